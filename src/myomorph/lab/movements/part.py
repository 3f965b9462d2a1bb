"""Parts of a movement with their numbers: a step, a jump, a repetition, a rise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.quantity import Quantity
from myomorph.lab.analysis.phases import Phase

UNKNOWN = float("nan")


@dataclass(frozen=True, kw_only=True)
class Part:
    """One step, jump, repetition or rise.

    Attributes
    ----------
    start, stop : from when to when it lasts [s]
    side : "right" or "left" of a step, "" of what both legs do
    numbers : by the name of a quantity, in its unit; what was not seen is not there
    phases : what it is made of, in order
    """

    start: float
    stop: float
    side: str = ""
    numbers: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    phases: tuple[Phase, ...] = ()

    def number(self, quantity: Quantity) -> float:
        """Return the value of a quantity, NaN where it is not known."""
        return self.numbers.get(quantity.name, UNKNOWN)


@dataclass(frozen=True, kw_only=True)
class Summary:
    """A quantity over several parts.

    Attributes
    ----------
    mean : over the parts in which it is known
    sd : standard deviation between them, NaN for fewer than two
    count : how many these are
    """

    mean: float
    sd: float
    count: int


@dataclass(frozen=True, kw_only=True)
class MovementNumbers:
    """The parts of a recording, and what is known of them.

    Attributes
    ----------
    one, many : what a part is called, as "step", "steps"
    parts : in order of time
    quantities : that a page shows, in order
    """

    one: str
    many: str
    parts: tuple[Part, ...]
    quantities: tuple[Quantity, ...]

    @property
    def sides(self) -> tuple[str, ...]:
        """Sides that parts have, right before left; "" alone where they have none."""
        found = {part.side for part in self.parts}
        return tuple(side for side in ("right", "left", "") if side in found)

    @property
    def known(self) -> tuple[Quantity, ...]:
        """Return the quantities that at least one part has."""
        return tuple(
            quantity
            for quantity in self.quantities
            if any(np.isfinite(part.number(quantity)) for part in self.parts)
        )

    def values(self, quantity: Quantity, side: str) -> Array:
        """Collect a quantity of the parts of one side.

        Parameters
        ----------
        quantity : one of `quantities`
        side : of `sides`

        Returns
        -------
        (parts,) in the quantity's unit, only those that are known
        """
        found = [part.number(quantity) for part in self.parts if part.side == side]
        values = np.array(found, dtype=np.float64)
        return np.asarray(values[np.isfinite(values)])

    def summary(self, quantity: Quantity, side: str) -> Summary | None:
        """Mean and standard deviation over the parts of a side; None where none is known."""
        values = self.values(quantity, side)
        if not len(values):
            return None
        sd = float(values.std(ddof=1)) if len(values) > 1 else UNKNOWN
        return Summary(mean=float(values.mean()), sd=sd, count=len(values))

    def only(self, quantities: Sequence[Quantity]) -> MovementNumbers:
        """Return the same with fewer quantities."""
        kept = tuple(quantity for quantity in self.quantities if quantity in quantities)
        return MovementNumbers(one=self.one, many=self.many, parts=self.parts, quantities=kept)


def known_numbers(numbers: Mapping[Quantity, float]) -> Mapping[str, float]:
    """Return the numbers that are known, by the names of their quantities."""
    known = {quantity.name: value for quantity, value in numbers.items() if np.isfinite(value)}
    return FrozenMap(known)


def phases_between(names: Sequence[str], instants: Sequence[float]) -> tuple[Phase, ...]:
    """Make phases of the instants that begin and end them; those of no length are left out.

    Parameters
    ----------
    names : of the phases
    instants : one more than names, in order [s], NaN where not known
    """
    ends = zip(names, instants, instants[1:], strict=False)
    return tuple(Phase(name, start, stop) for name, start, stop in ends if start < stop)
