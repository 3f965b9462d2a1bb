"""Coverage of 0 by intervals of torques at the root.

Nothing holds a pelvis, so force and moment on it are 0 wherever plates measure all that touches
the ground.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.accuracy.intervals.uncertainty_measured import StudyTable, drawn, held_at
from benchmarks.hidden_plates import CASES, opened
from benchmarks.results import load
from myomorph.core.motion.turns import floating_coordinates
from myomorph.lab.uncertainty.spread import FACTORS

Row = dict[str, object]
TORQUES = StudyTable(table="torques", steps='"id"', options="id]", forces='loads = "loads.xml"')


def measure(folder: Path) -> Iterator[Row]:
    """Measure the share of frames in which 0 lies inside the interval of each force on the pelvis.

    The forces are its generalized forces. The rows have the widths of the intervals too.
    """
    for case in (one for one in CASES if not one.seated):
        hidden = opened(folder, case)
        tables, frames = drawn(folder, hidden, TORQUES)
        clock = hidden.motion.time[frames]
        row: Row = {
            "recording": case.name,
            "plates over stated mass [%]": 100.0 * (hidden.weighs / case.mass - 1.0),
        }
        for name in floating_coordinates(hidden.model):
            moved = hidden.model.coordinate(name).motion == "translational"
            column = f"{name}_force" if moved else f"{name}_moment"
            held = held_at(clock, np.zeros(len(clock)), tables, column)
            row |= held.row(
                name.removeprefix("pelvis_"), "N" if moved else "N m", FACTORS["generalized_force"]
            )
        yield row


TRUTHS = {
    "uncertainty_knee": ("force in a knee", ("total", "medial", "lateral")),
    "uncertainty_roots": (
        "nothing holds the pelvis",
        ("tx", "ty", "tz", "tilt", "list", "rotation"),
    ),
    "uncertainty_plates": ("forces of hidden plates", ("vertical", "fore-aft", "lateral")),
    "uncertainty_pins": ("angles of a shoulder, by pins", ("all",)),
    "uncertainty_box": ("force that lifts a box", ("up", "forward")),
}
"""What was measured, by the table that has it, and its parts."""


def measure_truths(folder: Path) -> Iterator[Row]:
    """Summarize the other tables of this page by the truth that was measured.

    The values are means over recordings.
    """
    for name, (truth, parts) in TRUTHS.items():
        rows = [row for row in load(f"validation/{name}") if row.get("sizes", "usual") == "usual"]
        for part in parts:
            (width,) = [column for column in rows[0] if column.startswith(f"{part}, width")]
            unit = width.partition("[")[2].rstrip("]")
            columns = f"{part}, inside [%]", width, f"{part}, 90 % of the error [{unit}]"
            inside_column, widths_column, errors_column = columns
            inside = [float(row[inside_column]) for row in rows]
            widths = [float(row[widths_column]) for row in rows]
            errors = [float(row[errors_column]) for row in rows]
            yield {
                "truth": f"{truth}: {part}",
                "recordings": len(rows),
                "inside, mean [%]": float(np.mean(inside)),
                "inside, minimum [%]": min(inside),
                "unit": unit,
                "width, mean": float(np.mean(widths)),
                "90 % of the error, mean": float(np.mean(errors)),
            }
