"""Shifts of the matter of bodies, alike on both sides."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.body.identify.shifts import SHIFT_SD, MatterShifts
from myomorph.body.identify.sides import sides_of
from myomorph.core.io.formats import read_model
from myomorph.core.model.inertia import inertial_parameters


@pytest.fixture(scope="module")
def model(data):
    return read_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))


def test_both_sides_shift_mirrored(model):
    own = inertial_parameters(model)
    shifts = MatterShifts.of(own, sides_of(model, own))
    names = list(model.body_names)
    right = shifts.directions[names.index("femur_r")]
    left = shifts.directions[names.index("femur_l")]
    both = (np.abs(right).max(axis=0) > 0.0) & (np.abs(left).max(axis=0) > 0.0)
    assert both.sum() == 3
    np.testing.assert_allclose(left[:, both], np.diag([1.0, 1.0, -1.0]) @ right[:, both], atol=1e-6)
    torso = shifts.directions[names.index("torso")]
    np.testing.assert_allclose(torso @ torso.T, SHIFT_SD**2 * np.eye(3), atol=1e-12)


def test_matter_that_moves_keeps_its_mass(model):
    own = inertial_parameters(model)
    shifts = MatterShifts.of(own, None)
    change = shifts.columns.reshape(*own.shape, -1)
    np.testing.assert_array_equal(change[:, 0], 0.0)
    np.testing.assert_allclose(change[:, 1:4], own[:, :1, None] * shifts.directions, atol=1e-12)
