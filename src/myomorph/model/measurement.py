"""A length of the body, measured between markers, and the bodies that it stretches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from myomorph.model.errors import BadData


@dataclass(frozen=True)
class Measurement:
    """Distances between markers of a model and of a person, whose ratio scales bodies.

    Attributes
    ----------
    pairs : the two markers of each distance; the ratios of several are averaged
    bodies : the axes along which each body is stretched: some of "x", "y" and "z"
    """

    name: str
    pairs: tuple[tuple[str, str], ...]
    bodies: Mapping[str, str]

    def __post_init__(self) -> None:
        for body, axes in self.bodies.items():
            if not axes or set(axes) - set("xyz"):
                raise BadData(f"measurement '{self.name}': body '{body}' has axes '{axes}'; expected some of x, y, z")
