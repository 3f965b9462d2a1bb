"""OpenSim's markers, in models and in files of their own, and files of scale factors."""

from __future__ import annotations

import os
from collections.abc import Mapping

from lxml import etree

from myomorph.io.osim.document import NEWEST, Node, child, put, read_document, write_document
from myomorph.io.osim.frames import Frames, body_path
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, UnknownName
from myomorph.model.model import GROUND, Marker, Model
from myomorph.model.spatial import Transform


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
        raise BadData(f"{node.document.path}: marker '{node.name}': {UnknownName('body', name, model.body_names)}")
    body, pose = places[name]
    return Marker(node.name, body, pose.apply(location), node.flag("fixed", False))


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
    put(element, socket_parent_frame=body_path(marker.body), location=marker.location, fixed=marker.fixed)


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
        markers.append(Marker(item.name, body, pose.apply(item.vector("location")), item.flag("fixed", False)))
    return markers
