"""A recording as the fit reads it: what no parameter changes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from myomorph.body.personalize.recordings import Windows
from myomorph.core.model.arrays import Array

MEAN_ACTIVATION = 0.1
"""Expected of a muscle without EMG, a parameter itself; walking has root mean squares of 0.1 to
0.25.
"""
FIRST_ACTIVATION = 0.05  # Of a muscle without EMG, with which the fit begins


@dataclass(frozen=True, eq=False)
class Recorded:
    """One recording, in the frames that count.

    Attributes
    ----------
    windows : the recording
    """

    windows: Windows

    @property
    def name(self) -> str:
        """Of the recording."""
        return self.windows.name

    @property
    def at_rest(self) -> bool:
        """Whether muscles were at rest and every frame held still."""
        return self.windows.at_rest

    def counted(self, values: Array) -> Array:
        """Select the frames that count.

        Parameters
        ----------
        values : (windows, frames, ...)

        Returns
        -------
        (frames, ...)
        """
        return values[self.windows.counted]

    @cached_property
    def measured(self) -> np.ndarray:
        """(frames, muscles) whether EMG is known."""
        return np.isfinite(self.counted(self.windows.emg))

    @cached_property
    def envelope(self) -> Array:
        """(frames, muscles) EMG, or the mean activation that is expected without it."""
        emg = self.counted(self.windows.emg)
        return np.where(self.measured, emg, MEAN_ACTIVATION)

    @cached_property
    def known(self) -> np.ndarray:
        """(frames, rows) whether a torque was measured.

        Rows without a torque have no muscles, no misfit and an error of 1.
        """
        return np.isfinite(self.counted(self.windows.torques))

    @cached_property
    def torques(self) -> Array:
        """(frames, rows) that muscles have to give, 0 where not measured [N m or N]."""
        return np.where(self.known, self.counted(self.windows.torques), 0.0)

    @cached_property
    def arms(self) -> Array:
        """(frames, rows, muscles) moment arms, 0 where no torque was measured [m/rad or m/m]."""
        return np.where(self.known[..., None], self.counted(self.windows.arms), 0.0)

    def first_activations(self) -> Array:
        """Return the activations with which the fit begins.

        Returns
        -------
        (windows, frames, muscles)
        """
        emg = self.windows.emg
        return np.clip(np.where(np.isfinite(emg), emg, FIRST_ACTIVATION), 0.0, 1.0)
