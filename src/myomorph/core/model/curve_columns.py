"""Quantities of a result over time as plain columns, one name each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.units import MotionKind, unit_by_motion


class CurveColumns(NamedTuple):
    """A quantity over time.

    Attributes
    ----------
    time : (frames,) [s]
    names : of the columns; those of vectors end in their axis
    values : (frames, names)
    quantity : its name, as in result files
    units : one per column; "rad or m" where it is not known whether a coordinate turns or slides
    vectors : whether the names end in an axis
    """

    time: Array
    names: tuple[str, ...]
    values: Array
    quantity: str
    units: tuple[str, ...]
    vectors: bool = False

    def of(self, names: Sequence[str]) -> CurveColumns:
        """Take some of the columns, which must exist."""
        places = [self.names.index(name) for name in names]
        units = tuple(self.units[place] for place in places)
        return self._replace(names=tuple(names), values=self.values[:, places], units=units)


def column_units(
    unit: str, names: Sequence[str], motion_kinds: Mapping[str, MotionKind] | None
) -> tuple[str, ...]:
    """Return the unit of each column, by how the coordinates of these names move.

    Parameters
    ----------
    unit : of the quantity: "N m or N" is N m of rotations and N of translations
    names : of the columns
    motion_kinds : by name; of other names the unit stays as it is
    """
    kinds = motion_kinds or {}
    return tuple(unit_by_motion(unit, kinds[name]) if name in kinds else unit for name in names)


def flattened(
    values: np.ndarray, dimensions: Sequence[str], labels: Mapping[str, Any]
) -> tuple[tuple[str, ...], Array]:
    """Flatten all axes but that of the times into columns.

    Parameters
    ----------
    values : (frames, ...)
    dimensions : a name for each axis
    labels : by dimension

    Returns
    -------
    names of the columns, and (frames, names)
    """
    words = [[str(label) for label in labels[dimension]] for dimension in dimensions[1:]]
    names = [""]
    for axis in words:
        names = [f"{name}_{label}" if name else label for name in names for label in axis]
    array = np.asarray(values, dtype=np.float64)
    return tuple(names), array.reshape(len(array), len(names))
