"""What the data leave open, drawn for docs/contact-forces.md: `python -m benchmarks.figures contact-intervals`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.accuracy.certificates import solved_case
from benchmarks.figures.hidden_plates import COLORS, ROWS
from benchmarks.figures.page import legend, page, zero_lines
from benchmarks.hidden_plates import CASES, feet_of
from data_collection import data_folder
from myomorph.tension.certificates import contact_intervals

SHOWN = (0, 3)
SPAN = 1.4
"""How much of each recording is shown [s]."""


def draw(file: Path) -> None:
    """Measured and estimated force of each foot, what the data leave open around it, and solutions near the optimum."""
    folder = data_folder()
    with page(file, len(ROWS), len(SHOWN), (11.0, 4.8), sharex="col", sharey="row") as (figure, axes):
        for column, number in enumerate(SHOWN):
            hidden, problem, tension = solved_case(folder, CASES[number])
            time = hidden.motion.time
            start = time[hidden.use][0]
            frames = np.flatnonzero(hidden.use & (time < start + SPAN))
            found = contact_intervals(problem, tension, frames.tolist())
            for side, force, _ in feet_of(hidden):
                group = found.groups.index(f"foot_{side[0]}")
                for panel, (axis, _) in zip(axes[:, column], ROWS, strict=True):
                    bands = (
                        (found.low, found.high, 0.12, "may be"),
                        (found.near_low, found.near_high, 0.35, "near optimum"),
                    )
                    for low, high, strength, label in bands:
                        ends = (one[:, group, axis] / hidden.weight for one in (low, high))
                        panel.fill_between(
                            found.time, *ends, color=COLORS[side], alpha=strength, lw=0.0, label=f"{side}, {label}"
                        )
                    panel.plot(
                        found.time, force[frames, axis] / hidden.weight, color=COLORS[side], label=f"{side}, measured"
                    )
                    panel.plot(
                        found.time,
                        found.forces[:, group, axis] / hidden.weight,
                        "--",
                        color=COLORS[side],
                        label=f"{side}, found",
                    )
            axes[0, column].set_title(hidden.case.name, fontsize=9)
            axes[-1, column].set_xlabel("time [s]")
        for row, (_, label) in enumerate(ROWS):
            axes[row, 0].set_ylabel(label)
        legend(figure, axes[0, 0], 8, fontsize=7)
        zero_lines(axes)
