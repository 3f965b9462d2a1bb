"""What a run of a study would do, and how long it would take; nothing is computed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from myomorph.io.frame_count import FrameCount, count_frames
from myomorph.model.errors import MyomorphError
from myomorph.model.model import Model
from myomorph.store.locks import check_age, read_mark
from myomorph.store.outcome import Excluded, Key
from myomorph.store.progress import progress
from myomorph.study.run.step_times import StepTimes, in_words, times_file
from myomorph.study.run.watching import named
from myomorph.study.run.work import Graph, Work
from myomorph.study.step.job_steps import AFTER_OTHERS, NEVER

FRESH = "everything is asked for anew"


@dataclass(frozen=True)
class Row:
    """One job of a dry run: how many frames of recordings it uses, None where files do not show it at once; by step,
    why it would be computed, () where it would be reused; seconds that this machine has learned of the computed steps,
    and those whose time is `unknown`; what keeps it from being looked at.
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
    """What a run would do, job by job in the order of the study file; `workers` jobs run side by side."""

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
        return max(sum(row.seconds for row in self.rows) / self.side, *(row.seconds for row in self.rows), 0.0)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Steps that would be computed and whose time is not known."""
        return tuple(dict.fromkeys(step for row in self.rows for step in row.unknown))

    @property
    def problems(self) -> tuple[str, ...]:
        """What would fail, as far as it was looked at."""
        return tuple(dict.fromkeys(row.problem for row in self.rows if row.problem))


def dry_run(graph: Graph, out: Path, fresh: bool = False, workers: int = 1) -> DryRun:
    """Look at what a run would do; recordings are opened only where there are earlier results to hold against them."""
    check_age(read_mark(out))
    looked = _Looked(graph, fresh)
    rows = []
    with progress("looking at jobs", len(graph.works), "jobs") as advance:
        for work in graph.works:
            rows.append(looked.row(work))
            advance(1)
    return DryRun(graph.name, out, tuple(rows), workers)


@dataclass
class _Looked:
    """What was looked at so far: jobs of which something would be computed, counts of the frames of recordings."""

    graph: Graph
    fresh: bool
    computed: set[Key] = field(default_factory=set)
    counts: dict[Path, FrameCount] = field(default_factory=dict)
    _models: dict[Path, Model | MyomorphError] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.times = StepTimes(times_file())

    def row(self, work: Work) -> Row:
        """What a run would do of one job."""
        why, problem = self._reasons(work)
        computed = [step for step, reasons in why.items() if reasons]
        if computed:
            self.computed.add(work.key)
        frames = work.frames(self._count)
        seconds, unknown = 0.0, list[str]()
        muscles = self._muscles(work) if computed else None
        for step in computed:
            taken = None
            if muscles is not None:
                taken = self.times.expected(step, work.settings.get(step, {}), muscles, frames)
            if taken is None:
                unknown.append(step)
            seconds += taken or 0.0
        unread = None if work.model is None else self._models.get(work.model)
        if isinstance(unread, MyomorphError) and not self._awaits(work):
            problem = problem or " ".join(str(unread).split())
        for recording in work.recordings:
            if recording.time is not None and self._count(recording.path).within(recording.time) == 0:
                start, end = recording.time
                problem = problem or f"{recording.path}: has no frame from {start:g} to {end:g} s, the time asked for"
        return Row(work, frames, why, seconds, tuple(unknown), problem)

    def _awaits(self, work: Work) -> bool:
        """Whether it begins with what other jobs would compute."""
        return any(key in self.computed for key in (*work.needs, *work.after))

    def _reasons(self, work: Work) -> tuple[dict[str, tuple[str, ...]], str]:
        """Why steps would be computed, and what kept them from being looked at."""
        there = work.folder.is_dir() and any(work.folder.iterdir())
        if self.fresh or not there:
            return dict.fromkeys(work.steps, (FRESH if there else NEVER,)), ""
        if self._awaits(work):
            return dict.fromkeys(work.steps, (AFTER_OTHERS,)), ""
        try:
            return work.reasons(None if work.model is None else self._model(work.model)), ""
        except MyomorphError as error:
            return dict.fromkeys(work.steps, (NEVER,)), " ".join(str(error).split())

    def _model(self, path: Path) -> Model:
        """A model, read once; raises what reading it raised the first time."""
        if path not in self._models:
            try:
                self._models[path] = self.graph.open_model(path)
            except MyomorphError as error:
                self._models[path] = error
        result = self._models[path]
        if isinstance(result, MyomorphError):
            raise result
        return result

    def _muscles(self, work: Work) -> int | None:
        """Muscles of the model that a job is given, None where it cannot be read, or not yet."""
        if work.model is None:
            return 0
        try:
            return len(self._model(work.model).muscles)
        except MyomorphError:
            return None

    def _count(self, path: Path) -> FrameCount:
        if path not in self.counts:
            self.counts[path] = count_frames(path)
        return self.counts[path]


HEADING = ("subject", "trial", "condition", "frames", "reused", "computed", "time", "files")
MAX_NAMES = 4


def dry_run_lines(dry_run: DryRun, excluded: Sequence[Excluded] = (), conditions: Sequence[str] = ()) -> Iterator[str]:
    """The lines that `--dry-run` prints, with what the study file leaves out and the conditions of its trials."""
    outcomes = [row.work.outcome for row in dry_run.rows]
    subjects = dict.fromkeys(outcome.subject for outcome in outcomes)
    counts = [_many(len(subjects), "subject"), _many(sum(1 for outcome in outcomes if outcome.trial), "trial")]
    counts += [f"conditions {', '.join(conditions)}"] if conditions else []
    yield f"{dry_run.name}: {', '.join(counts)}; results go to {dry_run.out}"
    yield ""
    yield from _table(dry_run.rows, bool(conditions))
    yield from _reasons(dry_run.rows)
    if excluded:
        yield ""
        yield "left out:"
        yield from (f"  {_name((trial.subject, trial.trial))}: {trial.reason}" for trial in excluded)
    if dry_run.problems:
        yield ""
        yield "cannot be looked at:"
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
    time = "-" if not row.computed else "?" if row.unknown else in_words(row.seconds)
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
        rest = f" and {_many(len(names) - MAX_NAMES, 'other')}" if len(names) > MAX_NAMES else ""
        yield f"  {text}: {', '.join(shown)}{rest}"


def _time(dry_run: DryRun) -> Iterator[str]:
    if not any(row.computed for row in dry_run.rows):
        yield "nothing to compute: all results are there and would come out the same"
        return
    if dry_run.seconds:
        yield f"expected: {in_words(dry_run.seconds)} with {_many(dry_run.side, 'worker')}"
        yield "  by what steps took before on this machine (step_times.csv in the user's cache folder)"
    if dry_run.unknown:
        steps = ", ".join(dry_run.unknown)
        yield f"time unknown: {steps}: not run before on this machine with such settings and so many muscles"


def _name(key: Key) -> str:
    return key[0] if key[0] == key[1] else named(key)


def _many(count: int, noun: str) -> str:
    return f"{count} {noun}" + ("" if count == 1 else "s")
