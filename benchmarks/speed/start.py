"""How long a user waits: import, the first command on a new machine with compilation, later
commands; size on disk.
"""

from __future__ import annotations

import importlib.metadata
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from packaging.requirements import Requirement

import myomorph


def installed_size(name: str) -> float:
    """Size of a package's files and of all that it requires without extras [bytes]."""
    left = [(name, "")]
    sizes = {}
    while left:
        one, extra = left.pop()
        if (one.lower(), extra) not in sizes:
            package = importlib.metadata.distribution(one)
            files = [Path(str(package.locate_file(file))) for file in package.files or ()]
            sizes[one.lower(), extra] = (
                0 if extra else sum(file.stat().st_size for file in files if file.is_file())
            )
            for needed in map(Requirement, package.requires or ()):
                if needed.marker is None or needed.marker.evaluate({"extra": extra}):
                    left += [(needed.name, also) for also in ("", *needed.extras)]
    return sum(sizes.values())


def seconds(arguments: list[str], environment: dict[str, str]) -> float:
    """Wall time of one command."""
    began = time.perf_counter()
    subprocess.run(
        [sys.executable, *arguments], check=True, env=environment, stdout=subprocess.DEVNULL
    )
    return time.perf_counter() - began


def run() -> list[dict[str, object]]:
    """Rows of what was waited for and how long."""
    rows: list[dict[str, object]] = [
        {"what": "packages without extras", "MB": 1e-6 * installed_size("myomorph")}
    ]
    with tempfile.TemporaryDirectory() as folder:
        # An empty cache of kernels is what a new machine has; pip compiled the modules when it
        # installed them.
        places = {
            "NUMBA_CACHE_DIR": str(Path(folder) / "cache"),
            "PYTHONPYCACHEPREFIX": str(Path(folder) / "modules"),
        }
        environment = {**os.environ, **places, "PYTHONDONTWRITEBYTECODE": ""}
        seconds(["-m", "compileall", "-q", str(Path(myomorph.__file__).parent)], environment)
        imports = [seconds(["-c", "import myomorph"], environment) for _ in range(5)]
        rows.append({"what": "python -c 'import myomorph'", "seconds": statistics.median(imports)})
        demo = ["-m", "myomorph.lab.cli", "demo", "--out"]
        first = seconds([*demo, str(Path(folder) / "first")], environment)
        rows.append({"what": "myomorph demo, first time (compiles)", "seconds": first})
        later = [seconds([*demo, str(Path(folder) / f"later{i}")], environment) for i in range(3)]
        rows.append({"what": "myomorph demo, later", "seconds": statistics.median(later)})
        helps = [seconds(["-m", "myomorph.lab.cli", "--help"], environment) for _ in range(5)]
        rows.append({"what": "myomorph --help", "seconds": statistics.median(helps)})
    return rows
