"""Axes of gait curves: the same on every page, with the words of their directions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil, floor

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap

SLACK = 0.02
"""Share of an axis by which a curve may leave it."""


@dataclass(frozen=True, kw_only=True)
class GaitAxis:
    """The upright axis of a chart.

    Attributes
    ----------
    low, high : ends, in the unit of the curve
    step : by which an end moves where a curve leaves the axis
    up, down : words of the directions, "" for none
    longer : whether an end has moved
    """

    low: float
    high: float
    step: float
    up: str = ""
    down: str = ""
    longer: bool = False

    def holding(self, values: Array) -> GaitAxis:
        """Return the axis, longer by whole steps where values leave it.

        Parameters
        ----------
        values : of any shape, NaN where not known

        Returns
        -------
        an axis that holds all of them
        """
        known = values[np.isfinite(values)]
        if not len(known):
            return self
        # A line that leaves the axis by less is drawn at its end.
        air = SLACK * (self.high - self.low)
        least = float(known.min())
        most = float(known.max())
        low = self.low if least >= self.low - air else self.step * floor(least / self.step)
        high = self.high if most <= self.high + air else self.step * ceil(most / self.step)
        return replace(self, low=low, high=high, longer=low < self.low or high > self.high)


EMG_AXIS = GaitAxis(low=0.0, high=150.0, step=50.0)
AXES: Mapping[str, GaitAxis] = FrozenMap(
    {
        "pelvic_tilt": GaitAxis(low=-30, high=30, step=10, up="anterior", down="posterior"),
        "pelvic_obliquity": GaitAxis(low=-20, high=20, step=10, up="up", down="down"),
        "pelvic_rotation": GaitAxis(low=-30, high=30, step=10, up="forward", down="backward"),
        "hip_flexion": GaitAxis(low=-30, high=60, step=10, up="flexion", down="extension"),
        "hip_adduction": GaitAxis(low=-20, high=20, step=10, up="adduction", down="abduction"),
        "hip_rotation": GaitAxis(low=-30, high=30, step=10, up="internal", down="external"),
        "knee_flexion": GaitAxis(low=-20, high=80, step=10, up="flexion", down="extension"),
        "ankle_dorsiflexion": GaitAxis(
            low=-40, high=30, step=10, up="dorsiflexion", down="plantarflexion"
        ),
        "foot_progression": GaitAxis(low=-30, high=30, step=10, up="internal", down="external"),
        "hip_moment": GaitAxis(low=-1.5, high=1.5, step=0.5, up="extension", down="flexion"),
        "knee_moment": GaitAxis(low=-1.0, high=1.5, step=0.5, up="extension", down="flexion"),
        "ankle_moment": GaitAxis(
            low=-0.5, high=2.0, step=0.5, up="plantarflexion", down="dorsiflexion"
        ),
        "hip_power": GaitAxis(low=-2.0, high=2.0, step=1.0, up="generation", down="absorption"),
        "knee_power": GaitAxis(low=-3.0, high=2.0, step=1.0, up="generation", down="absorption"),
        "ankle_power": GaitAxis(low=-2.0, high=5.0, step=1.0, up="generation", down="absorption"),
        "hip_abduction_moment": GaitAxis(
            low=-0.5, high=1.5, step=0.5, up="abduction", down="adduction"
        ),
        "vertical_force": GaitAxis(low=0.0, high=1.5, step=0.5),
    }
)
"""By variable of gait curves, in its unit."""
