"""What a kind of motion is looked at for: panels, muscles and phases of its analysis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from myomorph.analysis.limb_muscles import MUSCLES
from myomorph.model.errors import UnknownName

Panel = Literal["score", "center", "phases", "contact forces", "relations"]
Cut = Literal["events", "contacts", "cycles", "parts"]

PANELS: tuple[Panel, ...] = ("score", "center", "phases", "contact forces", "relations")
"""Every panel, in the order of the page: pictures, height, contacts and muscles on one time axis; the center of
gravity; phases; contact forces; what goes with what."""

CUTS: tuple[Cut, ...] = ("events", "contacts", "cycles", "parts")
"""Every way to cut a motion: between events, where the contact state changes, by the period of the center of gravity,
into four equal parts."""


@dataclass(frozen=True)
class Preset:
    """Which panels, muscles and phases the analysis of one kind of motion has.

    Attributes
    ----------
    name : as study files and the command line say it
    title : in print
    panels : of `PANELS`
    muscles : of `MUSCLES`, from top to bottom
    cuts : of `CUTS`, the first that cuts the motion at all is taken
    pictures : in the strip
    """

    name: str
    title: str
    panels: tuple[Panel, ...]
    muscles: tuple[str, ...]
    cuts: tuple[Cut, ...]
    pictures: int = 9

    def __post_init__(self) -> None:
        for kind, names, known in (
            ("panel", self.panels, PANELS),
            ("muscle", self.muscles, tuple(MUSCLES)),
            ("cut", self.cuts, CUTS),
        ):
            for one in names:
                if one not in known:
                    raise UnknownName(kind, one, known, f"the preset '{self.name}': the report")


_ARM = ("Deltoid, anterior", "Deltoid, posterior", "Biceps brachii, long head", "Triceps brachii, lateral head")
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
_GENERAL = (*_ARM, "Trapezius", "Erector spinae", "Gluteus maximus", *_LEG[:1], "Vastus lateralis", *_LEG[1:])

PRESETS: Mapping[str, Preset] = MappingProxyType(
    {
        one.name: one
        for one in (
            Preset("taichi", "Tai Chi", PANELS, (*_ARM, *_LEG), ("cycles", "contacts", "parts"), 10),
            Preset(
                "tap",
                "Tap dance",
                PANELS,
                (*_ARM, "Trapezius", "Gluteus maximus", *_LEG),
                ("events", "cycles", "parts"),
                10,
            ),
            Preset(
                "drum",
                "Drum playing",
                PANELS,
                (*_ARM, "Brachioradialis", "External oblique", "Tibialis anterior", "Gastrocnemius, lateral"),
                ("events", "cycles", "parts"),
            ),
            Preset(
                "judo",
                "Judo",
                PANELS,
                (
                    *_ARM,
                    "Trapezius",
                    "Latissimus dorsi",
                    "External oblique",
                    "Erector spinae",
                    "Gluteus maximus",
                    *_LEG,
                ),
                ("events", "contacts", "cycles", "parts"),
            ),
            Preset("gait", "Gait", PANELS, _WALK, ("contacts", "events", "cycles"), 9),
            Preset(
                "lift",
                "Lifting",
                PANELS,
                (
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
                ),
                ("contacts", "events", "cycles", "parts"),
            ),
            Preset("motion", "The motion", PANELS, _GENERAL, ("events", "contacts", "cycles", "parts")),
        )
    }
)
"""By name; "motion" is for what no other fits."""


def preset_of(name: str) -> Preset:
    """The preset of that name; raises `UnknownName`."""
    if name not in PRESETS:
        raise UnknownName("preset", name, tuple(PRESETS), "the report")
    return PRESETS[name]


def fitting_preset(walks: bool, sources: tuple[str, ...], persons: int, holds: bool) -> Preset:
    """The preset that a recording asks for by itself.

    Parameters
    ----------
    walks : whether feet strike the ground one after the other
    sources : what told of the contacts
    persons : subjects with muscles
    holds : whether an object without muscles is in the recording
    """
    if persons > 1:
        return PRESETS["judo"]
    if "sound" in sources:
        return PRESETS["drum"]
    if holds:
        return PRESETS["lift"]
    return PRESETS["gait" if walks else "motion"]
