"""What rests on the base: it weighs like limb, so masses are known only as far as this load is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.model.errors import BadData
from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.identification.identify import STATES, Condition, SpecimenViscosity

UNKNOWN = (0.0, float("inf"))  # A load of which nothing is known [kg].
TOLD = 0.02  # A range of a mass wider than this share of it is named.

Range = tuple[float, float]


@dataclass(frozen=True)
class BaseLoad:
    """What the base carries beyond the plate's zero and does not swing.

    That is bone, fixture, and muscle that stays on it.

    Attributes
    ----------
    removed, intact : the least and the most of it [kg], of limbs without their muscles and with
        them
    """

    removed: Range = UNKNOWN
    intact: Range = UNKNOWN

    def __post_init__(self) -> None:
        for low, high in (self.removed, self.intact):
            if not 0.0 <= low <= high:
                raise BadData(
                    f"a load of the base is {low:g} to {high:g} kg: expected from 0, the lower end"
                    " first"
                )


def with_base_load(specimen_viscosity: SpecimenViscosity, load: BaseLoad) -> SpecimenViscosity:
    """Take the base's load off the masses, each with the range that it can have.

    The constant force gives limb and base together, m + m_b. A body of first moment h and inertia I
    about the joint weighs at least |h|^2 / I, muscles by what they add to both, and the base
    carries no less with muscles than without. A value whose load is a range is the middle of its
    range.

    Parameters
    ----------
    specimen_viscosity : whose masses have the load
    load : of both conditions
    """
    notes = []
    loads = dict(zip(STATES, (load.removed, load.intact), strict=True))
    changed: dict[str, Condition] = {}
    for name, condition in specimen_viscosity.conditions.items():
        if not np.isfinite(condition.mass.value):
            continue
        low, high = loads[name]
        mass = _less(condition.mass, (low, high), condition.least_mass.low)
        if high > low:
            h = condition.first_moment
            com = Interval(h.value / mass.value, h.low / mass.high, h.high / max(mass.low, 1e-9))
        else:
            factor = condition.mass.value / mass.value
            com = condition.com
            com = Interval(factor * com.value, factor * com.low, factor * com.high)
        changed[name] = replace(condition, mass=mass, com=com)
        if mass.high - mass.low > TOLD * mass.value and high > low:
            notes.append(
                f"{STATES[name]}: the mass is known only as {mass.low:.2f} to {mass.high:.2f} kg,"
                " for what rests on the base weighs like limb; mass times COM,"
                f" {condition.first_moment.value:.3g} kg m, and the viscosities do not depend on"
                " it; weigh the base and give base_mass"
            )
    muscle_mass = specimen_viscosity.muscle_mass
    if muscle_mass is not None and len(changed) == 2:
        more = tuple(
            max(a - b, 0.0) for a, b in zip(load.intact, reversed(load.removed), strict=True)
        )
        least = specimen_viscosity.least_muscle_mass
        muscle_mass = _less(muscle_mass, (more[0], more[1]), 0.0 if least is None else least.low)
    return specimen_viscosity.changed(changed, notes, muscle_mass=muscle_mass)


def _less(shown: Interval, load: Range, least: float) -> Interval:
    """Take a load off a mass that the constant force shows.

    Parameters
    ----------
    shown : the mass with the load [kg]
    load : the least and the most [kg]
    least : below which the mass cannot be, where the load is a range [kg]
    """
    low, high = load
    if high == low:
        return Interval(shown.value - low, shown.low - low, shown.high - low)
    top = shown.high - low
    bottom = min(max(least, shown.low - high, 0.0), top)
    return Interval(0.5 * (bottom + top), bottom, top)
