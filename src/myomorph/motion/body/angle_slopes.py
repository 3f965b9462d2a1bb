"""How the angles of all frames follow lengths and marker places, and what each recording says of these.

Also what fixes the zero of every angle. Turn a body's markers about its joint, and the angle by as much back: no marker
error changes, unless the next joint's center or axis goes along. What is left open so is decided by a standing trial,
by centers and axes that the motion shows, by the symmetry of the mean posture, and last by where the generic model has
its markers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array, read_only
from myomorph.model.findings import Finding
from myomorph.model.frozen_map import FrozenMap
from myomorph.motion.body.shared_fit import reduce
from myomorph.motion.body.shared_problem import Point, SharedProblem
from myomorph.motion.calibration import FUNCTIONAL, GENERIC, NORMAL_90, STATIC, SYMMETRY, ZeroAngle
from myomorph.motion.pose_problem import PoseProblem
from myomorph.motion.stretch import TIED, Stretch, slopes_of_frame, tied_markers, with_travel
from myomorph.motion.tasks.loops import ties_of
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

SEEN = 1e-9
"""A coordinate whose curvature is less than this share of the largest moves no marker."""


MAX_COUNT = 120
"""Frames of all recordings that are looked at, evenly chosen: a mean derivative needs no more of them."""


@read_only
class AngleSlopes:
    """Of all frames at a point: `mean` (coordinates, unknowns), derivatives of each coordinate's mean over all frames,
    found of at most `MAX_COUNT`, 0 where no marker shows it; `seen` (coordinates,), share of the frames in which
    markers show the coordinate and no bound holds it.
    """

    mean: Array
    seen: Array


@read_only
class FrameSlopes:
    """One frame at its best angles: its share in the mean over all frames, the coordinates that are free, rotations
    (bodies, 3, 3) to ground, weights (markers,), 0 for one that is unseen; derivatives of the markers' places in the
    lengths at fixed angles and in the angles (3 markers, ...); those of the best angles (free, unknowns but the size).
    """

    share: float
    free: Array
    rotations: Array
    weight: Array
    by_length: Array
    by_angle: Array
    angles: Array


def angle_slopes(problem: SharedProblem, at: Point) -> AngleSlopes:
    """Derivatives of the angles' means in the unknowns, every frame at its best angles."""
    mean, seen = np.zeros((len(problem.posture), len(at.x))), np.zeros(len(problem.posture))
    for frame in frame_slopes(problem, at):
        mean[frame.free, :-1] += frame.share * frame.angles
        seen[frame.free] += frame.share
    return AngleSlopes(mean, seen)


def frame_slopes(problem: SharedProblem, at: Point) -> Iterator[FrameSlopes]:
    """At most `MAX_COUNT` frames of all recordings. Where a frame's cost has its minimum, dq/ds = -(J_q^T W J_q)^-1
    J_q^T W J_s.
    """
    total = sum(len(angle) for angle in at.angles)
    tree = compile_tree(problem.stretched(at.x))
    stretch = with_travel(problem.stretch, problem.model, at.x[: len(problem.lengths)])
    ties = _ties(problem, tree, stretch)
    bodies = problem.pose.markers.body
    every = max(-(-total // MAX_COUNT), 1)
    for group, pose, angles in zip(problem.sets, at.poses, at.angles, strict=True):
        chosen = slice(len(angles) % every // 2, None, every)
        angles, frames = angles[chosen], len(angles)
        share = frames / (total * max(len(angles), 1))
        rotations = forward_kinematics(tree, angles).rotations if len(angles) else np.zeros((0, 1, 3, 3))
        for observed, c, R in zip(group.observed[chosen], angles, rotations, strict=True):
            _, by_length, by_coordinate = slopes_of_frame(at.tree, pose.markers, stretch, c)
            weight = np.where(np.isfinite(observed).all(axis=1), pose.markers.weight, 0.0)
            free = _moving(pose, by_coordinate, np.repeat(weight, 3), c)
            root = np.sqrt(np.repeat(weight, 3))[:, None]
            Jq = by_coordinate[:, free] * root
            A = Jq.T @ Jq + weight.sum() * np.diag(pose.coordinates.weight[free])
            # Shifts move their own marker by its body's rotation.
            by_shift = (R[bodies].transpose(0, 2, 1) @ Jq.reshape(-1, 3, len(free))).transpose(2, 0, 1)
            by_shift = by_shift * np.sqrt(weight)[None, :, None]
            b = np.hstack([Jq.T @ (by_length * root), by_shift.reshape(len(free), -1)])
            for tied, tied_stretch in ties:
                _, gap_length, gap_coordinate = slopes_of_frame(at.tree, tied, tied_stretch, c)
                gap = _between(gap_coordinate)[:, free]
                A += TIED**2 * gap.T @ gap
                b[:, : gap_length.shape[1]] += TIED**2 * gap.T @ _between(gap_length)
            unit = pose.unit[free]
            scaled = A * unit[:, None] * unit
            stiff = problem.posture_weight * float(np.trace(scaled)) / max(len(free), 1)
            slope = -unit[:, None] * np.linalg.solve(scaled + stiff * np.eye(len(free)), b * unit[:, None])
            yield FrameSlopes(share, free, R, weight, by_length, by_coordinate[:, free], slope)


def _moving(pose: PoseProblem, by_coordinate: Array, weight: Array, c: Array) -> Array:
    """Coordinates that are solved for, move a marker that is seen, and lie at no bound."""
    curvature = (by_coordinate[:, pose.free] ** 2 * weight[:, None]).sum(axis=0) * pose.unit[pose.free] ** 2
    slack = 1e-9 * (1.0 + np.abs(c[pose.free]))
    inside = (c[pose.free] > pose.lower + slack) & (c[pose.free] < pose.upper - slack)
    return pose.free[inside & (curvature > SEEN * curvature.max(initial=0.0))]


def _between(slopes: Array) -> Array:
    """(pairs * 3, unknowns) of the gaps from (pairs * 6, unknowns) of points in turn."""
    pairs = slopes.reshape(-1, 2, 3, slopes.shape[1])
    return (pairs[:, 1] - pairs[:, 0]).reshape(-1, slopes.shape[1])


def _ties(problem: SharedProblem, tree, stretch: Stretch) -> Sequence:
    if not problem.model.loops:
        return ()
    model_ties = tied_markers(ties_of(compile_tree(problem.model), lever=0.0))
    return ((tied_markers(ties_of(tree)), stretch._replace(location=model_ties.location)),)


@dataclass(frozen=True)
class Slides:
    """Standard deviations of what all markers of a segment share while the body moves: along each axis [m] and about
    each axis through the markers' middle [rad]. Slides are alike from frame to frame: so many independent frames say as
    much as all.
    """

    shift: float
    turn: float
    independent_frames: int


def sliding(problem: SharedProblem, at: Point, slides: Slides) -> Array:
    """(unknowns + coordinates, same) covariance that slides give the gradient [m^2 per unknown] and the angles' means.
    A slide u of a segment's markers moves them by E u, and the gradient by J^T W E u, where J are the slopes with the
    angles at their best; the angles follow the markers as well. Slides of neighboring frames are alike: their sum
    counts as that of `independent_frames`.
    """
    unknowns, n = len(at.x), len(problem.lengths)
    size = unknowns + len(problem.posture)
    result = np.zeros((size, size))
    if slides.shift <= 0.0 and slides.turn <= 0.0:
        return result
    bodies, places = problem.pose.markers.body, problem.placed(at.x)
    modes = [_modes(places, bodies == body, slides) for body in np.unique(bodies)]
    frames = sum(len(angle) for angle in at.angles)
    alike = max(1.0, frames / slides.independent_frames)
    for frame in frame_slopes(problem, at):
        R = frame.rotations[bodies]
        moved = []
        for of, mode in modes:
            # (markers of the body, 3, modes) in their body; a marker's own shift has the body's rotation, too.
            moves = frame.weight[of][:, None, None] * mode
            ground = (R[of] @ moves).reshape(-1, mode.shape[2])
            rows = np.repeat(3 * of, 3) + np.tile(np.arange(3), len(of))
            both = np.zeros((size, mode.shape[2]))
            both[:n] = frame.by_length[rows].T @ ground
            both[n + rows] = moves.reshape(-1, mode.shape[2])
            both[: unknowns - 1] += frame.angles.T @ (frame.by_angle[rows].T @ ground)
            # A seen marker moved one way is its place moved the other way.
            both[unknowns + frame.free] = -frame.angles[:, n + rows] @ mode.reshape(-1, mode.shape[2]) / frames
            moved.append(both)
        every = np.hstack(moved)
        # A frame stands for `share * frames` of them where not all are looked at.
        result += alike * frame.share * frames * every @ every.T
    return result


def widened(spread: Array, variance: float, skin: Array, free: NDArray[np.bool_]) -> Array:
    """(unknowns, unknowns) covariance with what slides add; `spread` is that of noise and priors, variance * A^-1."""
    inner = np.where(free[:, None] & free, skin[: len(free), : len(free)], 0.0)
    return spread + spread @ inner @ spread / variance**2


def _modes(places: Array, of: NDArray[np.bool_], slides: Slides) -> tuple[NDArray[np.int64], Array]:
    """Markers of a body, and (markers, 3, 6) their moves in it: three shifts and three turns about their middle."""
    chosen = np.flatnonzero(of)
    apart = places[chosen] - places[chosen].mean(axis=0)
    shift = np.repeat(slides.shift * np.eye(3)[None], len(chosen), axis=0)
    turn = slides.turn * np.cross(np.eye(3)[None], apart[:, None]).transpose(0, 2, 1)
    return chosen, np.concatenate([shift, turn], axis=2)


WIDE = np.radians(10.0)
"""An interval wider than this to either side is not left unsaid [rad]."""

FAR = np.radians(16.0)
"""As far as zeros of calibrated models lie from experts' at most: beyond it they are named [rad]."""
REFUTED = np.radians(25.0)
"""Beyond it a static trial takes the motion's place [rad]."""


def posterior(problem: SharedProblem, at: Point, variance: float, free: NDArray[np.bool_], H: Array) -> Array:
    """(unknowns, unknowns) covariance of what is searched for, of the noise, priors and mean posture; 0 elsewhere."""
    rows = _rows(problem, at)[:, free]
    result = np.zeros((len(free), len(free)))
    result[np.ix_(free, free)] = variance * np.linalg.inv(H[np.ix_(free, free)] + variance * rows.T @ rows)
    return result


def _rows(problem: SharedProblem, at: Point) -> Array:
    """Of the prior, and of the mean posture about this point."""
    if problem.mean_posture is None:
        return problem.prior.rows
    return np.vstack([problem.prior.rows, problem.mean_posture.rows @ angle_slopes(problem, at).mean])


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
    """The zeros of all angles that markers show, what fixes each, and its standard deviation. The precision of a zero
    is counted up source by source, the generic model first and the static trial (last set of frames) last; what each
    one adds is its share. `variance` is of a marker along one axis [m^2], `zero_sd` of the generic bones' axes against
    the person's [rad], `skin` the result of `sliding`.
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
    for name, part in ((FUNCTIONAL, motion), (STATIC, slice(len(problem.sets) - 1, None) if static else None)):
        if part is not None and problem.sets[part]:
            here = replace(at, poses=at.poses[part], angles=at.angles[part], data=at.data[part])
            H = reduce(replace(problem, sets=problem.sets[part]), here).H
            information = information + H[np.ix_(given_size, given_size)] / variance
        precision[name] = _precision(S, information)
    order = (GENERIC, SYMMETRY, FUNCTIONAL, STATIC)
    known = np.array([precision[name] for name in order])
    # All information is A / variance: a gradient g moves the zeros by S A^-1 g, and the slides turn them themselves.
    pulled = np.zeros((len(chosen), len(skin)))
    pulled[:, np.flatnonzero(given_size)] = np.linalg.solve(information, S.T).T / variance
    pulled[np.arange(len(chosen)), len(free) + np.array(chosen, np.intp)] = 1.0
    slid = np.einsum("ki,ij,kj->k", pulled, skin, pulled)
    shares = np.diff(known, axis=0, prepend=0.0) / known[-1]
    return tuple(
        ZeroAngle(
            problem.model.coordinates[j].name,
            float(means[0][j] - means[1][j]),
            float(np.sqrt(1.0 / known[-1, column] + slid[column] + zero_sd**2)),
            FrozenMap({name: float(shares[row, column]) for row, name in enumerate(order)}),
        )
        for column, j in enumerate(chosen)
    )


def _precision(S: Array, information: Array) -> Array:
    """(rows,) inverse variance of the rows."""
    return 1.0 / np.maximum(np.einsum("ij,ji->i", S, np.linalg.solve(information, S.T)), 1e-18)


def zero_notes(zeros: tuple[ZeroAngle, ...], static: bool) -> tuple[str, ...]:
    """One line where angles' zeros are known badly: which, how far, and what would fix them."""
    wide = sorted((zero for zero in zeros if NORMAL_90 * zero.sd > WIDE), key=lambda zero: -zero.sd)
    if not wide:
        return ()
    named = ", ".join(f"{zero.coordinate} ±{np.degrees(NORMAL_90 * zero.sd):.0f}°" for zero in wide)
    generic = sum(zero.source == GENERIC for zero in wide)
    cause = f"{generic} of them fixed by the generic model's marker places" if generic else "90 % intervals"
    cure = "" if static else "; a static trial (--static) with known angles fixes them"
    return (f"zero angles known to no better than {np.degrees(WIDE):g}°: {named} ({cause}{cure})",)


def far_zeros(zeros: Sequence[ZeroAngle], static: bool) -> tuple[Finding, ...]:
    """Angles whose zeros lie where no bones have them; mended where a static trial can take the motion's place."""
    ends = {zero: abs(zero.offset) - NORMAL_90 * zero.sd for zero in zeros}
    far = sorted((zero for zero, end in ends.items() if end > FAR), key=lambda zero: -ends[zero])
    if not far:
        return ()
    mended = static and bool(ends[far[0]] > REFUTED)
    named = ", ".join(f"{zero.coordinate} {np.degrees(zero.offset):.0f}°" for zero in far)
    cure = "" if static else " (--static shows them)"
    then = "calibrated on the static trial alone" if mended else f"their angles may be off by as much{cure}"
    text = (
        f"zero angles are far from the generic model's ({named}), for the motion turns bones as the model's joints "
        f"cannot (a foot that bends, a shank that twists): {then}"
    )
    return (Finding("far zero angles", far[0].coordinate, text, mended=mended),)
