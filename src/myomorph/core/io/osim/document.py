"""An OpenSim document as typed properties, and elements to write.

Versions, defaults sections and component paths are looked after here.
"""

from __future__ import annotations

import os
import posixpath
import re
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import ArrayLike

from myomorph.core.io.parsing.text import whole_number, written
from myomorph.core.io.parsing.xml import read_xml, with_colons
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import MODEL
from myomorph.core.model.errors import BadFile
from myomorph.core.model.messages import Message, Severity
from myomorph.core.model.spatial import Transform

OLDEST = 10901
NEWEST = 40600
RENAMED = {
    "NaturalCubicSpline": "SimmSpline",
    "natCubicSpline": "SimmSpline",
    "MuscleWrap": "PathWrap",
    "MusclePoint": "PathPoint",
    "MuscleViaPoint": "ConditionalPathPoint",
    "MovingMusclePoint": "MovingPathPoint",
    "GeneralizedForce": "CoordinateActuator",
    "Schutte1993Muscle": "Schutte1993Muscle_Deprecated",
    "Delp1990Muscle": "Delp1990Muscle_Deprecated",
}
NUMBER = re.compile(r"[\s,()\[\]~]+")
INFINITE = {
    "inf": np.inf,
    "+inf": np.inf,
    "-inf": -np.inf,
    "infinity": np.inf,
    "-infinity": -np.inf,
}


@dataclass(frozen=True, eq=False)
class Document:
    """Facts and warnings that all parts of one file share.

    Attributes
    ----------
    path : of the file
    version : five or six digits, 40000 for OpenSim 4.0
    root : element that holds the object
    defaults : by class, the element of the file's defaults section
    warnings : filled while reading, one line each
    """

    path: Path
    version: int
    root: etree._Element
    defaults: dict[str, etree._Element] = field(default_factory=dict)
    warnings: list[Message] = field(default_factory=list)

    def warn(self, line: str, severity: Severity | None = None) -> None:
        """Add a warning, once.

        Parameters
        ----------
        line : of text
        severity : of it, None for that of what a model's file holds
        """
        if line not in self.warnings:
            known = line if isinstance(line, Message) else MODEL.message(line, severity=severity)
            self.warnings.append(known)


@dataclass(frozen=True, eq=False)
class Node:
    """One object of the file: its properties, else those of the defaults section.

    Attributes
    ----------
    element : of the object
    document : that it is part of
    path : component path as OpenSim 4 would write it ("/jointset/hip_r")
    """

    element: etree._Element
    document: Document
    path: str = ""

    @property
    def kind(self) -> str:
        """Class name in today's spelling."""
        tag = str(self.element.tag)
        return RENAMED.get(tag, tag)

    @cached_property
    def name(self) -> str:
        """Name attribute, without the blanks that OpenSim 4 takes out of old names."""
        name = str(self.element.get("name", "")).strip()
        return re.sub(r"\s+", "", name) if self.document.version < 30500 else name

    def find(self, *tags: str) -> etree._Element | None:
        """Find the first child element of one of the tags, or the defaults section's.

        Parameters
        ----------
        tags : in order of preference

        Returns
        -------
        the element, None where neither has one
        """
        for tag in tags:
            result = self.element.find(tag)
            if result is not None:
                return result
        default = self.document.defaults.get(self.kind)
        if default is None or default is self.element:
            return None
        return next((result for tag in tags if (result := default.find(tag)) is not None), None)

    def child(self, *tags: str) -> Node | None:
        """Find the first child of one of the tags as a node.

        Parameters
        ----------
        tags : in order of preference

        Returns
        -------
        the child, or the defaults section's; None where neither has one
        """
        element = self.find(*tags)
        return None if element is None else self.node(element)

    def inner(self, *tags: str) -> Node | None:
        """Find the object inside a property: in `<function><Sine/></function>` the Sine.

        Parameters
        ----------
        tags : of the property, in order of preference

        Returns
        -------
        the first object inside, None where there is none
        """
        holder = self.find(*tags)
        if holder is None:
            return None
        return next(
            (self.node(element) for element in holder if isinstance(element.tag, str)), None
        )

    def node(self, element: etree._Element) -> Node:
        """Wrap a child element as a node.

        Parameters
        ----------
        element : inside this one

        Returns
        -------
        the node, with its component path
        """
        name = element.get("name", "")
        return Node(element, self.document, f"{self.path}/{name}" if name else self.path)

    def items(self, tag: str) -> list[Node]:
        """List the objects of a set (`<tag><objects>...`) or of a list property (`<tag>...`).

        Parameters
        ----------
        tag : of the set or property

        Returns
        -------
        the objects in the file's order, with their component paths; none where the set is absent
        """
        owner_element = self.find(tag)
        if owner_element is None:
            return []
        inside = owner_element.find("objects")
        holder = owner_element if inside is None else inside
        path = (
            self.path
            if inside is None
            else f"{self.path}/{(owner_element.get('name') or tag).lower()}"
        )
        owner = Node(self.element, self.document, path)
        return [owner.node(element) for element in holder if isinstance(element.tag, str)]

    def words(self, *tags: str) -> list[str]:
        """Read a property that is a list of names.

        Parameters
        ----------
        tags : in order of preference

        Returns
        -------
        the names, none where the property is absent
        """
        return self.text("", *tags).split()

    def text(self, default: str, *tags: str) -> str:
        """Read a property that is a text.

        Parameters
        ----------
        default : value where the property is absent
        tags : in order of preference

        Returns
        -------
        the text without blanks around
        """
        element = self.find(*tags)
        return default if element is None else (element.text or "").strip()

    def flag(self, tag: str, default: bool) -> bool:
        """Read a property that is true or false.

        Parameters
        ----------
        tag : of the property
        default : value where it is absent or empty

        Raises
        ------
        BadFile : it is another text
        """
        text = self.text("", tag).lower()
        if text in ("true", "1", "false", "0"):
            return text in ("true", "1")
        if text:
            raise self.bad(f"'{tag}' is '{text}'", "expected true or false")
        return default

    @property
    def is_applied(self) -> bool:
        """Whether a force is switched on, in any version's spelling."""
        return self.flag("appliesForce", not self.flag("isDisabled", False))

    def number(self, tag: str, default: float, infinite: bool = False) -> float:
        """Read a property that is one number.

        Parameters
        ----------
        tag : of the property
        default : value where it is absent or empty
        infinite : whether it may be infinite

        Returns
        -------
        the number in the file's unit

        Raises
        ------
        BadFile : it is no number, several, NaN, or infinite where it may not be
        """
        values = self.numbers(tag, None, infinite)
        if values is None or not len(values):
            return default
        if len(values) > 1:
            raise self.bad(f"'{tag}' has {len(values)} numbers", "expected one")
        return float(values[0])

    def vector(
        self, tag: str, default: tuple[float, ...] = (0.0, 0.0, 0.0), infinite: bool = False
    ) -> Array:
        """Read a property of as many numbers as its default.

        Parameters
        ----------
        tag : of the property
        default : value where it is absent or empty
        infinite : whether numbers may be infinite

        Returns
        -------
        (numbers,) in the file's unit

        Raises
        ------
        BadFile : it has more or fewer numbers, or some that are not allowed
        """
        values = self.numbers(tag, None, infinite)
        if values is None or not len(values):
            return np.array(default)
        if len(values) != len(default):
            raise self.bad(f"'{tag}' has {len(values)} numbers", f"expected {len(default)}")
        return values

    def pose(self, turn: str, place: str) -> Transform:
        """Read a pose from two properties, zero where they are absent.

        Parameters
        ----------
        turn : property of body-fixed X, Y, Z angles [rad]
        place : property of the position [m]

        Returns
        -------
        the transform from the frame to its parent

        Raises
        ------
        BadFile : one of the properties is not of three finite numbers
        """
        return Transform.from_euler_xyz(self.vector(turn), self.vector(place))

    def numbers(
        self, tag: str, default: Array | None = None, infinite: bool = False
    ) -> Array | None:
        """Read a property that is a list of numbers.

        Parameters
        ----------
        tag : of the property
        default : value where it is absent
        infinite : whether numbers may be infinite

        Returns
        -------
        (numbers,) in the file's unit, empty for an empty property

        Raises
        ------
        BadFile : one is no number, NaN, or infinite where it may not be
        """
        element = self.find(tag)
        if element is None:
            return default
        parts = [part for part in NUMBER.split(element.text or "") if part]
        try:
            values = np.array([INFINITE.get(part.lower()) or float(part) for part in parts])
        except ValueError:
            raise self.bad(
                f"'{tag}' is '{(element.text or '').strip()[:60]}'", "expected numbers", element
            ) from None
        if np.isnan(values).any() or not (infinite or np.isfinite(values).all()):
            raise self.bad(
                f"'{tag}' is '{(element.text or '').strip()[:60]}'",
                "expected finite numbers",
                element,
            )
        return values

    def socket(self, name: str, *old: str) -> str:
        """Read which object a socket is connected to, in any version's spelling.

        Parameters
        ----------
        name : of the socket
        old : properties that named the object in older versions

        Returns
        -------
        path or name of the object as the file has it; "" if the socket is not connected
        """
        tags = [
            f"socket_{name}",
            f"socket_{name}_connectee_name",
            f"connector_{name}_connectee_name",
            name,
            *old,
        ]
        text = self.text("", *tags)
        if text:
            return text
        for connector in self.element.findall("connectors/*"):
            if connector.get("name") in (name, *old):
                return (connector.findtext("connectee_name") or "").strip()
        return ""

    def bad(
        self, problem: str, expected: str = "", element: etree._Element | None = None
    ) -> BadFile:
        """Make the error that states where in the file this object stands.

        Parameters
        ----------
        problem : what is wrong
        expected : what would be right
        element : whose line is named, this object's by default

        Returns
        -------
        the error, to be raised
        """
        line = (self.element if element is None else element).sourceline
        where = f"{self.kind} '{self.name}'" if self.name else self.kind
        return BadFile(self.document.path, f"line {line}: {where}: {problem}", expected)

    def source(self) -> str:
        """Return the text of the object as the file has it."""
        return str(etree.tostring(self.element, encoding="unicode", with_tail=False))


def read_document(path: str | os.PathLike[str], wanted: tuple[str, ...], what: str) -> Node:
    """Read the object that an OpenSim file holds.

    Parameters
    ----------
    path : of the file
    wanted : classes of which the object may be, () for any
    what : was expected, for the message

    Returns
    -------
    the object, with the file's version, defaults sections and warnings

    Raises
    ------
    BadFile : it cannot be read, is no XML, has a version that is no number, or holds another object
    """
    file = read_xml(path)
    root = file.root
    data = root
    version = 10500
    if root.tag == "OpenSimDocument":
        text = root.get("Version", "")
        stated = whole_number(text)
        if stated is None:
            raise BadFile(
                path, f"OpenSimDocument Version is '{text}'", "expected a number such as 40000"
            )
        version = stated
        data = next((element for element in root if isinstance(element.tag, str)), root)
    if wanted and data.tag not in wanted:
        raise BadFile(path, f"holds <{data.tag}>", f"expected {what}")
    defaults: dict[str, etree._Element] = {}
    for section in (*data.findall("defaults"), *root.findall("defaults")):
        for element in section:
            defaults.setdefault(RENAMED.get(str(element.tag), str(element.tag)), element)
    document = Document(
        path=file.path, version=version, root=data, defaults=defaults, warnings=list(file.warnings)
    )
    return Node(data, document, "")


def joined(owner: str, path: str) -> str:
    """Make a component path absolute, as seen from a component.

    Parameters
    ----------
    owner : absolute path of the component
    path : relative to it, or absolute
    """
    return posixpath.normpath(path if path.startswith("/") else posixpath.join(owner or "/", path))


def number(value: float) -> str:
    """Write a number as the shortest text that reads back as the same number.

    Parameters
    ----------
    value : may be infinite
    """
    if np.isinf(value):
        return "Inf" if value > 0 else "-Inf"
    return repr(float(value))


def numbers(values: ArrayLike) -> str:
    """Write numbers with blanks between.

    Parameters
    ----------
    values : of any shape, flattened row by row

    Returns
    -------
    the text
    """
    return " ".join(number(value) for value in np.ravel(np.asarray(values, dtype=np.float64)))


def legal(name: str) -> str:
    """Replace characters that OpenSim 4 refuses in a name by underscores.

    Parameters
    ----------
    name : of a component
    """
    return re.sub(r"[\\*+\s/]", "_", name)


def child(parent: etree._Element, tag: str, text: str = "", name: str = "") -> etree._Element:
    """Add an element to a parent.

    Parameters
    ----------
    parent : gets the element as its last child
    tag : of the element
    text : inside it
    name : attribute, made legal; "" for none

    Returns
    -------
    the new element
    """
    element = etree.SubElement(parent, tag, {"name": legal(name)} if name else {})
    if text:
        element.text = text
    return element


def put(parent: etree._Element, **properties: str | bool | ArrayLike) -> None:
    """Add properties to an object, in this order.

    Parameters
    ----------
    parent : the object
    properties : texts, truths, numbers, or lists of numbers by name
    """
    for tag, value in properties.items():
        if isinstance(value, bool):
            value = str(value).lower()
        child(parent, tag, value if isinstance(value, str) else numbers(value))


def write_document(root: etree._Element, path: str | os.PathLike[str]) -> None:
    """Write a document with tabs, whole or not at all.

    Parameters
    ----------
    root : outermost element, which is indented in place
    path : of the new file, replaced where it exists

    Raises
    ------
    BadFile : the file cannot be written
    """
    etree.indent(root, space="\t")
    text = with_colons(etree.tostring(root, encoding="unicode"))
    with written(path) as stream:
        stream.write(f'<?xml version="1.0" encoding="UTF-8" ?>\n{text}\n')
