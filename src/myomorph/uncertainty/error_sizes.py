"""Sizes of errors that earlier steps of a study found, item by item, and where each size comes from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from myomorph.model.frozen_map import FrozenMap
from myomorph.uncertainty.sources import GROUPS, Sources

USUAL, STATED = "usual", "stated"
"""Where the size of a source comes from that no step found."""


class ItemSize(NamedTuple):
    """The size of a source for one item, in the source's own unit.

    Attributes
    ----------
    source, item : as in `Sources`, and what it is of: a body, a muscle, a point of a path
    size : standard deviation
    shared : items with the same name here err together; "" for each by itself
    """

    source: str
    item: str
    size: float
    shared: str = ""


class SourceSize(NamedTuple):
    """How large a source was taken to be.

    Attributes
    ----------
    size : of all items alike, of found sizes the median
    origin : `USUAL`, `STATED` or the step that found it
    items : of so many there are sizes of their own
    least, greatest : of these
    """

    group: str
    source: str
    size: float
    origin: str
    items: int
    least: float
    greatest: float


@dataclass(frozen=True)
class ErrorSizes:
    """Sizes that steps found, the latest step's where several found one.

    Attributes
    ----------
    items : by source and item
    origins : by source, the step
    """

    items: Mapping[str, Mapping[str, ItemSize]] = field(default_factory=lambda: FrozenMap({}))
    origins: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))

    def of(self, source: str, item: str) -> ItemSize | None:
        """What was found of an item, or None."""
        return self.items.get(source, {}).get(item)

    def with_step(self, step: str, sizes: Iterable[ItemSize]) -> ErrorSizes:
        """The same with what a later step found, which replaces all that earlier ones said of its sources."""
        by_source: dict[str, dict[str, ItemSize]] = {}
        for size in sizes:
            by_source.setdefault(size.source, {})[size.item] = size
        items = {**self.items, **{source: FrozenMap(by_item) for source, by_item in by_source.items()}}
        return ErrorSizes(FrozenMap(items), FrozenMap({**self.origins, **dict.fromkeys(by_source, step)}))

    def beside(self, sources: Sources) -> ErrorSizes:
        """Without sources whose size a user stated: one that is not the usual."""
        kept = [name for name in self.items if _origin(sources, name) == USUAL]
        return ErrorSizes(
            FrozenMap({name: self.items[name] for name in kept}), FrozenMap({name: self.origins[name] for name in kept})
        )


NOTHING = ErrorSizes()


def source_sizes(sources: Sources, error_sizes: ErrorSizes) -> tuple[SourceSize, ...]:
    """Every source with its size and where that comes from; one that is left out has size 0."""
    rows = []
    for group, names in GROUPS.items():
        for name in names:
            sizes = np.array([item.size for item in error_sizes.items.get(name, {}).values()])
            size, origin = float(getattr(sources, name)), _origin(sources, name)
            if len(sizes) and origin == USUAL:
                least, middle, greatest = (float(size) for size in np.quantile(sizes, (0.0, 0.5, 1.0)))
                rows.append(SourceSize(group, name, middle, error_sizes.origins[name], len(sizes), least, greatest))
            else:
                rows.append(SourceSize(group, name, size, origin, 0, size, size))
    return tuple(rows)


def _origin(sources: Sources, name: str) -> str:
    return USUAL if getattr(sources, name) == getattr(Sources(), name) else STATED
