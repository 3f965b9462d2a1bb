"""What a study of swinging limbs leaves behind: tables of the cohort and of each specimen."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from myomorph.io.sto import write_sto
from myomorph.model.provenance import Estimate
from myomorph.model.series import Table
from myomorph.report.trial.identified import COMPONENTS
from myomorph.viscosity.cohort import QUANTITIES, Row, cohort
from myomorph.viscosity.report.given import SpecimenReport
from myomorph.viscosity.swings import SwingRecording
from myomorph.viscosity.viscosity import Condition, SpecimenViscosity

SPECIMENS, COHORT, AXES, MUSCLES, MODELS, NOTES = (
    "specimens.csv",
    "cohort.csv",
    "axes.csv",
    "muscles.csv",
    "models.csv",
    "notes.csv",
)
WEIGHED = "measured_muscle_mass"
"""The one column that was not estimated and so has no interval."""

Cells = Sequence[object]


def specimens_table(rows: Sequence[tuple[str, Row]]) -> str:
    """`specimens.csv`: a row a specimen, the columns of [S] tables I and II, each estimate with its interval."""
    head = ["name"]
    for quantity in QUANTITIES:
        head += _columns(quantity.name)
    return _csv(head, ([name, *_row_cells(row)] for name, row in rows))


def _columns(name: str) -> list[str]:
    return [name] if name == WEIGHED else [name, f"{name}_low", f"{name}_high"]


def _row_cells(row: Row) -> list[object]:
    cells: list[object] = []
    for quantity in QUANTITIES:
        one = row.get(quantity.name)
        if quantity.name == WEIGHED:
            cells.append("" if one is None else one.value)
        else:
            cells += _interval(one)
    return cells


def _interval(one: Estimate | None) -> list[object]:
    return ["", "", ""] if one is None else [one.value, one.low, one.high]


def cohort_table(rows: Sequence[Row]) -> str:
    """`cohort.csv`: mean and population SD of every quantity, and the interval of the mean."""
    head = ("quantity", "mean", "sd", "n", "mean_low", "mean_high", "unit")
    cells = (
        (one.quantity.name, one.mean, one.sd, one.count, one.low, one.high, one.quantity.unit) for one in cohort(rows)
    )
    return _csv(head, cells)


def axes_table(specimens: Sequence[SpecimenReport]) -> str:
    """`axes.csv`: viscosity about every free axis."""
    rows = []
    for one in specimens:
        for name, condition in (("without", one.without), ("with", one.intact)):
            if condition is not None:
                for axis, value, excited in zip(
                    condition.axes, condition.axis_viscosity, condition.excited, strict=True
                ):
                    rows.append((one.name, name, axis, *_interval(value), "yes" if excited else "no"))
    return _csv(("name", "condition", "axis", "viscosity", "viscosity_low", "viscosity_high", "excited"), rows)


def muscles_table(specimens: Sequence[SpecimenReport]) -> str:
    """`muscles.csv`: the regularised viscosity of every muscle, and that in proportion to its cross-section."""
    rows = []
    for one in specimens:
        if one.muscles is not None:
            found = one.muscles
            for muscle, value, share in zip(found.muscles, found.by_muscle, found.pcsa, strict=True):
                rows.append((one.name, muscle, *_interval(value), share, share * found.by_pcsa.value, found.rank))
    head = ("name", "muscle", "viscosity", "viscosity_low", "viscosity_high", "pcsa_share", "by_pcsa", "rank")
    return _csv(head, rows)


def models_table(specimens: Sequence[SpecimenReport]) -> str:
    """`models.csv`: alternatives of the passive torque and how well each foretells a swing."""
    head = ("name", "condition", "model", "viscosity", "values", "aic_over_best", "bic_over_best")
    rows = (
        (one.name, model.condition, model.terms, model.viscosity, model.values, model.aic, model.bic)
        + (model.angle_error, model.wrench_error)
        for one in specimens
        for model in one.models
    )
    return _csv((*head, "held_out_angle_rad", "held_out_moment_nm"), rows)


def notes_table(specimens: Sequence[SpecimenReport]) -> str:
    """`notes.csv`: what failed, and what else was said of each specimen."""
    rows = [(one.name, "failed", one.failure) for one in specimens if one.failure]
    rows += [(one.name, "note", note) for one in specimens for note in one.notes]
    return _csv(("name", "kind", "text"), rows)


def write_tables(specimens: Sequence[SpecimenReport], folder: Path) -> None:
    """Write all tables of a cohort, each whole or not at all."""
    known = [(one.name, one.row) for one in specimens if one.row]
    for name, text in (
        (SPECIMENS, specimens_table(known)),
        (COHORT, cohort_table([row for _, row in known])),
        (AXES, axes_table(specimens)),
        (MUSCLES, muscles_table(specimens)),
        (MODELS, models_table(specimens)),
        (NOTES, notes_table(specimens)),
    ):
        write_whole(text, folder / name)


def write_whole(text: str, path: Path) -> None:
    """Write a text so that the file is whole or not there."""
    temporary = path.with_name(f".{path.name}.part")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)


def write_swings(found: SpecimenViscosity, folder: Path) -> None:
    """Write every trial as a table over time: angles, rates, torques, wrench measured and predicted."""
    for name, condition in (("without", found.without), ("with", found.intact)):
        if condition is not None:
            for recording in condition.recordings:
                stem = "".join(one if one.isalnum() or one in "-._" else "_" for one in recording.name)
                write_sto(swing_table(recording, condition), folder / f"{name}_{stem}.sto")


def swing_table(recording: SwingRecording, found: Condition) -> Table:
    """One trial: angle [rad], rate [rad/s], torque and its viscous part [N m] of every axis; the wrench."""
    torque = recording.torque_rows @ found.parameters
    blocks = (
        ("angle", recording.axes, recording.angles),
        ("rate", recording.axes, recording.rates),
        ("torque", recording.axes, torque),
        ("viscous", recording.axes, -found.viscosity.value * recording.rates),
        ("measured", COMPONENTS, recording.wrench),
        ("predicted", COMPONENTS, recording.wrench_rows @ found.parameters),
        ("swing", ("",), recording.swing[:, None].astype(np.float64)),
    )
    names = tuple(f"{kind}_{column}".rstrip("_") for kind, columns, _ in blocks for column in columns)
    return Table(recording.time, names, np.hstack([values for _, _, values in blocks]))


def _csv(head: Iterable[str], rows: Iterable[Cells]) -> str:
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(head)
    for row in rows:
        table.writerow([f"{cell:.8g}" if isinstance(cell, float) else cell for cell in row])
    return text.getvalue()
