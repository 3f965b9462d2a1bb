"""OpenSim's muscles: paths, wraps and the parameters of their classes."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import numpy as np

from myomorph.io.osim.document import Node
from myomorph.io.osim.frames import Frames
from myomorph.io.osim.functions import read_function
from myomorph.io.osim.joints import plain_name
from myomorph.model.errors import BadModel, UnknownName
from myomorph.model.functions import Function, SineProduct, constant
from myomorph.model.paths import MovingPathPoint, Muscle, Path, PathPoint, PathWrap
from myomorph.model.spatial import Transform

DEFAULTS = {
    "Thelen2003Muscle": {"min_control": 0.01},
    "Millard2012EquilibriumMuscle": {"min_control": 0.01},
    "Millard2012AccelerationMuscle": {},
    "DeGrooteFregly2016Muscle": {},
    "MeyerFregly2016Muscle": {},
    "RigidTendonMuscle": {},
    "Thelen2003Muscle_Deprecated": {},
    "Schutte1993Muscle_Deprecated": {},
    "Delp1990Muscle_Deprecated": {},
}
NOT_PARAMETERS = frozenset(
    {
        "isDisabled",
        "appliesForce",
        "min_control",
        "max_control",
        "optimal_force",
        "max_isometric_force",
        "optimal_fiber_length",
        "tendon_slack_length",
        "pennation_angle_at_optimal",
        "pennation_angle",
        "max_contraction_velocity",
        "Vmax",
    }
)
CURVES = (
    "ActiveForceLengthCurve",
    "ForceVelocityCurve",
    "FiberForceLengthCurve",
    "TendonForceLengthCurve",
    "FiberCompressiveForceLengthCurve",
    "FiberCompressiveForceCosPennationCurve",
    "MuscleFirstOrderActivationDynamicModel",
    "MuscleFixedWidthPennationModel",
)
FREE_CURVES = (
    "tendon_force_length_curve",
    "active_force_length_curve",
    "passive_force_length_curve",
    "force_velocity_curve",
)


class PathReader:
    """Reads paths of points and wraps, once what they may refer to is known."""

    def __init__(self, frames: Frames, coordinates: tuple[str, ...], wraps: dict[str, str]):
        self._frames = frames
        self._coordinates = coordinates
        self._wraps = wraps

    def read(self, node: Node) -> Path:
        """The path of a muscle, of a path actuator or of another object that has one."""
        path = node.child("GeometryPath")
        if path is None:
            other = next((str(one.tag) for one in node.element if str(one.tag).endswith("Path")), "")
            if other:
                raise BadModel(f"{node.document.path}: {node.kind} '{node.name}' has a {other}, which is not built")
            path = node
        points = [self._point(one) for one in path.items("PathPointSet") or path.items("MusclePointSet")]
        if len(points) < 2:
            raise node.bad(f"its path has {len(points)} points", "expected two or more")
        wraps = [self._wrap(one, len(points)) for one in path.items("PathWrapSet") or path.items("MuscleWrapSet")]
        return Path(tuple(points), tuple(wraps))

    def _point(self, node: Node) -> PathPoint | MovingPathPoint:
        body, pose = self._frames.place(node.socket("parent_frame", "body"), node)
        if node.kind == "MovingPathPoint":
            return self._moving(node, body, pose)
        place = pose.apply(node.vector("location", (0.0, 0.0, 0.0)))
        if node.kind == "PathPoint":
            return PathPoint(node.name, body, place)
        if node.kind != "ConditionalPathPoint":
            raise BadModel(f"{node.document.path}: path point '{node.name}' is a {node.kind}, which is not built")
        low, high = node.vector("range", (0.0, 0.0), infinite=True)
        coordinate = self._coordinate(node.socket("coordinate", "coordinate", "coordinates"), node)
        return PathPoint(node.name, body, place, coordinate, (float(low), float(high)))

    def _moving(self, node: Node, body: str, pose: Transform) -> MovingPathPoint:
        if not np.array_equal(pose.rotation, np.eye(3)):
            raise BadModel(f"{node.document.path}: moving path point '{node.name}' is in a turned frame: not built")
        functions: list[Function] = []
        coordinates: list[str] = []
        for axis, offset in zip("xyz", pose.translation, strict=True):
            inner = node.inner(f"{axis}_location")
            function = constant(0.0) if inner is None else read_function(inner, node)
            name = node.socket(f"{axis}_coordinate")
            if function.arity and not name:
                raise node.bad(f"its {axis}_location depends on a coordinate, but names none")
            functions.append(_raised(function, float(offset)))
            coordinates.append(self._coordinate(name, node) if function.arity else "")
        return MovingPathPoint(node.name, body, tuple(functions), tuple(coordinates))  # type: ignore[arg-type]

    def _coordinate(self, text: str, node: Node) -> str:
        name = plain_name(text)
        if name not in self._coordinates:
            raise UnknownName(
                "coordinate", name, self._coordinates, f"{node.document.path}: {node.kind} '{node.name}': the model"
            )
        return name

    def _wrap(self, node: Node, points: int) -> PathWrap:
        name = node.text("", "wrap_object")
        if name not in self._wraps:
            raise UnknownName("wrap object", name, tuple(self._wraps), f"{node.document.path}: the model")
        first, last = (int(one) for one in node.vector("range", (-1.0, -1.0)))
        method = node.text("hybrid", "method").lower()
        if method not in ("hybrid", "midpoint", "axial", "unassigned", ""):
            raise node.bad(f"its method is '{method}'", "expected hybrid, midpoint or axial")
        return PathWrap(self._wraps[name], "hybrid" if method in ("unassigned", "") else method, first, last)


def _raised(function: Function, by: float) -> Function:
    if by == 0.0:
        return function
    if isinstance(function, SineProduct):
        return replace(function, offset=function.offset + by)
    coefficients = function.coefficients.copy()
    coefficients[:, 0] += by
    return replace(function, coefficients=coefficients)


def is_muscle(node: Node) -> bool:
    """Whether an object of the ForceSet is a muscle."""
    return node.kind in DEFAULTS or (node.kind.endswith("Muscle") and node.find("max_isometric_force") is not None)


def read_muscle(node: Node, paths: PathReader, groups: tuple[str, ...]) -> Muscle:
    """A muscle with its path and parameters.

    Raises
    ------
    BadModel
        Its class is not built.
    """
    if node.kind not in DEFAULTS:
        known = ", ".join(DEFAULTS)
        raise BadModel(f"{node.document.path}: muscle '{node.name}' is a {node.kind}, which is not built: {known} are")
    low, high = _controls(node)
    speed = node.number("Vmax", 10.0) if node.kind == "Thelen2003Muscle_Deprecated" else 10.0
    pennation = node.number("pennation_angle_at_optimal", node.number("pennation_angle", 0.0))
    return Muscle(
        node.name,
        node.kind,
        paths.read(node),
        node.number("max_isometric_force", 1000.0),
        node.number("optimal_fiber_length", 0.1),
        node.number("tendon_slack_length", 0.2),
        pennation,
        node.number("max_contraction_velocity", speed),
        low,
        high,
        MappingProxyType(_parameters(node)),
        groups,
        node.flag("appliesForce", not node.flag("isDisabled", False)),
        MappingProxyType(_free_curves(node)),
    )


def _free_curves(node: Node) -> dict[str, Function]:
    """Curves that older classes keep as functions of normalized length or velocity."""
    found = {tag: node.inner(tag) for tag in FREE_CURVES}
    return {tag: read_function(inner, node) for tag, inner in found.items() if inner is not None}


def _controls(node: Node) -> tuple[float, float]:
    """Bounds of the control; before 4.0 a lower bound of 0 was a slip, and the class's own counts."""
    low = node.number("min_control", DEFAULTS[node.kind].get("min_control", 0.0), infinite=True)
    high = node.number("max_control", 1.0, infinite=True)
    if node.document.version < 30513 and low == 0.0:
        low = DEFAULTS[node.kind].get("min_control", 0.0)
    return low, high


def _parameters(node: Node) -> dict[str, float]:
    """Every other number of the muscle and of its curves, where the file or its defaults give it."""
    found: dict[str, float] = {}
    for owner, prefix in ((node, ""), *((node.child(curve), f"{curve}/") for curve in CURVES)):
        if owner is None:
            continue
        default = node.document.defaults.get(owner.kind)
        tags = [
            str(one.tag) for holder in (default, owner.element) if holder is not None for one in holder if not len(one)
        ]
        for tag in dict.fromkeys(tags):
            if tag in NOT_PARAMETERS or tag.startswith(("socket_", "connector_")):
                continue
            value = _value(owner, tag)
            if value is not None:
                found[prefix + tag] = value
    return found


def _value(node: Node, tag: str) -> float | None:
    text = node.text("", tag).lower()
    if text in ("true", "false"):
        return float(text == "true")
    try:
        return float(text)
    except ValueError:
        return None
