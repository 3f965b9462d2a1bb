"""The figure of the measured knee force in docs: `python -m benchmarks.figures.knee [FILE]`."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import numpy as np

from benchmarks.accuracy.knee import BODY_WEIGHT, PARTS, STRIDES, WAYS, at_times, measured, our_loads
from data_collection import data_folder

FILE = Path(__file__).resolve().parents[2] / "docs" / "images" / "knee-force.svg"
SHOWN = (("default", "#2166ac", "-"), ("personalized", "#b2182b", "-"))
"""Rows of the table, by their names, with a color and a line."""


def draw(file: Path) -> None:
    """Total, medial and lateral force over the strides: measured, and as found."""
    ways = {way.name: way for way in WAYS}
    folder = data_folder()
    plt.rcParams.update({"svg.hashsalt": "knee", "svg.fonttype": "none", "font.size": 9})
    figure, axes = plt.subplots(len(STRIDES), len(PARTS), figsize=(9.0, 4.8), sharex=True, sharey="col")
    percent = np.arange(101)
    for row, stride in zip(axes, STRIDES, strict=True):
        truth, clock = measured(folder, stride)
        found = {name: at_times(our_loads(folder, stride, ways[name]), clock) for name, _, _ in SHOWN}
        for k, (one, part) in enumerate(zip(row, PARTS, strict=True)):
            one.plot(percent, truth[:, k] / BODY_WEIGHT, color="#222222", lw=1.8, label="measured")
            for name, color, line in SHOWN:
                one.plot(percent, found[name][:, k] / BODY_WEIGHT, color=color, ls=line, lw=1.2, label=name)
            one.axhline(0.0, color="#999999", lw=0.6)
            one.spines[["top", "right"]].set_visible(False)
            if one in axes[0]:
                one.set_title(part, fontsize=9)
        row[0].set_ylabel(f"{stride} [body weights]")
    for one in axes[-1]:
        one.set_xlabel("stride [%]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", ncols=3, frameon=False)
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.94))
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, metadata={"Date": None})


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else FILE)
