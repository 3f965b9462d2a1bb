"""Forces at the contact points of a joint: its force shared among places that only push.

The medial and lateral condyles of a knee are the usual case. Two points on a line give the
two-point method: the force along their normal and the moment about the axis across their line, the
adduction moment, determine both (Winby et al. 2009; Fregly et al. 2012; Lerner et al. 2015). Any
number of points with normals of their own goes the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.errors import BadData, UnknownName, check_name
from myomorph.core.model.labelled import Labelled
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Actuator, Joint, Model
from myomorph.core.model.series import Motion, Series, Table, Wrenches
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.knees import long_axis
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.core.tension.load_quantities import JOINT_CONTACT_LOAD, JOINT_CONTACTS
from myomorph.core.tension.reaction import (
    JointReactions,
    Patella,
    frame_in_ground,
    joint_reactions,
)
from myomorph.core.tension.tension import Tension

FORCE_ALONG_NORMAL = 1e3
"""Weight of the force along the normals beside moments: a point that lifts off leaves a moment, not
a force.
"""
FLAT = 0.05
"""Moments of the points about an axis count where they are at least so much of those about the
strongest axis.
"""
EVEN = 1e-3
"""Weight of the points' own forces: of equal ways to share a force, points that lie close to each
other share it.
"""


@dataclass(frozen=True)
class ContactPoint:
    """Where a joint's force passes from one body to the other.

    Attributes
    ----------
    joint : whose force it carries
    name : of the point, unique in its joint: "medial"
    frame : body, or frame on a body, that it is fixed to; "" for the joint's child
    point : where it is in that frame [m]
    normal : direction in that frame in which it pushes on the joint's child; None for the way from
        the joint's center to that of the next joint on the child, down the tibia for a knee
    """

    joint: str
    name: str
    frame: str
    point: tuple[float, float, float]
    normal: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class JointPoints:
    """Contact points of a model's joints.

    Attributes
    ----------
    points : of one joint after the other
    notes : one line each on points that were not taken from the joint's own bone
    """

    points: tuple[ContactPoint, ...]
    notes: tuple[Message, ...] = ()


@read_only
class JointContactForces(Labelled):
    """Forces at contact points of joints over time.

    Attributes
    ----------
    time : (frames,) [s]
    joints : that have contact points
    points : names of the points, joint by joint
    joint_of : joint of each point
    joint_contact_force : (frames, points) push of each point along its normal, 0 or more [N]; NaN
        where tensions are
    joint_contact_total : (frames, joints) size of the joint's whole force [N]
    joint_contact_shear : (frames, joints) force across the mean normal, which the points do not
        carry [N]
    joint_contact_unbalanced_force : (frames, joints) force along the mean normal that no push can
        give: above 0 where the bodies are pulled apart [N]
    joint_contact_unbalanced_moment : (frames, joints) size of the moment that is left where points
        have lifted off [N m]
    weight : of the body [N]
    """

    quantities = JOINT_CONTACTS

    time: Array
    joints: tuple[str, ...]
    points: tuple[str, ...]
    joint_of: tuple[str, ...]
    joint_contact_force: Array
    joint_contact_total: Array
    joint_contact_shear: Array
    joint_contact_unbalanced_force: Array
    joint_contact_unbalanced_moment: Array
    weight: float

    def __post_init__(self) -> None:
        frames = len(self.time)
        of_joints = (frames, len(self.joints))
        freeze(
            self,
            time=(-1,),
            joint_contact_force=(frames, len(self.points)),
            joint_contact_total=of_joints,
            joint_contact_shear=of_joints,
            joint_contact_unbalanced_force=of_joints,
            joint_contact_unbalanced_moment=of_joints,
        )

    def __len__(self) -> int:
        return len(self.time)

    def of(self, joint: str, point: str = "") -> Array:
        """Force at a point of a joint, or the size of the joint's whole force.

        Parameters
        ----------
        joint, point : by name; no point for the whole force

        Returns
        -------
        (frames,) [N]

        Raises
        ------
        UnknownName : no joint, or no point of it, has that name
        """
        check_name("joint", joint, self.joints, "the contact forces")
        if not point:
            return self.joint_contact_total[:, self.joints.index(joint)]
        columns = {self.points[column]: column for column in self._columns_of(joint)}
        check_name("contact point", point, columns, f"joint '{joint}'")
        return self.joint_contact_force[:, columns[point]]

    def _columns_of(self, joint: str) -> list[int]:
        """Columns of the points of a joint."""
        return [column for column, other in enumerate(self.joint_of) if other == joint]

    @property
    def point_columns(self) -> tuple[str, ...]:
        """`<point>_<joint>` of each point, so that a name still ends in its side."""
        return tuple(
            f"{name}_{joint}" for name, joint in zip(self.points, self.joint_of, strict=True)
        )

    def loads(self) -> Series:
        """Totals and forces at the points, joint by joint [N].

        Columns are `total_<joint>` and `<point>_<joint>`.
        """
        names: list[str] = []
        columns: list[Array] = []
        for j, joint in enumerate(self.joints):
            of_points = self._columns_of(joint)
            names += [f"total_{joint}", *(self.point_columns[column] for column in of_points)]
            columns += [
                self.joint_contact_total[:, j],
                *(self.joint_contact_force[:, column] for column in of_points),
            ]
        return Series(self.time, tuple(names), np.stack(columns, axis=1))

    def table(self) -> Table:
        """Write loads, and beside them what the points do not carry [N], [N m]."""
        loads = self.loads()
        kinds = ("shear", "unbalanced_force", "unbalanced_moment")
        rest = (
            self.joint_contact_shear,
            self.joint_contact_unbalanced_force,
            self.joint_contact_unbalanced_moment,
        )
        names = tuple(f"{kind}_{joint}" for kind in kinds for joint in self.joints)
        facts = {"name": JOINT_CONTACT_LOAD.title, "body_weight": f"{self.weight:.6g}"}
        return Table(
            self.time, (*loads.names, *names), np.hstack([loads.values, *rest]), facts=facts
        )

    def labels(self) -> dict[str, Sequence[str] | Array]:
        """Instants [s], points and joints, by dimension.

        Returns
        -------
        (times,) numbers or names, by dimension
        """
        return {
            "time": self.time,
            "joint_contact": self.point_columns,
            "contact_joint": self.joints,
        }


def joint_contact_forces(  # page: as of `joint_reactions`, and the points
    model: Model,
    motion: Motion,
    tension: Tension | Series | None,
    wrenches: Wrenches | None,
    points: Sequence[ContactPoint],
    *,
    actuators: Sequence[Actuator] | None = None,
    patella: Patella = "lever",
) -> JointContactForces:
    """Find forces at contact points of joints.

        minimise    |sum_i (r_i - c) x n_i f_i - M|^2
        subject to  f >= 0,  sum_i n_i f_i = F along the mean normal

    with the joint's force F and its moment M about the middle c of the points r_i, both as they act
    on the joint's child, and normals n_i. Of M only the axes count about which the points make
    moments: two points balance the moment across their line, and nothing else. Forces across the
    normals (ligaments, friction) are not shared. Where a force would have to pull, its point lifts
    off: the others carry the whole force, and the moment that is then left is part of the result.

    Source: Winby et al. 2009; Fregly et al. 2012; Lerner et al. 2015.

    Parameters
    ----------
    model, motion, tension, wrenches, actuators, patella : as of `joint_reactions`
    points : at least one; see `ContactPoint`

    Returns
    -------
    forces at the points, of the joints as a whole, and what the points do not carry

    Raises
    ------
    BadData : no points, two of a joint with one name, or normals of a joint point against each
        other
    UnknownName : a joint or a frame is not in the model

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.differentiate(mm.read_motion("reach.mot", model), cutoff=6.0)
    >>> ends = [("upper", (0.0, 0.0, 0.02)), ("lower", (0.0, 0.0, -0.02))]
    >>> down = (0.0, -1.0, 0.0)
    >>> points = [mm.ContactPoint("elbow", name, "", place, down) for name, place in ends]
    >>> mm.joint_contact_forces(model, motion, None, None, points).point_columns
    ('upper_elbow', 'lower_elbow')
    """
    joints = pointed_joints(model, points)
    reactions = joint_reactions(
        model,
        motion,
        tension,
        wrenches,
        joints,
        frame="ground",
        actuators=actuators,
        patella=patella,
    )
    return shared_reactions(model, motion, reactions, points)


def pointed_joints(model: Model, points: Sequence[ContactPoint]) -> tuple[str, ...]:
    """Name the joints that have contact points, each once.

    Raises
    ------
    BadData : there are no points
    UnknownName : a joint is not in the model
    """
    if not points:
        raise BadData("no contact points are given: expected at least one")
    known = {joint.name for joint in model.joints}
    for point in points:
        check_name("joint", point.joint, known, f"contact point '{point.name}': the model")
    return tuple(dict.fromkeys(point.joint for point in points))


def shared_reactions(
    model: Model, motion: Motion, reactions: JointReactions, points: Sequence[ContactPoint]
) -> JointContactForces:
    """Share loads of joints among their contact points.

    Parameters
    ----------
    model, motion : as of `joint_contact_forces`
    reactions : of the `pointed_joints`, on their children, in ground
    points : of these joints

    Returns
    -------
    as of `joint_contact_forces`
    """
    known = {joint.name: joint for joint in model.joints}
    joints = reactions.joints
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    ordered = []
    shared = []
    for j, joint in enumerate(joints):
        joint_points = [point for point in points if point.joint == joint]
        ordered += joint_points
        places, normals = _in_ground(tree, poses, known[joint], joint_points)
        shared.append(
            shared_force(
                reactions.forces[:, j],
                reactions.moments[:, j],
                reactions.points[:, j],
                places,
                normals,
            )
        )
    return JointContactForces(
        time=reactions.time,
        joints=joints,
        points=tuple(point.name for point in ordered),
        joint_of=tuple(point.joint for point in ordered),
        joint_contact_force=np.hstack([of_joint.forces for of_joint in shared]),
        joint_contact_total=np.linalg.norm(reactions.forces, axis=2),
        joint_contact_shear=np.stack([of_joint.shear for of_joint in shared], axis=1),
        joint_contact_unbalanced_force=np.stack([of_joint.pulled for of_joint in shared], axis=1),
        joint_contact_unbalanced_moment=np.stack([of_joint.moment for of_joint in shared], axis=1),
        weight=model.weight,
    )


def points_in_ground(
    tree: Tree, motion: Motion, joint: Joint, points: Sequence[ContactPoint]
) -> tuple[Array, Array]:
    """Points and unit normals of one joint in ground over a motion.

    Parameters
    ----------
    tree : of the model
    motion : of as many frames as asked for
    joint : whose points they are
    points : of it

    Returns
    -------
    (frames, points, 3) [m] and (frames, points, 3)
    """
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    return _in_ground(tree, poses, joint, points)


def _in_ground(
    tree: Tree, poses: Poses, joint: Joint, points: Sequence[ContactPoint]
) -> tuple[Array, Array]:
    """Points and unit normals of one joint in ground.

    Returns
    -------
    (frames, points, 3) [m] and (frames, points, 3)

    Raises
    ------
    BadData : two points have one name, a frame does not exist, or a normal has no direction
    """
    names = [point.name for point in points]
    twice = next((name for name in names if names.count(name) > 1), "")
    if twice:
        raise BadData(
            f"joint '{joint.name}' has two contact points '{twice}': give each a name of its own"
        )
    places = []
    normals = []
    for point in points:
        try:
            frame = frame_in_ground(tree, poses, point.frame or joint.child)
        except UnknownName as error:
            raise BadData(
                f"contact point '{point.name}' of joint '{joint.name}': {error}"
            ) from None
        places.append(frame.origins + frame.rotations @ np.asarray(point.point, dtype=np.float64))
        if point.normal is None:
            normals.append(_down(tree, poses, joint, point))
        else:
            normals.append(frame.rotations @ _unit(point))
    return np.stack(places, axis=1), np.stack(normals, axis=1)


def _unit(point: ContactPoint) -> Array:
    """Scale the normal of a point (3,) to unit length, in the axes of its frame."""
    normal = np.asarray(point.normal, dtype=np.float64)
    size = float(np.linalg.norm(normal))
    if not 1e-9 < size < np.inf:
        raise BadData(
            f"contact point '{point.name}' of joint '{point.joint}': its normal has no direction"
        )
    return normal / size


def _down(tree: Tree, poses: Poses, joint: Joint, point: ContactPoint) -> Array:
    """Direction (frames, 3) from the joint to the next joint on its child, in ground."""
    way = long_axis(tree.model, joint)
    if way is None:
        raise BadData(
            f"contact point '{point.name}' of joint '{joint.name}' has no normal, and no joint"
            f" follows on '{joint.child}' that would define one: give the direction in which it"
            f" pushes on '{joint.child}'"
        )
    return poses.rotations[:, tree.body_index[joint.child]] @ way


class SharedForce(NamedTuple):
    """Force of a joint shared among its points.

    Attributes
    ----------
    forces : (frames, points) push of each along its normal [N]
    shear : (frames,) force across the mean normal [N]
    pulled : (frames,) force along the mean normal that would have to pull [N]
    moment : (frames,) size of the moment that is left [N m]
    """

    forces: Array
    shear: Array
    pulled: Array
    moment: Array


def shared_force(
    force: Array, moment: Array, center: Array, points: Array, normals: Array
) -> SharedForce:
    """Share a joint's force among points that push, frame by frame.

    Parameters
    ----------
    force, moment : (frames, 3) on the child, the moment about `center` [N], [N m]
    center : (frames, 3) in the same axes [m]
    points, normals : (frames, points, 3) in the same axes [m], normals of unit length

    Returns
    -------
    NaN in frames whose force or moment is not known

    Raises
    ------
    BadData : normals point against each other
    """
    mean = _mean_normal(normals)
    middle = points.mean(axis=1)
    offsets = points - middle[:, None]
    spread = np.maximum(np.sqrt((offsets**2).sum(axis=2).mean(axis=1)), 1e-9)
    about_middle = moment + np.cross(center - middle, force)
    arms = np.cross(offsets, normals)
    along = np.einsum("fi,fi->f", force, mean)
    across = force - along[:, None] * mean

    forces = np.full(points.shape[:2], np.nan)
    pulled = np.full(len(points), np.nan)
    left = np.full(len(points), np.nan)
    for f in np.flatnonzero(np.isfinite(along) & np.isfinite(about_middle).all(axis=1)):
        axes = _balanced_axes(arms[f], spread[f])
        rows = _rows(normals[f], mean[f], axes, arms[f], spread[f])
        wanted = np.zeros(len(rows))
        wanted[0] = FORCE_ALONG_NORMAL * along[f]
        wanted[1:4] = across[f]
        wanted[4 : 4 + axes.shape[1]] = axes.T @ about_middle[f] / spread[f]
        forces[f] = scipy.optimize.nnls(rows, wanted)[0]
        pulled[f] = max(0.0, -along[f])
        left[f] = np.linalg.norm(axes.T @ (about_middle[f] - arms[f].T @ forces[f]))
    return SharedForce(
        forces=forces, shear=np.linalg.norm(across, axis=1), pulled=pulled, moment=left
    )


def _mean_normal(normals: Array) -> Array:
    """Direction (frames, 3) along the sum of normals (frames, points, 3)."""
    total = normals.sum(axis=1)
    size = np.linalg.norm(total, axis=1)
    if (size < 0.1 * normals.shape[1]).any():
        raise BadData(
            "the normals of a joint's contact points point against each other: expected one side"
            " that pushes"
        )
    return total / size[:, None]


def _balanced_axes(arms: Array, spread: float) -> Array:
    """Axes about which the points make moments.

    Parameters
    ----------
    arms : (points, 3) moment of one unit of force at each point [m]
    spread : root mean square distance of the points from their middle [m]

    Returns
    -------
    (3, axes) unit vectors
    """
    U, sizes, _ = np.linalg.svd(arms.T)
    strong = sizes > max(FLAT * sizes[0], 1e-9 * spread)
    return U[:, : len(sizes)][:, strong]


def _rows(normals: Array, mean: Array, axes: Array, arms: Array, spread: float) -> Array:
    """Rows of the least squares problem of one frame: force along and across, and moments.

    Parameters
    ----------
    normals, arms : (points, 3) of unit forces
    mean : (3,) mean normal
    axes : (3, axes) about which moments count
    spread : length by which moments are divided [m]

    Returns
    -------
    (rows, points)
    """
    count = len(normals)
    sideways = normals - np.outer(normals @ mean, mean)
    rows = [
        FORCE_ALONG_NORMAL * (normals @ mean)[None],
        sideways.T,
        axes.T @ arms.T / spread,
    ]
    if count > 1 + axes.shape[1]:
        rows.append(EVEN * np.eye(count))
    return np.vstack(rows)
