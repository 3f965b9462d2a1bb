"""Errors that a low-pass filter leaves in a motion and its derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.findings import Span, spans_of
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.labelled import Labelled
from myomorph.core.model.series_quantities import MOTION_ERRORS


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class MotionErrors(Labelled):
    """What is known of the errors of a smoothed motion, by its noise and what the filter takes.

    Errors that a recording does not show, as of the model or of skin that slides as one piece, are
    not in them.

    Attributes
    ----------
    time : (frames,) [s]
    names : of the coordinates
    value_sd, velocity_sd, acceleration_sd : (frames, coordinates) standard deviations [rad or m,
        per s, per s^2]
    uncertain : (frames,) ends, and what stands beside a gap too long to bridge
    """

    quantities = MOTION_ERRORS
    axes: ClassVar[Mapping[str, str]] = FrozenMap({"time": "time", "coordinate": "names"})

    time: Array
    names: tuple[str, ...]
    value_sd: Array
    velocity_sd: Array
    acceleration_sd: Array
    uncertain: np.ndarray

    @property
    def less_sure(self) -> tuple[Span, ...]:
        """First and last time of each stretch that is marked as uncertain [s]."""
        return spans_of(self.time, self.uncertain > 0)

    def at(self, time: Array) -> MotionErrors:
        """Take the frames at some of the times.

        Parameters
        ----------
        time : (n,) among those of the errors, but for rounding [s]

        Returns
        -------
        errors of these frames
        """
        after = np.searchsorted(self.time, time).clip(0, len(self.time) - 1)
        before = np.maximum(after - 1, 0)
        nearer = np.abs(self.time[before] - time) < np.abs(self.time[after] - time)
        frames = np.where(nearer, before, after)
        return MotionErrors(
            time=self.time[frames],
            names=self.names,
            value_sd=self.value_sd[frames],
            velocity_sd=self.velocity_sd[frames],
            acceleration_sd=self.acceleration_sd[frames],
            uncertain=self.uncertain[frames],
        )
