"""Norms of gait as a table: groups of people, each with curves, parameters, ages and speeds."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.core.io.parsing.cells import plain_record
from myomorph.core.io.parsing.door import content_of
from myomorph.core.io.parsing.text import written
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadFile, listing
from myomorph.core.model.frozen_map import FrozenMap, grouped
from myomorph.lab.analysis.gait_curves import KEYS, SAMPLES
from myomorph.lab.analysis.gait_parameters import UNITS
from myomorph.lab.analysis.gait_scores import GaitNorm, LogScores, ScoreScale

COLUMNS = ("group", "variable", "percent", "mean", "sd", "n", "low", "high")
AGE = "Age"
SPEED = "Walking speed"
LOG_SCORE = "ln stride score"
LOG_SCORE_OF_BOTH = "ln stride score, both sides"
OLD_LOG_SCORE = "ln score"
"""Of mean curves, which no patient's strides can be held against."""
SOURCE = "source"
DEFINITIONS = "definitions"
OWN = "own"
"""Word of `DEFINITIONS` where angles are those of this program's models."""
VARIABLES = (AGE, LOG_SCORE, LOG_SCORE_OF_BOTH, OLD_LOG_SCORE, *UNITS, *KEYS)


@dataclass(frozen=True, kw_only=True)
class NormRow:
    """A line of the table.

    Attributes
    ----------
    group, variable : whose it is, and of what: one of `VARIABLES`
    percent : of the stride, nan where the variable is no curve
    mean, sd : between people
    n : people, 0 where it is not known
    low, high : of ages and speeds, between which the group is a norm; nan else
    """

    group: str
    variable: str
    percent: float
    mean: float
    sd: float
    n: int
    low: float
    high: float


def read_norms(path: Path) -> tuple[GaitNorm, ...]:
    """Read all groups of a file of norms.

    Lines that begin with # say where the numbers come from ("# source: ...") and whether angles are
    defined as here ("# definitions: own" or "other").

    Raises
    ------
    BadFile : a column or a row is none of a norm
    """
    try:
        lines = content_of(path, "settings").decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise BadFile(path, f"cannot be read as a norm ({error})") from None
    facts = _facts(line for line in lines if line.startswith("#"))
    table = csv.DictReader(line for line in lines if line and not line.startswith("#"))
    missing = [name for name in COLUMNS if name not in (table.fieldnames or ())]
    if missing:
        hint = "'myomorph norms' makes one of a control group"
        raise BadFile(path, f"is no norm of gait: has no column '{missing[0]}'", hint)
    rows = [_row(path, number, plain_record(cells)) for number, cells in enumerate(table, 1)]
    groups = grouped((row.group, row) for row in rows)
    return tuple(_norm(group, members, facts) for group, members in groups.items())


def _facts(lines: Iterable[str]) -> dict[str, str]:
    """Return what the head says, by word; a line without a word goes on with the one above."""
    facts: dict[str, str] = {}
    last = ""
    for line in lines:
        text = line.lstrip("# ").strip()
        word, colon, said = text.partition(":")
        if colon and word in (SOURCE, DEFINITIONS):
            last = word
            facts[word] = said.strip()
        elif last:
            facts[last] += f" {text}"
    return facts


def _row(path: Path, number: int, cells: Mapping[str, str]) -> NormRow:
    """Return a line of the table, checked."""
    variable = cells["variable"]
    if variable not in VARIABLES:
        names = listing(variable, VARIABLES)
        raise BadFile(path, f"row {number}: unknown variable '{variable}'", f"there are {names}")
    try:
        row = NormRow(
            group=cells["group"],
            variable=variable,
            percent=_number(cells["percent"]),
            mean=float(cells["mean"]),
            sd=_number(cells["sd"]),
            n=int(float(cells["n"] or 0)),
            low=_number(cells["low"]),
            high=_number(cells["high"]),
        )
    except (TypeError, ValueError):
        raise BadFile(
            path, f"row {number} ('{variable}'): has a cell that is not a number"
        ) from None
    if variable in KEYS and not 0.0 <= row.percent <= 100.0:
        raise BadFile(path, f"row {number} ('{variable}'): percent is not between 0 and 100")
    return row


def _number(text: str) -> float:
    return float(text) if text else float("nan")


def _norm(group: str, rows: Sequence[NormRow], facts: Mapping[str, str]) -> GaitNorm:
    """Return a group as a norm; curves between their rows by straight lines."""
    by_variable = grouped((row.variable, row) for row in rows)
    mean = np.full((SAMPLES, len(KEYS)), np.nan)
    deviation = np.full((SAMPLES, len(KEYS)), np.nan)
    for index, key in enumerate(KEYS):
        curve = sorted(by_variable.get(key, ()), key=lambda row: row.percent)
        if len(curve) > 1:
            mean[:, index] = _sampled(curve, [row.mean for row in curve])
            deviation[:, index] = _sampled(curve, [row.sd for row in curve])
    single = {name: members[0] for name, members in by_variable.items()}
    return GaitNorm(
        mean=mean,
        deviation=deviation,
        persons=max((row.n for row in rows), default=0),
        source=facts.get(SOURCE, "") or group,
        parameters=FrozenMap(
            {name: (row.mean, row.sd) for name, row in single.items() if name in UNITS}
        ),
        same_definitions=facts.get(DEFINITIONS, OWN) == OWN,
        scale=_scale(single),
        old_scale=OLD_LOG_SCORE in single,
        group=group,
        ages=_range(single.get(AGE)),
        speeds=_range(single.get(SPEED)),
    )


def _scale(single: Mapping[str, NormRow]) -> ScoreScale | None:
    """Return the scale of scores; None where a file does not have both of its rows."""
    side = single.get(LOG_SCORE)
    both = single.get(LOG_SCORE_OF_BOTH)
    if side is None or both is None:
        return None
    return ScoreScale(side=LogScores(side.mean, side.sd), both=LogScores(both.mean, both.sd))


def _sampled(curve: Sequence[NormRow], values: Sequence[float]) -> Array:
    """Return values at every sample of gait curves (SAMPLES,), NaN beyond the first and last."""
    at = np.linspace(0.0, 100.0, SAMPLES)
    percents = [row.percent for row in curve]
    return np.asarray(np.interp(at, percents, values, left=np.nan, right=np.nan))


def _range(row: NormRow | None) -> tuple[float, float]:
    """Return between which values a group is a norm, all where nothing is said."""
    if row is None or not (np.isfinite(row.low) and np.isfinite(row.high)):
        return 0.0, np.inf
    return row.low, row.high


def write_norm(path: Path, norm: GaitNorm) -> None:
    """Write a group as a file of norms, whole or not at all."""
    definitions = OWN if norm.same_definitions else "other"
    head = [f"# {SOURCE}: {norm.source}\n", f"# {DEFINITIONS}: {definitions}\n"]
    with written(path) as stream:
        stream.writelines(head)
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(COLUMNS)
        table.writerows(_cells(row) for row in norm_rows(norm))


def _cells(row: NormRow) -> tuple[str, ...]:
    numbers = (row.percent, row.mean, row.sd)
    ends = (row.low, row.high)
    return (
        row.group,
        row.variable,
        *(_text(value) for value in numbers),
        str(row.n) if row.n else "",
        *(_text(value) for value in ends),
    )


def _text(value: float) -> str:
    return f"{value:.9g}" if np.isfinite(value) else ""


def norm_rows(norm: GaitNorm) -> Iterator[NormRow]:
    """Yield ages, parameters and curves of a group, as far as they are known."""
    if np.isfinite(norm.ages[1]):
        yield _single(norm, AGE, (0.5 * sum(norm.ages), np.nan), norm.ages)
    for name, numbers in norm.parameters.items():
        limits = norm.speeds if name == SPEED else (np.nan, np.nan)
        yield _single(norm, name, numbers, limits)
    if norm.scale is not None:
        yield _single(norm, LOG_SCORE, norm.scale.side, (np.nan, np.nan))
        yield _single(norm, LOG_SCORE_OF_BOTH, norm.scale.both, (np.nan, np.nan))
    percents = np.linspace(0.0, 100.0, SAMPLES)
    for index, key in enumerate(KEYS):
        for sample in np.flatnonzero(np.isfinite(norm.mean[:, index])):
            row = _single(
                norm,
                key,
                (float(norm.mean[sample, index]), float(norm.deviation[sample, index])),
                (np.nan, np.nan),
                float(percents[sample]),
            )
            yield row


def _single(
    norm: GaitNorm,
    variable: str,
    numbers: tuple[float, float],
    limits: tuple[float, float],
    percent: float = float("nan"),
) -> NormRow:
    """Return a row of a group."""
    mean, sd = numbers
    low, high = limits
    return NormRow(
        group=norm.group or "controls",
        variable=variable,
        percent=percent,
        mean=mean,
        sd=sd,
        n=norm.persons,
        low=low,
        high=high,
    )
