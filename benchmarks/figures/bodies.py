"""Figure of identified bodies: `python -m benchmarks.figures chapter3-wrenches`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.accuracy.identification.chapter3 import COMPONENTS, DEFAULTS, SIMULATED, found
from benchmarks.figures.page import legend, page

SHOWN = (30.0, 50.0)
"""Part of the motion that was not used [s]."""
LINES = {
    "measured": ("measured (simulated)", "#222222", 1.6),
    "identified, own link": ("identified", "#2a78b0", 0.8),
    "shape only": ("shape only", "#d9822b", 0.8),
}


def draw(file: Path) -> None:
    """[D] figure 3.3 of the simulated person: the base wrench of a motion that was not used."""
    rows = found(SIMULATED).tables[DEFAULTS]["wrench_other.csv"]
    time = np.array([float(row["time [s]"]) for row in rows])
    part = (time >= SHOWN[0]) & (time <= SHOWN[1])
    with page(file, 3, 2, (9.0, 6.0), sharex=True) as (figure, axes):
        for axis, (component, unit) in zip(axes.T.ravel(), COMPONENTS.items(), strict=True):
            for column, (name, color, width) in LINES.items():
                values = np.array(
                    [float(row[f"{component} {column} [{unit}]"] or "nan") for row in rows]
                )
                axis.plot(time[part], values[part], color=color, lw=width, label=name)
            axis.set_ylabel(f"{component[0]}$_{component[1]}$ [{unit}]")
        for axis in axes[-1]:
            axis.set_xlabel("time [s]")
        legend(figure, axes[0, 0], 3)
