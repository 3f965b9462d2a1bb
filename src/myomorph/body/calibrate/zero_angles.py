"""Sources that fix the zero of every angle of a calibrated model, and its interval.

Turn a body's markers about its joint, and the angle by as much back: no marker error changes,
unless the next joint's center or axis goes along. What is left open so is decided by a standing
trial, by centers and axes that the motion shows, by the symmetry of the mean posture, and last by
where the generic model has its markers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from myomorph.body.calibrate.angle_slopes import angle_slopes
from myomorph.body.calibrate.calibration import (
    FUNCTIONAL,
    GENERIC,
    STATIC,
    SYMMETRY,
    CalibrationOptions,
    ZeroAngle,
)
from myomorph.body.calibrate.frame_sums import reduce
from myomorph.body.calibrate.shared_fit import Search
from myomorph.body.calibrate.shared_problem import Point, SharedProblem
from myomorph.body.causes import CALIBRATION
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.fit.unknowns import Bools
from myomorph.core.model.arrays import Array
from myomorph.core.model.findings import Finding
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message

ORDER = (GENERIC, SYMMETRY, FUNCTIONAL, STATIC)
"""Sources in the order in which what they add is counted."""
WIDE = np.radians(10.0)  # An interval wider than this to either side is not left unsaid [rad]
MIN_VARIANCE = 1e-18  # Of a zero, so that its precision stays finite [rad^2]
# As far as zeros of calibrated models lie from experts' at most: beyond it they are named [rad]
FAR = np.radians(16.0)
STANDS = np.radians(10.0)  # Within it of the known pose of a static trial a zero is right [rad]
REFUTED = np.radians(25.0)  # Beyond it a static trial takes the motion's place [rad]


class _Known(NamedTuple):
    """What is known of the zeros once all sources are counted.

    Attributes
    ----------
    precision : (sources, zeros) after each of `ORDER` [1/rad^2]
    information : (unknowns at a given size, same) of all sources
    """

    precision: Array
    information: Array

    @property
    def shares(self) -> Array:
        """(sources, zeros) of what is known that each source adds."""
        return np.diff(self.precision, axis=0, prepend=0.0) / self.precision[-1]


def zero_angles(
    search: Search, generic: Point, errors: Array, options: CalibrationOptions
) -> tuple[ZeroAngle, ...]:
    """Find what fixes the zero of every angle that markers show, and its standard deviation.

    The precision of a zero is counted up source by source, the generic model first and the static
    trial last. What each one adds is its share.

    Parameters
    ----------
    search : where it ended; the static trial's frames are its problem's last
    generic : the generic model at the body's size
    errors : (unknowns + coordinates, same) covariance of gradient and mean angles that the noise
        of the markers does not have, see `sliding` and `gradient_of_spread`
    options : whether there is a static trial, and how far axes of generic bones are turned

    Returns
    -------
    one for each rotational coordinate that markers show
    """
    problem = search.problem
    at = search.found.point
    slopes = angle_slopes(problem, at)
    coordinates = problem.model.coordinates
    chosen = [
        j
        for j in problem.pose.free.tolist()
        if coordinates[j].motion == "rotational" and slopes.seen[j] > 0.0
    ]
    known = _known(search, slopes.mean, chosen, static=options.static is not None)
    added = _added(search, slopes.mean[chosen], chosen, known.information, errors)
    offset = _mean_angles(at) - _mean_angles(generic)
    variance = 1.0 / known.precision[-1] + added + options.zero_sd**2
    shares = known.shares
    return tuple(
        ZeroAngle(
            coordinate=coordinates[j].name,
            offset=float(offset[j]),
            sd=float(np.sqrt(variance[column])),
            shares=FrozenMap(dict(zip(ORDER, shares[:, column].tolist(), strict=True))),
        )
        for column, j in enumerate(chosen)
    )


def _mean_angles(at: Point) -> Array:
    """Average all frames: (coordinates,) [rad or m]."""
    return np.concatenate(at.angles).mean(axis=0)


def _at_given_size(search: Search) -> Bools:
    """Select the unknowns that were estimated, but for the overall size: (unknowns,) flags."""
    free = search.stage.free.copy()
    free[-1] = False
    return free


def _known(search: Search, slopes: Array, chosen: Sequence[int], static: bool) -> _Known:
    """Count up what is known of the zeros, source by source.

    Parameters
    ----------
    slopes : (coordinates, unknowns) of the mean angles
    chosen : coordinates whose zeros are wanted
    static : whether the last set of frames is a static trial
    """
    problem = search.problem
    free = _at_given_size(search)
    S = slopes[chosen][:, free]
    rows = problem.prior.rows[:, free]
    information = rows.T @ rows
    precision = [_precision(S, information)]
    if problem.mean_posture is not None:
        symmetry = problem.mean_posture.rows @ slopes[:, free]
        information = information + symmetry.T @ symmetry
    precision.append(_precision(S, information))

    standing = len(problem.sets) - 1 if static else len(problem.sets)
    for part in (slice(0, standing), slice(standing, None)):
        if problem.sets[part]:
            H = reduce(_part_of_problem(problem, part), _part(search.found.point, part)).H
            information = information + H[np.ix_(free, free)] / search.stage.variance
        precision.append(_precision(S, information))
    return _Known(precision=np.array(precision), information=information)


def _added(
    search: Search, S: Array, chosen: Sequence[int], information: Array, errors: Array
) -> Array:
    """Compute the variance that sliding skin and the spread of markers add to the zeros.

    All information is A / variance: a gradient g moves the zeros by S A^-1 g, and slides turn them
    themselves.

    Parameters
    ----------
    S : (zeros, unknowns) slopes of the mean angles
    chosen : coordinates of the zeros
    information : (unknowns at a given size, same)
    errors : (unknowns + coordinates, same) covariance of gradient and mean angles

    Returns
    -------
    (zeros,) [rad^2]
    """
    free = _at_given_size(search)
    pulled = np.zeros((len(chosen), len(errors)))
    by_gradient = np.linalg.solve(information, S[:, free].T).T
    pulled[:, np.flatnonzero(free)] = by_gradient / search.stage.variance
    pulled[np.arange(len(chosen)), len(free) + np.array(chosen, np.intp)] = 1.0
    return np.einsum("ki,ij,kj->k", pulled, errors, pulled)


def _part_of_problem(problem: SharedProblem, part: slice) -> SharedProblem:
    return replace(problem, sets=problem.sets[part])


def _part(at: Point, part: slice) -> Point:
    return replace(at, poses=at.poses[part], angles=at.angles[part], data=at.data[part])


def _precision(S: Array, information: Array) -> Array:
    """Compute the precision of linear combinations of the unknowns.

    Parameters
    ----------
    S : (rows, unknowns)
    information : (unknowns, unknowns)

    Returns
    -------
    (rows,) inverse variance
    """
    variance = np.einsum("ij,ji->i", S, np.linalg.solve(information, S.T))
    return 1.0 / np.maximum(variance, MIN_VARIANCE)


def zero_notes(zeros: tuple[ZeroAngle, ...], static: bool) -> tuple[Message, ...]:
    """Report angles whose zeros are known badly: which, how far, and what would fix them."""
    wide = sorted((zero for zero in zeros if half_width(zero.sd) > WIDE), key=lambda zero: -zero.sd)
    if not wide:
        return ()
    named = ", ".join(f"{zero.coordinate} ±{np.degrees(half_width(zero.sd)):.0f}°" for zero in wide)
    generic = sum(zero.source == GENERIC for zero in wide)
    cause = "90 % intervals"
    if generic:
        cause = f"{generic} of them fixed by the generic model's marker positions"
    cure = "" if static else "; a static trial (--static) with known angles fixes them"
    return (
        CALIBRATION.message(
            f"zero angles with intervals above {np.degrees(WIDE):g}°: {named} ({cause}{cure})"
        ),
    )


def standing_errors(search: Search) -> Mapping[str, float]:
    """Compare the calibrated posture in the static trial with the angles that are known there.

    Parameters
    ----------
    search : where it ended; the static trial's frames are its problem's last

    Returns
    -------
    mean difference by coordinate [rad]
    """
    frames = search.problem.sets[-1]
    errors = (search.found.point.angles[-1] - frames.targets).mean(axis=0)
    coordinates = search.problem.model.coordinate_names
    return FrozenMap({coordinates[j]: float(errors[j]) for j in np.flatnonzero(frames.known)})


def far_zeros(
    zeros: Sequence[ZeroAngle], standing: Mapping[str, float], alone: bool
) -> tuple[Finding, ...]:
    """Find angles whose zeros lie where no bones have them.

    The generic model's markers may lie beside the bones, and the zero be right for all that: where
    the body then stands as it does in static trials, nothing is said. They are repaired where a
    static trial can take the place of the motion.

    Parameters
    ----------
    zeros : of knees and feet
    standing : by coordinate, how far the calibrated posture in a static trial lies from the known
        one [rad]; none without a static trial
    alone : whether a static trial is there to calibrate on alone

    Returns
    -------
    one finding, or none
    """
    at_least = {zero: abs(zero.offset) - half_width(zero.sd) for zero in zeros}
    beyond = [
        zero
        for zero, angle in at_least.items()
        if angle > FAR and (angle > REFUTED or abs(standing.get(zero.coordinate, np.inf)) > STANDS)
    ]
    far = sorted(beyond, key=lambda zero: -at_least[zero])
    if not far:
        return ()
    repaired = alone and bool(at_least[far[0]] > REFUTED)
    named = ", ".join(f"{zero.coordinate} {np.degrees(zero.offset):.0f}°" for zero in far)
    cure = "" if standing else " (--static shows them)"
    then = f"their angles may have an error of that size{cure}"
    if repaired:
        then = "calibrated on the static trial alone"
    text = CALIBRATION.message(
        f"zero angles are far from the generic model's ({named}), because the motion rotates bones"
        " in ways that the model's joints do not allow (a foot that bends, a shank that twists):"
        f" {then}",
        severity="changes results",
    )
    return (Finding("far zero angles", far[0].coordinate, text, repaired=repaired),)
