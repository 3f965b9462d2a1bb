"""The symmetry of the mean posture, as prior knowledge of all frames' angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.body.calibrate.shared_problem import MeanPosture
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.sides import mirror_names
from myomorph.core.motion.lengths import joint_centers
from myomorph.core.motion.starts import closed_defaults, root_coordinates
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import ROTATION, Tree

MIN_ALIKE = 0.9  # Cosine from which two axes of rotation are the same one
MAX_UNEVEN = 0.25  # Postures that both sides pass so unevenly say nothing of the mean [rad]
MIN_DISTANCE = 1e-6  # Between centers of both sides, below which they show no direction [m]


class Condition(NamedTuple):
    """A combination of mean angles that is about 0.

    Attributes
    ----------
    name : as "ankle_angle_r - ankle_angle_l"
    row : (coordinates,) factors of the mean angles
    uneven : how much more it may be because other postures were recorded [rad]
    """

    name: str
    row: Array
    uneven: float


def symmetric_posture(
    tree: Tree, free: Ints, angles: Sequence[Array], sd: float
) -> MeanPosture | None:
    """Build rows that hold the mean posture symmetric.

    They are right less left, and what bends or rotates the trunk to one side. How evenly a
    recording shows both sides is measured by what an offset does not change: the distances of the
    mean from the smallest and the largest angle. Where they differ, the row counts less, and beyond
    `MAX_UNEVEN` not at all. Joints to the ground have no rows.

    Parameters
    ----------
    tree : of the model
    free : (free,) coordinates that are solved for
    angles : of each recording (frames, coordinates) [rad or m]
    sd : standard deviation of a row [rad]

    Returns
    -------
    rows over the means of all coordinates; None where the model has no sides or no row is left
    """
    recorded = np.concatenate(angles)
    lateral = _lateral(tree)
    if lateral is None or len(recorded) == 0:
        return None
    joints = _Joints(
        names=tuple(coordinate.name for coordinate in tree.model.coordinates),
        axes=_axes(tree),
        lateral=lateral,
        compared=frozenset(free.tolist()) - set(root_coordinates(tree)),
    )
    conditions = [joints.condition(j, recorded) for j in free.tolist()]
    held = [one for one in conditions if one is not None and one.uneven <= MAX_UNEVEN]
    if not held:
        return None
    spread = np.array([float(np.hypot(sd, one.uneven)) for one in held])
    rows = np.array([one.row for one in held]) / spread[:, None]
    return MeanPosture(
        names=tuple(one.name for one in held), rows=rows, right=np.zeros(len(held)), sd=spread
    )


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class _Joints:
    """Angles of joints whose mean may be held symmetric.

    Attributes
    ----------
    names : of all coordinates
    axes : by coordinate (3,) direction that it rotates about, in ground
    lateral : (3,) unit vector across the body
    compared : coordinates that are solved for and are none of the root
    """

    names: tuple[str, ...]
    axes: Mapping[int, Array]
    lateral: Array
    compared: frozenset[int]

    def condition(self, j: int, recorded: Array) -> Condition | None:
        """Build the condition on a coordinate, and on that of the other side, which comes later.

        Parameters
        ----------
        j : number of the coordinate
        recorded : (frames, coordinates) [rad or m]

        Returns
        -------
        None where symmetry says nothing of it
        """
        if j not in self.compared or j not in self.axes:
            return None
        mirror = mirror_names(self.names)
        if self.names[j] not in mirror:
            return self._of_middle(j, recorded)
        return self._of_pair(j, self.names.index(mirror[self.names[j]]), recorded)

    def _of_middle(self, j: int, recorded: Array) -> Condition | None:
        """Hold an angle of the trunk that bends or rotates to one side at 0."""
        if abs(self.axes[j] @ self.lateral) > 1.0 - MIN_ALIKE:
            return None
        row = np.zeros(len(self.names))
        row[j] = 1.0
        uneven = _uneven(recorded[:, j], -recorded[:, j])
        return Condition(name=self.names[j], row=row, uneven=uneven)

    def _of_pair(self, j: int, other: int, recorded: Array) -> Condition | None:
        """Hold an angle equal to that of the other side, or to its negative."""
        if other < j or other not in self.axes or other not in self.compared:
            return None
        # Mirrored, an axis of rotation keeps its part along the normal of the mirror.
        axis = self.axes[j]
        mirrored = 2.0 * (axis @ self.lateral) * self.lateral - axis
        cosine = float(self.axes[other] @ mirrored)
        if abs(cosine) < MIN_ALIKE:
            return None
        sign = np.sign(cosine)
        row = np.zeros(len(self.names))
        row[j] = 1.0
        row[other] = -sign
        operator = "-" if sign > 0 else "+"
        return Condition(
            name=f"{self.names[j]} {operator} {self.names[other]}",
            row=row,
            uneven=_uneven(recorded[:, j], sign * recorded[:, other]),
        )


def _uneven(angle: Array, other: Array) -> float:
    """Bound how much the means of two angles may differ because other postures were recorded.

    Parameters
    ----------
    angle, other : (frames,) [rad]

    Returns
    -------
    largest difference of the means' distances from the smallest and the largest angle [rad]
    """
    low = abs((angle.mean() - angle.min()) - (other.mean() - other.min()))
    high = abs((angle.max() - angle.mean()) - (other.max() - other.mean()))
    return float(max(low, high))


def _axes(tree: Tree) -> Mapping[int, Array]:
    """Find the axis in the default pose of every coordinate that rotates about one axis.

    Returns
    -------
    index of the coordinate to (3,) direction in ground; the first one where there are several
    """
    poses = forward_kinematics(tree, closed_defaults(tree)[None])
    directions: dict[int, Array] = {}
    for axis, kind in enumerate(tree.arrays.axis_kind):
        for term, j in enumerate(tree.arrays.axis_coordinate[axis].tolist()):
            slope = float(poses.axis_slopes[0, axis, term])
            if kind == ROTATION and j >= 0 and abs(slope) > 1e-9:
                direction = np.sign(slope) * poses.axis_directions[0, axis]
                directions.setdefault(j, direction)
    return directions


def _lateral(tree: Tree) -> Array | None:
    """Find the direction from left to right by the joints of both sides in the default pose.

    Returns
    -------
    (3,) unit vector in ground; None without sides
    """
    poses = forward_kinematics(tree, closed_defaults(tree)[None])
    centers = joint_centers(tree, poses.axis_points[0], poses.origins[0])
    between = [
        centers[tree.body_index[name]] - centers[tree.body_index[other]]
        for name, other in mirror_names(tree.body_index).items()
        if name < other
    ]
    if not between:
        return None
    # Each pair shows a direction and not its sign: that is the first pair's.
    alike = [
        np.sign(direction @ between[0]) * direction
        for direction in between
        if np.linalg.norm(direction) > MIN_DISTANCE
    ]
    total = np.sum(alike, axis=0) if alike else np.zeros(3)
    norm = float(np.linalg.norm(total))
    return total / norm if norm > MIN_DISTANCE else None
