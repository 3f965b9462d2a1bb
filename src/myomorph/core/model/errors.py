"""The errors a user can meet: what is wrong, what exists, what to try."""

from __future__ import annotations

import difflib
import importlib
import re
from collections.abc import Collection, Iterable
from functools import cache
from importlib.util import find_spec
from typing import Any, Literal, get_args, get_origin, get_type_hints

MAX_CHARACTERS = 20_000  # Of a message
END_CHARACTERS = 2_000  # Of the end of a message that is too long
MAX_NAMES = 5  # That a message lists
MIN_RATIO = 0.6  # Share of common characters from which two names are alike
MIN_PART = 3  # Characters from which a part of a name is like it
CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029]")


class MyomorphError(Exception):
    """Base of every error that is the input's fault; the command line exits 2 on it.

    Its message is one line without control characters, whatever the file holds that it quotes.
    """

    def __str__(self) -> str:
        return one_line(super().__str__())


class UnknownName(MyomorphError, KeyError):
    """A name that the model or the file does not have."""

    def __init__(self, kind: str, name: str, existing: Iterable[str], where: str = "the model"):
        self.kind = kind
        self.name = name
        self.existing = tuple(existing)
        self.where = where
        super().__init__(kind, name, self.existing, where)

    def __str__(self) -> str:
        return one_line(unknown(self.kind, self.name, self.existing, self.where))


class BadFile(MyomorphError):
    """A file that cannot be read, with the reason and what to try."""

    def __init__(self, path: object, problem: str, hint: str = ""):
        self.path = path
        self.problem = problem
        self.hint = hint
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
        self.package = package
        self.extra = extra
        super().__init__(package, extra)

    def __str__(self) -> str:
        return (
            f"this needs the package '{self.package}': python -m pip install"
            f' "myomorph[{self.extra}]"'
        )


class BadExtension(MyomorphError):
    """A part of an installed package that extends Myomorph cannot be imported."""

    def __init__(self, package: str, place: str, error: Exception):
        self.package = package
        self.place = place
        self.error = error
        super().__init__(package, place, error)

    def __str__(self) -> str:
        return one_line(
            f"the extension '{self.package}' does not work: {self.place} cannot be imported"
            f" ({type(self.error).__name__}: {self.error}): update the package that brings it, or"
            " uninstall it"
        )


def check_name(kind: str, name: str, existing: Collection[str], where: str = "the model") -> None:
    """Raise `UnknownName` where a name is not among those that exist."""
    if name not in existing:
        raise UnknownName(kind, name, existing, where=where)


def check_choices(options: object) -> None:
    """Raise `BadData` where a field of a dataclass has none of the values of its `Literal`."""
    kind: Any = type(options)
    for name, choices in _choices(kind).items():
        value = getattr(options, name)
        if value not in choices:
            listed = ", ".join(f"'{choice}'" for choice in choices)
            raise BadData(f"unknown {name.replace('_', ' ')} '{value}': there are {listed}")


@cache
def _choices(kind: type) -> dict[str, tuple[Any, ...]]:
    """Values that each field of a dataclass with a `Literal` may have, by name."""
    hints = get_type_hints(kind)
    return {name: get_args(hint) for name, hint in hints.items() if get_origin(hint) is Literal}


def from_extra(extra: str, module: str, package: str = "") -> Any:
    """Import a module that an extra brings, when it is first needed.

    Parameters
    ----------
    extra : of the package's optional dependencies
    module : to import
    package : that has the module, where its name is another one

    Raises
    ------
    MissingPackage : the extra is not installed
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise MissingPackage(package or module, extra) from None


def check_extra(extra: str, module: str, package: str = "") -> None:
    """Raise `MissingPackage` where a module of an extra is missing; nothing is imported."""
    if find_spec(module) is None:
        raise MissingPackage(package or module, extra)


def one_line(text: str) -> str:
    """Make a text fit for a terminal.

    Control characters become blanks; of a very long text the beginning and the end are left.
    """
    text = CONTROL.sub(" ", text)
    if len(text) <= MAX_CHARACTERS:
        return text
    beginning = text[: MAX_CHARACTERS - END_CHARACTERS]
    left_out = len(text) - MAX_CHARACTERS
    return f"{beginning} ... ({left_out} characters) ... {text[-END_CHARACTERS:]}"


def few(names: Iterable[str], most: int = 6) -> str:
    """List names for a sentence, at most so many of them, and how many more there are."""
    names = tuple(dict.fromkeys(names))
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def whole(value: float) -> str:
    """Write a whole number, or two digits of one below 1, as forces of small animals are."""
    return f"{value:.0f}" if abs(value) >= 1.0 else f"{value:.2g}"


def counted(count: int, noun: str) -> str:
    """Write a number of things: "1 frame", "2 frames"."""
    ending = "es" if noun.endswith("ch") else "s"
    return f"{count} {noun}" + ("" if count == 1 else ending)


def quoted(names: Iterable[str], most: int = MAX_NAMES) -> str:
    """List names in quotes, at most so many, and their number where some are left out."""
    names = tuple(dict.fromkeys(names))
    text = ", ".join(f"'{name}'" for name in names[:most])
    return text + (f", ... ({len(names)} in all)" if len(names) > most else "")


def nearest(name: str, existing: Iterable[str], most: int = MAX_NAMES) -> tuple[str, ...]:
    """Find names that are spelt like another, nearest first.

    Two names are alike by the share of characters that they have in common in the same order
    (`difflib.SequenceMatcher`), or where one is a part of the other. Capitals and what joins words
    (`-`, `_`, a blank) do not count.

    Parameters
    ----------
    name : to compare with
    existing : the names that there are
    most : number of names in the result
    """
    plain = _plain(name)
    if not plain:
        return ()
    matcher = difflib.SequenceMatcher(b=plain, autojunk=False)
    scores: dict[str, float] = {}
    for other in existing:
        spelling = _plain(other)
        matcher.set_seq1(spelling)
        if min(matcher.real_quick_ratio(), matcher.quick_ratio()) >= MIN_RATIO:
            scores[other] = matcher.ratio()
        shorter, longer = sorted((plain, spelling), key=len)
        if len(shorter) >= MIN_PART and shorter in longer:
            scores[other] = max(scores.get(other, 0.0), MIN_RATIO)
    near = [other for other, score in scores.items() if score >= MIN_RATIO]
    return tuple(sorted(near, key=lambda other: -scores[other])[:most])


def listing(name: str, existing: Iterable[str], most: int = MAX_NAMES) -> str:
    """List names that exist: those nearest to `name`, else the first ones.

    Their number follows where some are left out.
    """
    existing = tuple(dict.fromkeys(existing))
    near = nearest(name, existing, most)
    if len(existing) <= most:
        near = (*near, *(other for other in existing if other not in near))
    text = ", ".join(f"'{other}'" for other in near or existing[:most])
    return (text or "none") + (f", ... ({len(existing)} in all)" if len(existing) > most else "")


def unknown(kind: str, name: str, existing: Iterable[str], where: str = "") -> str:
    """Write the line that answers an unknown name: the nearest that exist, and how many do.

    Parameters
    ----------
    kind : of name: marker, body, key, option, file
    name : that is unknown
    existing : the names that there are
    where : what has them; "" says "there are"
    """
    there = f"{where} has" if where else "there are"
    return f"unknown {kind} '{name}': {there} {listing(name, existing)}"


def _plain(name: str) -> str:
    """Spell a name without capitals and without what joins words."""
    return re.sub(r"[-_.\s]+", "", name).casefold()
