"""A mapping that cannot be written, and that travels to other processes; lists gathered by key."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")
Value_co = TypeVar("Value_co", covariant=True)


class FrozenMap(Mapping[Key, Value_co]):
    """A read-only copy of a mapping; unlike `types.MappingProxyType` it can be pickled and copied.

    Parameters
    ----------
    entries : that it holds from now on, in this order

    Examples
    --------
    >>> from myomorph.core.model.frozen_map import FrozenMap
    >>> FrozenMap({"mass": 70.0})["mass"]
    70.0
    """

    __slots__ = ("_entries",)
    _entries: dict[Key, Value_co]

    def __init__(self, entries: Mapping[Key, Value_co]):
        object.__setattr__(self, "_entries", dict(entries))

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"cannot set '{name}' of a read-only mapping")

    def __getitem__(self, key: Key) -> Value_co:
        return self._entries[key]

    def __iter__(self) -> Iterator[Key]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __repr__(self) -> str:
        return f"FrozenMap({self._entries})"

    def __reduce__(self) -> tuple[type[FrozenMap[Key, Value_co]], tuple[dict[Key, Value_co]]]:
        return type(self), (self._entries,)


def grouped(pairs: Iterable[tuple[Key, Value]]) -> dict[Key, list[Value]]:
    """Gather values by their keys, both in the order in which they come first."""
    groups: dict[Key, list[Value]] = {}
    for key, value in pairs:
        groups.setdefault(key, []).append(value)
    return groups
