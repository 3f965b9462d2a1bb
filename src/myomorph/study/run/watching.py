"""Who keeps what became of the jobs of a study, and tells of it: the table, the log, a bar, and whoever called."""

from __future__ import annotations

import csv
import io
import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from myomorph import __version__
from myomorph.model.errors import BadFile
from myomorph.store.outcome import GATHERED, Key, Outcome
from myomorph.store.results import fixed_date
from myomorph.study.run.job_plan import StudyJobs
from myomorph.study.run.jobs import Job, Workers
from myomorph.study.run.study_log import StudyLog
from myomorph.study.run.study_progress import StudyProgress

TABLE = "results.csv"
RARELY = 1.0
"""The table is not written more often than this, so that many short trials do not wait for it [s]."""


class StudyWatcher:
    """Keeps the outcomes of a study.

    Parameters
    ----------
    said : called with each outcome when its job ends
    """

    def __init__(
        self, name: str, jobs: StudyJobs, out: Path, workers: Workers, said: Callable[[Outcome], None]
    ) -> None:
        self._out, self._said = out, said
        self._order: dict[Key, int] = {job.key: index for index, job in enumerate(jobs.jobs)}
        self._found: dict[Key, Outcome] = {}
        self._written = time.monotonic()
        self._log = StudyLog(out)
        self._progress = StudyProgress(name or "study", len(jobs.jobs), workers.count)
        memory = "" if workers.memory is None else f", {workers.memory / 2**30:.2f} GiB of memory each"
        count = f"{workers.count} worker{'s' if workers.count != 1 else ''}"
        self._log.say(f"begin: Myomorph {__version__}, {len(jobs.jobs)} jobs, {count}{memory}")

    def started(self, job: Job) -> None:
        """A worker has taken a job."""
        self._log.say(f"start {named(job.key)}")

    def lost(self, job: Job, why: str, again: bool) -> None:
        """Its worker is lost; the job is done again, or given up."""
        self._log.say(f"lost {named(job.key)}: {why}; {'done again' if again else 'given up'}")

    def ended(self, outcome: Outcome) -> None:
        """A job has ended, or could not begin."""
        self._found[outcome.key] = outcome
        if outcome.key in self._order:
            self._progress.ended(outcome)
        self._log.say(f"{told(outcome)} ({self._progress})")
        self._log.time(outcome)
        if outcome.key != GATHERED or outcome.error:
            self._said(outcome)
        if time.monotonic() - self._written > RARELY:
            with suppress(OSError):
                self._write()

    def idle(self) -> None:
        """Nothing has happened for a while."""
        self._progress.look()

    def interrupted(self, error: BaseException) -> None:
        """The run ends before its time."""
        self._log.say(f"interrupted: {type(error).__name__} {error}")

    def outcomes(self) -> list[Outcome]:
        """Those that are known, in the order of the study file, and those of tables and groups after them."""
        last = len(self._order)
        ordered = sorted(self._found.values(), key=lambda one: self._order.get(one.key, last))
        return [one for one in ordered if one.key != GATHERED or one.error]

    def _write(self) -> None:
        write_table(self.outcomes(), self._out / TABLE)
        self._written = time.monotonic()

    def close(self) -> None:
        """Write what is known; raises `BadFile` where that is not possible."""
        self._progress.close()
        failures = sum(1 for one in self._found.values() if one.error)
        self._log.say(f"end: {len(self._found)} jobs ended, {failures} of them with an error")
        try:
            self._write()
        except OSError as error:
            problem = f"cannot be written ({error.strerror or error})"
            lacking = len(self._order) - sum(1 for one in self._found.values() if not one.error)
            hint = f"make room, then run again: {lacking} of {len(self._order)} jobs are not done"
            raise BadFile(self._out / TABLE, problem, hint) from None
        finally:
            self._log.close()


def told(outcome: Outcome) -> str:
    """An outcome as a line of the log: what was computed, what was taken over, and why."""
    name = named(outcome.key)
    computed = " ".join(step for step in outcome.done if step not in outcome.kept)
    parts = [f"computed {computed}"] if computed else []
    if outcome.kept:
        parts.append(f"kept {' '.join(outcome.kept)}")
    if outcome.changed:
        parts.append(f"because {', '.join(outcome.changed)}")
    if outcome.error:
        parts.append(outcome.error)
    return f"{'failed' if outcome.error else 'done'} {name}: {'; '.join((*parts, f'{outcome.seconds:.2f} s'))}"


def named(key: Key) -> str:
    """A job's key as it is told."""
    return "/".join(one for one in key if one) or "tables"


def write_table(outcomes: Sequence[Outcome], path: Path) -> None:
    """Write what became of every trial as a CSV file, whole or not at all."""
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    heading = ("subject", "trial", "steps", "frames", "marker_rms_m", "marker_largest_m", "seconds", "error")
    table.writerow((*heading, "condition"))
    for one in outcomes:
        # Results that are to be equal byte for byte cannot hold how long they took.
        seconds = f"{one.seconds:.2f}" if fixed_date() is None else ""
        numbers = (one.frames, f"{one.rms:.6g}", f"{one.largest:.6g}", seconds)
        table.writerow((one.subject, one.trial, " ".join(one.done), *numbers, one.error, one.condition))
    temporary = path.with_name(f".{path.name}.part")
    try:
        temporary.write_text(text.getvalue(), encoding="utf-8")
        os.replace(temporary, path)
    except OSError:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
