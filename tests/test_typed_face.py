"""Type checkers see the types of the public face, and names of options that do not exist."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
REVEALED = """
import myomorph as mm

walk = mm.sample("walk")
fit = mm.inverse_kinematics(walk.model, walk.markers)
reveal_type(walk)
reveal_type(fit.motion)
reveal_type(fit.motion.strides(walk.events).mean("knee_angle_r"))
reveal_type(mm.analyze("walk.c3d", mass=70.0).trial.tension)
mm.analyze("walk.c3d", weight=70.0)
"""


@pytest.mark.long
def test_results_and_options_have_types(tmp_path):
    pytest.importorskip("mypy")
    program = tmp_path / "typed.py"
    program.write_text(REVEALED, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml")]
    done = subprocess.run(
        [*command, "--cache-dir", str(tmp_path), str(program)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    lines = done.stdout.splitlines()
    types = [line.split("Revealed type is ")[1] for line in lines if "Revealed type" in line]
    assert [text.strip('"').rpartition(".")[2] for text in types[:2]] == ["Sample", "Motion"]
    assert "ndarray" in types[2]
    assert "Tension" in types[3]
    errors = [line for line in lines if ": error:" in line]
    assert len(errors) == 1
    assert "weight" in errors[0]
