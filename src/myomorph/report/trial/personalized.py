"""The page of a person's muscles: normalized fiber lengths before and after, and every parameter with its interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.report.charts.axis import number
from myomorph.report.charts.marks import dot, drawing, frame, grid_along, mark, rect, text
from myomorph.report.page.page import rendered
from myomorph.report.page.parts import Figure, Grid, PageHead, Section

ROW, LEFT, WIDTH = 11.0, 96.0, 430.0
PHYSIOLOGICAL = (0.5, 1.4)
PLACES = {"optimal_fiber_length": 4, "tendon_slack_length": 4}


@dataclass(frozen=True)
class ParameterRow:
    """One estimated parameter as the page shows it, see `tension.personal.personalize.Estimate`."""

    of: str
    parameter: str
    generic: float
    person: float
    low: float
    high: float
    identifiable: str
    bound: str
    kept: bool


@read_only
@dataclass(frozen=True, eq=False)
class PersonalizedInput:
    """What the page shows.

    Attributes
    ----------
    muscles : names
    before, after : (muscles, 2) least and greatest normalized fiber lengths, without recordings empty
    rows : every parameter
    lines : what the command printed
    """

    muscles: tuple[str, ...]
    before: Array
    after: Array
    rows: tuple[ParameterRow, ...]
    lines: tuple[str, ...]


def personalized_page(head: PageHead, person: PersonalizedInput) -> str:
    """The page as HTML text."""
    sections = []
    if person.before.any():
        figure = Figure(
            fiber_ranges(person.muscles, person.before, person.after),
            "full",
            "Normalized fiber lengths over the recordings, tendons at slack length: above of the generic muscle, "
            "below of the person's. The shaded range is that expected of a recording.",
        )
        sections.append(
            Section("fibers", "Fiber lengths", "", (("second", "generic"), ("first", "person")), figures=(figure,))
        )
    sections.append(
        Section("parameters", "Parameters", ". ".join(person.lines) + ".", grids=tuple(_grids(person.rows)))
    )
    return rendered(head, sections, ())


def fiber_ranges(names: Sequence[str], before: Array, after: Array) -> str:
    """Ranges of normalized fiber lengths before and after, one row a muscle, as an `<svg>` element."""
    height = ROW * len(names)
    low = min(0.4, float(np.min([before, after])))
    high = max(1.6, float(np.max([before, after])))
    area = frame(LEFT, 24.0, LEFT + WIDTH, 24.0 + height, (low, high), (0.0, float(len(names))))
    marks = []
    left, right = (float(area.x.at(limit)) for limit in PHYSIOLOGICAL)
    marks.append(rect("spread", left, 24.0, right - left, height))
    marks.append(grid_along(area, 6))
    for index, name in enumerate(names):
        y = 24.0 + ROW * (index + 0.5)
        marks.append(text(LEFT - 4.0, y + 3.0, name, "tick y"))
        for ends, style, aside in ((before[index], "second", -2.0), (after[index], "first", 2.0)):
            a, b = (float(area.x.at(end)) for end in ends)
            under = f"{name}: {number(ends[0])} to {number(ends[1])}"
            marks.append(mark("path", f"line {style}", under, d=f"M{a:.1f} {y + aside:.1f}H{max(b, a + 1.0):.1f}"))
            marks.append(dot(b, y + aside, style, 1.6, under))
    size = (LEFT + WIDTH + 20.0, height + 50.0)
    return drawing("ranges", "Normalized fiber length", size, *marks, unit="optimal fiber lengths")


def _grids(rows: Sequence[ParameterRow]) -> list[Grid]:
    """A table of each kind of parameter."""
    head = ("of", "generic", "person", "90 % interval", "identifiable", "")
    grids = []
    for parameter in dict.fromkeys(row.parameter for row in rows):
        shown = []
        for row in rows:
            if row.parameter != parameter:
                continue
            places = PLACES.get(parameter, 3)
            known = np.isfinite(row.low)
            span = f"{row.low:.{places}f} to {row.high:.{places}f}" if known else ""
            remark = "generic kept" if row.kept else f"at its {row.bound} bound" if row.bound else ""
            values = (f"{row.generic:.{places}f}", f"{row.person:.{places}f}")
            shown.append((row.of, *values, span, row.identifiable, remark))
        unit = " [m]" if parameter in PLACES else ""
        grids.append(
            Grid(head, tuple(shown), f"{parameter.replace('_', ' ').capitalize()}{unit}", folded=len(shown) > 12)
        )
    return grids
