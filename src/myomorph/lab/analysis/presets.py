"""Presets of analysis for each kind of motion: its muscles and phases.

How models spell the muscles stands here too.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from myomorph.core.model.errors import check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.movement import Movement
from myomorph.core.model.segments import Segment
from myomorph.core.model.sides import split_side
from myomorph.lab.analysis.selection import MAJOR_MUSCLES, SIDES, Pair, spelled, with_right

_UPPER = (
    ("Deltoid, anterior", r"(delt(oid)?_?(ant(erior)?|clav\w*|1)|delt1)"),
    (
        "Deltoid, posterior",
        r"(delt(oid)?_?(post(erior)?|3)|delt3|delt(oideus)?_?scap(ula)?_?(post)?\w*)",
    ),
    ("Biceps brachii, long head", r"(bic_?(brachii_?)?l(ong|h)|biclong|bic_l|biceps_?(lh|long))"),
    ("Triceps brachii, lateral head", r"(tri_?lat|triceps_?lat(eral)?|tri_?lt)"),
    ("Brachioradialis", r"(brd|brachiorad(ialis)?|brachrad)"),
    ("Trapezius", r"(trap(ezius)?(_\w+)?|trp\d*)"),
    ("Latissimus dorsi", r"(lat(issimus)?_?dorsi\w*|ld_\w+|lat\d)"),
    ("External oblique", r"(ext_?obl\w*|eo_?\d+|e[o0]_r\d+|extobl)"),
    ("Erector spinae", r"(erc?_?spn\w*|erector_?spinae\w*|il_[lr]\d+|ltp[tl]_[rtl]\d+)"),
)
MUSCLES: Mapping[str, str] = FrozenMap({**dict(_UPPER), **dict(MAJOR_MUSCLES)})
"""Name in print to the spellings of models of the leg, the arm, the trunk and the whole body."""


def named_muscles(
    names: Sequence[str], wanted: Sequence[str], prefix: str = ""
) -> tuple[tuple[Pair, ...], tuple[str, ...]]:
    """Find the wanted muscles of a model, right and left together, and those that it lacks.

    Parts of one muscle are members of one pair.

    Parameters
    ----------
    names : of the model's muscles
    wanted : of `MUSCLES` or of the model
    prefix : that one subject's names begin with
    """
    bare = {name: split_side(name.removeprefix(prefix).rsplit("__", 1)[-1]) for name in names}
    pairs = []
    lacking = []
    for label in wanted:
        members = with_right(spelled(bare, MUSCLES.get(label) or re.escape(split_side(label)[0])))
        if members:
            pairs.append(Pair(label, {side: members[side] for side in SIDES if side in members}))
        else:
            lacking.append(label)
    return tuple(pairs), tuple(lacking)


def segment_words(segment: Segment) -> str:
    """Write a segment with its side: "left forearm"."""
    return f"{segment.side} {plain_words(segment.name)}".strip()


def plain_words(name: str) -> str:
    """Write the name of a segment in words: "forearm"."""
    return name.replace("lower_arm", "forearm").replace("_", " ")


Cut = Literal["events", "contacts", "cycles", "parts"]

CUTS: tuple[Cut, ...] = ("events", "contacts", "cycles", "parts")
"""Every way to cut a motion: between events, where the contact state changes, by the period of the
center of gravity, into four equal parts.
"""


@dataclass(frozen=True)
class Preset:
    """Which muscles and phases the analysis of one kind of motion has."""

    name: str  # as study files and the command line say it
    title: str  # in print
    muscles: tuple[str, ...]  # of `MUSCLES`, from top to bottom
    cuts: tuple[Cut, ...]  # of `CUTS`, the first that cuts the motion at all is taken
    pictures: int = 9  # in the strip

    def __post_init__(self) -> None:
        for kind, names, known in (
            ("muscle", self.muscles, tuple(MUSCLES)),
            ("cut", self.cuts, CUTS),
        ):
            for name in names:
                check_name(kind, name, known, f"the preset '{self.name}': the report")


_ARM = (
    "Deltoid, anterior",
    "Deltoid, posterior",
    "Biceps brachii, long head",
    "Triceps brachii, lateral head",
)
_LEG = (
    "Rectus femoris",
    "Biceps femoris, long head",
    "Tibialis anterior",
    "Gastrocnemius, lateral",
)
_WALK = (
    "Gluteus maximus",
    "Gluteus medius",
    "Rectus femoris",
    "Vastus lateralis",
    "Biceps femoris, long head",
    "Gastrocnemius, lateral",
    "Soleus",
    "Tibialis anterior",
)
_TAP = (*_ARM, "Trapezius", "Gluteus maximus", *_LEG)
_DRUM = (
    *_ARM,
    "Brachioradialis",
    "External oblique",
    "Tibialis anterior",
    "Gastrocnemius, lateral",
)
_JUDO = (
    *_ARM,
    "Trapezius",
    "Latissimus dorsi",
    "External oblique",
    "Erector spinae",
    "Gluteus maximus",
    *_LEG,
)
_LIFT = (
    "Deltoid, anterior",
    "Biceps brachii, long head",
    "Trapezius",
    "Latissimus dorsi",
    "Erector spinae",
    "External oblique",
    "Gluteus maximus",
    "Rectus femoris",
    "Vastus lateralis",
    "Biceps femoris, long head",
)
_GENERAL = (
    *_ARM,
    "Trapezius",
    "Erector spinae",
    "Gluteus maximus",
    *_LEG[:1],
    "Vastus lateralis",
    *_LEG[1:],
)
_ALL = (
    Preset(
        name="taichi",
        title="Tai Chi",
        muscles=(*_ARM, *_LEG),
        cuts=("cycles", "contacts", "parts"),
        pictures=10,
    ),
    Preset(
        name="tap", title="Tap dance", muscles=_TAP, cuts=("events", "cycles", "parts"), pictures=10
    ),
    Preset(name="drum", title="Drum playing", muscles=_DRUM, cuts=("events", "cycles", "parts")),
    Preset(
        name="judo", title="Judo", muscles=_JUDO, cuts=("events", "contacts", "cycles", "parts")
    ),
    Preset(name="gait", title="Gait", muscles=_WALK, cuts=("contacts", "events", "cycles")),
    Preset(
        name="lift", title="Lifting", muscles=_LIFT, cuts=("contacts", "events", "cycles", "parts")
    ),
    Preset(
        name="motion",
        title="The motion",
        muscles=_GENERAL,
        cuts=("events", "contacts", "cycles", "parts"),
    ),
)
PRESETS: Mapping[str, Preset] = FrozenMap({preset.name: preset for preset in _ALL})
"""By name; "motion" is for what no other fits."""


def preset_of(name: str) -> Preset:
    """Return the preset of that name; raises `UnknownName`."""
    check_name("preset", name, PRESETS, "the report")
    return PRESETS[name]


def fitting_preset(
    walks: bool,
    sources: tuple[str, ...],
    persons: int,
    holds: bool,
    movement: Movement | None = None,
) -> Preset:
    """Choose the preset that fits a recording.

    Parameters
    ----------
    walks : whether feet strike the ground one after the other
    sources : where the contacts come from
    persons : subjects with muscles
    holds : whether an object without muscles is in the recording
    movement : of the recording, None where it is not known: a walk needs no plates to be one, and
        what is known to be no gait is none, whatever feet do
    """
    if persons > 1:
        return PRESETS["judo"]
    if "sound" in sources:
        return PRESETS["drum"]
    if holds:
        return PRESETS["lift"]
    if movement == "walking":
        return PRESETS["gait"]
    steps = movement in (None, "running", "stairs")
    return PRESETS["gait" if walks and steps else "motion"]
