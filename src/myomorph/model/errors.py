"""The errors a user can meet: what was given, what exists, what to try."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence

LONGEST, LAST = 20_000, 2_000
"""Letters of a message at most, and how many of them are its end."""

CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029]")


class MyomorphError(Exception):
    """Base of every error that is the input's fault; the command line exits 2 on it.

    Its message is one line without control signs, whatever a file holds that it tells of.
    """

    def __str__(self) -> str:
        return one_line(super().__str__())


class UnknownName(MyomorphError, KeyError):
    """A name that the model or the file does not have."""

    def __init__(self, kind: str, name: str, existing: Iterable[str], where: str = "the model"):
        self.kind, self.name, self.existing, self.where = kind, name, tuple(existing), where
        super().__init__(kind, name, self.existing, where)

    def __str__(self) -> str:
        return one_line(f"unknown {self.kind} '{self.name}': {self.where} has {listing(self.name, self.existing)}")


class BadFile(MyomorphError):
    """A file that cannot be read, with the reason and what to try."""

    def __init__(self, path: object, problem: str, hint: str = ""):
        self.path, self.problem, self.hint = path, problem, hint
        super().__init__(path, problem, hint)

    def __str__(self) -> str:
        return one_line(f"{self.path}: {self.problem}" + (f"; {self.hint}" if self.hint else ""))


class BadModel(MyomorphError):
    """A model that is inconsistent, or that holds what would change the result and is not built."""


class BadData(MyomorphError):
    """Values that no step can use: wrong shape, not finite, no frames, no common time."""


class MissingPackage(MyomorphError):
    """A package that one feature alone needs is not installed."""

    def __init__(self, package: str, extra: str):
        self.package, self.extra = package, extra
        super().__init__(package, extra)

    def __str__(self) -> str:
        return f"this needs the package '{self.package}': python -m pip install \"myomorph[{self.extra}]\""


def one_line(text: str) -> str:
    """A text for a terminal: control signs as blanks, and of a very long one the beginning and the end."""
    text = CONTROL.sub(" ", text)
    if len(text) <= LONGEST:
        return text
    return f"{text[: LONGEST - LAST]} ... ({len(text) - LONGEST} letters) ... {text[-LAST:]}"


def quoted(names: Iterable[str], most: int = 6) -> str:
    """Names in quotes, cut to `most`."""
    given = tuple(names)
    return ", ".join(f"'{name}'" for name in given[:most]) + (", ..." if len(given) > most else "")


def listing(name: str, existing: Sequence[str], most: int = 6) -> str:
    """Names that exist, those nearest to `name` first, cut to `most`."""
    if not existing:
        return "none"
    near = difflib.get_close_matches(name, existing, n=most, cutoff=0.5)
    rest = [other for other in existing if other not in near]
    shown = (near + rest)[:most]
    text = ", ".join(f"'{one}'" for one in shown)
    return text + (f", ... ({len(existing)} in all)" if len(existing) > most else "")
