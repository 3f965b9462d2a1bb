"""How far off a subject's model may be, as the steps that made it found.

They are sizes of errors for interval bounds of results.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from myomorph.body.calibrate.calibration import Calibration
from myomorph.body.personalize.estimates import FIBER, FORCE, SLACK
from myomorph.body.personalize.personalize import Personalized
from myomorph.body.refine.options import MASSES
from myomorph.body.refine.refinement import Refinement
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import Model
from myomorph.lab.uncertainty.sources import ItemSize


def calibrated_errors(calibration: Calibration) -> Iterator[ItemSize]:
    """Distance of patellae, where markers on them inform it."""
    found = calibration.patella
    if found is not None:
        for patella in found.patellae:
            yield ItemSize("patella_distance", patella, found.sd)


def identified_errors(model: Model, sd: Array) -> Iterator[ItemSize]:
    """Yield the errors of masses, centers of mass and inertias.

    What a first moment or an inertia owes to the error of the mass is taken off, as masses are
    drawn themselves.

    Parameters
    ----------
    model : with the bodies
    sd : standard deviations of the parameters (bodies, 10)

    Yields
    ------
    size of the error of each, by body
    """
    for body, parameter, error in zip(model.bodies, inertial_parameters(model), sd, strict=True):
        if not (body.mass > 0.0 and error[0] > 0.0):
            continue
        share = float(error[0]) / body.mass
        yield ItemSize("segment_mass", body.name, share)
        radius = np.sqrt(max(float(np.trace(body.inertia)), 0.0) / (2.0 * body.mass))
        apart = (
            np.sqrt(np.maximum(error[1:4] ** 2 - (body.mass_center * error[0]) ** 2, 0.0))
            / body.mass
        )
        if radius > 0.0:
            yield ItemSize("mass_center", body.name, float(np.sqrt(np.mean(apart**2))) / radius)
        trace = float(parameter[4:7].sum())
        if trace > 0.0:
            whole = float(np.sqrt((error[4:7] ** 2).sum())) / trace
            yield ItemSize("inertia", body.name, float(np.sqrt(max(whole**2 - share**2, 0.0))))


def refined_errors(refinement: Refinement) -> Iterator[ItemSize]:
    """Masses; those that were kept are no surer than before."""
    if MASSES not in refinement.fit:
        return
    for body, sd in zip(refinement.model.bodies, refinement.mass_sd, strict=True):
        if body.mass > 0.0 and sd > 0.0:
            yield ItemSize("segment_mass", body.name, float(sd) / body.mass)


def personal_errors(personalized: Personalized) -> Iterator[ItemSize]:
    """Fiber and slack lengths of muscles; strengths, which muscles of a group share."""
    fibers = {muscle.name: muscle.optimal_fiber_length for muscle in personalized.model.muscles}
    members = grouped(
        zip(personalized.strength_groups, personalized.model.muscle_names, strict=False)
    )
    one_sd = float(half_width(1.0))
    for estimate in personalized.estimates:
        if not (np.isfinite(estimate.low) and estimate.low > 0.0 and estimate.high > estimate.low):
            continue
        ratio = float(np.log(estimate.high / estimate.low)) / (2.0 * one_sd)
        if estimate.parameter == FIBER:
            yield ItemSize("fiber_length", estimate.of, ratio)
        elif estimate.parameter == SLACK:
            yield ItemSize(
                "slack_length",
                estimate.of,
                (estimate.high - estimate.low) / (2.0 * one_sd) / fibers[estimate.of],
            )
        elif estimate.parameter == FORCE:
            for muscle in members.get(estimate.of, ()):
                yield ItemSize(source="strength", item=muscle, size=ratio, shared=estimate.of)
