"""OpenSim's bodies with their meshes, wrap objects and markers."""

from __future__ import annotations

import numpy as np

from myomorph.io.osim.document import Node
from myomorph.io.osim.frames import OFFSET_KINDS, Frames
from myomorph.model.arrays import Array
from myomorph.model.errors import BadModel
from myomorph.model.model import GROUND, Body, Marker, Mesh
from myomorph.model.paths import WrapObject
from myomorph.model.spatial import Transform

ONES, ZEROS = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
QUADRANTS = {"all": "", "unassigned": "", "": ""} | {
    sign + axis: (sign or "+") + axis for sign in ("", "+", "-") for axis in "xyz"
}
PRIMITIVES = {"Sphere": "sphere", "Cylinder": "cylinder", "Ellipsoid": "ellipsoid", "Brick": "box"}


def read_body(node: Node) -> Body:
    """A body with its mass properties and its meshes."""
    mass = node.number("mass", float("nan"))
    if mass != mass:
        raise node.bad("has no mass", "expected <mass> in kg, 0 for none")
    if mass < 0:
        raise BadModel(f"{node.document.path}: body '{node.name}' has mass {mass:g} kg: a mass cannot be negative")
    return Body(node.name, mass, node.vector("mass_center", ZEROS), _inertia(node), read_meshes(node))


def _inertia(node: Node) -> Array:
    if node.document.version < 30500:
        parts = [
            node.number(f"inertia_{one}", float(one in ("xx", "yy", "zz")))
            for one in ("xx", "yy", "zz", "xy", "xz", "yz")
        ]
    else:
        parts = list(node.vector("inertia", (0.0,) * 6))
    xx, yy, zz, xy, xz, yz = parts
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def read_meshes(node: Node) -> tuple[Mesh, ...]:
    """What draws a body: its own geometry and that of the offset frames inside it."""
    visible = node.child("VisibleObject")
    if node.document.version < 30502 and visible is not None:
        return _old_meshes(visible)
    return tuple(_geometry(node, Transform.identity()))


def _old_meshes(visible: Node) -> tuple[Mesh, ...]:
    outer_scale = visible.vector("scale_factors", ONES)
    if visible.document.version < 20101:
        return tuple(Mesh(file, Transform.identity(), outer_scale) for file in visible.words("geometry_files"))
    outer = _placed(visible)
    meshes = []
    geometry = visible.child("GeometrySet")
    for one in geometry.items("objects") if geometry is not None else []:
        if one.kind == "DisplayGeometry":
            scale = one.vector("scale_factors", ONES) * outer_scale
            meshes.append(Mesh(one.text("", "geometry_file"), outer @ _placed(one), scale))
    return tuple(meshes)


def _placed(node: Node) -> Transform:
    six = node.vector("transform", (0.0,) * 6)
    return Transform.from_euler_xyz(six[:3], six[3:])


def _geometry(node: Node, pose: Transform) -> list[Mesh]:
    meshes = []
    for one in node.items("attached_geometry") or node.items("geometry"):
        if one.kind == "Mesh":
            file = one.text("", "mesh_file")
            if file:
                meshes.append(Mesh(file, pose, one.vector("scale_factors", ONES)))
        elif one.kind in PRIMITIVES:
            meshes.append(Mesh("", pose, _half_sizes(one) * one.vector("scale_factors", ONES), PRIMITIVES[one.kind]))
    for inner in node.items("components"):
        if inner.kind in OFFSET_KINDS and inner.kind != "StationDefinedFrame":
            offset = Transform.from_euler_xyz(inner.vector("orientation", ZEROS), inner.vector("translation", ZEROS))
            if inner.socket("parent") in ("..", node.path, ""):
                meshes += _geometry(inner, pose @ offset)
    return meshes


def _half_sizes(node: Node) -> Array:
    if node.kind == "Sphere":
        return np.full(3, node.number("radius", 1.0))
    if node.kind == "Cylinder":
        radius = node.number("radius", 1.0)
        return np.array([radius, node.number("half_height", 1.0), radius])
    return node.vector("radii" if node.kind == "Ellipsoid" else "half_lengths", ONES)


def read_wrap_objects(node: Node, frames: Frames) -> list[WrapObject]:
    """The surfaces of a body, of the ground or of an offset frame, in its body's frame."""
    body, pose = (node.name or GROUND, Transform.identity())
    if node.kind in OFFSET_KINDS:
        body, pose = frames.place(node.path, node)
    elif node.kind == "Ground":
        body = GROUND
    return [_wrap_object(one, body, pose) for one in node.items("WrapObjectSet")]


def _wrap_object(node: Node, body: str, frame: Transform) -> WrapObject:
    quadrant = node.text("all", "quadrant").lower()
    if quadrant not in QUADRANTS:
        raise node.bad(f"its quadrant is '{quadrant}'", "expected all, x, -x, y, -y, z or -z")
    pose = frame @ Transform.from_euler_xyz(node.vector("xyz_body_rotation", ZEROS), node.vector("translation", ZEROS))
    kinds = {
        "WrapCylinder": ("cylinder", (("radius", 1.0), ("length", 1.0))),
        "WrapSphere": ("sphere", (("radius", 0.05),)),
        "WrapTorus": ("torus", (("inner_radius", 0.01), ("outer_radius", 0.05))),
    }
    if node.kind in kinds:
        kind, sizes = kinds[node.kind]
        size = tuple(node.number(tag, default, infinite=tag == "length") for tag, default in sizes)
    elif node.kind == "WrapEllipsoid":
        kind, size = "ellipsoid", tuple(float(one) for one in node.vector("dimensions", (0.05, 0.05, 0.05)))
    else:
        raise BadModel(f"{node.document.path}: wrap object '{node.name}' is a {node.kind}, which is not built")
    if min(size) < 0:
        raise node.bad(f"has size {size}", "expected positive numbers")
    active = node.flag("active", True)
    if active and min(size) == 0:
        node.document.warn(f"wrap object '{node.name}' has no size: nothing wraps around it")
        active = False
    return WrapObject(node.name, body, kind, pose, size, QUADRANTS[quadrant], active)  # type: ignore[arg-type]


def read_markers(node: Node, frames: Frames) -> list[Marker]:
    """The model's markers, on bodies."""
    markers = []
    for one in node.items("MarkerSet"):
        if one.kind != "Marker":
            continue
        body, pose = frames.place(one.socket("parent_frame", "body"), one)
        markers.append(Marker(one.name, body, pose.apply(one.vector("location", ZEROS)), one.flag("fixed", False)))
    return markers
