"""OpenSim's inverse kinematics tasks: weights of markers and coordinates."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from lxml import etree

from myomorph.io.osim.document import Node, read_document
from myomorph.io.osim.included import with_included


@dataclass(frozen=True)
class CoordinateAim:
    """A coordinate that inverse kinematics pulls towards a value.

    Attributes
    ----------
    weight : of the squared difference
    source : where the value comes from: the model's default, `value`, or a table of coordinates
    value : [rad or m], of source "value"
    """

    coordinate: str
    weight: float
    source: Literal["default", "value", "table"] = "default"
    value: float = 0.0


@dataclass(frozen=True)
class IkTasks:
    """Weights of markers and of coordinates; only markers with a weight are tracked."""

    marker_weights: Mapping[str, float]
    coordinates: tuple[CoordinateAim, ...] = ()


def read_ik_tasks(path: str | os.PathLike[str]) -> IkTasks:
    """The inverse kinematics tasks of an IKTaskSet file, or of the setup file of a tool that has one.

    Raises
    ------
    BadFile
        The file holds no task set, or a task has no name or an impossible weight.
    """
    node = with_included(read_document(path, (), "inverse kinematics tasks (IKTaskSet) or a tool's setup"))
    if _task_set(node) is None:
        raise node.bad("has no IKTaskSet inside")
    return tasks_of(node)


def tasks_of(node: Node) -> IkTasks:
    """The tasks of an IKTaskSet, or of the first one inside a node; none where there is no such set."""
    found = _task_set(node)
    if found is None:
        return IkTasks(MappingProxyType({}))
    weights: dict[str, float] = {}
    aims = []
    for element in found.iter("IKMarkerTask", "IKCoordinateTask"):
        task = node.node(element)
        if not task.name:
            raise task.bad("has no name", "expected the name of a marker or coordinate")
        if not task.flag("apply", True):
            continue
        weight = task.number("weight", 0.0)
        if weight < 0:
            raise task.bad(f"has weight {weight:g}", "expected zero or more")
        if task.kind == "IKMarkerTask":
            weights[task.name] = weight
        else:
            aims.append(_aim(task, weight))
    return IkTasks(MappingProxyType(weights), tuple(aims))


def _task_set(node: Node) -> etree._Element | None:
    return node.element if node.kind == "IKTaskSet" else next(node.element.iter("IKTaskSet"), None)


def _aim(task: Node, weight: float) -> CoordinateAim:
    kind = task.text("default_value", "value_type").lower()
    if kind == "manual_value":
        return CoordinateAim(task.name, weight, "value", task.number("value", 0.0))
    return CoordinateAim(task.name, weight, "table" if kind == "from_file" else "default")
