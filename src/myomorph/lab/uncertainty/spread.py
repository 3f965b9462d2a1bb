"""The spread of draws: interval bounds that hold 90 % of them, and their standard deviation.

The share of each source in it stands beside.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import field, replace
from pathlib import Path
from zlib import crc32

import numpy as np
import scipy
from numpy.typing import NDArray

from myomorph.core.fit.interval_rule import LEVEL, drawn_limits, reflected_limits
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.quantity import Bound, Quantity
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.tension.load_quantities import JOINT_CONTACT_LOAD, JOINT_REACTION
from myomorph.core.tension.quantities import ACTIVATION, MUSCLE_FORCE
from myomorph.lab.uncertainty.sources import SourceSize

# Draws that take more [bytes] are kept on disk, so that memory does not grow with their number
IN_MEMORY = 100e6
AT_ONCE = 20e6  # Values that are sorted together [bytes]
MIN_SOLVED = 0.9
"""Share of the draws that must have solved a frame for it to have limits."""


@read_only
class Spread:
    """The spread of a table over draws.

    Attributes
    ----------
    time : (frames,) [s]
    names : columns
    low, high : (frames, names) between which 90 % of the draws lie
    deviation : (frames, names) standard deviation
    quantity : what these are, None where it is not declared
    """

    time: Array
    names: tuple[str, ...]
    low: Array
    high: Array
    deviation: Array
    quantity: Quantity | None = field(default=None, kw_only=True)

    def bounds(self) -> dict[Bound, Array]:
        """Return the arrays by the ends of their names in result files.

        Returns
        -------
        (frames, names) lower and upper bound and standard deviation
        """
        return {"low": self.low, "high": self.high, "sd": self.deviation}

    def over(self, time: Array, drawn: Array, nominal: Array) -> Spread:
        """Interpolate the spread at other times.

        Its bounds are as far from the values without errors as between its own frames.

        Parameters
        ----------
        time : (samples,) [s]
        drawn : (frames, names) values without errors at the spread's times
        nominal : (samples, names) values without errors at the other times

        Returns
        -------
        The spread of (samples, names)
        """
        if len(time) == len(self.time):
            return self
        low = np.column_stack(
            [np.interp(time, self.time, column) for column in (self.low - drawn).T]
        )
        high = np.column_stack(
            [np.interp(time, self.time, column) for column in (self.high - drawn).T]
        )
        deviation = np.column_stack(
            [np.interp(time, self.time, column) for column in self.deviation.T]
        )
        return replace(self, time=time, low=nominal + low, high=nominal + high, deviation=deviation)


@read_only
class Shares:
    """Contributions of groups of sources to the columns of one table.

    They are shares of the variance (groups, names).

    Attributes
    ----------
    groups : names
    alone : of each group, the others left out
    total : what is missing where a group is left out, so that what it does together with others
        counts too
    """

    groups: tuple[str, ...]
    alone: Array
    total: Array


@read_only
class Uncertainty:
    """The spread of every table of a trial.

    Attributes
    ----------
    notes : warnings, one line each
    spreads : by the tables' names
    shares : by the tables' names, what each group of sources contributes
    draws, failed : how many inputs were drawn, and of how many there is no solution
    factors : by which the limits of tables are wider than those that hold 90 % of the draws
    sizes : of the sources of error, and where each comes from
    gait : by side, (draws, samples, variables) errors of the mean curves of clinical gait analysis;
        {} for no walk
    """

    spreads: Mapping[str, Spread] = field(default_factory=lambda: FrozenMap({}))
    shares: Mapping[str, Shares] = field(default_factory=lambda: FrozenMap({}))
    draws: int = 0
    failed: int = 0
    notes: tuple[Message, ...] = ()
    factors: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    sizes: tuple[SourceSize, ...] = ()
    gait: Mapping[str, Array] = field(default_factory=lambda: FrozenMap({}))

    @property
    def summary(self) -> str:
        """How limits were found, as the end of a line."""
        wider = ", ".join(
            f"{name.replace('_', ' ')} {factor:g}"
            for name, factor in self.factors.items()
            if factor != 1.0
        )
        count = self.draws - self.failed
        text = f"limits of {100 * LEVEL:.0f} % from {count} draws"
        if count > 0:
            text += f", each known to {100 * limit_error(count):.0f} % of the half width"
        return f"{text}, widened by factors ({wider})" if wider else text


class Draws(ExitStack):
    """Tables of many draws, of shapes by name; what lies on disk is gone after it."""

    def __init__(self, count: int, shapes: Mapping[str, tuple[int, ...]]):
        super().__init__()
        self.count = count
        self.done = list[int]()
        self._values = dict[str, np.ndarray]()
        folder = ""
        if 4.0 * count * sum(float(np.prod(shape)) for shape in shapes.values()) > IN_MEMORY:
            made = tempfile.TemporaryDirectory(prefix="myomorph-draws.", ignore_cleanup_errors=True)
            folder = self.enter_context(made)
        for name, shape in shapes.items():
            path = Path(folder) / f"{len(shape) + 1}-{name}"
            whole = (count, *shape)
            values = (
                np.memmap(path, np.float32, "w+", shape=whole)
                if folder
                else np.empty(whole, np.float32)
            )
            self._values[name] = values
        self.callback(self._values.clear)

    def put(self, draw: int, tables: Mapping[str, Array]) -> None:
        """Store the values of one draw.

        Parameters
        ----------
        draw : which of the draws
        tables : (frames, names) by table
        """
        for name, values in self._values.items():
            values[draw] = tables[name]
        self.done.append(draw)

    def at(self, name: str, draw: int) -> Array:
        """Return one draw of a table, stored in single precision.

        Parameters
        ----------
        name : of the table
        draw : which of the draws

        Returns
        -------
        (frames, names)
        """
        return np.asarray(self._values[name][draw], np.float64)

    def spread(self, name: str, time: Array, names: tuple[str, ...]) -> Spread:
        """Compute interval bounds and standard deviation of a table.

        Parameters
        ----------
        name : of the table
        time : (frames,) [s]
        names : of the columns

        Returns
        -------
        The spread of (frames, names) over the draws that were done
        """
        values = self._values[name]
        done = np.array(self.done)
        frames = values.shape[1]
        low = np.empty(values.shape[1:])
        high = np.empty(values.shape[1:])
        deviation = np.empty(values.shape[1:])
        step = max(1, int(AT_ONCE / (4.0 * values.shape[0] * max(values.shape[2], 1))))
        for start in range(0, frames, step):
            part = slice(start, start + step)
            taken = np.asarray(values[done, part], np.float64)
            low[part], high[part] = drawn_limits(taken)
            deviation[part] = taken.std(axis=0, ddof=1)
            for frame, columns in _solved_in_part(taken):
                values_there = taken[:, frame, columns]
                known = values_there[np.isfinite(values_there).all(axis=1)]
                at = (start + frame, columns)
                low[at], high[at] = drawn_limits(known)
                deviation[at] = known.std(axis=0, ddof=1)
        return Spread(time=time, names=names, low=low, high=high, deviation=deviation)


def _solved_in_part(values: Array) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """Find frames that a few draws could not solve, and their columns.

    Parameters
    ----------
    values : (draws, frames, names), NaN where a draw was not solved

    Returns
    -------
    frames, and columns (columns,) of each
    """
    share = np.isfinite(values).mean(axis=0)
    partly = (share < 1.0) & (share >= MIN_SOLVED)
    for frame in np.flatnonzero(partly.any(axis=1)):
        yield int(frame), np.flatnonzero(partly[frame])


FACTORS: Mapping[str, float] = FrozenMap(
    {
        COORDINATE_VALUE.name: 1.17,
        GENERALIZED_FORCE.name: 1.11,
        ACTIVATION.name: 1.03,
        MUSCLE_FORCE.name: 1.03,
        JOINT_REACTION.name: 1.05,
        JOINT_CONTACT_LOAD.name: 1.05,
    }
)
"""By quantity; found on simulated motions and held against others, as
docs/validation/uncertainty.md says. Of a quantity that is not named nothing is known: its limits
stay as drawn.
"""
MAGNITUDES = ("_f", "_force")
"""Ends of columns that are magnitudes of forces, which are never below 0."""


def widened(spread: Spread, factor: float) -> Spread:
    """Limits of a quantity further apart by a factor, about their middle.

    They pass the quantity's bounds only where those of the draws do; magnitudes of forces stay at 0
    or above as well.
    """
    if factor == 1.0:
        return spread
    middle = 0.5 * (spread.low + spread.high)
    half = 0.5 * factor * (spread.high - spread.low)
    low = middle - half
    high = middle + half
    lowest, highest = bounds_of(spread.quantity, spread.names)
    low = np.maximum(low, np.minimum(spread.low, lowest))
    high = np.minimum(high, np.maximum(spread.high, highest))
    return replace(spread, low=low, high=high)


def bounds_of(quantity: Quantity | None, names: Sequence[str]) -> Array:
    """Bounds of columns of a quantity, infinite where there are none; magnitudes are 0 or more.

    Parameters
    ----------
    quantity : what the columns are, None where it is not declared
    names : of the columns

    Returns
    -------
    (2, names) in SI units
    """
    lower, upper = (-np.inf, np.inf) if quantity is None else quantity.bounds
    lowest = [max(lower, 0.0) if name.endswith(MAGNITUDES) else lower for name in names]
    return np.array([lowest, [upper] * len(names)])


@read_only
class ValueErrors:
    """Errors of the numbers of a trial under draws, in the units of the tables.

    Attributes
    ----------
    names : step and quantity of each
    errors : (draws, names) drawn less nominal; NaN in a draw that has no solution
    room : (2, names) how far bounds of the numbers lie from their values, at most 0 and at least 0;
        None where they are not known
    again : (times, draws, names) of draws to which the errors of another draw were added; None
        where nobody did
    """

    names: tuple[tuple[str, str], ...]
    errors: Array
    room: Array | None = field(default=None, kw_only=True)
    again: Array | None = field(default=None, kw_only=True)

    def limits(self) -> tuple[Array, Array, Array]:
        """Find the distances of the 90 % interval bounds from the value, and the errors' spread.

        The numbers' data hold errors as the draws add them: bounds are reflected, within the
        numbers' own bounds.

        Returns
        -------
        (names,) lower bound, upper bound and standard deviation; NaN with fewer than two draws
        """
        solved = np.isfinite(self.errors).all(axis=1)
        known = self.errors[solved]
        if len(known) < 2:
            none = np.full(len(self.names), np.nan)
            return none, none, none
        again = None if self.again is None else self.again[:, solved]
        low, high = reflected_limits(np.zeros(len(self.names)), known, again=again)
        if self.room is not None:
            low = np.clip(low, *self.room)
            high = np.clip(high, *self.room)
        return low, high, known.std(axis=0, ddof=1)


def widened_errors(errors: Array, factors: Array) -> Array:
    """Move errors away from their middle by a factor of each, as intervals are.

    Parameters
    ----------
    errors : (draws, names) NaN where a draw was not solved
    factors : (names,)

    Returns
    -------
    (draws, names)
    """
    known = np.isfinite(errors).all(axis=1)
    if not known.any():
        return errors
    low, high = drawn_limits(errors[known])
    middle = 0.5 * (low + high)
    return np.asarray(middle + factors * (errors - middle))


def limit_error(count: int) -> float:
    """Return the standard error of a limit from so many normal draws, over the half width.

    sqrt(p (1 - p) / n) / (z_p phi(z_p)) with the share p beyond it
    """
    beyond = 0.5 - 0.5 * LEVEL
    z = float(-scipy.special.ndtri(beyond))
    density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    return float(np.sqrt(beyond * (1.0 - beyond) / count) / (z * density))


def of_subject(errors: Array, subject: str) -> Array:
    """Put errors in an order of the subject's own.

    Draws go by the names of sources and items: a marker is misplaced alike in all trials of a
    subject, which is true, and in those of another, which is not. In another order for each,
    subjects err independently.

    Parameters
    ----------
    errors : (draws, names)
    subject : its name

    Returns
    -------
    (draws, names)
    """
    order = np.random.default_rng(crc32(subject.encode())).permutation(len(errors))
    return np.asarray(errors[order])
