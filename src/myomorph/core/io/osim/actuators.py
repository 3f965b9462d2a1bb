"""OpenSim's ideal actuators (coordinate, torque, point, point to point), and files of controls."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
from lxml import etree

from myomorph.core.io.osim.document import Node, child, legal, put, read_document
from myomorph.core.io.osim.joints import plain_name
from myomorph.core.io.parsing.text import written
from myomorph.core.model.errors import BadFile, UnknownName, check_name
from myomorph.core.model.model import GROUND, Actuator, Model
from myomorph.core.model.series import Table
from myomorph.core.model.spatial import Transform

KINDS = ("CoordinateActuator", "TorqueActuator", "PointActuator", "PointToPointActuator")
OLD = 10905
ActuatorKind = Literal["coordinate", "torque", "point", "point_to_point"]

BEFORE = (
    "<is_model_control>true</is_model_control>",
    "<extrapolate>true</extrapolate>",
    "<default_min>0.02</default_min>",
    "<default_max>1</default_max>",
    "<filter_on>false</filter_on>",
    "<use_steps>false</use_steps>",
)
AFTER = ("<min_nodes />", "<max_nodes />", "<kp>100</kp>", "<kv>20</kv>")
"""What OpenSim writes of every control, whatever its bounds."""


def read_actuator(node: Node) -> Actuator:
    """Read an ideal actuator with the names that the file has, not yet looked up in a model.

    Parameters
    ----------
    node : the actuator

    Returns
    -------
    points [m] and directions (3,) in the frames that the file names; before document version 1.9.5
    the file has directions of the force on the other body
    """
    old = node.document.version < OLD
    if node.kind == "CoordinateActuator":
        coordinate = plain_name(node.text("", "coordinate"))
        return replace(_bare(node, "coordinate"), coordinate=coordinate)
    if node.kind == "TorqueActuator":
        axis = node.vector("direction_A" if old else "axis", (0.0, 0.0, 1.0)) * (
            -1.0 if old else 1.0
        )
        return replace(
            _bare(node, "torque"),
            body=_body(node, "body_B" if old else "bodyA"),
            other_body=_body(node, "body_A" if old else "bodyB"),
            direction=axis,
            direction_is_global=node.flag("torque_is_global", True),
        )
    if node.kind == "PointActuator":
        direction = node.vector("direction_A" if old else "direction", (1.0, 0.0, 0.0)) * (
            -1.0 if old else 1.0
        )
        return replace(
            _bare(node, "point"),
            body=_body(node, "body_B" if old else "body"),
            point=node.vector("point_B" if old else "point"),
            direction=direction,
            point_is_global=node.flag("point_is_global", False),
            direction_is_global=node.flag("force_is_global", old),
        )
    return replace(
        _bare(node, "point_to_point"),
        body=_body(node, "bodyA"),
        other_body=_body(node, "bodyB"),
        point=node.vector("pointA"),
        other_point=node.vector("pointB"),
        point_is_global=node.flag("points_are_global", False),
    )


def _bare(node: Node, kind: ActuatorKind) -> Actuator:
    """Read the fields that actuators of all kinds have."""
    return Actuator(
        name=node.name,
        kind=kind,
        optimal_force=node.number("optimal_force", 1.0),
        min_control=node.number("min_control", -np.inf, infinite=True),
        max_control=node.number("max_control", np.inf, infinite=True),
        enabled=node.is_applied,
    )


def _body(node: Node, tag: str) -> str:
    """Read the name of a body, "" where none is assigned."""
    text = node.text("", tag)
    return "" if text == "Unassigned" else text


def placed_actuator(
    actuator: Actuator,
    coordinates: tuple[str, ...],
    pose_of: Callable[[str], tuple[str, Transform]],
    where: str,
) -> Actuator:
    """Look up the names of an actuator and place its points and directions in bodies.

    Parameters
    ----------
    actuator : as `read_actuator` gives it
    coordinates : names of the model's coordinates
    pose_of : gives body and pose of the frame of a name
    where : begins the message about an unknown name

    Returns
    -------
    the actuator with its points [m] and directions (3,) in bodies, those that are global in ground

    Raises
    ------
    UnknownName : its coordinate or frame does not exist
    """
    if actuator.kind == "coordinate":
        check_name("coordinate", actuator.coordinate, coordinates, where)
        return actuator
    body, pose = pose_of(actuator.body)
    other, other_pose = pose_of(actuator.other_body) if actuator.other_body else ("", pose)
    placed = replace(actuator, body=body, other_body=other)
    if not actuator.point_is_global:
        placed = replace(
            placed,
            point=pose.apply(actuator.point),
            other_point=other_pose.apply(actuator.other_point),
        )
    if not actuator.direction_is_global:
        placed = replace(placed, direction=pose.rotation @ actuator.direction)
    return placed


def write_actuator(parent: etree._Element, actuator: Actuator) -> None:
    """Write an ideal actuator.

    Parameters
    ----------
    parent : element that gets it
    actuator : to write
    """
    kinds = dict(zip(("coordinate", "torque", "point", "point_to_point"), KINDS, strict=True))
    element = child(parent, kinds[actuator.kind], name=actuator.name)
    put(
        element,
        appliesForce=actuator.enabled,
        min_control=actuator.min_control,
        max_control=actuator.max_control,
    )
    put(element, optimal_force=actuator.optimal_force)
    points = actuator.point_is_global
    turned = actuator.direction_is_global
    if actuator.kind == "coordinate":
        put(element, coordinate=legal(actuator.coordinate))
    elif actuator.kind == "point":
        put(element, body=legal(actuator.body), point=actuator.point, point_is_global=points)
        put(element, direction=actuator.direction, force_is_global=turned)
    else:
        put(element, bodyA=legal(actuator.body))
        if actuator.other_body:
            put(element, bodyB=legal(actuator.other_body))
        if actuator.kind == "torque":
            put(element, torque_is_global=turned, axis=actuator.direction)
        else:
            put(
                element,
                points_are_global=points,
                pointA=actuator.point,
                pointB=actuator.other_point,
            )


def read_actuators(
    path: str | os.PathLike[str], model: Model | None = None
) -> tuple[Actuator, ...]:
    """Read the actuators of a ForceSet file, those it switches off left out.

    Parameters
    ----------
    path : of the file
    model : names are looked up in it, and points on its offset frames placed in bodies; None leaves
        names and points as the file has them

    Returns
    -------
    the actuators, one or more

    Raises
    ------
    BadFile : it is no such file, has other forces, or no actuator that is switched on
    UnknownName : the model lacks a coordinate or frame that an actuator names
    """
    node = read_document(path, ("ForceSet", "ActuatorSet"), "a set of actuators (ForceSet)")
    actuators = []
    for item in node.items("objects"):
        if item.kind not in KINDS:
            raise item.bad("is not an ideal actuator", f"expected {', '.join(KINDS)}")
        actuator = read_actuator(item)
        if actuator.enabled:
            actuators.append(actuator if model is None else _looked_up(actuator, model))
    if not actuators:
        raise BadFile(path, "holds no actuator that is switched on")
    return tuple(actuators)


def _looked_up(actuator: Actuator, model: Model) -> Actuator:
    """Look up an actuator's names in a model; `UnknownName` where it lacks one."""
    where = f"the model (for actuator '{actuator.name}')"
    return placed_actuator(
        actuator, model.coordinate_names, lambda name: _place(name, model, where), where
    )


def _place(text: str, model: Model, where: str) -> tuple[str, Transform]:
    """Return body and pose of the body or frame that a text names in a model."""
    name = plain_name(text)
    if not name or name == GROUND or name in model.body_names:
        return name, Transform.identity()
    frame = next((candidate for candidate in model.frames if candidate.name == name), None)
    if frame is None:
        raise UnknownName(
            "body",
            name,
            existing=(GROUND, *model.body_names, *(frame.name for frame in model.frames)),
            where=where,
        )
    return frame.body, frame.pose


def write_controls(table: Table, path: str | os.PathLike[str], name: str = "Control Set") -> None:
    """Write the columns of a table as controls, whole or not at all.

    Parameters
    ----------
    table : controls (rows, columns) over times (rows,) [s], one column per actuator, by its name
    path : of the new file, replaced where it exists
    name : of the set of controls

    Raises
    ------
    BadFile : the file cannot be written
    """
    # It imports what opens web addresses, which reading a model does without.
    from xml.sax.saxutils import quoteattr

    with written(path) as stream:
        stream.write('<?xml version="1.0" encoding="UTF-8" ?>\n<OpenSimDocument Version="40600">\n')
        stream.write(f"\t<ControlSet name={quoteattr(name)}>\n\t\t<objects>\n")
        for column, values in zip(table.names, table.values.T, strict=True):
            stream.write(f"\t\t\t<ControlLinear name={quoteattr(column)}>\n")
            stream.writelines(f"\t\t\t\t{line}\n" for line in BEFORE)
            stream.write("\t\t\t\t<x_nodes>\n")
            for time, value in zip(table.time.tolist(), values.tolist(), strict=True):
                node = f"<t>{time:.12g}</t><value>{_number(value)}</value>"
                stream.write(f"\t\t\t\t\t<ControlLinearNode>{node}</ControlLinearNode>\n")
            stream.write("\t\t\t\t</x_nodes>\n")
            stream.writelines(f"\t\t\t\t{line}\n" for line in AFTER)
            stream.write("\t\t\t</ControlLinear>\n")
        stream.write("\t\t</objects>\n\t\t<groups />\n\t</ControlSet>\n</OpenSimDocument>\n")


def _number(value: float) -> str:
    """Write a number as OpenSim's XML has it."""
    return "NaN" if value != value else f"{value:.12g}"
