"""Skin that slides as one piece: what it adds to the gradient and to the zero angles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.body.calibrate.angle_slopes import FrameSlopes, frame_slopes
from myomorph.body.calibrate.shared_problem import Point, SharedProblem
from myomorph.core.model.arrays import Array
from myomorph.core.rigid.coordinates import Ints


class Slide(NamedTuple):
    """Standard deviations by which all markers of a segment move as one.

    Attributes
    ----------
    shift : along each axis [m]
    turn : about each axis through the middle of the markers [rad]
    """

    shift: float
    turn: float


class SlideModes(NamedTuple):
    """Ways in which the markers of one body slide.

    Attributes
    ----------
    markers : (chosen,) numbers of the body's markers
    moves : (chosen, 3, 6) in the body's axes [m]: three shifts, then three rotations about their
        mean position
    """

    markers: Ints
    moves: Array

    @property
    def rows(self) -> Ints:
        """(3 chosen,) rows of these markers among those of all markers."""
        return np.repeat(3 * self.markers, 3) + np.tile(np.arange(3), len(self.markers))


def sliding(problem: SharedProblem, at: Point, slide: Slide, independent_frames: int) -> Array:
    """Compute what skin that slides as one piece does to the gradient and to the zero angles.

    A slide u of a segment's markers moves them by E u, and so the gradient by J^T W E u, where J
    are the markers' slopes with the angles at their best. The angles follow the markers as well.
    Slides of neighboring frames are alike: all frames count as `independent_frames`. Source: Barré
    et al. 2017, Fiorentino et al. 2017 (docs/references.md).

    Parameters
    ----------
    problem : of all frames
    at : point at which frames are settled
    slide : standard deviations of shifts and turns
    independent_frames : number of frames that all frames together are worth

    Returns
    -------
    (unknowns + coordinates, same) covariance of the gradient [m^2 per unknown], then of the mean
        angles [rad or m]; 0 where nothing slides
    """
    width = len(at.x) + len(problem.posture)
    covariance = np.zeros((width, width))
    if slide.shift <= 0.0 and slide.turn <= 0.0:
        return covariance
    bodies = problem.pose.markers.body
    locations = problem.placed(at.x)
    modes = [_modes(locations, bodies == body, slide) for body in np.unique(bodies)]
    frames = sum(len(angles) for angles in at.angles)
    alike = max(1.0, frames / independent_frames)
    for frame in frame_slopes(problem, at):
        moved = [_moved(problem, frame, part, width, frames) for part in modes]
        columns = np.hstack(moved)
        # A frame stands for `share * frames` of them where not all are looked at.
        covariance += alike * frame.share * frames * columns @ columns.T
    return covariance


def _moved(
    problem: SharedProblem, frame: FrameSlopes, modes: SlideModes, width: int, frames: int
) -> Array:
    """Compute what the slides of one body move in a frame.

    Parameters
    ----------
    width : number of unknowns and coordinates
    frames : of all recordings, over which the mean angles are taken

    Returns
    -------
    (unknowns + coordinates, 6) of the gradient, then of the mean angles
    """
    count = len(problem.lengths)
    unknowns = width - len(problem.posture)
    rows = modes.rows
    body = problem.pose.markers.body[modes.markers]
    # A marker's own shift has the body's rotation, too.
    weighted = frame.weight[modes.markers][:, None, None] * modes.moves
    in_ground = (frame.rotations[body] @ weighted).reshape(len(rows), -1)
    columns = np.zeros((width, modes.moves.shape[2]))
    columns[:count] = frame.by_length[rows].T @ in_ground
    columns[count + rows] = weighted.reshape(len(rows), -1)
    columns[: unknowns - 1] += frame.angles.T @ (frame.by_angle[rows].T @ in_ground)
    # A seen marker moved one way is its place moved the other way.
    of_angles = -frame.angles[:, count + rows] @ modes.moves.reshape(len(rows), -1)
    columns[unknowns + frame.free] = of_angles / frames
    return columns


def _modes(locations: Array, on_body: NDArray[np.bool_], slide: Slide) -> SlideModes:
    """Build the moves of one body's markers that slide as one piece.

    Parameters
    ----------
    locations : (markers, 3) of all markers on their bodies [m]
    on_body : (markers,) which are on the body
    slide : standard deviations
    """
    markers = np.flatnonzero(on_body)
    from_middle = locations[markers] - locations[markers].mean(axis=0)
    shifts = np.repeat(slide.shift * np.eye(3)[None], len(markers), axis=0)
    turns = slide.turn * np.cross(np.eye(3)[None], from_middle[:, None]).transpose(0, 2, 1)
    return SlideModes(markers=markers, moves=np.concatenate([shifts, turns], axis=2))
