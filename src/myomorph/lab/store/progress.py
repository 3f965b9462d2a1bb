"""How far work has come: a bar with the time left, on work longer than two seconds."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from myomorph.lab.store.watched import announce, is_watched

if TYPE_CHECKING:
    from rich.progress import Progress

PATIENCE = 2.0  # Work shorter than this says nothing [s].
OFTEN = 0.3  # How often whoever watches from outside hears how far it is [s].

Advance = Callable[[float], None]

_SILENT = False


def silence(silent: bool = True) -> bool:
    """Let `progress` say nothing here, because another says how far all is.

    Parameters
    ----------
    silent : say nothing

    Returns
    -------
    whether it was silent before
    """
    global _SILENT
    before = _SILENT
    _SILENT = silent
    return before


@contextmanager
def progress(title: str, total: int, unit: str = "frames") -> Iterator[Advance]:
    """Show how far a piece of work has come, on standard error.

    Where that is a terminal, a bar with the time left appears once the work has taken `PATIENCE`;
    else one line says at the end what was done and how long it took. Shorter work stays silent.

    Yields
    ------
    a function to call with the number of units just done
    """
    started = time.monotonic()
    bar: Progress | None = None
    done = 0.0
    interactive = sys.stderr.isatty() and not _SILENT
    watched = is_watched()
    announced = started

    def advance(count: float) -> None:
        nonlocal announced, bar, done
        done += count
        if watched and time.monotonic() - announced > OFTEN:
            announced = time.monotonic()
            announce(done=min(1.0, done / max(total, 1)))
        if bar is not None:
            bar.update(bar.task_ids[0], completed=done)
        elif interactive and time.monotonic() - started > PATIENCE:
            bar = shown_bar(title, total, done)

    try:
        yield advance
    except BaseException:
        if bar is not None:
            bar.stop()
        raise
    if bar is not None:
        bar.stop()
    took = time.monotonic() - started
    if took > PATIENCE and not interactive and not _SILENT:
        sys.stderr.write(f"{title}: {total} {unit} in {took:.1f} s\n")


def shown_bar(title: str, total: int, done: float = 0.0) -> Progress:
    """Show a bar on standard error with the time left."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    bar = Progress(  # page: rich takes columns by position
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
        console=Console(stderr=True),
        # Lines of results go above the bar, but stay where they are told to go where that is a
        # file.
        redirect_stdout=sys.stdout.isatty(),
    )
    bar.update(bar.add_task(title, total=total), completed=done)
    bar.start()
    return bar
