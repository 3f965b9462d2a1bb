"""The figure of docs/viscosity.md and validation: `python -m benchmarks.figures passive-tensions`."""

from __future__ import annotations

from pathlib import Path

from benchmarks.accuracy.passive import solved
from benchmarks.figures.page import legend, page
from data_collection import data_folder

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
    with page(file, 2, len(SHOWN), (8.0, 4.6), sharex=True) as (figure, axes):
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
        legend(figure, axes[0, 0], 3)
