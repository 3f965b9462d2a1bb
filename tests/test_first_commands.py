"""The commands of the first page do what they say on a laboratory's files of those names."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from docs_build.examples import run_command, working_in

PAGE = Path(__file__).resolve().parents[1] / "docs" / "getting-started.md"
ELSEWHERE = {"view", "live", "analyze", "morph", "viscosity", "run", "run-tool", "demo"}
"""What waits for a browser or for streams; and what needs other files, which other tests run."""


def page_commands():
    """Return the commands under "Step by step", in their order."""
    text = PAGE.read_text(encoding="utf-8").split("## Step by step")[1].split("\n## ")[0]
    lines = re.findall(r"^myomorph .*$", text, re.MULTILINE)
    return [line for line in lines if line.split()[1] not in ELSEWHERE]


@pytest.fixture
def laboratory(data, tmp_path):
    """Make a folder with a walk, its forces and EMG under the names of the page.

    The walk stands for the squat too.
    """
    walk = data("rajagopal-walk-emg")
    shutil.copy(first_c3d(data("c3d-gait-plugingait")), tmp_path / "walk1.c3d")
    for source, name in (
        ("subject_walk_scaled.osim", "generic.osim"),
        ("raw/static_walk_1.trc", "static.trc"),
        ("markers_walk.trc", "walk1.trc"),
        ("markers_walk.trc", "squat1.trc"),
        ("grf_walk.xml", "walk1_grf.xml"),
        ("grf_walk.xml", "squat1_grf.xml"),
        ("grf_walk.mot", "grf_walk.mot"),
        ("electromyography.sto", "walk1_emg.sto"),
    ):
        shutil.copy(walk / source, tmp_path / name)
    return tmp_path


def first_c3d(folder):
    return next(iter(sorted(folder.rglob("*.c3d"))))


def test_there_are_commands():
    assert [line.split()[1] for line in page_commands()] == [
        "info",
        "calibrate",
        "ik",
        "id",
        "muscles",
        "tension",
        "report",
        "convert",
        "export",
        "tension",
        "personalize",
        "tension",
        "identify",
    ]


@pytest.mark.long
def test_page_commands_run(laboratory):
    with working_in(laboratory):
        for line in page_commands():
            if line.startswith("myomorph identify"):
                run_command(
                    "myomorph ik --model subject.osim --markers squat1.trc --out squat1.mot",
                    PAGE.name,
                )
                # A coarse grid of mass points: the command is tried, not its numbers.
                line += " --spacing 0.02"
            print(run_command(line, PAGE.name))
    for name in (
        "subject.osim",
        "walk1.mot",
        "walk1_torques.sto",
        "walk1_tension/report.html",
        "identified.osim",
    ):
        assert (laboratory / name).is_file()
    assert (laboratory / "walk1").is_dir()
    assert (laboratory / "walk1_contacts" / "contact_forces.xml").is_file()
    assert (laboratory / "walk1_loads" / "joint_contact_forces.sto").is_file()
