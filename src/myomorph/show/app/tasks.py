"""What is done for the page in a process of its own: looking into a folder, or computing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import singledispatch
from pathlib import Path

from myomorph.show.app.asked import Asked

Say = Callable[..., None]
"""Sends an event by its name, with values."""


@dataclass(frozen=True, kw_only=True)
class LookTask:
    """Look into a folder, or at a file."""

    folder: Path


@dataclass(frozen=True, kw_only=True)
class ComputeTask:
    """Compute what the page asks for."""

    asked: Asked


@singledispatch
def do(task: object, say: Say) -> None:
    """Do a task.

    Parameters
    ----------
    task : of one of the kinds above
    say : sends events
    """
    raise TypeError(f"unknown task: {task!r}")


@do.register
def _look(task: LookTask, say: Say) -> None:
    # Reading needs packages that the other task does without.
    from myomorph.show.app.found import (
        found_session,
        look_into,
        needs_places,
        results_folder,
    )

    def begins(count: int, total: int, name: str) -> None:
        say("reading", count=count, total=total, name=name)

    look = look_into(task.folder, begins)
    if needs_places(look):
        say("note", text="Finding the positions of the markers")
    say("found", found=found_session(look), out=str(results_folder(look)))


@do.register
def _compute(task: ComputeTask, say: Say) -> None:
    # Computing needs packages that the other task does without.
    from myomorph.show.app.computing import compute

    compute(task.asked, say)
