"""The folder of a study file, and what is noted while its files are looked for."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class StudyFolder:
    """Where the paths of a study file begin.

    Attributes
    ----------
    path : of the folder
    problems : what is wrong, a line each; the file is refused with all of them
    remarks : which files were found by the rule of names, and what is missing
    """

    path: Path
    problems: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
