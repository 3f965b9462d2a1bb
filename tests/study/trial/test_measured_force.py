"""Vertical forces as measured: those on one body add up; a recording may have none."""

from __future__ import annotations

import numpy as np

from myomorph.core.io.formats import read_model
from myomorph.core.model.series import Wrenches
from myomorph.lab.study.trial.measured_force import vertical_forces

TIME = np.arange(5) / 100.0


def loads(*bodies):
    forces = np.zeros((len(TIME), len(bodies), 3))
    forces[:, :, 1] = 1.0 + np.arange(len(bodies))
    names = tuple(f"plate {number}" for number in range(len(bodies)))
    nothing = np.zeros_like(forces)
    return Wrenches(
        time=TIME, names=names, bodies=bodies, forces=forces, points=nothing, torques=nothing
    )


def test_forces_on_a_body_add_up(arm):
    measured = vertical_forces(loads("foot", "hand", "foot", ""), read_model(arm.model))
    assert measured.names == ("foot", "hand", "plate 3")
    np.testing.assert_array_equal(measured.values, np.tile([4.0, 2.0, 4.0], (len(TIME), 1)))


def test_a_recording_without_forces_has_none(arm):
    measured = vertical_forces(loads(), read_model(arm.model))
    assert measured.names == ()
    assert measured.values.shape == (len(TIME), 0)
