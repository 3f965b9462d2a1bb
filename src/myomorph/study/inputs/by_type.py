"""Values of different types, found by their type."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Self, TypeVar

Held = TypeVar("Held")


class ByType:
    """Values of different types, at most one of each, found by their type."""

    def __init__(self, *values: object):
        self._values = {type(value): value for value in values if value is not None}

    def __iter__(self) -> Iterator[Any]:
        return iter(self._values.values())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ByType) and self._values == other._values

    def __hash__(self) -> int:
        return hash(frozenset(self._values))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(map(repr, self))})"

    def get(self, kind: type[Held]) -> Held | None:
        """The value of a type, or None."""
        return self._values.get(kind)  # type: ignore[return-value]

    def __getitem__(self, kind: type[Held]) -> Held:
        """The value of a type; raises `KeyError` where there is none."""
        return self._values[kind]  # type: ignore[return-value]

    def or_default(self, kind: type[Held]) -> Held:
        """The value of a type, one with its defaults where there is none."""
        value = self.get(kind)
        return kind() if value is None else value

    def having(self, *values: object) -> Self:
        """The same with other values; each takes the place of the one of its type."""
        return type(self)(*self._values.values(), *values)

    def without(self, *kinds: type) -> Self:
        """The same without the values of some types."""
        return type(self)(*(value for kind, value in self._values.items() if kind not in kinds))

    def only(self, *kinds: type) -> Self:
        """Those values whose types are named."""
        return type(self)(*(value for kind, value in self._values.items() if kind in kinds))


class OptionSet(ByType):
    """Options of the steps: values of their option dataclasses."""

    def __getitem__(self, kind: type[Held]) -> Held:
        """The options of a kind, its defaults where nothing was said."""
        return self.or_default(kind)
