"""The mean posture of a body whose halves mirror each other: what calibration holds likely of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.sides import mirror_names
from myomorph.motion.body.shared_problem import MeanPosture
from myomorph.motion.lengths import joint_centers
from myomorph.motion.starts import closed_defaults, root_coordinates
from myomorph.rigid.coordinates import Ints
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import ROTATION, Tree

ALONG = 0.9
"""Cosine from which two axes of rotation are the same one."""

MAX_UNEVEN = 0.25
"""Postures that both sides pass so unevenly say nothing of the mean [rad]."""


def symmetric_posture(tree: Tree, free: Ints, angles: Sequence[Array], sd: float) -> MeanPosture | None:
    """Rows that hold the mean posture symmetric: right less left, and what bends or turns the trunk to one side.

    How evenly a recording (frames, coordinates) [rad] shows both sides is seen from what an offset does not change, the
    distances of the mean from the least and the largest angle. Where they differ, the row counts less than `sd` [rad],
    and beyond `MAX_UNEVEN` not at all. Joints to the ground have no rows.
    """
    names = [coordinate.name for coordinate in tree.model.coordinates]
    every = np.concatenate(angles)
    axes = _axes(tree)
    lateral = _lateral(tree)
    if lateral is None or len(every) == 0:
        return None
    root, mirror = set(root_coordinates(tree)), mirror_names(names)
    conditions: list[tuple[str, Array, float]] = []
    for j in (int(coordinate) for coordinate in free):
        if j in root or j not in axes:
            continue
        row = np.zeros(len(names))
        row[j] = 1.0
        other = names.index(mirror[names[j]]) if names[j] in mirror else None
        if other is None:
            if abs(axes[j] @ lateral) > 1.0 - ALONG:
                continue
            text, uneven = names[j], _uneven(every[:, j], -every[:, j])
        else:
            if other < j or other not in axes or other not in free:
                continue
            # Mirrored, an axis of rotation keeps its part along the normal of the mirror.
            alike = float(axes[other] @ (2.0 * (axes[j] @ lateral) * lateral - axes[j]))
            if abs(alike) < ALONG:
                continue
            row[other] = -np.sign(alike)
            text = f"{names[j]} {'-' if alike > 0 else '+'} {names[other]}"
            uneven = _uneven(every[:, j], np.sign(alike) * every[:, other])
        if uneven <= MAX_UNEVEN:
            conditions.append((text, row, float(np.hypot(sd, uneven))))
    if not conditions:
        return None
    spread = np.array([coordinate for _, _, coordinate in conditions])
    rows = np.array([row for _, row, _ in conditions]) / spread[:, None]
    return MeanPosture(tuple(text for text, _, _ in conditions), rows, np.zeros(len(conditions)), spread)


def _uneven(angle: Array, other: Array) -> float:
    """How much the means of two angles may differ because not the same postures were recorded [rad]."""
    low = abs((angle.mean() - angle.min()) - (other.mean() - other.min()))
    high = abs((angle.max() - angle.mean()) - (other.max() - other.mean()))
    return float(max(low, high))


def _axes(tree: Tree) -> Mapping[int, Array]:
    """Coordinate to the direction about which it turns its body in the default pose; those that turn about one only."""
    poses = forward_kinematics(tree, closed_defaults(tree)[None])
    directions_of: dict[int, list[Array]] = {}
    for axis, kind in enumerate(tree.arrays.axis_kind):
        for t, j in enumerate(tree.arrays.axis_coordinate[axis]):
            slope = float(poses.axis_slopes[0, axis, t])
            if kind == ROTATION and j >= 0 and abs(slope) > 1e-9:
                directions_of.setdefault(int(j), []).append(np.sign(slope) * poses.axis_directions[0, axis])
    return {j: directions[0] for j, directions in directions_of.items()}


def _lateral(tree: Tree) -> Array | None:
    """(3,) from the left to the right, by the joints of both sides in the default pose; None without sides."""
    poses = forward_kinematics(tree, closed_defaults(tree)[None])
    centers = joint_centers(tree, poses.axis_points[0], poses.origins[0])
    mirror = mirror_names(tree.body_index)
    apart = [
        centers[tree.body_index[name]] - centers[tree.body_index[other]]
        for name, other in mirror.items()
        if name < other
    ]
    apart = [np.sign(direction @ apart[0]) * direction for direction in apart if np.linalg.norm(direction) > 1e-6]
    total = np.sum(apart, axis=0) if apart else np.zeros(3)
    size = float(np.linalg.norm(total))
    return total / size if size > 1e-6 else None
