"""Quantities of a result over time as plain columns, one name each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array


class CurveColumns(NamedTuple):
    """A quantity over time.

    Attributes
    ----------
    time : (frames,) [s]
    names : of the columns; those of vectors end in their axis
    values : (frames, names)
    quantity : its name, as in result files
    unit : of the values; "rad or m", where some names turn and others slide
    """

    time: Array
    names: tuple[str, ...]
    values: Array
    quantity: str
    unit: str

    def of(self, names: Sequence[str]) -> CurveColumns:
        """Take some of the columns, which must exist."""
        places = [self.names.index(name) for name in names]
        return self._replace(names=tuple(names), values=self.values[:, places])


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
