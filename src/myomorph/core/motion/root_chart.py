"""Derivatives of a floating body that passes the singular pose of its angles.

Three angles about axes u, v, w say how a body floats. Where the middle one is a quarter turn, u and
w are in line: near that pose the outer angles change by up to half a turn within a few frames,
though the body turns evenly (a cartwheel, a roll). No filter and no spline of these angles gives
its angular velocity. So derivatives are taken of angles in another order of the same axes, and
taken back exactly: with R = Rot(u, a) Rot(v, b) Rot(w, c),

    omega = J (a', b', c'),   alpha = J (a'', b'', c'') + J' (a', b', c')
    J = (u, Rot(u, a) v, Rot(u, a) Rot(v, b) w)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.model import Axis, Joint, Model
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import euler_xyz_from_rotation
from myomorph.core.motion.turns import floating_coordinates, nearest_turn, other_branch

MIN_COSINE = 0.25  # Of the middle angle, below which other angles are looked for.
MIN_GAIN = 2.0  # Of that cosine, by which others must be better.
ORTHOGONAL = 1e-9  # Of products of axes.


class _Angles(NamedTuple):
    """Three angles about axes that are perpendicular to each other.

    Attributes
    ----------
    names : of the coordinates, in the order of their axes
    axes : (3, 3) unit vectors, one a row
    """

    names: tuple[str, ...]
    axes: Array

    @property
    def hand(self) -> float:
        """1 where the axes are right-handed, -1 else."""
        return float(np.sign(np.linalg.det(self.axes)))

    def rotations(self, angles: Array) -> Array:
        """Rotations (frames, 3, 3) of angles (frames, 3)."""
        first, second, third = map(_turns, self.axes, angles.T)
        return first @ second @ third

    def of(self, rotations: Array) -> Array:
        """Angles (frames, 3) of rotations (frames, 3, 3)."""
        return self.hand * euler_xyz_from_rotation(self.axes @ rotations @ self.axes.T)

    def jacobian(self, angles: Array) -> Array:
        """J (frames, 3, 3), whose columns are the axes about which each angle turns the body."""
        first, second, third = self.axes
        zero = np.zeros(len(angles))
        outer = self.rotations(np.stack([angles[:, 0], zero, zero], axis=1))
        both = self.rotations(np.stack([angles[:, 0], angles[:, 1], zero], axis=1))
        along = np.broadcast_to(first, (len(angles), 3))
        return np.stack([along, outer @ second, both @ third], axis=2)

    def bias(self, jacobian: Array, rates: Array) -> Array:
        """J' (a', b', c') (frames, 3) [rad/s^2]; an axis turns with the angles before it."""
        spins = jacobian * rates[:, None, :]
        return np.cross(spins[:, :, 0], spins[:, :, 1]) + np.cross(
            spins[:, :, 0] + spins[:, :, 1], spins[:, :, 2]
        )


def _turns(axis: Array, angles: Array) -> Array:
    """Rotations about an axis (3,) by angles (frames,) [rad]: 1 + sin K + (1 - cos) K^2."""
    # Columns are the axis times each unit vector.
    cross = np.cross(axis, np.eye(3)).T
    sine = np.sin(angles)[:, None, None]
    versine = (1.0 - np.cos(angles))[:, None, None]
    return np.eye(3) + sine * cross + versine * (cross @ cross)


@dataclass(frozen=True, kw_only=True, eq=False)
class RootChart:
    """A motion in angles that stay away from their singular pose.

    Attributes
    ----------
    motion : with the other angles in the columns of the floating body's, or as it was
    recorded : the motion as it was
    pairs : of each floating body its own angles, and those in their place; () where none change
    distance : smallest distance of a middle angle from a quarter turn [rad]
    """

    motion: Motion
    recorded: Motion
    pairs: tuple[tuple[_Angles, _Angles], ...] = ()
    distance: float = np.inf

    def back(self, motion: Motion) -> Motion:
        """Express a motion with derivatives in the model's own angles.

        Parameters
        ----------
        motion : of `motion`, filtered and differentiated, at any times among its own

        Returns
        -------
        the same with the model's angles and their derivatives
        """
        for own, other in self.pairs:
            motion = _expressed(motion, other, own, self.recorded)
        return motion


def root_chart(model: Model, motion: Motion) -> RootChart:
    """Find angles of floating bodies whose derivatives can be taken.

    Parameters
    ----------
    model : of the motion
    motion : (frames, coordinates), NaN in gaps [rad or m]

    Returns
    -------
    the motion itself where its angles stay away from their singular pose, or none does better
    """
    pairs = []
    distance = np.inf
    charted = motion
    floating = set(floating_coordinates(model))
    for joint in model.joints:
        own = _angles_of(joint)
        if own is None or not set(own.names) <= floating & set(motion.names):
            continue
        columns = [motion.names.index(name) for name in own.names]
        angles = motion.values[:, columns]
        known = np.asarray(np.isfinite(angles).all(axis=1))
        if not known.any():
            continue
        rotations = own.rotations(angles[known])
        cosine = _least_cosine(own, rotations)
        distance = min(distance, float(np.arcsin(min(cosine, 1.0))))
        if cosine >= MIN_COSINE:
            continue
        other = max(_orders(own), key=lambda order: _least_cosine(order, rotations))
        if _least_cosine(other, rotations) < MIN_GAIN * cosine:
            continue
        values = np.array(charted.values)
        values[known[:, None] & np.isin(np.arange(values.shape[1]), columns)] = other.of(
            rotations
        ).ravel()
        for start, stop in runs(known):
            values[start:stop, columns] = np.unwrap(values[start:stop, columns], axis=0)
        charted = replace(charted, values=values)
        pairs.append((own, other))
    return RootChart(motion=charted, recorded=motion, pairs=tuple(pairs), distance=distance)


def _angles_of(joint: Joint) -> _Angles | None:
    """Three angles about perpendicular axes, each turned one to one by a coordinate of its own."""
    turning = [axis for axis in joint.axes if axis.kind == "rotation"]
    if len(turning) != 3 or not all(_is_plain(axis) for axis in turning):
        return None
    names = tuple(axis.coordinates[0] for axis in turning)
    axes = np.array([_slope(axis) * axis.vector for axis in turning])
    if len(set(names)) < 3 or np.abs(axes @ axes.T - np.eye(3)).max() > ORTHOGONAL:
        return None
    return _Angles(names=names, axes=axes)


def _is_plain(axis: Axis) -> bool:
    """Return whether an axis is turned by one coordinate as it stands, or by its negative."""
    if len(axis.coordinates) != 1 or axis.function.arity != 1 or np.any(axis.origin):
        return False
    values = axis.function(np.array([0.0, 1.0, 2.0]))
    return bool(values[0] == 0.0 and abs(values[1]) == 1.0 and values[2] == 2.0 * values[1])


def _slope(axis: Axis) -> float:
    """Angle per unit of the coordinate of a plain axis, 1 or -1."""
    return float(axis.function(np.array(1.0)))


def _orders(own: _Angles) -> list[_Angles]:
    """List all orders of the axes of angles; names stay in their columns."""
    return [_Angles(own.names, own.axes[list(order)]) for order in permutations(range(3))]


def _least_cosine(angles: _Angles, rotations: Array) -> float:
    """Least cosine of the middle angle over rotations (frames, 3, 3)."""
    return float(np.abs(np.cos(angles.of(rotations)[:, 1])).min())


def _expressed(motion: Motion, other: _Angles, own: _Angles, recorded: Motion) -> Motion:
    """Express the angles `other` of a motion with derivatives as `own`, near those recorded."""
    columns = [motion.names.index(name) for name in own.names]
    angles = motion.values[:, columns]
    known = np.asarray(np.isfinite(angles).all(axis=1))
    assert motion.velocities is not None
    assert motion.accelerations is not None
    rates = motion.velocities[known][:, columns]
    jacobian = other.jacobian(angles[known])
    omega = np.einsum("fij,fj->fi", jacobian, rates)
    alpha = np.einsum("fij,fj->fi", jacobian, motion.accelerations[known][:, columns])
    alpha += other.bias(jacobian, rates)

    near = _recorded_near(recorded, own.names, motion.time[known])
    result = _nearest_branch(own.of(other.rotations(angles[known])), near)
    jacobian = own.jacobian(result)
    speeds = np.linalg.solve(jacobian, omega[:, :, None])[:, :, 0]
    unexplained = alpha - own.bias(jacobian, speeds)
    changes = np.linalg.solve(jacobian, unexplained[:, :, None])[:, :, 0]

    return replace(
        motion,
        values=_with_rows(motion.values, known, columns, result),
        velocities=_with_rows(motion.velocities, known, columns, speeds),
        accelerations=_with_rows(motion.accelerations, known, columns, changes),
    )


def _recorded_near(recorded: Motion, names: tuple[str, ...], time: Array) -> Array:
    """Angles (frames, 3) of a recorded motion in its frames nearest to times (frames,) [s]."""
    nearest = np.abs(recorded.time[:, None] - time).argmin(axis=0)
    return recorded.values[nearest][:, [recorded.names.index(name) for name in names]]


def _with_rows(table: Array, known: np.ndarray, columns: list[int], new: Array) -> Array:
    """Put values (known frames, columns) into a copy of a table (frames, coordinates)."""
    result = np.array(table)
    rows = result[known]
    rows[:, columns] = new
    result[known] = rows
    return result


def _nearest_branch(angles: Array, near: Array) -> Array:
    """Of both triples (frames, 3) of each rotation, whole turns apart, the one nearer to others."""
    first = nearest_turn(angles, near)
    second = nearest_turn(np.array([other_branch(triple) for triple in angles]), near)
    closer = ((second - near) ** 2).sum(axis=1) < ((first - near) ** 2).sum(axis=1)
    return np.where(closer[:, None], second, first)
