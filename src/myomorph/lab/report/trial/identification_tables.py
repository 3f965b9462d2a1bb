"""Tables of an identified body as numbers: those of [D] chapter 3, and their background."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from myomorph.body.identify.subject import GENERIC, Identification
from myomorph.body.identify.validation import COMPONENTS, CrossValidation
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import PARAMETERS
from myomorph.core.model.model import Model
from myomorph.core.model.segments import Segment, segments_of
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.lab.report.page.parts import Cell, Sheet

TRUST = (
    "expected [kg]",
    "standard deviation [kg]",
    "90 % interval from [kg]",
    "90 % interval to [kg]",
    "determined by",
    "another mass than the shape's",
)
"""Columns that say how sure the mass of a link in the model is."""


ATHLETES: Mapping[str, float] = {
    "Head": 6.9,
    "Body": 45.9,
    "Upper arm": 2.7,
    "Lower arm": 1.6,
    "Hand": 0.6,
    "Thigh": 11.0,
    "Shank": 5.1,
    "Foot": 1.1,
    "Upper body": 30.2,
    "Lower body": 18.7,
}
"""Percent of body mass of Japanese male athletes (Ae, Tang, Yokoi 1992), as table 3.4 of [D] prints
them.

"Body" is a misprint there: its two parts sum to 48.9, and only with 48.9 do all segments sum to
100.
"""

_PARTS: Mapping[str, tuple[str, ...]] = {
    name: (name.lower().replace(" ", "_"),) for name in ATHLETES
} | {
    "Body": ("upper_trunk", "lower_trunk"),
    "Upper body": ("upper_trunk",),
    "Lower body": ("lower_trunk",),
}

_SPINE = (
    ("Lumbar vertebrae", r"^(lumbar|lumber|lumb|l)[_ ]?(vertebra)?[_ ]?[1-5]$"),
    (
        "Rib vertebrae",
        r"^(thoracic|thorac|rib[_ ]?vertebra|t)[_ ]?(vertebra)?[_ ]?(1[0-2]?|[2-9])$",
    ),
    ("Neck vertebrae", r"^(cervical|cerv|neck|c)[_ ]?(vertebra)?[_ ]?[1-7]$"),
)


SOFT_TISSUE_HEAD = ("coordinate", "group", "alpha [s^2]", "standard deviation [s^2]")
"""Of the table of soft tissue, which `id` reads."""

ERRORS: Mapping[str, str] = {
    "bias": "mean error [N m, N]",
    "mean": "mean absolute error [N m, N]",
    "rms": "RMS error [N m, N]",
    "peak": "largest error [N m, N]",
    "percent": "RMS error [% of body weight, or of body weight times 1 m]",
}
"""Columns of `CrossValidation.table`, as files name them."""


def named_segments(model: Model) -> Mapping[str, Segment]:
    """Segment of each body: by the bodies' names; none of a model whose names contain none."""
    try:
        return segments_of(model)
    except BadData:
        return {}


def mass_sheet(identification: Identification) -> Sheet:
    """List the mass of every link by every method [kg], its sum last ([D] tables 3.1 and 3.2).

    Intervals about the expected mass stand beside.
    """
    masses = identification.masses
    expected = identification.expected
    evidence = identification.mass_evidence
    rows: list[tuple[Cell, ...]] = []
    for i, body in enumerate(identification.model.bodies):
        interval = identification.mass_interval(body.name)
        origin = "data" if identification.from_data[i, 0] else "prior"
        trust = (
            float(expected[i, 0]),
            float(identification.sd[i, 0]),
            interval.low,
            interval.high,
            origin,
            evidence[body.name],
        )
        rows.append((body.name, *(float(mass[i]) for mass in masses.values()), *trust))
    total = ("Total", *(float(mass.sum()) for mass in masses.values()), *(None,) * len(TRUST))
    return Sheet(("link", *(f"{name} [kg]" for name in masses), *TRUST), (*rows, total))


def parameter_sheet(identification: Identification) -> Sheet:
    """List all ten parameters of every link, about the body's origin [kg, kg m, kg m^2].

    Below the methods stand the expected parameters, their standard deviations, and whether they
    come from data or prior.
    """
    units = ("kg",) + 3 * ("kg m",) + 6 * ("kg m^2",)
    head = (
        "method",
        "link",
        *(f"{name} [{unit}]" for name, unit in zip(PARAMETERS, units, strict=True)),
    )
    determined = np.where(identification.from_data, "data", "prior")
    tables = {
        **identification.parameters,
        "expected": identification.expected,
        "standard deviation": identification.sd,
        "determined by": determined,
    }
    names = identification.model.body_names
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (method, body, *row.tolist())
        for method, table in tables.items()
        for body, row in zip(names, table, strict=True)
    )
    return Sheet(head, rows)


def spine_groups(bodies: Sequence[str]) -> dict[str, list[int]]:
    """Find the vertebrae of each group of [D] table 3.3 that a model has, as indices.

    A group has at least two of them.
    """
    result: dict[str, list[int]] = {}
    for group, pattern in _SPINE:
        members = [
            i
            for i, name in enumerate(bodies)
            if re.match(pattern, name.rsplit("__", 1)[-1], re.IGNORECASE)
        ]
        if len(members) > 1:
            result[group] = members
    return result


def spine_sheet(bodies: Sequence[str], masses: Mapping[str, Array]) -> Sheet:
    """List the standard deviation of the vertebrae's masses by group ([D] table 3.3).

    It is that of the population (ddof = 0).

    Parameters
    ----------
    bodies : names
    masses : (bodies,) [kg], by method

    Returns
    -------
    A row per group, a column per method [kg]
    """
    rows: list[tuple[Cell, ...]] = [
        (group, len(members), *(float(np.std(mass[members])) for mass in masses.values()))
        for group, members in spine_groups(bodies).items()
    ]
    return Sheet(("link group", "links", *(f"{name} [kg]" for name in masses)), tuple(rows))


def segment_share(model: Model, masses: Array, row: str, side: str) -> float | None:
    """Compute the percent of body mass in a row of [D] table 3.4.

    Parameters
    ----------
    model : whose links have names of segments
    masses : (bodies,) [kg]
    row : of the table
    side : "right" or "left"

    Returns
    -------
    The share [%]; None if the model has no such link
    """
    segments = named_segments(model)
    known = [(i, segments[body]) for i, body in enumerate(model.body_names) if body in segments]
    members = [
        i for i, segment in known if segment.name in _PARTS[row] and segment.side in ("", side)
    ]
    total = float(masses.sum())
    return 100.0 * float(masses[members].sum()) / total if members and total > 0.0 else None


def segment_sheet(identification: Identification) -> Sheet:
    """Segments' shares of the body's mass [%] beside athletes' ([D] table 3.4), right and left."""
    masses = identification.masses
    sides = ("right", "left")
    head = (
        "segment",
        "athletes (Ae et al. 1992) [%]",
        *(f"{name}, {side} [%]" for side in sides for name in masses),
    )
    rows = tuple(
        (row, athletes)
        + tuple(
            segment_share(identification.model, mass, row, side)
            for side in sides
            for mass in masses.values()
        )
        for row, athletes in ATHLETES.items()
    )
    return Sheet(head, rows)


def link_sheet(identification: Identification) -> Sheet:
    """Segment of every link ([D] table 3.5), how well it is known, and whether it is possible."""
    segments = named_segments(identification.model)
    from_shape = identification.from_shape
    rows: list[tuple[Cell, ...]] = []
    links = identification.consistency[identification.chosen].links
    for check, share in zip(links, identification.link_shares.tolist(), strict=True):
        segment = segments.get(check.name)
        where = ("", "") if segment is None else (segment.name, segment.side)
        judged = (
            check.mass,
            float(check.eigenvalues[0]),
            "yes" if check.ok else "no",
            ", ".join(check.faults),
        )
        rows.append((check.name, *where, share, *judged, ", ".join(from_shape.get(check.name, ()))))
    head = (
        "link",
        "segment",
        "side",
        "share from the data",
        "mass [kg]",
        "smallest eigenvalue of the pseudo-inertia",
        "physically consistent",
        "reason",
        "parameters from the shape",
    )
    return Sheet(head, tuple(rows))


def misfit_sheet(identification: Identification) -> Sheet:
    """List the root mean square misfit of moment and force by every method.

    It is that of the frames used and of those held out.
    """
    misfits = dict(identification.residuals)
    unseen = identification.unseen
    if unseen.known:
        misfits[f"{identification.identified}, on {unseen.what}"] = unseen.rms(unseen.estimate)
        misfits[f"{GENERIC}, on {unseen.what}"] = unseen.rms(unseen.generic)
    rows = tuple((name, float(errors[0]), float(errors[1])) for name, errors in misfits.items())
    return Sheet(("method", "moment [N m]", "force [N]"), rows)


def validation_sheet(validation: Mapping[str, CrossValidation]) -> Sheet:
    """Errors of the base wrench on motions not used ([D] figure 3.3), component by component."""
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (trial, component, method, *(float(errors[name][i]) for name in ERRORS))
        for trial, check in validation.items()
        for method, errors in check.table().items()
        for i, component in enumerate(COMPONENTS)
    )
    return Sheet(("motion", "component", "method", *ERRORS.values()), rows)


def wrench_sheet(check: CrossValidation) -> Sheet:
    """List the six components over time, measured and by every method: curves of [D] figure 3.3."""
    columns = {"measured": check.measured, **check.predicted}
    rows = list(zip(COMPONENTS, ("N m",) * 3 + ("N",) * 3, strict=True))
    head = [f"{component} {name} [{unit}]" for name in columns for component, unit in rows]
    values = np.hstack([check.time[:, None], *columns.values()])
    return Sheet(("time [s]", *head), tuple(map(tuple, values.tolist())))


def base_sheet(identification: Identification) -> Sheet:
    """List base parameters with their standard deviations."""
    base = identification.base
    columns = base.base.names, base.estimate.tolist(), base.relative_sd.tolist(), base.identifiable
    rows = tuple(
        (name, value, abs(value) * relative, relative, "yes" if identifiable else "no")
        for name, value, relative, identifiable in zip(*columns, strict=True)
    )
    head = (
        "base parameter",
        "estimate",
        "standard deviation",
        "relative standard deviation",
        "identifiable",
    )
    return Sheet(head, rows)


def tissue_sheet(tissue: SoftTissue | None) -> Sheet:
    """List how much more each coordinate moves than the body's mass.

    There is no row where nothing was taken from the motion.
    """
    if tissue is None:
        return Sheet(SOFT_TISSUE_HEAD, ())
    rows = tuple(
        zip(tissue.names, tissue.groups, tissue.alpha.tolist(), tissue.sd.tolist(), strict=True)
    )
    return Sheet(SOFT_TISSUE_HEAD, rows)


def identification_tables(
    identification: Identification, validation: Mapping[str, CrossValidation]
) -> dict[str, Sheet]:
    """Collect every table that has a row, by the name of the file to write it to.

    Soft tissue is among them, which later steps read.
    """
    sheets = {
        "masses.csv": mass_sheet(identification),
        "parameters.csv": parameter_sheet(identification),
        "spine.csv": spine_sheet(identification.model.body_names, identification.masses),
        "segments.csv": (
            segment_sheet(identification) if named_segments(identification.model) else None
        ),
        "links.csv": link_sheet(identification),
        "misfit.csv": misfit_sheet(identification),
        "base_parameters.csv": base_sheet(identification),
        "cross_validation.csv": validation_sheet(validation),
    }
    for i, (trial, check) in enumerate(validation.items()):
        name = re.sub(r"[^A-Za-z0-9_.-]+", "_", trial)
        sheets[f"wrench_{name or i + 1}.csv"] = wrench_sheet(check)
    tables = {name: sheet for name, sheet in sheets.items() if sheet is not None and sheet.rows}
    return tables | {"soft_tissue.csv": tissue_sheet(identification.soft_tissue)}
