"""Parts of an OpenSim setup that stand in files of their own: `<IKTaskSet file="tasks.xml"/>`."""

from __future__ import annotations

import copy

from myomorph.io.osim.document import Node, read_document
from myomorph.io.osim.setup_paths import resolved


def with_included(node: Node) -> Node:
    """The node with the contents of the files that its parts name by a `file` attribute.

    Raises
    ------
    BadFile
        A file is absent or holds another part, or files include each other.
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
