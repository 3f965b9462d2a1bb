"""Slopes of all frames' angles in lengths and marker positions, and what sliding skin adds.

At the best angles of a frame the gradient in the angles is 0. So they follow the shared unknowns by
the implicit function theorem; see `frame_slopes`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.body.calibrate.shared_problem import Point, SharedProblem
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.motion.frame_blocks import TIED
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.stretch import Stretch, slopes_of_frame, with_travel
from myomorph.core.motion.tasks.markers import MarkerArrays
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import Tree

# A coordinate whose curvature is less than this share of the largest moves no marker
MIN_CURVATURE = 1e-9
AT_BOUND = 1e-9  # Share of 1 plus its size by which a coordinate may be off the bound it lies at
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
    free: Ints
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
    return AngleSlopes(mean=mean, seen=seen)


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
    total = sum(len(angles) for angles in at.angles)
    stride = max(-(-total // MAX_COUNT), 1)
    stretch = with_travel(problem.stretch, problem.model, at.x[: len(problem.lengths)])
    tied, tied_stretch = problem.tied(at.tree, stretch)
    for group, pose, angles in zip(problem.sets, at.poses, at.angles, strict=True):
        looked = slice(len(angles) % stride // 2, None, stride)
        chosen = angles[looked]
        if not len(chosen):
            continue
        setting = _Setting(
            tree=at.tree,
            pose=pose,
            stretch=stretch,
            tied=tied,
            tied_stretch=tied_stretch,
            posture_weight=problem.posture_weight,
            share=len(angles) / (total * len(chosen)),
        )
        rotations = forward_kinematics(at.tree, chosen).rotations
        for observed, c, R in zip(group.observed[looked], chosen, rotations, strict=True):
            yield setting.slopes_of(observed, c, R)


class _AngleEquations(NamedTuple):
    """Equations A dq = -B ds that the best angles q of a frame follow.

    Attributes
    ----------
    A : (free, free) curvature in the angles
    B : (free, unknowns but the size) between angles and shared unknowns
    """

    A: Array
    B: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class _Setting:
    """What frames of one recording have in common.

    Attributes
    ----------
    tree : of the model at the point
    pose : markers, and what may move
    stretch, tied_stretch : how markers, and points that loops tie, move with the lengths
    tied : points that loops tie, in pairs, as markers
    posture_weight : of the pull to the posture relative to the mean curvature
    share : of a frame in the mean over all frames
    """

    tree: Tree
    pose: PoseProblem
    stretch: Stretch
    tied: MarkerArrays
    tied_stretch: Stretch
    posture_weight: float
    share: float

    def slopes_of(self, observed: Array, c: Array, R: Array) -> FrameSlopes:
        """Differentiate the best angles of a frame.

        Parameters
        ----------
        observed : (markers, 3) [m], NaN where unseen
        c : (coordinates,) the best angles [rad or m]
        R : (bodies, 3, 3) rotations to ground
        """
        markers = self.pose.markers
        _, by_length, by_coordinate = slopes_of_frame(self.tree.arrays, markers, self.stretch, c)
        weight = np.where(np.isfinite(observed).all(axis=1), markers.weight, 0.0)
        free = _moving(self.pose, by_coordinate, np.repeat(weight, 3), c)
        equations = self._of_markers(by_length, by_coordinate[:, free], weight, R[markers.body])
        pulled = weight.sum() * np.diag(self.pose.coordinates.weight[free])
        equations = equations._replace(A=equations.A + pulled)
        if len(self.tied.body):
            self._add_ties(equations, c, free)
        return FrameSlopes(
            share=self.share,
            free=free,
            rotations=R,
            weight=weight,
            by_length=by_length,
            by_angle=by_coordinate[:, free],
            angles=self._solved(equations, free),
        )

    @staticmethod
    def _of_markers(by_length: Array, by_angle: Array, weight: Array, R: Array) -> _AngleEquations:
        """Sum J_q^T W J_q and J_q^T W J_s over the markers.

        Shifts move their own marker by its body's rotation.

        Parameters
        ----------
        by_length, by_angle : (3 markers, lengths), (3 markers, free) derivatives of positions
        weight : (markers,)
        R : (markers, 3, 3) rotations of their bodies to ground
        """
        free = by_angle.shape[1]
        root = np.sqrt(np.repeat(weight, 3))[:, None]
        Jq = by_angle * root
        in_body = R.transpose(0, 2, 1) @ Jq.reshape(-1, 3, free)  # (markers, 3, free)
        by_shift = in_body.transpose(2, 0, 1) * np.sqrt(weight)[None, :, None]
        with_lengths = Jq.T @ (by_length * root)
        return _AngleEquations(A=Jq.T @ Jq, B=np.hstack([with_lengths, by_shift.reshape(free, -1)]))

    def _add_ties(self, equations: _AngleEquations, c: Array, free: Ints) -> None:
        """Add the gaps of closed loops, changed in place, as residuals of the weight `TIED`."""
        _, by_length, by_coordinate = slopes_of_frame(
            self.tree.arrays, self.tied, self.tied_stretch, c
        )
        gap_by_angle = _between(by_coordinate)[:, free]
        gap_by_length = _between(by_length)
        A, B = equations
        A += TIED**2 * gap_by_angle.T @ gap_by_angle
        B[:, : by_length.shape[1]] += TIED**2 * gap_by_angle.T @ gap_by_length

    def _solved(self, equations: _AngleEquations, free: Ints) -> Array:
        """Solve for dq/ds (free, unknowns but the size), the angles in their units."""
        unit = self.pose.unit[free]
        scaled = equations.A * unit[:, None] * unit
        mean_curvature = float(np.trace(scaled))
        stiffness = self.posture_weight * mean_curvature / max(len(free), 1)
        posed = scaled + stiffness * np.eye(len(free))
        return -unit[:, None] * np.linalg.solve(posed, equations.B * unit[:, None])


def _moving(pose: PoseProblem, by_coordinate: Array, weight: Array, c: Array) -> Ints:
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
    free = pose.free
    squares = (by_coordinate[:, free] ** 2 * weight[:, None]).sum(axis=0)
    curvature = squares * pose.unit[free] ** 2
    slack = AT_BOUND * (1.0 + np.abs(c[free]))
    inside = (c[free] > pose.lower + slack) & (c[free] < pose.upper - slack)
    moves = curvature > MIN_CURVATURE * curvature.max(initial=0.0)
    return free[inside & moves]


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
