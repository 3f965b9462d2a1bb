"""OpenSim models (`.osim`, documents 1.9 to 4.6) as `Model`s."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from myomorph.io.osim_bodies import read_body, read_markers, read_meshes, read_wrap_objects
from myomorph.io.osim_document import OLDEST, Node, read_document, unique
from myomorph.io.osim_forces import read_forces
from myomorph.io.osim_constraints import read_constraints
from myomorph.io.osim_frames import OFFSET_KINDS, Frames
from myomorph.io.osim_joints import ReadJoint, read_joint, reversed_joint
from myomorph.model.errors import BadFile, BadModel
from myomorph.model.model import GROUND, Body, Coordinate, Joint, Kept, Mesh, Model
from myomorph.model.paths import WrapObject


def read_osim(path: str | Path) -> Model:
    """The model of an OpenSim file.

    Raises
    ------
    BadFile
        The file is not XML, cut off, not OpenSim's, or a value in it makes no sense.
    BadModel
        The model holds what would change the result and is not built.
    UnknownName
        Something refers to a body, coordinate or wrap object that the model does not have.
    """
    node = read_document(path, ("Model",), "an OpenSim model")
    document = node.document
    if document.version < OLDEST:
        raise BadFile(path, f"is an OpenSim document of version {document.version}", "save it with OpenSim 4 first")
    frames = Frames(node)
    ground = node.child("Ground")
    bodies = []
    for one in node.items("BodySet"):
        if one.name == GROUND:
            ground = ground or one
        elif one.kind == "Body":
            bodies.append(one)
    joints = _joints(node, bodies, frames)
    ordered, tree, coordinates = _tree(node, [read_body(one) for one in bodies], joints)
    wraps, wrap_names = _wraps(node, ground, bodies, frames)
    names = tuple(one.name for one in coordinates)
    forces = read_forces(node, frames, names, wrap_names)
    couplers, loops, constraints = read_constraints(node, frames, names)
    return Model(
        node.name or Path(path).stem,
        ordered,
        tree,
        coordinates,
        node.vector("gravity", (0.0, -9.80665, 0.0)),
        _markers(node, frames),
        forces.muscles,
        wraps,
        forces.actuators,
        couplers,
        loops,
        frames.all(),
        _ground_meshes(ground),
        (*constraints, *forces.kept, *_rest(node)),
        str(path),
        tuple(document.warnings),
    )


def _ground_meshes(ground: Node | None) -> tuple[Mesh, ...]:
    return () if ground is None else read_meshes(ground)


def _joints(node: Node, bodies: list[Node], frames: Frames) -> list[ReadJoint]:
    found = []
    for one in (*node.items("JointSet"), *node.items("components")):
        if one.kind.endswith("Joint"):
            found.append(read_joint(one, frames))
    if node.document.version < 30501:
        for body in bodies:
            inner = body.inner("Joint")
            if inner is not None:
                found.append(
                    read_joint(Node(inner.element, node.document, f"/jointset/{inner.name}"), frames, body.name)
                )
    names = unique([one.joint.name for one in found], "joint", node.document)
    return [replace(one, joint=replace(one.joint, name=name)) for one, name in zip(found, names, strict=True)]


def _tree(
    node: Node, bodies: list[Body], joints: list[ReadJoint]
) -> tuple[tuple[Body, ...], tuple[Joint, ...], tuple[Coordinate, ...]]:
    """Bodies in tree order, a joint for each, and the coordinates in the file's order."""
    placed = {GROUND}
    ordered: list[Body] = []
    tree: dict[str, Joint] = {}
    waiting = list(joints)
    by_name = {body.name: body for body in bodies}
    if len(by_name) != len(bodies):
        names = [body.name for body in bodies]
        twice = next(name for name in names if names.count(name) > 1)
        raise BadModel(f"{node.document.path}: two bodies are named '{twice}'")
    while waiting:
        step = next((one for one in waiting if (one.joint.parent in placed) != (one.joint.child in placed)), None)
        if step is None:
            break
        waiting.remove(step)
        joint = step.joint if step.joint.parent in placed else reversed_joint(step.joint)
        placed.add(joint.child)
        tree[joint.name] = joint
        ordered.append(by_name[joint.child])
    loose = [one.joint.name for one in waiting]
    if loose:
        raise BadModel(f"{node.document.path}: joints {', '.join(loose)} close a loop, which is not built")
    free = [name for name in by_name if name not in placed]
    if free:
        raise BadModel(f"{node.document.path}: no joint leads from the ground to the bodies {', '.join(free)}")
    order = {one.name: i for i, one in enumerate(ordered)}
    coordinates = tuple(one for joint in joints for one in joint.coordinates)
    return tuple(ordered), tuple(sorted(tree.values(), key=lambda one: order[one.child])), coordinates


def _wraps(
    node: Node, ground: Node | None, bodies: list[Node], frames: Frames
) -> tuple[tuple[WrapObject, ...], dict[str, str]]:
    """All wrap objects, and the one that each name in a path means: the first in OpenSim's order."""
    holders = [] if ground is None else [ground]
    for body in bodies:
        holders += [body, *(one for one in body.items("components") if one.kind in OFFSET_KINDS)]
    holders += [one for one in node.items("components") if one.kind in OFFSET_KINDS]
    found = [wrap for one in holders for wrap in read_wrap_objects(one, frames)]
    names = [one.name for one in found]
    wraps, meant = [], {}
    for wrap in found:
        own = wrap.name if names.count(wrap.name) == 1 else f"{wrap.body}/{wrap.name}"
        wraps.append(replace(wrap, name=own))
        meant.setdefault(wrap.name, own)
    return tuple(wraps), meant


def _markers(node: Node, frames: Frames) -> tuple:
    markers = read_markers(node, frames)
    names = unique([one.name for one in markers], "marker", node.document)
    return tuple(replace(one, name=name) for one, name in zip(markers, names, strict=True))


def _rest(node: Node) -> tuple[Kept, ...]:
    return ()
