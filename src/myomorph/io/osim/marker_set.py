"""Marker sets and scale factors in OpenSim's own files."""

from __future__ import annotations

import os
from collections.abc import Mapping

from lxml import etree

from myomorph.io.osim.document import NEWEST, Node, read_document
from myomorph.io.osim.write_functions import child, numbers
from myomorph.io.osim.write_joints import body_path
from myomorph.io.parsing.text import written
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, UnknownName
from myomorph.model.model import GROUND, Marker, Model
from myomorph.model.spatial import Transform


def read_marker_set(path: str | os.PathLike[str], model: Model) -> tuple[Marker, ...]:
    """The markers of a MarkerSet file, on bodies of `model`.

    Raises
    ------
    BadFile
        The file holds no MarkerSet, or a marker without a name.
    UnknownName
        A marker is on a body or frame that the model does not have.
    """
    node = read_document(path, ("MarkerSet",), "an OpenSim MarkerSet")
    inside = node.element.find("objects")
    holder = node.element if inside is None else inside
    found: dict[str, Marker] = {}
    for element in holder.findall("Marker"):
        marker = node.node(element)
        if not marker.name:
            raise marker.bad("has no name")
        found[marker.name] = _marker(marker, model)
    return tuple(found.values())


def _marker(node: Node, model: Model) -> Marker:
    name = node.socket("parent_frame", "body").rstrip("/").rsplit("/", 1)[-1]
    location = node.vector("location", (0.0, 0.0, 0.0))
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
    _write(root, path)


def put_marker(parent: etree._Element, marker: Marker) -> None:
    """A marker as OpenSim 4 writes it."""
    element = child(parent, "Marker", name=marker.name)
    child(element, "socket_parent_frame", body_path(marker.body))
    child(element, "location", numbers(marker.location))
    child(element, "fixed", str(marker.fixed).lower())


def write_scale_set(factors: Mapping[str, Array], path: str | os.PathLike[str]) -> None:
    """Write scale factors (3,) by body as a ScaleSet file, whole or not at all."""
    root = etree.Element("OpenSimDocument", Version=str(NEWEST))
    objects = child(child(root, "ScaleSet", name="ScaleSet"), "objects")
    for body, factor in factors.items():
        element = child(objects, "Scale")
        child(element, "scales", numbers(factor))
        child(element, "segment", body)
        child(element, "apply", "true")
    _write(root, path)


def _write(root: etree._Element, path: str | os.PathLike[str]) -> None:
    etree.indent(root, space="\t")
    with written(path) as stream:
        stream.write('<?xml version="1.0" encoding="UTF-8" ?>\n')
        stream.write(etree.tostring(root, encoding="unicode"))
        stream.write("\n")
