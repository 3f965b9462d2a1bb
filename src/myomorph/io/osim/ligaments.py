"""OpenSim's ligaments and path springs: their paths and slack lengths; all else of them is kept as the file has it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from lxml import etree

from myomorph.io.osim.document import Node
from myomorph.io.osim.muscles import PathReader
from myomorph.io.osim.write_forces import write_path
from myomorph.io.osim.write_functions import child, number
from myomorph.model.model import Kept
from myomorph.model.paths import Ligament

SLACK: Mapping[str, str] = MappingProxyType(
    {"Ligament": "resting_length", "Blankevoort1991Ligament": "slack_length", "PathSpring": "resting_length"}
)
"""The length at which each class begins to pull, by the file's name."""


def read_ligaments(forces: Iterable[Node], paths: PathReader) -> tuple[Ligament, ...]:
    """The ligaments among forces that are kept as the file has them."""
    found = [one for one in forces if one.kind in SLACK and one.child("GeometryPath") is not None]
    return tuple(
        Ligament(one.name, one.kind, paths.read(one), one.number(SLACK[one.kind], float("nan"))) for one in found
    )


def put_ligament(part: Kept, element: etree._Element, ligaments: Iterable[Ligament], joints: dict[str, str]) -> None:
    """Give a kept part, about to be written, the path and slack length of the model's ligament of that name.

    Parameters
    ----------
    joints : the joint of each coordinate, as the document names it
    """
    ligament = next((one for one in ligaments if (one.kind, one.name) == (part.kind, part.name)), None)
    if ligament is None:
        return
    before = element.find("GeometryPath")
    if before is not None:
        after = write_path(element, ligament.name, ligament.path, joints, [])
        look = before.find("Appearance")
        if look is not None:
            after.append(look)
        element.replace(before, after)
    if ligament.slack_length == ligament.slack_length:
        tag = SLACK[ligament.kind]
        slack = element.find(tag)
        slack = child(element, tag) if slack is None else slack
        slack.text = number(ligament.slack_length)
