"""Tables as pictures: a number and its color in every cell, right and left side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

ROW, LABEL = 19.0, 190.0
SIDES = ("right", "left")


@dataclass(frozen=True)
class Cell:
    """A value between -1 and 1 that colors the cell, what is printed in it, and what its tooltip says."""

    value: float
    text: str = ""
    told: str = ""


def sided_table(
    title: str,
    unit: str,
    columns: Sequence[str],
    rows: Sequence[tuple[str, Sequence[Sequence[Cell | None]]]],
    width: int = 1040,
) -> str:
    """A table of colored cells as an `<svg>` element.

    Parameters
    ----------
    columns : heads
    rows : a label each, and for every column the cells of the right and the left side, or one cell for both
    """
    room = min((width - LABEL) / max(len(columns), 1), 250.0)
    gap, top = 6.0, 52.0
    height = top + ROW * len(rows) + 4
    parts = [
        f'<svg class="chart cells" viewBox="0 0 {width} {height:g}" role="img" aria-label="{escape(title, True)}">',
        f'<text class="title" x="2" y="12">{escape(title)} <tspan class="unit">{escape(unit)}</tspan></text>',
    ]
    sided = any(len(cells) == 2 for _, each in rows for cells in each)
    for j, column in enumerate(columns):
        left = LABEL + room * j
        most = int((room - gap) / 5.6)
        text = column if len(column) <= most else column[: most - 1] + "…"
        parts.append(
            f'<text class="tick x strong" x="{left + (room - gap) / 2:.1f}" y="33">{escape(text)}'
            f"<title>{escape(column)}</title></text>"
        )
        if sided:
            for k, side in enumerate(SIDES):
                x = left + (room - gap) * (0.25 + 0.5 * k)
                name = side if room > 90 else side[0].upper()
                parts.append(f'<text class="tick x {side}" x="{x:.1f}" y="46">{name}</text>')
    for i, (label, each) in enumerate(rows):
        y = top + ROW * i
        parts.append(f'<text class="tick end" x="2" y="{y + 13:.1f}">{escape(label)}</text>')
        for j, cells in enumerate(each):
            wide = (room - gap) / max(len(cells), 1)
            for k, cell in enumerate(cells):
                parts += _cell(cell, LABEL + room * j + wide * k, y, wide - 1.5)
    return "".join([*parts, "</svg>"])


def _cell(cell: Cell | None, x: float, y: float, wide: float) -> list[str]:
    if cell is None:
        return []
    kind = "more" if cell.value >= 0.0 else "less"
    depth = 0.0 if np.isnan(cell.value) else 0.06 + 0.68 * min(abs(cell.value), 1.0) ** 0.85
    ink = "" if np.isnan(cell.value) else " ink"
    told = f"<title>{escape(cell.told)}</title>" if cell.told else ""
    return [
        f'<g><rect class="cell {kind}" x="{x:.1f}" y="{y + 1:.1f}" width="{wide:.1f}" height="{ROW - 2:g}" '
        f'fill-opacity="{depth:.2f}"/><text class="tick x{ink}" x="{x + wide / 2:.1f}" y="{y + 13:.1f}">'
        f"{escape(cell.text)}</text>{told}</g>"
    ]
