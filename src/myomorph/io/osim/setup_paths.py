"""The files that an OpenSim setup names, and the parts of it that nothing reads."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path, PureWindowsPath

from lxml import etree

from myomorph.io.osim.document import Node
from myomorph.model.errors import BadFile

UNASSIGNED = ("", "Unassigned", "NULL")
OUTPUTS = (".osim", ".mot", ".sto", ".xml")


def path_of(node: Node, tag: str) -> Path | None:
    """The file that a property names, None where it names none."""
    text = node.text("", tag)
    return None if text in UNASSIGNED else resolved(node, text)


def resolved(node: Node, name: str) -> Path:
    """A path beside the setup file; of a path on somebody's Windows drive, only the name counts elsewhere."""
    if "\0" in name:
        raise BadFile(node.document.path, f"names the path {name!r}")
    windows = PureWindowsPath(name)
    if windows.drive and os.name != "nt":
        return node.document.path.parent / windows.name
    return node.document.path.parent / name.replace("\\", "/")


def output_of(node: Node, tag: str) -> Path | None:
    """The file that a property wants written, None for none; its ending is checked, as it may come from anybody.

    Raises
    ------
    BadFile
        The name does not end as OpenSim's files do.
    """
    path = path_of(node, tag)
    if path is not None and path.suffix.lower() not in OUTPUTS:
        raise node.bad(
            f"'{tag}' is '{path.name}'", f"expected a name that ends in {', '.join(OUTPUTS)}", node.find(tag)
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
        return any(len(one) for one in element.iter("objects"))
    return (element.text or "").strip() not in (*UNASSIGNED, "-1", "false")
