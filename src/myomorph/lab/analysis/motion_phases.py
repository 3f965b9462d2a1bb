"""Phases of a motion: how it is cut, and center of mass, muscles and contacts in each."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Event, Series
from myomorph.lab.analysis.phases import Phase
from myomorph.lab.analysis.presets import Cut

MAX_STAGES = 16
MIN_DURATION = 0.03
PARTS = 4


@dataclass(frozen=True)
class Stage:
    """What is treated as one: a phase, or all phases with the same contacts."""

    name: str
    phases: tuple[Phase, ...]

    @property
    def duration(self) -> float:
        """Of all together [s]."""
        return sum(phase.stop - phase.start for phase in self.phases)

    def inside(self, time: Array) -> np.ndarray:
        """Find the times that belong to the stage; a border belongs to the later one.

        Parameters
        ----------
        time : (frames,) [s]

        Returns
        -------
        (frames,) whether each belongs to it
        """
        result = np.zeros(len(time), dtype=bool)
        for phase in self.phases:
            result |= (time >= phase.start - 1e-9) & (time < phase.stop - 1e-9)
        return result


@dataclass(frozen=True, eq=False)
class Cutting:
    """A motion in stages, and how it was cut: "given", or one of the cuts of a preset."""

    stages: tuple[Stage, ...]
    by: str

    @property
    def phases(self) -> tuple[Phase, ...]:
        """All phases in order of time."""
        return tuple(
            sorted(
                (phase for stage in self.stages for phase in stage.phases),
                key=lambda phase: phase.start,
            )
        )


@read_only
class Cuttable:
    """What phases are made from."""

    span: tuple[float, float]  # first and last time [s]
    time: Array
    events: tuple[Event, ...] = ()
    # contact_names, touching: what can touch, and (frames, names) whether it does, at `time`
    contact_names: tuple[str, ...] = ()
    touching: np.ndarray | None = None
    nothing: str = "no contact"  # what no contact is called
    period: float = float("nan")  # of the center of gravity [s], nan where it has none


def cut(what: Cuttable, cuts: Sequence[Cut], phases: Sequence[Phase] = ()) -> Cutting:
    """Cut a motion into phases: the given ones, else those of the first cut that fits.

    A cut fits that makes at least two phases and not too many.
    """
    if phases:
        in_order = sorted(phases, key=lambda phase: phase.start)
        return Cutting(tuple(Stage(phase.name, (phase,)) for phase in in_order), "given")
    makers = {
        "events": _between_events,
        "contacts": _by_contacts,
        "cycles": _cycles,
        "parts": _parts,
    }
    for way in cuts:
        stages = makers[way](what)
        if 2 <= len(stages) <= MAX_STAGES:
            return Cutting(stages, way)
    return Cutting((), "")


def _single(borders: Sequence[float], names: Sequence[str]) -> tuple[Stage, ...]:
    return tuple(
        Stage(name, (Phase(name, start, stop),))
        for (start, stop), name in zip(itertools.pairwise(borders), names, strict=True)
        if stop - start > 1e-6
    )


def _between_events(what: Cuttable) -> tuple[Stage, ...]:
    """Cut from one event to the next; a phase is named after both.

    The time before the first event and after the last is a phase too.
    """
    inside = [event for event in what.events if what.span[0] < event.time < what.span[1]]
    if not inside:
        return ()
    labels = [
        f"{event.side[:1]} {event.label.replace('Foot ', '').lower()}".strip() for event in inside
    ]
    borders = [what.span[0], *(event.time for event in inside), what.span[1]]
    names = [f"to {labels[0]}", *(f"{a} – {b}" for a, b in itertools.pairwise(labels))]
    return _single(borders, [*names, f"from {labels[-1]}"])


def _by_contacts(what: Cuttable) -> tuple[Stage, ...]:
    """Cut where the contacts change; all phases with the same contacts are one stage.

    Stages stand in order of appearance. A contact from the first frame to the last does not
    distinguish phases and is not named.
    """
    if what.touching is None or not len(what.contact_names) or not what.touching.any():
        return ()
    runs = _steady(what.touching, what.time)
    always = what.touching.all(axis=0)
    if always.all():
        return ()
    by_name: dict[str, list[Phase]] = {}
    for start, stop in runs:
        on = what.touching[(start + stop) // 2] & ~always
        touching = [name for name, touches in zip(what.contact_names, on, strict=True) if touches]
        name = together(touching, "nothing else" if always.any() else what.nothing)
        last = float(what.time[min(stop + 1, len(what.time) - 1)])
        if last > what.time[start]:
            by_name.setdefault(name, []).append(Phase(name, float(what.time[start]), last))
    return tuple(Stage(name, tuple(phases)) for name, phases in by_name.items())


def together(names: Sequence[str], nothing: str = "no contact") -> str:
    """Write in words what is in contact: both of a pair as such, nothing as flight."""
    if not names:
        return nothing
    left = list(names)
    texts = []
    for name in names:
        if name not in left:
            continue
        side = next((word for word in ("right", "left") if word in name.split()), "")
        mate = name.replace(side, "left" if side == "right" else "right", 1) if side else name
        if mate != name and mate in left:
            ending = "feet" if name.endswith("foot") else "s"
            texts.append(name.replace(side, "both", 1).removesuffix("foot") + ending)
            left.remove(mate)
        else:
            texts.append(name)
        left.remove(name)
    return " + ".join(texts)


def _steady(touching: np.ndarray, time: Array) -> list[tuple[int, int]]:
    """Find runs [first, last] of frames of the same contacts.

    A run too short to be one joins the one before it.
    """
    changes = np.flatnonzero((touching[1:] != touching[:-1]).any(axis=1)) + 1
    borders = [0, *changes.tolist(), len(touching)]
    runs: list[tuple[int, int]] = []
    for start, stop in itertools.pairwise(borders):
        short = time[stop - 1] - time[start] < MIN_DURATION
        same = bool(runs) and np.array_equal(touching[sum(runs[-1]) // 2], touching[start])
        if runs and (short or same):
            runs[-1] = runs[-1][0], stop - 1
        else:
            runs.append((start, stop - 1))
    return runs


def _cycles(what: Cuttable) -> tuple[Stage, ...]:
    """One period of the center of gravity after another, from the start."""
    if not np.isfinite(what.period) or what.period <= 0.0:
        return ()
    count = int((what.span[1] - what.span[0]) / what.period + 1e-6)
    borders = [what.span[0] + what.period * i for i in range(count + 1)]
    names = [f"Cycle {i + 1}" for i in range(count)]
    if what.span[1] - borders[-1] > 0.1 * what.period:
        borders.append(what.span[1])
        names.append("Remainder")
    return _single(borders, names)


def _parts(what: Cuttable) -> tuple[Stage, ...]:
    borders = np.linspace(*what.span, PARTS + 1).tolist()
    return _single(borders, [f"Part {i + 1}" for i in range(PARTS)])


@read_only
class StageMeasures:
    """What a stage is like."""

    stage: Stage
    # mean, range, variance: (3,) of the center of gravity along the ground's axes [m], [m], [m^2];
    # range and variance are those within a phase, their means over the phases of a stage
    mean: Array
    range: Array
    variance: Array
    # activity, peak: mean over time and muscles, and largest activation; nan where none is known
    activity: float
    peak: float
    strongest: int  # index of the muscle of the largest mean activation, -1 where none is known
    # (names,) share of its time that each limb touches; empty where contacts are not known
    contact: Array


def measure(
    stage: Stage,
    center: Series | None,
    activations: Series | None,
    time: Array,
    touching: np.ndarray | None,
) -> StageMeasures:
    """Measure one stage.

    Parameters
    ----------
    stage : phases of the same contacts or the same name
    center : (frames, 3) center of gravity [m]
    activations : (frames, muscles) from 0 to 1
    time : (frames,) of the contacts [s]
    touching : (frames, limbs) whether each is in contact

    Returns
    -------
    StageMeasures, NaN where the stage has no frames
    """
    way = _way(stage, center)
    activity = _activity(stage, activations)
    return StageMeasures(
        stage=stage,
        mean=way.mean,
        range=way.range,
        variance=way.variance,
        activity=activity.mean,
        peak=activity.peak,
        strongest=activity.strongest,
        contact=_contact(stage, time, touching),
    )


class _Way(NamedTuple):
    """Of the center of gravity, (3,) each, as in `StageMeasures`."""

    mean: Array
    range: Array
    variance: Array


def _way(stage: Stage, center: Series | None) -> _Way:
    unknown = np.full(3, np.nan)
    if center is None:
        return _Way(unknown, unknown, unknown)
    parts = [center.values[Stage("", (phase,)).inside(center.time)] for phase in stage.phases]
    parts = [kept for part in parts if len(kept := part[np.isfinite(part).all(axis=1)])]
    if not parts:
        return _Way(unknown, unknown, unknown)
    share = np.array([len(part) for part in parts]) / sum(len(part) for part in parts)
    return _Way(
        mean=share @ [part.mean(axis=0) for part in parts],
        range=share @ [np.ptp(part, axis=0) for part in parts],
        variance=share @ [part.var(axis=0) for part in parts],
    )


class _Activity(NamedTuple):
    """Of the muscles, as in `StageMeasures`."""

    mean: float = float("nan")
    peak: float = float("nan")
    strongest: int = -1


def _activity(stage: Stage, activations: Series | None) -> _Activity:
    if activations is None or not activations.names:
        return _Activity()
    rows = activations.values[stage.inside(activations.time)]
    if not (rows.size and np.isfinite(rows).any()):
        return _Activity()
    means = np.array([np.nanmean(row) if np.isfinite(row).any() else np.nan for row in rows.T])
    return _Activity(
        mean=float(np.nanmean(means)),
        peak=float(np.nanmax(rows)),
        strongest=int(np.nanargmax(means)),
    )


def _contact(stage: Stage, time: Array, touching: np.ndarray | None) -> Array:
    if touching is None:
        return np.zeros(0)
    inside = stage.inside(time)
    return touching[inside].mean(axis=0) if inside.any() else np.full(touching.shape[1], np.nan)
