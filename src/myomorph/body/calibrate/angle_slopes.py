"""Slopes of all frames' angles in lengths and marker positions, and what sliding skin adds.

At the best angles of a frame the gradient in the angles is 0. So they follow the shared unknowns by
the implicit function theorem; see `frame_slopes`.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from myomorph.body.calibrate.shared_problem import Point, SharedProblem
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.motion.frame_blocks import TIED
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.stretch import slopes_of_frame, with_travel
from myomorph.core.rigid.kinematics import forward_kinematics

SEEN = 1e-9  # A coordinate whose curvature is less than this share of the largest moves no marker


# Frames of all recordings that are looked at, evenly chosen: a mean derivative needs no more of
# them
MAX_COUNT = 120


@read_only
class AngleSlopes:
    """Slopes of the angles' means at a point.

    Attributes
    ----------
    mean : (coordinates, unknowns) derivative of each coordinate's mean over all frames, from at
        most `MAX_COUNT` of them; 0 where no marker shows it
    seen : (coordinates,) share of the frames in which markers show the coordinate and no bound
        holds it
    """

    mean: Array
    seen: Array


@read_only
class FrameSlopes:
    """One frame at its best angles.

    Attributes
    ----------
    share : of the frame in the mean over all frames
    free : (free,) coordinates that markers show and no bound holds
    rotations : (bodies, 3, 3) from each body to ground
    weight : (markers,) 0 for one that is unseen
    by_length : (3 markers, lengths) derivatives of the markers' positions in the lengths, angles
        fixed [m]
    by_angle : (3 markers, free) the same in the angles [m per rad or m]
    angles : (free, unknowns but the size) derivatives of the best angles
    """

    share: float
    free: Array
    rotations: Array
    weight: Array
    by_length: Array
    by_angle: Array
    angles: Array


def angle_slopes(problem: SharedProblem, at: Point) -> AngleSlopes:
    """Compute derivatives of the angles' means, every frame at its best angles.

    Parameters
    ----------
    problem : of all frames
    at : point at which frames are settled

    Returns
    -------
    slopes of the means over all frames, and how often each coordinate is shown
    """
    mean = np.zeros((len(problem.posture), len(at.x)))
    seen = np.zeros(len(problem.posture))
    for frame in frame_slopes(problem, at):
        mean[frame.free, :-1] += frame.share * frame.angles
        seen[frame.free] += frame.share
    return AngleSlopes(mean, seen)


def frame_slopes(problem: SharedProblem, at: Point) -> Iterator[FrameSlopes]:
    """Yield how the best angles of a frame follow the shared unknowns.

    With J_q and J_s the slopes of a frame's markers in its angles q and the shared unknowns s, and
    W the markers' weights,

        dq/ds = -(J_q^T W J_q)^-1 J_q^T W J_s

    Closed loops enter as stiff ties (`TIED`).

    Parameters
    ----------
    problem : of all frames
    at : point at which frames are settled

    Yields
    ------
    slopes of at most `MAX_COUNT` frames, evenly chosen from each recording
    """
    total = sum(len(angle) for angle in at.angles)
    stretch = with_travel(problem.stretch, problem.model, at.x[: len(problem.lengths)])
    tied, tied_stretch = problem.tied(at.tree, stretch)
    bodies = problem.pose.markers.body
    every = max(-(-total // MAX_COUNT), 1)
    for group, pose, angles in zip(problem.sets, at.poses, at.angles, strict=True):
        chosen = slice(len(angles) % every // 2, None, every)
        angles, frames = angles[chosen], len(angles)
        share = frames / (total * max(len(angles), 1))
        rotations = (
            forward_kinematics(at.tree, angles).rotations if len(angles) else np.zeros((0, 1, 3, 3))
        )
        for observed, c, R in zip(group.observed[chosen], angles, rotations, strict=True):
            _, by_length, by_coordinate = slopes_of_frame(at.tree.arrays, pose.markers, stretch, c)
            weight = np.where(np.isfinite(observed).all(axis=1), pose.markers.weight, 0.0)
            free = _moving(pose, by_coordinate, np.repeat(weight, 3), c)
            root = np.sqrt(np.repeat(weight, 3))[:, None]
            Jq = by_coordinate[:, free] * root
            A = Jq.T @ Jq + weight.sum() * np.diag(pose.coordinates.weight[free])
            # Shifts move their own marker by its body's rotation.
            by_shift = (R[bodies].transpose(0, 2, 1) @ Jq.reshape(-1, 3, len(free))).transpose(
                2, 0, 1
            )
            by_shift = by_shift * np.sqrt(weight)[None, :, None]
            b = np.hstack([Jq.T @ (by_length * root), by_shift.reshape(len(free), -1)])
            if len(tied.body):
                _, gap_length, gap_coordinate = slopes_of_frame(
                    at.tree.arrays, tied, tied_stretch, c
                )
                gap = _between(gap_coordinate)[:, free]
                A += TIED**2 * gap.T @ gap
                b[:, : gap_length.shape[1]] += TIED**2 * gap.T @ _between(gap_length)
            unit = pose.unit[free]
            scaled = A * unit[:, None] * unit
            stiff = problem.posture_weight * float(np.trace(scaled)) / max(len(free), 1)
            slope = -unit[:, None] * np.linalg.solve(
                scaled + stiff * np.eye(len(free)), b * unit[:, None]
            )
            yield FrameSlopes(
                share=share,
                free=free,
                rotations=R,
                weight=weight,
                by_length=by_length,
                by_angle=by_coordinate[:, free],
                angles=slope,
            )


def _moving(pose: PoseProblem, by_coordinate: Array, weight: Array, c: Array) -> Array:
    """Select coordinates that are solved for, move a seen marker, and lie at no bound.

    Parameters
    ----------
    by_coordinate : (3 markers, coordinates) slopes of marker positions
    weight : (3 markers,) 0 where unseen
    c : (coordinates,) of the frame [rad or m]

    Returns
    -------
    (free,) indices of coordinates
    """
    curvature = (by_coordinate[:, pose.free] ** 2 * weight[:, None]).sum(axis=0) * pose.unit[
        pose.free
    ] ** 2
    slack = 1e-9 * (1.0 + np.abs(c[pose.free]))
    inside = (c[pose.free] > pose.lower + slack) & (c[pose.free] < pose.upper - slack)
    return pose.free[inside & (curvature > SEEN * curvature.max(initial=0.0))]


def _between(slopes: Array) -> Array:
    """Subtract the two points of each pair.

    Parameters
    ----------
    slopes : (6 pairs, unknowns) of both points of each pair in turn

    Returns
    -------
    (3 pairs, unknowns) slopes of the gaps, second less first
    """
    pairs = slopes.reshape(-1, 2, 3, slopes.shape[1])
    return (pairs[:, 1] - pairs[:, 0]).reshape(-1, slopes.shape[1])


def sliding(
    problem: SharedProblem, at: Point, shift: float, turn: float, independent_frames: int
) -> Array:
    """Compute what skin that slides as one piece does to the gradient and to the zero angles.

    A slide u of a segment's markers moves them by E u, and so the gradient by J^T W E u, where J
    are the markers' slopes with the angles at their best. The angles follow the markers as well.
    Slides of neighboring frames are alike: all frames count as `independent_frames`. Source: Barré
    et al. 2017, Fiorentino et al. 2017 (docs/references.md).

    Parameters
    ----------
    problem : of all frames
    at : point at which frames are settled
    shift : standard deviation by which all markers of a segment slide along each axis [m]
    turn : the same about each axis through the middle of the markers [rad]
    independent_frames : number of frames that all frames together are worth

    Returns
    -------
    (unknowns + coordinates, same) covariance of the gradient [m^2 per unknown], then of the mean
        angles [rad or m]; 0 where nothing slides
    """
    unknowns = len(at.x)
    n = len(problem.lengths)
    size = unknowns + len(problem.posture)
    result = np.zeros((size, size))
    if shift <= 0.0 and turn <= 0.0:
        return result
    bodies = problem.pose.markers.body
    places = problem.placed(at.x)
    modes = [_modes(places, bodies == body, shift, turn) for body in np.unique(bodies)]
    frames = sum(len(angle) for angle in at.angles)
    alike = max(1.0, frames / independent_frames)
    for frame in frame_slopes(problem, at):
        R = frame.rotations[bodies]
        moved = []
        for of, mode in modes:
            # (markers of the body, 3, modes) in their body; a marker's own shift has the body's
            # rotation, too.
            moves = frame.weight[of][:, None, None] * mode
            ground = (R[of] @ moves).reshape(-1, mode.shape[2])
            rows = np.repeat(3 * of, 3) + np.tile(np.arange(3), len(of))
            both = np.zeros((size, mode.shape[2]))
            both[:n] = frame.by_length[rows].T @ ground
            both[n + rows] = moves.reshape(-1, mode.shape[2])
            both[: unknowns - 1] += frame.angles.T @ (frame.by_angle[rows].T @ ground)
            # A seen marker moved one way is its place moved the other way.
            both[unknowns + frame.free] = (
                -frame.angles[:, n + rows] @ mode.reshape(-1, mode.shape[2]) / frames
            )
            moved.append(both)
        every = np.hstack(moved)
        # A frame stands for `share * frames` of them where not all are looked at.
        result += alike * frame.share * frames * every @ every.T
    return result


def _modes(
    places: Array, of: NDArray[np.bool_], shift: float, turn: float
) -> tuple[NDArray[np.int64], Array]:
    """Build the moves of one body's markers that slide as one piece.

    Parameters
    ----------
    places : (markers, 3) of all markers on their bodies [m]
    of : (markers,) which are on the body
    shift, turn : standard deviations [m], [rad]

    Returns
    -------
    (chosen,) indices of its markers, and (chosen, 3, 6) their moves in the body's axes [m]: three
        shifts, then three rotations about their mean position
    """
    chosen = np.flatnonzero(of)
    apart = places[chosen] - places[chosen].mean(axis=0)
    shifts = np.repeat(shift * np.eye(3)[None], len(chosen), axis=0)
    turns = turn * np.cross(np.eye(3)[None], apart[:, None]).transpose(0, 2, 1)
    return chosen, np.concatenate([shifts, turns], axis=2)
