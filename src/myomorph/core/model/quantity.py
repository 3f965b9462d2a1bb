"""A quantity of the results: its name, axes, unit and files, declared once."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import Any, Literal, Self

import numpy as np

from myomorph.core.model.errors import BadData, check_choices
from myomorph.core.model.shown import shown
from myomorph.core.model.units import MotionKind, conversion, unit_by_motion

Kind = Literal["number", "single", "count", "code", "flag", "text"]
Statistic = Literal["minimum", "maximum", "range", "mean"]
Bound = Literal["low", "high", "sd"]

STORED_KINDS: dict[str, Any] = {
    "number": np.float64,
    "single": np.float32,
    "count": np.int32,
    "code": np.int8,
    "flag": np.int8,
}
"""Type of the numbers of each kind in a result file."""

NAME = re.compile(r"[a-z][a-z0-9_]*")
FILE = re.compile(r"[a-z][a-z0-9_]*(\{\w+\})?\.(sto|mot|csv)")
CLOCK = "time"
"""Axes of times end in it."""

BOUNDS: dict[Bound, str] = {
    "low": "lower limit of 90 %",
    "high": "upper limit of 90 %",
    "sd": "standard deviation of the draws",
}
"""Drawn values of a quantity: the end of their names, and their meaning."""

SHARES = {
    "alone": "share of the variance, by itself",
    "total": "share of the variance, with all others",
}
"""Contributions of groups of error sources to the variance of a drawn quantity."""

SOURCE_GROUP = "error_group"
"""Axis of the groups of error sources."""


@dataclass(frozen=True, kw_only=True)
class Tidy:
    """Place of a quantity in `values.csv` and `curves.csv`.

    Attributes
    ----------
    statistics : of each column over the trial and over strides
    endings : of the columns' names; two for rotations and for translations
    unit : in `values.csv`, "" for the quantity's own
    curve : what its curves over the cycle are called, "" for none
    curve_unit : of the curves, "" for none; columns whose unit has no such are not drawn
    """

    statistics: tuple[Statistic, ...]
    endings: tuple[str, ...] = ("",)
    unit: str = ""
    curve: str = ""
    curve_unit: str = ""

    def __post_init__(self) -> None:
        if not self.statistics or len(self.endings) not in (1, 2):
            raise BadData("a tidy quantity has at least one statistic, and one or two endings")

    @property
    def heading(self) -> str:
        """Name of the curves with their unit."""
        return f"{self.curve} [{self.curve_unit}]" if self.curve_unit else self.curve

    def ending(self, motion: MotionKind = "rotational") -> str:
        """Return the end of a column's name, by how its coordinate moves."""
        return self.endings[0 if motion == "rotational" else -1]


@shown
@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A quantity that a result holds: declared once, next to what computes it.

    Result files, tables, `to_xarray`, `to_pandas`, tidy tables, drawn intervals, pages of the
    report, BIDS and the documentation's table follow from it.

    Attributes
    ----------
    name : of the variable in result files and in xarray
    dims : names of its axes; what has times begins with them
    unit : in SI, "1" where it has none, "N m or N" of rotations and of translations, "" of texts
    meaning : one line
    attribute : path to it in the value that holds it, "" for its name
    kind : "number" and "single" are floats of 8 and 4 bytes; "count" and "code" integers of 4 and
        1; "flag" is a truth value, "text" a text for each entry
    packed : its axes in a result file, where that holds only the entries that can differ from 0
    stored : whether a result file holds it; else only its table and its drawn intervals
    file : table in the folder of results, with the name that OpenSim's users know; "" for none
    title : of that table, in its header
    endings : of that table's columns after the names of the last axis: one, or two for rotations
        and for translations
    file_unit : of that table, "" for the quantity's own
    label : what pages of the report call it, "" for its meaning
    tidy : its place in tables of values and curves, None for none
    drawn : whether intervals of it are drawn
    bounds : values that cannot be passed, whatever the intervals' widening
    """

    name: str
    dims: tuple[str, ...]
    unit: str
    meaning: str
    attribute: str = ""
    kind: Kind = "number"
    packed: tuple[str, ...] = ()
    stored: bool = True
    file: str = ""
    title: str = ""
    endings: tuple[str, ...] = ("",)
    file_unit: str = ""
    label: str = ""
    tidy: Tidy | None = None
    drawn: bool = False
    bounds: tuple[float, float] = (-np.inf, np.inf)

    def __post_init__(self) -> None:
        check_choices(self)
        for name in (self.name, *self.dims, *self.packed):
            if not NAME.fullmatch(name):
                raise BadData(
                    f"quantity '{self.name}': '{name}' is not a valid name: expected a-z, 0-9, _"
                )
        if len(set(self.dims)) != len(self.dims):
            raise BadData(f"quantity '{self.name}' has an axis twice: {', '.join(self.dims)}")
        if bool(self.unit) == (self.kind == "text"):
            raise BadData(
                f"quantity '{self.name}' has the unit '{self.unit}': expected one ('1' for none),"
                " but none of texts"
            )
        if not self.meaning or "\n" in self.meaning:
            raise BadData(f"quantity '{self.name}': expected its meaning in one line")
        if self.file and not FILE.fullmatch(self.file):
            raise BadData(
                f"quantity '{self.name}': '{self.file}' is not a valid name of a .sto, .mot, .csv"
            )
        if self.tidy is not None and not (self.over_time and len(self.dims) == 2):
            raise BadData(f"quantity '{self.name}': tables of values need one column a name")

    @cached_property
    def field(self) -> str:
        """Path to it in the value that holds it."""
        return self.attribute or self.name

    @property
    def over_time(self) -> bool:
        """Whether its first axis is a clock."""
        return bool(self.dims) and self.dims[0].endswith(CLOCK)

    @property
    def stored_dims(self) -> tuple[str, ...]:
        """Names of its axes in a result file."""
        return self.packed or self.dims

    @property
    def words(self) -> str:
        """Name of it on pages."""
        return self.label or self.meaning

    @property
    def stem(self) -> str:
        """Name of its table without the ending; its own where it has no table."""
        return self.file.rpartition(".")[0] or self.name

    @property
    def column(self) -> str:
        """Name of its column in a table whose columns are unlike quantities, with its unit."""
        return self.field if self.unit in ("", "1") else f"{self.field}_{self.unit}"

    @property
    def suffix(self) -> str:
        """Ending of its tables."""
        return f".{self.file.rpartition('.')[2]}" if self.file else ".sto"

    def of(self, value: object) -> Any:
        """Return the array, or the texts, in a value that holds it; None where it has none."""
        return attrgetter(self.field)(value)

    def unit_of(self, motion: MotionKind = "rotational") -> str:
        """Return the unit of one column, by how its coordinate moves."""
        return unit_by_motion(self.unit, motion)

    def ending_of(self, motion: MotionKind = "rotational") -> str:
        """Return the end of a column's name in its table, by how its coordinate moves."""
        return self.endings[0 if motion == "rotational" else -1]

    def stored_array(self, values: Any) -> np.ndarray:
        """Return values as a result file holds them.

        Parameters
        ----------
        values : on the quantity's axes, in its unit

        Returns
        -------
        the same in the type of its kind
        """
        return np.asarray(values).astype(STORED_KINDS[self.kind])

    def restored(self, values: np.ndarray) -> np.ndarray:
        """Return values of a result file as the value that holds them had them.

        Parameters
        ----------
        values : on the quantity's axes, in the type of its kind

        Returns
        -------
        truth values of flags, integers of counts, floats of 8 bytes of others
        """
        if self.kind == "flag":
            return np.asarray(values != 0)
        if self.kind == "count":
            return values.astype(np.int64)
        return np.asarray(values, np.float64) if self.kind == "single" else values

    def replaced(self, **changes: Any) -> Self:
        """Return the quantity declared in part otherwise: held by another field, for example."""
        return replace(self, **changes)

    def derived(self, **changes: Any) -> Self:
        """Return a quantity that follows from this one, and has no table of its own."""
        own = {"name": self.name, "dims": self.dims, "unit": self.unit, "meaning": self.meaning}
        return type(self)(**{**own, **changes})

    def bound(self, bound: Bound) -> Self:
        """Return a limit, or the standard deviation, of its draws."""
        return self.derived(name=f"{self.name}_{bound}", meaning=BOUNDS[bound])

    def share(self, kind: str) -> Self:
        """Return the shares of groups of error sources in its variance: "alone" or "total"."""
        return self.derived(
            name=f"{self.name}_{kind}",
            dims=(SOURCE_GROUP, *self.dims[1:]),
            unit="1",
            meaning=SHARES[kind],
        )

    @property
    def intervals(self) -> tuple[Self, ...]:
        """What a result file holds of its draws."""
        if not self.drawn:
            return ()
        return (*map(self.bound, BOUNDS), *map(self.share, SHARES))

    def tidy_unit(self, motion: MotionKind = "rotational") -> str:
        """Return the unit of a column in `values.csv`."""
        other = "" if self.tidy is None else self.tidy.unit
        return unit_by_motion(other or self.unit, motion)

    def tidy_factor(self, motion: MotionKind = "rotational") -> float:
        """Return the factor of a column to its unit in `values.csv`."""
        return conversion(self.unit_of(motion), self.tidy_unit(motion)) or 1.0

    def curve_factor(self, motion: MotionKind = "rotational") -> float | None:
        """Return the factor of a column of `values.csv` to its curve, None where it has none."""
        if self.tidy is None or not self.tidy.curve:
            return None
        return conversion(self.tidy_unit(motion), self.tidy.curve_unit or "1")


def declared_once(quantities: tuple[Quantity, ...]) -> tuple[Quantity, ...]:
    """Return the quantities, each once.

    Raises
    ------
    BadData : two of one name are not declared alike
    """
    by_name: dict[str, Quantity] = {}
    for quantity in quantities:
        known = by_name.setdefault(quantity.name, quantity)
        if known != quantity:
            raise BadData(f"the quantity '{quantity.name}' is declared twice, and not alike")
    return tuple(by_name.values())
