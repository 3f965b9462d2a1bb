"""OpenSim models (`.osim`, documents 1.9 to 4.6) as `Model`s."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from myomorph.core.io.osim.actuators import KINDS, placed_actuator, read_actuator
from myomorph.core.io.osim.bodies import read_body, read_meshes, read_wrap_objects
from myomorph.core.io.osim.components import gather_components, name_coordinates_apart
from myomorph.core.io.osim.constraints import read_bushings, read_constraints, read_passive_torques
from myomorph.core.io.osim.document import NEWEST, OLDEST, Document, Node, read_document
from myomorph.core.io.osim.frames import OFFSET_KINDS, Frames
from myomorph.core.io.osim.joints import ReadJoint, free_joint, read_joint, reversed_joint
from myomorph.core.io.osim.kept import kept_elsewhere, kept_force, warnings_of
from myomorph.core.io.osim.muscles import is_muscle, read_muscle, with_dampers
from myomorph.core.io.osim.paths import PathReader, read_ligaments
from myomorph.core.io.osim.setup_parts import read_markers
from myomorph.core.model.errors import BadFile, BadModel
from myomorph.core.model.inertia import made_up_inertias
from myomorph.core.model.model import (
    GROUND,
    Actuator,
    Body,
    Coordinate,
    Joint,
    Kept,
    Loop,
    Marker,
    Model,
)
from myomorph.core.model.paths import Ligament, Muscle, WrapObject
from myomorph.core.model.spatial import Transform

GRAVITY = (0.0, -9.80665, 0.0)
FIRST_WITH_JOINT_SET = 30501  # Version of documents; before, joints stand inside bodies too.
USUAL_UNITS = {
    "length_units": ("meters", "metres", "meter", "m"),
    "force_units": ("N", "newtons", "Newtons"),
}
Named = TypeVar("Named", Muscle, Actuator, Joint, Marker)  # page: typing takes types by position


@dataclass(frozen=True)
class Forces:
    """Contents of a ForceSet.

    Attributes
    ----------
    muscles, actuators, ligaments : in the file's order
    kept : other forces, which are only stored
    """

    muscles: tuple[Muscle, ...]
    actuators: tuple[Actuator, ...]
    kept: tuple[Kept, ...]
    ligaments: tuple[Ligament, ...]


def read_forces(
    model: Node, frames: Frames, coordinates: tuple[str, ...], wraps: dict[str, str]
) -> Forces:
    """Read muscles, actuators and the rest of a model's forces.

    Parameters
    ----------
    model : its node
    frames : of the model
    coordinates : names of its coordinates
    wraps : the model's wrap object that each name in a path means

    Returns
    -------
    muscles, actuators and ligaments, and the forces that are only stored

    Raises
    ------
    BadFile, BadModel : a force lacks a part, or has one that is not supported
    UnknownName : a force names a part that does not exist
    """
    paths = PathReader(frames, coordinates, wraps)
    groups = _groups(model)
    muscles = []
    actuators = []
    others = []
    for item in (*model.items("ForceSet"), *model.items("ActuatorSet")):
        if is_muscle(item):
            muscles.append(read_muscle(item, paths, groups.get(item.name, ())))
        elif item.kind in KINDS:
            actuators.append(_actuator(item, frames, coordinates))
        else:
            others.append(item)
    muscles = _with_unique_names(muscles, "muscle", model.document)
    muscles, others = with_dampers(muscles, others, paths)
    actuators = _with_unique_names(actuators, "actuator", model.document)
    kept = tuple(kept_force(other) for other in others)
    return Forces(
        muscles=tuple(muscles),
        actuators=tuple(actuators),
        kept=kept,
        ligaments=read_ligaments(others, paths),
    )


def _with_unique_names(items: Sequence[Named], kind: str, document: Document) -> list[Named]:
    """Rename items by numbers where names come twice or are empty, as OpenSim does.

    Parameters
    ----------
    items : of one kind
    kind : names those without a name, and begins the warning
    document : gets a warning where a name comes twice
    """
    result: dict[str, Named] = {}
    for item in items:
        name = item.name or kind
        number = 0
        while name in result:
            name = f"{item.name or kind}_{number}"
            number += 1
        if item.name and name != item.name:
            document.warn(f"two {kind}s are named '{item.name}': the later one is called '{name}'")
        result[name] = replace(item, name=name)
    return list(result.values())


def _actuator(node: Node, frames: Frames, coordinates: tuple[str, ...]) -> Actuator:
    """Read an actuator with its names looked up; `UnknownName` where one does not exist."""
    actuator = read_actuator(node)
    where = f"{node.document.path}: actuator '{actuator.name}': the model"
    return placed_actuator(
        actuator, coordinates, lambda name: frames.place(name or GROUND, node), where
    )


def _groups(model: Node) -> dict[str, tuple[str, ...]]:
    """Read the groups of each member, in the file's order."""
    result: dict[str, tuple[str, ...]] = {}
    forces = model.child("ForceSet", "ActuatorSet")
    if forces is None:
        return result
    for element in forces.element.findall("groups/ObjectGroup"):
        group = forces.node(element)
        for member in group.words("members"):
            result[member] = (*result.get(member, ()), group.name)
    return result


def read_osim(path: str | os.PathLike[str]) -> Model:
    """Read an OpenSim model.

    Source: Seth et al. 2018, OpenSim's model files.

    Parameters
    ----------
    path : of the file (.osim), of document version 1.9 to 4.6

    Returns
    -------
    the model in meters, radians and kilograms, with bodies in tree order and loops cut; `kept` has
    what is not modelled, `warnings` what was assumed

    Raises
    ------
    BadFile : it cannot be read, is no model, is too old, or a part of it is not as it should be
    BadModel : it has a part that is not supported
    UnknownName : a part names another that does not exist
    """
    node = read_document(path, ("Model",), "an OpenSim model")
    document = node.document
    _check_version(document)
    _check_units(node)
    gather_components(node)
    name_coordinates_apart(node)
    frames = Frames(node)
    parts = _body_nodes(node)
    joints = _joints(node, parts.bodies, frames)
    tree = _tree(node, [read_body(body) for body in parts.bodies], joints)
    wraps = _wraps(node, parts, [body.name for body in tree.bodies], frames)
    names = tuple(coordinate.name for coordinate in tree.coordinates)
    forces = read_forces(node, frames, names, wraps.by_name)
    couplers, loops, constraints = read_constraints(node, frames, names)
    kept = (*constraints, *forces.kept, *kept_elsewhere(node, parts.bodies))
    if tree.bodies and sum(body.mass for body in tree.bodies) == 0.0:
        document.warn(
            "all bodies have zero mass: the model moves, but has no dynamics", "changes results"
        )
    for line in (*made_up_inertias(tree.bodies), *warnings_of(kept)):
        document.warn(line)
    return Model(
        name=node.name or Path(path).stem,
        bodies=tuple(tree.bodies),
        joints=tuple(tree.joints),
        coordinates=tuple(tree.coordinates),
        gravity=node.vector("gravity", GRAVITY),
        markers=tuple(_with_unique_names(read_markers(node, frames), "marker", document)),
        muscles=forces.muscles,
        wrap_objects=wraps.objects,
        actuators=forces.actuators,
        couplers=couplers,
        loops=(*tree.loops, *loops),
        frames=frames.all(),
        ground_meshes=() if parts.ground is None else read_meshes(parts.ground),
        kept=kept,
        source=str(path),
        warnings=tuple(document.warnings),
        passive_torques=read_passive_torques(node, tree.coordinates),
        bushings=read_bushings(node, frames),
        ligaments=forces.ligaments,
    )


def _check_version(document: Document) -> None:
    """Refuse a document that is too old, and warn of one that is newer than we know."""
    version = document.version
    if version < OLDEST:
        raise BadFile(
            document.path,
            f"is an OpenSim document of version {version}, which OpenSim 4 refuses too",
            "open and save it in OpenSim 3.3",
        )
    if version > NEWEST:
        document.warn(
            f"document version {version} is newer than OpenSim 4.6 ({NEWEST}): read as if of 4.6"
        )


def _check_units(node: Node) -> None:
    """Warn of units that OpenSim does not heed."""
    for tag, usual in USUAL_UNITS.items():
        unit = node.text("", tag)
        if unit and unit not in usual:
            node.document.warn(f"{tag} is '{unit}': read as {usual[0]}, as OpenSim does")


@dataclass(frozen=True, kw_only=True)
class _BodyNodes:
    """Nodes of the ground and of the bodies.

    Attributes
    ----------
    ground : None where the file has none
    bodies : in the file's order
    """

    ground: Node | None
    bodies: list[Node]


def _body_nodes(node: Node) -> _BodyNodes:
    """Sort the bodies of a model; old documents have the ground among them."""
    ground = node.child("Ground")
    bodies = []
    for item in node.items("BodySet"):
        if item.name == GROUND:
            ground = ground or item
        elif item.kind == "Body":
            bodies.append(item)
    return _BodyNodes(ground=ground, bodies=bodies)


def _joints(node: Node, bodies: list[Node], frames: Frames) -> list[ReadJoint]:
    """Read the joints of the model, before version 3.5.1 those inside its bodies too."""
    items = (*node.items("JointSet"), *node.items("components"))
    joints = [read_joint(item, frames) for item in items if item.kind.endswith("Joint")]
    if node.document.version < FIRST_WITH_JOINT_SET:
        for body in bodies:
            inner = body.inner("Joint")
            if inner is None:
                continue
            placed = Node(inner.element, node.document, f"/jointset/{inner.name}")
            joints.append(read_joint(placed, frames, body.name))
    renamed = _with_unique_names([read.joint for read in joints], "joint", node.document)
    return [replace(read, joint=joint) for read, joint in zip(joints, renamed, strict=True)]


@dataclass
class Tree:
    """Bodies and joints ordered from the ground outwards.

    Attributes
    ----------
    bodies : in tree order
    joints : one for each body, which leads to it
    coordinates : in the file's order
    loops : ends of joints that were cut
    """

    bodies: list[Body]
    joints: list[Joint]
    coordinates: list[Coordinate]
    loops: list[Loop]


def _tree(node: Node, bodies: list[Body], joints: list[ReadJoint]) -> Tree:
    """Order bodies and joints as OpenSim does: loose bodies float, loops are cut and welded.

    Parameters
    ----------
    node : of the model; its document gets a warning for each body that floats and each loop
    bodies : in the file's order
    joints : in the file's order

    Raises
    ------
    BadModel : two bodies have one name, or a joint cannot be cut
    """
    by_name = _bodies_by_name(node, bodies)
    tree = Tree(
        bodies=[],
        joints=[],
        coordinates=[coordinate for joint in joints for coordinate in joint.coordinates],
        loops=[],
    )
    placed = {GROUND}
    waiting = list(joints)
    while len(placed) <= len(bodies):
        following = _next_joint(waiting, placed)
        if following is None:
            base = _base(waiting, [name for name in by_name if name not in placed])
            node.document.warn(f"no joint leads to body '{base}': it floats freely, as in OpenSim")
            following = free_joint(base)
            tree.coordinates += following.coordinates
        else:
            waiting.remove(following)
        joint = following.joint
        if joint.parent not in placed:
            joint = reversed_joint(joint)
        placed.add(joint.child)
        tree.joints.append(joint)
        tree.bodies.append(by_name[joint.child])
    for left in waiting:
        _cut(node, left.joint, tree)
    return tree


def _bodies_by_name(node: Node, bodies: Sequence[Body]) -> dict[str, Body]:
    """Index bodies by name; `BadModel` where two have one."""
    by_name = {body.name: body for body in bodies}
    if len(by_name) < len(bodies):
        names = [body.name for body in bodies]
        twice = next(name for name in names if names.count(name) > 1)
        raise BadModel(f"{node.document.path}: two bodies are named '{twice}'")
    return by_name


def _next_joint(joints: Sequence[ReadJoint], placed: Collection[str]) -> ReadJoint | None:
    """Find the first joint of which one body has its place and the other has none."""
    for read in joints:
        if (read.joint.parent in placed) != (read.joint.child in placed):
            return read
    return None


def _base(joints: Sequence[ReadJoint], loose: Sequence[str]) -> str:
    """Choose the loose body that floats: the first to which no joint leads, else the first."""
    children = {read.joint.child for read in joints}
    for name in loose:
        if name not in children:
            return name
    return loose[0]


def _cut(node: Node, joint: Joint, tree: Tree) -> None:
    """Lead a joint that closes a loop to a massless copy of its child, welded to it.

    Parameters
    ----------
    node : of the model, for messages
    joint : to cut
    tree : gets the copy, the joint and the weld

    Raises
    ------
    BadModel : the joint joins a body to itself, or leads to the ground
    """
    if joint.parent == joint.child or joint.child == GROUND:
        raise BadModel(
            f"{node.document.path}: joint '{joint.name}' joins '{joint.parent}' to '{joint.child}'"
        )
    stem = f"{joint.child}_slave_"
    number = sum(body.name.startswith(stem) for body in tree.bodies)
    name = f"{stem}{number}"
    node.document.warn(f"joint '{joint.name}' closes a loop: it was cut at body '{joint.child}'")
    still = Transform.identity()
    tree.bodies.append(Body(name=name, mass=0.0, mass_center=np.zeros(3), inertia=np.zeros((3, 3))))
    tree.joints.append(replace(joint, child=name))
    tree.loops.append(
        Loop(
            name=f"{name}_weld",
            kind="WeldConstraint",
            body_1=joint.child,
            body_2=name,
            pose_1=still,
            pose_2=still,
        )
    )


@dataclass(frozen=True, kw_only=True)
class _Wraps:
    """Wrap objects of a model.

    Attributes
    ----------
    objects : in tree order, named BODY/NAME where a name comes twice
    by_name : name of the object that each name in a path means, the file's first
    """

    objects: tuple[WrapObject, ...]
    by_name: dict[str, str]


def _wraps(node: Node, parts: _BodyNodes, tree: Sequence[str], frames: Frames) -> _Wraps:
    """Read all wrap objects.

    Parameters
    ----------
    node : of the model
    parts : nodes of its bodies
    tree : names of the bodies in tree order
    frames : of the model
    """
    holders = [] if parts.ground is None else [parts.ground]
    for body in parts.bodies:
        holders += [body, *_offset_frames(body)]
    holders += _offset_frames(node)
    wraps = [wrap for holder in holders for wrap in read_wrap_objects(holder, frames)]
    counts = Counter(wrap.name for wrap in wraps)
    objects: list[WrapObject] = []
    by_name: dict[str, str] = {}
    for wrap in wraps:
        unique_name = wrap.name if counts[wrap.name] == 1 else f"{wrap.body}/{wrap.name}"
        objects.append(replace(wrap, name=unique_name))
        by_name.setdefault(wrap.name, unique_name)
    order = {name: index for index, name in enumerate((GROUND, *tree))}
    objects.sort(key=lambda wrap: order[wrap.body])
    return _Wraps(objects=tuple(objects), by_name=by_name)


def _offset_frames(node: Node) -> list[Node]:
    """List the frames among the components of a node."""
    return [item for item in node.items("components") if item.kind in OFFSET_KINDS]
