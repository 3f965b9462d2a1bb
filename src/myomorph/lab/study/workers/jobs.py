"""A job that a process does alone, the processes that do jobs, and the messages between them."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import dataclass
from typing import IO, Protocol

from myomorph.core.model.model import Model
from myomorph.lab.store.outcome import Key, Outcome

PROTOCOL = 5
"""Of pickle: from this one on, arrays that are read-only stay so, and kernels are not compiled for
both kinds.
"""


@dataclass(frozen=True)
class Job:
    """One piece of work that a process does alone.

    It leads from the model of a file, None where it needs none, to the outcome, which has its own
    errors. `work` can be sent to another process or machine: a function of a module, or a
    `partial`.
    """

    key: Key
    work: Callable[[Model | None], Outcome]


@dataclass(frozen=True)
class Ended:
    """A job that no longer runs.

    Without outcome, it says why its process was lost: killed, out of memory, out of reach.
    """

    job: Job
    outcome: Outcome | None
    lost: str = ""


class Workers(Protocol):
    """Processes that do jobs: in this process, in others of this machine, or on a cluster."""

    @property
    def count(self) -> int:
        """Jobs that run at the same time."""

    @property
    def memory(self) -> int | None:
        """That one worker may take [bytes], None where nothing bounds it."""

    def start(self, job: Job, model: Model | None) -> None:
        """Take a job, with its model as a value.

        A process gets each model once, however many jobs use it.
        """

    def ended(self, timeout: float) -> list[Ended]:
        """Return jobs that have ended since, as soon as there is one.

        There are none after `timeout` [s]. A lost worker is replaced.
        """

    def close(self) -> None:
        """End all processes at once, whatever they do."""


@dataclass(frozen=True)
class Do:
    """A job's packed `work` and model, None for that of the job before."""

    work: bytes
    model: bytes | None


@dataclass(frozen=True)
class Stop:
    """The last message: leave what you do, tidy up, end."""


@dataclass(frozen=True)
class Done:
    """The answer to a job: its outcome, or why there is none."""

    outcome: Outcome | None
    broken: str = ""


def pack(value: object) -> bytes:
    """Return a value as bytes that another process of the same version reads."""
    return pickle.dumps(value, PROTOCOL)


def send(stream: IO[bytes], message: object) -> None:
    """Write a message into a pipe; `pickle.load` takes it out.

    Raises `OSError` where nobody reads it any more.
    """
    stream.write(pack(message))
    stream.flush()
