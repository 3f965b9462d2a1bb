"""Where forces act on feet: how far a center of pressure must lie from a sole to be looked at."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.core.contact import force_placement
from myomorph.core.contact.force_inspection import ForceSamples
from myomorph.core.contact.force_placement import (
    FITS,
    MARKED,
    NEAR,
    Remedy,
    check_origins,
    on_carriers,
)
from myomorph.core.model.series import Wrenches

UNIT = 0.8


@pytest.mark.parametrize(
    ("before", "after", "repaired"),
    [
        (1.01 * NEAR, 0.0, True),
        (0.99 * NEAR, 0.0, False),
        (1.01 * NEAR, 0.99 * MARKED * 1.01 * NEAR, True),
        (1.01 * NEAR, 1.01 * MARKED * 1.01 * NEAR, False),
        (1.0, 0.99 * FITS, True),
        (1.0, 1.01 * FITS, False),
    ],
)
def test_an_origin_is_changed_only_from_far_to_near(monkeypatch, before, after, repaired):
    """Distances are shares of the foot's length.

    A change must leave less than `FITS`, and less than `MARKED` of the distances before.
    """
    remedy = Remedy(
        kind="units",
        text="",
        done="",
        advice="",
        change=lambda force, point, torque: (force, point, torque),
    )
    monkeypatch.setattr(force_placement, "_remedies", lambda inspection, number: [remedy])
    zero = np.zeros((2, 1, 3))
    inspection = SimpleNamespace(
        numbers=[0],
        feet=SimpleNamespace(unit=UNIT),
        samples=ForceSamples(forces=zero, points=zero, torques=zero, loaded=np.ones((2, 1), bool)),
        misfit=lambda number, samples=None: UNIT * (before if samples is None else after),
        weights=lambda number: np.zeros(2),
        name=lambda number: "ForcePlate1",
    )
    repairs = [finding.repair.apply.keywords for finding in check_origins(inspection)]
    assert repairs == ([{"number": 0, "change": remedy.change}] if repaired else [])


def test_a_force_goes_to_the_carrier_of_each_step_and_nothing_is_lost():
    random = np.random.default_rng(0)
    time = np.arange(6.0)
    forces, points, torques = random.standard_normal((3, 6, 3, 3))
    wrenches = Wrenches(
        time=time,
        names=("a", "b", "c"),
        bodies=("heel_r", "heel_r", "hand"),
        forces=forces,
        points=points,
        torques=torques,
    )
    carried = on_carriers(wrenches, "b", ("heel_r", "heel_l", "heel_r"), [1.5, 3.5])
    assert carried.names == ("a", "b_heel_r", "b_heel_l", "c")
    assert carried.bodies == ("heel_r", "heel_r", "heel_l", "hand")
    for part in ("forces", "torques"):
        split = getattr(carried, part)
        np.testing.assert_array_equal(split[:, 1] + split[:, 2], getattr(wrenches, part)[:, 1])
        np.testing.assert_array_equal(
            np.any(split[:, 2] != 0.0, axis=1), [False, False, True, True, False, False]
        )
        np.testing.assert_array_equal(split[:, [0, 3]], getattr(wrenches, part)[:, [0, 2]])
    np.testing.assert_array_equal(carried.points, wrenches.points[:, [0, 1, 1, 2]])
    whole = on_carriers(wrenches, "b", ("heel_l",), [])
    assert (whole.names, whole.bodies) == (wrenches.names, ("heel_r", "heel_l", "hand"))
    np.testing.assert_array_equal(whole.forces, wrenches.forces)
