"""A kind of chart from outside the package, and a page that shows it. See docs/adding.md."""

from __future__ import annotations

import numpy as np

from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.marks import Box, drawing, frame, grid_along, grid_up, rect, text
from myomorph.lab.report.page.page import rendered
from myomorph.lab.report.page.parts import Figure, PageHead, Section


def histogram(title, unit, values, bins=8):
    """How often values (n,) fall into even bins, as an `<svg>` element."""
    counts, edges = np.histogram(values, bins)
    area = frame((46.0, 26.0), (322.0, 168.0), (edges[0], edges[-1]), (0.0, 1.05 * counts.max()))
    bars = [
        rect(
            "bar first",
            Box(x=corner[0], y=corner[1], width=width, height=height),
            f"{number(low)} to {number(high)} {unit}: {count}",
        )
        for corner, width, height, low, high, count in zip(
            zip(area.x.at(edges[:-1]), area.y.at(counts), strict=True),
            np.diff(area.x.at(edges)) - 1.0,
            area.y.start - area.y.at(counts),
            edges[:-1],
            edges[1:],
            counts,
            strict=True,
        )
    ]
    name = text(184.0, 196.0, f"{unit}, counted", "tick x")
    return drawing(
        "histogram", title, (330, 200), grid_up(area), grid_along(area, 5), name, *bars, unit=unit
    )


speeds = np.random.default_rng(0).normal(1.3, 0.1, 200)
figure = Figure(histogram("Walking speed", "m/s", speeds), caption="All trials of the study.")
section = Section("speeds", "Walking speed", "One value a trial.", figures=(figure,))
page = rendered(PageHead("A study"), [section], ())
