"""Single strides as a table: angles, moments and powers of both sides, a row a sample."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.text import write_csv
from myomorph.lab.analysis.gait_curves import SIDES, GaitCurves
from myomorph.lab.analysis.stride_quantities import QUANTITIES, stride_column

Row = tuple[str | int | float, ...]


def write_stride_table(path: Path, curves: GaitCurves | None) -> None:
    """Write every stride as rows of a table; without strides there is none.

    Parameters
    ----------
    path : of the table; one of an earlier run goes where there are no strides now
    curves : of both sides over their strides
    """
    if curves is None or not any(curves.strides.values()):
        path.unlink(missing_ok=True)
        return
    write_csv(path, map(stride_column, QUANTITIES), stride_rows(curves))


def stride_rows(curves: GaitCurves) -> Iterator[Row]:
    """Yield rows as `QUANTITIES` declares their cells; what is not known is nan.

    Parameters
    ----------
    curves : of both sides over their strides

    Yields
    ------
    side, number of the stride, percent of it, time [s], and the value of each curve
    """
    for side in SIDES:
        values = curves.of(side)
        percent = np.linspace(0.0, 100.0, values.shape[1])
        for number, stride in enumerate(curves.strides[side], 1):
            times = stride.start + 0.01 * percent * stride.duration
            for at, time, row in zip(percent, times, values[number - 1], strict=True):
                yield (side, number, float(at), float(time), *row.tolist())
