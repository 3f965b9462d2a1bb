"""What a C3D file holds before it is given a meaning: parameters, points and analog samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array

Value = tuple[str, ...] | Array


@dataclass(frozen=True, eq=False)
class RawC3d:
    """Parameters and samples of a C3D file, scaled, in the file's units.

    Attributes
    ----------
    groups : group to parameter to value: texts, or numbers of the file's shape (first index fastest)
    first_frame : number of the first frame, counted from 1
    point_rate, analog_rate : samples per second [Hz]
    points : (frames, points, 3), NaN where the file calls them invalid
    residuals : (frames, points), negative where invalid
    analog : (samples, channels), offset and scale applied
    events : (label, time [s]) of the header's own list
    reader : which reader it was
    remarks : what that reader had to mend or leave out
    """

    groups: Mapping[str, Mapping[str, Value]]
    first_frame: int
    point_rate: float
    analog_rate: float
    points: Array
    residuals: Array
    analog: Array
    events: tuple[tuple[str, float], ...] = ()
    reader: str = ""
    remarks: tuple[str, ...] = ()

    def texts(self, group: str, name: str) -> tuple[str, ...]:
        """Texts of a parameter and of its continuations (`LABELS`, `LABELS2`, ...), () if absent."""
        found: list[str] = []
        for number in ("", *range(2, 40)):
            value = self.groups.get(group, {}).get(f"{name}{number}")
            if value is None:
                break
            found += value if isinstance(value, tuple) else ()
        return tuple(text.partition("\0")[0].strip() for text in found)

    def numbers(self, group: str, name: str) -> Array:
        """Numbers of a parameter, flat in the file's order, and of its continuations; empty if absent."""
        found: list[Array] = []
        for number in ("", *range(2, 40)):
            value = self.groups.get(group, {}).get(f"{name}{number}")
            if value is None or isinstance(value, tuple):
                break
            found.append(np.asarray(value, dtype=np.float64).ravel(order="F"))
        return np.concatenate(found) if found else np.zeros(0)

    def shape(self, group: str, name: str) -> tuple[int, ...]:
        """Shape of a parameter's value, () if absent or text."""
        value = self.groups.get(group, {}).get(name)
        return () if value is None or isinstance(value, tuple) else np.shape(value)
