"""From a recording to its forces by foot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from made_walker import walker
from myomorph.core.model.series import Motion, Series
from myomorph.lab.movements.recorded_movement import RecordedMovement, support_force

BODY = walker()
WEIGHT = 600.0
STILL = Motion(np.arange(3.0), BODY.coordinate_names, np.zeros((3, len(BODY.coordinate_names))))


def recorded(right: float, left: float) -> RecordedMovement:
    """Give a squat whose feet carry shares of the weight."""
    time = np.arange(0.0, 2.0, 0.001)
    values = np.tile([right * WEIGHT, left * WEIGHT], (len(time), 1))
    return RecordedMovement(
        movement="squatting",
        model=BODY,
        motion=STILL,
        fit=None,
        torques=None,
        measured=Series(time, ("foot_r", "foot_l"), values),
        shared=False,
        strides=None,
        center=None,
        up=np.array([0.0, 1.0, 0.0]),
        floor=0.0,
        weight=WEIGHT,
    )


def test_forces_are_those_of_their_feet() -> None:
    force = support_force(recorded(0.6, 0.4))
    assert force is not None
    assert force.right_share(0.2, 1.8) == pytest.approx(60.0)
    np.testing.assert_allclose(force.total, WEIGHT)


@pytest.mark.parametrize("shared", [True, False])
def test_a_force_that_was_halved_or_shared_shows_no_share(shared: bool) -> None:
    given = recorded(0.6, 0.4) if shared else recorded(0.5, 0.5)
    force = support_force(replace(given, shared=shared))
    assert force is not None
    assert force.right is None
    assert np.isnan(force.right_share(0.2, 1.8))
    np.testing.assert_allclose(force.total, WEIGHT)


def test_a_foot_beside_its_plate_shows_no_share() -> None:
    force = support_force(recorded(0.9, 0.0))
    assert force is not None
    assert force.right is None


def test_without_plates_there_is_no_force() -> None:
    assert support_force(replace(recorded(0.6, 0.4), measured=None)) is None
