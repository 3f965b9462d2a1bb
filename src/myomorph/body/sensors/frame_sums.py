"""Sums over frames whose poses are eliminated: the equations of mountings, headings and clock.

A frame shows of each sensor its mounting, its heading at that time, and the delay of all clocks.
Headings at knots follow by the share that each knot has of the frame.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from myomorph.core.fit.elimination import EliminatedFrames, eliminated_frames
from myomorph.core.fit.residuals import NormalEquations
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.motion.marker_frames import MarkerFrames

# Standard deviation of the mean of a joint angle about a knot, against that over the recording
# [rad]
TREND = 0.07
ALIKE = 0.1
"""Knots whose sensors have verticals further apart in the mean see other movements, as sitting and
walking [rad].
"""


class FrameRows(NamedTuple):
    """Rows of frames; 0 where nothing is reported.

    Attributes
    ----------
    of_pose : (frames, rows, variables) slopes in the free coordinates
    of_unknowns : (frames, rows, 4 sensors + 1) slopes in the mountings, in the headings at that
        time, and in the delay
    residuals : (frames, rows)
    """

    of_pose: Array
    of_unknowns: Array
    residuals: Array

    def scaled(self, scales: Array) -> FrameRows:
        """Multiply rows by scales.

        Parameters
        ----------
        scales : (rows,), or (1,) for all

        Returns
        -------
        the rows, in the scales' unit times theirs
        """
        return FrameRows(
            of_pose=scales[:, None] * self.of_pose,
            of_unknowns=scales[:, None] * self.of_unknowns,
            residuals=scales * self.residuals,
        )

    def beside(self, others: FrameRows) -> FrameRows:
        """Add other rows of the same frames."""
        return FrameRows(
            of_pose=np.concatenate([self.of_pose, others.of_pose], axis=1),
            of_unknowns=np.concatenate([self.of_unknowns, others.of_unknowns], axis=1),
            residuals=np.concatenate([self.residuals, others.residuals], axis=1),
        )

    def eliminated(self) -> EliminatedFrames:
        """Take the poses out."""
        return eliminated_frames(self.of_pose, self.of_unknowns, self.residuals)


def sensor_rows(
    reported: Array, errors: Array, slopes: Array, velocities: Array, up: Array
) -> FrameRows:
    """Collect the rows of sensors: three for each, of the rotation vector of its error.

    Parameters
    ----------
    reported : (frames, sensors, 3, 3) rotations of the bodies by the sensors
    errors : (frames, sensors, 3) rotation vectors from these to the bodies [rad], NaN where unknown
    slopes : (frames, sensors, 3, variables) of the bodies' rotation vectors [rad per rad or m]
    velocities : (frames, sensors, 3) rotation vectors per second of delay [rad/s]
    up : (3,) unit vector

    Returns
    -------
    the rows, in rad
    """
    frames, count = errors.shape[:2]
    known = np.isfinite(errors[..., 0])
    of_unknowns = np.zeros((frames, count, 3, 4 * count + 1))
    for index in range(count):
        of_unknowns[:, index, :, 3 * index : 3 * index + 3] = reported[:, index]
        of_unknowns[:, index, :, 3 * count + index] = -up
    of_unknowns[..., -1] = -velocities
    of_unknowns[~known] = 0.0
    return FrameRows(
        of_pose=np.where(known[..., None, None], slopes, 0.0).reshape(frames, 3 * count, -1),
        of_unknowns=of_unknowns.reshape(frames, 3 * count, -1),
        residuals=np.where(known[..., None], errors, 0.0).reshape(frames, -1),
    )


def marker_rows(marked: MarkerFrames, width: int) -> FrameRows:
    """Collect the rows of markers, three for each, which no unknown of the sensors moves.

    Parameters
    ----------
    marked : markers against the model
    width : number of unknowns

    Returns
    -------
    the rows, in m
    """
    frames, count = marked.errors.shape[:2]
    seen = np.asarray(np.isfinite(marked.errors).all(axis=2))
    return FrameRows(
        of_pose=np.where(seen[..., None, None], marked.slopes, 0.0).reshape(frames, 3 * count, -1),
        of_unknowns=np.zeros((frames, 3 * count, width)),
        residuals=np.where(seen[..., None], -marked.errors, 0.0).reshape(frames, -1),
    )


@read_only
class FrameSums:
    """Frames with their poses eliminated, and the knots of the headings.

    Attributes
    ----------
    frames : equations of each in its own mountings, headings and delay
    shares : (frames, knots) of each knot's heading
    sensors : how many there are
    """

    frames: EliminatedFrames
    shares: Array
    sensors: int

    @property
    def _heading(self) -> slice:
        """Where the headings of a frame are among its unknowns."""
        return slice(3 * self.sensors, 4 * self.sensors)

    def _widened(self, columns: Array) -> Array:
        """Sum columns of frames' unknowns over the frames, headings by their knots.

        Parameters
        ----------
        columns : (frames, rows, 4 sensors + 1)

        Returns
        -------
        (rows, unknowns)
        """
        by_knot = np.einsum("fk,frs->rks", self.shares, columns[..., self._heading])
        summed = columns.sum(axis=0)
        parts = [summed[:, : 3 * self.sensors], by_knot.reshape(len(summed), -1), summed[:, -1:]]
        return np.concatenate(parts, axis=1)

    def equations(self) -> NormalEquations:
        """Sum the equations of all frames.

        With the shares S of the knots in a frame, its headings are h = S h_knots, so that of its
        curvatures

            H_knots,knots = S^T H_hh S,   H_others,knots = H_others,h S
        """
        H = self.frames.H
        others = np.delete(H, np.r_[self._heading], axis=1)
        wide = self._widened(others)
        of_headings = np.concatenate(
            [self._widened(share[:, None, None] * H[:, self._heading]) for share in self.shares.T]
        )
        mountings = 3 * self.sensors
        g = self._widened(self.frames.g[:, None])[0]
        return NormalEquations(
            H=np.concatenate([wide[:mountings], of_headings, wide[mountings:]]), g=g
        )

    def with_trends(self, angles: Array, joints: np.ndarray, upright: Array) -> NormalEquations:
        """Add that mean joint angles about knots at which the body does the same are alike.

        Headings that drift would part them.

        Parameters
        ----------
        angles : (frames, variables) free coordinates [rad or m]
        joints : (variables,) which of these are angles of joints
        upright : (frames, sensors, 3) the vertical in the axes of each sensor's body

        Returns
        -------
        the equations with those of the frames
        """
        equations = self.equations()
        knots = self._knots(angles[:, joints], joints, upright)
        H = np.array(equations.H)
        g = np.array(equations.g)
        for first, second in combinations(knots, 2):
            between = first.vertical - second.vertical
            apart = np.sqrt(np.nanmean((between**2).sum(axis=-1)))
            weight = np.exp(-0.5 * (apart / ALIKE) ** 2) / (len(knots) * TREND**2)
            slopes = first.follows - second.follows
            H += weight * slopes.T @ slopes
            g += weight * slopes.T @ (first.angles - second.angles)
        return NormalEquations(H=H, g=g)

    def _knots(self, angles: Array, joints: np.ndarray, upright: Array) -> list[_Knot]:
        """Average what is seen about each knot; see `with_trends`."""
        near = self.shares.argmax(axis=1)
        best = angles + self.frames.moved[:, joints]
        follows = np.array(self.frames.follows[:, joints])
        # A mounting does not change: what it makes of the means is none of a trend's.
        follows[..., : 3 * self.sensors] = 0.0
        shown = np.diagonal(self.frames.H, axis1=1, axis2=2).any(axis=1)
        knots = []
        for number in range(self.shares.shape[1]):
            frames = near == number
            counted = frames & shown
            if not counted.any():
                continue
            there = FrameSums(frames=self.frames, shares=self.shares[counted], sensors=self.sensors)
            knot = _Knot(
                angles=best[counted].mean(axis=0),
                follows=there._widened(follows[counted]) / counted.sum(),
                vertical=np.nanmean(upright[frames], axis=0),
            )
            knots.append(knot)
        return knots


@read_only
class _Knot:
    """What is seen about a knot of the headings.

    Attributes
    ----------
    angles : (joints,) mean of the best poses of the frames that are nearest to it [rad]
    follows : (joints, unknowns) how these follow the unknowns
    vertical : (sensors, 3) mean of the vertical in the axes of each sensor's body
    """

    angles: Array
    follows: Array
    vertical: Array
