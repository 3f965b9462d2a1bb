"""A result that is held in memory as a file would be: what is quickly computed need not go through the disk."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from myomorph.store.netcdf import NetcdfVariable


@dataclass(eq=False)
class HeldVariable:
    """Values with what is told of them, used like a data set of a file."""

    values: Any
    dimensions: tuple[str, ...]
    attrs: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, part: Any) -> Any:
        return self.values[part]

    def __setitem__(self, part: Any, values: Any) -> None:
        self.values[part] = values


class HeldFile:
    """Takes dimensions, variables and attributes as `NetcdfFile` does, and gives them as `NetcdfSource` does."""

    def __init__(self) -> None:
        self.dimensions: dict[str, int] = {}
        self.attributes: dict[str, str] = {}
        self._variables: dict[str, HeldVariable] = {}

    def __contains__(self, name: str) -> bool:
        return name in self._variables

    def variable(
        self,
        name: str,
        dimensions: tuple[str, ...],
        kind: Any,
        values: Any = None,
        chunks: tuple[int, ...] | None = None,
    ) -> HeldVariable:
        """Make a variable; its values may also come later, part by part. Chunks are for the disk."""
        kind = np.dtype(kind)
        if values is None:
            shape = tuple(self.dimensions[one] for one in dimensions)
            values = np.full(shape, np.nan if kind.kind == "f" else 0, kind)
        else:
            # A copy, since whoever gave them may go on to use them.
            values = np.array(values, kind)
        self._variables[name] = HeldVariable(values, dimensions)
        return self._variables[name]

    @staticmethod
    def tell(variable: HeldVariable, told: Mapping[str, Any]) -> None:
        """Write attributes of a variable."""
        variable.attrs.update(told)

    def data(self, only: Sequence[str] = ()) -> Iterator[tuple[str, Any]]:
        """Name and values of every variable, or `only` of some, in the order in which they were made."""
        for name in [one for one in only if one in self] if only else self._variables:
            yield name, self._variables[name].values

    def variables(self) -> Iterator[NetcdfVariable]:
        """The same with all that is told of them."""
        for name, one in self._variables.items():
            # In the order in which a file gives them.
            told = dict(sorted(one.attrs.items()))
            yield NetcdfVariable(name, one.values, told, one.dimensions, False)

    @staticmethod
    def dimensions_of(variable: NetcdfVariable) -> tuple[str, ...]:
        """Names of a variable's dimensions."""
        return variable.references
