"""How far off a morphed model may be, as sizes of errors for intervals of results."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from myomorph.bones.morph.morphed import Morph
from myomorph.lab.uncertainty.sources import ItemSize

IN_SPACE = 2.5003
"""Standard deviations of each axis within which 90 % of points of an isotropic normal distribution
lie.
"""


def morphed_errors(morph: Morph) -> Iterator[ItemSize]:
    """Points of muscles: a distance within which 90 % lie, as a standard deviation of each axis."""
    for point in morph.points:
        if np.isfinite(point.within) and point.within > 0.0:
            yield ItemSize("attachment", f"{point.owner}/{point.name}", point.within / IN_SPACE)
