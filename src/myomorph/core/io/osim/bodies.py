"""OpenSim's bodies with their meshes and wrap objects, read and written."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import count

import numpy as np
from lxml import etree

from myomorph.core.io.osim.document import Node, child, put
from myomorph.core.io.osim.frames import (
    OFFSET_KINDS,
    Frames,
    body_path,
    euler,
    is_still,
    write_offset_frame,
)
from myomorph.core.io.osim.kept import put_back
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadModel
from myomorph.core.model.model import GROUND, Body, Frame, Kept, Mesh, Model
from myomorph.core.model.paths import WrapObject
from myomorph.core.model.spatial import Transform

FIRST_WITH_INERTIA = 30500  # Version of documents that state it as one vector.
ONES = (1.0, 1.0, 1.0)
QUADRANTS = {"all": "", "unassigned": "", "": ""} | {
    sign + axis: (sign or "+") + axis for sign in ("", "+", "-") for axis in "xyz"
}
WRAPS: dict[str, tuple[str, dict[str, float]]] = {
    "WrapCylinder": ("cylinder", {"radius": 1.0, "length": 1.0}),
    "WrapSphere": ("sphere", {"radius": 0.05}),
    "WrapTorus": ("torus", {"inner_radius": 0.01, "outer_radius": 0.05}),
    "WrapEllipsoid": ("ellipsoid", {}),
}
"""By class its shape, and its sizes with their defaults [m]."""
PRIMITIVES = {"Sphere": "sphere", "Cylinder": "cylinder", "Ellipsoid": "ellipsoid", "Brick": "box"}


def read_body(node: Node) -> Body:
    """Read a body with its mass properties and its meshes.

    Parameters
    ----------
    node : the body

    Returns
    -------
    mass [kg], center of mass (3,) [m] and inertia (3, 3) about it [kg m^2] in the body's frame

    Raises
    ------
    BadFile : it has no mass, or numbers that are not as they should be
    BadModel : its mass is negative
    """
    mass = node.number("mass", float("nan"))
    if mass != mass:
        raise node.bad("has no mass", "expected <mass> in kg, 0 for none")
    if mass < 0:
        raise BadModel(
            f"{node.document.path}: body '{node.name}' has mass {mass:g} kg: a mass cannot be"
            " negative"
        )
    return Body(
        name=node.name,
        mass=mass,
        mass_center=node.vector("mass_center"),
        inertia=_inertia(node),
        meshes=read_meshes(node),
    )


def _inertia(node: Node) -> Array:
    """Read the inertia (3, 3) about the center of mass, in the body's frame [kg m^2].

    Before version 3.5.0 each part stands by itself, and a moment that is left out is 1 kg m^2, as
    in OpenSim.
    """
    if node.document.version < FIRST_WITH_INERTIA:
        xx, yy, zz = [node.number(f"inertia_{axes}", 1.0) for axes in ("xx", "yy", "zz")]
        xy, xz, yz = [node.number(f"inertia_{axes}", 0.0) for axes in ("xy", "xz", "yz")]
    else:
        xx, yy, zz, xy, xz, yz = node.vector("inertia", (0.0,) * 6)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def read_meshes(node: Node) -> tuple[Mesh, ...]:
    """Read what draws a body: its own geometry and that of the offset frames inside it.

    Parameters
    ----------
    node : a body or the ground

    Returns
    -------
    meshes and shapes with their poses in the body and their scale factors or half sizes (3,)
    """
    visible = node.child("VisibleObject")
    if node.document.version < 30502 and visible is not None:
        return _old_meshes(visible)
    return tuple(_geometry(node, Transform.identity()))


def _old_meshes(visible: Node) -> tuple[Mesh, ...]:
    """Read the geometry of a body before version 3.5.2, with both scales multiplied."""
    outer_scale = visible.vector("scale_factors", ONES)
    if visible.document.version < 20101:
        return tuple(
            Mesh(file, Transform.identity(), outer_scale)
            for file in visible.words("geometry_files")
        )
    outer = _placed(visible)
    meshes = []
    geometry = visible.child("GeometrySet")
    for item in geometry.items("objects") if geometry is not None else []:
        if item.kind == "DisplayGeometry":
            scale = item.vector("scale_factors", ONES) * outer_scale
            meshes.append(Mesh(item.text("", "geometry_file"), outer @ _placed(item), scale))
    return tuple(meshes)


def _placed(node: Node) -> Transform:
    """Read a pose from six numbers: body-fixed X, Y, Z angles [rad] and a position [m]."""
    six = node.vector("transform", (0.0,) * 6)
    return Transform.from_euler_xyz(six[:3], six[3:])


def _geometry(node: Node, pose: Transform) -> list[Mesh]:
    """Read the geometry of a frame and of the offset frames inside it.

    Parameters
    ----------
    node : the frame
    pose : of the frame in its body
    """
    meshes = []
    for item in node.items("attached_geometry") or node.items("geometry"):
        if item.kind == "Mesh":
            file = item.text("", "mesh_file")
            if file:
                meshes.append(Mesh(file, pose, item.vector("scale_factors", ONES)))
        elif item.kind in PRIMITIVES:
            meshes.append(
                Mesh(
                    file="",
                    pose=pose,
                    scale=_half_sizes(item) * item.vector("scale_factors", ONES),
                    shape=PRIMITIVES[item.kind],
                )
            )
    for inner in node.items("components"):
        offset = inner.kind in OFFSET_KINDS and inner.kind != "StationDefinedFrame"
        if offset and inner.socket("parent") in ("..", node.path, ""):
            meshes += _geometry(inner, pose @ inner.pose("orientation", "translation"))
    return meshes


def _half_sizes(node: Node) -> Array:
    """Read the half sizes (3,) of a shape along its axes [m], a cylinder's along y."""
    if node.kind == "Sphere":
        return np.full(3, node.number("radius", 1.0))
    if node.kind == "Cylinder":
        radius = node.number("radius", 1.0)
        return np.array([radius, node.number("half_height", 1.0), radius])
    return node.vector("radii" if node.kind == "Ellipsoid" else "half_lengths", ONES)


def read_wrap_objects(node: Node, frames: Frames) -> list[WrapObject]:
    """Read the surfaces of a body, of the ground or of an offset frame, in its body's frame.

    Parameters
    ----------
    node : body, ground or frame
    frames : of the model

    Returns
    -------
    surfaces with poses in their bodies and sizes [m], in the file's order

    Raises
    ------
    BadFile : a quadrant or a size is not as it should be
    BadModel : a surface is of a class that is not supported
    """
    body = node.name or GROUND
    pose = Transform.identity()
    if node.kind in OFFSET_KINDS:
        body, pose = frames.place(node.path, node)
    elif node.kind == "Ground":
        body = GROUND
    return [_wrap_object(item, body, pose) for item in node.items("WrapObjectSet")]


def _wrap_object(node: Node, body: str, frame: Transform) -> WrapObject:
    """Read a surface; one without a size is switched off with a warning.

    Parameters
    ----------
    node : the surface
    body : name of the body
    frame : pose of the frame that the surface is given in, in the body
    """
    quadrant = node.text("all", "quadrant").lower()
    if quadrant not in QUADRANTS:
        raise node.bad(f"its quadrant is '{quadrant}'", "expected all, x, -x, y, -y, z or -z")
    pose = frame @ node.pose("xyz_body_rotation", "translation")
    if node.kind not in WRAPS:
        raise BadModel(
            f"{node.document.path}: wrap object '{node.name}' is a {node.kind}, which is not"
            " supported"
        )
    kind, tags = WRAPS[node.kind]
    if kind == "ellipsoid":
        size = tuple(float(radius) for radius in node.vector("dimensions", (0.05, 0.05, 0.05)))
    else:
        size = tuple(
            node.number(tag, default, infinite=tag == "length") for tag, default in tags.items()
        )
    if min(size) < 0:
        raise node.bad(f"has size {size}", "expected positive numbers")
    active = node.flag("active", True)
    if active and min(size) == 0:
        node.document.warn(f"wrap object '{node.name}' has no size: nothing wraps around it")
        active = False
    return WrapObject(
        name=node.name,
        body=body,
        kind=kind,  # type: ignore[arg-type]
        pose=pose,
        size=size,
        quadrant=QUADRANTS[quadrant],
        active=active,
    )


def write_body(parent: etree._Element, body: Body, model: Model, kept: list[Kept]) -> None:
    """Write a body with its frames, meshes, wrap objects and mass properties.

    Parameters
    ----------
    parent : element that gets it
    body : to write
    model : its frames and wrap objects are read
    kept : stored parts, of which the body's are written back
    """
    element = child(parent, "Body", name=body.name)
    write_body_parts(element, body.name, body.meshes, model, kept)
    inertia = body.inertia
    six = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    put(element, mass=body.mass, mass_center=body.mass_center, inertia=six)


def write_body_parts(
    element: etree._Element, name: str, meshes: Iterable[Mesh], model: Model, kept: list[Kept]
) -> None:
    """Write frames, meshes and wrap objects of a body or of the ground.

    Parameters
    ----------
    element : of the body
    name : of the body
    meshes : of the body; those with a pose go into an offset frame
    model : its frames and wrap objects are read
    kept : stored parts, of which the body's are written back
    """
    components = etree.Element("components")
    frames = [frame for frame in model.frames if frame.body == name]
    holders = {}
    for frame in frames:
        holders[frame.name] = write_offset_frame(
            components, frame.name, body_path(name), frame.pose
        )
    still = []
    for mesh in meshes:
        if is_still(mesh.pose):
            still.append(mesh)
            continue
        at = next((frame.name for frame in frames if _close(frame.pose, mesh.pose)), "")
        if not at:
            at = next(free for i in count(1) if (free := f"{name}_geom_frame_{i}") not in holders)
            holders[at] = write_offset_frame(components, at, body_path(name), mesh.pose)
            frames.append(Frame(at, name, mesh.pose))
        _write_meshes(holders[at], [mesh], at)
    put_back(components, kept, f"/bodyset/{name}")
    if len(components):
        element.insert(0, components)
    _write_meshes(element, still, name)
    objects = child(child(element, "WrapObjectSet", name="wrapobjectset"), "objects")
    for wrap in model.wrap_objects:
        if wrap.body == name:
            _write_wrap(objects, wrap)


def _close(first: Transform, second: Transform) -> bool:
    """Return whether two poses agree to rounding."""
    pairs = ((first.rotation, second.rotation), (first.translation, second.translation))
    return all(np.allclose(*both, rtol=0, atol=1e-14) for both in pairs)


def _write_meshes(element: etree._Element, meshes: list[Mesh], name: str) -> None:
    """Write meshes and the shapes that OpenSim has; other shapes are left out."""
    if not meshes:
        return
    holder = element.find("attached_geometry")
    if holder is None:
        holder = child(element, "attached_geometry")
    for mesh in meshes:
        kind = (
            "Mesh"
            if mesh.file
            else next((name for name, shape in PRIMITIVES.items() if shape == mesh.shape), None)
        )
        if kind is None:
            continue
        geometry = child(holder, kind, name=f"{name}_geom_{len(holder) + 1}")
        put(geometry, socket_frame="..")
        if mesh.file:
            put(geometry, scale_factors=mesh.scale, mesh_file=mesh.file)
        elif kind == "Sphere":
            put(geometry, radius=mesh.scale[0])
        elif kind == "Cylinder":
            put(geometry, radius=mesh.scale[0], half_height=mesh.scale[1])
        else:
            put(geometry, **{"radii" if kind == "Ellipsoid" else "half_lengths": mesh.scale})


def _write_wrap(parent: etree._Element, wrap: WrapObject) -> None:
    """Write a wrap object; OpenSim gets 100 m for an infinite length."""
    kind, tags = next((kind, tags) for kind, (shape, tags) in WRAPS.items() if shape == wrap.kind)
    element = child(parent, kind, name=wrap.name)
    put(
        element,
        active=wrap.active,
        xyz_body_rotation=euler(wrap.pose.rotation),
        translation=wrap.pose.translation,
    )
    put(element, quadrant=wrap.quadrant or "all")
    size = [length if np.isfinite(length) else 100.0 for length in wrap.size]
    put(
        element,
        **(
            {"dimensions": size} if wrap.kind == "ellipsoid" else dict(zip(tags, size, strict=True))
        ),
    )
