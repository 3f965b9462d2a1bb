"""Muscles, actuators and constraints as OpenSim 4 writes them."""

from __future__ import annotations

from lxml import etree

from myomorph.io.osim.muscles import DEFAULTS
from myomorph.io.osim.viscosity import DAMPER, damper_expression
from myomorph.io.osim.write_functions import child, legal, number, numbers, write_function
from myomorph.io.osim.write_joints import body_path, write_offset_frame
from myomorph.model.functions import PiecewisePolynomial
from myomorph.model.model import Actuator, Coupler, Loop
from myomorph.model.passive_parts import Bushing, PassiveTorque
from myomorph.model.paths import MovingPathPoint, Muscle, Path, PathPoint, PathWrap

FLAGS = frozenset({"ignore_tendon_compliance", "ignore_activation_dynamics", "ignore_passive_fiber_force"})
FOREIGN = "Millard2012EquilibriumMuscle"


def write_muscle(parent: etree._Element, muscle: Muscle, joints: dict[str, str], warnings: list[str]) -> None:
    """A muscle object; one of a class that OpenSim lacks becomes a Millard muscle, with a warning."""
    kind = muscle.kind
    if kind not in DEFAULTS:
        warnings.append(f"muscles of kind '{kind}' are written as {FOREIGN}: their force will differ")
        kind = FOREIGN
    element = child(parent, kind, name=muscle.name)
    child(element, "appliesForce", str(muscle.enabled).lower())
    child(element, "min_control", number(muscle.min_activation))
    child(element, "max_control", number(muscle.max_activation))
    write_path(element, muscle.name, muscle.path, joints, warnings)
    for tag, value in (
        ("max_isometric_force", muscle.max_isometric_force),
        ("optimal_fiber_length", muscle.optimal_fiber_length),
        ("tendon_slack_length", muscle.tendon_slack_length),
        ("pennation_angle_at_optimal", muscle.pennation_at_optimal),
        ("max_contraction_velocity", muscle.max_contraction_velocity),
    ):
        child(element, tag, number(value))
    if kind == "Thelen2003Muscle_Deprecated":
        child(element, "Vmax", number(muscle.max_contraction_velocity))
    if kind != muscle.kind:
        child(element, "ignore_tendon_compliance", "true")
        child(element, "minimum_activation", number(muscle.min_activation))
    else:
        _write_parameters(element, muscle)
        for tag, curve in muscle.curves.items():
            write_function(child(element, tag), curve, f"muscle '{muscle.name}' {tag}", warnings)


def write_viscosity(parent: etree._Element, muscle: Muscle, joints: dict[str, str]) -> None:
    """The damper along a muscle's path: a force of its own, which every class of muscle can have beside it."""
    element = child(parent, "ExpressionBasedPathForce", name=f"{muscle.name}{DAMPER}")
    child(element, "appliesForce", str(muscle.enabled).lower())
    write_path(element, muscle.name, muscle.path, joints, [])
    child(element, "expression", damper_expression(muscle.viscosity))
    child(element, "clamp_stretch", "false")


def _write_parameters(element: etree._Element, muscle: Muscle) -> None:
    curves: dict[str, etree._Element] = {}
    for key, value in muscle.parameters.items():
        owner, _, tag = key.rpartition("/")
        holder = element
        if owner:
            if owner not in curves:
                curves[owner] = child(element, owner, name=f"{muscle.name}_{owner}")
            holder = curves[owner]
        flag = tag in FLAGS or tag.startswith(("use_", "clamp_"))
        child(holder, tag, str(bool(value)).lower() if flag else number(value))


def write_path(
    element: etree._Element, owner: str, way: Path, joints: dict[str, str], warnings: list[str]
) -> etree._Element:
    """The path of a muscle or ligament, put into `element`."""
    path = child(element, "GeometryPath", name="path")
    points = child(child(path, "PathPointSet"), "objects")
    for i, point in enumerate(way.points):
        _write_point(points, point, point.name or f"{owner}-P{i + 1}", joints, warnings)
    wraps = child(child(path, "PathWrapSet"), "objects")
    _warn_of_path(way, warnings)
    names: set[str] = set()
    for wrap in way.wraps:
        if isinstance(wrap, PathWrap):
            written = child(wraps, "PathWrap", name=f"{legal(wrap.wrap_object)}_{len(names)}")
            names.add(wrap.wrap_object + str(len(names)))
            child(written, "wrap_object", legal(wrap.wrap_object))
            child(written, "method", wrap.method)
            child(written, "range", f"{wrap.first} {wrap.last}")
    return path


def _warn_of_path(path: Path, warnings: list[str]) -> None:
    if any(not isinstance(wrap, PathWrap) for wrap in path.wraps):
        warnings.append("wraps of MuJoCo tendons cannot be written: their muscles run straight between points")
    if any(one != 1.0 for one in path.divisors):
        warnings.append("pulleys of MuJoCo tendons cannot be written: their muscles' lengths will differ")


def _write_point(
    parent: etree._Element,
    point: PathPoint | MovingPathPoint,
    name: str,
    joints: dict[str, str],
    warnings: list[str],
) -> None:
    if isinstance(point, MovingPathPoint):
        element = child(parent, "MovingPathPoint", name=name)
        child(element, "socket_parent_frame", body_path(point.body))
        # OpenSim wants a coordinate for a constant function too.
        some = next((one for one in point.coordinates if one), "")
        for axis, function, coordinate in zip("xyz", point.functions, point.coordinates, strict=True):
            chosen = coordinate or some
            if chosen:
                child(element, f"socket_{axis}_coordinate", f"/jointset/{joints[chosen]}/{legal(chosen)}")
            write_function(child(element, f"{axis}_location"), function, f"path point '{name}' {axis}", warnings)
        return
    element = child(parent, "ConditionalPathPoint" if point.coordinate else "PathPoint", name=name)
    child(element, "socket_parent_frame", body_path(point.body))
    child(element, "location", numbers(point.location))
    if point.coordinate:
        child(element, "socket_coordinate", f"/jointset/{joints[point.coordinate]}/{legal(point.coordinate)}")
        child(element, "range", numbers(point.range))


def write_actuator(parent: etree._Element, actuator: Actuator) -> None:
    """An ideal actuator."""
    kinds = {
        "coordinate": "CoordinateActuator",
        "torque": "TorqueActuator",
        "point": "PointActuator",
        "point_to_point": "PointToPointActuator",
    }
    element = child(parent, kinds[actuator.kind], name=actuator.name)
    child(element, "appliesForce", str(actuator.enabled).lower())
    child(element, "min_control", number(actuator.min_control))
    child(element, "max_control", number(actuator.max_control))
    child(element, "optimal_force", number(actuator.optimal_force))
    is_global = str(actuator.point_is_global).lower(), str(actuator.direction_is_global).lower()
    if actuator.kind == "coordinate":
        child(element, "coordinate", legal(actuator.coordinate))
    elif actuator.kind == "point":
        child(element, "body", legal(actuator.body))
        child(element, "point", numbers(actuator.point))
        child(element, "point_is_global", is_global[0])
        child(element, "direction", numbers(actuator.direction))
        child(element, "force_is_global", is_global[1])
    else:
        child(element, "bodyA", legal(actuator.body))
        if actuator.other_body:
            child(element, "bodyB", legal(actuator.other_body))
        if actuator.kind == "torque":
            child(element, "torque_is_global", is_global[1])
            child(element, "axis", numbers(actuator.direction))
        else:
            child(element, "points_are_global", is_global[0])
            child(element, "pointA", numbers(actuator.point))
            child(element, "pointB", numbers(actuator.other_point))


def write_passive(parent: etree._Element, passive: PassiveTorque, warnings: list[str]) -> None:
    """A spring of a coordinate, where the torque is a line and the damping constant; else a warning."""
    torque, damping = passive.torque, passive.damping
    straight = isinstance(torque, PiecewisePolynomial) and torque.coefficients.shape in ((1, 1), (1, 2))
    if not straight or not isinstance(damping, PiecewisePolynomial) or damping.coefficients.shape != (1, 1):
        warnings.append(f"passive torque '{passive.name}' is left out: it is not a linear spring with constant damping")
        return
    at_zero, slope = float(torque(0.0)), float(torque(0.0, order=1))  # type: ignore[call-arg]
    if slope == 0.0 and at_zero != 0.0:
        warnings.append(f"passive torque '{passive.name}' is left out: it is constant")
        return
    element = child(parent, "SpringGeneralizedForce", name=passive.name)
    child(element, "coordinate", legal(passive.coordinate))
    child(element, "stiffness", number(-slope))
    child(element, "rest_length", number(-at_zero / slope if slope else 0.0))
    child(element, "viscosity", number(float(damping(0.0))))


def write_bushing(parent: etree._Element, bushing: Bushing) -> None:
    """Springs and dampers between two frames."""
    element = child(parent, "BushingForce", name=bushing.name)
    _write_ends(element, bushing)
    for what in ("rotational", "translational"):
        for part in ("stiffness", "damping"):
            child(element, f"{what}_{part}", numbers(getattr(bushing, f"{what}_{part}")))


def write_coupler(parent: etree._Element, coupler: Coupler, warnings: list[str]) -> None:
    """A coordinate coupler."""
    element = child(parent, "CoordinateCouplerConstraint", name=coupler.name)
    child(element, "isEnforced", "true")
    holder = child(element, "coupled_coordinates_function")
    names = coupler.independents
    write_function(holder, coupler.function, f"coupler '{coupler.name}'", warnings)
    if not names:
        warnings.append(f"coupler '{coupler.name}' holds '{coupler.dependent}' at a constant: written as it is")
    child(element, "independent_coordinate_names", " ".join(legal(name) for name in names))
    child(element, "dependent_coordinate_name", legal(coupler.dependent))
    child(element, "scale_factor", "1")


def write_loop(parent: etree._Element, loop: Loop, warnings: list[str]) -> None:
    """A point or weld constraint."""
    if loop.kind in ("PointConstraint", "connect"):
        element = child(parent, "PointConstraint", name=loop.name)
        for i, body, pose in (("1", loop.body_1, loop.pose_1), ("2", loop.body_2, loop.pose_2)):
            child(element, f"socket_body_{i}", body_path(body))
            child(element, f"location_body_{i}", numbers(pose.translation))
    elif loop.kind in ("WeldConstraint", "weld"):
        element = child(parent, "WeldConstraint", name=loop.name)
        _write_ends(element, loop)
    else:
        warnings.append(f"constraint '{loop.name}' of kind '{loop.kind}' cannot be written")


def _write_ends(element: etree._Element, tie: Loop | Bushing) -> None:
    """The two frames of what links bodies, as offset frames of its own."""
    frames = etree.Element("frames")
    for i, body, pose in (("1", tie.body_1, tie.pose_1), ("2", tie.body_2, tie.pose_2)):
        child(element, f"socket_frame{i}", legal(f"{body}_frame{i}"))
        write_offset_frame(frames, f"{body}_frame{i}", body_path(body), pose)
    element.append(frames)
