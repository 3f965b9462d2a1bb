"""The spread of d_M under wrong moment arms, and its laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from swung_limb import LIMB, released

from myomorph.core.model.errors import BadData
from myomorph.swings.viscosity.trust.moment_arms import (
    MomentArmOptions,
    moment_arm_sensitivity,
)

JOINT = 0.03
MUSCLE = 90.0
FEW = MomentArmOptions(draws=2, offset=0.0)


@pytest.fixture(scope="module")
def intact() -> list:
    return released()["muscles"]


@pytest.fixture(scope="module")
def sensitivity(intact):
    return moment_arm_sensitivity(intact, LIMB, JOINT, MomentArmOptions(draws=4000, offset=1e-3))


def test_exact_arms_give_the_truth(sensitivity):
    assert sensitivity[0].exact == pytest.approx(MUSCLE, rel=1e-3)


def test_a_common_factor_acts_by_its_inverse_square(intact, sensitivity):
    longer = [replace(one, lengthening=1.1 * one.lengthening) for one in intact]
    assert moment_arm_sensitivity(longer, LIMB, JOINT, FEW)[0].exact == pytest.approx(
        MUSCLE / 1.1**2, rel=1e-3
    )
    spread = sensitivity[0]
    factors = np.sqrt(spread.exact / spread.draws)
    assert np.std(factors) == pytest.approx(0.1, rel=0.05)
    assert np.mean(factors) == pytest.approx(1.0, abs=0.01)


def test_factors_of_each_muscle_average_out_but_a_common_one_does_not(intact, sensitivity):
    common, each = sensitivity[:2]
    step = 1e-4
    slopes = []
    for m in range(4):
        factor = np.ones((4, 1))
        factor[m] += step
        moved = [replace(one, lengthening=factor * one.lengthening) for one in intact]
        slopes.append(
            np.log(moment_arm_sensitivity(moved, LIMB, JOINT, FEW)[0].exact / common.exact) / step
        )
    assert sum(slopes) == pytest.approx(-2.0, abs=5e-3)
    assert each.sd == pytest.approx(0.1 * np.linalg.norm(slopes), rel=0.15)
    assert common.sd == pytest.approx(0.2, rel=0.15)
    assert each.sd < common.sd
    low, middle, high = each.quantiles()
    assert low < middle < high
    assert low < MUSCLE < high


def test_offsets_act_as_arms_that_are_moved(intact):
    spread = moment_arm_sensitivity(
        intact, LIMB, JOINT, MomentArmOptions(draws=4, offset=2e-3, seed=7)
    )[-1]
    random = np.random.default_rng(7)
    random.standard_normal((4, 1))
    random.standard_normal((4, 4))
    for found in spread.draws:
        offset = 2e-3 * random.standard_normal((4, 3))
        moved = [replace(one, lengthening=one.lengthening + offset) for one in intact]
        assert moment_arm_sensitivity(moved, LIMB, JOINT, FEW)[0].exact == pytest.approx(
            found, rel=5e-3
        )
    assert spread.exact == pytest.approx(MUSCLE, rel=1e-3)


def test_swings_without_muscles_are_refused(intact):
    bare = [replace(one, muscles=(), lengthening=one.lengthening[:, :0]) for one in intact]
    with pytest.raises(BadData, match="no viscosity of muscles"):
        moment_arm_sensitivity(bare, LIMB, JOINT)
