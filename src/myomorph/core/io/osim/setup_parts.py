"""What OpenSim's setups share: tasks of inverse kinematics, files that they name, parts that stand
in other files.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Literal

from lxml import etree

from myomorph.core.io.osim.document import NEWEST, Node, child, put, read_document, write_document
from myomorph.core.io.osim.frames import Frames, body_path
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadFile, UnknownName
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import GROUND, Marker, Model
from myomorph.core.model.spatial import Transform

UNASSIGNED = ("", "Unassigned", "NULL")
OUTPUTS = (".osim", ".mot", ".sto", ".xml")


def with_included(node: Node) -> Node:
    """The node with the contents of the files that its parts name by a `file` attribute."""
    if not any(element.get("file") for element in node.element.iter()):
        return node
    root = copy.deepcopy(node.element)
    for element in list(root.iter()):
        name = element.get("file")
        if not name or not isinstance(element.tag, str) or len(element):
            continue
        part = read_document(resolved(node, name), (element.tag,), f"a {element.tag}")
        if any(inner.get("file") for inner in part.element.iter()):
            raise part.bad("names a further file", "put its contents into this one")
        element.extend(copy.deepcopy(part.element))
        element.attrib.pop("file")
    return Node(root, node.document, node.path)


@dataclass(frozen=True)
class CoordinateAim:
    """A coordinate that inverse kinematics pulls towards a value."""

    coordinate: str
    weight: float  # of the squared difference
    # where the value comes from: the model's default, `value`, or a table of coordinates
    source: Literal["default", "value", "table"] = "default"
    value: float = 0.0  # [rad or m], of source "value"


@dataclass(frozen=True)
class IkTasks:
    """Weights of markers and of coordinates; only markers with a weight are tracked."""

    marker_weights: Mapping[str, float]
    coordinates: tuple[CoordinateAim, ...] = ()


def read_ik_tasks(path: str | os.PathLike[str]) -> IkTasks:
    """The inverse kinematics tasks of an IKTaskSet file, or of the setup file of a tool that has
    one.
    """
    node = with_included(
        read_document(path, (), "inverse kinematics tasks (IKTaskSet) or a tool's setup")
    )
    if _task_set(node) is None:
        raise node.bad("has no IKTaskSet inside")
    return tasks_of(node)


def tasks_of(node: Node) -> IkTasks:
    """The tasks of an IKTaskSet, or of the first one inside a node; none where there is no such
    set.
    """
    task_set = _task_set(node)
    if task_set is None:
        return IkTasks(FrozenMap({}))
    weights: dict[str, float] = {}
    aims = []
    for element in task_set.iter("IKMarkerTask", "IKCoordinateTask"):
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
    return IkTasks(FrozenMap(weights), tuple(aims))


def _task_set(node: Node) -> etree._Element | None:
    return node.element if node.kind == "IKTaskSet" else next(node.element.iter("IKTaskSet"), None)


def _aim(task: Node, weight: float) -> CoordinateAim:
    kind = task.text("default_value", "value_type").lower()
    if kind == "manual_value":
        return CoordinateAim(
            coordinate=task.name, weight=weight, source="value", value=task.number("value", 0.0)
        )
    return CoordinateAim(task.name, weight, "table" if kind == "from_file" else "default")


def path_of(node: Node, tag: str) -> Path | None:
    """The file that a property names, None where it names none."""
    text = node.text("", tag)
    return None if text in UNASSIGNED else resolved(node, text)


def resolved(node: Node, name: str) -> Path:
    """A path beside the setup file; of a path on somebody's Windows drive, only the name counts
    elsewhere.
    """
    if "\0" in name:
        raise BadFile(node.document.path, f"names the path {name!r}")
    windows = PureWindowsPath(name)
    if windows.drive and os.name != "nt":
        return node.document.path.parent / windows.name
    return node.document.path.parent / name.replace("\\", "/")


def output_of(node: Node, tag: str) -> Path | None:
    """The file that a property wants written, None for none; its ending is checked, as it may come
    from anybody.
    """
    path = path_of(node, tag)
    if path is not None and path.suffix.lower() not in OUTPUTS:
        raise node.bad(
            f"'{tag}' is '{path.name}'",
            f"expected a name ending in {', '.join(OUTPUTS)}",
            node.find(tag),
        )
    return path


def unknown_parts(node: Node, read: Iterable[str]) -> tuple[str, ...]:
    """One line for each part with a content that nothing reads."""
    known = set(read)
    return tuple(
        f"<{element.tag}> of {node.kind} is left out"
        for element in node.element
        if isinstance(element.tag, str) and element.tag not in known and _says_something(element)
    )


def _says_something(element: etree._Element) -> bool:
    if len(element):
        return any(len(objects) for objects in element.iter("objects"))
    return (element.text or "").strip() not in (*UNASSIGNED, "-1", "false")


def read_marker_set(path: str | os.PathLike[str], model: Model) -> tuple[Marker, ...]:
    """The markers of a MarkerSet file, on bodies of `model`."""
    node = read_document(path, ("MarkerSet",), "an OpenSim MarkerSet")
    return tuple({marker.name: _marker(marker, model) for marker in named_markers(node)}.values())


def named_markers(marker_set: Node) -> list[Node]:
    """The markers of a MarkerSet."""
    inside = marker_set.element.find("objects")
    holder = marker_set.element if inside is None else inside
    result = [marker_set.node(element) for element in holder.findall("Marker")]
    for marker in result:
        if not marker.name:
            raise marker.bad("has no name")
    return result


def holder_of(marker: Node) -> str:
    """Name of the body or frame that a marker of a MarkerSet is on."""
    return marker.socket("parent_frame", "body").rstrip("/").rsplit("/", 1)[-1]


def _marker(node: Node, model: Model) -> Marker:
    name = holder_of(node)
    location = node.vector("location")
    places = {frame.name: (frame.body, frame.pose) for frame in model.frames}
    places |= {body: (body, Transform.identity()) for body in (GROUND, *model.body_names)}
    if name not in places:
        raise BadData(
            f"{node.document.path}: marker '{node.name}':"
            f" {UnknownName('body', name, model.body_names)}"
        )
    body, pose = places[name]
    return Marker(
        name=node.name, body=body, location=pose.apply(location), fixed=node.flag("fixed", False)
    )


def write_marker_set(model: Model, path: str | os.PathLike[str]) -> None:
    """Write a model's markers as a MarkerSet file, whole or not at all."""
    root = etree.Element("OpenSimDocument", Version=str(NEWEST))
    objects = child(child(root, "MarkerSet", name=model.name), "objects")
    for marker in model.markers:
        put_marker(objects, marker)
    write_document(root, path)


def put_marker(parent: etree._Element, marker: Marker) -> None:
    """A marker as OpenSim 4 writes it."""
    element = child(parent, "Marker", name=marker.name)
    put(
        element,
        socket_parent_frame=body_path(marker.body),
        location=marker.location,
        fixed=marker.fixed,
    )


def write_scale_set(factors: Mapping[str, Array], path: str | os.PathLike[str]) -> None:
    """Write scale factors (3,) by body as a ScaleSet file, whole or not at all."""
    root = etree.Element("OpenSimDocument", Version=str(NEWEST))
    objects = child(child(root, "ScaleSet", name="ScaleSet"), "objects")
    for body, factor in factors.items():
        put(child(objects, "Scale"), scales=factor, segment=body, apply=True)
    write_document(root, path)


def read_markers(node: Node, frames: Frames) -> list[Marker]:
    """The model's markers, on bodies."""
    markers = []
    for item in node.items("MarkerSet"):
        if item.kind != "Marker":
            continue
        body, pose = frames.place(item.socket("parent_frame", "body"), item)
        markers.append(
            Marker(
                name=item.name,
                body=body,
                location=pose.apply(item.vector("location")),
                fixed=item.flag("fixed", False),
            )
        )
    return markers
