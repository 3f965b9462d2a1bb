"""What a study is made of: jobs that a process does alone, and the processes that do them."""

from __future__ import annotations

import copyreg
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

from myomorph.model.model import Model
from myomorph.store.outcome import Key, Outcome


def _read_only(values: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(values)


# Jobs go to other processes, and the values in them hold mappings that nobody may change, which pickle does not know.
copyreg.pickle(MappingProxyType, lambda mapping: (_read_only, (dict(mapping),)))


@dataclass(frozen=True)
class Job:
    """One piece of work that a process does alone.

    Attributes
    ----------
    key : subject and trial
    work : from the model to the outcome; a function of a module or a `partial` of one, so that it can be sent to
        another process or machine; its own errors are in the outcome
    needs : jobs that end well before this one may begin
    after : jobs that end before it begins, well or not
    kept : the outcome where its results are there already, else None; asked before `work`, where the jobs are given out
    model : file of the model that `work` is given, None where it needs none
    """

    key: Key
    work: Callable[[Model | None], Outcome]
    needs: tuple[Key, ...] = ()
    model: Path | None = None
    after: tuple[Key, ...] = ()
    kept: Callable[[Model | None], Outcome | None] | None = None


@dataclass(frozen=True)
class Ended:
    """A job that no longer runs.

    Attributes
    ----------
    outcome : None where its process was lost
    lost : why it was lost: killed, out of memory, out of reach
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
        """Take a job, with its model as a value; a process gets each model once, however many jobs use it."""

    def ended(self, timeout: float) -> list[Ended]:
        """Jobs that have ended since, as soon as there is one; none after `timeout` [s]. A lost worker is replaced."""

    def close(self) -> None:
        """End all processes at once, whatever they do."""
