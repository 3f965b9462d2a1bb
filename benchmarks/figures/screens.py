"""Pictures of pages, as commands make them: `python -m benchmarks.figures walk`, `report`, `gait`.

The first is a movie of a recorded walk (rajagopal-walk-emg, Apache-2.0 and MIT) in OpenSim's bones
(CC BY 3.0); the second the first screen of the demonstration's report, in a Chromium; the third the
gait page of the recorded walk.
"""

from __future__ import annotations

import shlex
import shutil
import tempfile
from contextlib import chdir
from pathlib import Path

from browser import Browser, browser_program
from data_collection import data_folder
from myomorph.lab.cli import main

WALK = "rajagopal-walk-emg"
BONES = "bones-opensim-rajagopal/Geometry"
FILES = (
    "subject_walk_scaled.osim",
    "markers_walk.trc",
    "grf_walk.xml",
    "grf_walk.mot",
    "electromyography.sto",
)
WALK_COMMANDS = (
    "ik --model subject_walk_scaled.osim --markers markers_walk.trc --time 0.3 1.9 --out walk.mot",
    (
        "tension --model subject_walk_scaled.osim --motion walk.mot --loads grf_walk.xml"
        " --contact-points auto --emg electromyography.sto --emg-side right --emg-display-only"
        " --time 0.45 1.8 --out walk"
    ),
    (
        "view walk --movie walk.gif --time 0.6 1.7 --speed 0.4"
        " --curves walker_knee soleus_r gasmed_r"
    ),
)
GAIT_STUDY = """
[study]
name = "walking"
[[subject]]
name = "s01"
model = "subject_walk_scaled.osim"
mass = 85.27
trials = [{markers = "markers_walk.trc", loads = "grf_walk.xml", name = "walk"}]
steps = ["ik", "id", "report"]
[options.id]
cutoff = 6
"""
GAIT_SCREEN = (1000, 1120)
SCREEN = (1280, 890)
"""Width and height of the first screen [pixels]."""
LATE = 0.9
"""How long a page may take to draw itself [s]."""


def draw_walk(file: Path) -> None:
    """Write the movie of a walk; no EMG takes part in what is computed."""
    data = data_folder()
    with tempfile.TemporaryDirectory() as work, chdir(work):
        for name in FILES:
            shutil.copy(data / WALK / name, work)
        shutil.copytree(data / BONES, Path(work) / "Geometry")
        for command in WALK_COMMANDS:
            _run(command)
        shutil.copy("walk.gif", file)


def draw_report(file: Path) -> None:
    """Write the first screen of the demonstration's report.

    Raises
    ------
    RuntimeError : there is no Chromium
    """
    with tempfile.TemporaryDirectory() as work, chdir(work):
        _run("demo")
        _picture(Path(work) / "demo" / "report.html", SCREEN, file)


def draw_gait(file: Path) -> None:
    """Write the first screen of a recorded walk's gait page.

    Raises
    ------
    RuntimeError : there is no Chromium
    """
    with tempfile.TemporaryDirectory() as work, chdir(work):
        for name in FILES:
            shutil.copy(data_folder() / WALK / name, work)
        Path("study.toml").write_text(GAIT_STUDY, encoding="utf-8")
        _run("run study.toml --out results")
        _picture(Path(work) / "results" / "s01" / "walk" / "gait.html", GAIT_SCREEN, file)


def _picture(page: Path, size: tuple[int, int], file: Path) -> None:
    """Open a page in a Chromium, and write what a window of a size [pixels] shows."""
    program = browser_program()
    if program is None:
        raise RuntimeError("no Chromium: name one in MYOMORPH_BROWSER")
    width, height = size
    with Browser(program, Path.cwd() / "browser", width=width, height=height) as shown:
        shown.open(page.as_uri())
        shown.until("document.readyState === 'complete'")
        shown.run(f"new Promise(done => setTimeout(done, {1000 * LATE:.0f}))")
        shown.picture(file)


def _run(command: str) -> None:
    """Run a command of the program; raise `RuntimeError` where it fails."""
    status = main(shlex.split(command))
    if status:
        raise RuntimeError(f"myomorph {command}: exit status {status}")
