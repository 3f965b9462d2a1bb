"""OpenSim's joints as axes, and the coordinates they own."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from myomorph.core.io.osim.document import Node
from myomorph.core.io.osim.frames import Frames
from myomorph.core.io.osim.functions import read_function
from myomorph.core.model.arrays import Array, frozen_array
from myomorph.core.model.errors import BadModel, check_name
from myomorph.core.model.functions import Function, SineProduct, constant, linear
from myomorph.core.model.model import GROUND, Axis, Coordinate, Joint
from myomorph.core.model.spatial import Transform

X, Y, Z = np.eye(3)
SIMPLE: dict[str, tuple[tuple[str, Array, int], ...]] = {
    "WeldJoint": (),
    "PinJoint": (("rotation", Z, 0),),
    "SliderJoint": (("translation", X, 0),),
    "UniversalJoint": (("rotation", X, 0), ("rotation", Y, 1)),
    "BallJoint": (("rotation", X, 0), ("rotation", Y, 1), ("rotation", Z, 2)),
    "GimbalJoint": (("rotation", X, 0), ("rotation", Y, 1), ("rotation", Z, 2)),
    "PlanarJoint": (("translation", X, 1), ("translation", Y, 2), ("rotation", Z, 0)),
    "FreeJoint": (
        ("translation", X, 3),
        ("translation", Y, 4),
        ("translation", Z, 5),
        ("rotation", X, 0),
        ("rotation", Y, 1),
        ("rotation", Z, 2),
    ),
}
CURVED = {"EllipsoidJoint": 3, "ScapulothoracicJoint": 4}
KINDS = (*SIMPLE, "CustomJoint", *CURVED)
QUARTER_TURN = frozen_array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""About z: how a scapulothoracic joint's ellipsoid lies in its frame."""
MIN_SINE = 1e-5  # Of the angle between two axes that are not parallel.
SPATIAL = ("rotation1", "rotation2", "rotation3", "translation1", "translation2", "translation3")

# Children of a transform axis that are no function; some old documents state the kind of the axis.
NOT_FUNCTIONS = ("coordinates", "axis", "function", "is_rotation")

Motion = Literal["rotational", "translational", "coupled"]
End = tuple[str, Transform, str]


@dataclass(frozen=True, eq=False)
class ReadJoint:
    """A joint as the file has it, before the tree is known.

    Attributes
    ----------
    joint : from its parent to its child
    coordinates : that it owns
    """

    joint: Joint
    coordinates: tuple[Coordinate, ...]


def read_joint(node: Node, frames: Frames, old_child: str = "") -> ReadJoint:
    """Read a joint with its axes and coordinates.

    Parameters
    ----------
    node : the joint
    frames : of the model
    old_child : before version 4.0, the body that the joint stands in

    Returns
    -------
    the joint from its parent to its child, as the file has them

    Raises
    ------
    BadFile : it lacks a frame, or its axes and coordinates do not fit each other
    BadModel : its class is not supported
    UnknownName : it names a frame or coordinate that does not exist
    """
    kind = node.kind
    if kind not in KINDS:
        raise BadModel(
            f"{node.document.path}: joint '{node.name}' is a {kind}: expected one of"
            f" {', '.join(KINDS)}"
        )
    items = node.items("coordinates") or node.items("CoordinateSet")
    coordinates = tuple(_coordinate(item) for item in items if item.kind == "Coordinate")
    if kind == "CustomJoint":
        axes, coordinates = _custom(node, coordinates)
    else:
        names = _named(node, coordinates, CURVED.get(kind, len(SIMPLE.get(kind, ()))))
        axes = _simple(kind, names) if kind in SIMPLE else _curved(node, names)
        coordinates = coordinates or tuple(Coordinate(name, range=(-10.0, 10.0)) for name in names)
        renamed = zip(coordinates, names, strict=True)
        coordinates = tuple(
            replace(coordinate, name=name, motion=_motion(axes, name))
            for coordinate, name in renamed
        )
    (parent, parent_frame, parent_name), (child, child_frame, child_name) = _ends(
        node, frames, old_child
    )
    name = node.name or kind.lower()
    coordinate_names = tuple(coordinate.name for coordinate in coordinates)
    joint = Joint(
        name=name,
        kind=kind,
        parent=parent,
        child=child,
        parent_frame=parent_frame,
        child_frame=child_frame,
        axes=axes,
        coordinates=coordinate_names,
        parent_frame_name=parent_name,
        child_frame_name=child_name,
    )
    return ReadJoint(joint, coordinates)


def _motion(axes: tuple[Axis, ...], coordinate: str) -> Motion:
    """Return whether a coordinate is rotational: whether it moves an axis of rotation."""
    turns = any(axis.kind == "rotation" and coordinate in axis.coordinates for axis in axes)
    return "rotational" if turns else "translational"


def _ends(node: Node, frames: Frames, old_child: str) -> tuple[End, End]:
    """Read the two ends of a joint.

    Parameters
    ----------
    node : the joint
    frames : of the model
    old_child : before version 4.0, the body that the joint stands in

    Returns
    -------
    of parent and of child: name of the body, pose of the joint's frame in it, and name of that
    frame, "" where it is the body's own

    Raises
    ------
    BadFile : an end names no frame
    UnknownName : a frame does not exist
    """
    ends = []
    old = {
        "parent": ("orientation_in_parent", "location_in_parent"),
        "child": ("orientation", "location"),
    }
    for end in ("parent", "child"):
        text = node.socket(f"{end}_frame", f"{end}_body")
        if not text and end == "child":
            text = old_child
        if not text:
            raise node.bad(f"has no {end} frame")
        body, pose = frames.place(text, node)
        name = plain_name(text)
        name = "" if name == body else name
        if node.document.version < 30505:
            tags = (tag if node.find(tag) is not None else f"{tag}_in_child" for tag in old[end])
            pose = pose @ node.pose(*tags)
            name = f"{name or body}_offset"
        ends.append((body, pose, name))
    parent, child = ends
    if node.document.version < 30514 and node.flag("reverse", False):
        parent, child = child, parent
    return parent, child


def _coordinate(node: Node) -> Coordinate:
    """Read a coordinate [rad or m], as rotational until the axes show another motion."""
    low, high = node.vector("range", (-10.0, 10.0), infinite=True)
    prescribed: Function | None = None
    function = node.inner("prescribed_function")
    if function is not None and node.flag("prescribed", False):
        prescribed = read_function(function, node)
    if prescribed is not None and node.flag("is_free_to_satisfy_constraints", False):
        node.document.warn(
            f"coordinate '{node.name}' is prescribed but free to meet constraints: read as"
            " prescribed"
        )
    default = node.number("default_value", 0.0)
    clamped = node.flag("clamped", False)
    if clamped and not low - 1e-8 < default < high + 1e-8:
        limits = f"{low:g} .. {high:g}"
        node.document.warn(
            f"coordinate '{node.name}' is clamped to {limits}, but its default is {default:g}"
        )
    return Coordinate(
        name=node.name,
        motion="rotational",
        default=default,
        range=(float(low), float(high)),
        clamped=clamped,
        locked=node.flag("locked", False),
        prescribed=prescribed,
        default_speed=node.number("default_speed_value", 0.0),
    )


def free_joint(child: str) -> ReadJoint:
    """Make the joint that OpenSim adds where none leads to a body.

    Parameters
    ----------
    child : name of the body

    Returns
    -------
    a joint of six coordinates from the ground
    """
    name = f"free_{child}"
    names = [f"{name}_coord_{i}" for i in range(6)]
    axes = _simple("FreeJoint", names)
    still = Transform.identity()
    joint = Joint(
        name=name,
        kind="FreeJoint",
        parent=GROUND,
        child=child,
        parent_frame=still,
        child_frame=still,
        axes=axes,
        coordinates=tuple(names),
    )
    return ReadJoint(
        joint, tuple(Coordinate(name, _motion(axes, name), range=(-10.0, 10.0)) for name in names)
    )


def _named(node: Node, coordinates: tuple[Coordinate, ...], needed: int) -> list[str]:
    """Return the names of a joint's coordinates, made up where the file has none.

    Parameters
    ----------
    node : the joint
    coordinates : as the file has them
    needed : count that the joint's class has

    Raises
    ------
    BadFile : it has another count of coordinates
    """
    if coordinates and len(coordinates) != needed:
        raise node.bad(f"has {len(coordinates)} coordinates", f"a {node.kind} has {needed}")
    names = [coordinate.name for coordinate in coordinates] or [""] * needed
    return [name or f"{node.name}_coord_{i}" for i, name in enumerate(names)]


def _simple(kind: str, names: list[str]) -> tuple[Axis, ...]:
    """Make the axes of a joint of a class that has them fixed, by the names of its coordinates."""
    return tuple(
        Axis(
            kind="rotation" if what == "rotation" else "translation",
            vector=vector,
            function=linear(1.0),
            coordinates=(names[i],),
        )
        for what, vector, i in SIMPLE[kind]
    )


def _custom(
    node: Node, coordinates: tuple[Coordinate, ...]
) -> tuple[tuple[Axis, ...], tuple[Coordinate, ...]]:
    """Read the axes of a custom joint, and order its coordinates as the axes name them.

    Parameters
    ----------
    node : the joint
    coordinates : as the file has them

    Returns
    -------
    three translations, then three rotations; and the coordinates with their kinds of motion

    Raises
    ------
    BadFile : axes are parallel, lack a function or a coordinate, or do not use a coordinate
    UnknownName : an axis names a coordinate that the joint does not have
    """
    axes, motions = _spatial_axes(node)
    rotations = axes[:3]
    translations = axes[3:]
    _check_not_parallel(node, rotations)
    _check_not_parallel(node, translations)
    known = [coordinate.name for coordinate in coordinates]
    for name in motions:
        check_name("coordinate", name, known, f"{node.document.path}: joint '{node.name}'")
    unused = [name for name in known if name not in motions]
    if unused:
        raise node.bad(f"no axis uses its coordinates {', '.join(unused)}")
    ordered = tuple(
        replace(coordinates[known.index(name)], motion=motion) for name, motion in motions.items()
    )
    return (*translations, *rotations), ordered


def _spatial_axes(node: Node) -> tuple[list[Axis], dict[str, Motion]]:
    """Read the six axes of a custom joint, and how each coordinate that they name moves it.

    Returns
    -------
    three rotations, then three translations; and motions by coordinate, in the order in which the
    axes name them

    Raises
    ------
    BadFile : the joint has no axes, or one lacks a function or a coordinate
    """
    spatial = node.child("SpatialTransform")
    if spatial is None:
        raise node.bad("has no SpatialTransform")
    transforms = {
        element.get("name", ""): spatial.node(element)
        for element in spatial.element.findall("TransformAxis")
    }
    axes: list[Axis] = []
    motions: dict[str, Motion] = {}
    for name, usual in zip(SPATIAL, (X, Y, Z, X, Y, Z), strict=True):
        transform = transforms.get(name)
        if transform is None:
            axes.append(Axis(_kind(name), usual, constant(0.0)))
            continue
        names = transform.words("coordinates")
        axis, pure = _transform_axis(node, transform, name, usual, names)
        axes.append(axis)
        for coordinate in names:
            if pure:
                motions[coordinate] = "rotational" if axis.kind == "rotation" else "translational"
            motions.setdefault(coordinate, "coupled")
    return axes, motions


def _check_not_parallel(node: Node, axes: Sequence[Axis]) -> None:
    """Check that no two of three axes of a joint are parallel; `BadFile` where they are."""
    vectors = [axis.vector for axis in axes]
    sines = [np.linalg.norm(np.cross(vectors[i], vectors[(i + 1) % 3])) for i in range(3)]
    if min(sines) < MIN_SINE:
        raise node.bad(f"two of its {axes[0].kind} axes are parallel")


def _kind(name: str) -> Literal["rotation", "translation"]:
    """Return whether a spatial axis is a rotation or a translation, by its name."""
    return "rotation" if name.startswith("rotation") else "translation"


def _transform_axis(
    joint: Node, axis: Node, name: str, usual: Array, names: list[str]
) -> tuple[Axis, bool]:
    """Read one axis of a custom joint.

    Parameters
    ----------
    joint : the joint, for messages
    axis : node of the axis
    name : as "rotation1"
    usual : (3,) direction where the file has none
    names : coordinates that it names

    Returns
    -------
    the axis with a direction of length 1; and whether a coordinate is its very amount (slope 1 or
    -1), as OpenSim sees it

    Raises
    ------
    BadFile : it has no direction, or a function but no coordinate
    """
    vector = axis.vector("axis", tuple(usual))
    length = float(np.linalg.norm(vector))
    if length == 0:
        raise joint.bad(f"its axis {name} has no direction")
    inner = axis.inner("function")
    if inner is None:
        bare = [
            axis.node(element) for element in axis.element if str(element.tag) not in NOT_FUNCTIONS
        ]
        inner = bare[0] if bare else None
    if inner is not None:
        function = read_function(inner, joint)
    else:
        function = constant(0.0)
        if names:
            joint.document.warn(
                f"joint '{joint.name}': axis {name} has a coordinate but no function: it does not"
                " move"
            )
    if function.arity > len(names):
        kind = inner.kind if inner else "function"
        raise joint.bad(f"its axis {name} has a {kind} but no coordinate")
    pure = inner is not None and inner.kind == "LinearFunction" and is_unit_line(function)
    return (
        Axis(
            kind=_kind(name),
            vector=vector / length,
            function=function,
            coordinates=tuple(names[: function.arity]),
        ),
        pure,
    )


def _curved(node: Node, names: list[str]) -> tuple[Axis, ...]:
    """Make the axes of a joint that rides on an ellipsoid.

    Ellipsoid mobilizer: body-fixed X, Y, Z rotations; the origin rides where the z axis is the
    normal. A scapulothoracic joint rotates that ellipsoid by 90 degrees about z and adds winging
    about an axis in the plane that touches it.

    Parameters
    ----------
    node : the joint, with its radii [m]
    names : of its coordinates

    Raises
    ------
    BadFile : a radius is missing or not above 0
    """
    winged = node.kind == "ScapulothoracicJoint"
    quarter = QUARTER_TURN if winged else np.eye(3)
    radii = node.vector(
        "thoracic_ellipsoid_radii_x_y_z" if winged else "radii_x_y_z", (np.nan,) * 3
    )
    radii = radii[[1, 0, 2]] if winged else radii
    if not np.all(radii > 0):
        raise node.bad(f"has ellipsoid radii {radii}", "expected three positive numbers")
    a, b, c = names[:3]
    half = np.pi / 2
    slides = (
        (SineProduct(radii[0], np.ones(1), np.zeros(1)), (b,)),
        (SineProduct(-radii[1], np.ones(2), np.array([0.0, half])), (a, b)),
        (SineProduct(radii[2], np.ones(2), np.array([half, half])), (a, b)),
    )
    axes = [
        Axis(kind="translation", vector=quarter[:, i], function=function, coordinates=over)
        for i, (function, over) in enumerate(slides)
    ]
    axes += [
        Axis(kind="rotation", vector=quarter[:, i], function=linear(1.0), coordinates=(name,))
        for i, name in enumerate((a, b, c))
    ]
    if winged:
        angle = node.number("scapula_winging_axis_direction", 0.0)
        origin = np.array([*node.vector("scapula_winging_axis_origin", (0.0, 0.0)), 0.0])
        winging = np.array([-np.sin(angle), np.cos(angle), 0.0])
        axes.append(
            Axis(
                kind="rotation",
                vector=winging,
                function=linear(1.0),
                coordinates=(names[3],),
                origin=origin,
            )
        )
    return tuple(axes)


def is_unit_line(function: Function) -> bool:
    """Return whether a function is a line of slope 1 or -1.

    Parameters
    ----------
    function : of any kind
    """
    if isinstance(function, SineProduct) or function.coefficients.shape != (1, 2):
        return False
    return abs(float(function.coefficients[0, 1])) == 1.0


def reversed_joint(joint: Joint) -> Joint:
    """Reverse a joint, as seen from its child: the axes undone in the opposite order.

    Parameters
    ----------
    joint : from a parent to a child

    Returns
    -------
    the joint from that child to that parent, of the same coordinates
    """
    axes = tuple(
        replace(axis, function=axis.function.scaled(-1.0)) for axis in reversed(joint.axes)
    )
    return replace(
        joint,
        parent=joint.child,
        child=joint.parent,
        parent_frame=joint.child_frame,
        child_frame=joint.parent_frame,
        axes=axes,
        parent_frame_name=joint.child_frame_name,
        child_frame_name=joint.parent_frame_name,
    )


def plain_name(text: str) -> str:
    """Return the last part of a component path, without blanks.

    Parameters
    ----------
    text : path or name
    """
    return re.sub(r"\s+", "", text.rsplit("/", 1)[-1])
