"""A contact law written outside the package.

Friction differs along an axis and across it, as of a skate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import read_only
from myomorph.core.model.contacts import Cone, Generators, tangents


@read_only
@dataclass(frozen=True, eq=False)
class FrictionEllipse(Cone):
    """An elliptic pyramid.

    Friction acts along the first tangent of the direction, `across` times that along the second.
    """

    across: float = 1.0

    takes_preference = False

    def generators(self) -> Generators:
        """d + mu (cos(phi) t_1 + across sin(phi) t_2)."""
        first, second = tangents(self.direction)
        angles = 2.0 * np.pi * np.arange(self.edges)[:, None] / self.edges
        push = self.direction + self.friction * (
            np.cos(angles) * first + self.across * np.sin(angles) * second
        )
        count = len(push)
        return Generators(
            push=push,
            turn=np.zeros((count, 3)),
            lower=np.zeros(count),
            share=np.full(count, float(count)),
        )
