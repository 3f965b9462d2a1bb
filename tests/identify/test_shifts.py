"""The matter of bodies lies where the rows show, beside their frames."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.body.identify.shifts import SHIFT_SD, MatterShifts, moved
from myomorph.body.identify.sides import sides_of
from myomorph.core.io.formats import read_model
from myomorph.core.model.inertia import inertial_parameters, pseudo_inertias


@pytest.fixture(scope="module")
def model(data):
    return read_model(data("rajagopal-walk-emg/subject_walk_scaled.osim"))


def test_matter_that_moves_keeps_its_mass_and_shape(model):
    own = inertial_parameters(model)
    by = np.tile([0.01, -0.02, 0.03], (len(own), 1))
    there = moved(own, by)
    np.testing.assert_allclose(there[:, 0], own[:, 0])
    np.testing.assert_allclose(there[:, 1:4], own[:, 1:4] + own[:, :1] * by, atol=1e-12)
    heavy = own[:, 0] > 0.1
    for before, after in zip(
        pseudo_inertias(own)[heavy], pseudo_inertias(there)[heavy], strict=True
    ):
        about = [P[:3, :3] - np.outer(P[:3, 3], P[:3, 3]) / P[3, 3] for P in (before, after)]
        np.testing.assert_allclose(about[1], about[0], atol=1e-9)
    np.testing.assert_allclose(moved(there, -by), own, atol=1e-9)


def test_both_sides_shift_mirrored(model):
    own = inertial_parameters(model)
    shifts = MatterShifts.of(own, sides_of(model, own))
    names = list(model.body_names)
    right = shifts.directions[names.index("femur_r")]
    left = shifts.directions[names.index("femur_l")]
    both = (np.abs(right).max(axis=0) > 0.0) & (np.abs(left).max(axis=0) > 0.0)
    assert both.sum() == 3
    np.testing.assert_allclose(left[:, both], np.diag([1.0, 1.0, -1.0]) @ right[:, both], atol=1e-6)
    assert np.linalg.norm(shifts.directions[names.index("torso")], axis=1).max() == SHIFT_SD
    # Masses do not change.
    np.testing.assert_array_equal(shifts.columns[::10], 0.0)


def test_weighed_rows_are_those_of_masses_and_shifts_together(model):
    """Least squares with unknowns for shifts, and the same without them by weighed rows."""
    random = np.random.default_rng(3)
    own = inertial_parameters(model)
    shifts = MatterShifts.of(own, None)
    A = random.standard_normal((60, own.size)) * np.tile([3.0, *[10.0] * 3, *[30.0] * 6], len(own))
    b = A @ own.ravel() + random.standard_normal(60)
    B = shifts.columns
    # A prior of the parameters beside the shifts.
    wide = np.diag(1.0 / np.full(own.size, 0.1))
    by_rows = np.vstack([*(np.hstack([A, A @ B]), np.hstack([wide, np.zeros_like(B)]))])
    by_rows = np.vstack(
        [by_rows, np.hstack([np.zeros((B.shape[1], own.size)), np.eye(B.shape[1])])]
    )
    right = np.concatenate([b, wide @ own.ravel(), np.zeros(B.shape[1])])
    together = np.linalg.lstsq(by_rows, right)[0]
    weighed_A, weighed_b = shifts.weighed((A, b))
    alone = np.linalg.lstsq(
        np.vstack([weighed_A, wide]), np.concatenate([weighed_b, wide @ own.ravel()])
    )[0]
    np.testing.assert_allclose(alone, together[: own.size], atol=1e-6)
    found = shifts.added((A, b), alone.reshape(-1, 10))
    displaced = (shifts.directions @ together[own.size :]) * own[:, :1]
    np.testing.assert_allclose(
        found[:, 1:4] - alone.reshape(-1, 10)[:, 1:4],
        displaced,
        atol=2e-2 * np.abs(displaced).max(),
    )
