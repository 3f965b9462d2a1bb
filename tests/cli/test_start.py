"""What a command does before it computes: help, reading and `info` compile nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from data_collection import data_folder
from myomorph.core.rigid.kernel_code import TRIED

SOURCES = Path(__file__).parents[2] / "src"
COMMAND = """
import sys
from myomorph.lab.cli import main
status = main(sys.argv[1:])
every = ("numba", "llvmlite", "pydantic", "h5py", "mujoco", "scipy.signal", "scipy.stats")
heavy = [name for name in every if name in sys.modules]
print("LOADED", *heavy)
sys.exit(status)
"""


def loaded(tmp_path, *words):
    """Return the heavy packages that a command imports.

    The process has an empty folder of kernels, in which none may come to be.
    """
    kernels = tmp_path / "kernels"
    places = {"NUMBA_CACHE_DIR": str(kernels), "PYTHONPATH": str(SOURCES)}
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, *map(str, words)],
        env=os.environ | places,
        capture_output=True,
        text=True,
        check=True,
    )
    written = [path for path in kernels.rglob("*") if path.is_file()]
    assert all(path.name.startswith("methods-") for path in written)
    assert "compiling" not in done.stderr
    return done.stdout.splitlines()[-1].split()[1:]


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["info", "--help"]])
def test_help_imports_nothing_heavy(tmp_path, words):
    assert loaded(tmp_path, *words) == []


def test_help_of_a_step_compiles_nothing(tmp_path):
    assert "numba" not in loaded(tmp_path, "id", "--help")


def test_info_of_files_compiles_nothing(tmp_path, arm):
    for path in (arm.model, arm.markers, arm.motion, arm.loads):
        assert loaded(tmp_path, "info", path) == []


def test_info_of_a_model_with_knees_compiles_nothing(tmp_path):
    model = data_folder() / "hamner-run-subject04" / "unscaled_generic.osim"
    if not model.is_file():
        pytest.skip("hamner-run-subject04 is not there")
    assert loaded(tmp_path, "info", model) == []


def test_steps_whose_kernels_are_on_disk_never_meet_numba(tmp_path, arm):
    """The first run compiles what no command before it has left in the folder of kernels."""
    if not TRIED:
        pytest.skip("kernels run through Numba on this machine")
    model = ["--model", str(arm.model)]
    motion = tmp_path / "motion.mot"
    measured = [*model, "--motion", str(motion)]
    commands = [
        ["ik", *model, "--markers", str(arm.markers), "--out", str(motion)],
        ["id", *measured, "--loads", str(arm.loads), "--out", str(tmp_path / "id.sto")],
        ["muscles", *measured, "--out", str(tmp_path / "muscles")],
        ["tension", *measured, "--loads", str(arm.loads), "--out", str(tmp_path / "tension")],
    ]
    environment = os.environ | {"PYTHONPATH": str(SOURCES)}
    heavy = []
    for _ in range(2):
        heavy = []
        for words in commands:
            done = subprocess.run(
                [sys.executable, "-c", COMMAND, *words],
                env=environment,
                capture_output=True,
                text=True,
                check=True,
            )
            heavy.append(done.stdout.splitlines()[-1].split()[1:])
    assert all(set(names) <= {"llvmlite", "h5py"} for names in heavy), heavy
