"""Drawings of conditions: mean curves over the cycle with the interval of the mean and the standard deviation."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from myomorph.analysis.conditions import Condition
from myomorph.model.arrays import Array
from myomorph.report.charts.chart import Frame, heading, path_data
from myomorph.report.charts.group_charts import across, opened, percent_ticks, range_of, ribbon

STYLES = ("right", "left", "third", "second", "fourth", "middle")
"""Of the conditions in their order; more of them take these again."""


def condition_chart(
    conditions: Sequence[Condition], family: str, name: str, width: int = 330, height: int = 220
) -> str:
    """One curve in all conditions: a line for the mean, a ribbon for its interval, a faint one for one deviation."""
    drawn: list[tuple[str, str, Array, Array, Array, Array]] = []
    for style, one in styled(conditions):
        curves = one.curves.get(family)
        if curves is None or name not in curves.names:
            continue
        k = curves.names.index(name)
        own = curves.mean[:, k], curves.deviation[:, k], curves.low[:, k], curves.high[:, k]
        drawn.append((style, one.name, *own))
    low, high = range_of(
        [part for _, _, mean, deviation, *_ in drawn for part in (mean, mean - deviation, mean + deviation)]
    )
    frame = Frame(46, 26.0, width - 8, height - 32, 0.0, 100.0, low, high)
    unit = family.partition(" [")[2].removesuffix("]")
    parts = [
        opened("time", name, width, height, frame.data),
        heading(name, unit),
        *across(frame),
        *percent_ticks(frame),
    ]
    for style, _, mean, deviation, least, most in drawn:
        percent = np.linspace(0.0, 100.0, len(mean))
        parts.append(
            f'<path class="band faint {style}" d="{ribbon(frame, percent, mean - deviation, mean + deviation)}"/>'
        )
        inside = np.clip(least, low, high), np.clip(most, low, high)
        parts.append(f'<path class="band {style}" d="{ribbon(frame, percent, *inside)}"/>')
    for style, label, mean, *_ in drawn:
        data = path_data(frame.x(np.linspace(0.0, 100.0, len(mean))), frame.y(mean))
        parts.append(f'<path class="line {style}" data-label="{escape(label, True)}" d="{data}"/>')
    return "".join([*parts, "</svg>"])


def styled(conditions: Sequence[Condition]) -> list[tuple[str, Condition]]:
    """Conditions with the style of their lines."""
    return [(STYLES[k % len(STYLES)], one) for k, one in enumerate(conditions)]
