"""Drawings of curves with matplotlib, an extra: over time, and over strides.

A panel holds a name with both of its sides, right in blue and solid, left in orange and dashed, as
pages of the report draw them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.curve_columns import CurveColumns
from myomorph.core.model.errors import BadData, UnknownName, from_extra
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.sides import split_side
from myomorph.core.model.units import conversion, shown_unit

EXTRA = "plot"
MAX_PANELS = 12
MAX_COLUMNS = 3
PANEL = (3.4, 2.2)
"""Width and height of a panel [inch]."""
MIN_BAND = 5  # So many strides have a band of a standard deviation; fewer are drawn each.
WIDTH = 1.6
FAINT = 0.35
BAND = 0.18
"""Opacities of single strides beside their mean, and of bands."""
PERCENT = "% of stride"
SECONDS = "time [s]"


class LineStyle(NamedTuple):
    """How the curve of a side looks.

    Attributes
    ----------
    color : "#rrggbb"
    dashes : as matplotlib calls them
    """

    color: str
    dashes: str


STYLES: Mapping[str, LineStyle] = FrozenMap(
    {
        "right": LineStyle(color="#0072b2", dashes="-"),
        "left": LineStyle(color="#c25200", dashes="--"),
        "": LineStyle(color="#3d444d", dashes="-"),
    }
)
"""By side, "" for names without one."""


class CurvesOverStrides(Protocol):
    """Curves (strides, percent, names) over strides, of which each name has its own."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the curves."""

    @property
    def values(self) -> Array:
        """(strides, percent, names)."""

    @property
    def percent(self) -> Array:
        """(percent,) of the stride [%]."""

    @property
    def quantity(self) -> str:
        """What the values are."""

    @property
    def units(self) -> tuple[str, ...]:
        """One per name, () where they are not known."""

    def __getitem__(self, name: str) -> Array:
        """Find a curve over the strides of its own foot, (strides, percent)."""


class Limits(NamedTuple):
    """Interval of each value.

    Attributes
    ----------
    low, high : (frames, names)
    """

    low: Array
    high: Array


class Curve(NamedTuple):
    """A curve of a panel.

    Attributes
    ----------
    column : its place among the names
    side : "right", "left" or ""
    factor : from its unit to the one that is shown
    """

    column: int
    side: str
    factor: float


class Panel(NamedTuple):
    """Curves that are drawn together.

    Attributes
    ----------
    title : their name without the side
    unit : that is shown, "" for none
    curves : right before left
    """

    title: str
    unit: str
    curves: tuple[Curve, ...]


def plot_over_time(
    columns: CurveColumns,
    names: Sequence[str] = (),
    *,
    limits: Limits | None = None,
    axes: Any = None,
) -> Any:
    """Draw columns over time.

    Parameters
    ----------
    columns : of a quantity
    names : that are drawn, with or without their side; () for all, or those with the largest values
    limits : of the columns, drawn as bands
    axes : to draw into, one per panel; None makes a new figure

    Returns
    -------
    the axes, an array of one per panel

    Raises
    ------
    UnknownName : there is no such name
    BadData : there are fewer axes than panels
    MissingPackage : matplotlib is not installed
    """
    panels = _panels(columns, names)
    drawn = _axes(len(panels), axes, SECONDS)
    for panel, at in zip(panels, drawn, strict=True):
        for curve in panel.curves:
            style = STYLES[curve.side]
            values = curve.factor * columns.values[:, curve.column]
            _line(at, columns.time, values, style, label=curve.side)
            if limits is not None:
                low = curve.factor * limits.low[:, curve.column]
                high = curve.factor * limits.high[:, curve.column]
                at.fill_between(columns.time, low, high, color=style.color, alpha=BAND, lw=0)
    _finish(panels, drawn)
    return drawn


def plot_over_strides(
    curves: CurvesOverStrides, names: Sequence[str] = (), *, axes: Any = None
) -> Any:
    """Draw curves over strides: each stride, and their mean; of many strides a band.

    Parameters
    ----------
    curves : over strides
    names : that are drawn, with or without their side; () for all, or those with the largest values
    axes : to draw into, one per panel; None makes a new figure

    Returns
    -------
    the axes, an array of one per panel

    Raises
    ------
    UnknownName : there is no such name
    BadData : there are fewer axes than panels
    MissingPackage : matplotlib is not installed
    """
    columns = CurveColumns(
        time=curves.percent,
        names=curves.names,
        values=np.nan_to_num(curves.values).reshape(-1, len(curves.names)),
        quantity=curves.quantity,
        units=curves.units or ("",) * len(curves.names),
    )
    panels = _panels(columns, names)
    drawn = _axes(len(panels), axes, PERCENT)
    for panel, at in zip(panels, drawn, strict=True):
        for curve in panel.curves:
            name = curves.names[curve.column]
            style = STYLES[curve.side]
            _strides(at, curves.percent, curve.factor * curves[name], style, curve.side)
    _finish(panels, drawn)
    return drawn


def _strides(at: Any, percent: Array, strides: Array, style: LineStyle, label: str) -> None:
    """Draw the strides (strides, 101) of one curve and their mean."""
    known = strides[np.isfinite(strides).any(axis=1)]
    if not len(known):
        return
    mean = np.nanmean(known, axis=0)
    _line(at, percent, mean, style, label=label)
    if len(known) >= MIN_BAND:
        sd = np.nanstd(known, axis=0, ddof=1)
        at.fill_between(percent, mean - sd, mean + sd, color=style.color, alpha=BAND, lw=0)
    elif len(known) > 1:
        for stride in known:
            at.plot(percent, stride, color=style.color, alpha=FAINT, lw=0.5 * WIDTH)


def _line(at: Any, x: Array, values: Array, style: LineStyle, label: str) -> None:
    at.plot(x, values, color=style.color, linestyle=style.dashes, lw=WIDTH, label=label or None)


def _panels(columns: CurveColumns, names: Sequence[str]) -> list[Panel]:
    """Put columns of one name and both sides together, those that are asked for."""
    groups: dict[str, list[int]] = {}
    for column, name in enumerate(columns.names):
        groups.setdefault(_base(name, columns.vectors), []).append(column)
    chosen = dict(_chosen(groups, columns, names)) if names else _largest(groups, columns)
    return [_panel(title, group, columns) for title, group in chosen.items()]


def _base(name: str, vector: bool) -> str:
    """Return a name without its side; of a component of a vector with the axis."""
    if not vector:
        return split_side(name)[0]
    return f"{split_side(name[:-2])[0]}{name[-2:]}"


def _side(name: str, vector: bool) -> str:
    return split_side(name[:-2] if vector else name)[1]


def _chosen(
    groups: Mapping[str, Sequence[int]], columns: CurveColumns, names: Sequence[str]
) -> Iterator[tuple[str, Sequence[int]]]:
    """Yield the groups and single columns that are named; raises `UnknownName`."""
    for name in [names] if isinstance(names, str) else names:
        if name in columns.names:
            yield name, [columns.names.index(name)]
        elif name in groups:
            yield name, groups[name]
        else:
            raise UnknownName("curve", name, [*columns.names, *groups], where="the result")


def _largest(
    groups: Mapping[str, Sequence[int]], columns: CurveColumns
) -> dict[str, Sequence[int]]:
    """Take the groups that change, of many those with the largest values, in their order."""
    sizes = {}
    for title, group in groups.items():
        values = columns.values[:, group]
        changes = np.isfinite(values).any() and np.nanmax(np.nanstd(values, axis=0)) > 0.0
        sizes[title] = float(np.nanmax(np.abs(values))) if changes else 0.0
    kept = sorted(filter(sizes.get, sizes), key=lambda title: -sizes[title])[:MAX_PANELS]
    if not kept:
        raise BadData(f"'{columns.quantity or 'the result'}' has no curve that changes: name some")
    return {title: group for title, group in groups.items() if title in kept}


def _panel(title: str, group: Sequence[int], columns: CurveColumns) -> Panel:
    unit = columns.units[group[0]]
    shown = shown_unit(unit)
    factor = conversion(unit, shown) or 1.0
    curves = [
        Curve(column=column, side=_side(columns.names[column], columns.vectors), factor=factor)
        for column in group
    ]
    ordered = sorted(curves, key=lambda curve: list(STYLES).index(curve.side))
    return Panel(title=title, unit=shown, curves=tuple(ordered))


def _axes(count: int, given: Any, x_label: str) -> np.ndarray:
    """Return one axes per panel, those given or those of a new figure."""
    if given is not None:
        flat = np.atleast_1d(np.asarray(given, dtype=object)).ravel()
        if len(flat) < count:
            raise BadData(f"{count} panels are drawn, but {len(flat)} axes were given")
        drawn = flat[:count]
    else:
        pyplot = from_extra(EXTRA, "matplotlib.pyplot", "matplotlib")
        across = min(count, MAX_COLUMNS)
        down = math.ceil(count / across)
        size = (PANEL[0] * across, PANEL[1] * down)
        _, grid = pyplot.subplots(down, across, figsize=size, squeeze=False, layout="constrained")
        drawn = grid.ravel()[:count]
        for unused in grid.ravel()[count:]:
            unused.remove()
    for at in drawn:
        at.set_xlabel(x_label)
    return drawn


def _finish(panels: Sequence[Panel], drawn: np.ndarray) -> None:
    """Write titles and units, and which line is which where there are both sides."""
    for panel, at in zip(panels, drawn, strict=True):
        at.set_title(panel.title, fontsize="medium", loc="left")
        at.set_ylabel(f"[{panel.unit}]" if panel.unit else "")
        at.margins(x=0.0)
        at.spines[["top", "right"]].set_visible(False)
    both = [
        at for panel, at in zip(panels, drawn, strict=True) if any(c.side for c in panel.curves)
    ]
    if both:
        place = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.98), "ncols": 2}
        both[0].legend(frameon=False, fontsize="small", borderaxespad=0.0, **place)
