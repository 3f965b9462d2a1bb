"""Parts that OpenSim's setups share: tasks of inverse kinematics, files that they name, sets."""

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
from myomorph.core.model.causes import MODEL
from myomorph.core.model.errors import BadData, BadFile, UnknownName
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, Marker, Model
from myomorph.core.model.spatial import Transform

UNASSIGNED = ("", "Unassigned", "NULL")
OUTPUTS = (".osim", ".mot", ".sto", ".xml")


def with_included(node: Node) -> Node:
    """Fill in the contents of the files that a node's parts name by a `file` attribute.

    Parameters
    ----------
    node : of a setup, which stays as it is

    Returns
    -------
    a node without such attributes

    Raises
    ------
    BadFile : a file cannot be read, holds another object, or names a further file
    """
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
    """A coordinate that inverse kinematics pulls towards a value.

    Attributes
    ----------
    coordinate : its name
    weight : of the squared difference
    source : of the value: the model's default, `value`, or a table of coordinates
    value : [rad or m], of source "value"
    """

    coordinate: str
    weight: float
    source: Literal["default", "value", "table"] = "default"
    value: float = 0.0


@dataclass(frozen=True)
class IkTasks:
    """Weights of markers and of coordinates; only markers with a weight are tracked.

    Attributes
    ----------
    marker_weights : of squared distances, by marker
    coordinates : that are pulled towards values
    """

    marker_weights: Mapping[str, float]
    coordinates: tuple[CoordinateAim, ...] = ()


def read_ik_tasks(path: str | os.PathLike[str]) -> IkTasks:
    """Read the tasks of inverse kinematics from an IKTaskSet file or a tool's setup file.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    weights of markers and coordinates, those switched off left out

    Raises
    ------
    BadFile : it cannot be read, has no IKTaskSet, or a task has no name or a negative weight
    """
    node = with_included(
        read_document(path, (), "inverse kinematics tasks (IKTaskSet) or a tool's setup")
    )
    if _task_set(node) is None:
        raise node.bad("has no IKTaskSet inside")
    return tasks_of(node)


def tasks_of(node: Node) -> IkTasks:
    """Read the tasks of an IKTaskSet, or of the first one inside a node.

    Parameters
    ----------
    node : the set, or an object that has it

    Returns
    -------
    weights of markers and coordinates, none where there is no such set

    Raises
    ------
    BadFile : a task has no name or a negative weight
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
    """Find the element of the IKTaskSet, None where there is none."""
    return node.element if node.kind == "IKTaskSet" else next(node.element.iter("IKTaskSet"), None)


def _aim(task: Node, weight: float) -> CoordinateAim:
    """Read a coordinate's task: towards its default, a value [rad or m] or a table."""
    kind = task.text("default_value", "value_type").lower()
    if kind == "manual_value":
        return CoordinateAim(
            coordinate=task.name, weight=weight, source="value", value=task.number("value", 0.0)
        )
    return CoordinateAim(task.name, weight, "table" if kind == "from_file" else "default")


def path_of(node: Node, tag: str) -> Path | None:
    """Return the file that a property names, None where it names none.

    Parameters
    ----------
    node : of the setup
    tag : of the property

    Returns
    -------
    path in the setup file's folder, if not absolute

    Raises
    ------
    BadFile : the path has a null character
    """
    text = node.text("", tag)
    return None if text in UNASSIGNED else resolved(node, text)


def resolved(node: Node, name: str) -> Path:
    """Resolve a path that a setup file names against the file's folder.

    Of a path on a Windows drive, only the name counts on other systems.

    Parameters
    ----------
    node : of the setup
    name : path as the file has it

    Returns
    -------
    the path

    Raises
    ------
    BadFile : the path has a null character
    """
    if "\0" in name:
        raise BadFile(node.document.path, f"names the path {name!r}")
    windows = PureWindowsPath(name)
    if windows.drive and os.name != "nt":
        return node.document.path.parent / windows.name
    return node.document.path.parent / name.replace("\\", "/")


def output_of(node: Node, tag: str) -> Path | None:
    """Return the file that a property wants written.

    Its ending is checked, as the setup may come from anybody.

    Parameters
    ----------
    node : of the setup
    tag : of the property

    Returns
    -------
    path in the setup file's folder, None where the property names none

    Raises
    ------
    BadFile : its name does not end in one of `OUTPUTS`
    """
    path = path_of(node, tag)
    if path is not None and path.suffix.lower() not in OUTPUTS:
        raise node.bad(
            f"'{tag}' is '{path.name}'",
            f"expected a name ending in {', '.join(OUTPUTS)}",
            node.find(tag),
        )
    return path


def unknown_parts(node: Node, read: Iterable[str]) -> tuple[Message, ...]:
    """List the parts with a content that nothing reads.

    Parameters
    ----------
    node : of the setup
    read : tags that are read

    Returns
    -------
    one line per part
    """
    known = set(read)
    return tuple(
        MODEL.message(f"<{element.tag}> of {node.kind} is left out")
        for element in node.element
        if isinstance(element.tag, str) and element.tag not in known and _says_something(element)
    )


def _says_something(element: etree._Element) -> bool:
    """Return whether an element has objects, or a text other than an unset property's."""
    if len(element):
        return any(len(objects) for objects in element.iter("objects"))
    return (element.text or "").strip() not in (*UNASSIGNED, "-1", "false")


def read_marker_set(path: str | os.PathLike[str], model: Model) -> tuple[Marker, ...]:
    """Read the markers of a MarkerSet file, on bodies of a model.

    Parameters
    ----------
    path : of the file
    model : its bodies and frames carry the markers

    Returns
    -------
    markers with locations (3,) in their bodies [m]; of those with one name the last

    Raises
    ------
    BadFile : it is no such file, or a marker has no name
    BadData : a marker is on no body or frame of the model
    """
    node = read_document(path, ("MarkerSet",), "an OpenSim MarkerSet")
    return tuple({marker.name: _marker(marker, model) for marker in named_markers(node)}.values())


def named_markers(marker_set: Node) -> list[Node]:
    """List the markers of a MarkerSet.

    Parameters
    ----------
    marker_set : node of the set

    Returns
    -------
    nodes of the markers

    Raises
    ------
    BadFile : a marker has no name
    """
    inside = marker_set.element.find("objects")
    holder = marker_set.element if inside is None else inside
    result = [marker_set.node(element) for element in holder.findall("Marker")]
    for marker in result:
        if not marker.name:
            raise marker.bad("has no name")
    return result


def holder_of(marker: Node) -> str:
    """Return the name of the body or frame that a marker of a MarkerSet is on.

    Parameters
    ----------
    marker : its node
    """
    return marker.socket("parent_frame", "body").rstrip("/").rsplit("/", 1)[-1]


def _marker(node: Node, model: Model) -> Marker:
    """Read a marker with its location (3,) in the body [m].

    Raises
    ------
    BadData : the model has no such body or frame
    """
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
    """Write a model's markers as a MarkerSet file, whole or not at all.

    Parameters
    ----------
    model : whose markers
    path : of the new file, replaced where it exists

    Raises
    ------
    BadFile : the file cannot be written
    """
    root = etree.Element("OpenSimDocument", Version=str(NEWEST))
    objects = child(child(root, "MarkerSet", name=model.name), "objects")
    for marker in model.markers:
        put_marker(objects, marker)
    write_document(root, path)


def put_marker(parent: etree._Element, marker: Marker) -> None:
    """Write a marker as OpenSim 4 does.

    Parameters
    ----------
    parent : element that gets it
    marker : to write
    """
    element = child(parent, "Marker", name=marker.name)
    put(
        element,
        socket_parent_frame=body_path(marker.body),
        location=marker.location,
        fixed=marker.fixed,
    )


def write_scale_set(factors: Mapping[str, Array], path: str | os.PathLike[str]) -> None:
    """Write scale factors as a ScaleSet file, whole or not at all.

    Parameters
    ----------
    factors : (3,) along x, y and z of each body, by its name
    path : of the new file, replaced where it exists

    Raises
    ------
    BadFile : the file cannot be written
    """
    root = etree.Element("OpenSimDocument", Version=str(NEWEST))
    objects = child(child(root, "ScaleSet", name="ScaleSet"), "objects")
    for body, factor in factors.items():
        put(child(objects, "Scale"), scales=factor, segment=body, apply=True)
    write_document(root, path)


def read_markers(node: Node, frames: Frames) -> list[Marker]:
    """Read the model's markers, on bodies.

    Parameters
    ----------
    node : of the model
    frames : of the model

    Returns
    -------
    markers with locations (3,) in their bodies [m], in the file's order

    Raises
    ------
    UnknownName : a marker is on a frame that does not exist
    """
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
