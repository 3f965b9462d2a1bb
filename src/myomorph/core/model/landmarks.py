"""Named points of a bone, and the same points of another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData


@read_only
class LandmarkPairs:
    """Landmarks of one body and the same of another's bone.

    `FeaturePoints(names, source, target)` makes maps of them.

    Attributes
    ----------
    names : of the landmarks, none twice
    source : (n, 3) in the source body's frame [m]
    target : (n, 3) in the frame of the target's bone [m]

    Raises
    ------
    BadData : a name is there twice, or points are missing or not finite
    """

    names: tuple[str, ...]
    source: Array
    target: Array

    def __post_init__(self) -> None:
        count = len(self.names)
        if len(set(self.names)) < count:
            twice = next(name for name in self.names if self.names.count(name) > 1)
            raise BadData(f"landmark '{twice}' is specified twice")
        for field in ("source", "target"):
            array = frozen_array(getattr(self, field), (-1, 3))
            if len(array) != count or not np.isfinite(array).all():
                raise BadData(
                    f"{count} landmarks are named: expected as many finite points as {field}"
                )
            object.__setattr__(self, field, array)

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True)
class Measurement:
    """Distances between markers of a model and of a person, whose ratio scales bodies.

    Attributes
    ----------
    name : of the measurement
    pairs : the two markers of each distance; the ratios of several are averaged
    bodies : axes along which each body is stretched, some of "x", "y" and "z", by body
    """

    name: str
    pairs: tuple[tuple[str, str], ...]
    bodies: Mapping[str, str]

    def __post_init__(self) -> None:
        for body, axes in self.bodies.items():
            if not axes or set(axes) - set("xyz"):
                raise BadData(
                    f"measurement '{self.name}': body '{body}' has axes '{axes}'; expected some of"
                    " x, y, z"
                )
