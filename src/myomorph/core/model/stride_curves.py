"""Curves of a result over strides, each from one foot strike to the next of the same foot."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.curve_columns import CurveColumns
from myomorph.core.model.cycle_samples import over_spans
from myomorph.core.model.errors import BadData, UnknownName, counted, from_extra
from myomorph.core.model.plots import plot_over_strides
from myomorph.core.model.sides import split_side

if TYPE_CHECKING:
    import pandas
    import xarray

STRIKES = ("foot strike", "foot contact", "heel strike", "initial contact")
"""What laboratories call a foot strike, in small letters."""
SIDES = ("right", "left")


class StrideLike(Protocol):
    """A stride of a limb."""

    @property
    def limb(self) -> str:
        """Name of the limb."""

    @property
    def start(self) -> float:
        """Time of its foot strike [s]."""

    @property
    def stop(self) -> float:
        """Time of the next one [s]."""


class EventLike(Protocol):
    """A named instant of a recording."""

    @property
    def time(self) -> float:
        """When it is [s]."""

    @property
    def label(self) -> str:
        """What happens, as "Foot Strike"."""

    @property
    def side(self) -> str:
        """Side of the body, as "Right"."""


class StridesLike(Protocol):
    """Strides that were found in a motion."""

    @property
    def strides(self) -> Sequence[StrideLike]:
        """Strides of all limbs."""


@dataclass(frozen=True)
class StrideSpan:
    """Time of a stride.

    Attributes
    ----------
    limb : name of the foot, or its side
    start, stop : of the stride [s]
    """

    limb: str
    start: float
    stop: float


@read_only
class StrideCurves:
    """Columns of a result over strides, from 0 to 100 % of each.

    A name with a side belongs to the strides of that side's foot, any other one to those of the
    first foot: `curves["knee_angle_r"]`, `mean` and `sd` are over these.

    Attributes
    ----------
    names : of the columns
    values : (strides, 101, names), NaN where the result is not known
    limbs : foot of each stride, or its side
    start, stop : (strides,) foot strikes [s]
    quantity : name of what the values are, "" where it is not known
    units : one per name, () where they are not known
    """

    names: tuple[str, ...]
    values: Array
    limbs: tuple[str, ...]
    start: Array
    stop: Array
    quantity: str = field(default="", kw_only=True)
    units: tuple[str, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        count = len(self.limbs)
        freeze(self, values=(count, -1, len(self.names)), start=(count,), stop=(count,))

    def __len__(self) -> int:
        return len(self.limbs)

    def __getitem__(self, name: str) -> Array:
        """Find a column over the strides of its own foot, (strides, 101); raises `UnknownName`."""
        return self.values[self._own(name), :, self._column(name)]

    @property
    def headline(self) -> str:
        """How many strides of which foot there are, in one line."""
        feet = dict.fromkeys(self.limbs)
        strides = " and ".join(f"{self.limbs.count(foot)} of '{foot}'" for foot in feet)
        return f"{counted(len(self.names), 'curve')} over {strides or 'no strides'}"

    @property
    def percent(self) -> Array:
        """(101,) of the stride [%]."""
        return np.linspace(0.0, 100.0, self.values.shape[1])

    @property
    def sides(self) -> tuple[str, ...]:
        """Side of each stride: "right", "left", or "" of a foot without one."""
        return tuple(map(side_of, self.limbs))

    def of(self, foot: str) -> Self:
        """Take the strides of a foot, or of a side; raises `UnknownName`."""
        sides = self.sides
        rows = [
            row
            for row, limb in enumerate(self.limbs)
            if foot == limb or (foot in SIDES and foot == sides[row])
        ]
        if not rows:
            raise UnknownName("foot", foot, dict.fromkeys(self.limbs), where="the strides")
        return type(self)(
            names=self.names,
            values=self.values[rows],
            limbs=tuple(self.limbs[row] for row in rows),
            start=self.start[rows],
            stop=self.stop[rows],
            quantity=self.quantity,
            units=self.units,
        )

    def mean(self, name: str = "") -> Array:
        """Average over the strides of each name's own foot.

        Parameters
        ----------
        name : of one column, "" for all

        Returns
        -------
        (101,), or (101, names); NaN where no stride is known

        Raises
        ------
        UnknownName : there is no such column
        """
        if name:
            return _known_mean(self[name])
        return np.stack([_known_mean(self[one]) for one in self.names], axis=-1)

    def sd(self, name: str = "") -> Array:
        """Return the standard deviation of a sample between strides of each name's own foot.

        Parameters
        ----------
        name : of one column, "" for all

        Returns
        -------
        (101,), or (101, names); NaN where fewer than two strides are known

        Raises
        ------
        UnknownName : there is no such column
        """
        if name:
            return _known_sd(self[name])
        return np.stack([_known_sd(self[one]) for one in self.names], axis=-1)

    def plot(self, names: Sequence[str] = (), axes: Any = None) -> Any:
        """Draw curves over strides with matplotlib, right and left of a name together.

        Each stride is a thin line and their mean a thick one; five strides or more have a band of
        one standard deviation.

        Parameters
        ----------
        names : curves, with or without their side: "knee_angle" draws both; () for all, or for
            those with the largest values where there are many
        axes : to draw into, one per panel; None makes a new figure

        Returns
        -------
        the axes; `axes[0].figure` is the figure

        Raises
        ------
        UnknownName : there is no such curve
        BadData : there are fewer axes than panels
        MissingPackage : matplotlib is not installed
        """
        return plot_over_strides(self, names, axes=axes)

    def to_pandas(self) -> pandas.DataFrame:
        """Put all strides into one `pandas.DataFrame`.

        A row is a stride and a percent of it, a column a name. `attrs["units"]` has the unit of
        each column.
        """
        pandas = from_extra("xarray", "pandas")
        count, samples, columns = self.values.shape
        rows = pandas.MultiIndex.from_arrays(
            [
                np.repeat(np.array(self.limbs, dtype=object), samples),
                np.repeat(np.arange(1, count + 1), samples),
                np.tile(self.percent, count),
            ],
            names=["foot", "stride", "percent"],
        )
        frame = pandas.DataFrame(
            self.values.reshape(count * samples, columns), index=rows, columns=list(self.names)
        )
        frame.attrs["units"] = dict(zip(self.names, self.units, strict=False))
        return frame

    def to_xarray(self) -> xarray.Dataset:
        """Put all strides into one `xarray.Dataset` over stride, percent and name."""
        xarray = from_extra("xarray", "xarray")
        return xarray.Dataset(
            {self.quantity or "values": (("stride", "percent", "name"), self.values)},
            {
                "stride": np.arange(1, len(self) + 1),
                "percent": ("percent", self.percent, {"units": "%"}),
                "name": list(self.names),
                "unit": ("name", list(self.units or [""] * len(self.names))),
                "foot": ("stride", list(self.limbs)),
                "side": ("stride", list(self.sides)),
                "start": ("stride", self.start, {"units": "s"}),
                "stop": ("stride", self.stop, {"units": "s"}),
            },
        )

    def _column(self, name: str) -> int:
        """Place of a name; raises `UnknownName`."""
        if name not in self.names:
            raise UnknownName("curve", name, self.names, where="the strides")
        return self.names.index(name)

    def _own(self, name: str) -> list[int]:
        """Rows of the strides that a name belongs to; raises `UnknownName`."""
        self._column(name)
        feet = list(dict.fromkeys(self.limbs))
        side = split_side(name)[1]
        own = next((foot for foot in feet if side and side_of(foot) == side), None)
        # A foot of the other side alone shows no stride of this one.
        foot = own if side else feet[0]
        return [row for row, limb in enumerate(self.limbs) if limb == foot]


def side_of(foot: str) -> str:
    """Return the side of a foot: "right", "left", or "" where it has none."""
    return foot if foot in SIDES else split_side(foot)[1]


def stride_spans(
    strikes: StridesLike | Iterable[EventLike] | Mapping[str, ArrayLike] | None,
) -> tuple[StrideSpan, ...]:
    """Find the strides that strikes mark, in the order of time.

    Parameters
    ----------
    strikes : strides as `walking_strides` finds them; events of a recording, of which foot strikes
        with a side count; or times of foot strikes by foot [s]

    Raises
    ------
    BadData : they are none of these, or mark no stride
    """
    strides = getattr(strikes, "strides", None)
    if isinstance(strides, tuple | list):
        spans = [StrideSpan(limb=one.limb, start=one.start, stop=one.stop) for one in strides]
    elif isinstance(strikes, Mapping):
        spans = list(_spans_between(strikes))
    elif isinstance(strikes, Iterable) and not isinstance(strikes, str):
        spans = list(_spans_between(_event_strikes(strikes)))
    else:
        kind = "None: is it a walk?" if strikes is None else type(strikes).__name__
        raise BadData(
            f"strikes: expected strides, events of foot strikes or times by foot, but got {kind}"
        )
    if not spans:
        raise BadData("strikes: they mark no stride, which takes two foot strikes of one foot")
    return tuple(sorted(spans, key=lambda span: span.start))


def _event_strikes(events: Iterable[EventLike]) -> dict[str, list[float]]:
    """Collect times of foot strikes by side, of events that have one [s]."""
    strikes: dict[str, list[float]] = {}
    for event in events:
        label = event.label.lower().replace("_", " ").strip()
        side = event.side.lower()
        if label in STRIKES and side in SIDES:
            strikes.setdefault(side, []).append(event.time)
    return strikes


def _spans_between(strikes: Mapping[str, ArrayLike]) -> Iterable[StrideSpan]:
    """Yield a stride for every two neighbors among the strikes of a foot."""
    for limb, times in strikes.items():
        for start, stop in itertools.pairwise(np.sort(np.asarray(times, dtype=np.float64))):
            yield StrideSpan(limb=limb, start=float(start), stop=float(stop))


def curves_over(columns: CurveColumns, spans: Sequence[StrideSpan]) -> StrideCurves:
    """Resample columns over strides.

    Parameters
    ----------
    columns : of a quantity over time, NaN where not known
    spans : of the strides
    """
    sampled = over_spans(columns.time, columns.values, [(span.start, span.stop) for span in spans])
    return StrideCurves(
        names=columns.names,
        values=sampled,
        limbs=tuple(span.limb for span in spans),
        start=np.array([span.start for span in spans]),
        stop=np.array([span.stop for span in spans]),
        quantity=columns.quantity,
        units=columns.units,
    )


def _known_mean(curves: Array) -> Array:
    """Mean (101,) of curves (strides, 101) where they are known, NaN where none is."""
    count = np.isfinite(curves).sum(axis=0)
    return np.where(count > 0, np.nansum(curves, axis=0) / np.maximum(count, 1), np.nan)


def _known_sd(curves: Array) -> Array:
    """Return the standard deviation (101,) of a sample of curves (strides, 101).

    NaN where fewer than two are known.
    """
    known = np.isfinite(curves)
    count = known.sum(axis=0)
    squares = np.where(known, curves - _known_mean(curves), 0.0) ** 2
    variance = squares.sum(axis=0) / np.maximum(count - 1, 1)
    return np.where(count > 1, np.sqrt(variance), np.nan)
