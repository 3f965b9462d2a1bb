"""From nothing installed to the report of one's own recording, as a new user waits for it.

`python -m benchmarks first_result [--save]`. A wheel is built from this checkout, which is not
counted. In a fresh environment without compiled kernels it is installed from the package index that
pip knows, and a folder of recordings is analyzed, twice. Downloads depend on the line and on what
pip has kept.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from data_collection import data_folder

ROOT = Path(__file__).parents[1]
RECORDING = "c3d-gait-plugingait/HC002D"
"""A child's walks and static trial by a laboratory's Plug-in Gait, with plates (C3D)."""
LEFT_OUT = ("PYTHONPATH", "VIRTUAL_ENV", "MYOMORPH_STEP_TIMES")
"""Variables that a new user does not have."""


def run() -> list[dict[str, object]]:
    """Return a row for each step, and their sum until the first report."""
    with tempfile.TemporaryDirectory(prefix="myomorph first ") as name:
        folder = Path(name)
        build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", str(ROOT)]
        _timed(build, {}, folder)
        (wheel,) = folder.glob("*.whl")
        programs = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
        new = {"NUMBA_CACHE_DIR": str(folder / "kernels")}
        recording = str(data_folder() / RECORDING)
        analyze = [str(programs / "myomorph"), "analyze", recording, "--out"]
        install = [str(programs / "python"), "-m", "pip", "install", "--quiet", str(wheel)]
        steps = {
            "python -m venv": [sys.executable, "-m", "venv", str(folder / "venv")],
            "pip install": install,
            "myomorph analyze, the first time": [*analyze, "first"],
            "myomorph analyze, later": [*analyze, "second"],
        }
        taken = {step: _timed(command, new, folder) for step, command in steps.items()}
        if not list((folder / "first").rglob("report.html")):
            raise RuntimeError("myomorph analyze left no report")
    first = sum(seconds for step, seconds in taken.items() if step != "myomorph analyze, later")
    rows = {**taken, "until the first report": first}
    return [{"step": step, "seconds": round(seconds, 1)} for step, seconds in rows.items()]


def _timed(command: Sequence[str], more: Mapping[str, str], folder: Path) -> float:
    environment = {key: value for key, value in os.environ.items() if key not in LEFT_OUT}
    began = time.perf_counter()
    ended = subprocess.run(
        command, cwd=folder, env={**environment, **more}, capture_output=True, text=True
    )
    if ended.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {ended.returncode}: {ended.stderr}")
    return time.perf_counter() - began
