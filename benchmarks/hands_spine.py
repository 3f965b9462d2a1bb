"""The moment at L5/S1 over a lift: from below and from above, beside the original laboratory's."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.hands_lift import Recorded, lifter, man, recorded
from benchmarks.hands_lift_forces import Lift, plate_on_feet
from myomorph.core.model.arrays import Array
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from truths.carried_bodies import needed_wrench

REGRESSED = (-0.335, -0.032)
"""L5/S1 of men from between the front spines of the pelvis, forward and up, over their distance
(Dumas and Wojtusch 2018).
"""


@dataclass(frozen=True, eq=False)
class Spine:
    """Where the moment is taken, and what passes there.

    `rotations`: (frames, 3, 3) of the pelvis; `points`: (frames, 3) L5/S1 in ground [m]; `forces`:
    (frames, 3) of the trunk on the pelvis, from below [N]; `from_below`, `from_above`: (frames, 3)
    moment of the trunk on the pelvis, in the pelvis's axes [N m]; from above without what the hands
    carry.
    """

    rotations: Array
    points: Array
    forces: Array
    from_below: Array
    from_above: Array


def regressed_point(model: mm.Model) -> Array:
    """Return L5/S1 by the positions of the pelvis's markers on the calibrated model.

    Parameters
    ----------
    model : calibrated, with markers RASI, LASI, RPSI and LPSI

    Returns
    -------
    (3,) in the pelvis's frame [m]
    """
    right = model.marker("RASI").location
    left = model.marker("LASI").location
    middle = 0.5 * (right + left)
    rear = 0.5 * (model.marker("RPSI").location + model.marker("LPSI").location)
    across = (right - left) / np.linalg.norm(right - left)
    up = np.cross(right - rear, left - rear)
    up /= np.linalg.norm(up)
    forward = np.cross(up, across)
    width = float(np.linalg.norm(right - left))
    point: Array = middle + width * (REGRESSED[0] * forward + REGRESSED[1] * up)
    return point


def spine(folder: Path, lift: str, point: Array | None = None) -> Spine:
    """Return what passes at a point of the pelvis.

    Parameters
    ----------
    folder : of the collection
    lift : name of the recording
    point : (3,) in the pelvis's frame [m], by default the regressed L5/S1

    Returns
    -------
    Force and moment at the point
    """
    model, motion = man(folder, lift)
    record = recorded(folder, lift)
    place = regressed_point(lifter(folder).model) if point is None else point
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    pelvis = tree.body_index["pelvis"]
    R = poses.rotations[:, pelvis]
    at = poses.points(np.array([pelvis]), place[None])[:, 0]
    above = needed_wrench(model, motion, "torso")
    left = needed_wrench(model, motion, "pelvis", plate_on_feet(record, motion.time))
    force = above.forces[:, 0] - left.forces[:, 0]
    below = _moment(above, at) - _moment(left, at)
    return Spine(
        rotations=R,
        points=at,
        forces=-force,
        from_below=_into(R, -below),
        from_above=_into(R, -_moment(above, at)),
    )


def carried_moment(passing: Spine, found: Lift) -> Array:
    """Return the moment that the estimated forces at the hands add from above.

    Parameters
    ----------
    passing : point of the pelvis
    found : estimate of the hands' forces

    Returns
    -------
    (frames, 3) in the pelvis's axes [N m]
    """
    assert found.tension is not None
    assert found.tension.contacts is not None
    one = found.tension.contacts
    moment = (
        np.cross(one.contact_point[:, :2] - passing.points[:, None], one.contact_force[:, :2])
        + one.contact_torque[:, :2]
    )
    return _into(passing.rotations, moment.sum(axis=1))


def point_of_laboratory(folder: Path, lift: str) -> tuple[Array, Array]:
    """Return the point about which our moment from below is nearest to the laboratory's.

    A moment about another point differs by the force across the way, so the point is a linear
    least-squares problem.

    Parameters
    ----------
    folder : of the collection
    lift : name of the recording

    Returns
    -------
    (3,) in the pelvis's frame [m], and (frames, 3) the difference of moments that is left [N m]
    """
    origin = spine(folder, lift, np.zeros(3))
    measured = of_laboratory(recorded(folder, lift))[0]
    force = _into(origin.rotations, origin.forces)
    slopes = np.stack([np.cross(force, axis) for axis in np.eye(3)], axis=2)
    wanted = measured - origin.from_below
    point = np.asarray(
        np.linalg.lstsq(slopes.reshape(-1, 3), wanted.reshape(-1), rcond=None)[0], np.float64
    )
    left: Array = wanted - slopes @ point
    return point, left


def of_laboratory(record: Recorded) -> tuple[Array, Array]:
    """Return the laboratory's moments of the trunk on the pelvis, from below and from above.

    They are taken to be along the pelvis's axes: along the ground's, or the trunk's, they differ
    from ours by a part about the vertical that grows with the moment.

    Parameters
    ----------
    record : measured values

    Returns
    -------
    (frames, 3) from below, and (frames, 3) from above [N m]
    """
    return record.bottom_up, -record.top_down


def _moment(wrench: mm.Wrenches, at: Array) -> Array:
    moment: Array = wrench.torques[:, 0] + np.cross(wrench.points[:, 0] - at, wrench.forces[:, 0])
    return moment


def _into(rotations: Array, vectors: Array) -> Array:
    """Vectors of ground in axes that turn with a body."""
    turned: Array = np.einsum("fji,fj->fi", rotations, vectors)
    return turned
