"""Units as results, tables and pages write them, and factors between them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

from myomorph.core.model.frozen_map import FrozenMap

MotionKind = Literal["rotational", "translational", "coupled"]
"""Kinds of coordinates, as OpenSim names them."""

FACTORS: Mapping[tuple[str, str], float] = FrozenMap(
    {
        ("rad", "deg"): 180.0 / np.pi,
        ("rad", "°"): 180.0 / np.pi,
        ("deg", "°"): 1.0,
        ("m", "mm"): 1000.0,
        ("1", "%"): 100.0,
    }
)
"""From a unit to one that people read."""

OR = " or "
"""Between the unit of rotations and that of translations: "N m or N"."""

LENGTHS = ("m",)
"""Units of a translation itself: a coupled coordinate, which moves in both ways, has none."""


def unit_by_motion(unit: str, motion: MotionKind) -> str:
    """Return the unit of one coordinate in a quantity whose unit depends on how coordinates move.

    Parameters
    ----------
    unit : of the quantity: "N m or N" is N m of rotations and N of translations
    motion : of the coordinate; a generalized force of a coupled one counts as a force, as in
        OpenSim, and the coordinate itself has no unit

    Returns
    -------
    one unit
    """
    of_rotation, _, of_translation = unit.partition(OR)
    if not of_translation or motion == "rotational":
        return of_rotation
    if motion == "coupled" and of_translation in LENGTHS:
        return "1"
    return of_translation


def written_unit(unit: str, product: str = "·") -> str:
    """Return a unit for people: "N m" with a sign between its parts, nothing for "1"."""
    if unit == "1":
        return ""
    return OR.join(each.replace(" ", product) for each in unit.split(OR))


def shown_unit(unit: str) -> str:
    """Return the unit in which pages show values: degrees for angles."""
    return "°" if unit == "rad" else written_unit(unit)


def conversion(unit: str, shown: str) -> float | None:
    """Return the factor from a unit to the one that is shown, None where there is none."""
    if shown in (unit, written_unit(unit)):
        return 1.0
    return FACTORS.get((unit, shown))
