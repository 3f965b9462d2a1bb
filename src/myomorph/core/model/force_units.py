"""Units of force, length and moment as recordings write them: N, kN, Nmm, N·m."""

from __future__ import annotations

import re
from collections.abc import Mapping

from myomorph.core.model.frozen_map import FrozenMap

FORCE_UNITS: Mapping[str, float] = FrozenMap(
    {
        "n": 1.0,
        "nt": 1.0,
        "newton": 1.0,
        "newtons": 1.0,
        "mn": 1e-3,
        "kn": 1000.0,
        "lb": 4.4482216,
        "lbf": 4.4482216,
    }
)
"""Newtons in a unit of force, by its letters."""
LENGTH_UNITS: Mapping[str, float] = FrozenMap(
    {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "meters": 1.0, "meter": 1.0}
)
"""Meters in a unit of length, by its letters."""

_BRACKETS = re.compile(r"[\[(]([^\[\]()]+)[\])]\s*$")


def letters_of(text: str) -> str:
    """Return the letters of a unit without what stands between them: "nmm" for "N·mm"."""
    return re.sub(r"[^a-z]", "", text.lower())


def force_factor(text: str) -> float | None:
    """Return the newtons in a unit, None where it is no unit of force.

    Examples
    --------
    >>> force_factor("kN"), force_factor("V")
    (1000.0, None)
    """
    return FORCE_UNITS.get(letters_of(text))


def moment_factor(text: str) -> float | None:
    """Return the newton meters in a unit, None where it is no unit of moment.

    Examples
    --------
    >>> moment_factor("N·mm"), moment_factor("N m"), moment_factor("N")
    (0.001, 1.0, None)
    """
    letters = letters_of(text)
    for force in sorted(FORCE_UNITS, key=len, reverse=True):
        length = letters.removeprefix(force)
        if length != letters and length in LENGTH_UNITS:
            return FORCE_UNITS[force] * LENGTH_UNITS[length]
    return None


def unit_in_name(name: str) -> str:
    """Return the unit in brackets at the end of a column's name, "" without one.

    Examples
    --------
    >>> unit_in_name("r1_mx [N mm]")
    'N mm'
    """
    match = _BRACKETS.search(name)
    return match[1].strip() if match else ""
