"""Numbers in print, and the axis of a chart: its limits, its ticks and where values are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array

RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Tick:
    """A round value of an axis: where it is drawn, its printed text, and whether it is zero."""

    position: float
    text: str
    zero: bool


@dataclass(frozen=True)
class Axis:
    """Values along one direction of a chart."""

    # low, high: limits
    low: float
    high: float
    # start, stop: where the limits are drawn, in the drawing's own units; an upright axis starts at
    # the bottom
    start: float
    stop: float
    unit: str = ""  # printed behind the last tick

    def at(self, values: ArrayLike) -> Array:
        """Find the position of each value.

        Parameters
        ----------
        values : (...) in the unit of the axis

        Returns
        -------
        (...) in pixels, NaN where a value is
        """
        return self.start + (np.asarray(values) - self.low) / (self.high - self.low) * (
            self.stop - self.start
        )

    def cut(self, values: ArrayLike) -> Array:
        """Find the position of each value, of those beyond a limit at the limit.

        Parameters
        ----------
        values : (...) in the unit of the axis

        Returns
        -------
        (...) in pixels, NaN where a value is not finite
        """
        known = np.asarray(values, dtype=np.float64)
        return self.at(np.where(np.isfinite(known), np.clip(known, self.low, self.high), np.nan))

    def ticks(self, count: int = 4) -> list[Tick]:
        """Round values within the limits, about `count` of them."""
        values = ticks(self.low, self.high, count)
        step = float(values[1] - values[0]) if len(values) > 1 else 1.0
        result = [
            Tick(float(self.at(value)), number(float(value), step), abs(value) < 1e-9 * step)
            for value in values
        ]
        if self.unit and result:
            result[-1] = Tick(
                result[-1].position, f"{result[-1].text} {self.unit}", result[-1].zero
            )
        return result


def limits(
    values: Sequence[Array], low: float | None = None, high: float | None = None, zero: bool = False
) -> tuple[float, float]:
    """Find the lowest and highest of several arrays with a little air.

    Parameters
    ----------
    values : arrays of any shape, in one unit
    low, high : values that must be inside, without air
    zero : whether zero must be inside, without air too

    Returns
    -------
    Lowest and highest; (0, 1) where no value is finite
    """
    finite = [array[np.isfinite(array)] for array in map(np.asarray, values)]
    lows = [float(array.min()) for array in finite if array.size] + ([] if low is None else [low])
    highs = [float(array.max()) for array in finite if array.size] + (
        [] if high is None else [high]
    )
    if not (lows and highs):
        return 0.0, 1.0
    first, last = (min([*lows, 0.0]), max([*highs, 0.0])) if zero else (min(lows), max(highs))
    if last - first < 1e-12 * max(1.0, abs(last)):
        air = abs(last) * 0.1 or 1.0
        return first - air, last + air
    air = 0.06 * (last - first)
    fixed = (0.0,) if zero else ()
    return first - air * (first not in (low, *fixed)), last + air * (last not in (high, *fixed))


def scaled_unit(unit: str, *values: Array) -> tuple[float, str]:
    """Find the factor and unit that print small values without a row of zeros.

    0.0003 N·m is 300 µN·m. Larger values keep their unit.
    """
    finite = [np.abs(value[np.isfinite(value)]) for value in values]
    peak = max((float(array.max()) for array in finite if array.size), default=0.0)
    scales = ((2e-2, 1.0, ""), (2e-5, 1e3, "m"), (0.0, 1e6, "µ"))
    return next(
        (factor, prefix + unit) for floor, factor, prefix in scales if peak >= floor or peak == 0.0
    )


def ticks(low: float, high: float, count: int = 4) -> Array:
    """Choose round numbers within limits.

    Parameters
    ----------
    low, high : limits, in the unit of the axis
    count : about how many

    Returns
    -------
    (ticks,) in rising order; `low` alone where the limits hold no range
    """
    if not (np.isfinite(low) and np.isfinite(high)) or high <= low:
        return np.array([low])
    raw = (high - low) / max(count, 1)
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * next(
        factor for factor in (1.0, 2.0, 2.5, 5.0, 10.0) if factor * power >= raw * 0.8
    )
    # Adding zero turns the -0.0 that ceil leaves into 0.0.
    return np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step + 0.0


def number(value: float, step: float | None = None) -> str:
    """Write a value for print: about three digits, or as many as a tick of `step` needs.

    Negative values have a true minus sign.
    """
    if not np.isfinite(value):
        return "–"
    if step is None or 0.0 < step < 1e-6:
        size = abs(value)
        if size != 0.0 and (size >= 1e6 or size < 1e-3):
            mantissa, power = f"{value:.1e}".split("e")
            return f"{mantissa}·10{str(int(power)).translate(RAISED)}".replace("-", "−")
        if size >= 100 or size == 0.0:
            digits = 0
        elif size >= 10:
            digits = 1
        elif size >= 1:
            digits = 2
        else:
            digits = 3
    else:
        digits = max(0, -int(np.floor(np.log10(step) + 1e-9))) if step > 0 else 0
        if step > 0 and abs(step * 10**digits - round(step * 10**digits)) > 1e-6:
            digits += 1
    return f"{value:,.{digits}f}".replace(",", "\u202f").replace("-", "−")
