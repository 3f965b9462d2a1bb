"""What a study of swinging limbs leaves behind: tables, trials, the report and its input."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from myomorph.body.identify.validation import COMPONENTS
from myomorph.core.io.parsing.text import csv_text, write_csv, written
from myomorph.core.io.sto import write_sto
from myomorph.core.model.errors import BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.interval import Interval
from myomorph.core.model.series import Table
from myomorph.lab.store.results import file_name
from myomorph.swings.viscosity.cohort import QUANTITIES, Row, cohort
from myomorph.swings.viscosity.identification.identify import Condition, SpecimenViscosity
from myomorph.swings.viscosity.report import specimen_report as shown
from myomorph.swings.viscosity.report.limb_report import COLUMNS, limb_rows
from myomorph.swings.viscosity.report.page import viscosity_page
from myomorph.swings.viscosity.report.specimen_report import (
    LimbReport,
    SpecimenReport,
    ViscosityInput,
)
from myomorph.swings.viscosity.swings.recording import SwingRecording

Kind = TypeVar("Kind")

SPECIMENS = "specimens.csv"
COHORT = "cohort.csv"
AXES = "axes.csv"
MUSCLES = "muscles.csv"
MODELS = "models.csv"
NOTES = "notes.csv"
ERRORS = "errors.csv"
INSTRUMENTS = "instruments.csv"
LIMBS = "limbs.csv"
WEIGHED = "measured_muscle_mass"  # The one column that was not estimated and so has no interval.

STORE = "viscosity.json"
REPORT = "report.html"

KIND = "is"
ARRAY = "array"
DIGITS = 6

NOUNS: dict[str, Any] = {
    name: variable
    for name, variable in vars(shown).items()
    if isinstance(variable, type) and is_dataclass(variable)
}
"""What a report is made of, by the names that its store has."""
NOUNS["Estimate"] = NOUNS["Interval"]  # Its name in stores of version 0.1.0


def specimens_table(rows: Sequence[tuple[str, Row]]) -> str:
    """Write `specimens.csv`: a row a specimen, the columns of [S] tables I and II.

    Each estimate has its interval.
    """
    head = ["name"]
    cells = [[name] for name, _ in rows]
    for quantity in (quantity.name for quantity in QUANTITIES):
        width = 1 if quantity == WEIGHED else 3
        head += [quantity, f"{quantity}_low", f"{quantity}_high"][:width]
        for row_cells, (_, row) in zip(cells, rows, strict=True):
            row_cells += _interval(row.get(quantity))[:width]
    return csv_text(head, cells, digits=8)


def _interval(estimate: Interval | None) -> list[Any]:
    if estimate is None:
        return ["", "", ""]
    # What is known as a range alone has no value.
    value = estimate.value if np.isfinite(estimate.value) else ""
    return [value, estimate.low, estimate.high]


def cohort_table(rows: Sequence[Row]) -> str:
    """Write `cohort.csv`: mean and population SD of every quantity, and the mean's interval."""
    head = ("quantity", "mean", "sd", "n", "mean_low", "mean_high", "unit")
    cells = (
        (
            line.quantity.name,
            line.mean if np.isfinite(line.mean) else "",
            line.sd if np.isfinite(line.sd) else "",
            line.count,
            line.low,
            line.high,
            line.quantity.unit,
        )
        for line in cohort(rows)
    )
    return csv_text(head, cells, digits=8)


def notes_table(specimens: Sequence[SpecimenReport | LimbReport]) -> str:
    """Write `notes.csv`: what failed, and what else was said of each specimen."""
    rows = [
        (specimen.name, "failed", specimen.failure) for specimen in specimens if specimen.failure
    ]
    rows += [(specimen.name, "note", note) for specimen in specimens for note in specimen.notes]
    return csv_text(("name", "kind", "text"), rows)


Rows = Iterator[tuple[object, ...]]


def _axis_rows(specimen: SpecimenReport) -> Rows:
    for name, condition in specimen.conditions.items():
        columns = (condition.axes, condition.axis_viscosity, condition.excited)
        for axis, value, excited in zip(*columns, strict=True):
            yield name, axis, *_interval(value if excited else None), "yes" if excited else "no"


def _muscle_rows(specimen: SpecimenReport) -> Rows:
    if (muscles := specimen.muscles) is not None:
        for muscle, value, share in zip(
            muscles.muscles, muscles.by_muscle, muscles.pcsa, strict=True
        ):
            yield muscle, *_interval(value), share, share * muscles.by_pcsa.value, muscles.rank


MODEL = attrgetter(
    *("condition", "terms", "viscosity", "values", "aic", "bic", "angle_error", "wrench_error")
)
ERROR = attrgetter("quantity", "source", "prior_sd", "sd", "share")

BY_SPECIMEN: dict[str, tuple[str, Callable[[SpecimenReport], Iterable[tuple[object, ...]]]]] = {
    # Viscosity about every free axis.
    AXES: ("condition axis viscosity viscosity_low viscosity_high excited", _axis_rows),
    # The regularised viscosity of every muscle, and that in proportion to its cross-section.
    MUSCLES: (
        "muscle viscosity viscosity_low viscosity_high pcsa_share by_pcsa rank",
        _muscle_rows,
    ),
    # Alternatives of the passive torque and how well each foretells a swing.
    MODELS: (
        (
            "condition model viscosity values aic_over_best bic_over_best held_out_angle_rad"
            " held_out_moment_nm"
        ),
        lambda specimen: map(MODEL, specimen.models),
    ),
    # What swings and each error that all swings share add to each result.
    ERRORS: (
        "quantity source prior_sd sd_of_result share_of_variance",
        lambda specimen: map(
            ERROR, sorted(specimen.errors, key=lambda error: (error.quantity, -error.share))
        ),
    ),
    # Errors of instruments as assumed and as the swings show them, in SI units.
    INSTRUMENTS: (
        "source axis prior_sd error sd_left",
        lambda specimen: () if specimen.instruments is None else specimen.instruments.rows,
    ),
}
"""Tables with rows of each specimen: the columns behind its name, and the rows."""


def write_tables(
    specimens: Sequence[SpecimenReport], folder: Path, limbs: Sequence[LimbReport] = ()
) -> None:
    """Write all tables of a cohort, each whole or not at all.

    There are those of specimens where there are any, and of limbs likewise.
    """
    write_whole(notes_table((*specimens, *limbs)), folder / NOTES)
    if limbs:
        rows = ((limb.name, *row) for limb in limbs for row in limb_rows(limb))
        write_csv(folder / LIMBS, ("name", *COLUMNS), rows, digits=8)
    if not specimens:
        return
    known = [(specimen.name, specimen.row) for specimen in specimens if specimen.row]
    write_whole(specimens_table(known), folder / SPECIMENS)
    write_whole(cohort_table([row for _, row in known]), folder / COHORT)
    for name, (head, rows_of) in BY_SPECIMEN.items():
        rows = ((specimen.name, *row) for specimen in specimens for row in rows_of(specimen))
        write_csv(folder / name, ("name", *head.split()), rows, digits=8)


def write_whole(text: str, path: Path) -> None:
    """Write a text so that the file is whole or not there."""
    with written(path) as stream:
        stream.write(text)


def write_swings(specimen_viscosity: SpecimenViscosity, folder: Path) -> None:
    """Write every trial as a table over time: angles, rates, torques, wrench."""
    for name, condition in specimen_viscosity.conditions.items():
        for recording in condition.recordings:
            write_sto(
                swing_table(recording, condition),
                folder / f"{name}_{file_name(recording.name)}.sto",
            )


def swing_table(recording: SwingRecording, condition: Condition) -> Table:
    """Put a trial into a table.

    It has angle [rad], rate [rad/s], torque and its viscous part [N m] of every axis, and the
    wrench, measured and predicted.
    """
    torque = recording.torque_rows @ condition.parameters
    blocks = (
        ("angle", recording.axes, recording.angles),
        ("rate", recording.axes, recording.rates),
        ("torque", recording.axes, torque),
        ("viscous", recording.axes, -condition.viscosity.value * recording.rates),
        ("measured", COMPONENTS, recording.wrench),
        ("predicted", COMPONENTS, recording.wrench_rows @ condition.parameters),
        ("swing", ("",), recording.swing[:, None].astype(np.float64)),
    )
    names = tuple(
        f"{kind}_{column}".rstrip("_") for kind, columns, _ in blocks for column in columns
    )
    return Table(recording.time, names, np.hstack([values for _, _, values in blocks]))


def read_store(folder: Path) -> ViscosityInput:
    """Read what the report of a folder of results shows."""
    return read_value(folder / STORE, ViscosityInput)


def write_value(value: object, path: Path, digits: int | None = None) -> None:
    """Write a value of which a report is made, numbers in arrays with so many digits."""
    write_whole(json.dumps(_plain(value, digits), separators=(",", ":")) + "\n", path)


def read_value(path: Path, kind: type[Kind]) -> Kind:
    """Read what `write_value` wrote.

    Raises
    ------
    BadFile : it is something else
    """
    try:
        result = json.loads(path.read_text(encoding="utf-8"), object_hook=_value)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadFile(
            path, f"is no result of 'myomorph viscosity' ({error})", "run the study again"
        ) from None
    if not isinstance(result, kind):
        raise BadFile(path, "is no result of 'myomorph viscosity'", "run the study again")
    return result


def remake_report(folder: Path) -> Path:
    """Make `report.html` of a folder of results again."""
    write_whole(viscosity_page(read_store(folder)), folder / REPORT)
    return folder / REPORT


def _plain(value: object, digits: int | None) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        parts = {field.name: _plain(getattr(value, field.name), digits) for field in fields(value)}
        return {KIND: type(value).__name__} | parts
    if isinstance(value, np.ndarray):
        if value.dtype.kind != "f":
            return {KIND: ARRAY, "values": value.tolist(), "whole": True}
        numbers = value.ravel().tolist()
        if digits is not None:
            numbers = [float(f"{number:.{digits}g}") for number in numbers]
        return {KIND: ARRAY, "values": numbers, "shape": value.shape}
    if isinstance(value, Mapping):
        return {"of": {str(name): _plain(item, digits) for name, item in value.items()}}
    if isinstance(value, tuple | list):
        return [_plain(item, digits) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    return value


def _value(entries: dict[str, Any]) -> Any:
    kind = entries.pop(KIND, None)
    if kind is None:
        return FrozenMap(entries["of"]) if set(entries) == {"of"} else entries
    if kind == ARRAY:
        if entries.get("whole"):
            return np.array(entries["values"])
        return np.array(entries["values"], dtype=np.float64).reshape(entries["shape"])
    return NOUNS[kind](
        **{
            name: tuple(value) if isinstance(value, list) else value
            for name, value in entries.items()
        }
    )
