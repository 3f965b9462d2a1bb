"""How far a run is, and how long it will take, from what its processes say."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from myomorph.lab.study.run.step_times import in_words

USUAL = {
    "calibrate": 6.0,
    "ik": 3.0,
    "id": 4.0,
    "muscles": 3.0,
    "tension": 8.0,
    "uncertainty": 120.0,
    "report": 6.0,
}
"""Shares of steps whose time this machine has not learned yet [s]."""
OTHER = 4.0  # Of a step that is not among them [s].
WORDS = {
    "calibrate": "fitting the body to the markers",
    "ik": "joint angles",
    "id": "joint torques",
    "muscles": "muscle lengths and lever arms",
    "tension": "muscle forces",
    "uncertainty": "effects of errors",
    "report": "drawing the pages",
    "tables": "tables of all recordings",
}
"""Steps in words that need no terminal."""
EARLY = 0.04  # Share of the work before which nothing is said of the time left.
TRUST = 0.15  # Share of the work that what this machine has learned counts as.


@dataclass(frozen=True, kw_only=True)
class PlannedJob:
    """A job of a run.

    Attributes
    ----------
    subject, trial : whose it is
    steps : in their order
    seconds : that each is expected to take, None where it never ran here
    """

    subject: str
    trial: str
    steps: tuple[str, ...]
    seconds: tuple[float | None, ...]

    @property
    def shares(self) -> tuple[float, ...]:
        """Of the steps in the whole work [s]."""
        return tuple(
            max(USUAL.get(step, OTHER) if seconds is None else seconds, 0.05)
            for step, seconds in zip(self.steps, self.seconds, strict=True)
        )

    @property
    def total(self) -> float:
        """Share of the job [s]."""
        return sum(self.shares)


@dataclass
class _Place:
    """Where a process is in a job: its step, and how much of it is done."""

    step: int = 0
    done: float = 0.0


@dataclass(kw_only=True)
class Bar:
    """How far a run is.

    Attributes
    ----------
    jobs : of the run, in their order
    side : jobs that run side by side
    ended : keys of jobs that have ended
    """

    jobs: Sequence[PlannedJob] = ()
    side: int = 1
    ended: set[tuple[str, str]] = field(default_factory=set)

    def look(self, said: Iterable[Mapping[str, Any]], elapsed: float) -> dict[str, Any]:
        """Say how far the run is.

        Parameters
        ----------
        said : by its processes, see `lab.store.watched`
        elapsed : since it began [s]

        Returns
        -------
        what the page shows: `share` 0 to 1, `left` in words, `now` steps that are computed
        """
        total = sum(job.total for job in self.jobs)
        if not total:
            return {"share": 0.0, "left": "", "now": []}
        places = self._places(said)
        done = sum(self._done(job, places) for job in self.jobs)
        now = [self._words(job, places) for job in self.jobs if self._is_running(job, places)]
        return {
            "share": min(done / total, 0.99),
            "left": self._left(done, total, elapsed),
            "now": now,
        }

    def _places(self, said: Iterable[Mapping[str, Any]]) -> dict[tuple[str, str], _Place]:
        known = {(job.subject, job.trial): job for job in self.jobs}
        places: dict[tuple[str, str], _Place] = {}
        current: _Place | None = None
        for line in said:
            if "step" in line:
                key = (str(line.get("subject", "")), str(line.get("trial", "")))
                job = known.get(key)
                if job is None or line["step"] not in job.steps:
                    current = None
                    continue
                current = _Place(step=job.steps.index(line["step"]))
                places[key] = current
            elif current is not None:
                current.done = float(line.get("done", 0.0))
        return places

    def _is_running(self, job: PlannedJob, places: Mapping[tuple[str, str], _Place]) -> bool:
        key = (job.subject, job.trial)
        return key in places and key not in self.ended

    def _done(self, job: PlannedJob, places: Mapping[tuple[str, str], _Place]) -> float:
        """Part of a job's share that is done [s]."""
        key = (job.subject, job.trial)
        if key in self.ended:
            return job.total
        place = places.get(key)
        if place is None:
            return 0.0
        return sum(job.shares[: place.step]) + place.done * job.shares[place.step]

    def _words(self, job: PlannedJob, places: Mapping[tuple[str, str], _Place]) -> str:
        step = job.steps[places[job.subject, job.trial].step]
        words = WORDS.get(step, step)
        return f"{job.trial or job.subject}: {words}" if job.trial or job.subject else words

    def _left(self, done: float, total: float, elapsed: float) -> str:
        """Time left in words, "" where nothing is known of it yet."""
        learned = all(seconds is not None for job in self.jobs for seconds in job.seconds)
        if not learned and done < EARLY * total:
            return ""
        # As if a share of the work had been done before, as fast as this machine has learned.
        weight = TRUST * total if learned else 0.0
        rate = (elapsed + weight / self.side) / (done + weight)
        return in_words(max(1.0, (total - done) * rate))
