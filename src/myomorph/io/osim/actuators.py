"""OpenSim's ideal actuators: of a coordinate, a torque, a point, or between two points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.io.osim.document import Node
from myomorph.io.osim.frames import Frames
from myomorph.io.osim.joints import plain_name
from myomorph.model.errors import UnknownName
from myomorph.model.model import GROUND, Actuator

KINDS = ("CoordinateActuator", "TorqueActuator", "PointActuator", "PointToPointActuator")
ZEROS = (0.0, 0.0, 0.0)
OLD = 10905


def read_actuator(node: Node) -> Actuator:
    """An ideal actuator with the names the file gives, not yet looked up in a model."""
    low = node.number("min_control", -np.inf, infinite=True)
    high = node.number("max_control", np.inf, infinite=True)
    enabled = node.flag("appliesForce", not node.flag("isDisabled", False))
    name, force = node.name, node.number("optimal_force", 1.0)
    if node.kind == "CoordinateActuator":
        coordinate = plain_name(node.text("", "coordinate"))
        return Actuator(name, "coordinate", force, low, high, coordinate=coordinate, enabled=enabled)
    if node.kind == "TorqueActuator":
        old = node.document.version < OLD
        body, other = ("body_B", "body_A") if old else ("bodyA", "bodyB")
        axis = node.vector("direction_A" if old else "axis", (0.0, 0.0, 1.0)) * (-1.0 if old else 1.0)
        return Actuator(
            name,
            "torque",
            force,
            low,
            high,
            body=_body(node, body),
            other_body=_body(node, other),
            direction=axis,
            direction_is_global=node.flag("torque_is_global", True),
            enabled=enabled,
        )
    if node.kind == "PointActuator":
        old = node.document.version < OLD
        direction = node.vector("direction_A" if old else "direction", (1.0, 0.0, 0.0)) * (-1.0 if old else 1.0)
        return Actuator(
            name,
            "point",
            force,
            low,
            high,
            body=_body(node, "body_B" if old else "body"),
            point=node.vector("point_B" if old else "point", ZEROS),
            direction=direction,
            point_is_global=node.flag("point_is_global", False),
            direction_is_global=node.flag("force_is_global", old),
            enabled=enabled,
        )
    return Actuator(
        name,
        "point_to_point",
        force,
        low,
        high,
        body=_body(node, "bodyA"),
        other_body=_body(node, "bodyB"),
        point=node.vector("pointA", ZEROS),
        other_point=node.vector("pointB", ZEROS),
        point_is_global=node.flag("points_are_global", False),
        enabled=enabled,
    )


def _body(node: Node, tag: str) -> str:
    text = node.text("", tag)
    return "" if text == "Unassigned" else text


def placed_actuator(node: Node, actuator: Actuator, frames: Frames, coordinates: tuple[str, ...]) -> Actuator:
    """The actuator with its names looked up, its points and directions in bodies.

    Raises
    ------
    UnknownName
        It names a body or coordinate that the model does not have.
    """
    where = f"{node.document.path}: actuator '{actuator.name}': the model"
    if actuator.kind == "coordinate":
        if actuator.coordinate not in coordinates:
            raise UnknownName("coordinate", actuator.coordinate, coordinates, where)
        return actuator
    body, pose = frames.place(actuator.body or GROUND, node)
    other, other_pose = frames.place(actuator.other_body, node) if actuator.other_body else ("", pose)
    placed = replace(actuator, body=body, other_body=other)
    if not actuator.point_is_global:
        placed = replace(placed, point=pose.apply(actuator.point), other_point=other_pose.apply(actuator.other_point))
    if not actuator.direction_is_global:
        placed = replace(placed, direction=pose.rotation @ actuator.direction)
    return placed
