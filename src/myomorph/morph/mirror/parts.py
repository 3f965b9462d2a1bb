"""Every part of a model on the other side, under its other name."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from myomorph.model.errors import BadModel
from myomorph.model.model import GROUND, Actuator, Axis, Body, Coordinate, Coupler, Joint, Loop, Mesh, Model
from myomorph.model.paths import (
    Bushing,
    MovingPathPoint,
    Muscle,
    PassiveTorque,
    Path,
    PathPoint,
    PathWrap,
    TendonWrap,
    WrapObject,
)
from myomorph.model.scale import slides_freely
from myomorph.model.sides import other_side
from myomorph.model.spatial import Transform
from myomorph.morph.mirror.sides import SNAP, OtherSide, Reflection, backwards, flip, raised

Tie = TypeVar("Tie", Loop, Bushing)
FREE_AXIS = {"cylinder": 2, "torus": 1, "sphere": 2, "ellipsoid": 2}
"""The axis of a wrap object's own frame that is turned round: not one that its rules tell left from right by."""
HINGE_AXIS = 2
"""OpenSim's hinges turn about z of their frames, and go on doing so."""


def mirrored_parts(model: Model, side: OtherSide) -> Model:
    """Everything on the other side under its other name, in the given order."""
    rename = side.named
    return replace(
        model,
        bodies=tuple(_body(one, side) for one in model.bodies),
        joints=tuple(_joint(one, side) for one in model.joints),
        coordinates=tuple(_coordinate(one, side) for one in model.coordinates),
        gravity=side.planes[GROUND].vectors(model.gravity),
        markers=tuple(
            replace(
                one,
                name=rename("markers", one.name),
                body=rename("bodies", one.body),
                location=side.planes[one.body].points(one.location),
            )
            for one in model.markers
        ),
        muscles=tuple(_muscle(one, side) for one in model.muscles),
        wrap_objects=tuple(_wrap(one, side) for one in model.wrap_objects),
        actuators=tuple(_actuator(one, side) for one in model.actuators),
        couplers=tuple(_coupler(one, side) for one in model.couplers),
        loops=tuple(_tied(one, side) for one in model.loops),
        frames=tuple(
            replace(
                one,
                name=rename("frames", one.name),
                body=rename("bodies", one.body),
                pose=_pose(one.pose, side.planes[one.body]),
            )
            for one in model.frames
        ),
        ground_meshes=tuple(_mesh(one, side.planes[GROUND]) for one in model.ground_meshes),
        passive_torques=tuple(_passive(one, side) for one in model.passive_torques),
        bushings=tuple(_tied(one, side) for one in model.bushings),
    )


def _pose(pose: Transform, plane: Reflection) -> Transform:
    return plane.pose(pose, flip(plane.axis))


def _body(body: Body, side: OtherSide) -> Body:
    plane = side.planes[body.name]
    return replace(
        body,
        name=side.named("bodies", body.name),
        mass_center=plane.points(body.mass_center),
        inertia=plane.matrix @ body.inertia @ plane.matrix,
        meshes=tuple(_mesh(one, plane) for one in body.meshes),
    )


def _mesh(mesh: Mesh, plane: Reflection) -> Mesh:
    """The same file, drawn with one factor of the other sign."""
    scale = np.array(mesh.scale, dtype=np.float64)
    if mesh.shape == "mesh":
        scale[plane.axis] *= -1.0
    return replace(mesh, pose=_pose(mesh.pose, plane), scale=scale)


def _joint(joint: Joint, side: OtherSide) -> Joint:
    parent, child = side.planes[joint.parent], side.planes[joint.child]
    if joint.child in side.middle:
        inner = Reflection(parent.seen_from(joint.parent_frame).normal)
    else:
        inner = flip(HINGE_AXIS if joint.kind == "PinJoint" else child.axis)
    return replace(
        joint,
        name=side.named("joints", joint.name),
        parent=side.named("bodies", joint.parent),
        child=side.named("bodies", joint.child),
        parent_frame=parent.pose(joint.parent_frame, inner),
        child_frame=child.pose(joint.child_frame, inner),
        axes=tuple(_axis(axis, inner, side) for axis in joint.axes),
        coordinates=tuple(side.named("coordinates", one) for one in joint.coordinates),
        parent_frame_name=_frame_name(joint.parent_frame_name, side),
        child_frame_name=_frame_name(joint.child_frame_name, side),
    )


def _frame_name(name: str, side: OtherSide) -> str:
    return side.named("frames", name) if name and name != GROUND else name


def _axis(axis: Axis, inner: Reflection, side: OtherSide) -> Axis:
    signs = side.of(axis.coordinates)
    image = inner.turns(axis.vector) if axis.kind == "rotation" else inner.vectors(axis.vector)
    turned = bool(np.abs(image + axis.vector).max() < SNAP)
    # A sliding coordinate, and an angle of a side, keep their sign by an axis that turns round, as OpenSim's do.
    follows = not axis.coordinates or any(sign < 0.0 for sign in signs)
    slides = axis.kind == "translation" and not slides_freely(axis.function)
    keeps = turned and (follows or slides)
    return replace(
        axis,
        vector=axis.vector if keeps else image + 0.0,
        function=backwards(axis.function, signs, -1.0 if keeps else 1.0),
        coordinates=tuple(side.named("coordinates", one) for one in axis.coordinates),
        origin=inner.vectors(axis.origin) + 0.0,
    )


def _coordinate(coordinate: Coordinate, side: OtherSide) -> Coordinate:
    sign = side.signs[coordinate.name]
    renamed = replace(coordinate, name=side.named("coordinates", coordinate.name))
    if sign > 0.0:
        return renamed
    return replace(
        renamed,
        default=-coordinate.default + 0.0,
        default_speed=-coordinate.default_speed + 0.0,
        range=_turned(coordinate.range),
        prescribed=None if coordinate.prescribed is None else coordinate.prescribed.scaled(-1.0),
    )


def _turned(bounds: tuple[float, float]) -> tuple[float, float]:
    return -bounds[1], -bounds[0]


def _coupler(coupler: Coupler, side: OtherSide) -> Coupler:
    own = side.signs.get(coupler.dependent, 1.0)
    return replace(
        coupler,
        name=side.named("couplers", coupler.name),
        dependent=side.named("coordinates", coupler.dependent),
        function=backwards(coupler.function, side.of(coupler.independents), own),
        independents=tuple(side.named("coordinates", one) for one in coupler.independents),
    )


def _passive(passive: PassiveTorque, side: OtherSide) -> PassiveTorque:
    sign = side.signs.get(passive.coordinate, 1.0)
    return replace(
        passive,
        name=side.named("passive_torques", passive.name),
        coordinate=side.named("coordinates", passive.coordinate),
        torque=backwards(passive.torque, (sign,), sign),
        damping=backwards(passive.damping, (sign,)),
    )


def _wrap(wrap: WrapObject, side: OtherSide) -> WrapObject:
    barred = "xyz".find(wrap.quadrant[-1:] or " ")
    inner = FREE_AXIS[wrap.kind] if FREE_AXIS[wrap.kind] != barred else (FREE_AXIS[wrap.kind] + 2) % 3
    quadrant = wrap.quadrant
    if wrap.kind == "cylinder" and barred == FREE_AXIS["cylinder"]:
        # Only along its own axis does a cylinder's rule not tell one way round from the other.
        inner = barred
        quadrant = ("+" if quadrant.startswith("-") else "-") + quadrant[-1]
    return replace(
        wrap,
        name=side.named("wraps", wrap.name),
        body=side.named("bodies", wrap.body),
        pose=side.planes[wrap.body].pose(wrap.pose, flip(inner)),
        quadrant=quadrant,
    )


def _muscle(muscle: Muscle, side: OtherSide) -> Muscle:
    path = muscle.path
    tendon = tuple(
        replace(
            one,
            wrap_object=side.named("wraps", one.wrap_object),
            side_body=side.named("bodies", one.side_body) if one.side_body else "",
            side=None if one.side is None else side.planes[one.side_body].points(one.side),
        )
        for one in path.wraps
        if isinstance(one, TendonWrap)
    )
    other = tuple(
        replace(one, wrap_object=side.named("wraps", one.wrap_object))
        for one in path.wraps
        if isinstance(one, PathWrap)
    )
    return replace(
        muscle,
        name=side.named("muscles", muscle.name),
        path=Path(tuple(_point(one, side) for one in path.points), tendon or other, path.divisors),
        groups=tuple(other_side(one) or one for one in muscle.groups),
    )


def _point(point: PathPoint | MovingPathPoint, side: OtherSide) -> PathPoint | MovingPathPoint:
    plane = side.planes[point.body]
    name, body = other_side(point.name) or point.name, side.named("bodies", point.body)
    if isinstance(point, PathPoint):
        coordinate = side.named("coordinates", point.coordinate) if point.coordinate else ""
        bounds = _turned(point.range) if side.signs.get(point.coordinate, 1.0) < 0.0 else point.range
        return replace(
            point, name=name, body=body, location=plane.points(point.location), coordinate=coordinate, range=bounds
        )
    if np.abs(plane.normal).max() < 1.0:
        raise BadModel(
            f"moving point '{point.name}' on body '{point.body}': the plane of symmetry is oblique in this body"
        )
    k = plane.axis
    functions = [
        backwards(function, side.of((name,)) if name else (1.0,), -1.0 if i == k else 1.0)
        for i, (function, name) in enumerate(zip(point.functions, point.coordinates, strict=True))
    ]
    functions[k] = raised(functions[k], 2.0 * plane.offset * float(plane.normal[k]))
    x, y, z = (side.named("coordinates", one) if one else "" for one in point.coordinates)
    return replace(
        point, name=name, body=body, functions=(functions[0], functions[1], functions[2]), coordinates=(x, y, z)
    )


def _actuator(actuator: Actuator, side: OtherSide) -> Actuator:
    ground = side.planes[GROUND]
    own, other = (side.planes.get(name, ground) for name in (actuator.body, actuator.other_body))
    along = ground if actuator.direction_is_global else own
    turned = side.signs.get(actuator.coordinate, 1.0) < 0.0
    return replace(
        actuator,
        name=side.named("actuators", actuator.name),
        coordinate=side.named("coordinates", actuator.coordinate) if actuator.coordinate else "",
        body=side.named("bodies", actuator.body) if actuator.body else "",
        other_body=side.named("bodies", actuator.other_body) if actuator.other_body else "",
        point=(ground if actuator.point_is_global else own).points(actuator.point),
        other_point=(ground if actuator.point_is_global else other).points(actuator.other_point),
        direction=along.turns(actuator.direction) if actuator.kind == "torque" else along.vectors(actuator.direction),
        min_control=-actuator.max_control if turned else actuator.min_control,
        max_control=-actuator.min_control if turned else actuator.max_control,
    )


def _tied(tie: Tie, side: OtherSide) -> Tie:
    # Both frames are reflected alike, and across an axis, so that stiffness along axes stays as it is.
    inner = flip(side.planes[tie.body_1].axis)
    return replace(
        tie,
        name=side.named("ties", tie.name),
        body_1=side.named("bodies", tie.body_1),
        body_2=side.named("bodies", tie.body_2),
        pose_1=side.planes[tie.body_1].pose(tie.pose_1, inner),
        pose_2=side.planes[tie.body_2].pose(tie.pose_2, inner),
    )
