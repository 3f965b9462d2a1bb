"""The tables of an identified body as numbers: those of [D] chapter 3, and what stands behind them."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.identify.determined import NINETY
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.inertia import PARAMETERS
from myomorph.model.segments import Segment, segments_of
from myomorph.report.trial.identified import COMPONENTS, IdentificationInput, WrenchCheck

Cell = str | float | int | None

TRUST = ("standard deviation [kg]", "90 % interval from [kg]", "90 % interval to [kg]", "determined by")
"""Columns that say how sure the mass of a link in the model is."""


@dataclass(frozen=True)
class Sheet:
    """A table of numbers: column names with their units, and rows; None is an empty cell."""

    head: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def csv(self) -> str:
        """The table as comma-separated text, numbers in full precision, a cell without a value empty."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.head)
        for row in self.rows:
            writer.writerow(["" if _empty(cell) else repr(cell) if isinstance(cell, float) else cell for cell in row])
        return text.getvalue()


def _empty(cell: Cell) -> bool:
    return cell is None or (isinstance(cell, float) and not np.isfinite(cell))


ATHLETES: Mapping[str, float] = FrozenMap(
    {
        "Head": 6.9, "Body": 45.9, "Upper arm": 2.7, "Lower arm": 1.6, "Hand": 0.6, "Thigh": 11.0, "Shank": 5.1,
        "Foot": 1.1, "Upper body": 30.2, "Lower body": 18.7,
    }
)  # fmt: skip
"""Percent of body mass of Japanese male athletes (Ae, Tang, Yokoi 1992), as table 3.4 of [D] prints them.

"Body" is a misprint there: its two parts sum to 48.9, and only with 48.9 do all segments sum to 100.
"""

_PARTS: Mapping[str, tuple[str, ...]] = FrozenMap(
    {
        "Head": ("head",),
        "Body": ("upper_trunk", "lower_trunk"),
        "Upper arm": ("upper_arm",),
        "Lower arm": ("lower_arm",),
        "Hand": ("hand",),
        "Thigh": ("thigh",),
        "Shank": ("shank",),
        "Foot": ("foot",),
        "Upper body": ("upper_trunk",),
        "Lower body": ("lower_trunk",),
    }
)

_SPINE = (
    ("Lumbar vertebrae", r"^(lumbar|lumber|lumb|l)[_ ]?(vertebra)?[_ ]?[1-5]$"),
    ("Rib vertebrae", r"^(thoracic|thorac|rib[_ ]?vertebra|t)[_ ]?(vertebra)?[_ ]?(1[0-2]?|[2-9])$"),
    ("Neck vertebrae", r"^(cervical|cerv|neck|c)[_ ]?(vertebra)?[_ ]?[1-7]$"),
)


def segments_given(identified: IdentificationInput) -> Mapping[str, Segment]:
    """Segment of each body: by the bodies' names; none of a model whose names contain none."""
    try:
        return segments_of(identified.model)
    except BadData:
        return {}


def mass_sheet(identified: IdentificationInput) -> Sheet:
    """Mass of every link by every method [kg], its sum last ([D] tables 3.1 and 3.2), and intervals."""
    masses = identified.masses
    bodies = identified.model.bodies
    known = len(identified.sd) > 0
    rows: list[tuple[Cell, ...]] = []
    for i, body in enumerate(identified.model.body_names):
        row: tuple[Cell, ...] = (body, *(float(mass[i]) for mass in masses.values()))
        if known:
            reach = NINETY * float(identified.sd[i, 0])
            low, high = max(float(bodies[i].mass) - reach, 0.0), float(bodies[i].mass) + reach
            row += (float(identified.sd[i, 0]), low, high, "data" if identified.from_data[i, 0] else "prior")
        rows.append(row)
    total: tuple[Cell, ...] = (
        "Total",
        *(float(mass.sum()) for mass in masses.values()),
        *((None,) * 4 if known else ()),
    )
    head = ("link", *(f"{name} [kg]" for name in masses))
    return Sheet(head + (TRUST if known else ()), (*rows, total))


def parameter_sheet(identified: IdentificationInput) -> Sheet:
    """All ten parameters of every link in the model, about the body's origin [kg, kg m, kg m^2].

    Below the methods stand the standard deviations of the model's parameters, and whether data or prior say them.
    """
    units = ("kg",) + 3 * ("kg m",) + 6 * ("kg m^2",)
    head = ("method", "link", *(f"{name} [{unit}]" for name, unit in zip(PARAMETERS, units, strict=True)))
    rows: list[tuple[Cell, ...]] = [
        (method, body, *(float(parameter) for parameter in row))
        for method, table in identified.parameters.items()
        for body, row in zip(identified.model.body_names, table, strict=True)
    ]
    if len(identified.sd):
        names = identified.model.body_names
        rows += [("standard deviation", name, *map(float, row)) for name, row in zip(names, identified.sd, strict=True)]
        rows += [
            ("determined by", name, *("data" if from_data else "prior" for from_data in row))
            for name, row in zip(names, identified.from_data, strict=True)
        ]
    return Sheet(head, tuple(rows))


def spine_groups(bodies: Sequence[str]) -> dict[str, list[int]]:
    """Indices of the vertebrae of each group of [D] table 3.3 that a model has, at least two of them."""
    result: dict[str, list[int]] = {}
    for group, pattern in _SPINE:
        members = [i for i, name in enumerate(bodies) if re.match(pattern, name.rsplit("__", 1)[-1], re.IGNORECASE)]
        if len(members) > 1:
            result[group] = members
    return result


def spine_sheet(identified: IdentificationInput) -> Sheet:
    """Population standard deviation (ddof = 0) of the vertebrae's masses by group [kg] ([D] table 3.3)."""
    masses = identified.masses
    rows: list[tuple[Cell, ...]] = [
        (group, len(members), *(float(np.std(mass[members])) for mass in masses.values()))
        for group, members in spine_groups(identified.model.body_names).items()
    ]
    return Sheet(("link group", "links", *(f"{name} [kg]" for name in masses)), tuple(rows))


def segment_share(identified: IdentificationInput, masses: Array, row: str, side: str) -> float | None:
    """Percent of the body's mass in a row of [D] table 3.4; None where the model has no such link.

    Parameters
    ----------
    masses : (bodies,) [kg]
    side : "right" or "left", for segments that come in pairs
    """
    segments = segments_given(identified)
    members = [
        i
        for i, body in enumerate(identified.model.body_names)
        if body in segments and segments[body].name in _PARTS[row] and segments[body].side in ("", side)
    ]
    total = float(masses.sum())
    return 100.0 * float(masses[members].sum()) / total if members and total > 0.0 else None


def segment_sheet(identified: IdentificationInput) -> Sheet:
    """Segments' shares of the body's mass [%] beside athletes' ([D] table 3.4), right and left."""
    masses = identified.masses
    head = ["segment", "athletes (Ae et al. 1992) [%]"]
    head += [f"{name}, {side} [%]" for side in ("right", "left") for name in masses]
    rows = [
        (row, ATHLETES[row])
        + tuple(segment_share(identified, mass, row, side) for side in ("right", "left") for mass in masses.values())
        for row in _PARTS
    ]
    return Sheet(tuple(head), tuple(rows))


def link_sheet(identified: IdentificationInput) -> Sheet:
    """Segment of every link ([D] table 3.5), and how well it is known and whether it is possible."""
    segments = segments_given(identified)
    checks = {check.name: check for check in identified.checks}
    rows: list[tuple[Cell, ...]] = []
    for i, body in enumerate(identified.model.body_names):
        segment, check = segments.get(body), checks.get(body)
        where = ("", "") if segment is None else (segment.name, segment.side)
        share = float(identified.share[i]) if len(identified.share) else None
        judged: tuple[Cell, ...] = (None,) * 4
        if check is not None:
            judged = check.mass, float(check.eigenvalues[0]), "yes" if check.ok else "no", ", ".join(check.faults)
        rows.append((body, *where, share, *judged, ", ".join(identified.from_shape.get(body, ()))))
    head = (
        "link", "segment", "side", "share from the data", "mass [kg]", "least eigenvalue of the pseudo-inertia",
        "possible", "reason", "parameters from the shape",
    )  # fmt: skip
    return Sheet(head, tuple(rows))


def misfit_sheet(identified: IdentificationInput) -> Sheet:
    """Root mean square misfit of moment and force by every method, in the frames used and in those held out."""
    rows: list[tuple[Cell, ...]] = [
        (name, float(errors[0]), float(errors[1])) for name, errors in identified.misfit.items()
    ]
    for name, errors in identified.held_out.items():
        rows.append((f"{name}, on {identified.held_out_on}", float(errors[0]), float(errors[1])))
    return Sheet(("method", "moment [N m]", "force [N]"), tuple(rows))


@dataclass(frozen=True)
class WrenchError:
    """Errors of one component by one method: mean and mean absolute, root mean square, largest [N m or N].

    Attributes
    ----------
    share : root mean square over body weight, of forces [%]; of moments, over body weight times 1 m
    """

    component: str
    method: str
    mean: float
    mean_absolute: float
    rms: float
    peak: float
    share: float


def wrench_errors(check: WrenchCheck) -> list[WrenchError]:
    """Every component's error by every method, over the frames that both know."""
    result = []
    for method, errors in check.errors.items():
        for component, column in zip(COMPONENTS, errors.T, strict=True):
            known = column[np.isfinite(column)]
            if not len(known):
                continue
            size, rms = np.abs(known), float(np.sqrt(np.mean(known**2)))
            means, share = (float(known.mean()), float(size.mean())), 100.0 * rms / check.weight
            result.append(WrenchError(component, method, *means, rms, float(size.max()), share))
    return result


def validation_sheet(identified: IdentificationInput) -> Sheet:
    """Errors of the base wrench on motions not used ([D] figure 3.3), component by component."""
    rows = [
        (
            check.trial,
            error.component,
            error.method,
            error.mean,
            error.mean_absolute,
            error.rms,
            error.peak,
            error.share,
        )
        for check in identified.validation
        for error in wrench_errors(check)
    ]
    head = (
        "motion", "component", "method", "mean error [N m, N]", "mean absolute error [N m, N]", "RMS error [N m, N]",
        "largest error [N m, N]", "RMS error [% of body weight, or of body weight times 1 m]",
    )  # fmt: skip
    return Sheet(head, tuple(rows))


def wrench_sheet(check: WrenchCheck) -> Sheet:
    """The six components over time, measured and by every method: the curves of [D] figure 3.3."""
    columns = {"measured": check.measured, **check.predicted}
    units = ("N m",) * 3 + ("N",) * 3
    head = [
        f"{component} {name} [{unit}]" for name in columns for component, unit in zip(COMPONENTS, units, strict=True)
    ]
    values = np.hstack([check.time[:, None], *columns.values()])
    return Sheet(("time [s]", *head), tuple(tuple(float(value) for value in row) for row in values))


def base_sheet(identified: IdentificationInput) -> Sheet:
    """Base parameters with their standard deviations."""
    head = ("base parameter", "estimate", "standard deviation", "relative standard deviation", "identifiable")
    if identified.base is None:
        return Sheet(head, ())
    base = identified.base
    rows = [
        (name, float(value), float(abs(value) * relative), float(relative), "yes" if shown else "no")
        for name, value, relative, shown in zip(base.names, base.estimate, base.relative_sd, base.shown, strict=True)
    ]
    return Sheet(head, tuple(rows))


def identification_tables(identified: IdentificationInput) -> dict[str, Sheet]:
    """Every table that was given something, by the name of the file to write it to."""
    sheets = {
        "masses.csv": mass_sheet(identified) if identified.parameters else None,
        "parameters.csv": parameter_sheet(identified) if identified.parameters else None,
        "spine.csv": spine_sheet(identified) if identified.parameters else None,
        "segments.csv": segment_sheet(identified) if identified.parameters and segments_given(identified) else None,
        "links.csv": link_sheet(identified),
        "misfit.csv": misfit_sheet(identified),
        "base_parameters.csv": base_sheet(identified),
        "cross_validation.csv": validation_sheet(identified),
    }
    for i, check in enumerate(identified.validation):
        name = re.sub(r"[^A-Za-z0-9_.-]+", "_", check.trial)
        sheets[f"wrench_{name or i + 1}.csv"] = wrench_sheet(check)
    return {name: sheet for name, sheet in sheets.items() if sheet is not None and sheet.rows}
