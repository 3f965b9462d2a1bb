"""Segments that words in labels name, where no marker protocol knows them.

Such labels are those of models' bodies, of skeletons of capture programs, and of animals.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from myomorph.core.model.segments import named_segment
from myomorph.core.motion.protocols import Site

OF_MODELS = {"lower_trunk": "pelvis", "upper_trunk": "trunk", "lower_arm": "forearm"}
"""Segments of models by the names that protocols have for them."""
OF_JOINTS = {
    "hip": "thigh",
    "knee": "shank",
    "shin": "shank",
    "ankle": "foot",
    "heel": "foot",
    "met": "foot",
    "mtp": "foot",
    "toe": "foot",
    "paw": "foot",
    "forepaw": "hand",
    "hindpaw": "foot",
    "rasi": "pelvis",
    "lasi": "pelvis",
    "tail": "pelvis",
    "uarm": "upper_arm",
    "farm": "forearm",
}
"""Joints and other words, each with the segment that hangs on it."""
SIDES = {"right": "right", "r": "right", "left": "left", "l": "left"}
MIDDLE = ("pelvis", "trunk", "head")
# `LeftKNEE` is left knee, `LShoulder2` l shoulder.
WORDS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")


def worded_site(label: str) -> Site | None:
    """Segment and side that a label names, None where it names none."""
    words = [word.lower() for word in WORDS.findall(label.split(":")[-1])]
    side = next((SIDES[word] for word in words if word in SIDES), "")
    words = [word for word in words if word not in SIDES]
    segment = next((OF_JOINTS[word] for word in words if word in OF_JOINTS), "")
    if not segment:
        named = named_segment("_".join(words))
        segment = "" if named is None else OF_MODELS.get(named.name, named.name)
    if segment == "thigh" and "hip" in words and not side:
        segment = "pelvis"
    if not segment:
        return None
    return Site(
        segment=segment,
        landmark=" ".join(words),
        side="" if segment in MIDDLE else side,
        key=f"{segment}.{'_'.join(words)}",
        kind="skin",
    )


def worded_sites(labels: Iterable[str]) -> dict[str, Site]:
    """Sites of the labels that name a segment."""
    sites = {label: worded_site(label) for label in labels}
    return {label: site for label, site in sites.items() if site is not None}
