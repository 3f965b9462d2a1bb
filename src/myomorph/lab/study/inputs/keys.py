"""Fields of an input's settings as keys of study files and as flags of commands.

A field takes part by its annotation: `emg: Annotated[Path | None, File(per="trial")] = None` is the
key `emg` of a trial's table and the flag `--emg`; its line of the docstring is its help. A field
without such an annotation is set by other steps only.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args, get_type_hints

from myomorph.core.io.labels import read_labels
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.store.named_files import check_time, existing, matching
from myomorph.lab.store.settings import attribute_help


@dataclass
class Notes:
    """What is found while a study file is being read.

    Attributes
    ----------
    problems : all of them make the file be refused
    remarks : what is not used, or not as one might expect
    found : files that were found by the rule of names
    """

    problems: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    found: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Place:
    """A table of a study file.

    Attributes
    ----------
    folder : that its paths are relative to
    where : how problems name it, such as "subject 's01'"
    notes : that problems are added to
    """

    folder: Path
    where: str
    notes: Notes

    def problem(self, key: str, text: str) -> None:
        """Add what is wrong with a key to the problems."""
        self.notes.problems.append(f"{self.where}: {key}: {text}")


@dataclass(frozen=True)
class KeyKind:
    """How a value is written on a command line and in a study file.

    This kind is written as it is: a number, a word, a switch.

    Attributes
    ----------
    per : which table of a study file has the key: that of a subject, for all its trials, that of a
        trial, or both, where the trial's counts
    option_of : step among whose options a study file has the key; in the tables of subjects and
        trials, where it stood in version 0.1, it is read too
    flag, table : its type on the command line and in the table, None for that of the field
    adds : both the values of the subject's table and of the trial's are used
    """

    per: Literal["subject", "trial", "both"] = "both"
    option_of: str = field(default="", kw_only=True)
    flag: ClassVar[Any] = None
    table: ClassVar[Any] = None
    adds: ClassVar[bool] = False

    def parsed(self, key: str, given: Any) -> Any:
        """Read a value from what was written on a command line; raise `BadData`."""
        return given

    def located(self, key: str, given: Any, place: Place) -> Any:
        """Read a value from what stands in a study file, its paths as files.

        What is wrong goes to the place's problems.
        """
        if isinstance(given, Mapping):
            return FrozenMap(
                {
                    name: tuple(part) if isinstance(part, list) else part
                    for name, part in given.items()
                }
            )
        return tuple(given) if isinstance(given, list) else given

    def written(self, value: Any, folder: Path) -> Any:
        """Return a value as a study file in a folder has it."""
        if isinstance(value, Mapping):
            return {
                name: list(part) if isinstance(part, tuple) else part
                for name, part in value.items()
            }
        return list(value) if isinstance(value, tuple) else value

    def files(self, value: Any) -> tuple[Path, ...]:
        """Files that a value names."""
        return ()

    def parts(self, value: Any) -> Iterator[tuple[str, str]]:
        """Names that must be the model's, each with its kind: "body", "marker" or "muscle"."""
        return iter(())


@dataclass(frozen=True)
class File(KeyKind):
    """One file, as `Path | None`."""

    flag: ClassVar[Any] = Path | None
    table: ClassVar[Any] = str | None

    def located(self, key: str, given: Any, place: Place) -> Path | None:
        """Return the file, None where it does not exist."""
        return existing(place.folder, given, f"{place.where}: {key}", place.notes.problems)

    def written(self, value: Path, folder: Path) -> str:
        """Its path as seen from the folder."""
        return relative(value, folder)

    def files(self, value: Path | None) -> tuple[Path, ...]:
        """Return the file."""
        return () if value is None else (value,)


@dataclass(frozen=True)
class Files(KeyKind):
    """Files, as `tuple[Path, ...]`; in a study file names and patterns."""

    flag: ClassVar[Any] = tuple[Path, ...]
    table: ClassVar[Any] = list[str]

    def located(self, key: str, given: Any, place: Place) -> tuple[Path, ...]:
        """Return what the patterns match."""
        where = f"{place.where}: {key}"
        return tuple(
            path
            for name in given
            for path in matching(place.folder, name, where, place.notes.problems)
        )

    def written(self, value: tuple[Path, ...], folder: Path) -> list[str]:
        """Their paths as seen from the folder."""
        return [relative(path, folder) for path in value]

    def files(self, value: tuple[Path, ...]) -> tuple[Path, ...]:
        """Return the files."""
        return value


@dataclass(frozen=True)
class WordOrFile(KeyKind):
    """A word, or a file or folder, as text; "" for none. `words`: that are no files."""

    words: tuple[str, ...] = ("auto",)
    flag: ClassVar[Any] = str
    table: ClassVar[Any] = str

    def located(self, key: str, given: Any, place: Place) -> str:
        """Return the word, or the path of the file."""
        if given in ("", *self.words):
            return str(given)
        if os.path.isdir(place.folder / given):
            return str(place.folder / given)
        path = existing(place.folder, given, f"{place.where}: {key}", place.notes.problems)
        return "" if path is None else str(path)

    def written(self, value: str, folder: Path) -> str:
        """Return the word, or the path as seen from the folder."""
        return value if value in ("", *self.words) else relative(Path(value), folder)

    def files(self, value: str) -> tuple[Path, ...]:
        """Return the file, where it is no word."""
        return () if value in ("", *self.words) else (Path(value),)


@dataclass(frozen=True)
class Span(KeyKind):
    """Start and end [s]."""

    def located(self, key: str, given: Any, place: Place) -> Any:
        """Return the span, checked."""
        check_time(given, f"{place.where}: {key}", place.notes.problems)
        return given


@dataclass(frozen=True)
class Pairs(KeyKind):
    """Names and what belongs to each, as a mapping.

    On the command line they are `NAME=WORD`, in a study file a table.

    Attributes
    ----------
    many : each name has several words, `NAME=WORD,WORD`
    of : kind of the model's parts that the words are
    shown : how the command line specifies one
    """

    many: bool = False
    of: str = ""
    shown: str = "NAME=WORD"
    flag: ClassVar[Any] = tuple[str, ...]

    def parsed(self, key: str, given: Any) -> Mapping[str, Any]:
        """Read the mapping from texts."""
        pairs: dict[str, Any] = {}
        for text in given:
            name, equal, words = text.partition("=")
            several = tuple(word.strip() for word in words.split(",") if word.strip())
            if (
                not equal
                or not several
                or name.strip() in pairs
                or (self.many and not name.strip())
            ):
                raise BadData(f"{flag_of(key)} {text}: expected {self.shown}, each name once")
            pairs[name.strip()] = several if self.many else words.strip()
        return FrozenMap(pairs)

    def parts(self, value: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Yield the words."""
        for words in value.values() if self.of else ():
            yield from ((self.of, word) for word in (words if self.many else (words,)) if word)


@dataclass(frozen=True)
class Names(KeyKind):
    """Names in an order, as `tuple[str, ...]`; on the command line `NAME,NAME`.

    `of`: kind of the model's parts that they are; `nothing`: words that stand for no name.
    """

    of: str = ""
    nothing: tuple[str, ...] = ("", "-", "none")
    flag: ClassVar[Any] = str
    table: ClassVar[Any] = list[str]

    def parsed(self, key: str, given: Any) -> tuple[str, ...]:
        """Return the names, "" for none."""
        return self._named(given.split(",")) if given else ()

    def located(self, key: str, given: Any, place: Place) -> tuple[str, ...]:
        """Return the names, "" for none."""
        return self._named(given)

    def _named(self, texts: list[str]) -> tuple[str, ...]:
        return tuple("" if text.strip().lower() in self.nothing else text.strip() for text in texts)

    def parts(self, value: tuple[str, ...]) -> Iterator[tuple[str, str]]:
        """Yield the names that are none of `nothing`."""
        return ((self.of, name) for name in value if name and self.of)


@dataclass(frozen=True)
class Spans(KeyKind):
    """Names, each with start and end [s], as a mapping; on the command line `NAME=START,END`."""

    flag: ClassVar[Any] = tuple[str, ...]
    table: ClassVar[Any] = dict[str, tuple[float, float]]

    def parsed(self, key: str, given: Any) -> Mapping[str, tuple[float, float]]:
        """Read the mapping from texts."""
        spans: dict[str, tuple[float, float]] = {}
        for text in given:
            name, _, times = text.partition("=")
            try:
                start, end = map(float, times.split(","))
            except ValueError:
                raise BadData(f"{flag_of(key)} {text}: expected NAME=START,END [s]") from None
            spans[name.strip()] = (start, end)
        return FrozenMap(spans)

    def located(self, key: str, given: Any, place: Place) -> Mapping[str, tuple[float, float]]:
        """Return the mapping, each span checked."""
        for name, span in given.items():
            check_time(
                span, f"{place.where}: {key.removesuffix('s')} '{name}'", place.notes.problems
            )
        return FrozenMap(dict(given))


@dataclass(frozen=True)
class LabelMap(KeyKind):
    """Recorded labels and the model's, as a mapping: a file, or a table of a study file."""

    flag: ClassVar[Any] = Path | None
    table: ClassVar[Any] = dict[str, str] | str

    def parsed(self, key: str, given: Any) -> Mapping[str, str]:
        """Read the labels of a file."""
        return FrozenMap({} if given is None else read_labels(given))

    def located(self, key: str, given: Any, place: Place) -> Mapping[str, str]:
        """Read the labels of a table or a file."""
        if not isinstance(given, str):
            return FrozenMap(dict(given))
        path = existing(place.folder, given, f"{place.where}: {key}", place.notes.problems)
        try:
            return FrozenMap({} if path is None else read_labels(path))
        except BadFile as error:
            place.problem(key, str(error))
            return FrozenMap({})

    def parts(self, value: Mapping[str, str]) -> Iterator[tuple[str, str]]:
        """Yield the model's markers."""
        return (("marker", name) for name in value.values() if name)


@dataclass(frozen=True)
class Sentences(KeyKind):
    """Texts for the reader, as `tuple[str, ...]`."""

    table: ClassVar[Any] = list[str]
    adds: ClassVar[bool] = True


@dataclass(frozen=True)
class Key:
    """A field of settings as a key of study files and a flag of commands.

    `type`: of its value; `help`: its line in the docstring of the settings.
    """

    name: str
    kind: KeyKind
    type: Any
    default: Any
    help: str

    @property
    def flag(self) -> Any:
        """Its type on the command line."""
        return self.kind.flag or self.type

    @property
    def table(self) -> Any:
        """Its type in a study file."""
        return self.kind.table or self.type


@cache
def keys_of(settings: type) -> tuple[Key, ...]:
    """Fields of an input's settings that study files and commands take."""
    hints = get_type_hints(settings, include_extras=True)
    helps = attribute_help(settings)
    found = []
    for part in fields(settings):
        kinds = [kind for kind in get_args(hints[part.name])[1:] if isinstance(kind, KeyKind)]
        if kinds:
            default = part.default if part.default_factory is MISSING else part.default_factory()
            type_ = get_args(hints[part.name])[0]
            found.append(
                Key(
                    name=part.name,
                    kind=kinds[0],
                    type=type_,
                    default=default,
                    help=helps.get(part.name, ""),
                )
            )
    return tuple(found)


def flag_of(key: str) -> str:
    """Return a key as a flag."""
    return f"--{key.replace('_', '-')}"


def relative(path: Path, folder: Path) -> str:
    """Return a path as seen from a folder; absolute where they share no drive."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return path.resolve().as_posix()
