"""The folder of a study file, and what is noted while its files are looked for."""

from __future__ import annotations

from collections.abc import Sequence
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

    def check_names(self, names: Sequence[str]) -> None:
        """Note names that two specimens or limbs share, and that there is none at all.

        Parameters
        ----------
        names : of specimens and limbs
        """
        if not names:
            self.problems.append(
                "it has no [[specimen]] and no [[limb]]: give one, as 'myomorph viscosity"
                " --template' shows"
            )
        self.problems.extend(
            f"two specimens or limbs are named '{name}': give one another name"
            for name in dict.fromkeys(names)
            if names.count(name) > 1
        )
