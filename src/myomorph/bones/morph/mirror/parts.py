"""Every part of a model on the other side, under its other name."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from myomorph.bones.morph.mirror.sides import SNAP, OtherSide, Reflection, backwards, flip
from myomorph.core.model.errors import BadModel
from myomorph.core.model.model import (
    GROUND,
    Actuator,
    Axis,
    Body,
    Coordinate,
    Coupler,
    Joint,
    Loop,
    Mesh,
    Model,
)
from myomorph.core.model.paths import (
    Bushing,
    MovingPathPoint,
    Muscle,
    PassiveTorque,
    PathPoint,
    TendonWrap,
    WrapObject,
)
from myomorph.core.model.scale import slides_freely
from myomorph.core.model.sides import other_side
from myomorph.core.model.spatial import Transform

Part = TypeVar("Part", bound=Any)
Tie = TypeVar("Tie", Loop, Bushing)
NAMED = dict.fromkeys(
    ("body", "other_body", "body_1", "body_2", "parent", "child", "side_body"), "bodies"
)
NAMED |= dict.fromkeys(("coordinate", "dependent", "coordinates", "independents"), "coordinates")
NAMED |= {"wrap_object": "wraps"}
"""Fields that name other parts, and of which kind these are."""
FREE_AXIS = {"cylinder": 2, "torus": 1, "sphere": 2, "ellipsoid": 2}
"""The axis of a wrap object's own frame that is turned round: not one that its rules tell left from
right by.
"""
HINGE_AXIS = 2  # OpenSim's hinges turn about z of their frames, and go on doing so.


def _renamed(part: Part, side: OtherSide, kind: str = "", /, **changes: Any) -> Part:
    """Rename a part and all that it uses to the other side, with further changes."""
    replaced: dict[str, Any] = {"name": side.named(kind, part.name)} if kind else {}
    for name in NAMED.keys() & {field.name for field in fields(part)}:
        value = getattr(part, name)
        names = tuple(
            side.named(NAMED[name], text) for text in ([value] if isinstance(value, str) else value)
        )
        replaced[name] = names[0] if isinstance(value, str) else names
    return replace(part, **(replaced | changes))


def mirrored_parts(model: Model, side: OtherSide) -> Model:
    """Everything on the other side under its other name, in the given order."""
    planes = side.planes

    def each(
        parts: Iterable[Part], mirrored: Callable[[Part, OtherSide], Part]
    ) -> tuple[Part, ...]:
        return tuple(mirrored(part, side) for part in parts)

    return replace(
        model,
        bodies=each(model.bodies, _body),
        joints=each(model.joints, _joint),
        coordinates=each(model.coordinates, _coordinate),
        gravity=planes[GROUND].vectors(model.gravity),
        markers=tuple(
            _renamed(marker, side, "markers", location=planes[marker.body].points(marker.location))
            for marker in model.markers
        ),
        muscles=each(model.muscles, _muscle),
        wrap_objects=each(model.wrap_objects, _wrap),
        actuators=each(model.actuators, _actuator),
        couplers=each(model.couplers, _coupler),
        loops=each(model.loops, _tied),
        frames=tuple(
            _renamed(frame, side, "frames", pose=_pose(frame.pose, planes[frame.body]))
            for frame in model.frames
        ),
        ground_meshes=tuple(_mesh(mesh, planes[GROUND]) for mesh in model.ground_meshes),
        passive_torques=each(model.passive_torques, _passive),
        bushings=each(model.bushings, _tied),
    )


def _pose(pose: Transform, plane: Reflection) -> Transform:
    return plane.pose(pose, flip(plane.axis))


def _body(body: Body, side: OtherSide) -> Body:
    plane = side.planes[body.name]
    return _renamed(
        body,
        side,
        "bodies",
        mass_center=plane.points(body.mass_center),
        inertia=plane.matrix @ body.inertia @ plane.matrix,
        meshes=tuple(_mesh(mesh, plane) for mesh in body.meshes),
    )


def _mesh(mesh: Mesh, plane: Reflection) -> Mesh:
    """Return the same file, drawn with one factor of the other sign."""
    scale = np.array(mesh.scale, dtype=np.float64)
    if mesh.shape == "mesh":
        scale[plane.axis] *= -1.0
    return replace(mesh, pose=_pose(mesh.pose, plane), scale=scale)


def _joint(joint: Joint, side: OtherSide) -> Joint:
    parent = side.planes[joint.parent]
    child = side.planes[joint.child]
    if joint.child in side.middle:
        inner = Reflection(parent.seen_from(joint.parent_frame).normal)
    else:
        inner = flip(HINGE_AXIS if joint.kind == "PinJoint" else child.axis)
    return _renamed(
        joint,
        side,
        "joints",
        parent_frame=parent.pose(joint.parent_frame, inner),
        child_frame=child.pose(joint.child_frame, inner),
        axes=tuple(_axis(axis, inner, side) for axis in joint.axes),
        parent_frame_name=_frame_name(joint.parent_frame_name, side),
        child_frame_name=_frame_name(joint.child_frame_name, side),
    )


def _frame_name(name: str, side: OtherSide) -> str:
    return side.named("frames", name) if name and name != GROUND else name


def _axis(axis: Axis, inner: Reflection, side: OtherSide) -> Axis:
    signs = side.of(axis.coordinates)
    image = inner.turns(axis.vector) if axis.kind == "rotation" else inner.vectors(axis.vector)
    turned = bool(np.abs(image + axis.vector).max() < SNAP)
    # A sliding coordinate, and an angle of a side, keep their sign by an axis that turns round, as
    # OpenSim's do.
    follows = not axis.coordinates or any(sign < 0.0 for sign in signs)
    slides = axis.kind == "translation" and not slides_freely(axis.function)
    keeps = turned and (follows or slides)
    return _renamed(
        axis,
        side,
        vector=axis.vector if keeps else image + 0.0,
        function=backwards(axis.function, signs, -1.0 if keeps else 1.0),
        origin=inner.vectors(axis.origin) + 0.0,
    )


def _coordinate(coordinate: Coordinate, side: OtherSide) -> Coordinate:
    if side.signs[coordinate.name] > 0.0:
        return _renamed(coordinate, side, "coordinates")
    return _renamed(
        coordinate,
        side,
        "coordinates",
        default=-coordinate.default + 0.0,
        default_speed=-coordinate.default_speed + 0.0,
        range=_turned(coordinate.range),
        prescribed=None if coordinate.prescribed is None else coordinate.prescribed.scaled(-1.0),
    )


def _turned(bounds: tuple[float, float]) -> tuple[float, float]:
    return -bounds[1], -bounds[0]


def _coupler(coupler: Coupler, side: OtherSide) -> Coupler:
    sign = side.signs.get(coupler.dependent, 1.0)
    function = backwards(coupler.function, side.of(coupler.independents), sign)
    return _renamed(coupler, side, "couplers", function=function)


def _passive(passive: PassiveTorque, side: OtherSide) -> PassiveTorque:
    sign = side.signs.get(passive.coordinate, 1.0)
    torque = backwards(passive.torque, (sign,), sign)
    damping = backwards(passive.damping, (sign,))
    return _renamed(passive, side, "passive_torques", torque=torque, damping=damping)


def _wrap(wrap: WrapObject, side: OtherSide) -> WrapObject:
    barred = "xyz".find(wrap.quadrant[-1:] or " ")
    inner = (
        FREE_AXIS[wrap.kind] if FREE_AXIS[wrap.kind] != barred else (FREE_AXIS[wrap.kind] + 2) % 3
    )
    quadrant = wrap.quadrant
    if wrap.kind == "cylinder" and barred == FREE_AXIS["cylinder"]:
        # Only along its own axis does a cylinder's rule not tell one way round from the other.
        inner = barred
        quadrant = ("+" if quadrant.startswith("-") else "-") + quadrant[-1]
    return _renamed(
        wrap,
        side,
        "wraps",
        pose=side.planes[wrap.body].pose(wrap.pose, flip(inner)),
        quadrant=quadrant,
    )


def _muscle(muscle: Muscle, side: OtherSide) -> Muscle:
    path = muscle.path
    wraps: Any = tuple(
        (
            _renamed(wrap, side, side=side.planes[wrap.side_body].points(wrap.side))
            if isinstance(wrap, TendonWrap) and wrap.side is not None
            else _renamed(wrap, side)
        )
        for wrap in path.wraps
    )
    points = tuple(_point(point, side) for point in path.points)
    groups = tuple(other_side(group) or group for group in muscle.groups)
    return _renamed(
        muscle, side, "muscles", path=replace(path, points=points, wraps=wraps), groups=groups
    )


def _point(point: PathPoint | MovingPathPoint, side: OtherSide) -> Any:
    plane = side.planes[point.body]
    renamed: Any = _renamed(point, side, name=other_side(point.name) or point.name)
    if isinstance(point, PathPoint):
        bounds = (
            _turned(point.range) if side.signs.get(point.coordinate, 1.0) < 0.0 else point.range
        )
        return replace(renamed, location=plane.points(point.location), range=bounds)
    if np.abs(plane.normal).max() < 1.0:
        raise BadModel(
            f"moving point '{point.name}' on body '{point.body}': the plane of symmetry is oblique"
            " in it"
        )
    index = plane.axis
    functions = [
        backwards(function, side.of((name,)) if name else (1.0,), -1.0 if i == index else 1.0)
        for i, (function, name) in enumerate(zip(point.functions, point.coordinates, strict=True))
    ]
    functions[index] = functions[index].raised(2.0 * plane.offset * float(plane.normal[index]))
    return replace(renamed, functions=tuple(functions))


def _actuator(actuator: Actuator, side: OtherSide) -> Actuator:
    ground = side.planes[GROUND]
    plane = side.planes.get(actuator.body, ground)
    other = side.planes.get(actuator.other_body, ground)
    along = ground if actuator.direction_is_global else plane
    turned = side.signs.get(actuator.coordinate, 1.0) < 0.0
    return _renamed(
        actuator,
        side,
        "actuators",
        point=(ground if actuator.point_is_global else plane).points(actuator.point),
        other_point=(ground if actuator.point_is_global else other).points(actuator.other_point),
        direction=(
            along.turns(actuator.direction)
            if actuator.kind == "torque"
            else along.vectors(actuator.direction)
        ),
        min_control=-actuator.max_control if turned else actuator.min_control,
        max_control=-actuator.min_control if turned else actuator.max_control,
    )


def _tied(tie: Tie, side: OtherSide) -> Tie:
    # Both frames are reflected alike, and across an axis, so that stiffness along axes stays as it
    # is.
    inner = flip(side.planes[tie.body_1].axis)
    return _renamed(
        tie,
        side,
        "ties",
        pose_1=side.planes[tie.body_1].pose(tie.pose_1, inner),
        pose_2=side.planes[tie.body_2].pose(tie.pose_2, inner),
    )
