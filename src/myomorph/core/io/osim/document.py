"""An OpenSim document as typed properties: versions, defaults sections and component paths; and
elements to write.
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

from myomorph.core.io.parsing.text import written
from myomorph.core.io.parsing.xml import read_xml
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadFile
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
    """What all parts of one file share."""

    path: Path
    version: int  # five or six digits, 40000 for OpenSim 4.0
    root: etree._Element
    # by class, the element of the file's defaults section
    defaults: dict[str, etree._Element] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)  # filled while reading, one line each

    def warn(self, line: str) -> None:
        """Remember a warning once."""
        if line not in self.warnings:
            self.warnings.append(line)


@dataclass(frozen=True, eq=False)
class Node:
    """One object of the file: its properties, those of the defaults section where it has none
    itself.
    """

    element: etree._Element
    document: Document
    path: str = ""  # component path as OpenSim 4 would write it ("/jointset/hip_r")

    @property
    def kind(self) -> str:
        """Class name in today's spelling."""
        tag = str(self.element.tag)
        return RENAMED.get(tag, tag)

    @cached_property
    def name(self) -> str:
        """The name attribute, without the blanks that OpenSim 4 takes out of old names."""
        name = str(self.element.get("name", "")).strip()
        return re.sub(r"\s+", "", name) if self.document.version < 30500 else name

    def find(self, *tags: str) -> etree._Element | None:
        """First child element of one of the tags, or the defaults section's."""
        for tag in tags:
            result = self.element.find(tag)
            if result is not None:
                return result
        default = self.document.defaults.get(self.kind)
        if default is None or default is self.element:
            return None
        return next((result for tag in tags if (result := default.find(tag)) is not None), None)

    def child(self, *tags: str) -> Node | None:
        """First child of one of the tags as a node."""
        element = self.find(*tags)
        return None if element is None else self.node(element)

    def inner(self, *tags: str) -> Node | None:
        """The object inside a property: `<function><Constant/></function>` gives the Constant."""
        holder = self.find(*tags)
        if holder is None:
            return None
        return next(
            (self.node(element) for element in holder if isinstance(element.tag, str)), None
        )

    def node(self, element: etree._Element) -> Node:
        """A child element as a node, with its component path."""
        name = element.get("name", "")
        return Node(element, self.document, f"{self.path}/{name}" if name else self.path)

    def items(self, tag: str) -> list[Node]:
        """Objects of a set (`<tag><objects>...`) or of a list property (`<tag>...`)."""
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
        """A property that is a list of names."""
        return self.text("", *tags).split()

    def text(self, default: str, *tags: str) -> str:
        """A property that is a text."""
        element = self.find(*tags)
        return default if element is None else (element.text or "").strip()

    def flag(self, tag: str, default: bool) -> bool:
        """A property that is true or false."""
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
        """A property that is one number."""
        values = self.numbers(tag, None, infinite)
        if values is None or not len(values):
            return default
        if len(values) > 1:
            raise self.bad(f"'{tag}' has {len(values)} numbers", "expected one")
        return float(values[0])

    def vector(
        self, tag: str, default: tuple[float, ...] = (0.0, 0.0, 0.0), infinite: bool = False
    ) -> Array:
        """A property of as many numbers as its default."""
        values = self.numbers(tag, None, infinite)
        if values is None or not len(values):
            return np.array(default)
        if len(values) != len(default):
            raise self.bad(f"'{tag}' has {len(values)} numbers", f"expected {len(default)}")
        return values

    def pose(self, turn: str, place: str) -> Transform:
        """A pose by two properties: body-fixed X, Y, Z angles [rad] and a position [m], zero where
        they are absent.
        """
        return Transform.from_euler_xyz(self.vector(turn), self.vector(place))

    def numbers(
        self, tag: str, default: Array | None = None, infinite: bool = False
    ) -> Array | None:
        """A property that is a list of numbers."""
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
        """What a socket is connected to, in any version's spelling; "" if to nothing."""
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
        """The error that says where in the file this object stands."""
        line = (self.element if element is None else element).sourceline
        where = f"{self.kind} '{self.name}'" if self.name else self.kind
        return BadFile(self.document.path, f"line {line}: {where}: {problem}", expected)

    def source(self) -> str:
        """The object as the file has it."""
        return str(etree.tostring(self.element, encoding="unicode", with_tail=False))


def read_document(path: str | os.PathLike[str], wanted: tuple[str, ...], what: str) -> Node:
    """The object of one of the classes `wanted` (of any, where that is empty) that an OpenSim file
    holds.
    """
    file = read_xml(path)
    root = file.root
    data = root
    version = 10500
    if root.tag == "OpenSimDocument":
        text = root.get("Version", "")
        if not text.isdigit():
            raise BadFile(
                path, f"OpenSimDocument Version is '{text}'", "expected a number such as 40000"
            )
        version = int(text)
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
    """A component path made absolute, seen from the component `owner`."""
    return posixpath.normpath(path if path.startswith("/") else posixpath.join(owner or "/", path))


def number(value: float) -> str:
    """Shortest text that reads back as the same number."""
    if np.isinf(value):
        return "Inf" if value > 0 else "-Inf"
    return repr(float(value))


def numbers(values: ArrayLike) -> str:
    """Numbers with blanks between."""
    return " ".join(number(value) for value in np.ravel(np.asarray(values, dtype=np.float64)))


def legal(name: str) -> str:
    """A name without the characters that OpenSim 4 refuses in one."""
    return re.sub(r"[\\*+\s/]", "_", name)


def child(parent: etree._Element, tag: str, text: str = "", name: str = "") -> etree._Element:
    """A new element inside `parent`."""
    element = etree.SubElement(parent, tag, {"name": legal(name)} if name else {})
    if text:
        element.text = text
    return element


def put(parent: etree._Element, **properties: str | bool | ArrayLike) -> None:
    """Properties of an object, in this order: texts, truths, numbers, or lists of numbers."""
    for tag, value in properties.items():
        if isinstance(value, bool):
            value = str(value).lower()
        child(parent, tag, value if isinstance(value, str) else numbers(value))


def write_document(root: etree._Element, path: str | os.PathLike[str]) -> None:
    """Write a document with tabs, whole or not at all."""
    etree.indent(root, space="\t")
    text = etree.tostring(root, encoding="unicode")
    with written(path) as stream:
        stream.write(f'<?xml version="1.0" encoding="UTF-8" ?>\n{text}\n')
