"""Pictures of the README, as its commands make them: `python -m benchmarks.figures walk`, `report`.

The first is a movie of a recorded walk (rajagopal-walk-emg, Apache-2.0 and MIT) in OpenSim's bones
(CC BY 3.0); the second the first screen of the demonstration's report, in a Chromium.
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
    program = browser_program()
    if program is None:
        raise RuntimeError("no Chromium: name one in MYOMORPH_BROWSER")
    with tempfile.TemporaryDirectory() as work, chdir(work):
        _run("demo")
        width, height = SCREEN
        profile = Path(work) / "browser"
        with Browser(program, profile, width=width, height=height) as page:
            page.open((Path(work) / "demo" / "report.html").as_uri())
            page.until("document.readyState === 'complete'")
            page.run(f"new Promise(done => setTimeout(done, {1000 * LATE:.0f}))")
            page.picture(file)


def _run(command: str) -> None:
    """Run a command of the program; raise `RuntimeError` where it fails."""
    status = main(shlex.split(command))
    if status:
        raise RuntimeError(f"myomorph {command}: exit status {status}")
