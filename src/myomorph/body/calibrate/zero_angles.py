"""Sources that fix the zero of every angle of a calibrated model, and its interval.

Turn a body's markers about its joint, and the angle by as much back: no marker error changes,
unless the next joint's center or axis goes along. What is left open so is decided by a standing
trial, by centers and axes that the motion shows, by the symmetry of the mean posture, and last by
where the generic model has its markers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from myomorph.body.calibrate.angle_slopes import angle_slopes
from myomorph.body.calibrate.calibration import (
    FUNCTIONAL,
    GENERIC,
    STATIC,
    SYMMETRY,
    ZeroAngle,
)
from myomorph.body.calibrate.frame_sums import reduce
from myomorph.body.calibrate.shared_problem import Point, SharedProblem
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.model.arrays import Array
from myomorph.core.model.findings import Finding
from myomorph.core.model.frozen_map import FrozenMap

WIDE = np.radians(10.0)  # An interval wider than this to either side is not left unsaid [rad]
# As far as zeros of calibrated models lie from experts' at most: beyond it they are named [rad]
FAR = np.radians(16.0)
REFUTED = np.radians(25.0)  # Beyond it a static trial takes the motion's place [rad]


def zero_angles(
    problem: SharedProblem,
    at: Point,
    start: Point,
    variance: float,
    free: NDArray[np.bool_],
    static: bool,
    zero_sd: float,
    skin: Array,
) -> tuple[ZeroAngle, ...]:
    """Find what fixes the zero of every angle that markers show, and its standard deviation.

    The precision of a zero is counted up source by source, the generic model first and the static
    trial last. What each one adds is its share.

    Parameters
    ----------
    problem : of all frames, the static trial's last
    at : point that was found
    start : the generic model at the body's size
    variance : of a marker along one axis [m^2]
    free : (unknowns,) that were estimated
    static : whether the last set of frames is a static trial
    zero_sd : of the generic bones' axes against the person's [rad]
    skin : (unknowns + coordinates, same) result of `sliding`

    Returns
    -------
    one for each rotational coordinate that markers show
    """
    slopes = angle_slopes(problem, at)
    motion = slice(0, len(problem.sets) - 1) if static else slice(None)
    means = [np.concatenate(point.angles).mean(axis=0) for point in (at, start)]
    chosen = [
        j
        for j in map(int, problem.pose.free)
        if problem.model.coordinates[j].motion == "rotational" and slopes.seen[j] > 0.0
    ]
    given_size = free.copy()
    given_size[-1] = False
    S = slopes.mean[chosen][:, given_size]
    rows = problem.prior.rows[:, given_size]
    information = rows.T @ rows
    precision = {GENERIC: _precision(S, information)}
    if problem.mean_posture is not None:
        symmetry = problem.mean_posture.rows @ slopes.mean[:, given_size]
        information = information + symmetry.T @ symmetry
    precision[SYMMETRY] = _precision(S, information)
    for name, part in (
        (FUNCTIONAL, motion),
        (STATIC, slice(len(problem.sets) - 1, None) if static else None),
    ):
        if part is not None and problem.sets[part]:
            H = reduce(replace(problem, sets=problem.sets[part]), _part(at, part)).H
            information = information + H[np.ix_(given_size, given_size)] / variance
        precision[name] = _precision(S, information)
    order = (GENERIC, SYMMETRY, FUNCTIONAL, STATIC)
    known = np.array([precision[name] for name in order])
    # All information is A / variance: a gradient g moves the zeros by S A^-1 g, and the slides turn
    # them themselves.
    pulled = np.zeros((len(chosen), len(skin)))
    pulled[:, np.flatnonzero(given_size)] = np.linalg.solve(information, S.T).T / variance
    pulled[np.arange(len(chosen)), len(free) + np.array(chosen, np.intp)] = 1.0
    slid = np.einsum("ki,ij,kj->k", pulled, skin, pulled)
    shares = np.diff(known, axis=0, prepend=0.0) / known[-1]
    return tuple(
        ZeroAngle(
            coordinate=problem.model.coordinates[j].name,
            offset=float(means[0][j] - means[1][j]),
            sd=float(np.sqrt(1.0 / known[-1, column] + slid[column] + zero_sd**2)),
            shares=FrozenMap({name: float(shares[row, column]) for row, name in enumerate(order)}),
        )
        for column, j in enumerate(chosen)
    )


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
    return 1.0 / np.maximum(np.einsum("ij,ji->i", S, np.linalg.solve(information, S.T)), 1e-18)


def zero_notes(zeros: tuple[ZeroAngle, ...], static: bool) -> tuple[str, ...]:
    """Report angles whose zeros are known badly: which, how far, and what would fix them."""
    wide = sorted((zero for zero in zeros if half_width(zero.sd) > WIDE), key=lambda zero: -zero.sd)
    if not wide:
        return ()
    named = ", ".join(f"{zero.coordinate} ±{np.degrees(half_width(zero.sd)):.0f}°" for zero in wide)
    generic = sum(zero.source == GENERIC for zero in wide)
    cause = (
        f"{generic} of them fixed by the generic model's marker places"
        if generic
        else "90 % intervals"
    )
    cure = "" if static else "; a static trial (--static) with known angles fixes them"
    return (f"zero angles known to no better than {np.degrees(WIDE):g}°: {named} ({cause}{cure})",)


def far_zeros(zeros: Sequence[ZeroAngle], static: bool) -> tuple[Finding, ...]:
    """Find angles whose zeros lie where no bones have them.

    They are repaired where a static trial can take the place of the motion.

    Parameters
    ----------
    zeros : of knees and feet
    static : whether a static trial is there to calibrate on alone

    Returns
    -------
    one finding, or none
    """
    ends = {zero: abs(zero.offset) - half_width(zero.sd) for zero in zeros}
    far = sorted((zero for zero, end in ends.items() if end > FAR), key=lambda zero: -ends[zero])
    if not far:
        return ()
    mended = static and bool(ends[far[0]] > REFUTED)
    named = ", ".join(f"{zero.coordinate} {np.degrees(zero.offset):.0f}°" for zero in far)
    cure = "" if static else " (--static shows them)"
    then = (
        "calibrated on the static trial alone"
        if mended
        else f"their angles may be off by as much{cure}"
    )
    text = (
        f"zero angles are far from the generic model's ({named}), for the motion turns bones as the"
        f" model's joints cannot (a foot that bends, a shank that twists): {then}"
    )
    return (Finding("far zero angles", far[0].coordinate, text, mended=mended),)
