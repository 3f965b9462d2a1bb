"""What became of a job of a study, and what is said of one that failed."""

from __future__ import annotations

import errno
import shutil
from dataclasses import dataclass, field, replace
from pathlib import Path

from myomorph.core.model.errors import MyomorphError
from myomorph.core.model.messages import Message

Key = tuple[str, str]
"""Subject and trial; ("s01", "") is what is done once for a subject, ("", "") what is done once for
the study.
"""
GATHERED = ("", "")  # Key of the job that makes the tables of a study.
FULL = tuple(getattr(errno, name) for name in ("ENOSPC", "EDQUOT") if hasattr(errno, name))
WINDOWS_FULL = (39, 112)  # ERROR_HANDLE_DISK_FULL and ERROR_DISK_FULL.
LITTLE = 1 << 20  # Less free space than this is none: no result fits in it [bytes].


@dataclass(frozen=True)
class Outcome:
    """What became of one trial, or of a subject's own steps (`trial` "").

    Attributes
    ----------
    subject, trial : names
    folder : of the results
    done : steps that ended well, those reused from an earlier run included
    reused : steps reused from an earlier run
    changed : what made other steps be computed again that an earlier run had done, one line each
    frames : of the motion
    rms, largest : mean over frames of the markers' root mean square error, and the largest error
        [m]
    seconds : it took [s]
    error : why it stopped, "" where all went well
    fault : whether that is a fault of Myomorph rather than of the input
    condition : that the trial was recorded in
    timed : each step that was computed now, and how long it took [s]
    full : whether it stopped because no space is left where results go
    findings : what is said of the files, and what checks of markers and forces found, one line
        each
    """

    subject: str
    trial: str
    folder: Path
    done: tuple[str, ...] = ()
    reused: tuple[str, ...] = ()
    frames: int = 0
    rms: float = float("nan")
    largest: float = float("nan")
    seconds: float = 0.0
    error: str = ""
    fault: bool = False
    changed: tuple[str, ...] = ()
    condition: str = ""
    timed: tuple[tuple[str, float], ...] = ()
    full: bool = False
    findings: tuple[Message, ...] = ()

    @property
    def key(self) -> Key:
        """Subject and trial."""
        return self.subject, self.trial


@dataclass(frozen=True)
class Excluded:
    """A trial that a study file leaves out, or a whole subject (`trial` "").

    Attributes
    ----------
    subject, trial : names
    reason : why, in the words of the study file
    """

    subject: str
    trial: str
    reason: str


@dataclass(frozen=True)
class Conditions:
    """In which condition each trial was recorded.

    Attributes
    ----------
    names : in the order of the study file
    trials : condition by subject and trial
    """

    names: tuple[str, ...] = ()
    trials: dict[Key, str] = field(default_factory=dict)


def failed(outcome: Outcome, error: BaseException, step: str = "") -> Outcome:
    """Make the outcome of a trial that an error ended, in a step if any.

    Of several errors, the first is reported.
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
    message = f"{step}: {text}" if step else text
    return replace(
        outcome,
        error=outcome.error or message,
        fault=outcome.fault or fault,
        full=outcome.full or full,
    )


def disk_full(error: BaseException, folder: Path) -> bool:
    """Whether an error came of a file system without space.

    Libraries hide the number of the system's error.
    """
    if isinstance(error, OSError) and (
        error.errno in FULL or getattr(error, "winerror", None) in WINDOWS_FULL
    ):
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
