"""Where a table of a study file stands, and what is found while the file is read."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class Notes:
    """What is found while a study file is being read. `problems`: all of them make the file be refused; `remarks`: what
    is not used, or not as one might think; `found`: files that were found by the rule of names.
    """

    problems: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    found: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Place:
    """A table of a study file. `folder`: that its paths are relative to; `where`: how problems name it, as "subject
    's01'".
    """

    folder: Path
    where: str
    notes: Notes

    def problem(self, key: str, text: str) -> None:
        """Add what is wrong with a key to the problems."""
        self.notes.problems.append(f"{self.where}: {key}: {text}")
