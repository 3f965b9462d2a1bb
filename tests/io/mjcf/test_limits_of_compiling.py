"""Compiling a stranger's file: limits of processor time, thin rods, fibers that cannot be."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.mjcf.read import read_mjcf
from myomorph.core.io.mjcf.write import with_least_moments
from myomorph.core.io.parsing.guard import run_guarded
from myomorph.core.model.paths import impossible_fibers

LIMITED = pytest.mark.skipif(sys.platform == "win32", reason="the system has no such limits")
MODEL = """<mujoco><worldbody>
<body name="base"><geom type="capsule" size="0.03" fromto="0 0 0 0 0 0.1" mass="2"/>
<site name="a" pos="-0.03 0 0.02"/>
<body name="tip" pos="0 0 0.1"><joint name="bend" axis="0 1 0" range="-0.5 0.5"/>
<geom type="capsule" size="0.03" fromto="0 0 0 0 0 0.2" mass="5"/>
<site name="b" pos="-0.03 0 0.08"/></body></body></worldbody>
<tendon><spatial name="t"><site site="a"/><site site="b"/></spatial></tendon>
<actuator><general name="pull" tendon="t" dyntype="muscle" gaintype="muscle" biastype="muscle"
 dynprm="0.01 0.04" lengthrange="0.12 0.17" gainprm="{range} 400 1 0.5 1.6 10 1.3 1.2"
 biasprm="{range} 400 1 0.5 1.6 10 1.3 1.2"/></actuator></mujoco>"""


def _burn(seconds: str) -> None:
    """Take processor time, as a file with a trap would."""
    until = time.monotonic() + float(seconds)
    while time.monotonic() < until:
        pass


def _sleep(seconds: str) -> None:
    """Wait without taking processor time, as on a busy machine."""
    time.sleep(float(seconds))


@LIMITED
def test_processor_time_is_limited(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=":")
    name = "test_limits_of_compiling:_burn"
    outcome = run_guarded(name, ["30"], 60.0, processor_seconds=1.0)
    assert outcome.status == "hung"
    assert "processor time" in outcome.message


@LIMITED
def test_time_that_others_take_does_not_count(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=":")
    outcome = run_guarded("test_limits_of_compiling:_sleep", ["2.5"], 60.0, processor_seconds=2.0)
    assert outcome.status == "done"


@pytest.mark.parametrize(("operating", "named"), [("0.99 1.0", True), ("0.6 1.4", False)])
def test_fibers_longer_than_their_muscle_are_named(tmp_path, operating, named):
    path = tmp_path / "back.xml"
    path.write_text(MODEL.format(range=operating), encoding="utf-8")
    model = read_mjcf(path)
    assert impossible_fibers(model.muscles) == (("pull",) if named else ())
    assert any("longer than the muscles" in warning for warning in model.warnings) == named


def test_a_thin_rod_gets_the_least_moment():
    rod = np.diag([0.02, 0.0, 0.02])
    thick = with_least_moments(rod)
    values = np.linalg.eigvalsh(thick)
    assert 0.0 < values[0] <= 2e-6 * values[2]
    assert values[0] + values[1] >= values[2]
    np.testing.assert_allclose(thick, rod, atol=1e-7)
    solid = np.diag([0.02, 0.001, 0.021])
    assert with_least_moments(solid) is solid
