"""What is to be estimated: numbers with a name, a unit, a prior, bounds, and where they live."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, frozen_array
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.frozen_map import FrozenMap

Bools = NDArray[np.bool_]
Made = TypeVar("Made")
Chart = Callable[[Array, Array], Array]
"""Values of a block after a step: `chart(values, step)`, both (unknowns,)."""


@dataclass(frozen=True, kw_only=True)
class Unknown:
    """One number that is not known.

    Attributes
    ----------
    name : unique among all that are estimated together, as "femur_r length"
    unit : of its value, "1" without one
    where : what of the model or the recording it is, as "body femur_r: length"
    start : where the search begins; the generic value
    mean, sd : before anything is measured; the mean is `start` by default, an sd of None is no
        prior
    low, high : bounds
    fixed : stays at its start, whatever is fitted
    scale : a change of this size matters; steps and what nothing shows are measured in it. An
        infinite one is not waited for
    """

    name: str
    unit: str = "1"
    where: str = ""
    start: float = 0.0
    mean: float | None = None
    sd: float | None = None
    low: float = -np.inf
    high: float = np.inf
    fixed: bool = False
    scale: float = 1.0

    def __post_init__(self) -> None:
        if not self.low <= self.start <= self.high:
            raise BadData(
                f"unknown '{self.name}' starts at {self.start:g}: expected {self.low:g} to"
                f" {self.high:g} {self.unit}"
            )
        if self.sd is not None and not self.sd > 0.0:
            raise BadData(
                f"unknown '{self.name}' has a prior of {self.sd:g} {self.unit}: expected a standard"
                " deviation above 0, or None for no prior"
            )
        if not self.scale > 0.0:
            raise BadData(f"unknown '{self.name}' has scale {self.scale:g}: expected above 0")


def added(values: Array, step: Array) -> Array:
    """Add a step to numbers: the usual chart.

    Parameters
    ----------
    values, step : (unknowns,)

    Returns
    -------
    (unknowns,)

    Examples
    --------
    >>> import numpy as np
    >>> from myomorph.core.fit.unknowns import added
    >>> added(np.array([1.0]), np.array([0.5])).tolist()
    [1.5]
    """
    return values + step


def turned(values: Array, step: Array) -> Array:
    """Turn rotations further: the chart of rotation vectors.

        exp(v') = exp(step) exp(v)

    by unit quaternions (w, u), exp(v) = (cos |v| / 2, sin(|v| / 2) v / |v|), with the product

        (w, u) (w', u') = (w w' - u . u', w u' + w' u + u x u')

    Slopes are those of a small turn on the left. Numbers instead of arrays, because there are few.

    Parameters
    ----------
    values, step : (3 n,) rotation vectors, one after the other [rad]

    Returns
    -------
    (3 n,) [rad]

    Raises
    ------
    ValueError : values or steps are not three for each rotation

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> quarter = np.array([0.0, 0.0, 0.5 * np.pi])
    >>> (mm.fit.turned(quarter, quarter) / np.pi).round(6).tolist()
    [0.0, 0.0, 1.0]
    """
    pairs = zip(step.reshape(-1, 3).tolist(), values.reshape(-1, 3).tolist(), strict=True)
    return np.array([_vector(_product(_quaternion(s), _quaternion(v))) for s, v in pairs]).ravel()


def _quaternion(vector: Sequence[float]) -> tuple[float, float, float, float]:
    """Convert a rotation vector [rad] to a unit quaternion w, x, y, z."""
    x, y, z = vector
    angle = math.hypot(x, y, z)
    share = math.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    return math.cos(0.5 * angle), share * x, share * y, share * z


def _product(first: Sequence[float], second: Sequence[float]) -> tuple[float, float, float, float]:
    """Multiply quaternions w, x, y, z: the first rotation after the second one."""
    a, b, c, d = first
    w, x, y, z = second
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def _vector(quaternion: Sequence[float]) -> tuple[float, float, float]:
    """Convert a quaternion to a rotation vector of at most half a turn [rad]."""
    w, x, y, z = quaternion
    sine = math.hypot(x, y, z)
    # A quaternion and its negative are the same rotation; with w >= 0 it is the shorter way.
    half = math.atan2(sine, abs(w))
    factor = math.copysign(2.0 * half / sine if sine > 0.0 else 2.0, w)
    return factor * x, factor * y, factor * z


@dataclass(frozen=True, kw_only=True)
class Block:
    """Unknowns that are estimated or held together, under one name.

    Attributes
    ----------
    name : as residuals and `fit = [...]` call it: "lengths"
    unknowns : in the order of their values
    chart : how a step moves the values: `added`, or `turned` for rotation vectors
    limit : from values of all blocks, within their bounds, to the nearest values (unknowns of the
        block,) that those of other blocks allow; None where bounds say all. Only where every chart
        adds
    """

    name: str
    unknowns: tuple[Unknown, ...]
    chart: Chart = added
    limit: Callable[[Values], Array] | None = None

    def __len__(self) -> int:
        return len(self.unknowns)


@dataclass(frozen=True)
class Unknowns:
    """All unknowns of an estimate. Their order in vectors is that of the blocks, stated here once.

    Examples
    --------
    >>> from myomorph.core.fit.unknowns import Block, Unknown, Unknowns
    >>> clock = Block(name="clock", unknowns=(Unknown(name="delay", unit="s", sd=0.05),))
    >>> Unknowns((clock,)).names
    ('delay',)
    """

    blocks: tuple[Block, ...]

    def __post_init__(self) -> None:
        for kind, names in (
            ("blocks of unknowns", [block.name for block in self.blocks]),
            ("unknowns", self.names),
        ):
            twice = [name for name, count in Counter(names).items() if count > 1]
            if twice:
                raise BadData(f"several {kind} are called '{twice[0]}'")

    def __len__(self) -> int:
        return sum(map(len, self.blocks))

    def __iter__(self) -> Iterator[Unknown]:
        return (unknown for block in self.blocks for unknown in block.unknowns)

    def __add__(self, other: Unknowns) -> Unknowns:
        """Both lists; a block that both have must be the same, and is there once."""
        mine = {block.name: block for block in self.blocks}
        for block in other.blocks:
            if mine.setdefault(block.name, block) != block:
                raise BadData(
                    f"unknowns '{block.name}' are declared twice, with different properties"
                )
        return Unknowns(tuple(mine.values()))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of every unknown, in order."""
        return tuple(unknown.name for unknown in self)

    @cached_property
    def slices(self) -> Mapping[str, slice]:
        """Where each block lies in a vector of all unknowns."""
        ends = np.cumsum([0, *map(len, self.blocks)]).tolist()
        pairs = zip(self.blocks, ends[:-1], ends[1:], strict=True)
        return FrozenMap({block.name: slice(first, last) for block, first, last in pairs})

    @cached_property
    def start(self) -> Array:
        """Starts (unknowns,)."""
        return self._column(unknown.start for unknown in self)

    @cached_property
    def low(self) -> Array:
        """Lower bounds (unknowns,)."""
        return self._column(unknown.low for unknown in self)

    @cached_property
    def high(self) -> Array:
        """Upper bounds (unknowns,)."""
        return self._column(unknown.high for unknown in self)

    @cached_property
    def scale(self) -> Array:
        """Scales (unknowns,)."""
        return self._column(unknown.scale for unknown in self)

    @cached_property
    def mean(self) -> Array:
        """(unknowns,) of the prior; where there is none, the start."""
        return self._column(
            unknown.start if unknown.mean is None else unknown.mean for unknown in self
        )

    @cached_property
    def sd(self) -> Array:
        """(unknowns,) of the prior; infinite where there is none."""
        return self._column(np.inf if unknown.sd is None else unknown.sd for unknown in self)

    def vector(self, values: Mapping[str, Array]) -> Array:
        """Join values by block to a vector.

        Parameters
        ----------
        values : of some blocks, (unknowns of the block,) each; the others stand at their start

        Returns
        -------
        (unknowns,)
        """
        x = np.array(self.start)
        for name, part in values.items():
            x[self.slices[name]] = part
        return x

    def index(self, blocks: Sequence[str]) -> NDArray[np.intp]:
        """Find the columns of some blocks in a vector of all unknowns.

        Parameters
        ----------
        blocks : names

        Returns
        -------
        (unknowns of the blocks,) block after block
        """
        every = np.arange(len(self))
        chosen = [every[self.slices[name]] for name in blocks]
        return np.concatenate([np.zeros(0, np.intp), *chosen])

    def free(self, blocks: Sequence[str] | None = None) -> Bools:
        """Tell which unknowns are searched for.

        Parameters
        ----------
        blocks : names of those that are fitted, by default all

        Returns
        -------
        (unknowns,) those of the blocks that are not fixed

        Raises
        ------
        UnknownName : a block that these unknowns do not have
        """
        known = tuple(self.slices)
        chosen = known if blocks is None else tuple(blocks)
        for name in chosen:
            check_name("unknowns", name, known, "what can be estimated here")
        free = np.zeros(len(self), np.bool_)
        free[self.index(chosen)] = True
        return free & ~np.array([unknown.fixed for unknown in self], np.bool_)

    def moved(self, x: Array, step: Array) -> Array:
        """Take a step, each block by its chart.

        Parameters
        ----------
        x, step : (unknowns,)

        Returns
        -------
        (unknowns,)
        """
        parts = [
            block.chart(x[self.slices[block.name]], step[self.slices[block.name]])
            for block in self.blocks
        ]
        return np.concatenate([np.zeros(0), *parts])

    def within(self, x: Array) -> Array:
        """Bring values within their bounds, and within what blocks allow each other.

        Parameters
        ----------
        x : (unknowns,)

        Returns
        -------
        (unknowns,)
        """
        inside = np.clip(x, self.low, self.high)
        for block in self.blocks:
            if block.limit is not None:
                inside[self.slices[block.name]] = block.limit(Values(self, inside))
        return inside

    def taken(self, step: Array, before: Array, after: Array) -> Array:
        """Find the step that was taken, where `within` may have changed it.

        Parameters
        ----------
        step : (unknowns,) that was wanted, within the bounds
        before, after : (unknowns,) values

        Returns
        -------
        (unknowns,)
        """
        limited = any(block.limit is not None for block in self.blocks)
        return after - before if limited else step

    def _column(self, values: Iterable[float]) -> Array:
        return frozen_array([float(value) for value in values])


class Values:
    """Values of all unknowns: by the name of a block (unknowns of the block,), together in `x`."""

    __slots__ = ("_shared", "unknowns", "x")

    def __init__(self, unknowns: Unknowns, x: Array):
        self.unknowns = unknowns
        self.x = x
        self._shared: dict[str, Any] = {}

    def __getitem__(self, block: str) -> Array:
        return self.x[self.unknowns.slices[block]]

    def nudged(self, index: int, size: float) -> Values:
        """Move one unknown (by its place in `x`) a step further, by its block's chart."""
        step = np.zeros(len(self.x))
        step[index] = size
        return Values(self.unknowns, self.unknowns.moved(self.x, step))

    def shared(self, name: str, make: Callable[[], Made]) -> Made:
        """Make once what several residuals need at these values, as the poses of all frames."""
        if name not in self._shared:
            self._shared[name] = make()
        made: Made = self._shared[name]
        return made
