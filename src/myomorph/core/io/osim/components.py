"""Parts that stand among a model's components, put where other models have them.

OpenSim 4 lets any part be a component of the model (`Model.addComponent`), outside of BodySet,
JointSet, ForceSet, ConstraintSet and MarkerSet. Such a part has the path `/weight`; in its set it
is `/bodyset/weight`, and so it is named by whatever refers to it.
"""

from __future__ import annotations

import re

from lxml import etree

from myomorph.core.io.osim.actuators import KINDS
from myomorph.core.io.osim.document import Document, Node, child
from myomorph.core.io.osim.kept import EFFECTS
from myomorph.core.io.osim.muscles import is_muscle

FIRST_WITH_COMPONENTS = 30000  # Version of documents.


def gather_components(model: Node) -> None:
    """Move bodies, joints, forces, constraints and markers among the components into their sets.

    Parameters
    ----------
    model : its node, changed in place
    """
    if model.document.version < FIRST_WITH_COMPONENTS:
        return
    moved: dict[str, str] = {}
    for element in model.element.findall("components/*"):
        room = _room(model.node(element))
        name = element.get("name", "")
        if room:
            home = _set(model, room)
            home.append(element)
            owner = home.getparent()
            assert owner is not None
            moved[name] = f"/{(owner.get('name') or room).lower()}/{name}"
    if moved:
        _rename_paths(model.element, moved)


def _room(node: Node) -> str:
    """Return the set that a component belongs to, "" where it has none of its own."""
    if node.kind == "Body":
        return "BodySet"
    if node.kind.endswith("Joint"):
        return "JointSet"
    if node.kind.endswith("Constraint"):
        return "ConstraintSet"
    if node.kind == "Marker":
        return "MarkerSet"
    return "ForceSet" if is_muscle(node) or node.kind in (*KINDS, *EFFECTS) else ""


def _set(model: Node, room: str) -> etree._Element:
    """Find the list of a set's objects, made where the file has none."""
    owner = model.element.find(room)
    if owner is None:
        owner = child(model.element, room, name=room.lower())
    objects = owner.find("objects")
    return child(owner, "objects") if objects is None else objects


def _rename_paths(root: etree._Element, moved: dict[str, str]) -> None:
    """Write new paths of components wherever a text names the old ones.

    Parameters
    ----------
    root : changed in place
    moved : new path by name
    """
    first = re.compile(r"(?<!\S)/([^/\s]+)")

    def renamed(match: re.Match[str]) -> str:
        return moved.get(match[1], match[0])

    for element in root.iter(etree.Element):
        if not len(element) and element.text and "/" in element.text:
            element.text = first.sub(renamed, element.text)


def name_coordinates_apart(model: Node) -> None:
    """Give coordinates of one name in several joints names of their own, with a warning.

    OpenSim 4 distinguishes them by their paths, `/jointset/elbow/rz`. Bare names are the first
    one's.

    Parameters
    ----------
    model : its node, changed in place
    """
    taken: dict[str, str] = {}
    for joint in model.element.findall("JointSet/objects/*"):
        owner = joint.get("name", "")
        for coordinate in joint.iter("Coordinate"):
            name = coordinate.get("name", "")
            if not name or taken.setdefault(name, owner) == owner:
                continue
            number = 0
            while f"{name}_{number}" in taken:
                number += 1
            new_name = f"{name}_{number}"
            taken[new_name] = owner
            coordinate.set("name", new_name)
            _rename_coordinate(model.document, joint, name, new_name)


def _rename_coordinate(document: Document, joint: etree._Element, name: str, new_name: str) -> None:
    """Write a coordinate's new name wherever its joint or a path names it."""
    owner = joint.get("name", "")
    document.warn(
        f"two coordinates are named '{name}': that of joint '{owner}' is called '{new_name}'"
    )
    for words in joint.iter("coordinates"):
        if words.text:
            words.text = " ".join(new_name if word == name else word for word in words.text.split())
    old_path = re.escape(f"{owner}/{name}")
    path = re.compile(rf"(?<![^/\s]){old_path}(?![^/\s])")
    for element in document.root.iter(etree.Element):
        if not len(element) and element.text and "/" in element.text:
            element.text = path.sub(lambda _: f"{owner}/{new_name}", element.text)
