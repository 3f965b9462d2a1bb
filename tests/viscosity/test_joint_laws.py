"""What a mechanical joint does is found as it is, and what swings do not show is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.swings.viscosity.identification.excitation import Excitation
from myomorph.swings.viscosity.identification.identify import ViscosityOptions, identify_specimen
from myomorph.swings.viscosity.identification.inertia import limb_inertia
from myomorph.swings.viscosity.swings.sums import swing_sums
from myomorph.swings.viscosity.trust.freed import ActingTerms, FreedProblem
from myomorph.swings.viscosity.trust.models import PassiveOptions, compare_passive_laws
from truths.mechanical_joint import JointExperiment, mechanical_joint

DAMPING = 0.06
FRICTION = 0.02
FEW = PassiveOptions(draws=60)


def test_dry_friction_of_a_hinge_is_found_and_leaves_the_damping():
    """Without errors of the inertia of a stated size they took all that resists."""
    joint = mechanical_joint(
        "hinge", DAMPING, 0.0, 61, experiment=JointExperiment(seconds=12.0, friction=FRICTION)
    )
    acting = compare_passive_laws(joint.swings(8.0), FEW).acting
    assert acting is not None
    assert acting.friction
    assert acting.coefficients["dry friction"].holds(FRICTION)
    assert abs(acting.coefficients["viscosity"].value / DAMPING - 1.0) < 0.05


def test_a_ball_that_is_released_without_spin_stays_one_value():
    """Errors of the inertia that act on a noisy acceleration took the torque about its length."""
    joint = mechanical_joint(
        "ball", DAMPING, 0.0, 106, experiment=JointExperiment(seconds=15.0, spin=0.0)
    )
    swings = [replace(one, cutoff=10.0) for one in joint.swings(10.0)]
    assert compare_passive_laws(swings, FEW).acting is None
    sums = swing_sums(swings)
    limb = replace(limb_inertia(sums), parameters=joint.truth.parameters)
    freed = FreedProblem.of(swings, sums, limb)
    axes = freed.fit(ActingTerms("viscosity by axis")).law[:3] / DAMPING
    assert (np.abs(axes - 1.0) < [0.03, 0.03, 0.08]).all()


def test_an_axis_whose_rates_are_noise_is_not_shown():
    joint = mechanical_joint("ball", DAMPING, 0.0, 4, experiment=JointExperiment(seconds=12.0))
    swings = [replace(one, cutoff=10.0) for one in joint.swings(10.0)]
    plain = Excitation.of(swings)
    assert plain.shown.all()
    # Noise of the rates follows from that of the accelerations: markers of 0.3 mm.
    exact = np.concatenate([one.rates[one.used] for one in joint.exact_swings()])
    assert (plain.noise < 0.1 * np.sqrt(np.square(exact).mean(axis=0))).all()
    still = [replace(one, rates=one.rates * [1.0, 1.0, 0.02]) for one in swings]
    assert Excitation.of(still).shown.tolist() == [True, True, False]
    options = ViscosityOptions(draws=40, stiffness=False)
    condition = identify_specimen("still", still, (), options=options).without
    assert condition is not None
    assert condition.excited == (True, True, False)
    hidden = condition.axis_viscosity[2]
    assert np.isnan(hidden.value)
    assert (hidden.low, hidden.high) == (0.0, np.inf)
