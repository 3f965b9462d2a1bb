"""OpenSim models (`.osim`, documents 1.9 to 4.6) as `Model`s."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from myomorph.core.io.osim.actuators import KINDS, placed_actuator, read_actuator
from myomorph.core.io.osim.bodies import read_body, read_meshes, read_wrap_objects
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
    muscles, others = with_dampers(
        _with_unique_names(muscles, "muscle", model.document), others, paths
    )
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
            number = number + 1
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
    if document.version < OLDEST:
        problem = (
            f"is an OpenSim document of version {document.version}, which OpenSim 4 refuses too"
        )
        raise BadFile(path, problem, "open and save it in OpenSim 3.3")
    if document.version > NEWEST:
        document.warn(
            f"document version {document.version} is newer than OpenSim 4.6 ({NEWEST}): read as if"
            " of 4.6"
        )
    for tag, usual in (
        ("length_units", ("meters", "metres", "meter", "m")),
        ("force_units", ("N", "newtons", "Newtons")),
    ):
        unit = node.text("", tag)
        if unit and unit not in usual:
            document.warn(f"{tag} is '{unit}': read as {usual[0]}, as OpenSim does")
    frames = Frames(node)
    ground = node.child("Ground")
    bodies = []
    for item in node.items("BodySet"):
        if item.name == GROUND:
            ground = ground or item
        elif item.kind == "Body":
            bodies.append(item)
    joints = _joints(node, bodies, frames)
    tree = _tree(node, [read_body(body_node) for body_node in bodies], joints)
    wraps, wrap_names = _wraps(node, ground, bodies, [body.name for body in tree.bodies], frames)
    names = tuple(coordinate.name for coordinate in tree.coordinates)
    forces = read_forces(node, frames, names, wrap_names)
    couplers, loops, constraints = read_constraints(node, frames, names)
    kept = (*constraints, *forces.kept, *kept_elsewhere(node, bodies))
    if tree.bodies and sum(body.mass for body in tree.bodies) == 0.0:
        document.warn("all bodies have zero mass: the model moves, but has no dynamics")
    for line in (*made_up_inertias(tree.bodies), *warnings_of(kept)):
        document.warn(line)
    return Model(
        name=node.name or Path(path).stem,
        bodies=tuple(tree.bodies),
        joints=tuple(tree.joints),
        coordinates=tuple(tree.coordinates),
        gravity=node.vector("gravity", (0.0, -9.80665, 0.0)),
        markers=tuple(_with_unique_names(read_markers(node, frames), "marker", document)),
        muscles=forces.muscles,
        wrap_objects=wraps,
        actuators=forces.actuators,
        couplers=couplers,
        loops=(*tree.loops, *loops),
        frames=frames.all(),
        ground_meshes=() if ground is None else read_meshes(ground),
        kept=kept,
        source=str(path),
        warnings=tuple(document.warnings),
        passive_torques=read_passive_torques(node, tree.coordinates),
        bushings=read_bushings(node, frames),
        ligaments=forces.ligaments,
    )


def _joints(node: Node, bodies: list[Node], frames: Frames) -> list[ReadJoint]:
    """Read the joints of the model, before version 3.5.1 those inside its bodies too."""
    joints = []
    for item in (*node.items("JointSet"), *node.items("components")):
        if item.kind.endswith("Joint"):
            joints.append(read_joint(item, frames))
    if node.document.version < 30501:
        for body in bodies:
            inner = body.inner("Joint")
            if inner is not None:
                joints.append(
                    read_joint(
                        Node(inner.element, node.document, f"/jointset/{inner.name}"),
                        frames,
                        body.name,
                    )
                )
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
    by_name = {body.name: body for body in bodies}
    if len(by_name) != len(bodies):
        names = [body.name for body in bodies]
        twice = next(name for name in names if names.count(name) > 1)
        raise BadModel(f"{node.document.path}: two bodies are named '{twice}'")
    placed = {GROUND}
    tree = Tree(
        bodies=[],
        joints=[],
        coordinates=[coordinate for joint in joints for coordinate in joint.coordinates],
        loops=[],
    )
    waiting = list(joints)
    while len(placed) <= len(bodies):
        step = next(
            (
                joint
                for joint in waiting
                if (joint.joint.parent in placed) != (joint.joint.child in placed)
            ),
            None,
        )
        if step is None:
            children = {joint.joint.child for joint in waiting}
            loose = [name for name in by_name if name not in placed]
            base = next((name for name in loose if name not in children), loose[0])
            node.document.warn(f"no joint leads to body '{base}': it floats freely, as in OpenSim")
            step = free_joint(base)
            tree.coordinates += step.coordinates
        else:
            waiting.remove(step)
        joint = step.joint if step.joint.parent in placed else reversed_joint(step.joint)
        placed.add(joint.child)
        tree.joints.append(joint)
        tree.bodies.append(by_name[joint.child])
    for waiting_joint in waiting:
        _cut(node, waiting_joint.joint, tree)
    return tree


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
    name = f"{stem}{sum(body.name.startswith(stem) for body in tree.bodies)}"
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


def _wraps(
    node: Node, ground: Node | None, bodies: list[Node], tree: list[str], frames: Frames
) -> tuple[tuple[WrapObject, ...], dict[str, str]]:
    """Read all wrap objects.

    Parameters
    ----------
    node : of the model
    ground : its node, None where the file has none
    bodies : nodes of its bodies
    tree : names of the bodies in tree order
    frames : of the model

    Returns
    -------
    wrap objects in tree order, named BODY/NAME where a name comes twice; and the object that each
    name in a path means, the file's first
    """
    holders = [] if ground is None else [ground]
    for body in bodies:
        holders += [
            body,
            *(
                component
                for component in body.items("components")
                if component.kind in OFFSET_KINDS
            ),
        ]
    holders += [
        component for component in node.items("components") if component.kind in OFFSET_KINDS
    ]
    wrap_objects = [wrap for holder in holders for wrap in read_wrap_objects(holder, frames)]
    names = [wrap.name for wrap in wrap_objects]
    wraps: list[WrapObject] = []
    meant: dict[str, str] = {}
    for wrap in wrap_objects:
        unique_name = wrap.name if names.count(wrap.name) == 1 else f"{wrap.body}/{wrap.name}"
        wraps.append(replace(wrap, name=unique_name))
        meant.setdefault(wrap.name, unique_name)
    order = {name: i for i, name in enumerate((GROUND, *tree))}
    return tuple(sorted(wraps, key=lambda wrap: order[wrap.body])), meant
