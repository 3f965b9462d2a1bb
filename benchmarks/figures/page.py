"""How every figure is drawn.

`python -m benchmarks.figures NAME [FILE]` writes docs/images/NAME.svg, or the file.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

IMAGES = Path(__file__).resolve().parents[2] / "docs" / "images"


@contextmanager
def page(
    file: Path,
    rows: int,
    columns: int,
    size: tuple[float, float],
    span: tuple[float, float] = (0.0, 0.94),
    **shared: Any,
) -> Iterator[tuple[Figure, np.ndarray]]:
    """Yield a figure and its axes as `plt.subplots` gives them; lay it out and write it at the end.

    Parameters
    ----------
    file : whose name seeds the identifiers in it, so that the same numbers give the same bytes
    rows, columns : of axes
    size : width and height [in]
    span : where the axes begin and end, as shares of the height
    shared : further arguments of `plt.subplots`

    Yields
    ------
    Figure and array of its axes
    """
    plt.rcParams.update({"svg.hashsalt": file.stem, "svg.fonttype": "none", "font.size": 9})
    figure, axes = plt.subplots(rows, columns, figsize=size, **shared)
    yield figure, axes
    for axis in np.ravel(axes):
        axis.spines[["top", "right"]].set_visible(False)
    bottom, top = span
    figure.tight_layout(rect=(0.0, bottom, 1.0, top))
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, metadata={"Date": None}, dpi=150)
    plt.close(figure)


def legend(figure: Figure, axes: Axes, columns: int, **more: Any) -> None:
    """Draw the legend of one of the axes above all of them."""
    figure.legend(
        *axes.get_legend_handles_labels(), loc="upper center", ncols=columns, frameon=False, **more
    )


def zero_lines(axes: np.ndarray) -> None:
    """Draw a thin line at zero in each.

    Parameters
    ----------
    axes : array of `Axes`, in any shape
    """
    for axis in np.ravel(axes):
        axis.axhline(0.0, color="#999999", lw=0.6)
