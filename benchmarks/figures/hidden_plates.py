"""The figure of docs/contact-forces.md: `python -m benchmarks.figures hidden-plates`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from benchmarks.figures.page import legend, page, zero_lines
from benchmarks.hidden_plates import CASES, Hidden, estimated, feet_of, foot_wrench, opened
from data_collection import data_folder

SHOWN = (0, 1, 2, 5)
COLORS = {"right": "#b2182b", "left": "#2166ac"}
ROWS = ((1, "vertical [weight]"), (0, "fore-aft [weight]"))


def draw(file: Path) -> None:
    """Measured and estimated force of each foot over its weight: vertical above, fore-aft below."""
    folder = data_folder()
    with page(file, len(ROWS), len(SHOWN), (11.0, 4.8), sharex="col", sharey="row") as (figure, axes):
        for column, number in enumerate(SHOWN):
            hidden = opened(folder, CASES[number])
            _panels(axes[:, column], hidden)
            axes[0, column].set_title(hidden.case.name, fontsize=9)
            axes[-1, column].set_xlabel("time [s]")
        for row, (_, label) in enumerate(ROWS):
            axes[row, 0].set_ylabel(label)
        legend(figure, axes[0, 0], 4)
        zero_lines(axes)


def _panels(axes: np.ndarray, hidden: Hidden) -> None:
    tension = estimated(hidden)
    use = hidden.use & (hidden.motion.time < hidden.motion.time[hidden.use][0] + 1.4)
    time = hidden.motion.time
    for side, force, _ in feet_of(hidden):
        found = foot_wrench(tension, side)[0]
        for panel, (axis, _) in zip(axes, ROWS, strict=True):
            _line(panel, time, force[:, axis] / hidden.weight, use, COLORS[side], "-", f"{side}, measured")
            _line(panel, time, found[:, axis] / hidden.weight, use, COLORS[side], "--", f"{side}, estimated")


def _line(
    panel: Axes, time: np.ndarray, values: np.ndarray, use: np.ndarray, color: str, style: str, label: str
) -> None:
    panel.plot(time[use], values[use], style, color=color, lw=1.3 if style == "-" else 1.6, label=label)
