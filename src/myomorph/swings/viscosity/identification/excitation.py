"""Which axes of a joint swings move enough to show what resists motion about them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.swings.sums import (
    noise_of_rates,
    unexplained_accelerations,
)

NOT_SHOWN = Interval(value=float("nan"), low=0.0, high=float("inf"))
"""Viscosity about an axis of which swings tell nothing."""
LEAN = 0.1
"""An axis whose rates are below this share of the fastest axis' is not excited: what leaks over
from an error of a tenth in the other axes' torque is then as large as its own.
"""
MAX_NOISE = 0.02
"""Share of noise in the squares of an axis' rates above which it is not excited: its viscosity is
too small by as much, for noise in a rate counts as motion that nothing resists.
"""


@read_only
class Excitation:
    """How much swings move a joint about each of its axes.

    Attributes
    ----------
    rates : (axes,) root mean square [rad/s]
    noise : (axes,) standard deviation of the noise in them [rad/s]
    """

    rates: Array
    noise: Array

    @classmethod
    def of(cls, recordings: Sequence[SwingRecording]) -> Excitation:
        """Measure it in the recordings of one condition.

        Noise of rates follows from that of accelerations, which the state of a limb on its joint
        does not explain:

            var(w) = 5/3 var(dw/dt) / (2 pi cutoff)^2

        of angles with white noise below the cutoff. Without a low-pass nothing is known of it.

        Parameters
        ----------
        recordings : of one condition
        """
        rates = np.concatenate([each.rates[each.used] for each in recordings])
        noise = np.zeros(rates.shape[1])
        cutoff = recordings[0].cutoff
        if cutoff is not None:
            left = unexplained_accelerations(recordings)
            noise = np.sqrt(noise_of_rates(left**2, cutoff))
        return cls(rates=np.sqrt(np.square(rates).mean(axis=0)), noise=noise)

    @property
    def leans(self) -> np.ndarray:
        """(axes,) whether an axis turns far less than the fastest one."""
        return np.asarray(self.rates < LEAN * self.rates.max())

    @property
    def noise_share(self) -> Array:
        """(axes,) share of noise in the squares of the rates."""
        squares = np.maximum(np.square(self.rates), 1e-300)
        return np.asarray(np.minimum(np.square(self.noise) / squares, 1.0))

    @property
    def shown(self) -> np.ndarray:
        """(axes,) whether rates of an axis are large enough, against others and their noise."""
        return np.asarray(~self.leans & (self.noise_share <= MAX_NOISE))
