"""Intervals of the damping of a mechanical joint in MuJoCo: with dry friction, and without spin."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np

from benchmarks.accuracy.intervals.covered import Covered, joined
from myomorph.swings.viscosity.identification.identify import ViscosityOptions, identify_specimen
from myomorph.swings.viscosity.specimen.model import SpecimenNames, SwingTrial, build_specimen
from myomorph.swings.viscosity.tracking.track import track
from myomorph.swings.viscosity.tracking.tracked import swing_recordings
from myomorph.swings.viscosity.trust.cutoff import choose_cutoff
from myomorph.swings.viscosity.trust.models import PassiveOptions, compare_passive_laws
from truths.mechanical_joint import JointExperiment, mechanical_joint

SECONDS = 15.0
JOINTS = 16
FRICTION = 0.02
"""Length of a trial [s], joints of each kind, and dry friction of an axis [N m]."""


class Kind(NamedTuple):
    """What joints are like.

    Attributes
    ----------
    joint : hinge or ball
    friction : dry, of every axis [N m]
    spin : of the limb about its length as it is released, over the usual one
    """

    joint: Literal["hinge", "ball"]
    friction: float = 0.0
    spin: float = 1.0


KINDS: Mapping[str, Kind] = {
    f"hinge with dry friction of {FRICTION:g} N m": Kind("hinge", friction=FRICTION),
    f"ball with dry friction of {FRICTION:g} N m": Kind("ball", friction=FRICTION),
    "ball, released without spin": Kind("ball", spin=0.0),
}


def dampings(kind: Kind, first: int) -> dict[str, Covered]:
    """Identify joints and compare the intervals of their dampings with the truth.

    Parameters
    ----------
    kind : of the joints
    first : seed of the first joint

    Returns
    -------
    of the one viscosity, and of what is said to resist about single axes
    """
    parts: dict[str, list[Covered]] = {"d_J": [], "d_J of single axes": []}
    for seed in range(first, first + JOINTS):
        for name, covered in _joint(kind, seed).items():
            parts[name].append(covered)
    return {name: joined(own) for name, own in parts.items()}


def _joint(kind: Kind, seed: int) -> dict[str, Covered]:
    """Identify one joint, as a study does without errors of instruments."""
    damping = float(np.exp(np.random.default_rng(seed).uniform(np.log(0.03), np.log(0.1))))
    made = mechanical_joint(
        kind.joint,
        damping,
        0.0,
        seed,
        experiment=JointExperiment(seconds=SECONDS, friction=kind.friction, spin=kind.spin),
    )
    specimen = build_specimen(made.model, SpecimenNames("base", "limb", joint=kind.joint))
    trials = [SwingTrial(one.name, one.markers, one.wrenches) for one in made.trials]
    tracked = track(specimen, trials)
    swings = swing_recordings(tracked, choose_cutoff([tracked]).cutoff, muscles=False)
    options = ViscosityOptions(seed=seed, stiffness=False)
    condition = identify_specimen("joint", swings, (), options=options).without
    assert condition is not None
    acting = compare_passive_laws(swings, PassiveOptions(seed=seed)).acting
    one = condition.viscosity
    axes = [each for each in condition.axis_viscosity if np.isfinite(each.value)]
    if acting is not None:
        one = acting.viscosity_of(one)
        own = [
            each
            for name, each in acting.coefficients.items()
            if name.startswith(("viscosity ", "hinge ")) and np.isfinite(each.value)
        ]
        # Beside dry friction the viscosities of single axes alone say nothing.
        axes = own or ([] if acting.friction else axes)
    found = {"d_J": [one], "d_J of single axes": axes}
    return {
        name: Covered.of_limits(
            np.full(len(intervals), damping),
            np.array([interval.low for interval in intervals]),
            np.array([interval.high for interval in intervals]),
        )
        for name, intervals in found.items()
    }
