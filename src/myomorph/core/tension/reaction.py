"""Joint reactions: the force and moment that a joint's mechanism carries.

As OpenSim's JointReaction analysis defines them (Steele, DeMers, Schwartz and Delp 2012): with the
bodies that hang on a joint taken as free,

    reaction = sum over them of (rate of momentum - gravity - external - muscles
               - actuators on bodies - bushings)

so that it holds all that the joint transmits, forces along its own coordinates (reserves, springs,
residuals of coordinates) included. What acts on a coordinate is not a load on a body: it is a part
of the reaction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from myomorph.core.model.arguments import check_argument
from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.errors import BadData, UnknownName, check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.labelled import AXES, Labelled
from myomorph.core.model.model import GROUND, Actuator, Joint, Model, index_of
from myomorph.core.model.paths import Bushing
from myomorph.core.model.series import Motion, Series, Table, Wrenches
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.sync import refuse_other_times
from myomorph.core.muscles.model_paths import Paths, compile_paths
from myomorph.core.muscles.passive import joint_forces
from myomorph.core.muscles.patella import with_lever
from myomorph.core.rigid.bushings import angular_velocities, deflection
from myomorph.core.rigid.dynamics import (
    JointWrenches,
    external_arrays,
    joint_wrenches,
    motion_arrays,
)
from myomorph.core.rigid.forward import (
    balancing_multipliers,
    forward_accelerations,
    gathered,
    loop_wrenches,
)
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.loops import refuse_open
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.core.tension.load_quantities import JOINT_REACTIONS
from myomorph.core.tension.tension import Tension
from myomorph.core.tension.terms.actuators import default_reserves

On = Literal["child", "parent"]
Patella = Literal["lever", "string"]


def no_wrenches(tree: Tree, frames: int) -> Array:
    """Make wrenches of nothing: force, and its moment about the ground's origin, in ground.

    Parameters
    ----------
    tree : of the model
    frames : number of frames

    Returns
    -------
    (frames, bodies, 6) [N], [N m]
    """
    return np.zeros((frames, len(tree.arrays.parent), 6))


def about_origin(force: Array, point: Array, torque: Array | float = 0.0) -> Array:
    """Move a force with a free torque to the ground's origin.

    Parameters
    ----------
    force, point, torque : (..., 3) in ground [N], [m], [N m]

    Returns
    -------
    (..., 6) force, and moment about the origin
    """
    return np.concatenate([force, torque + np.cross(point, force)], axis=-1)


def of_muscles(paths: Paths, pulls: Array, tensions: Array) -> Array:
    """Wrenches of muscles of known tensions on bodies.

    Parameters
    ----------
    paths : of the muscles
    pulls : (frames, pairs, 6) as of `Paths.pulls`
    tensions : (frames, muscles) [N]

    Returns
    -------
    (frames, bodies, 6) [N], [N m]
    """
    result = no_wrenches(paths.tree, len(pulls))
    share = pulls * tensions[:, paths.pull_muscle, None]
    for body in np.unique(paths.pull_body):
        result[:, body] = share[:, paths.pull_body == body].sum(axis=1)
    return result


def of_actuators(tree: Tree, poses: Poses, actuators: Sequence[Actuator], forces: Array) -> Array:
    """Wrenches of actuators on the bodies that they push or turn; those of coordinates have none.

    Parameters
    ----------
    tree : of the model
    poses : of the bodies
    actuators : whose forces act
    forces : (frames, actuators) [N or N m]

    Returns
    -------
    (frames, bodies, 6) [N], [N m]
    """
    result = no_wrenches(tree, len(forces))
    for actuator, force in zip(actuators, forces.T, strict=True):
        if actuator.kind == "coordinate":
            continue
        where = f"for '{actuator.name}' the model"
        body = tree.body_number(actuator.body or GROUND, where)
        other = tree.body_number(actuator.other_body, where) if actuator.other_body else -1
        wrench, opposite = _actuator_wrenches(poses, actuator, body, max(other, 0), force)
        result[:, body] += wrench
        if other >= 0 and opposite is not None:
            result[:, other] += opposite
    return result


def _actuator_wrenches(
    poses: Poses, actuator: Actuator, body: int, other: int, force: Array
) -> tuple[Array, Array | None]:
    """Wrenches of an actuator on its body and on the body that reacts, None of a single point.

    Parameters
    ----------
    body, other : numbers
    force : (frames,) [N or N m]

    Returns
    -------
    (frames, 6) each [N], [N m]
    """
    point = _actuator_point(poses, actuator, body, actuator.point)
    if actuator.kind == "point_to_point":
        end = _actuator_point(poses, actuator, other, actuator.other_point)
        line = point - end
        push = force[:, None] * line / np.linalg.norm(line, axis=1, keepdims=True)
        return about_origin(push, point), about_origin(-push, end)

    unit = actuator.direction / (np.linalg.norm(actuator.direction) or 1.0)
    direction = np.broadcast_to(unit, (len(force), 3))
    if not actuator.direction_is_global:
        direction = np.einsum("fij,fj->fi", poses.rotations[:, body], direction)
    load = force[:, None] * direction
    if actuator.kind == "point":
        return about_origin(load, point), None
    wrench = np.concatenate([np.zeros_like(direction), load], axis=1)
    return wrench, -wrench


def _actuator_point(poses: Poses, actuator: Actuator, body: int, point: Array) -> Array:
    """Move a point (3,) of an actuator into ground, (frames, 3) or (3,) [m]."""
    if actuator.point_is_global:
        return point
    return poses.rotations[:, body] @ point + poses.origins[:, body]


def of_bushings(tree: Tree, poses: Poses, bushings: Sequence[Bushing], rates: Array) -> Array:
    """Wrenches of bushings on bodies.

    Parameters
    ----------
    tree : of the model
    poses : of the bodies
    bushings : of the model
    rates : (frames, coordinates) consistent [rad/s or m/s]

    Returns
    -------
    (frames, bodies, 6) [N], [N m]
    """
    result = no_wrenches(tree, len(rates))
    for bushing in bushings:
        first = tree.body_index[bushing.body_1]
        second = tree.body_index[bushing.body_2]
        wrench = _bushing_wrench(tree, poses, bushing, rates)
        result[:, second] += wrench
        result[:, first] -= wrench
    return result


def _bushing_wrench(tree: Tree, poses: Poses, bushing: Bushing, rates: Array) -> Array:
    """Wrench of a bushing on its second body (frames, 6); `rates` (frames, coordinates)."""
    q, B = deflection(tree, poses, bushing)
    stiffness = np.concatenate([bushing.rotational_stiffness, bushing.translational_stiffness])
    damping = np.concatenate([bushing.rotational_damping, bushing.translational_damping])
    load = -(stiffness * q + damping * np.einsum("fij,fj->fi", B, rates))
    # The generalized forces of the angles are E^T times the moment along the first frame's axes.
    slopes = np.swapaxes(angular_velocities(q[:, 0], q[:, 1]), 1, 2)
    moment = np.linalg.solve(slopes, load[:, :3, None])[..., 0]

    first = tree.body_index[bushing.body_1]
    second = tree.body_index[bushing.body_2]
    axes = poses.rotations[:, first] @ bushing.pose_1.rotation
    point = poses.origins[:, second] + poses.rotations[:, second] @ bushing.pose_2.translation
    return about_origin(
        np.einsum("fij,fj->fi", axes, load[:, 3:]),
        point,
        np.einsum("fij,fj->fi", axes, moment),
    )


def of_wrenches(tree: Tree, wrenches: Wrenches) -> Array:
    """Wrenches of external forces on bodies; where there is no force its point does not matter.

    Parameters
    ----------
    tree : of the model
    wrenches : in ground

    Returns
    -------
    (frames, bodies, 6) [N], [N m]
    """
    result = no_wrenches(tree, len(wrenches))
    without_force = (wrenches.forces == 0.0).all(axis=2)[..., None]
    points = np.where(without_force, 0.0, wrenches.points)
    for index, body in enumerate(wrenches.bodies):
        wrench = about_origin(
            wrenches.forces[:, index], points[:, index], wrenches.torques[:, index]
        )
        result[:, tree.body_number(body, f"for '{wrenches.names[index]}' the model")] += wrench
    return result


@read_only
class JointReactions(Labelled):
    """Loads of joints over time.

    Each is that on one of the joint's bodies, at the joint's point, in the axes of one frame.

    Attributes
    ----------
    time : (frames,) [s]
    joints : names
    bodies : the body that each load acts on
    frames : the body, frame or "ground" in whose axes each is
    forces, moments : (frames, joints, 3) [N], [N m]; NaN where tensions are
    points : (frames, joints, 3) where they act, seen from the frame [m]: the joint's frame on that
        body
    """

    quantities = JOINT_REACTIONS

    time: Array
    joints: tuple[str, ...]
    bodies: tuple[str, ...]
    frames: tuple[str, ...]
    forces: Array
    moments: Array
    points: Array

    def __post_init__(self) -> None:
        shape = (len(self.time), len(self.joints), 3)
        freeze(self, time=(-1,), forces=shape, moments=shape, points=shape)

    def __len__(self) -> int:
        return len(self.time)

    def labels(self) -> dict[str, Sequence[str] | Array]:
        """Label each dimension: times [s], joints, axes.

        Returns
        -------
        by dimension
        """
        return {"time": self.time, "joint": self.joints, "axis": AXES}

    def part(self, columns: slice) -> JointReactions:
        """Take the loads of some joints, by their places."""
        return JointReactions(
            time=self.time,
            joints=self.joints[columns],
            bodies=self.bodies[columns],
            frames=self.frames[columns],
            forces=self.forces[:, columns],
            moments=self.moments[:, columns],
            points=self.points[:, columns],
        )

    def of(self, joint: str) -> Array:
        """Force in one joint.

        Parameters
        ----------
        joint : by name

        Returns
        -------
        (frames, 3) [N]

        Raises
        ------
        UnknownName : no joint has that name
        """
        return self.forces[:, index_of("joint", joint, self.joints, "the reactions")]

    def table(self, labels: Mapping[str, str] | None = None) -> Table:
        """Table of the loads as OpenSim's JointReaction writes them.

        Its columns are `<joint>_on_<body>_in_<frame>_fx` ... `_pz`.

        Parameters
        ----------
        labels : plain names by joint; with them the magnitude of each force comes first,
            `<label>_force` [N]
        """
        frames = len(self.time)
        parts = np.concatenate([self.forces, self.moments, self.points], axis=2)
        endings = ("fx", "fy", "fz", "mx", "my", "mz", "px", "py", "pz")
        roots = [
            f"{joint}_on_{body}_in_{frame}"
            for joint, body, frame in zip(self.joints, self.bodies, self.frames, strict=True)
        ]
        names = [f"{root}_{ending}" for root in roots for ending in endings]
        values = parts.reshape(frames, -1)
        if labels is not None:
            names = [*(f"{labels[joint]}_force" for joint in self.joints), *names]
            values = np.hstack([np.linalg.norm(self.forces, axis=2), values])
        return Table(
            self.time, tuple(names), values, facts=FrozenMap({"name": "Joint Reaction Loads"})
        )


def joint_reactions(  # page: what OpenSim's analysis has as settings
    model: Model,
    motion: Motion,
    tension: Tension | Series | None,
    wrenches: Wrenches | None = None,
    joints: Sequence[str] | None = None,
    on: On | Sequence[On] = "child",
    frame: str | Sequence[str] = "child",
    *,
    actuators: Sequence[Actuator] | None = None,
    accelerations: Literal["motion", "forces"] = "motion",
    patella: Patella = "lever",
) -> JointReactions:
    """Find force and moment that every joint transmits.

    Source: Steele et al. 2012; Sherman, Seth and Delp 2011.

    Parameters
    ----------
    model : whose joints are asked for
    motion : with velocities and accelerations, at the times of the tensions
    tension : result of `solve_tension`, its contact forces included; or forces of muscles and
        actuators by name [N or N m], of all muscles that are switched on; None where no muscle
        takes part
    wrenches : external forces in ground at the motion's times
    joints : names, a joint may come twice; all joints in tree order by default
    on : the body that the load acts on, one for all or one per joint
    frame : "child", "parent", "ground", a body or a named frame, in whose axes it is; one for all
        or one per joint
    actuators : those beside the model's own that `tension` has forces of; by default reserves and
        residuals as `solve_tension` adds them
    accelerations : "motion": those of the motion, what forces leave unbalanced is taken as carried
        by the joints' own coordinates; "forces": those that the forces cause, as OpenSim's analysis
        does it. Balanced forces give the same either way
    patella : "lever": below a patella the tendon has the tension that its moment arm asks for
        (`muscles.patella`); "string": a muscle has one tension from end to end, as in OpenSim

    Returns
    -------
    forces and moments (frames, joints, 3) [N], [N m] about the joints' centers, and these in ground
    [m]

    Raises
    ------
    BadData : derivatives are missing, or times differ
    UnknownName : a joint, body, frame, muscle or actuator is not in the model or in the forces

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.differentiate(mm.read_motion("reach.mot", model), cutoff=6.0)
    >>> reactions = mm.joint_reactions(model, motion, None, joints=["elbow"], frame="ground")
    >>> reactions.joints, reactions.forces.shape
    (('elbow',), (61, 1, 3))
    """
    check_argument("model", model, Model)
    check_argument("motion", motion, Motion)
    tree = compile_tree(model)
    applied = _AppliedLoads(tree, motion)
    names = tuple(joint.name for joint in model.joints)
    requested = [model.joints[index_of("joint", name, names)] for name in joints or names]
    sides = _per_joint(on, len(requested), "on")
    frame_names = _per_joint(frame, len(requested), "frame")

    applied.add_external(wrenches, getattr(tension, "contacts", None))
    applied.add_tension(tension, actuators, patella)
    carried = applied.carried(accelerations)
    loads = [
        _joint_load(tree, applied.poses, joint, side, frame_name, carried)
        for joint, side, frame_name in zip(requested, sides, frame_names, strict=True)
    ]
    return JointReactions(
        time=motion.time,
        joints=tuple(joint.name for joint in requested),
        bodies=tuple(load.body for load in loads),
        frames=tuple(load.frame for load in loads),
        forces=np.stack([load.force for load in loads], axis=1),
        moments=np.stack([load.moment for load in loads], axis=1),
        points=np.stack([load.point for load in loads], axis=1),
    )


def caused_motion(
    model: Model,
    motion: Motion,
    forces: Series | None,
    wrenches: Wrenches | None = None,
    actuators: Sequence[Actuator] = (),
) -> Motion:
    """Motion with the accelerations that all forces together cause, of all coordinates.

    Coordinates are in the model's order.

    Parameters
    ----------
    model : of the body
    motion : with velocities and accelerations, of which only those of prescribed coordinates are
        read
    forces : of muscles and actuators by name [N or N m], of all muscles that are switched on; None
        where none acts
    wrenches, actuators : as of `joint_reactions`
    """
    tree = compile_tree(model)
    applied = _AppliedLoads(tree, motion)
    applied.add_external(wrenches, None)
    applied.add_tension(forces, actuators)
    accelerations, _ = forward_accelerations(
        tree, applied.arrays, applied.bodies, applied.generalized()
    )
    return replace(
        motion,
        names=model.coordinate_names,
        values=applied.c,
        velocities=applied.cdot,
        accelerations=accelerations,
    )


class NamedForces(NamedTuple):
    """Forces of a result or a table, in the order of the model.

    Attributes
    ----------
    actuators : that have forces
    forces : (frames, actuators) [N or N m]
    tensions : (frames, muscles) [N]
    """

    actuators: list[Actuator]
    forces: Array
    tensions: Array


class _AppliedLoads:
    """Loads on bodies and along coordinates, summed over all that acts.

    Attributes
    ----------
    arrays : of the motion: c, cdot and cddot, (frames, coordinates) each, consistent
    poses : of the bodies
    bodies : (frames, bodies, 6) wrenches
    along : (frames, coordinates) forces of actuators of coordinates
    moved : (frames, coordinates) of muscles through points that move in their bodies, gathered
    lever : (frames, bodies, 6) or 0.0, what the patella as a lever changes of `bodies`: nothing
        that moves the model
    """

    def __init__(self, tree: Tree, motion: Motion):
        self.tree = tree
        self.motion = motion
        self.arrays = motion_arrays(tree, motion)
        self.c, self.cdot, _ = self.arrays
        refuse_open(tree, self.c)
        self.poses = forward_kinematics(tree, self.c)
        self.bodies = of_bushings(tree, self.poses, tree.model.bushings, self.cdot)
        self.along = np.zeros_like(self.c)
        self.moved = np.zeros_like(self.c)
        self.lever: Array | float = 0.0

    def add_external(self, wrenches: Wrenches | None, contacts: object) -> None:
        """Add measured forces, and those of contacts that a tension problem estimated."""
        if wrenches is not None:
            self._add_wrenches(wrenches)
        if hasattr(contacts, "wrenches"):
            self._add_wrenches(contacts.wrenches("site"))

    def _add_wrenches(self, wrenches: Wrenches) -> None:
        """Add forces on bodies, at the motion's times."""
        external_arrays(self.tree, self.motion, wrenches)
        self.bodies += of_wrenches(self.tree, wrenches)

    def add_tension(
        self,
        tension: Tension | Series | None,
        actuators: Sequence[Actuator] | None,
        patella: Patella = "string",
    ) -> None:
        """Add forces of muscles and actuators, where there are any."""
        if tension is None:
            return
        refuse_other_times("tensions", tension.time, self.motion.time)
        named = self._named(tension, actuators)
        if self.tree.model.muscles:
            self._add_muscles(named.tensions, patella)
        self.bodies += of_actuators(self.tree, self.poses, named.actuators, named.forces)
        names = self.tree.model.coordinate_names
        for actuator, force in zip(named.actuators, named.forces.T, strict=True):
            if actuator.kind == "coordinate":
                self.along[:, index_of("coordinate", actuator.coordinate, names)] += force

    def _add_muscles(self, tensions: Array, patella: Patella) -> None:
        """Add tensions of muscles (frames, muscles) [N]."""
        paths = compile_paths(self.tree.model)
        pulls, work = paths.pulls(self.c)
        self.bodies += of_muscles(paths, pulls, tensions)
        if patella == "lever":
            change = with_lever(paths, self.c, pulls, work) - pulls
            self.lever = of_muscles(paths, change, tensions)
        for number in np.flatnonzero(paths.arm_free & work.any(axis=0)):
            self.moved[:, paths.arm_coordinate[number]] += (
                work[:, number] * tensions[:, paths.arm_muscle[number]]
            )

    def _named(
        self, tension: Tension | Series, actuators: Sequence[Actuator] | None
    ) -> NamedForces:
        """Order forces of a result, or of a table by name."""
        model = self.tree.model
        added = default_reserves(model, 1.0, 1.0) if actuators is None else actuators
        known = {actuator.name: actuator for actuator in (*model.actuators, *added)}
        if isinstance(tension, Tension):
            names = tension.reserve_names
            forces = tension.actuator_force
            order = [
                index_of("muscle", name, tension.muscles, "the table of forces")
                for name in model.muscle_names
            ]
            tensions = tension.muscle_force[:, order]
        else:
            names = tuple(name for name in tension.names if name not in model.muscle_names)
            nothing = np.zeros((len(tension), 0))
            columns = [tension[name][:, None] for name in names]
            forces = np.concatenate([nothing, *columns], axis=1)
            tensions = _tensions_by_name(model, tension)
        for name in names:
            check_name("actuator", name, known, "the model with the actuators given")
        return NamedForces(
            actuators=[known[name] for name in names], forces=forces, tensions=tensions
        )

    def generalized(self) -> Array:
        """Gather forces along coordinates (frames, coordinates) that act on no body."""
        tree = self.tree
        bushings = [bushing.name for bushing in tree.model.bushings]
        springs = joint_forces(tree, self.c, self.cdot, bushings)
        return gathered(tree, self.c, self.along + springs) + self.moved

    def carried(self, accelerations: str) -> JointWrenches:
        """Wrenches of all joints on their child bodies, about the ground's origin.

        Parameters
        ----------
        accelerations : "motion" or "forces", see `joint_reactions`

        Raises
        ------
        BadData : other accelerations
        """
        tree = self.tree
        _, _, cddot = self.arrays
        if accelerations == "forces":
            cddot, multipliers = forward_accelerations(
                tree, self.arrays, self.bodies, self.generalized()
            )
        elif accelerations == "motion":
            multipliers = balancing_multipliers(tree, self.arrays, self.bodies, self.generalized())
        else:
            raise BadData(f"unknown accelerations '{accelerations}': there are 'motion', 'forces'")
        on_bodies = self.bodies + self.lever + loop_wrenches(tree, self.c, multipliers)
        return joint_wrenches(tree, self.c, self.cdot, cddot, on_bodies)


def _tensions_by_name(model: Model, forces: Series) -> Array:
    """Tensions (frames, muscles) [N] of a table, 0 of muscles that are switched off."""
    tensions = np.zeros((len(forces), len(model.muscles)))
    for m, muscle in enumerate(model.muscles):
        if muscle.enabled:
            column = index_of("muscle", muscle.name, forces.names, "the table of forces")
            tensions[:, m] = forces.values[:, column]
    return tensions


def _per_joint(values: str | Sequence[str], count: int, argument: str) -> list[str]:
    """Repeat one value for all joints, or take one per joint."""
    if isinstance(values, str):
        return [values] * count
    if len(values) == 1:
        return list(values) * count
    if len(values) != count:
        raise BadData(
            f"{argument} names {len(values)} for {count} joints: expected one for all, or one a"
            " joint"
        )
    return list(values)


@dataclass(frozen=True)
class JointEnd:
    """One of a joint's two bodies.

    Attributes
    ----------
    body : by name
    pose : of the joint's frame on it
    sign : of the load there: the joint loads its two bodies with opposite wrenches
    """

    body: str
    pose: Transform
    sign: float


@read_only
class JointLoad:
    """Load of one joint on one of its bodies, in the axes of a frame.

    Attributes
    ----------
    body, frame : by name
    force, moment : (frames, 3) [N], [N m]
    point : (frames, 3) where they act, seen from the frame [m]
    """

    body: str
    frame: str
    force: Array
    moment: Array
    point: Array


@read_only
class FrameMotion:
    """Motion of a named frame in ground.

    Attributes
    ----------
    name : without the joint's that it belongs to
    rotations : (frames, 3, 3)
    origins : (frames, 3) [m]
    """

    name: str
    rotations: Array
    origins: Array

    def components(self, vectors: Array) -> Array:
        """Components of vectors along the frame's axes.

        Parameters
        ----------
        vectors : (frames, 3) in ground

        Returns
        -------
        (frames, 3)
        """
        return np.einsum("fji,fj->fi", self.rotations, vectors)


def _joint_end(joint: Joint, side: str) -> JointEnd:
    """Find one of a joint's two bodies; `side` "child" or "parent"."""
    if side == "child":
        return JointEnd(body=joint.child, pose=joint.child_frame, sign=1.0)
    if side == "parent":
        return JointEnd(body=joint.parent, pose=joint.parent_frame, sign=-1.0)
    raise BadData(
        f"a reaction on the '{side}' of joint '{joint.name}': there are 'child', 'parent'"
    )


def _joint_load(
    tree: Tree, poses: Poses, joint: Joint, side: str, frame: str, carried: JointWrenches
) -> JointLoad:
    """Move the wrench of a joint from the ground's origin to the joint, into the axes of a frame.

    Parameters
    ----------
    side : "child" or "parent", the body that the load acts on
    frame : "child", "parent", "ground", a body or a named frame
    carried : wrenches of all joints on their child bodies, about the ground's origin
    """
    end = _joint_end(joint, side)
    body = tree.body_index[end.body]
    point = poses.origins[:, body] + poses.rotations[:, body] @ end.pose.translation

    child = tree.body_index[joint.child]
    force = end.sign * carried.forces[:, child]
    moment_at_origin = end.sign * carried.moments[:, child]
    moment = moment_at_origin - np.cross(point, force)

    ends = {"child": joint.child, "parent": joint.parent}
    axes = frame_in_ground(tree, poses, ends.get(frame.lower(), frame))
    return JointLoad(
        body=end.body,
        frame=axes.name,
        force=axes.components(force),
        moment=axes.components(moment),
        point=axes.components(point - axes.origins),
    )


def frame_in_ground(tree: Tree, poses: Poses, name: str) -> FrameMotion:
    """Motion in ground of a body, of the ground itself, or of a frame on one.

    A joint's own frames go by their name, or as "<joint>/<frame>" where several joints have one of
    that name.

    Raises
    ------
    UnknownName : neither a body nor a frame
    """
    plain = name.rsplit("/", 1)[-1]
    fixed = _named_frames(tree)
    of_joint = "/".join(name.strip("/").split("/")[-2:])
    key = of_joint if of_joint in fixed else plain
    if key not in fixed:
        raise UnknownName("frame", name, tuple(fixed))
    body_name, pose = fixed[key]
    body = tree.body_index[body_name]
    rotations = poses.rotations[:, body]
    return FrameMotion(
        name=plain,
        rotations=rotations @ pose.rotation,
        origins=poses.origins[:, body] + rotations @ pose.translation,
    )


@lru_cache(maxsize=4)
def _named_frames(tree: Tree) -> Mapping[str, tuple[str, Transform]]:
    """Body and pose on it of all frames that have a name.

    They are kept, as a call asks for those of one tree many times.
    """
    fixed = {item: (item, Transform.identity()) for item in tree.body_index}
    for joint in reversed(tree.model.joints):
        for end, body, pose in (
            (joint.parent_frame_name, joint.parent, joint.parent_frame),
            (joint.child_frame_name, joint.child, joint.child_frame),
        ):
            if end and end not in tree.body_index:
                fixed[end] = fixed[f"{joint.name}/{end}"] = (body, pose)
    return fixed | {frame.name: (frame.body, frame.pose) for frame in tree.model.frames}
