"""An input of a trial as one value.

It has its settings, where it is found, and how it is opened and fitted to the model.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol, Self, TypeVar, runtime_checkable

from myomorph.core.model.extension import load
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Source
from myomorph.core.model.series import Trial
from myomorph.lab.store.results import ResultWriter
from myomorph.lab.study.inputs.keys import Key, keys_of

Held = TypeVar("Held")


class ByType:
    """Values of different types, at most one of each, found by their type."""

    def __init__(self, *values: object):
        self._values = {type(value): value for value in values if value is not None}

    @classmethod
    def of(cls, values: Iterable[object]) -> Self:
        """Collect the values that are not None."""
        return cls(*values)

    def __iter__(self) -> Iterator[Any]:
        return iter(self._values.values())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ByType) and self._values == other._values

    def __hash__(self) -> int:
        return hash(frozenset(self._values))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(map(repr, self))})"

    def get(self, kind: type[Held]) -> Held | None:
        """Return the value of a type, or None."""
        return self._values.get(kind)  # type: ignore[return-value]

    def __getitem__(self, kind: type[Held]) -> Held:
        """Return the value of a type; raise `KeyError` where there is none."""
        return self._values[kind]  # type: ignore[return-value]

    def or_default(self, kind: type[Held]) -> Held:
        """Return the value of a type, one with its defaults where there is none."""
        value = self.get(kind)
        return kind() if value is None else value

    def having(self, *values: object) -> Self:
        """Return the same with other values; each takes the place of the one of its type."""
        return type(self)(*self._values.values(), *values)

    def without(self, *kinds: type) -> Self:
        """Return the same without the values of some types."""
        return type(self)(*(value for kind, value in self._values.items() if kind not in kinds))

    def only(self, *kinds: type) -> Self:
        """Those values whose types are named."""
        return type(self)(*(value for kind, value in self._values.items() if kind in kinds))


class OptionSet(ByType):
    """Options of the steps: values of their option dataclasses."""

    def __getitem__(self, kind: type[Held]) -> Held:
        """Return the options of a kind, its defaults where none were specified."""
        return self.or_default(kind)


@dataclass(frozen=True, eq=False)
class Opening:
    """A trial while its inputs are opened.

    Attributes
    ----------
    model_file, model : the file and the model that was read from it
    options : of the steps
    settings : of all inputs
    values : of the inputs that were opened so far, by type
    """

    model_file: Path
    model: Model
    options: OptionSet
    settings: ByType
    values: ByType


@dataclass(frozen=True, eq=False)
class Opened:
    """What an input gives.

    Attributes
    ----------
    values : by whose types steps find them
    sources : what results depend on
    warnings : what is wrong with it, one line each
    real : what was recorded, as a part of a sentence for the first lines of the report: "EMG from
        walk_emg.sto"
    assumed, simulated : sentences for the same place
    options : values that take the place of options of the steps
    """

    values: tuple[object, ...] = ()
    sources: tuple[Source, ...] = ()
    warnings: tuple[Message, ...] = ()
    real: str = ""
    assumed: tuple[str, ...] = ()
    simulated: tuple[str, ...] = ()
    options: tuple[object, ...] = ()


class Beside(NamedTuple):
    """A file that was searched for beside a recording.

    `path`: None where none fits; `remark`: why one that exists does not.
    """

    path: Path | None
    remark: str = ""


@runtime_checkable
class Recorded(Protocol):
    """A value of an input that result files hold, so that a report can be made of them alone."""

    @property
    def facts(self) -> Mapping[str, str]:
        """Texts, by name."""
        return FrozenMap({})

    def put(self, writer: ResultWriter) -> None:
        """Write what is more than texts."""
        return


Open = Callable[[Any, Opening], Opened]


@dataclass(frozen=True, kw_only=True)
class Input:
    """One input of a trial, or a few that belong together.

    docs/adding.md says what its fields are for. Flags of commands, keys of study files and their
    checks, what `analyze` writes, hashes, notes of the report and files of the dry run follow from
    it.

    `open` may be that of `later`; `beside` takes the recording and the trial's keys, `near`, which
    looks further for `analyze`, the recording and what it holds.
    """

    name: str
    settings: type
    open: Open
    main: str = ""
    beside: Callable[[Path, Mapping[str, Any]], Beside] | None = None
    near: Callable[[Path, Trial], Path | None] | None = None
    holds: tuple[str, ...] = ()

    @property
    def keys(self) -> tuple[Key, ...]:
        """Keys of study files and flags of commands."""
        return keys_of(self.settings)


def later(place: str) -> Open:
    """Return the function at `module:name`, which is imported when it is called."""

    def opened(settings: Any, opening: Opening) -> Opened:
        function: Open = load(place)
        return function(settings, opening)

    return opened
