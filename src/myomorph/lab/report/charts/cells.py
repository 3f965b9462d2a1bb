"""Many values as colors: heat maps over time, and tables whose cells are colored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Event
from myomorph.lab.report.charts.axis import Axis
from myomorph.lab.report.charts.curves import event_line
from myomorph.lab.report.charts.marks import (
    Box,
    Frame,
    drawing,
    frame,
    grid_along,
    image,
    mark,
    rect,
    shortened,
    text,
    upright_text,
)
from myomorph.lab.report.scene.image import HEAT, data_uri, png

MAX_COLUMNS = 700
WIDTH = 1040
HEAT_TOP = 38.0  # Of the first block of a heat map [px]
HEAT_GAP = 14.0  # Between two blocks [px]
ROW = 19.0
LABEL = 190.0
LEAST_LEFT = 96.0
ROW_LETTER = 4.4
"""Width of a letter of the names beside a heat map, where there is `LEAST_LEFT` at least."""
SIDES = ("right", "left")


def pooled(values: Array, max_rows: int = MAX_COLUMNS) -> Array:
    """Cut values to few rows, each the largest of the frames it stands for.

    Parameters
    ----------
    values : (frames, n) NaN where not known
    max_rows : how many rows remain at most

    Returns
    -------
    (rows, n) NaN where nothing is known
    """
    if len(values) <= max_rows:
        return values
    edges = np.linspace(0, len(values), max_rows + 1).astype(np.int64)
    filled = np.where(np.isnan(values), -np.inf, values)
    largest: Array = np.maximum.reduceat(filled, edges[:-1], axis=0)
    return np.where(np.isfinite(largest), largest, np.nan)


@read_only
class Columns:
    """Values over time, in blocks.

    Attributes
    ----------
    time : (frames,) [s]
    values : (frames, columns) NaN where not known
    names : of the columns
    blocks : label and columns of each block; the label is a side or ""
    """

    time: Array
    values: Array
    names: Sequence[str]
    blocks: Sequence[tuple[str, NDArray[np.int64]]]

    @property
    def peak(self) -> float:
        """Largest value, 1 where none is above zero."""
        return float(np.max(self.values, where=np.isfinite(self.values), initial=0.0)) or 1.0

    @property
    def index(self) -> NDArray[np.uint8]:
        """Colors (rows, columns) of the values, pooled where there are many."""
        levels = np.round(np.nan_to_num(pooled(self.values)) / self.peak * 255.0)
        return np.clip(levels, 0, 255).astype(np.uint8)

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s]."""
        first = float(self.time[0])
        return first, max(float(self.time[-1]), first + 1e-9)


def heat_map(title: str, unit: str, columns: Columns, events: Sequence[Event] = ()) -> str:
    """Draw many columns over time as rows of color, light for zero, in labelled blocks.

    Parameters
    ----------
    title : of the chart
    unit : of the values
    columns : times, values and blocks
    events : drawn over the blocks of their side

    Returns
    -------
    The chart as an `<svg>` element
    """
    names = columns.names
    left = max(LEAST_LEFT, 24.0 + ROW_LETTER * max(map(len, names), default=0))
    right = WIDTH - 76.0
    peak = columns.peak
    index = columns.index
    row = _row_height(columns)
    parts = []
    y = HEAT_TOP
    for label, block in columns.blocks:
        below = y + len(block) * row
        area = frame((left, y), (right, below), columns.span, (0.0, float(len(block))))
        parts.append(_heat_block(area, label, [names[i] for i in block], index[:, block]))
        parts += _events_beside(area, label, events)
        y = below + HEAT_GAP
    bottom = y - HEAT_GAP
    whole = frame((left, HEAT_TOP), (right, bottom), columns.span, unit="s")
    parts.append(grid_along(whole, 9, lines=False, drop=14.0))
    start = HEAT_TOP + min(bottom - HEAT_TOP, 220.0)
    colors = Axis(low=0.0, high=peak, start=start, stop=HEAT_TOP)
    parts.append(_color_bar(right + 14, colors, unit))
    attributes = f'data-peak="{peak:.9g}" data-unit="{escape(unit, True)}"'
    return drawing(
        "heat", title, (WIDTH, int(bottom + 24)), *parts, unit=unit, attributes=attributes
    )


def _row_height(columns: Columns) -> float:
    """Height of a row of color [px], less where there are many."""
    count = int(sum(len(block) for _, block in columns.blocks))
    return 10.0 if count <= 90 else max(1.6, 900.0 / count)


def _events_beside(area: Frame, label: str, events: Sequence[Event]) -> list[str]:
    """Draw events of a block's side, or of no side."""
    return [
        event_line(area, event, "over")
        for event in events
        if (not event.side or not label or event.side.lower() == label.lower())
        and area.x.low <= event.time <= area.x.high
    ]


def _heat_block(area: Frame, label: str, names: Sequence[str], index: NDArray[np.uint8]) -> str:
    """Draw rows of the colors `index` (frames, rows) with the block's label.

    Names stand beside as many rows as have room for them.
    """
    y = area.y.stop
    tall = area.y.start - area.y.stop
    every = max(1, int(np.ceil(9.8 / (tall / len(names)))))
    address = data_uri(png(np.ascontiguousarray(index.T), HEAT))
    listed = escape("|".join(name.replace("|", "/") for name in names), True)
    parts = [
        f'<image class="heat" href="{address}" x="{area.x.start:g}" y="{y:.1f}" '
        f'width="{area.x.stop - area.x.start:g}" height="{tall:.1f}" preserveAspectRatio="none" '
        f'data-names="{listed}" {area.data}/>'
    ]
    for place in range(0, len(names), every):
        parts.append(
            text(
                area.x.start - 4,
                y + (place + 0.5) * tall / len(names) + 3,
                names[place],
                "tick y row",
            )
        )
    return "".join(parts) + (upright_text(10.0, y + tall / 2, label, "block") if label else "")


def _color_bar(x: float, axis: Axis, unit: str) -> str:
    """Draw the colors of the values along an upright axis."""
    address = data_uri(png(np.arange(255, -1, -1, dtype=np.uint8)[:, None], HEAT))
    parts = [
        image(
            address, Box(x=x, y=axis.stop, width=10.0, height=axis.start - axis.stop), stretch=True
        ),
        text(x + 5, axis.stop - 5, unit, "tick x"),
    ]
    for tick in axis.ticks(5):
        parts.append(mark("path", "grid", d=f"M{x + 10:.1f} {tick.position:.1f}h3"))
        parts.append(text(x + 16, tick.position + 3, tick.text, "tick end"))
    return "".join(parts)


@dataclass(frozen=True)
class Cell:
    """A colored cell of a table.

    It has a value between -1 and 1 that colors it, its printed text, and what is shown under the
    pointer.
    """

    value: float
    text: str = ""
    under: str = ""


def sided_table(
    title: str,
    unit: str,
    columns: Sequence[str],
    rows: Sequence[tuple[str, Sequence[Sequence[Cell | None]]]],
) -> str:
    """Draw a table of colored cells.

    Each row has a label and, for every column, the cells of both sides or one for both.
    """
    room = min((WIDTH - LABEL) / max(len(columns), 1), 250.0)
    gap = 6.0
    top = 52.0
    parts = []
    sided = any(len(cells) == 2 for _, each in rows for cells in each)
    for j, column in enumerate(columns):
        left = LABEL + room * j
        head = shortened(column, (room - gap) / 5.6)
        parts.append(text(left + (room - gap) / 2, 33.0, head, "tick x strong", column))
        for place, side in enumerate(SIDES if sided else ()):
            name = side if room > 90 else side[0].upper()
            parts.append(
                text(left + (room - gap) * (0.25 + 0.5 * place), 46.0, name, f"tick x {side}")
            )
    for i, (label, each) in enumerate(rows):
        y = top + ROW * i
        parts.append(text(2.0, y + 13, label, "tick end"))
        for j, cells in enumerate(each):
            wide = (room - gap) / max(len(cells), 1)
            known = (
                (LABEL + room * j + wide * place, cell)
                for place, cell in enumerate(cells)
                if cell is not None
            )
            parts += [_cell(cell, x, y, wide - 1.5) for x, cell in known]
    return drawing("cells", title, (WIDTH, top + ROW * len(rows) + 4), *parts, unit=unit)


def _cell(cell: Cell, x: float, y: float, wide: float) -> str:
    kind = "more" if cell.value >= 0.0 else "less"
    unknown = bool(np.isnan(cell.value))
    depth = 0.0 if unknown else 0.06 + 0.68 * min(abs(cell.value), 1.0) ** 0.85
    box = rect(
        f"cell {kind}",
        Box(x=x, y=y + 1.0, width=wide, height=ROW - 2.0),
        fill_opacity=f"{depth:.2f}",
    )
    under = f"<title>{escape(cell.under)}</title>" if cell.under else ""
    label = text(x + wide / 2, y + 13, cell.text, "tick x" if unknown else "tick x ink")
    return f"<g>{box}{label}{under}</g>"
