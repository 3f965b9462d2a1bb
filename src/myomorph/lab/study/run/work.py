"""What one process does of a study.

It does the steps of one subject, trial, pair, specimen, or of the study itself.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path

from myomorph.core.io.frame_count import FrameCount, count_frames
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.lab.store.locks import PATIENCE, RunMark, folder_lock
from myomorph.lab.store.outcome import Key, Outcome, failed
from myomorph.lab.study.step.job_steps import JobSteps, run_steps
from myomorph.lab.study.step.step import WHOLE_STUDY
from myomorph.lab.study.step.step_table import REPORT, Scope
from myomorph.lab.study.trial.trial_inputs import Settings

Open = Callable[[Model | None, str, bool], JobSteps]
"""From the model that a job is given ("" or the hash of its file when it was read, whether all is
computed anew) to its steps, with their inputs opened; a function of a module or a `partial` of one.
"""


@dataclass(frozen=True)
class Recording:
    """A recording that a job reads, for the count of its frames."""

    path: Path
    time: tuple[float, float] | None = None


@dataclass(frozen=True)
class Work:
    """The work of one job, which is sent to the process that does it.

    `outcome` is that before the first step: whose it is, its condition, and the folder of its
    results; `open` gives its inputs, where it is done; `needs` are jobs that end well before it may
    begin, `after` those that end before, well or not; `model` is the file of the model that it is
    given; `files` are named in a dry run; `recordings` are those whose frames it uses.
    """

    scope: Scope
    outcome: Outcome
    steps: tuple[str, ...]
    open: Open
    needs: tuple[Key, ...] = ()
    after: tuple[Key, ...] = ()
    model: Path | None = None
    fresh: bool = False
    mark: RunMark | None = None
    settings: Settings = field(default_factory=lambda: FrozenMap({}))
    files: tuple[str, ...] = ()
    recordings: tuple[Recording, ...] = ()

    @property
    def key(self) -> Key:
        """Of the job."""
        return self.outcome.key

    @property
    def folder(self) -> Path:
        """Of its results."""
        return self.outcome.folder

    def frames(self, count: Callable[[Path], FrameCount] = count_frames) -> int | None:
        """Frames that are used of its recordings, None where the files do not show it at once."""
        counts = [count(recording.path).within(recording.time) for recording in self.recordings]
        known = [frames for frames in counts if frames is not None]
        if not counts or len(known) < len(counts):
            return None
        # Several recordings that are solved as one have common times.
        return min(known) if self.scope == "pair" else sum(known)

    def __call__(self, model: Model | None, read: str = "") -> Outcome:
        """Do it alone in its folder; an error ends it, but not the study.

        `read`: hash of the model's file, "" if unknown.
        """
        started = time.monotonic()
        try:
            with self._lock():
                steps = self.open(model, read, self.fresh)
                check = (lambda: None) if self.mark is None else self.mark.check
                outcome = run_steps(steps, [step for step in self.steps if step != REPORT], check)
        except Exception as error:
            outcome = failed(self.outcome, error)
        return self._told(outcome, started)

    def reused(self, model: Model | None, read: str = "") -> Outcome | None:
        """Return the outcome where nothing would be computed, before the job is given out.

        It is None where a worker must look, which reports whatever is wrong.
        """
        if not self.folder.is_dir():
            return None
        started = time.monotonic()
        try:
            with self._lock(patience=0.0):
                outcome = self.open(model, read, False).unchanged(self.steps)
        except Exception:
            return None
        return None if outcome is None else self._told(outcome, started)

    def reasons(self, model: Model | None) -> dict[str, tuple[str, ...]]:
        """By step, why it would be computed; () where it would be reused."""
        return self.open(model, "", False).all_reasons(self.steps)

    def _lock(self, patience: float = PATIENCE) -> AbstractContextManager[None]:
        # The folder of a study is this run's already.
        return (
            nullcontext()
            if self.scope in WHOLE_STUDY
            else folder_lock(self.folder, self.mark, patience)
        )

    def _told(self, outcome: Outcome, started: float) -> Outcome:
        subject = self.outcome.subject
        trial = self.outcome.trial
        condition = self.outcome.condition
        seconds = time.monotonic() - started
        return replace(outcome, subject=subject, trial=trial, condition=condition, seconds=seconds)


def outcome_of(key: Key, folder: Path, condition: str = "") -> Outcome:
    """Begin the outcome of what has a key, with its results in a folder."""
    subject, trial = key
    return Outcome(subject=subject, trial=trial, folder=folder, condition=condition)


def not_run(work: Work, why: str, fault: bool = False) -> Outcome:
    """Return the outcome of a job that could not begin; `fault`: by a fault of Myomorph."""
    outcome = outcome_of(work.key, work.folder)
    return replace(outcome, error=f"not run: {why}", fault=fault)


@dataclass(frozen=True)
class Graph:
    """All that a study has to do, in the order of its file.

    `last` follows from the outcomes of all.
    """

    name: str
    works: tuple[Work, ...]
    last: Callable[[tuple[Outcome, ...]], tuple[Work, ...]]
    open_model: Callable[[Path], Model]
