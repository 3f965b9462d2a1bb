"""The analysis of a motion: who moves, where the center of gravity goes, contacts, phases.

It includes correlations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import Contacts
from myomorph.core.model.series import Series
from myomorph.lab.analysis.contact_states import (
    Limb,
    limb_states,
    measured_contacts,
    solved_contacts,
)
from myomorph.lab.analysis.correlations import Correlations, correlate
from myomorph.lab.analysis.cycles import NONE, Periodicity, find_period
from myomorph.lab.analysis.motion_phases import Cuttable, Cutting, StageMeasures, cut, measure
from myomorph.lab.analysis.presets import Preset, fitting_preset, named_muscles, preset_of
from myomorph.lab.analysis.selection import (
    Pair,
    Subject,
    centroids,
    lowest_joint,
    standing_height,
    subjects,
)
from myomorph.lab.report.trial.figures import axis_names, weighted
from myomorph.lab.report.trial.prepared import Prepared, thinned

REST_TIME = 0.5
REST_SPEED = 0.03
REST_SHARE = 0.05
MAX_FRAMES = 20000
STEP_TIME = 0.1
PERSONS = ("third", "second", "fourth")
NEARLY = 0.8


@dataclass(frozen=True, eq=False)
class Person:
    """One subject in the analysis."""

    who: Subject
    center: Series  # center of gravity along `axis_names(up)`, vertical first, (frames, 3) [m]
    # height of the center of gravity over the lowest joint in the model's default posture, and its
    # mean height over the lowest joint of the motion [m]
    standing: tuple[float, float]
    still: float  # mean height while the recording begins at rest [m], nan where it does not
    periods: tuple[Periodicity, ...]  # of the three columns of `center`
    muscles: tuple[Pair, ...]  # of the preset or those chosen, as far as the model has them
    lacking: tuple[str, ...]  # the others
    # (frames, n) by `column_name`, parts of a muscle weighted by strength; None where nothing is
    # known of them
    activations: Series | None


@read_only
class MotionAnalysis:
    """What the panels show."""

    preset: Preset
    chosen: bool  # whether the user named the preset
    span: tuple[float, float]
    axes: tuple[str, ...]  # names of the columns of centers of gravity
    persons: tuple[Person, ...]
    contacts: Contacts | None
    # limbs, touching: what can touch, and (frames, limbs) whether it does, at `time`
    limbs: tuple[Limb, ...]
    time: Array
    touching: np.ndarray | None
    cutting: Cutting
    measures: tuple[StageMeasures, ...]  # of every stage, of the first person
    # rows contacts and muscles, columns `axes`, of the first person
    correlations: Correlations | None

    @property
    def who(self) -> tuple[Subject, ...]:
        """Subjects and objects."""
        return tuple(person.who for person in self.persons)


def analyse(prepared: Prepared) -> MotionAnalysis | None:
    """Analyze the motion in the results.

    The result is None where neither a center of gravity nor contacts are known.
    """
    results = prepared.results
    contacts = _contacts(prepared)
    who = _who(prepared)
    if not who and (contacts is None or not contacts.intervals):
        return None
    sources = () if contacts is None else tuple({each.source for each in contacts.intervals})
    clock = _clock(prepared)
    limbs, touching = limb_states(contacts, clock, who) if contacts is not None else ((), None)
    walks = prepared.ground.kind == "gait" and _steps(limbs, touching, clock)
    preset = _preset(prepared, who, walks, sources)
    persons = _persons(prepared, who, results.analysis.muscles or preset.muscles)
    cuttable = Cuttable(
        span=prepared.span,
        time=clock,
        events=prepared.events,
        contact_names=tuple(limb.label for limb in limbs),
        touching=touching,
        nothing="no plate loaded" if sources == ("plates",) else "no contact",
        period=_clearest_period(persons),
    )
    cutting = cut(cuttable, preset.cuts, results.analysis.phases)
    center, muscles = (persons[0].center, persons[0].activations) if persons else (None, None)
    return MotionAnalysis(
        preset=preset,
        chosen=bool(results.analysis.preset),
        span=prepared.span,
        axes=tuple(axis_names(prepared.up)[1]),
        persons=persons,
        contacts=contacts,
        limbs=limbs,
        time=clock,
        touching=touching,
        cutting=cutting,
        measures=tuple(
            measure(stage, center, muscles, clock, touching) for stage in cutting.stages
        ),
        correlations=_correlations(center, _rows(muscles, clock, limbs, touching)),
    )


def _who(prepared: Prepared) -> tuple[Subject, ...]:
    """Subjects and objects whose center of gravity is known."""
    model = prepared.results.model
    return () if model is None or prepared.centroid is None else subjects(model)


def _preset(
    prepared: Prepared, who: Sequence[Subject], walks: bool, sources: tuple[str, ...]
) -> Preset:
    """Return the preset that the study names, else the one that fits the recording."""
    results = prepared.results
    if results.analysis.preset:
        return preset_of(results.analysis.preset)
    people = sum(1 for subject in who if subject.muscles)
    holds = len(who) > people > 0
    return fitting_preset(walks, sources, people, holds, results.recorded.movement.value)


def _correlations(center: Series | None, rows: Series | None) -> Correlations | None:
    """Correlate activations and contacts with the center of gravity, as far as both are known."""
    if center is None or rows is None or len(rows) < 2:
        return None
    return correlate(rows, leveled(center))


def _clearest_period(persons: Sequence[Person]) -> float:
    """Find the clearest of the longest periods of the first center of gravity [s], or NaN."""
    periodic = [period for period in persons[0].periods if period.periodic] if persons else []
    longest = max((period.period for period in periodic), default=0.0)
    alike = [period for period in periodic if period.period > NEARLY * longest]
    return max(alike, key=lambda period: period.likeness).period if alike else float("nan")


def _contacts(prepared: Prepared) -> Contacts | None:
    results = prepared.results
    if results.contacts.touches is not None:
        return results.contacts.touches
    if results.contacts.forces is not None and results.contacts.forces.sites:
        return solved_contacts(results.contacts.forces)
    if results.dynamics.wrenches is not None and len(results.dynamics.wrenches.names):
        return measured_contacts(results.dynamics.wrenches, prepared.up, prepared.weight)
    return None


def _steps(limbs: tuple[Limb, ...], touching: np.ndarray | None, time: Array) -> bool:
    """Check whether the right foot and the left one each stand alone for a while.

    They do in steps and not in rising.
    """
    if touching is None or len(time) < 2:
        return False
    alone = touching.sum(axis=1) == 1
    step = float(np.median(np.diff(time)))
    stood = {
        limb.side: step * float((alone & on).sum())
        for limb, on in zip(limbs, touching.T, strict=True)
    }
    return all(stood.get(side, 0.0) > STEP_TIME for side in ("right", "left"))


def _clock(prepared: Prepared) -> Array:
    if prepared.centroid is not None:
        return prepared.centroid.time
    wrenches = prepared.results.dynamics.wrenches
    if wrenches is not None and len(wrenches) > 1:
        return wrenches.time[:: max(1, len(wrenches) // MAX_FRAMES)]
    return np.linspace(*prepared.span, 1001)


def _persons(
    prepared: Prepared, who: tuple[Subject, ...], wanted: tuple[str, ...]
) -> tuple[Person, ...]:
    results = prepared.results
    motion = prepared.results.kinematics.motion
    if results.model is None or motion is None or prepared.centroid is None or not who:
        return ()
    fewer = thinned(motion, MAX_FRAMES)
    centers = (prepared.centroid,) if len(who) == 1 else centroids(results.model, fewer, who)
    vectors = np.stack(axis_names(prepared.up)[0])
    names = results.tension.muscles if results.tension is not None else ()
    persons = []
    for subject, center in zip(who, centers, strict=True):
        series = Series(center.time, tuple(axis_names(prepared.up)[1]), center.values @ vectors.T)
        lowest = lowest_joint(results.model, fewer, subject, prepared.up)
        height = _mean(series.values[:, 0])
        known = [name for name in names if name in set(subject.muscles)]
        muscles, lacking = named_muscles(known, wanted if subject.muscles else (), subject.prefix)
        periods = tuple(
            find_period(series.time, column) if len(series) > 8 else NONE
            for column in series.values.T
        )
        standing = standing_height(results.model, subject, prepared.up), height - lowest
        persons.append(
            Person(
                who=subject,
                center=series,
                standing=standing,
                still=_still(series),
                periods=periods,
                muscles=muscles,
                lacking=lacking,
                activations=_activations(prepared, muscles),
            )
        )
    return tuple(persons)


def _mean(values: Array) -> float:
    """Mean of the known values, NaN where none is."""
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


def _still(center: Series) -> float:
    """Mean height over the first half second, where the center of gravity hardly moves then."""
    first = center.time <= center.time[0] + REST_TIME
    part = center.values[first]
    if first.all() or len(part) < 3 or not np.isfinite(part).all():
        return float("nan")
    moved = float(np.ptp(part, axis=0).max())
    least = min(
        REST_SPEED * REST_TIME, REST_SHARE * float(np.nanmax(np.ptp(center.values, axis=0)))
    )
    return float(part[:, 0].mean()) if moved < least else float("nan")


def _activations(prepared: Prepared, muscles: tuple[Pair, ...]) -> Series | None:
    series = prepared.results.activations
    strengths = prepared.results.strengths
    if series is None:
        return None
    columns: dict[str, Array] = {}
    for pair in muscles:
        for side, members in pair.members.items():
            mean = weighted(series, members, strengths)
            columns |= {} if mean is None else {column_name(pair, side): mean}
    return (
        Series(series.time, tuple(columns), np.stack(list(columns.values()), axis=1))
        if columns
        else None
    )


def column_name(pair: Pair, side: str) -> str:
    """Name of a muscle's column in `Person.activations`."""
    return f"{pair.label}, {side}" if side else pair.label


def _rows(
    activations: Series | None, clock: Array, limbs: tuple[Limb, ...], touching: np.ndarray | None
) -> Series | None:
    """Contacts that change and muscles as columns of one series."""
    rows: list[Series] = []
    state = np.zeros((1, 0), dtype=bool) if touching is None else touching
    changing = np.asarray(state.any(axis=0) & ~state.all(axis=0))
    if touching is not None and changing.any():
        names = tuple(limb.label for limb, changes in zip(limbs, changing, strict=True) if changes)
        rows.append(Series(clock, names, touching[:, changing].astype(np.float64)))
    if activations is not None and activations.names:
        rows.append(activations)
    if len(rows) == 1:
        return rows[0]
    if rows:
        return _joined(rows)
    return None


def _joined(rows: list[Series]) -> Series:
    """Columns of several series at the last one's times within all."""
    last = rows[-1]
    inside = np.ones(len(last), dtype=bool)
    for row in rows:
        inside &= (last.time >= row.time[0] - 1e-9) & (last.time <= row.time[-1] + 1e-9)
    time = last.time[inside]
    columns = [np.interp(time, row.time, column) for row in rows for column in row.values.T]
    names = tuple(name for row in rows for name in row.names)
    return Series(
        time, names, np.stack(columns, axis=1) if len(time) else np.zeros((0, len(names)))
    )


def leveled(series: Series) -> Series:
    """Every column less its straight line: walking forward is no relation."""
    values = np.array(series.values)
    for column in values.T:
        known = np.isfinite(column)
        if known.sum() > 2:
            x = series.time - series.time[0]
            fit = np.polynomial.polynomial.polyfit(x[known], column[known], 1)
            column -= fit[0] + fit[1] * x
    return Series(series.time, series.names, values)


def person_styles(analysis: MotionAnalysis) -> list[str]:
    """Style of every person's lines."""
    return (
        [PERSONS[i % 3] for i in range(len(analysis.persons))]
        if len(analysis.persons) > 1
        else ["middle"]
    )


def person_legend(analysis: MotionAnalysis) -> list[tuple[str, str]]:
    """Styles and names of the persons."""
    return [
        (style, person.who.name)
        for person, style in zip(analysis.persons, person_styles(analysis), strict=True)
    ]
