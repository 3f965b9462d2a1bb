"""A run as it is watched.

It has its table of outcomes, `study.log` and `timings.csv`, the bar, and the caller's observer.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from myomorph import __version__
from myomorph.core.io.parsing.text import csv_text
from myomorph.core.model.errors import BadFile, counted
from myomorph.lab.store.locks import write_whole
from myomorph.lab.store.outcome import GATHERED, Key, Outcome
from myomorph.lab.store.progress import PATIENCE, shown_bar, silence
from myomorph.lab.store.results import fixed_date
from myomorph.lab.study.run.step_times import Learning, in_words
from myomorph.lab.study.run.work import Graph
from myomorph.lab.study.workers.jobs import Workers

if TYPE_CHECKING:
    from rich.progress import Progress

LOG = "study.log"
TIMINGS = "timings.csv"
HEADING = "subject,trial,step,frames,seconds,compiled"
TABLE = "results.csv"
# The table is not written more often than this, so that many short trials do not wait for it [s].
RARELY = 1.0


class StudyProgress:
    """Counter of the jobs of a study as they end.

    On a terminal it shows a bar in the place of those of single steps.
    """

    def __init__(self, title: str, total: int, count: int) -> None:
        self.title = title
        self.total = total
        self.count = max(1, count)
        self.done = self.failed = 0
        self._computed = [0, 0.0]
        self._reused = [0, 0.0]
        self._started = time.monotonic()
        # A single recording is reported step by step.
        self._shown = total > 1 and sys.stderr.isatty()
        self._bar: Progress | None = None
        if self._shown:
            silence()

    def ended(self, outcome: Outcome) -> None:
        """Count a job."""
        self.done += 1
        self.failed += bool(outcome.error)
        kind = self._computed if outcome.timed else self._reused
        kind[0] += 1
        kind[1] += outcome.seconds
        self.look()

    def left(self) -> float | None:
        """Return the time left [s], as if what remains took as long as what was computed.

        It is None where nothing has ended.
        """
        number, seconds = self._computed if self._computed[0] else self._reused
        if not number or not self.done:
            return None
        return (
            seconds
            / number
            * (self.total - self.done)
            / min(self.count, max(1, self.total - self.done))
        )

    def __str__(self) -> str:
        left = self.left()
        left_text = "" if left is None or self.done >= self.total else f", {in_words(left)} left"
        return f"{self.done} of {self.total}{left_text}"

    def look(self) -> None:
        """Show how far it is now."""
        if self._bar is None:
            if not self._shown or time.monotonic() - self._started < PATIENCE:
                return
            self._bar = shown_bar(self.title, self.total)
        failed = f", {self.failed} failed" if self.failed else ""
        self._bar.update(
            self._bar.task_ids[0], completed=self.done, description=f"{self.title}{failed}"
        )

    def close(self) -> None:
        """Leave the bar as it is."""
        if self._bar is not None:
            self._bar.stop()
        if self._shown:
            silence(False)


def _add(path: Path, text: str, heading: str = "") -> None:
    """Add lines to a file, after one in which an earlier run was cut off.

    A file that cannot be written stops nothing.
    """
    with suppress(OSError), path.open("ab+") as file:
        if not file.seek(0, os.SEEK_END):
            text = heading + text
        elif file.seek(-1, os.SEEK_END) and file.read() != b"\n":
            text = f"\n{text}"
        file.write(f"{text}\n".encode())


class StudyWatcher:
    """Keeps the outcomes of a study; `said` is called with each when its job ends."""

    def __init__(
        self,
        graph: Graph,
        out: Path,
        workers: Workers,
        said: Callable[[Outcome], None],
        learning: Learning,
    ) -> None:
        self._out = out
        self._said = said
        self._learning = learning
        self._order: dict[Key, int] = {work.key: index for index, work in enumerate(graph.works)}
        self._found: dict[Key, Outcome] = {}
        self._written = time.monotonic()
        self._progress = StudyProgress(graph.name or "study", len(graph.works), workers.count)
        memory = (
            "" if workers.memory is None else f", {workers.memory / 2**30:.2f} GiB of memory each"
        )
        count = counted(workers.count, "worker")
        self._say(f"begin: Myomorph {__version__}, {len(graph.works)} jobs, {count}{memory}")

    def _say(self, text: str) -> None:
        """Add a line to the log."""
        now = datetime.now().astimezone().isoformat(timespec="seconds")
        _add(self._out / LOG, f"{now} {' '.join(text.split())}")

    def started(self, key: Key) -> None:
        """Note that a worker has taken a job."""
        self._learning.started(key)
        self._say(f"start {named(key)}")

    def lost(self, key: Key, why: str, again: bool) -> None:
        """Its worker is lost; the job is done again, or given up."""
        consequence = "done again" if again else "given up"
        self._say(f"lost {named(key)}: {why}; {consequence}")

    def ended(self, outcome: Outcome) -> None:
        """Note that a job has ended, or could not begin."""
        self._learning.ended(outcome)
        self._found[outcome.key] = outcome
        if outcome.key in self._order:
            self._progress.ended(outcome)
        self._say(f"{outcome_line(outcome)} ({self._progress})")
        compiled = int(outcome.key in self._learning.compiled)
        rows = [
            (*outcome.key, step, outcome.frames, f"{took:.3f}", compiled)
            for step, took in outcome.timed
        ]
        if rows:
            _add(self._out / TIMINGS, csv_text(rows[0], rows[1:]).rstrip(), f"{HEADING}\n")
        if outcome.key != GATHERED or outcome.error:
            self._said(outcome)
        if time.monotonic() - self._written > RARELY:
            with suppress(OSError):
                self._write()

    def idle(self) -> None:
        """Nothing has happened for a while."""
        self._progress.look()

    def interrupted(self, error: BaseException) -> None:
        """Note that the run ends before its time."""
        self._say(f"interrupted: {type(error).__name__} {error}")

    def outcomes(self) -> list[Outcome]:
        """Return the outcomes that are known, in the order of the study file.

        Those of tables and groups come last.
        """
        last = len(self._order)
        ordered = sorted(
            self._found.values(), key=lambda outcome: self._order.get(outcome.key, last)
        )
        return [outcome for outcome in ordered if outcome.key != GATHERED or outcome.error]

    def _write(self) -> None:
        write_table(self.outcomes(), self._out / TABLE)
        self._written = time.monotonic()

    def close(self) -> None:
        """Write what is known; raises `BadFile` where that is not possible."""
        self._progress.close()
        failures = sum(1 for outcome in self._found.values() if outcome.error)
        self._say(f"end: {len(self._found)} jobs ended, {failures} of them with an error")
        try:
            self._write()
        except OSError as error:
            problem = f"cannot be written ({error.strerror or error})"
            lacking = len(self._order) - sum(
                1 for outcome in self._found.values() if not outcome.error
            )
            hint = f"free space, then run again: {lacking} of {len(self._order)} jobs are not done"
            raise BadFile(self._out / TABLE, problem, hint) from None


def outcome_line(outcome: Outcome) -> str:
    """Return an outcome as a line of the log: what was computed, what was reused, and why."""
    name = named(outcome.key)
    computed = " ".join(step for step in outcome.done if step not in outcome.reused)
    parts = [f"computed {computed}"] if computed else []
    if outcome.reused:
        parts.append(f"reused {' '.join(outcome.reused)}")
    if outcome.changed:
        parts.append(f"because {', '.join(outcome.changed)}")
    if outcome.error:
        parts.append(outcome.error)
    parts.append(f"{outcome.seconds:.2f} s")
    status = "failed" if outcome.error else "done"
    return f"{status} {name}: {'; '.join(parts)}"


def named(key: Key) -> str:
    """Return a job's key as it is reported."""
    return "/".join(part for part in key if part) or "tables"


def write_table(outcomes: Sequence[Outcome], path: Path) -> None:
    """Write what became of every trial as a CSV file, whole or not at all."""
    rows = []
    for outcome in outcomes:
        # Results that are to be equal byte for byte cannot hold how long they took.
        seconds = f"{outcome.seconds:.2f}" if fixed_date() is None else ""
        numbers = (outcome.frames, outcome.rms, outcome.largest, seconds)
        rows.append(
            (*outcome.key, " ".join(outcome.done), *numbers, outcome.error, outcome.condition)
        )
    head = (
        "subject",
        "trial",
        "steps",
        "frames",
        "marker_rms_m",
        "marker_largest_m",
        "seconds",
        "error",
        "condition",
    )
    write_whole(path, csv_text(head, rows))
