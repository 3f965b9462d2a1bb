"""How far a study has come: one bar over all trials, with the time left, and the same as words for the log."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING

from myomorph.store.outcome import Outcome
from myomorph.store.progress import PATIENCE, silence
from myomorph.study.run.expected_time import in_words

if TYPE_CHECKING:
    from rich.progress import Progress


class StudyProgress:
    """Counts the jobs of a study as they end.

    On a terminal a bar on standard error shows it, in the place of those of single steps; else nothing is printed.

    Parameters
    ----------
    title : of the study
    total : how many jobs there are
    count : how many of them run side by side
    """

    def __init__(self, title: str, total: int, count: int) -> None:
        self.title, self.total, self.count = title, total, max(1, count)
        self.done = self.failed = 0
        self._computed, self._kept = [0, 0.0], [0, 0.0]
        self._started = time.monotonic()
        # A single recording is told of step by step.
        self._shown = total > 1 and sys.stderr.isatty()
        self._bar: Progress | None = None
        if self._shown:
            silence()

    def ended(self, outcome: Outcome) -> None:
        """Count a job."""
        self.done += 1
        self.failed += bool(outcome.error)
        kind = self._computed if outcome.timed else self._kept
        kind[0] += 1
        kind[1] += outcome.seconds
        self.look()

    def left(self) -> float | None:
        """Time left [s], as if what remains took as long as what was computed; None where nothing has ended."""
        number, seconds = self._computed if self._computed[0] else self._kept
        if not number or not self.done:
            return None
        return seconds / number * (self.total - self.done) / min(self.count, max(1, self.total - self.done))

    def __str__(self) -> str:
        left = self.left()
        told = "" if left is None or self.done >= self.total else f", {in_words(left)} left"
        return f"{self.done} of {self.total}{told}"

    def look(self) -> None:
        """Show how far it is now."""
        if self._bar is None:
            if not self._shown or time.monotonic() - self._started < PATIENCE:
                return
            self._bar = self._begin()
        failed = f", {self.failed} failed" if self.failed else ""
        left = self.left()
        told = "" if left is None else f"{in_words(left)} left"
        self._bar.update(self._bar.task_ids[0], completed=self.done, left=told, description=f"{self.title}{failed}")

    def _begin(self) -> Progress:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[left]}"),
            TimeElapsedColumn(),
            console=Console(stderr=True),
            refresh_per_second=2,
            # Lines of results go above the bar, but stay where they are told to go where that is a file.
            redirect_stdout=sys.stdout.isatty(),
        )
        bar.add_task(self.title, total=self.total, left="")
        bar.start()
        return bar

    def close(self) -> None:
        """Leave the bar as it is."""
        if self._bar is not None:
            self._bar.stop()
        if self._shown:
            silence(False)
