"""The figure of carried attachments in docs/validation: `python -m benchmarks.figures.morph_shapes [FILE]`."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import numpy as np

from benchmarks.accuracy.morph.shapes import PLACES, carried, cases, every_map, foreseen

FILE = Path(__file__).resolve().parents[2] / "docs" / "images" / "morph-shapes.svg"
COUNTS = (4, 6, 8, 12, 16, 24, 36)
SHOWN = {
    "per-axis scaling, distances": ("per-axis scaling", "#777777", "-"),
    "affine": ("affine", "#e08214", "-"),
    "RBF, r": ("RBF, r", "#2166ac", "-"),
    "SSD": ("SSD", "#b2182b", "-"),
}


def draw(file: Path) -> None:
    """Mean error of attachments over the number of landmarks, in both places."""
    plt.rcParams.update({"svg.hashsalt": "morph", "svg.fonttype": "none", "font.size": 9})
    figure, axes = plt.subplots(1, len(PLACES), figsize=(8.4, 3.6), sharey=True)
    makers = every_map()
    for axis, (where, landmarks) in zip(axes, PLACES.items(), strict=True):
        for name, (words, color, style) in SHOWN.items():
            errors = [carried(makers[name], partial(landmarks, count=n), cases("mean")).on.mean() for n in COUNTS]
            axis.plot(COUNTS, 1e3 * np.array(errors), style, color=color, marker="o", ms=3, lw=1.4, label=words)
            if words == "per-axis scaling":
                axis.plot(COUNTS, 5e2 * np.array(errors), ":", color=color, lw=1.0, label="half of it")
        told = [1e3 * foreseen(partial(landmarks, count=n)) for n in COUNTS]
        axis.plot(COUNTS, told, "--", color="#1b7837", lw=1.2, label="regression on other persons")
        axis.set_title(f"landmarks {where}" if where.startswith("at") else f"landmarks at {where}", fontsize=9)
        axis.set_xlabel("landmarks on each bone")
        axis.set_xticks(COUNTS, [str(n) for n in COUNTS])
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("mean error of attachments [mm]")
    axes[0].set_ylim(0.0, 6.5)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", ncols=6, frameon=False, fontsize=8)
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.92))
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, metadata={"Date": None})


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else FILE)
