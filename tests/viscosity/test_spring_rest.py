"""A ball's spring that is slack far from hanging is found, and its viscosity with it."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.swings.viscosity.identification.identify import identify_specimen
from myomorph.swings.viscosity.identification.inertia import InertiaOptions, limb_inertia
from myomorph.swings.viscosity.identification.torque import (
    counted_from,
    neutral_position,
    spring_misfit,
)
from myomorph.swings.viscosity.swings.sums import swing_sums
from truths.mechanical_joint import JointExperiment, mechanical_joint


@pytest.mark.parametrize(
    ("damping", "stiffness", "rest"), [(0.02, 1.0, (-0.2, 0.4, 0.0)), (0.05, 3.0, (0.3, -0.2, 0.5))]
)
def test_viscosity_beside_a_spring_with_another_rest(damping, stiffness, rest) -> None:
    joint = mechanical_joint(
        "ball", damping, stiffness, 7, experiment=JointExperiment(seconds=10.0, trials=2, rest=rest)
    )
    found = identify_specimen("joint", joint.exact_swings(), ()).without
    assert found is not None
    assert found.viscosity.value == pytest.approx(damping, rel=1e-3)
    assert found.viscosity.holds(damping)


def test_counting_from_the_rest_leaves_less_of_the_torque() -> None:
    joint = mechanical_joint(
        "ball",
        0.02,
        1.0,
        7,
        experiment=JointExperiment(seconds=10.0, trials=2, rest=(-0.2, 0.4, 0.0)),
    )
    swings = joint.exact_swings()
    sums = swing_sums(swings)
    parameters = limb_inertia(sums, None, InertiaOptions()).parameters
    before = spring_misfit(sums, parameters)
    shift = neutral_position(sums, parameters)
    assert np.linalg.norm(shift) == pytest.approx(np.linalg.norm(joint.truth.rest), abs=0.05)
    moved = counted_from(swings, shift)
    assert spring_misfit(swing_sums(moved), parameters) < 1e-2 * before


def test_without_a_spring_nothing_moves_the_viscosity() -> None:
    joint = mechanical_joint(
        "ball", 0.05, 0.0, 3, experiment=JointExperiment(seconds=10.0, trials=2)
    )
    found = identify_specimen("joint", joint.swings(8.0), ()).without
    assert found is not None
    assert found.viscosity.value == pytest.approx(0.05, rel=0.03)
