"""The figure of the measured knee force in docs: `python -m benchmarks.figures knee-force`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.accuracy.knee import BODY_WEIGHT, PARTS, STRIDES, WAYS, at_times, measured, our_loads
from benchmarks.figures.page import legend, page
from data_collection import data_folder

SHOWN = (("default", "#2166ac", "-"), ("personalized", "#b2182b", "-"))
"""Rows of the table, by their names, with a color and a line."""


def draw(file: Path) -> None:
    """Total, medial and lateral force over the strides: measured, and as found."""
    ways = {way.name: way for way in WAYS}
    folder = data_folder()
    with page(file, len(STRIDES), len(PARTS), (9.0, 4.8), sharex=True, sharey="col") as (figure, axes):
        percent = np.arange(101)
        for row, stride in zip(axes, STRIDES, strict=True):
            truth, clock = measured(folder, stride)
            found = {name: at_times(our_loads(folder, stride, ways[name]), clock) for name, _, _ in SHOWN}
            for k, (one, part) in enumerate(zip(row, PARTS, strict=True)):
                one.plot(percent, truth[:, k] / BODY_WEIGHT, color="#222222", lw=1.8, label="measured")
                for name, color, line in SHOWN:
                    one.plot(percent, found[name][:, k] / BODY_WEIGHT, color=color, ls=line, lw=1.2, label=name)
                one.axhline(0.0, color="#999999", lw=0.6)
                if one in axes[0]:
                    one.set_title(part, fontsize=9)
            row[0].set_ylabel(f"{stride} [body weights]")
        for one in axes[-1]:
            one.set_xlabel("stride [%]")
        legend(figure, axes[0, 0], 3)
