"""What a run of a study would do, and how long it would take; nothing is computed or written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from myomorph.io.frame_count import FrameCount, count_frames
from myomorph.model.errors import MyomorphError
from myomorph.model.model import Model
from myomorph.store.locks import check_age, read_mark
from myomorph.store.outcome import Key
from myomorph.store.progress import progress
from myomorph.study.run.step_times import StepTimes, times_file
from myomorph.study.run.work import Graph, Work
from myomorph.study.step.job_steps import AFTER_OTHERS, NEVER

FRESH = "everything is asked for anew"


@dataclass(frozen=True)
class Row:
    """One job of a dry run: how many frames of recordings it uses, None where the files do not tell at once; by step,
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
    """Look at what a run of a study would do, `fresh` as if nothing could be reused. Recordings are opened only where
    there are earlier results to hold against them.
    """
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
