"""A point of the problem: motions, and values of every kind of unknowns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from myomorph.core.model.arrays import Array, read_only


@read_only
class Point:
    """A point of the problem.

    Attributes
    ----------
    motions : of each recording (coefficients, free coordinates) of its splines [rad or m]
    values : by kind, whether it is estimated or held: "lengths" (lengths,) factors on the model's,
        "markers" (markers, 3) from the model's positions, stretched [m], "masses" (bodies, 10)
        inertial parameters, ...
    """

    motions: tuple[Array, ...]
    values: Mapping[str, Array]

    def __getitem__(self, kind: str) -> Array:
        return self.values[kind]

    def with_values(self, values: Mapping[str, Array]) -> Point:
        """Replace the values of some kinds.

        Parameters
        ----------
        values : by kind, of the shapes of this point

        Returns
        -------
        the point with them
        """
        return replace(self, values={**self.values, **values})
