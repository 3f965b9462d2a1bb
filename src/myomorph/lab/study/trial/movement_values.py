"""Numbers of a run, a jump, a squat or a rise as rows of `values.csv`, and each part in a table."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.text import write_csv
from myomorph.lab.analysis.stride_spread import stride_spreads
from myomorph.lab.movements.part import MovementNumbers
from myomorph.lab.movements.quantities import FILE
from myomorph.lab.study.trial.trial_inputs import Value

STEP = "movement"
"""In the place of a step: these numbers follow from the results of several."""
COLUMNS = ("part", "side", "start_s", "stop_s")


def movement_values(numbers: MovementNumbers | None) -> Iterator[Value]:
    """Yield how many parts there are, and the mean of each quantity by side with its spread."""
    if numbers is None:
        return
    for side in numbers.sides:
        count = sum(part.side == side for part in numbers.parts)
        yield Value(step=STEP, quantity=_sided(numbers.many, side), value=float(count), unit="1")
        for quantity in numbers.known:
            values = numbers.values(quantity, side)
            if not len(values):
                continue
            (spread,) = stride_spreads(values[:, None])
            yield Value(
                step=STEP,
                quantity=_sided(quantity.name, side),
                value=spread.mean,
                unit=quantity.unit,
                strides=spread,
            )


def _sided(name: str, side: str) -> str:
    """Return the name of a row, as "contact_time, right"."""
    return f"{name}, {side}" if side else name


def write_movement(folder: Path, numbers: MovementNumbers | None) -> None:
    """Write one row a part into a folder of results; a table of an earlier movement goes."""
    path = folder / FILE
    if numbers is None:
        path.unlink(missing_ok=True)
        return
    known = numbers.known
    head = (*COLUMNS, *(quantity.column.replace(" ", "_") for quantity in known))
    rows = []
    for index, part in enumerate(numbers.parts, 1):
        values = [part.number(quantity) for quantity in known]
        cells = (f"{value:.6g}" if np.isfinite(value) else "" for value in values)
        rows.append((str(index), part.side, f"{part.start:.4f}", f"{part.stop:.4f}", *cells))
    write_csv(path, head, rows)
