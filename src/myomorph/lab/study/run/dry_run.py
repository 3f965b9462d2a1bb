"""What a run of a study would do, and how long it would take; nothing is computed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

from myomorph.core.io.frame_count import FrameCount, count_frames
from myomorph.core.model.errors import MyomorphError, counted
from myomorph.core.model.model import Model
from myomorph.lab.store.locks import check_age, read_mark
from myomorph.lab.store.outcome import Excluded, Key
from myomorph.lab.store.progress import progress
from myomorph.lab.study.run.step_times import StepTimes, in_words, times_file
from myomorph.lab.study.run.watching import named
from myomorph.lab.study.run.work import Graph, Work
from myomorph.lab.study.step.job_steps import AFTER_OTHERS, NEVER

FRESH = "everything is requested anew"


@dataclass(frozen=True)
class Row:
    """One job of a dry run.

    Attributes
    ----------
    work : the job
    frames : of recordings that it uses, None where files do not show them at once
    reasons : by step, why it would be computed, () where it would be reused
    seconds : that this machine has learned of the computed steps
    unknown : computed steps whose time is not known
    problem : what prevents a look at it
    """

    work: Work
    frames: int | None
    reasons: Mapping[str, tuple[str, ...]]
    seconds: float = 0.0
    unknown: tuple[str, ...] = ()
    problem: str = ""

    @property
    def reused(self) -> tuple[str, ...]:
        """Steps that would be reused."""
        return tuple(step for step, why in self.reasons.items() if not why)

    @property
    def computed(self) -> tuple[str, ...]:
        """Steps that would be computed."""
        return tuple(step for step, why in self.reasons.items() if why)


@dataclass(frozen=True)
class DryRun:
    """What a run would do, job by job in the order of the study file.

    `workers` jobs run side by side.
    """

    name: str
    out: Path
    rows: tuple[Row, ...]
    workers: int = 1

    @property
    def side(self) -> int:
        """Jobs that run side by side."""
        return max(min(self.workers, sum(1 for row in self.rows if row.computed)), 1)

    @property
    def seconds(self) -> float:
        """Time of the steps whose time is known, as so many workers do them."""
        return max(
            sum(row.seconds for row in self.rows) / self.side,
            *(row.seconds for row in self.rows),
            0.0,
        )

    @property
    def unknown(self) -> tuple[str, ...]:
        """Steps that would be computed and whose time is not known."""
        return tuple(dict.fromkeys(step for row in self.rows for step in row.unknown))

    @property
    def problems(self) -> tuple[str, ...]:
        """What would fail, as far as it was looked at."""
        return tuple(dict.fromkeys(row.problem for row in self.rows if row.problem))


def dry_run(graph: Graph, out: Path, fresh: bool = False, workers: int = 1) -> DryRun:
    """Find what a run would do.

    Recordings are opened only where there are earlier results to compare them with.
    """
    check_age(read_mark(out))
    count = cache(count_frames)
    times = StepTimes(times_file())
    awaited = set[Key]()
    rows = []

    @cache
    def read(path: Path | None) -> Model | MyomorphError | None:
        try:
            return None if path is None else graph.open_model(path)
        except MyomorphError as error:
            return error

    with progress("checking jobs", len(graph.works), "jobs") as advance:
        for work in graph.works:
            # What begins with what other jobs would compute cannot be looked at.
            awaits = not awaited.isdisjoint((*work.needs, *work.after))
            row = _row(work, read(work.model), fresh, awaits, count, times)
            awaited |= {work.key} if row.computed else set()
            rows.append(row)
            advance(1)
    return DryRun(name=graph.name, out=out, rows=tuple(rows), workers=workers)


def _row(
    work: Work,
    model: Model | MyomorphError | None,
    fresh: bool,
    awaits: bool,
    count: Callable[[Path], FrameCount],
    times: StepTimes,
) -> Row:
    """Find what a run would do of one job."""
    frames = work.frames(count)
    found = _compared(work, model, fresh, awaits)
    computed = [step for step, reasons in found.by_step.items() if reasons]
    taken = dict.fromkeys(computed)
    if not isinstance(model, MyomorphError):
        muscles = 0 if model is None else len(model.muscles)
        taken = {
            step: times.expected(step, work.settings.get(step, {}), muscles, frames)
            for step in computed
        }
    unknown = tuple(step for step, seconds in taken.items() if seconds is None)
    return Row(
        work=work,
        frames=frames,
        reasons=found.by_step,
        seconds=sum(seconds or 0.0 for seconds in taken.values()),
        unknown=unknown,
        problem=found.problem or _outside_recordings(work, count),
    )


class _Comparison(NamedTuple):
    """Why the steps of a job would be computed, () where they would be reused.

    `problem`: what prevents a look at it.
    """

    by_step: Mapping[str, tuple[str, ...]]
    problem: str = ""


def _compared(
    work: Work, model: Model | MyomorphError | None, fresh: bool, awaits: bool
) -> _Comparison:
    """Compare the earlier results of a job with what it would do now."""
    has_results = work.folder.is_dir() and any(work.folder.iterdir())
    if fresh and has_results:
        reason = FRESH
    elif awaits and has_results:
        reason = AFTER_OTHERS
    else:
        reason = NEVER
    alike = dict.fromkeys(work.steps, (reason,))
    if awaits:
        return _Comparison(alike)
    if isinstance(model, MyomorphError):
        return _Comparison(alike, _one_line(model))
    if fresh or not has_results:
        return _Comparison(alike)
    try:
        return _Comparison(work.reasons(model))
    except MyomorphError as error:
        return _Comparison(alike, _one_line(error))


def _one_line(error: MyomorphError) -> str:
    return " ".join(str(error).split())


def _outside_recordings(work: Work, count: Callable[[Path], FrameCount]) -> str:
    """Name the first recording that has no frame in the requested time, "" for none."""
    for recording in work.recordings:
        if recording.time is not None and count(recording.path).within(recording.time) == 0:
            start, end = recording.time
            return f"{recording.path}: has no frame from {start:g} to {end:g} s, the time requested"
    return ""


HEADING = ("subject", "trial", "condition", "frames", "reused", "computed", "time", "files")
MAX_NAMES = 4


def dry_run_lines(
    dry_run: DryRun, excluded: Sequence[Excluded] = (), conditions: Sequence[str] = ()
) -> Iterator[str]:
    """Yield the lines that `--dry-run` prints.

    They contain what the study file leaves out and the conditions of its trials.
    """
    outcomes = [row.work.outcome for row in dry_run.rows]
    subjects = dict.fromkeys(outcome.subject for outcome in outcomes)
    counts = [
        counted(len(subjects), "subject"),
        counted(sum(1 for outcome in outcomes if outcome.trial), "trial"),
    ]
    counts += [f"conditions {', '.join(conditions)}"] if conditions else []
    yield f"{dry_run.name}: {', '.join(counts)}; results go to {dry_run.out}"
    yield ""
    yield from _table(dry_run.rows, bool(conditions))
    yield from _reasons(dry_run.rows)
    if excluded:
        yield ""
        yield "left out:"
        yield from (
            f"  {_name((trial.subject, trial.trial))}: {trial.reason}" for trial in excluded
        )
    if dry_run.problems:
        yield ""
        yield "cannot be checked:"
        yield from (f"  {problem}" for problem in dry_run.problems)
    yield ""
    yield from _time(dry_run)


def _table(rows: tuple[Row, ...], conditions: bool) -> Iterator[str]:
    shown = [name for name in HEADING if conditions or name != "condition"]
    cells = [HEADING, *map(_cells, rows)]
    columns = [[row[HEADING.index(name)] for row in cells] for name in shown]
    widths = [max(map(len, column)) for column in columns]
    for line in zip(*columns, strict=True):
        yield "  ".join(
            cell.rjust(width) if name in ("frames", "time") else cell.ljust(width)
            for name, cell, width in zip(shown, line, widths, strict=True)
        ).rstrip()


def _cells(row: Row) -> tuple[str, ...]:
    outcome = row.work.outcome
    if not row.computed:
        time = "-"
    elif row.unknown:
        time = "?"
    else:
        time = in_words(row.seconds)
    return (
        outcome.subject,
        outcome.trial,
        outcome.condition,
        "?" if row.frames is None else str(row.frames),
        " ".join(row.reused) or "-",
        " ".join(row.computed) or "-",
        time,
        ", ".join(row.work.files),
    )


def _reasons(rows: tuple[Row, ...]) -> Iterator[str]:
    """Why results that are there would be computed again, each reason once."""
    jobs: dict[str, dict[str, list[str]]] = {}
    for row in rows:
        for step, why in row.reasons.items():
            for text in why:
                if text != NEVER:
                    jobs.setdefault(text, {}).setdefault(_name(row.work.key), []).append(step)
    if jobs:
        yield ""
        yield "computed again, because"
    for text, names in jobs.items():
        shown = [f"{name} ({' '.join(steps)})" for name, steps in list(names.items())[:MAX_NAMES]]
        rest = f" and {counted(len(names) - MAX_NAMES, 'other')}" if len(names) > MAX_NAMES else ""
        yield f"  {text}: {', '.join(shown)}{rest}"


def _time(dry_run: DryRun) -> Iterator[str]:
    if not any(row.computed for row in dry_run.rows):
        yield "nothing to compute: all results are up to date"
        return
    if dry_run.seconds:
        yield f"expected: {in_words(dry_run.seconds)} with {counted(dry_run.side, 'worker')}"
        yield (
            "  from times of earlier steps on this machine (step_times.csv in the user's cache"
            " folder)"
        )
    if dry_run.unknown:
        steps = ", ".join(dry_run.unknown)
        yield (
            f"time unknown: {steps}: not run before on this machine with such settings and so many"
            " muscles"
        )


def _name(key: Key) -> str:
    return key[0] if key[0] == key[1] else named(key)
