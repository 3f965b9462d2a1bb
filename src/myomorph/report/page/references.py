"""Where the limits and the formulas come from: the sources in `references.toml`."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

ANALYSIS = frozenset({"experts", "bartlett1946", "mcleod2005", "bartlett1935", "benjamini1995"})


@dataclass(frozen=True)
class Reference:
    """A source: what it is cited for, authors and title, place, digital object identifier or address ("" if none)."""

    key: str
    used: str
    text: str
    link: str = ""


@cache
def _known() -> Mapping[str, Reference]:
    text = (files("myomorph.report") / "page" / "references.toml").read_text(encoding="utf-8")
    return {key: Reference(key, **entry) for key, entry in tomllib.loads(text).items()}


def references(
    kinematics: bool, dynamics: bool, tension: bool, jump: bool, identification: bool = False, analysis: bool = False
) -> tuple[Reference, ...]:
    """Those that a report with these parts relies on."""
    wanted = set() if identification and not (kinematics or dynamics or tension) else {"hicks2015", "opensim"}
    wanted |= {"lu1999"} if kinematics else set()
    wanted |= {"featherstone2008", "woltring1986"} if dynamics else set()
    wanted |= {"crowninshield1981", "millard2013"} if tension else set()
    wanted |= {"dissertation", "ayusawa2014", "ae1992", "wensing2018"} if identification else set()
    wanted |= {"owen2014", "mcmahon2018"} if jump else set()
    return listed(wanted | ANALYSIS if analysis else wanted)


def listed(keys: Collection[str]) -> tuple[Reference, ...]:
    """Sources in the order of the list."""
    return tuple(reference for key, reference in _known().items() if key in keys)


def cited(*keys: str) -> tuple[Reference, ...]:
    """Sources in the order of their keys."""
    return tuple(_known()[key] for key in keys)
