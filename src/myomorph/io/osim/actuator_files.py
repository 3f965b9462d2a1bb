"""Actuator files (OpenSim's ForceSet XML) as ideal actuators."""

from __future__ import annotations

import os
from dataclasses import replace

from myomorph.io.osim.actuators import KINDS, read_actuator
from myomorph.io.osim.document import read_document
from myomorph.io.osim.joints import plain_name
from myomorph.model.errors import BadFile, UnknownName
from myomorph.model.model import GROUND, Actuator, Model
from myomorph.model.spatial import Transform


def read_actuators(path: str | os.PathLike[str], model: Model | None = None) -> tuple[Actuator, ...]:
    """The actuators of a ForceSet file, those it switches off left out.

    Parameters
    ----------
    model : where given, names are looked up in it, and points on its offset frames placed in bodies

    Raises
    ------
    BadFile
        The file holds no set of forces, or a force that is not an ideal actuator.
    UnknownName
        An actuator names a coordinate or body that the model lacks.
    """
    node = read_document(path, ("ForceSet", "ActuatorSet"), "a set of actuators (ForceSet)")
    found = []
    for one in node.items("objects"):
        if one.kind not in KINDS:
            raise one.bad("is not an ideal actuator", f"expected {', '.join(KINDS)}")
        actuator = read_actuator(one)
        if actuator.enabled:
            found.append(actuator if model is None else _looked_up(actuator, model))
    if not found:
        raise BadFile(path, "holds no actuator that is switched on")
    return tuple(found)


def _looked_up(actuator: Actuator, model: Model) -> Actuator:
    where = f"the model (for actuator '{actuator.name}')"
    if actuator.kind == "coordinate":
        if actuator.coordinate not in model.coordinate_names:
            raise UnknownName("coordinate", actuator.coordinate, model.coordinate_names, where)
        return actuator
    body, pose = _place(actuator.body, model, where)
    other, other_pose = _place(actuator.other_body, model, where)
    placed = replace(actuator, body=body, other_body=other)
    if not actuator.point_is_global:
        points = (pose.apply(actuator.point), other_pose.apply(actuator.other_point))
        placed = replace(placed, point=points[0], other_point=points[1])
    if not actuator.direction_is_global:
        placed = replace(placed, direction=pose.rotation @ actuator.direction)
    return placed


def _place(text: str, model: Model, where: str) -> tuple[str, Transform]:
    name = plain_name(text)
    if not name or name == GROUND or name in model.body_names:
        return name, Transform.identity()
    frame = next((one for one in model.frames if one.name == name), None)
    if frame is None:
        raise UnknownName("body", name, (GROUND, *model.body_names, *(one.name for one in model.frames)), where)
    return frame.body, frame.pose
