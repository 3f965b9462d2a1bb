"""Workers of this machine: this process itself, or others beside it."""

from __future__ import annotations

from collections import deque

from myomorph.model.model import Model
from myomorph.study.jobs import Ended, Job, Workers


class InProcess:
    """One worker, which is the process that asks: each job is done when its end is asked for."""

    count = 1
    memory: int | None = None

    def __init__(self) -> None:
        self._waiting: deque[tuple[Job, Model | None]] = deque()

    def start(self, job: Job, model: Model | None) -> None:
        """Take a job."""
        self._waiting.append((job, model))

    def ended(self, timeout: float) -> list[Ended]:
        """Do the next job."""
        if not self._waiting:
            return []
        job, model = self._waiting.popleft()
        return [Ended(job, job.work(model))]

    def close(self) -> None:
        """Forget what has not begun."""
        self._waiting.clear()


def local_workers(count: int | None = None, memory: int | None = None, jobs: int = 0) -> Workers:
    """Workers of this machine: this process where one is enough, else others beside it.

    Parameters
    ----------
    count : processes; None for one of each core, as far as memory reaches
    memory : that each may take [bytes], None for its share of what is free
    jobs : how many there are, so that there are no more processes than that; 0 where that is not known
    """
    return InProcess()
