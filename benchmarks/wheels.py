"""Which dependencies have no wheel for a system: `python -m benchmarks wheels`.

pip looks for the wheels of all dependencies in pyproject.toml, as if it ran on that system;
nothing is installed. Those whose marker excludes the system are left out, and those whose
wheel here is one for every system. Wheels of dependencies' dependencies are not looked up.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from urllib.parse import unquote

from packaging.requirements import Requirement
from packaging.utils import parse_wheel_filename

ROOT = Path(__file__).parents[1]
PYTHON = "3.12"
SYSTEMS: dict[str, tuple[tuple[str, ...], dict[str, str]]] = {
    "Windows x86-64": (("win_amd64",), {"sys_platform": "win32", "platform_machine": "AMD64"}),
    "Windows ARM64": (("win_arm64",), {"sys_platform": "win32", "platform_machine": "ARM64"}),
    "macOS arm64": (
        ("macosx_15_0_arm64",),
        {"sys_platform": "darwin", "platform_machine": "arm64"},
    ),
    "Linux arm64": (
        (
            "manylinux_2_34_aarch64",
            "manylinux_2_28_aarch64",
            "manylinux_2_27_aarch64",
            "manylinux_2_17_aarch64",
        ),
        {"sys_platform": "linux", "platform_machine": "aarch64"},
    ),
}
"""pip's names of a system's wheels, and what markers ask of it."""


def run() -> list[dict[str, object]]:
    """Return the number of dependencies, and those without a wheel, per system and group."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = {"core": project["dependencies"], **project["optional-dependencies"]}
    rows: list[dict[str, object]] = []
    for system, (tags, facts) in SYSTEMS.items():
        for group in ("core", "test", "oracles", "live"):
            wanted = list(wanted_on(groups[group], facts))
            missing = without_wheel(wanted, tags)
            left_out = len(groups[group]) - len(wanted)
            rows.append(
                {
                    "system": system,
                    "dependencies": group,
                    "asked for": len(wanted),
                    "left out by marker": left_out,
                    "no wheel": ", ".join(missing) or "none",
                }
            )
    return rows


def wanted_on(requirements: list[str], facts: dict[str, str]) -> Iterator[str]:
    """Yield requirements, without their markers, that hold on a system."""
    for text in requirements:
        one = Requirement(text)
        if one.marker is None or one.marker.evaluate({**facts, "python_version": PYTHON}):
            yield f"{one.name}{one.specifier}"


def without_wheel(requirements: Iterable[str], tags: tuple[str, ...]) -> list[str]:
    """Names of the requirements for which pip knows no wheel with one of the tags."""
    needed = [one for one in map(Requirement, requirements) if not runs_anywhere(one.name)]
    with ThreadPoolExecutor(4) as pool:
        found = pool.map(lambda one: versions(one.name, tags), needed)
    return [
        one.name
        for one, some in zip(needed, found, strict=True)
        if not any(map(one.specifier.contains, some))
    ]


def runs_anywhere(name: str) -> bool:
    """Whether the wheel that is installed here is one for every system."""
    try:
        return "-none-any" in (distribution(name).read_text("WHEEL") or "")
    except PackageNotFoundError:
        return False


def versions(name: str, tags: tuple[str, ...]) -> set[str]:
    """Return versions of which pip finds a wheel with one of the tags.

    pip prints that in its log alone, but downloads nothing.
    """
    command = [
        *(sys.executable, "-m", "pip", "index", "versions", "-vv", "--disable-pip-version-check"),
        *(
            "--python-version",
            PYTHON,
            *(part for tag in tags for part in ("--platform", tag)),
            name,
        ),
    ]
    ended = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)
    if (
        ended.returncode != 0
        and "No matching distribution found" not in ended.stdout + ended.stderr
    ):
        raise RuntimeError(f"pip failed: {ended.stderr.strip()}")
    wheels = re.findall(r"Found link \S*/([^/\s#]+\.whl)", ended.stdout)
    return {str(parse_wheel_filename(unquote(one))[1]) for one in wheels}
