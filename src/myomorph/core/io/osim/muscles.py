"""OpenSim's muscles: parameters of their classes and dampers along paths, read and written."""

from __future__ import annotations

import re
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
from lxml import etree

from myomorph.core.io.osim.document import Node, child, put
from myomorph.core.io.osim.functions import read_function, write_function
from myomorph.core.io.osim.paths import PathReader, write_path
from myomorph.core.model.causes import MODEL
from myomorph.core.model.errors import BadModel
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.paths import Muscle

DAMPER = "_viscosity"
"""Ends the name of the force that damps a muscle.

OpenSim's muscle classes have no damper along the path. Millard2012EquilibriumMuscle alone damps,
along the fiber and in proportion to its strength, and static optimization leaves that out with the
passive force; a PathSpring's dissipation multiplies its stretch. An ExpressionBasedPathForce
`viscosity*ldot` on the same path is exact for every class and pose.
"""

FORM = re.compile(r"\(?\+?(\d+\.?\d*(?:[eE][-+]?\d+)?)\)?\*ldot")

DEFAULTS: dict[str, float] = dict.fromkeys(
    ("Thelen2003Muscle", "Millard2012EquilibriumMuscle"), 0.01
) | dict.fromkeys(
    (
        "Millard2012AccelerationMuscle",
        "DeGrooteFregly2016Muscle",
        "MeyerFregly2016Muscle",
        "RigidTendonMuscle",
        "Thelen2003Muscle_Deprecated",
        "Schutte1993Muscle_Deprecated",
        "Delp1990Muscle_Deprecated",
    ),
    0.0,
)
"""By class that is built, the least control where the file gives none."""

NOT_PARAMETERS = frozenset(
    (
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
    )
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
FLAGS = frozenset(
    {"ignore_tendon_compliance", "ignore_activation_dynamics", "ignore_passive_fiber_force"}
)
FOREIGN = "Millard2012EquilibriumMuscle"


def with_dampers(
    muscles: list[Muscle], forces: list[Node], paths: PathReader
) -> tuple[list[Muscle], list[Node]]:
    """Add the viscosity of the dampers that lie along muscles' paths.

    A damper is an ExpressionBasedPathForce named "<muscle>_viscosity" whose path is the muscle's.

    Parameters
    ----------
    muscles : of the model
    forces : nodes of the other forces
    paths : reads the dampers' paths

    Returns
    -------
    the muscles with their viscosity [N s/m], and the forces that are no such dampers
    """
    places = {muscle.name: i for i, muscle in enumerate(muscles)}
    damped = list(muscles)
    rest = []
    for force in forces:
        value = _viscosity(force)
        i = places.get(force.name.removesuffix(DAMPER), -1) if force.name.endswith(DAMPER) else -1
        if value is None or i < 0 or not _same(paths.read(force), muscles[i].path):
            rest.append(force)
        else:
            damped[i] = replace(damped[i], viscosity=damped[i].viscosity + value)
    return damped, rest


def _viscosity(force: Node) -> float | None:
    """Read a path force's viscosity [N s/m], None where it is no active damper."""
    if force.kind != "ExpressionBasedPathForce" or not force.flag("appliesForce", True):
        return None
    form = FORM.fullmatch("".join(force.text("0.0", "expression").split()))
    return float(form.group(1)) if form else None


def _same(first: Any, second: Any) -> bool:
    """Return whether two values are alike, whatever their parts are named."""
    if isinstance(first, float | np.ndarray):
        return np.shape(first) == np.shape(second) and np.allclose(
            first, second, rtol=1e-9, atol=1e-9
        )
    if is_dataclass(first):
        parts = [field.name for field in fields(first) if field.name != "name"]
        return type(first) is type(second) and all(
            _same(getattr(first, part), getattr(second, part)) for part in parts
        )
    if isinstance(first, tuple):
        return (
            isinstance(second, tuple)
            and len(first) == len(second)
            and all(map(_same, first, second))
        )
    return bool(first == second)


def is_muscle(node: Node) -> bool:
    """Return whether an object of the ForceSet is a muscle.

    Parameters
    ----------
    node : the object
    """
    return node.kind in DEFAULTS or (
        node.kind.endswith("Muscle") and node.find("max_isometric_force") is not None
    )


def read_muscle(node: Node, paths: PathReader, groups: tuple[str, ...]) -> Muscle:
    """Read a muscle with its path and parameters.

    Parameters
    ----------
    node : the muscle
    paths : reads its path
    groups : that it is a member of

    Returns
    -------
    forces [N], lengths [m], pennation [rad] and velocity [optimal fiber lengths per second]

    Raises
    ------
    BadFile : a number or its path is not as it should be
    BadModel : its class is not supported
    UnknownName : its path names a part that does not exist
    """
    if node.kind not in DEFAULTS:
        known = ", ".join(DEFAULTS)
        raise BadModel(
            f"{node.document.path}: muscle '{node.name}' is a {node.kind}, which is not supported:"
            f" {known} are"
        )
    low = node.number("min_control", DEFAULTS[node.kind], infinite=True)
    high = node.number("max_control", 1.0, infinite=True)
    # Before 4.0 a lower bound of 0 was a slip, and the class's own counts.
    low = DEFAULTS[node.kind] if node.document.version < 30513 and low == 0.0 else low
    speed = node.number("Vmax", 10.0) if node.kind == "Thelen2003Muscle_Deprecated" else 10.0
    pennation = node.number("pennation_angle_at_optimal", node.number("pennation_angle", 0.0))
    # Older classes keep curves as functions of normalized length or velocity.
    curves = {tag: node.inner(tag) for tag in FREE_CURVES}
    return Muscle(
        name=node.name,
        kind=node.kind,
        path=paths.read(node),
        max_isometric_force=node.number("max_isometric_force", 1000.0),
        optimal_fiber_length=node.number("optimal_fiber_length", 0.1),
        tendon_slack_length=node.number("tendon_slack_length", 0.2),
        pennation_at_optimal=pennation,
        max_contraction_velocity=node.number("max_contraction_velocity", speed),
        min_activation=low,
        max_activation=high,
        parameters=FrozenMap(_parameters(node)),
        groups=groups,
        enabled=node.is_applied,
        curves=FrozenMap(
            {tag: read_function(inner, node) for tag, inner in curves.items() if inner is not None}
        ),
    )


def _parameters(node: Node) -> dict[str, float]:
    """Read other numbers of the muscle and of its curves that the file or its defaults state.

    Returns
    -------
    by name, those of curves as CURVE/NAME; truths are 0 or 1
    """
    result: dict[str, float] = {}
    for owner, prefix in ((node, ""), *((node.child(curve), f"{curve}/") for curve in CURVES)):
        if owner is None:
            continue
        default = node.document.defaults.get(owner.kind)
        tags = [
            str(element.tag)
            for holder in (default, owner.element)
            if holder is not None
            for element in holder
            if not len(element)
        ]
        for tag in dict.fromkeys(tags):
            if tag in NOT_PARAMETERS or tag.startswith(("socket_", "connector_")):
                continue
            value = _value(owner, tag)
            if value is not None:
                result[prefix + tag] = value
    return result


def _value(node: Node, tag: str) -> float | None:
    """Read a property that is a number or a truth, None where it is neither."""
    text = node.text("", tag).lower()
    if text in ("true", "false"):
        return float(text == "true")
    try:
        return float(text)
    except ValueError:
        return None


def write_muscle(
    parent: etree._Element, muscle: Muscle, joints: dict[str, str], warnings: list[Message]
) -> None:
    """Write a muscle; a class that OpenSim lacks becomes a Millard muscle, with a warning.

    Parameters
    ----------
    parent : element that gets it
    muscle : to write
    joints : component name of the joint of each coordinate
    warnings : gets a line for what cannot be written as it is
    """
    kind = muscle.kind
    if kind not in DEFAULTS:
        warnings.append(
            MODEL.message(
                f"muscles of kind '{kind}' are written as {FOREIGN}: their force will differ",
                severity="may change results",
            )
        )
        kind = FOREIGN
    element = child(parent, kind, name=muscle.name)
    put(
        element,
        appliesForce=muscle.enabled,
        min_control=muscle.min_activation,
        max_control=muscle.max_activation,
    )
    write_path(element, muscle.name, muscle.path, joints, warnings)
    put(
        element,
        max_isometric_force=muscle.max_isometric_force,
        optimal_fiber_length=muscle.optimal_fiber_length,
        tendon_slack_length=muscle.tendon_slack_length,
        pennation_angle_at_optimal=muscle.pennation_at_optimal,
        max_contraction_velocity=muscle.max_contraction_velocity,
    )
    if kind == "Thelen2003Muscle_Deprecated":
        put(element, Vmax=muscle.max_contraction_velocity)
    if kind != muscle.kind:
        put(element, ignore_tendon_compliance=True, minimum_activation=muscle.min_activation)
    else:
        _write_parameters(element, muscle)
        # OpenSim refuses a control below the activation that fibers need, 0.01 unless the file says
        # less.
        if "minimum_activation" not in muscle.parameters and muscle.min_activation < DEFAULTS[kind]:
            put(element, minimum_activation=muscle.min_activation)
        for tag, curve in muscle.curves.items():
            write_function(child(element, tag), curve, f"muscle '{muscle.name}' {tag}", warnings)


def write_viscosity(parent: etree._Element, muscle: Muscle, joints: dict[str, str]) -> None:
    """Write the damper along a muscle's path as a force of its own.

    Every class of muscle can have such a force.

    Parameters
    ----------
    parent : element that gets it
    muscle : its viscosity is in N s/m
    joints : component name of the joint of each coordinate
    """
    element = child(parent, "ExpressionBasedPathForce", name=f"{muscle.name}{DAMPER}")
    put(element, appliesForce=muscle.enabled)
    write_path(element, muscle.name, muscle.path, joints, [])
    put(element, expression=f"{float(muscle.viscosity)!r}*ldot", clamp_stretch=False)


def _write_parameters(element: etree._Element, muscle: Muscle) -> None:
    """Write the other numbers of a muscle and of its curves, truths as such."""
    curves: dict[str, etree._Element] = {}
    for key, value in muscle.parameters.items():
        owner, _, tag = key.rpartition("/")
        holder = element
        if owner:
            if owner not in curves:
                curves[owner] = child(element, owner, name=f"{muscle.name}_{owner}")
            holder = curves[owner]
        flag = tag in FLAGS or tag.startswith(("use_", "clamp_"))
        put(holder, **{tag: bool(value) if flag else value})
