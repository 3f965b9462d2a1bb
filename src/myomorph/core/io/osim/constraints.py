"""OpenSim's couplers, loops, bushings, and springs and limits of coordinates, read and written."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from lxml import etree

from myomorph.core.io.osim.document import Node, child, legal, put
from myomorph.core.io.osim.frames import Frames, body_path, write_offset_frame
from myomorph.core.io.osim.functions import read_function, write_function
from myomorph.core.io.osim.joints import plain_name
from myomorph.core.io.osim.kept import keep
from myomorph.core.model.causes import MODEL
from myomorph.core.model.errors import UnknownName, check_name
from myomorph.core.model.functions import PiecewisePolynomial, constant, linear, substituted
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Coordinate, Coupler, Kept, Loop
from myomorph.core.model.paths import Bushing, PassiveTorque
from myomorph.core.model.spatial import Transform

BUSHING = "BushingForce"
BUSHING_PARTS = (
    "rotational_stiffness",
    "rotational_damping",
    "translational_stiffness",
    "translational_damping",
)
KINDS = ("CoordinateLimitForce", "SpringGeneralizedForce")


def read_constraints(
    model: Node, frames: Frames, coordinates: tuple[str, ...]
) -> tuple[tuple[Coupler, ...], tuple[Loop, ...], tuple[Kept, ...]]:
    """Read couplers and loops; other constraints, and those not enforced, are only stored.

    Parameters
    ----------
    model : its node
    frames : of the model
    coordinates : names of its coordinates

    Returns
    -------
    couplers, loops and stored parts, in the file's order

    Raises
    ------
    BadFile, BadModel : a coupler has no function, or one that is not supported
    UnknownName : a constraint names a coordinate or a frame that does not exist
    """
    couplers = []
    loops = []
    kept = []
    for node in model.items("ConstraintSet"):
        if not node.flag("isEnforced", not node.flag("isDisabled", False)):
            kept.append(keep(node, "ConstraintSet", "switched off in the file"))
        elif node.kind == "CoordinateCouplerConstraint":
            couplers.append(_coupler(node, coordinates))
        elif node.kind in ("PointConstraint", "WeldConstraint"):
            loops.append(_loop(node, frames))
        else:
            kept.append(keep(node, "ConstraintSet", "the motion it forbids is allowed"))
    return tuple(couplers), tuple(loops), tuple(kept)


def _coupler(node: Node, coordinates: tuple[str, ...]) -> Coupler:
    """Read a coupler of coordinates [rad or m], its function multiplied by its scale factor."""
    function = node.inner("coupled_coordinates_function")
    if function is None:
        raise node.bad("has no coupled_coordinates_function")
    names = node.words("independent_coordinate_names")
    dependent = node.text("", "dependent_coordinate_name")
    for name in (*names, dependent):
        if name not in coordinates:
            raise UnknownName(
                "coordinate",
                name,
                existing=coordinates,
                where=f"{node.document.path}: coupler '{node.name}': the model",
            )
    factor = node.number("scale_factor", 1.0)
    return Coupler(
        name=node.name,
        dependent=dependent,
        function=read_function(function, node).scaled(factor),
        independents=tuple(names),
    )


def _loop(node: Node, frames: Frames) -> Loop:
    """Read a point or weld constraint as two frames on bodies."""
    if node.kind == "PointConstraint":
        ends = []
        for i in "12":
            body, _ = frames.place(node.socket(f"body_{i}"), node)
            ends.append((body, Transform(np.eye(3), node.vector(f"location_body_{i}"))))
    else:
        ends = [tied_frame(node, frames, i) for i in "12"]
    (body_1, pose_1), (body_2, pose_2) = ends
    return Loop(
        name=node.name, kind=node.kind, body_1=body_1, body_2=body_2, pose_1=pose_1, pose_2=pose_2
    )


def tied_frame(node: Node, frames: Frames, i: str) -> tuple[str, Transform]:
    """Read one of the two frames of an object that links two, in any version's layout.

    Parameters
    ----------
    node : the object
    frames : of the model
    i : "1" for the first frame, "2" for the second

    Returns
    -------
    name of the body, and the frame's pose in it

    Raises
    ------
    UnknownName : the frame does not exist
    """
    text = node.socket(f"frame{i}", f"body_{i}")
    body, pose = frames.place(text, node)
    return body, pose @ node.pose(f"orientation_body_{i}", f"location_body_{i}")


def read_passive_torques(
    model: Node, coordinates: Sequence[Coordinate]
) -> tuple[PassiveTorque, ...]:
    """Read the passive torques of a model's forces, those switched off left out.

    Parameters
    ----------
    model : its node
    coordinates : of the model

    Returns
    -------
    a torque for each spring, and two for each limit of a coordinate, over the coordinate [rad or m]

    Raises
    ------
    UnknownName : a force acts on a coordinate that does not exist
    """
    by_name = {coordinate.name: coordinate for coordinate in coordinates}
    passive_torques: list[PassiveTorque] = []
    for node in model.items("ForceSet"):
        if node.kind not in KINDS or not node.is_applied:
            continue
        name = plain_name(node.text("", "coordinate"))
        check_name("coordinate", name, by_name, f"{node.document.path}: {node.kind} '{node.name}'")
        if node.kind == "SpringGeneralizedForce":
            stiffness = node.number("stiffness", 0.0)
            rest = node.number("rest_length", 0.0)
            spring = linear(-stiffness, stiffness * rest)
            passive_torques.append(
                PassiveTorque(
                    name=node.name,
                    coordinate=name,
                    torque=spring,
                    damping=constant(node.number("viscosity", 0.0)),
                )
            )
        else:
            passive_torques += _limits(node, by_name[name])
    return tuple(passive_torques)


def read_bushings(model: Node, frames: Frames) -> tuple[Bushing, ...]:
    """Read the bushings of a model's forces, those switched off left out.

    Parameters
    ----------
    model : its node
    frames : of the model

    Returns
    -------
    frames on two bodies each, with stiffness [N m/rad, N/m] and damping [N m s/rad, N s/m] (3,)

    Raises
    ------
    UnknownName : a bushing is on a frame that does not exist
    """
    bushings = []
    for node in model.items("ForceSet"):
        if node.kind != BUSHING or not node.is_applied:
            continue
        (body_1, pose_1) = tied_frame(node, frames, "1")
        (body_2, pose_2) = tied_frame(node, frames, "2")
        bushings.append(
            Bushing(
                name=node.name,
                body_1=body_1,
                body_2=body_2,
                pose_1=pose_1,
                pose_2=pose_2,
                rotational_stiffness=node.vector("rotational_stiffness"),
                rotational_damping=node.vector("rotational_damping"),
                translational_stiffness=node.vector("translational_stiffness"),
                translational_damping=node.vector("translational_damping"),
            )
        )
    return tuple(bushings)


def _limits(node: Node, coordinate: Coordinate) -> list[PassiveTorque]:
    """Read the torques of both limits of a coordinate.

    They are 0 inside; beyond, a stiffness rises over the transition. Rotational limits are in
    degrees, their stiffness and damping per degree.

    Parameters
    ----------
    node : the `CoordinateLimitForce`
    coordinate : that it acts on

    Returns
    -------
    torque of the upper limit, then of the lower one, over radians or meters
    """
    unit = np.pi / 180.0 if coordinate.motion == "rotational" else 1.0
    width = node.number("transition", 0.1) * unit
    damping = node.number("damping", 0.001) / unit
    result = []
    for side, sign in (("upper", 1.0), ("lower", -1.0)):
        limit = sign * node.number(f"{side}_limit", 0.0) * unit
        stiffness = node.number(f"{side}_stiffness", 1.0) / unit
        # The smooth step 10 t^3 - 15 t^4 + 6 t^5 of t = h / width, h the way past the limit.
        step = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]) / width ** np.arange(6)
        # Times h.
        resisting = -stiffness * np.concatenate([[0.0], step])
        torque = _pieces(limit, width, resisting, [-stiffness * width, -stiffness])
        damped = _pieces(limit, width, damping * step, [damping])
        if sign < 0.0:
            torque = _mirrored(torque).scaled(-1.0)
            damped = _mirrored(damped)
        result.append(
            PassiveTorque(
                name=f"{node.name}_{side}",
                coordinate=coordinate.name,
                torque=torque,
                damping=damped,
            )
        )
    return result


def _pieces(
    limit: float, width: float, within: np.ndarray, beyond: list[float]
) -> PiecewisePolynomial:
    """Join polynomials: 0 up to the limit, `within` over the transition, `beyond` after it.

    Parameters
    ----------
    limit : where the transition begins [rad or m]
    width : of the transition [rad or m]
    within : coefficients in the distance from `limit`, the constant first, 7 at most
    beyond : coefficients in the distance from the transition's end
    """
    rows = np.zeros((3, 7))
    rows[1, : len(within)] = within
    rows[2, : len(beyond)] = beyond
    return PiecewisePolynomial(np.array([limit, limit, limit + width]), rows)


def _mirrored(function: PiecewisePolynomial) -> PiecewisePolynomial:
    """Mirror a function of three pieces whose first break is given twice: g(x) = f(-x)."""
    _, low, high = function.breaks
    width = high - low
    left, middle, right = function.coefficients
    signs = (-1.0) ** np.arange(len(left))
    # On a piece of f, f(-x) with x = -high + k reads f at low + (width - k).
    turned = substituted(middle, width, -1.0)
    return PiecewisePolynomial(
        np.array([-high, -high, -low]), np.stack([right * signs, turned, left * signs])
    )


def write_passive(parent: etree._Element, passive: PassiveTorque, warnings: list[Message]) -> None:
    """Write a passive torque as a spring of a coordinate.

    Parameters
    ----------
    parent : element that gets it
    passive : torque of the coordinate [N m or N]
    warnings : gets a line where the torque is no line or the damping not constant: it is left out
    """
    torque = passive.torque
    damping = passive.damping
    straight = isinstance(torque, PiecewisePolynomial) and torque.coefficients.shape in (
        (1, 1),
        (1, 2),
    )
    if (
        not straight
        or not isinstance(damping, PiecewisePolynomial)
        or damping.coefficients.shape != (1, 1)
    ):
        warnings.append(
            MODEL.message(
                f"passive torque '{passive.name}' is left out: it is not a linear spring with"
                " constant damping"
            )
        )
        return
    at_zero = float(torque(0.0))
    slope = float(torque(0.0, order=1))  # type: ignore[call-arg]
    if slope == 0.0 and at_zero != 0.0:
        warnings.append(
            MODEL.message(f"passive torque '{passive.name}' is left out: it is constant")
        )
        return
    element = child(parent, "SpringGeneralizedForce", name=passive.name)
    put(element, coordinate=legal(passive.coordinate), stiffness=-slope)
    put(element, rest_length=-at_zero / slope if slope else 0.0, viscosity=float(damping(0.0)))


def write_bushing(parent: etree._Element, bushing: Bushing) -> None:
    """Write springs and dampers between two frames.

    Parameters
    ----------
    parent : element that gets it
    bushing : to write
    """
    element = child(parent, BUSHING, name=bushing.name)
    _write_ends(element, bushing)
    put(element, **{part: getattr(bushing, part) for part in BUSHING_PARTS})


def write_coupler(parent: etree._Element, coupler: Coupler, warnings: list[Message]) -> None:
    """Write a coordinate coupler.

    Parameters
    ----------
    parent : element that gets it
    coupler : to write
    warnings : gets a line where OpenSim has no such function or coupler
    """
    element = child(parent, "CoordinateCouplerConstraint", name=coupler.name)
    put(element, isEnforced=True)
    holder = child(element, "coupled_coordinates_function")
    names = coupler.independents
    write_function(holder, coupler.function, f"coupler '{coupler.name}'", warnings)
    if not names:
        warnings.append(
            MODEL.message(
                f"coupler '{coupler.name}' holds '{coupler.dependent}' at a constant: written as it"
                " is"
            )
        )
    put(element, independent_coordinate_names=" ".join(legal(name) for name in names))
    put(element, dependent_coordinate_name=legal(coupler.dependent), scale_factor="1")


def write_loop(parent: etree._Element, loop: Loop, warnings: list[Message]) -> None:
    """Write a point or weld constraint.

    Parameters
    ----------
    parent : element that gets it
    loop : to write
    warnings : gets a line where it is of another kind: it is left out
    """
    if loop.kind in ("PointConstraint", "connect"):
        element = child(parent, "PointConstraint", name=loop.name)
        for i, body, pose in (("1", loop.body_1, loop.pose_1), ("2", loop.body_2, loop.pose_2)):
            child(element, f"socket_body_{i}", body_path(body))
            put(element, **{f"location_body_{i}": pose.translation})
    elif loop.kind in ("WeldConstraint", "weld"):
        element = child(parent, "WeldConstraint", name=loop.name)
        _write_ends(element, loop)
    else:
        warnings.append(
            MODEL.message(f"constraint '{loop.name}' of kind '{loop.kind}' cannot be written")
        )


def _write_ends(element: etree._Element, tie: Loop | Bushing) -> None:
    """Write the two frames of an object that links bodies, as offset frames of its own."""
    frames = etree.Element("frames")
    for i, body, pose in (("1", tie.body_1, tie.pose_1), ("2", tie.body_2, tie.pose_2)):
        child(element, f"socket_frame{i}", legal(f"{body}_frame{i}"))
        write_offset_frame(frames, f"{body}_frame{i}", body_path(body), pose)
    element.append(frames)
