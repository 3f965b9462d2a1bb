"""What a recording says of who it is of."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from pathlib import Path

from myomorph.core.model.known import Known
from myomorph.lab.session.body_measures import BodyMeasures
from myomorph.lab.session.names import SubjectCode


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What one recording says of who it is of.

    Attributes
    ----------
    path : of the recording
    header : who it is by its header
    code : of a subject, in names of files and folders
    word : with which the file's name begins, "" for a word on a movement or a condition
    day : of the recording, None where it is not known
    labels : of markers on the body, without names of subjects
    measures : of the body
    """

    path: Path
    header: Known[str]
    code: SubjectCode
    measures: BodyMeasures
    word: str = ""
    day: date | None = None
    labels: frozenset[str] = frozenset()

    @property
    def named(self) -> bool:
        """Whether any name says who it is."""
        return bool(self.header) or bool(self.code.text)

    def shares_name(self, other: Evidence) -> bool:
        """Whether a code, or without codes a header, names both alike."""
        if self.code.text and other.code.text:
            return self.code.text == other.code.text
        return bool(self.header) and self.header.value == other.header.value

    def named_apart(self, other: Evidence) -> str:
        """Say by which names two recordings are of two people, "" where names do not say it."""
        if self.header and other.header and self.header.value != other.header.value:
            return f"its header names {other.header}, not {self.header}"
        codes = (self.code, other.code)
        different = all(code.text for code in codes) and self.code.text != other.code.text
        if different and all(code.sure for code in codes):
            return f"its {other.code.origin} begins with {other.code.text}, not {self.code.text}"
        return ""

    def shared_labels(self, other: Evidence) -> float:
        """Share of the labels that both have, of whom has fewer."""
        fewer = min(len(self.labels), len(other.labels))
        return len(self.labels & other.labels) / fewer if fewer else 0.0
