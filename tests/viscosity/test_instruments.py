"""Laws of instruments estimated from swings.

What swings show is found, what they cannot show stays assumed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.swings.viscosity.identification.budget import ErrorOptions, disturbed
from myomorph.swings.viscosity.identification.identify import ViscosityOptions, identify_specimen
from myomorph.swings.viscosity.identification.instruments import Instruments, estimate_instruments
from truths.mechanical_joint import JointExperiment, mechanical_joint

DAMPING = 0.055
ORIGIN = np.array([0.2, 0.0, -0.8])
OPTIONS = ViscosityOptions(draws=10, stiffness=False)


@pytest.fixture(scope="module")
def swings():
    made = mechanical_joint(
        "ball", DAMPING, 0.0, seed=4, experiment=JointExperiment(seconds=8.0)
    ).swings()
    return [replace(one, origin=ORIGIN) for one in made]


def off(swings, *errors):
    for error in errors:
        swings = [disturbed(one, *error) for one in swings]
    return swings


def found_of(swings):
    one = identify_specimen("limb", swings, [], options=OPTIONS).without
    return one.mass.value, one.com.value, one.viscosity.value


@pytest.mark.parametrize(
    "errors",
    [
        [("plate_position", 0, 0.005), ("plate_position", 2, -0.005)],
        [("moment_gain", 0, 0.02), ("moment_gain", 1, -0.01), ("moment_gain", 2, 0.02)],
        [("plate_rotation", 1, 0.01)],
        [("plate_clock", 0, 0.002)],
    ],
    ids=["plate", "gains", "turned plate", "late clock"],
)
def test_estimates_change_no_more_than_their_prior_lets_gains_change(swings, errors):
    """Without correction these errors change mass center or viscosity by up to ten percent."""
    exact = found_of(swings)
    wrong = off(swings, *errors)
    instruments = estimate_instruments({"without": wrong}, ErrorOptions())
    repaired = found_of([instruments.corrected(one) for one in wrong])
    assert np.abs(np.array(repaired) / exact - 1.0).max() < 0.006
    assert (
        np.abs(np.array(repaired) / exact - 1.0).max()
        < 0.5 * np.abs(np.array(found_of(wrong)) / exact - 1.0).max()
    )


def test_a_gain_that_all_channels_share_moves_no_limb_and_stays_unknown(swings):
    gains = [(name, axis, 0.02) for name in ("force_gain", "moment_gain") for axis in range(3)]
    plain = estimate_instruments({"without": swings}, ErrorOptions())
    shared = estimate_instruments({"without": off(swings, *gains)}, ErrorOptions())
    np.testing.assert_allclose(shared.errors / shared.prior, plain.errors / plain.prior, atol=0.05)
    along = np.array([0.01 if name.endswith("gain") else 0.0 for name, _ in shared.sources])
    assert along @ np.linalg.solve(shared.covariance, along) == pytest.approx(
        along @ np.linalg.solve(np.diag(shared.prior**2), along), rel=0.02
    )


def test_a_plate_and_a_center_that_are_off_are_told_only_together(swings):
    wrong = off(swings, ("plate_position", 0, 0.006))
    found = estimate_instruments({"without": wrong}, ErrorOptions())
    size = dict(zip(found.sources, found.errors, strict=True))
    sign = {"plate_position": 1.0, "joint_center": -1.0}
    apart = np.array([sign.get(name, 0.0) * (axis == 0) for name, axis in found.sources])
    left = float(np.sqrt(apart @ found.covariance @ apart))
    assert left < 0.25 * float(np.sqrt(apart @ np.diag(found.prior**2) @ apart))
    assert apart @ found.errors == pytest.approx(0.006, abs=3.0 * left)
    # As the prior has it: 2 and 3 mm.
    assert -size["joint_center", 0] / size["plate_position", 0] == pytest.approx(
        9.0 / 4.0, rel=0.05
    )


def test_without_a_source_nothing_is_estimated(swings):
    none = replace(ErrorOptions(), **dict.fromkeys(ErrorOptions().names, 0.0))
    assert estimate_instruments({"without": swings}, none).sources == ()
    assert Instruments.assumed(none).rows == ()
