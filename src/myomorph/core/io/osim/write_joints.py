"""Joints and coordinates as OpenSim 4 writes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from lxml import etree

from myomorph.core.io.osim.document import child, legal, number, numbers, put
from myomorph.core.io.osim.frames import body_path, is_still, write_offset_frame
from myomorph.core.io.osim.functions import write_function
from myomorph.core.io.osim.joints import (
    CURVED,
    MIN_SINE,
    QUARTER_TURN,
    SIMPLE,
    SPATIAL,
    is_unit_line,
    reversed_joint,
)
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import MODEL
from myomorph.core.model.functions import PiecewisePolynomial, SineProduct
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.spatial import Transform

STILL = PiecewisePolynomial(np.zeros(1), np.zeros((1, 1)))
"""Function of an axis that does not move."""


@dataclass
class Plan:
    """The joints to write, and the massless bodies that they need between.

    Attributes
    ----------
    joints : of OpenSim's classes, in tree order
    bodies : links of chains, without mass
    """

    joints: list[Joint] = field(default_factory=list)
    bodies: list[Body] = field(default_factory=list)


def plan_joints(model: Model, warnings: list[Message]) -> Plan:
    """Express the model's joints as joints of OpenSim's classes.

    A joint of another kind (MuJoCo's, with anchors and several axes) becomes a chain of custom
    joints.

    Parameters
    ----------
    model : its joints are read
    warnings : gets a line for what changes

    Returns
    -------
    joints in tree order, and the massless bodies of chains
    """
    plan = Plan()
    for joint in model.joints:
        kind = _own_class(joint)
        if kind is not None:
            plan.joints.append(replace(joint, kind=kind))
            continue
        back = reversed_joint(joint)
        kind = _own_class(back)
        if kind is not None:
            plan.joints.append(replace(back, kind=kind))
        else:
            _chain(joint, plan, warnings)
    return plan


def _own_class(joint: Joint) -> str | None:
    """Return the OpenSim class that can hold the joint's axes, or None."""
    if joint.kind in CURVED and curved_settings(joint) is not None:
        return joint.kind
    if joint.kind in SIMPLE and _is_simple(joint, joint.kind):
        return joint.kind
    if not joint.axes:
        return "WeldJoint"
    if joint.coordinates and _custom_axes(joint.axes) is not None:
        return "CustomJoint"
    return None


def _is_simple(joint: Joint, kind: str) -> bool:
    """Return whether a joint has exactly the axes and coordinates of a class."""
    wanted = SIMPLE[kind]
    if len(joint.axes) != len(wanted) or len(joint.coordinates) != len(wanted):
        return False
    return all(
        axis.kind == what
        and np.array_equal(axis.vector, vector)
        and not axis.origin.any()
        and axis.coordinates == (joint.coordinates[i],)
        and is_identity(axis)
        for axis, (what, vector, i) in zip(joint.axes, wanted, strict=True)
    )


def is_identity(axis: Axis) -> bool:
    """Return whether the amount of motion is the coordinate itself.

    Parameters
    ----------
    axis : of a joint
    """
    function = axis.function
    if isinstance(function, SineProduct) or function.coefficients.shape != (1, 2):
        return False
    return bool(function.breaks[0] == 0 and np.array_equal(function.coefficients[0], (0.0, 1.0)))


def _custom_axes(axes: tuple[Axis, ...]) -> list[Axis] | None:
    """Arrange axes as three rotations, then three translations of a custom joint.

    Parameters
    ----------
    axes : in the order in which they move, translations first

    Returns
    -------
    six axes, those added standing still; None where these do not fit
    """
    count = sum(axis.kind == "translation" for axis in axes)
    translations = axes[:count]
    rotations = axes[count:]
    if any(axis.kind != "translation" for axis in translations):
        return None
    if len(translations) > 3 or len(rotations) > 3:
        return None
    if any(axis.origin.any() for axis in rotations) or any(_is_of_two(axis) for axis in axes):
        return None
    all_rotations = _filled(rotations, "rotation")
    all_translations = _filled(translations, "translation")
    if all_rotations is None or all_translations is None:
        return None
    return all_rotations + all_translations


def _is_of_two(axis: Axis) -> bool:
    """Return whether an axis moves by two coordinates, which OpenSim's functions do not."""
    return axis.function.arity > 1


def _filled(axes: Sequence[Axis], kind: Literal["rotation", "translation"]) -> list[Axis] | None:
    """Fill up to three axes that are not parallel, those added standing still.

    Parameters
    ----------
    axes : up to three
    kind : of those added

    Returns
    -------
    three axes; None where two of them are parallel
    """
    filled = list(axes)
    while len(filled) < 3:
        filled.append(Axis(kind, _free_direction(filled), STILL))
    vectors = [axis.vector for axis in filled]
    sines = [np.linalg.norm(np.cross(vectors[i], vectors[(i + 1) % 3])) for i in range(3)]
    return None if min(sines) < MIN_SINE else filled


def _free_direction(axes: Sequence[Axis]) -> Array:
    """Find the first of x, y and z (3,) that is far from parallel to all axes."""
    return next(
        direction
        for direction in np.eye(3)
        if all(np.linalg.norm(np.cross(direction, axis.vector)) > 0.5 for axis in axes)
    )


def _chain(joint: Joint, plan: Plan, warnings: list[Message]) -> None:
    """Write a joint as custom joints one after another, through massless bodies.

    Each joint rotates about one anchor.

    Parameters
    ----------
    joint : to write
    plan : gets the joints and bodies
    warnings : gets a line for what changes
    """
    groups = _groups(joint.axes)
    if any(_is_of_two(axis) for axis in joint.axes):
        warnings.append(
            MODEL.message(
                f"joint '{joint.name}': an axis of two coordinates cannot be written, and does not"
                " move",
                severity="may change results",
            )
        )
    last = len(groups) - 1
    parent = joint.parent
    frame = joint.parent_frame
    for index, axes in enumerate(groups):
        link = _Link(name=joint.name, child=joint.child, child_frame=joint.child_frame)
        if index < last:
            link = _Link(
                name=f"{joint.name}_{index}",
                child=f"{joint.child}_link_{index}",
                child_frame=Transform.identity(),
            )
            plan.bodies.append(_massless_body(link.child))
        anchor = Transform(np.eye(3), _anchor(axes))
        coordinates = _coordinates_of(axes, joint)
        plan.joints.append(
            Joint(
                name=link.name,
                kind="CustomJoint" if coordinates else "WeldJoint",
                parent=parent,
                child=link.child,
                parent_frame=frame @ anchor,
                child_frame=link.child_frame @ anchor,
                axes=tuple(_through_origin(axis) for axis in axes),
                coordinates=coordinates,
            )
        )
        parent = link.child
        frame = Transform.identity()
    if len(groups) > 1:
        warnings.append(
            MODEL.message(
                f"joint '{joint.name}': written as {len(groups)} joints with massless bodies"
                " between"
            )
        )


@dataclass(frozen=True, kw_only=True)
class _Link:
    """A joint of a chain, without its axes.

    Attributes
    ----------
    name : of the joint
    child : body that it leads to
    child_frame : of the joint, in that body
    """

    name: str
    child: str
    child_frame: Transform


def _massless_body(name: str) -> Body:
    """Make a body without mass and inertia.

    Parameters
    ----------
    name : of the body
    """
    return Body(name=name, mass=0.0, mass_center=np.zeros(3), inertia=np.zeros((3, 3)))


def _anchor(axes: Sequence[Axis]) -> Array:
    """Return the point (3,) [m] through which the rotations of a group go, 0 without."""
    for axis in axes:
        if axis.kind == "rotation":
            return axis.origin
    return np.zeros(3)


def _coordinates_of(axes: Sequence[Axis], joint: Joint) -> tuple[str, ...]:
    """List the joint's coordinates that move these axes, each once."""
    names = [name for axis in axes for name in axis.coordinates if name in joint.coordinates]
    return tuple(dict.fromkeys(names))


def _through_origin(axis: Axis) -> Axis:
    """Return an axis through the origin of its joint's frame."""
    return replace(axis, origin=np.zeros(3))


def _groups(axes: tuple[Axis, ...]) -> list[tuple[Axis, ...]]:
    """Group consecutive axes that fit one custom joint about one anchor."""
    groups: list[tuple[Axis, ...]] = []
    for axis in axes:
        if _is_of_two(axis):
            axis = replace(axis, function=STILL, coordinates=())
        longer = (*groups[-1], axis) if groups else (axis,)
        anchors = {tuple(member.origin) for member in longer if member.kind == "rotation"}
        at_origin = tuple(_through_origin(member) for member in longer)
        if groups and len(anchors) <= 1 and _custom_axes(at_origin) is not None:
            groups[-1] = longer
        else:
            groups.append((axis,))
    return groups


def curved_settings(joint: Joint) -> dict[str, str] | None:
    """Return the properties of a joint that rides on an ellipsoid.

    Parameters
    ----------
    joint : of a class in `CURVED`

    Returns
    -------
    texts of the radii [m] and of the winging axis by property; None where the joint's axes are
    others
    """
    axes = joint.axes
    scapular = joint.kind == "ScapulothoracicJoint"
    if len(axes) != (7 if scapular else 6) or len(joint.coordinates) != CURVED[joint.kind]:
        return None
    frame = QUARTER_TURN if scapular else np.eye(3)
    if not all(np.array_equal(axis.vector, frame[:, i % 3]) for i, axis in enumerate(axes[:6])):
        return None
    radii = []
    for axis in axes[:3]:
        if not isinstance(axis.function, SineProduct):
            return None
        radii.append(abs(axis.function.factor))
    if not scapular:
        return {"radii_x_y_z": numbers(radii)}
    wing = axes[6]
    angle = float(np.arctan2(-wing.vector[0], wing.vector[1]))
    return {
        "thoracic_ellipsoid_radii_x_y_z": numbers([radii[1], radii[0], radii[2]]),
        "scapula_winging_axis_origin": numbers(wing.origin[:2]),
        "scapula_winging_axis_direction": number(angle),
    }


def write_joint(
    parent: etree._Element,
    joint: Joint,
    coordinates: dict[str, Coordinate],
    warnings: list[Message],
) -> None:
    """Write a joint with its frames, coordinates and axes.

    Parameters
    ----------
    parent : element that gets it
    joint : of a class of OpenSim
    coordinates : by name
    warnings : gets a line for what cannot be written as it is
    """
    element = child(parent, joint.kind, name=joint.name)
    frames = etree.Element("frames")
    for end, body, pose, frame_name in (
        ("parent", joint.parent, joint.parent_frame, joint.parent_frame_name),
        ("child", joint.child, joint.child_frame, joint.child_frame_name),
    ):
        if not frame_name and is_still(pose):
            child(element, f"socket_{end}_frame", body_path(body))
            continue
        name = frame_name if frame_name and frame_name not in (body, GROUND) else f"{body}_offset"
        if len(frames) and legal(name) == frames[0].get("name"):
            name = f"{name}_child"
        child(element, f"socket_{end}_frame", legal(name))
        write_offset_frame(frames, name, body_path(body), pose)
    owned = child(element, "coordinates")
    for name in joint.coordinates:
        _write_coordinate(owned, coordinates[name], warnings)
    if len(frames):
        element.append(frames)
    if joint.kind == "CustomJoint":
        _write_spatial(element, joint, coordinates, warnings)
    elif joint.kind in CURVED:
        for tag, text in (curved_settings(joint) or {}).items():
            child(element, tag, text)


def _write_coordinate(
    parent: etree._Element, coordinate: Coordinate, warnings: list[Message]
) -> None:
    """Write a coordinate; a default out of its range costs its clamp, with a warning."""
    element = child(parent, "Coordinate", name=coordinate.name)
    put(element, default_value=coordinate.default, default_speed_value=coordinate.default_speed)
    put(element, range=coordinate.range)
    low, high = coordinate.range
    outside = coordinate.clamped and not low - 1e-8 < coordinate.default < high + 1e-8
    if outside:
        warnings.append(
            MODEL.message(
                f"coordinate '{coordinate.name}' is written without its clamp: its default is not"
                " in its range"
            )
        )
    put(element, clamped=coordinate.clamped and not outside, locked=coordinate.locked)
    if coordinate.prescribed is not None:
        holder = child(element, "prescribed_function")
        write_function(holder, coordinate.prescribed, f"coordinate '{coordinate.name}'", warnings)
        put(element, prescribed=True)


def _write_spatial(
    parent: etree._Element,
    joint: Joint,
    coordinates: dict[str, Coordinate],
    warnings: list[Message],
) -> None:
    """Write the axes of a custom joint.

    Coordinates that move none are named at axes that stand still.
    """
    spatial = child(parent, "SpatialTransform")
    used = {name for axis in joint.axes for name in axis.coordinates}
    idle = [name for name in joint.coordinates if name not in used]
    for name, axis in zip(SPATIAL, _custom_axes(joint.axes) or (), strict=True):
        names = axis.coordinates
        if not names and idle:
            names = (idle.pop(0),)
        element = child(spatial, "TransformAxis", name=name)
        put(
            element,
            coordinates=" ".join(legal(coordinate) for coordinate in names),
            axis=axis.vector,
        )
        holder = child(element, "function")
        if is_unit_line(axis.function) and coordinates[names[0]].motion == "coupled":
            # OpenSim takes a bare line of slope 1 for a pure rotation or translation, and this one
            # is not.
            multiplier = child(holder, "MultiplierFunction")
            holder = child(multiplier, "function")
            child(multiplier, "scale", "1")
        write_function(holder, axis.function, f"joint '{joint.name}' {name}", warnings)
