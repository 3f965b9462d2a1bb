"""Anatomical segments that bodies belong to, as tables of segment masses name them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.sides import split_side

SEGMENTS = (
    "head",
    "upper_trunk",
    "lower_trunk",
    "upper_arm",
    "lower_arm",
    "hand",
    "thigh",
    "shank",
    "foot",
)
"""Segments of tables 3.4 and 3.5 of [D], whose "body" is the upper and the lower trunk."""
_PATTERNS = (
    ("head", r"head|neck|skull|cervical|jaw|mandible|hyoid|^c[1-7]$"),
    (
        "hand",
        r"hand|wrist|carp|meta?carp|finger|thumb|lunate|scaphoid|pisiform|triquetrum|capitate"
        r"|trapez|hamate|[1-5]?(prox|mid|dist)ph|(first|second|third|fourth|fifth)mc|phalan",
    ),
    ("foot", r"foot|feet|talus|calcn|calcaneus|toe|tars|midfoot|forefoot"),
    ("shank", r"tibia|shank|fibula|patella|kneecap|lower_?leg"),
    ("thigh", r"femur|thigh|upper_?leg"),
    ("lower_arm", r"ulna|radius|fore_?arm|lower_?arm"),
    ("upper_arm", r"humer|hum?phant|upper_?arm"),
    ("lower_trunk", r"pelvis|sacrum|lumbar|abd(omen)?(_|$)|hips?$|ilium|coccyx|^l[1-5]$|full.body"),
    (
        "upper_trunk",
        r"torso|trunk|thora|rib|sternum|clav|scap|chest|spine|back|shoulder|^t(1[0-2]?|[2-9])$",
    ),
)
JOINT_WORDS = (
    "hip",
    "knee",
    "ankle",
    "subtalar",
    "mtp",
    "patellofemoral",
    "tibiofemoral",
    "talocrural",
    "midtarsal",
    "lumbar",
    "back",
    "neck",
    "shoulder",
    "glenohumeral",
    "acromial",
    "acromioclavicular",
    "sternoclavicular",
    "scapulothoracic",
    "elbow",
    "humeroulnar",
    "radioulnar",
    "wrist",
    "radiocarpal",
)
"""Words for joints that names of joints, coordinates and bodies hold."""


@dataclass(frozen=True)
class Segment:
    """A part of the body.

    Attributes
    ----------
    name : one of `SEGMENTS`
    side : "right", "left", or "" in the middle
    """

    name: str
    side: str = ""


def segments_of(model: Model, stated: Mapping[str, Segment] | None = None) -> Mapping[str, Segment]:
    """Find the segment of every body of a human model, by the bodies' names.

    A body whose name says nothing (a massless one between two joints) belongs with its parent; one
    on the ground, with its child.

    Parameters
    ----------
    model : of a human body
    stated : segments that go before the names, by body

    Raises
    ------
    BadData : no body is named like a segment
    UnknownName : `stated` has a body or segment that does not exist
    """
    segments: dict[str, Segment] = {}
    for body, segment in (stated or {}).items():
        check_name("body", body, model.body_names)
        check_name("segment", segment.name, SEGMENTS, "the table of segments")
        segments[body] = segment
    parents = {joint.child: joint.parent for joint in model.joints}
    for body in model.body_names:
        named = segments.get(body) or named_segment(body)
        if named is None and parents[body] in segments:
            named = segments[parents[body]]
        if named is not None:
            segments[body] = named
    if not segments:
        raise BadData(
            f"no body of model '{model.name}' is named like a segment of the human body:"
            f" {model.body_names}"
        )
    for body in reversed(model.body_names):
        if body in segments and parents[body] not in (GROUND, *segments):
            segments[parents[body]] = segments[body]
    return FrozenMap(
        {body: segments.get(body, Segment("lower_trunk")) for body in model.body_names}
    )


def segments_if_human(model: Model) -> Mapping[str, Segment]:
    """Find `segments_of`, none for a model without human segments."""
    try:
        return segments_of(model)
    except BadData:
        return {}


def feet_of(model: Model) -> tuple[str, ...]:
    """Find the bodies that stand on the ground by their names.

    Heel bones, else feet, else tarsi; () where there are none.
    """
    for word in ("calcn", "calcaneus", "hindfoot", "foot"):
        result = tuple(name for name in model.body_names if word in name.lower())
        if result:
            return result
    # Skeletons of animals: the tarsus as a whole, but neither metatarsals nor bodies between two
    # joints.
    return tuple(
        name
        for name in model.body_names
        if split_side(name.rsplit("__", 1)[-1])[0].lower() == "tarsus"
    )


def named_segment(body: str) -> Segment | None:
    """Find the segment and side in a name, `femur_r` or `Left Shank`; None where it has none."""
    base, side = split_side(body.rsplit("__", 1)[-1])
    for segment, pattern in _PATTERNS:
        if re.search(pattern, base, re.IGNORECASE):
            trunk = segment in ("head", "upper_trunk", "lower_trunk")
            return Segment(segment, "" if trunk else side)
    return None


def joint_labels(model: Model) -> Mapping[str, str]:
    """Give every joint a plain name, by the model's name of it.

    `knee_r` for `walker_knee_r` and for `tibia_r` that turns by `knee_angle_r`: the word for the
    joint in its name, else in that of one of its coordinates, with its side; else its child body.
    Joints that would share a name keep the model's.
    """
    labels = {}
    for joint in model.joints:
        words = (_joint_word(name) for name in (joint.name, *joint.coordinates))
        labels[joint.name] = next((word for word in words if word), joint.child)
    shared = Counter(labels.values())
    return FrozenMap(
        {name: label if shared[label] == 1 else name for name, label in labels.items()}
    )


def _joint_word(name: str) -> str:
    """Word for a joint in a name, with its side, "" where there is none."""
    base, side = split_side(name)
    words = base.lower().split("_")
    word = next((word for word in words if word in JOINT_WORDS), "")
    return f"{word}_{side[0]}" if word and side else word
