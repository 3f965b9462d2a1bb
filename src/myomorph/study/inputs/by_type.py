"""Values of different types, found by their type."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeVar

Held = TypeVar("Held")


class ByType:
    """Values of different types, at most one of each, found by their type."""

    def __init__(self, *values: object):
        self._values = {type(value): value for value in values if value is not None}

    def __iter__(self) -> Iterator[Any]:
        return iter(self._values.values())

    def get(self, kind: type[Held]) -> Held | None:
        """The value of a type, or None."""
        return self._values.get(kind)  # type: ignore[return-value]

    def __getitem__(self, kind: type[Held]) -> Held:
        """The value of a type; raises `KeyError` where there is none."""
        return self._values[kind]  # type: ignore[return-value]

    def having(self, *values: object) -> Any:
        """The same with other values; each takes the place of the one of its type."""
        return type(self)(*self._values.values(), *values)

    def only(self, *kinds: type) -> Any:
        """Those values whose types are named."""
        return type(self)(*(value for kind, value in self._values.items() if kind in kinds))


class OptionSet(ByType):
    """Options of the steps: values of their option dataclasses."""

    def __getitem__(self, kind: type[Held]) -> Held:
        """The options of a kind, its defaults where nothing was said."""
        found = self.get(kind)
        return kind() if found is None else found
