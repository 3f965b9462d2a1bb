"""Errors of a motion that return with the posture, and what they make of forces.

Skin carries markers along with the joints beside them, and joint centers are off by millimeters. So
the motion errs by a function of the posture, as forces are one: more frames do not average it out,
a second step errs as the first, and parts of a recording that were held out cannot show it. What
the markers alone say of its size enters here, whatever the measured wrench is.

Markers of a body are displaced as one piece, shifted and turned, by a constant and in proportion to
each coordinate beside the body. Least squares make of displacements d of the markers the change of
all coordinates

    dq = (J^T J + e)^-1 J^T d

with the slopes J of the markers, and the change of the wrench that masses must explain is, with
differences along every coordinate,

    dw = dw/dq dq + dw/dqdot dqdot + dw/dqddot dqddot
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from myomorph.body.identify.errors_in_rows import ReturningErrors
from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.parts import Parts, pieces_of
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.rigid.coordinates import Ints, couple_frames
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.loops import free_coordinates
from myomorph.core.rigid.regressor import base_regressor, base_wrench
from myomorph.core.rigid.tree import Tree, compile_tree

SKIN_SD = 0.006
"""Root mean square by which skin and lengths that are off displace a marker from its body [m].

Markers on skin move by 5 mm at shanks to 3 cm at thighs over the bone (Leardini et al. 2005).
"""
MAX_FRAMES = 600  # That stand for all frames of all recordings
RATE = 30.0  # Of these, at most: motions through a filter hold nothing faster [Hz]
STEP = 1e-4  # Of differences along a coordinate [rad or m] and its rates
WIDE = 1.0  # Standard deviation of a coordinate that no marker shows [rad or m]
WHOLE = 0.5
"""Share of the variance of skin's motion that all markers of a body have in common, which is
assumed: skin of a segment slides as one piece and is stretched.
"""


@read_only
class Posture:
    """Some frames of a recording, and what small changes of its coordinates do in them.

    Attributes
    ----------
    step : time between the frames [s]
    stands_for : frames of the recording that each stands for
    part : (frames,) part of the recordings that each is in, -1 for none
    values : (frames, free) coordinates [rad or m]
    rotations : (frames, bodies, 3, 3) of the bodies in ground
    inverse : (frames, free, markers, 3) change of coordinates by displacements of markers
    slopes : (3, frames, 6, free) change of the wrench by values, velocities and accelerations
    rows : (frames, 6, n) of the base parameters
    """

    step: float
    stands_for: int
    part: np.ndarray
    values: Array
    rotations: Array
    inverse: Array
    slopes: Array
    rows: Array


def skin_errors(
    model: Model, recordings: Sequence[Recording], parts: Parts, sd: float
) -> ReturningErrors:
    """Compute what errors of the motion that return with the posture make of rows.

    Parameters
    ----------
    model : at the body's mass, with markers where the body has them
    recordings : of which the parts were made, with derivatives of their motion
    parts : of `parts_of`
    sd : root mean square of a marker's displacement [m]

    Returns
    -------
    pulls at base parameters and squares; without markers there are no errors
    """
    tree = compile_tree(model)
    if not model.markers:
        return ReturningErrors(
            pulls=np.zeros((len(parts), 2, len(parts.base), 0)), squares=np.zeros((len(parts), 2))
        )
    postures = [*_postures(tree, recordings, parts, sd)]
    values = np.concatenate([posture.values for posture in postures])
    mean = values.mean(axis=0)
    spread = np.maximum(values.std(axis=0), 1e-9)
    free = free_coordinates(tree)
    pulls = []
    squares = np.zeros((len(parts), 2))
    for body in dict.fromkeys(marker.body for marker in model.markers):
        beside = np.flatnonzero(np.isin(free, _coordinates_beside(tree, body)))
        total = np.zeros((len(parts), 2, len(parts.base), 1))
        for posture in postures:
            deviation = (posture.values[:, beside] - mean[beside]) / spread[beside]
            shares = deviation / np.sqrt(max(len(beside), 1))
            along = np.column_stack([np.ones(len(shares)), shares])
            changed = _body_errors(tree, posture, body, along, sd)
            found = _errors_of(posture, changed, len(parts))
            total = total + found.pulls
            squares += found.squares
        pulls.append(total)
    return ReturningErrors(pulls=np.concatenate(pulls, axis=3), squares=squares)


def _postures(
    tree: Tree, recordings: Sequence[Recording], parts: Parts, sd: float
) -> Iterator[Posture]:
    """Choose frames of each recording, and look at small changes there.

    Parameters
    ----------
    tree : the compiled model
    recordings, parts : as of `skin_errors`
    sd : of a marker's displacement [m]
    """
    model = tree.model
    total = sum(len(recording.motion) for recording in recordings)
    first = 0
    for recording in recordings:
        clock = float(np.median(np.diff(recording.motion.time)))
        every = max(1, round(1.0 / (RATE * clock)), -(-total // MAX_FRAMES))
        pieces = pieces_of(model, recording, parts.least)
        numbers = pieces.parts(first)
        first += len(pieces.counts)
        chosen = np.arange(every // 2, len(recording.motion), every)
        chosen = chosen[np.isfinite(recording.motion.values[chosen]).all(axis=1)]
        part = numbers[chosen]
        motion = recording.motion.frames(chosen)
        wrenches = recording.wrenches.frames(chosen)
        rows = base_regressor(model, motion)
        known = np.isfinite(base_wrench(model, motion, wrenches)).all(axis=1)
        values = tree.coordinates_of(motion)
        poses = forward_kinematics(tree, values)
        yield Posture(
            step=every * clock,
            stands_for=every,
            part=np.where(known, part, -1),
            values=values[:, free_coordinates(tree)],
            rotations=poses.rotations,
            inverse=_inverse(tree, values, poses, sd),
            slopes=_wrench_slopes(tree, motion, wrenches, rows @ _flat(model)),
            rows=rows[:, :, parts.base.columns],
        )


def _flat(model: Model) -> Array:
    """List the inertial parameters (10 bodies,) of a model."""
    return np.asarray(inertial_parameters(model).ravel())


def _coordinates_beside(tree: Tree, body: str) -> Ints:
    """Find coordinates of the joints between a body and its neighbors."""
    names = {
        name
        for joint in tree.model.joints
        if joint.parent != GROUND and body in (joint.parent, joint.child)
        for name in joint.coordinates
    }
    listed = tree.model.coordinate_names
    return np.array([index for index, name in enumerate(listed) if name in names], np.int64)


def _inverse(tree: Tree, values: Array, poses: Poses, sd: float) -> Array:
    """Compute the change of coordinates by displacements of markers, (J^T J + e)^-1 J^T.

    Parameters
    ----------
    tree : the compiled model
    values : (frames, coordinates) [rad or m]
    poses : there
    sd : of a marker's displacement along one axis; what no marker shows stays within `WIDE` [m]

    Returns
    -------
    (frames, free, markers, 3)
    """
    markers = tree.model.markers
    at = poses.markers(markers).reshape(len(values), -1)
    columns = []
    for coordinate in free_coordinates(tree):
        nudged = values.copy()
        nudged[:, coordinate] += STEP
        couple_frames(tree.arrays, nudged)
        places = forward_kinematics(tree, nudged).markers(markers)
        columns.append((places.reshape(len(values), -1) - at) / STEP)
    J = np.stack(columns, axis=2)
    square = np.swapaxes(J, 1, 2) @ J + (sd / WIDE) ** 2 * np.eye(J.shape[2])
    inverse = np.linalg.solve(square, np.swapaxes(J, 1, 2))
    return np.asarray(inverse.reshape(len(values), J.shape[2], len(markers), 3))


def _wrench_slopes(tree: Tree, motion: Motion, wrenches: Wrenches, needed: Array) -> Array:
    """Differentiate the wrench to be explained along values, velocities and accelerations.

    Parameters
    ----------
    tree : the compiled model
    motion : some frames, with derivatives
    wrenches : at its times
    needed : (frames, 6) by the motion

    Returns
    -------
    (3, frames, 6, free) of the needed less the measured wrench
    """
    model = tree.model
    flat = _flat(model)
    at = needed - base_wrench(model, motion, wrenches)
    free = free_coordinates(tree)
    slopes = np.zeros((3, len(motion), 6, len(free)))
    for column, coordinate in enumerate(free):
        name = model.coordinate_names[coordinate]
        if name not in motion.names:
            continue
        for kind, moved in enumerate(_nudged(motion, motion.names.index(name))):
            wrench = base_regressor(model, moved) @ flat
            changed = wrench - base_wrench(model, moved, wrenches) - at
            slopes[kind, :, :, column] = changed / STEP
    return slopes


def _nudged(motion: Motion, column: int) -> Iterator[Motion]:
    """Move a coordinate by `STEP`: its value, then its velocity, then its acceleration alone."""
    step = np.zeros(len(motion.names))
    step[column] = STEP
    yield replace(motion, values=motion.values + step)
    yield replace(motion, velocities=np.asarray(motion.velocities) + step)
    yield replace(motion, accelerations=np.asarray(motion.accelerations) + step)


def _body_errors(tree: Tree, posture: Posture, body: str, along: Array, sd: float) -> Array:
    """Compute errors of the wrench where the skin of one body moves.

    Parameters
    ----------
    tree : the compiled model
    posture : of a recording
    body : whose markers are displaced
    along : (frames, functions) what displacements are proportional to
    sd : root mean square of a displacement [m]

    Returns
    -------
    (frames, 6, 6 functions) of the wrench [N m], [N]; of a body with one marker 3 functions
    """
    markers = tree.model.markers
    own = [index for index, marker in enumerate(markers) if marker.body == body]
    patterns = _patterns(np.array([markers[index].location for index in own]), sd)
    turned = np.einsum("fij,pmj->fpmi", posture.rotations[:, tree.body_index[body]], patterns)
    change = np.einsum("fcmi,fpmi->fcp", posture.inverse[:, :, own], turned, optimize=True)
    errors = (change[:, :, :, None] * along[:, None, None]).reshape(*change.shape[:2], -1)
    rates = np.gradient(errors, posture.step, axis=0)
    faster = np.gradient(rates, posture.step, axis=0)
    by_value, by_rate, by_acceleration = posture.slopes
    wrench: Array = by_value @ errors + by_rate @ rates + by_acceleration @ faster
    return wrench


def _patterns(locations: Array, sd: float) -> Array:
    """List displacements of a body's markers: all along an axis, and turned about their middle.

    Parameters
    ----------
    locations : (markers, 3) in the body [m]
    sd : root mean square of a displacement [m]

    Returns
    -------
    (3 or 6, markers, 3) in the body [m]
    """
    count = len(locations)
    axis_sd = sd / np.sqrt(3.0)
    shift = axis_sd * np.sqrt(WHOLE + (1.0 - WHOLE) / count)
    shifts = np.tile(shift * np.eye(3)[:, None], (1, count, 1))
    if count == 1:
        return shifts
    arms = locations - locations.mean(axis=0)
    # What markers do by themselves turns the piece the less, the more they are and the wider.
    turn = axis_sd * np.sqrt(1.0 - WHOLE) / np.sqrt(np.square(arms).sum() / 1.5)
    turns = turn * np.cross(np.eye(3)[:, None], arms[None])
    return np.concatenate([shifts, turns])


def _errors_of(posture: Posture, errors: Array, parts: int) -> ReturningErrors:
    """Sum products of rows and errors, and squares of these, over the frames of each part.

    Parameters
    ----------
    posture : of a recording
    errors : (frames, 6, k) of the wrench
    parts : number of parts of all recordings
    """
    count = posture.rows.shape[2]
    pulls = np.zeros((parts, 2, count, errors.shape[2]))
    squares = np.zeros((parts, 2))
    for part in np.unique(posture.part[posture.part >= 0]):
        inside = posture.part == part
        for kind, axes in enumerate((slice(0, 3), slice(3, 6))):
            rows = posture.rows[inside][:, axes].reshape(-1, count)
            off = errors[inside][:, axes].reshape(-1, errors.shape[2])
            pulls[part, kind] = posture.stands_for * (rows.T @ off)
            squares[part, kind] = posture.stands_for * np.square(off).sum()
    return ReturningErrors(pulls=pulls, squares=squares)
