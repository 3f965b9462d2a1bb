"""What draws come to: limits that hold 90 % of them, their standard deviation, and what share each source has in it."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.frozen_map import FrozenMap
from myomorph.uncertainty.found_sizes import SourceSize

LEVEL = 0.9
IN_MEMORY = 100e6
"""Draws that take more [bytes] are kept on disk, so that memory does not grow with their number."""
AT_ONCE = 20e6
"""Values that are sorted together [bytes]."""


@read_only
@dataclass(frozen=True, eq=False)
class Spread:
    """The spread of a table over draws.

    Attributes
    ----------
    names : columns
    low, high : (frames, names) between which 90 % of the draws lie
    deviation : (frames, names) standard deviation
    """

    time: Array
    names: tuple[str, ...]
    low: Array
    high: Array
    deviation: Array

    def over(self, time: Array, drawn: Array, nominal: Array) -> Spread:
        """The spread at other times, its limits as far from the values without errors as between its own frames.

        Parameters
        ----------
        time : (samples,) [s]
        drawn, nominal : values without errors at the spread's times and at the others
        """
        if len(time) == len(self.time):
            return self
        low, high, deviation = (
            np.column_stack([np.interp(time, self.time, column) for column in values.T])
            for values in (self.low - drawn, self.high - drawn, self.deviation)
        )
        return Spread(time, self.names, nominal + low, nominal + high, deviation)


@read_only
@dataclass(frozen=True, eq=False)
class Shares:
    """What groups of sources contribute to the columns of one table, as shares of the variance (groups, names).

    Attributes
    ----------
    groups : names
    alone : of each group, the others left out
    total : what is missing where a group is left out, so that what it does together with others counts too
    """

    groups: tuple[str, ...]
    alone: Array
    total: Array


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """The spread of every table of a trial.

    Attributes
    ----------
    spreads : by the tables' names
    shares : by the tables' names, what each group of sources contributes
    draws, failed : how many inputs were drawn, and of how many there is no solution
    factors : by which the limits of tables are wider than those that hold 90 % of the draws
    sizes : of the sources of error, and where each comes from
    """

    spreads: Mapping[str, Spread] = field(default_factory=lambda: FrozenMap({}))
    shares: Mapping[str, Shares] = field(default_factory=lambda: FrozenMap({}))
    draws: int = 0
    failed: int = 0
    notes: tuple[str, ...] = ()
    factors: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    sizes: tuple[SourceSize, ...] = ()

    @property
    def summary(self) -> str:
        """How limits were found, as the end of a line."""
        wider = ", ".join(
            f"{name.replace('_', ' ')} {factor:g}" for name, factor in self.factors.items() if factor != 1.0
        )
        text = f"limits of {100 * LEVEL:.0f} % from {self.draws - self.failed} draws"
        return f"{text}, widened by factors ({wider})" if wider else text


class Draws:
    """Tables of many draws.

    Parameters
    ----------
    count : draws
    shapes : of each table, by name
    """

    def __init__(self, count: int, shapes: Mapping[str, tuple[int, ...]]):
        self.count, self.done = count, list[int]()
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        size = 4.0 * count * sum(float(np.prod(shape)) for shape in shapes.values())
        if size > IN_MEMORY:
            self._folder = tempfile.TemporaryDirectory(prefix="myomorph-draws.", ignore_cleanup_errors=True)
        self._values = {name: self._room(name, (count, *shape)) for name, shape in shapes.items()}

    def __enter__(self) -> Draws:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._values.clear()
        if self._folder is not None:
            self._folder.cleanup()

    def _room(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        if self._folder is None:
            return np.empty(shape, np.float32)
        return np.memmap(Path(self._folder.name) / f"{len(shape)}-{name}", np.float32, "w+", shape=shape)

    def put(self, draw: int, tables: Mapping[str, Array]) -> None:
        """Keep what one draw came to."""
        for name, values in self._values.items():
            values[draw] = tables[name]
        self.done.append(draw)

    def at(self, name: str, draw: int) -> Array:
        """One draw of a table, in single precision."""
        return np.asarray(self._values[name][draw], np.float64)

    def spread(self, name: str, time: Array, names: tuple[str, ...], level: float = LEVEL) -> Spread:
        """Limits and standard deviation of a table (frames, names)."""
        values, done = self._values[name], np.array(self.done)
        frames = values.shape[1]
        low, high, deviation = (np.empty(values.shape[1:]) for _ in range(3))
        step = max(1, int(AT_ONCE / (4.0 * values.shape[0] * max(values.shape[2], 1))))
        tails = (0.5 - 0.5 * level, 0.5 + 0.5 * level)
        for start in range(0, frames, step):
            part = slice(start, start + step)
            taken = np.asarray(values[done, part], np.float64)
            low[part], high[part] = np.quantile(taken, tails, axis=0)
            deviation[part] = taken.std(axis=0, ddof=1)
        return Spread(time, names, low, high, deviation)
