"""An error as what became of a trial: one line, whose fault it is, and whether the disk is full."""

from __future__ import annotations

import errno
import shutil
from dataclasses import replace
from pathlib import Path

from myomorph.model.errors import MyomorphError
from myomorph.store.outcome import Outcome

FULL = tuple(getattr(errno, name) for name in ("ENOSPC", "EDQUOT") if hasattr(errno, name))
WINDOWS_FULL = (39, 112)
"""ERROR_HANDLE_DISK_FULL and ERROR_DISK_FULL."""
LITTLE = 1 << 20
"""Less free space than this is none: no result fits in it [bytes]."""


def failed(outcome: Outcome, error: BaseException, step: str = "") -> Outcome:
    """The outcome of a trial that an error ended; of several errors, the first is told.

    Parameters
    ----------
    step : in which it happened, "" where it belongs to none
    """
    text = " ".join(str(error).split())
    full = disk_full(error, outcome.folder)
    fault = not full and not isinstance(error, MyomorphError | OSError | MemoryError)
    if full:
        text = f"no space is left where {outcome.folder} lies"
    elif isinstance(error, MemoryError):
        text = "not enough memory: use fewer workers, or cut the recording with 'time'"
    elif fault:
        text = f"{type(error).__name__}: {text}"
    told = f"{step}: {text}" if step else text
    return replace(outcome, error=outcome.error or told, fault=outcome.fault or fault, full=outcome.full or full)


def disk_full(error: BaseException, folder: Path) -> bool:
    """Whether an error came of a file system without space; libraries hide the number of the system's error."""
    if isinstance(error, OSError) and (error.errno in FULL or getattr(error, "winerror", None) in WINDOWS_FULL):
        return True
    if isinstance(error, MyomorphError) or not isinstance(error, OSError | RuntimeError):
        return False
    if any(f"errno = {number}," in str(error) for number in FULL):
        return True
    return no_space(folder)


def no_space(folder: Path) -> bool:
    """Whether there is as good as no space left where a folder lies, or will lie."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        return shutil.disk_usage(folder).free < LITTLE
    except OSError:
        return False
