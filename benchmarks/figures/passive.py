"""The figure of docs/viscosity.md and validation: `python -m benchmarks.figures.passive [FILE]`."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import numpy as np

from benchmarks.accuracy.passive import solved
from data_collection import data_folder

FILE = Path(__file__).resolve().parents[2] / "docs" / "images" / "passive-tensions.svg"
SHOWN = (("DeltoideusScapula_M", "deltoid, acromial part"), ("TRIlong", "triceps, long head"))
COLORS = ("#222222", "#2166ac", "#b2182b")


def draw(file: Path) -> None:
    """Tension of two muscles without and with passive dynamics, and the difference, over one lift."""
    plain, (_, (fitting, muscles), (printed, thick)) = solved(data_folder(), "FLX01", "no")
    found = [
        ("no passive dynamics", plain),
        (fitting.replace("d_M", "fitting d_M"), muscles),
        (printed.replace("d_M", "printed d_M"), thick),
    ]
    plt.rcParams.update({"svg.hashsalt": "passive", "svg.fonttype": "none", "font.size": 9})
    figure, axes = plt.subplots(2, len(SHOWN), figsize=(8.0, 4.6), sharex=True)
    every = slice(None, None, 4)
    for column, (name, words) in enumerate(SHOWN):
        m = plain.muscles.index(name)
        for (label, tension), color in zip(found, COLORS, strict=True):
            axes[0, column].plot(tension.time[every], tension.forces[every, m], color=color, lw=1.2, label=label)
            if tension is not plain:
                change = (tension.forces - plain.forces)[every, m]
                axes[1, column].plot(tension.time[every], change, color=color, lw=1.2)
        axes[0, column].set_title(words, fontsize=9)
        axes[1, column].set_xlabel("time [s]")
        axes[1, column].axhline(0.0, color="#999999", lw=0.6)
    axes[0, 0].set_ylabel("tension [N]")
    axes[1, 0].set_ylabel("change [N]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", ncols=3, frameon=False)
    for one in np.ravel(axes):
        one.spines[["top", "right"]].set_visible(False)
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.94))
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, metadata={"Date": None})


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else FILE)
