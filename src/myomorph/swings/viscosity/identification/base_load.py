"""What rests on the base: it weighs like limb, so masses are known only as far as this load is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.model.errors import BadData
from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.identification.identify import STATES, Condition, SpecimenViscosity

UNKNOWN = (0.0, float("inf"))  # A load of which nothing is known [kg].
TOLD = 0.02  # A range of a mass wider than this share of it has no value, and is named.

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


def shared_load(load: BaseLoad, muscles: float | None) -> BaseLoad:
    """Let each condition's load bound the other's: they differ by muscle that was cut off the base.

    With muscles the base carries no less than without, and no more than all that was cut off.

    Parameters
    ----------
    load : as it was stated
    muscles : that were removed, as weighed [kg]; None where nobody weighed them

    Returns
    -------
    the narrower ranges; those of a load that was stated as it was

    Raises
    ------
    BadData : the base carries less with muscles than without
    """
    bare_low, bare_high = load.removed
    full_low, full_high = load.intact
    most = float("inf") if muscles is None else muscles
    if full_high < bare_low:
        raise BadData(
            f"base_mass is {bare_low:g} kg or more without muscles, but {full_high:g} kg or less"
            " with them: the base loses what is cut off, so give no less with muscles"
        )
    removed = (max(bare_low, full_low - most), min(bare_high, full_high))
    intact = (max(full_low, bare_low), min(full_high, bare_high + most))
    return BaseLoad(removed=removed, intact=intact)


def with_base_load(specimen_viscosity: SpecimenViscosity, load: BaseLoad) -> SpecimenViscosity:
    """Take the base's load off the masses, each with the range that it can have.

    The constant force gives limb and base together, m + m_b. A body of first moment h and inertia I
    about the joint weighs at least |h|^2 / I, muscles by what they add to both, and the base
    carries with muscles what it carries without and what stays on it of those that are cut. A mass
    of which no more than a range is known has no value, and neither has the distance of its center.

    Parameters
    ----------
    specimen_viscosity : whose masses have the load
    load : of both conditions
    """
    weighed = specimen_viscosity.measured_muscle_mass
    load = shared_load(load, weighed)
    loads = dict(zip(STATES, (load.removed, load.intact), strict=True))
    masses = {
        name: _less(condition.mass, loads[name], condition.least_mass.low)
        for name, condition in specimen_viscosity.conditions.items()
        if np.isfinite(condition.mass.value)
    }
    muscle_mass = specimen_viscosity.muscle_mass
    if muscle_mass is not None and len(masses) == len(STATES):
        least = specimen_viscosity.least_muscle_mass
        staying = _staying(load, weighed)
        muscle_mass = _less(muscle_mass, staying, 0.0 if least is None else least.low)
        if weighed is not None and not np.isfinite(muscle_mass.value):
            top = max(min(muscle_mass.high, weighed), muscle_mass.low)
            muscle_mass = replace(muscle_mass, high=top)
        masses = _bounded(masses, muscle_mass)
    notes = []
    changed: dict[str, Condition] = {}
    for name, mass in masses.items():
        condition = specimen_viscosity.conditions[name]
        changed[name] = replace(condition, mass=mass, com=_center(condition, mass))
        if not np.isfinite(mass.value):
            notes.append(
                f"{STATES[name]}: the mass is known only as {mass.low:.2f} to {mass.high:.2f} kg,"
                " for what rests on the base weighs like limb; mass times COM,"
                f" {condition.first_moment.value:.3g} kg m, and the viscosities do not depend on"
                " it; weigh the base and give base_mass"
            )
    return specimen_viscosity.changed(changed, notes, muscle_mass=muscle_mass)


def _bounded(masses: Mapping[str, Interval], muscles: Interval) -> dict[str, Interval]:
    """Let the range of a mass end where the other mass and the muscles' end.

    Parameters
    ----------
    masses : of both conditions [kg]
    muscles : that are the difference [kg]
    """
    bare = masses["without"]
    full = masses["with"]
    ends = {
        "without": (full.low - muscles.high, full.high - muscles.low),
        "with": (bare.low + muscles.low, bare.high + muscles.high),
    }
    result = {}
    for name, mass in masses.items():
        low = max(mass.low, ends[name][0])
        high = min(mass.high, ends[name][1])
        narrower = not np.isfinite(mass.value) and low <= high
        result[name] = replace(mass, low=low, high=high) if narrower else mass
    return result


def _staying(load: BaseLoad, weighed: float | None) -> Range:
    """Find the least and the most of the cut muscles that the base carried [kg]."""
    low = max(load.intact[0] - load.removed[1], 0.0)
    high = max(load.intact[1] - load.removed[0], 0.0)
    return low, high if weighed is None else max(min(high, weighed), low)


def _center(condition: Condition, mass: Interval) -> Interval:
    """Find the distance of the mass center of a condition with a mass that has no load [m]."""
    if np.isfinite(mass.value):
        factor = condition.mass.value / mass.value
        com = condition.com
        return Interval(factor * com.value, factor * com.low, factor * com.high)
    moment = condition.first_moment
    return Interval(float("nan"), moment.low / mass.high, moment.high / max(mass.low, 1e-9))


def _less(shown: Interval, load: Range, least: float) -> Interval:
    """Take a load off a mass that the constant force shows.

    Parameters
    ----------
    shown : the mass with the load [kg]
    load : the least and the most [kg]
    least : below which the mass cannot be, where the load is a range [kg]

    Returns
    -------
    the mass; without a value where its range is wider than `TOLD` of it
    """
    low, high = load
    if high == low:
        return Interval(shown.value - low, shown.low - low, shown.high - low)
    top = shown.high - low
    bottom = min(max(least, shown.low - high, 0.0), top)
    middle = 0.5 * (bottom + top)
    narrow = top - bottom <= TOLD * middle
    return Interval(middle if narrow else float("nan"), bottom, top)
