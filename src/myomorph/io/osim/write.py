"""A model as an OpenSim 4 document, with what a file held beyond it put back."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable

import numpy as np
from lxml import etree

from myomorph.io.osim.document import NEWEST
from myomorph.io.osim.kept import HARMLESS
from myomorph.io.osim.ligaments import put_ligament
from myomorph.io.osim.marker_set import put_marker
from myomorph.io.osim.write_forces import (
    write_actuator,
    write_bushing,
    write_coupler,
    write_loop,
    write_muscle,
    write_passive,
    write_viscosity,
)
from myomorph.io.osim.write_functions import child, legal, number, numbers
from myomorph.io.osim.write_joints import body_path, euler, is_still, plan_joints, write_joint, write_offset_frame
from myomorph.io.parsing.text import written
from myomorph.model.errors import BadModel
from myomorph.model.model import GROUND, Body, Frame, Kept, Mesh, Model
from myomorph.model.paths import WrapObject
from myomorph.model.spatial import Transform

SAME_SINCE_2 = frozenset({"CoordinateLimitForce", "SpringGeneralizedForce", "ExpressionBasedCoordinateForce"})
PRIMITIVES = {"sphere": "Sphere", "cylinder": "Cylinder", "ellipsoid": "Ellipsoid", "box": "Brick"}
SETS = ("ConstraintSet", "ForceSet", "ControllerSet", "ContactGeometrySet", "ProbeSet", "ComponentSet")


def write_osim(model: Model, path: str | os.PathLike[str]) -> tuple[str, ...]:
    """Write a model as `.osim` of OpenSim 4.6, whole or not at all.

    Parts that reading kept are put back where their layout allows it.

    Returns
    -------
    warnings : what could not be written as it is, one line each
    """
    warnings = _renamed(model)
    root = etree.Element("OpenSimDocument", Version=str(NEWEST))
    _model(child(root, "Model", name=model.name), model, warnings)
    etree.indent(root, space="\t")
    text = etree.tostring(root, encoding="unicode")
    with written(path) as stream:
        stream.write('<?xml version="1.0" encoding="UTF-8" ?>\n')
        stream.write(text)
        stream.write("\n")
    return tuple(dict.fromkeys(warnings))


def _renamed(model: Model) -> list[str]:
    """A warning for names that OpenSim cannot hold; an error where two would become one."""
    groups = {
        "bodies": model.body_names,
        "joints": tuple(joint.name for joint in model.joints),
        "coordinates": model.coordinate_names,
        "markers": model.marker_names,
        "muscles": model.muscle_names,
    }
    changed = []
    for what, names in groups.items():
        meant: dict[str, str] = {}
        for name in names:
            if meant.setdefault(legal(name), name) != name:
                raise BadModel(f"{what} '{meant[legal(name)]}' and '{name}' would have one name in OpenSim")
        changed += [name for name in names if legal(name) != name]
    if not changed:
        return []
    shown = ", ".join(f"'{name}'" for name in changed[:3]) + (", ..." if len(changed) > 3 else "")
    return [f"blanks and signs in {len(changed)} names ({shown}) are written as '_', as OpenSim wants"]


def _model(element: etree._Element, model: Model, warnings: list[str]) -> None:
    plan = plan_joints(model, warnings)
    coordinates = {one.name: one for one in model.coordinates}
    joints = {name: legal(joint.name) for joint in plan.joints for name in joint.coordinates}
    kept = _usable(model.kept, warnings)
    _put_back(element, kept, "Model")
    child(element, "gravity", numbers(model.gravity))
    _write_body(child(element, "Ground", name=GROUND), GROUND, model.ground_meshes, model, kept)
    bodies = child(child(element, "BodySet", name="bodyset"), "objects")
    for body in (*model.bodies, *plan.bodies):
        _write_mass(bodies, body, model, kept)
    joint_set = child(child(element, "JointSet", name="jointset"), "objects")
    for joint in plan.joints:
        write_joint(joint_set, joint, coordinates, warnings)
    holders = {name: child(element, name, name=name.lower()) for name in SETS}
    sets = {name: child(holder, "objects") for name, holder in holders.items()}
    for coupler in model.couplers:
        write_coupler(sets["ConstraintSet"], coupler, warnings)
    for loop in model.loops:
        write_loop(sets["ConstraintSet"], loop, warnings)
    for muscle in model.muscles:
        write_muscle(sets["ForceSet"], muscle, joints, warnings)
    for muscle in model.muscles:
        if muscle.viscosity:
            write_viscosity(sets["ForceSet"], muscle, joints)
    for actuator in model.actuators:
        write_actuator(sets["ForceSet"], actuator)
    for passive in model.passive_torques:
        if not _is_kept(passive.name, kept):
            write_passive(sets["ForceSet"], passive, warnings)
    for bushing in model.bushings:
        if not _is_kept(bushing.name, kept):
            write_bushing(sets["ForceSet"], bushing)
    for name, objects in sets.items():
        _put_back(objects, kept, name, model, joints)
    _write_groups(holders["ForceSet"], model)
    markers = child(child(element, "MarkerSet", name="markerset"), "objects")
    for marker in model.markers:
        put_marker(markers, marker)
    components = etree.Element("components")
    _put_back(components, kept, "components")
    if len(components):
        element.append(components)


def _write_groups(parent: etree._Element, model: Model) -> None:
    """Groups in an order that every muscle's own order of groups agrees with, as the file's did."""
    members: dict[str, list[str]] = {}
    for muscle in model.muscles:
        for group in muscle.groups:
            members.setdefault(group, []).append(muscle.name)
    sooner: dict[str, set[str]] = {group: set() for group in members}
    for muscle in model.muscles:
        for i, group in enumerate(muscle.groups):
            sooner[group].update(muscle.groups[:i])
    groups = child(parent, "groups")
    waiting = list(members)
    while waiting:
        name = next((one for one in waiting if not sooner[one] & set(waiting)), waiting[0])
        waiting.remove(name)
        written_group = child(groups, "ObjectGroup")
        written_group.set("name", name)
        child(written_group, "members", " ".join(legal(one) for one in members[name]))


def _write_mass(parent: etree._Element, body: Body, model: Model, kept: list[Kept]) -> None:
    element = child(parent, "Body", name=body.name)
    _write_body(element, body.name, body.meshes, model, kept)
    inertia = body.inertia
    child(element, "mass", number(body.mass))
    child(element, "mass_center", numbers(body.mass_center))
    six = (inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2])
    child(element, "inertia", numbers(six))


def _write_body(element: etree._Element, name: str, meshes: Iterable[Mesh], model: Model, kept: list[Kept]) -> None:
    """Frames, meshes and wrap objects of a body or of the ground."""
    components = etree.Element("components")
    frames = [frame for frame in model.frames if frame.body == name]
    holders = {}
    for frame in frames:
        holders[frame.name] = write_offset_frame(components, frame.name, body_path(name), frame.pose)
    own = []
    for mesh in meshes:
        if is_still(mesh.pose):
            own.append(mesh)
            continue
        at = next((one.name for one in frames if _close(one.pose, mesh.pose)), "")
        if not at:
            at = _free_name(f"{name}_geom_frame", holders)
            holders[at] = write_offset_frame(components, at, body_path(name), mesh.pose)
            frames.append(Frame(at, name, mesh.pose))
        _write_meshes(holders[at], [mesh], at)
    _put_back(components, kept, f"/bodyset/{name}")
    if len(components):
        element.insert(0, components)
    _write_meshes(element, own, name)
    objects = child(child(element, "WrapObjectSet", name="wrapobjectset"), "objects")
    for wrap in model.wrap_objects:
        if wrap.body == name:
            _write_wrap(objects, wrap)


def _free_name(stem: str, taken: Iterable[str]) -> str:
    used = set(taken)
    return next(name for i in range(1, len(used) + 2) if (name := f"{stem}_{i}") not in used)


def _close(first: Transform, second: Transform) -> bool:
    return bool(
        np.allclose(first.rotation, second.rotation, rtol=0, atol=1e-14)
        and np.allclose(first.translation, second.translation, rtol=0, atol=1e-14)
    )


def _write_meshes(element: etree._Element, meshes: list[Mesh], name: str) -> None:
    if not meshes:
        return
    holder = element.find("attached_geometry")
    if holder is None:
        holder = child(element, "attached_geometry")
    for mesh in meshes:
        kind = "Mesh" if mesh.file else PRIMITIVES.get(mesh.shape)
        if kind is None:
            continue
        one = child(holder, kind, name=f"{name}_geom_{len(holder) + 1}")
        child(one, "socket_frame", "..")
        if mesh.file:
            child(one, "scale_factors", numbers(mesh.scale))
            child(one, "mesh_file", mesh.file)
        elif kind == "Sphere":
            child(one, "radius", number(mesh.scale[0]))
        elif kind == "Cylinder":
            child(one, "radius", number(mesh.scale[0]))
            child(one, "half_height", number(mesh.scale[1]))
        else:
            child(one, "radii" if kind == "Ellipsoid" else "half_lengths", numbers(mesh.scale))


def _write_wrap(parent: etree._Element, wrap: WrapObject) -> None:
    kinds = {"cylinder": "WrapCylinder", "sphere": "WrapSphere", "ellipsoid": "WrapEllipsoid", "torus": "WrapTorus"}
    element = child(parent, kinds[wrap.kind], name=wrap.name)
    child(element, "active", str(wrap.active).lower())
    child(element, "xyz_body_rotation", numbers(euler(wrap.pose.rotation)))
    child(element, "translation", numbers(wrap.pose.translation))
    child(element, "quadrant", wrap.quadrant or "all")
    size = [one if np.isfinite(one) else 100.0 for one in wrap.size]
    if wrap.kind == "ellipsoid":
        child(element, "dimensions", numbers(size))
    else:
        tags = {"cylinder": ("radius", "length"), "sphere": ("radius",), "torus": ("inner_radius", "outer_radius")}
        for tag, value in zip(tags[wrap.kind], size, strict=True):
            child(element, tag, number(value))


def _usable(kept: Iterable[Kept], warnings: list[str]) -> list[Kept]:
    """The kept parts that an OpenSim 4.6 document can hold, in its layout."""
    usable = []
    for part in kept:
        if part.kind == "BushingForce" and part.effect == HARMLESS:
            continue  # the model's own bushing is written
        new = part.version >= 40000 and not (part.room == "ControllerSet" and part.version < NEWEST)
        if new or part.room == "Model" or part.kind in SAME_SINCE_2:
            usable.append(part)
        elif part.version:
            warnings.append(f"{part.kind} '{part.name}' is left out: its layout is of document version {part.version}")
        else:
            warnings.append(f"{part.kind} '{part.name}' is left out: it is not OpenSim's")
    return usable


def _is_kept(passive: str, kept: list[Kept]) -> bool:
    """Whether a passive torque comes from a part that is put back; a limit has one for each of its sides."""
    names = {passive, passive.removesuffix("_upper"), passive.removesuffix("_lower")}
    return any(part.room == "ForceSet" and part.name in names for part in kept)


def _put_back(
    parent: etree._Element,
    kept: list[Kept],
    room: str,
    model: Model | None = None,
    joints: dict[str, str] | None = None,
) -> None:
    for part in kept:
        if part.room != room:
            continue
        element = etree.fromstring(part.text)
        if part.version < 30509:
            _renamed_switch(element, room)
        if model is not None:
            put_ligament(part, element, model.ligaments, joints or {})
        for path in element.findall("GeometryPath"):
            path.set("name", "path")
        parent.append(element)


def _renamed_switch(element: etree._Element, room: str) -> None:
    """Before 4.0, parts were switched off by `isDisabled`."""
    for switch in element.findall("isDisabled"):
        switch.tag = "isEnforced" if room == "ConstraintSet" else "appliesForce"
        switch.text = str(not re.fullmatch(r"\s*(true|1)\s*", switch.text or "")).lower()
