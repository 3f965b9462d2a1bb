"""What became of a job of a study."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

Key = tuple[str, str]
"""Subject and trial; ("s01", "") is what is done once for a subject, ("", "") what is done once for the study."""


@dataclass(frozen=True)
class Outcome:
    """What became of one trial, or of a subject's own steps (`trial` "").

    Attributes
    ----------
    done : steps that ended well, those taken over from an earlier run included
    kept : steps taken over from an earlier run
    changed : what made other steps be computed again that an earlier run had done, one line each
    frames : of the motion
    rms, largest : mean over frames of the markers' root mean square error, and the largest error [m]
    seconds : it took [s]
    error : why it stopped, "" where all went well
    fault : whether that is a fault of Myomorph rather than of the input
    condition : that the trial was recorded in
    timed : each step that was computed now, and how long it took [s]
    full : whether it stopped because no space is left where results go
    """

    subject: str
    trial: str
    folder: Path
    done: tuple[str, ...] = ()
    kept: tuple[str, ...] = ()
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

    @property
    def key(self) -> Key:
        """Subject and trial."""
        return self.subject, self.trial


@dataclass(frozen=True)
class Excluded:
    """A trial that a study file leaves out, or a whole subject (`trial` "").

    Attributes
    ----------
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


GATHERED = ("", "")
"""Key of the job that makes the tables of a study."""
