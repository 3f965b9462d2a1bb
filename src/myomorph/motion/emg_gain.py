"""From envelopes to activations: one gain and offset a channel, never negative."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.errors import BadData
from myomorph.model.model import index_of
from myomorph.model.series import Emg, Series
from myomorph.motion.emg_delay import shifted

ChannelMap = Mapping[str, Sequence[str]]
"""EMG channel to the muscles it tells of; muscles may be told of by several channels."""


@dataclass(frozen=True, eq=False)
class EmgCalibration:
    """What turns envelopes into activations: a(t) = gain * envelope(t - delay) + offset.

    Attributes
    ----------
    channels : names
    delays : (channels,) [s]
    gains : (channels,) activation at an envelope of 1, 0 or more
    offsets : (channels,) activation at rest, 0 or more
    warnings : one line each
    """

    channels: tuple[str, ...]
    delays: Array
    gains: Array
    offsets: Array
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("delays", "gains", "offsets"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (len(self.channels),)))
        if not (np.all(self.gains >= 0.0) and np.all(self.offsets >= 0.0)):
            raise BadData(f"EMG gains {self.gains.tolist()}, offsets {self.offsets.tolist()}: expected 0 or more")

    def applied(self, emg: Emg, time: Array) -> Series:
        """Activations (frames, channels) at `time`, NaN where the EMG tells nothing; raises `UnknownName`."""
        values = np.array([emg[name] for name in self.channels]).T.reshape(len(emg), len(self.channels))
        moved = shifted(Emg(emg.time, self.channels, values), time, self.delays)
        return Series(time, self.channels, np.clip(self.gains * moved + self.offsets, 0.0, 1.0))


def uncalibrated(channels: Sequence[str], delay: float) -> EmgCalibration:
    """Envelopes that are activations already, but for a delay [s]."""
    count = len(channels)
    return EmgCalibration(tuple(channels), np.full(count, delay), np.ones(count), np.zeros(count))


def fit_gains(envelopes: Array, activations: Array, offsets: bool = False) -> tuple[Array, Array]:
    """Gains and offsets (channels,) that bring envelopes nearest to activations, both (frames, channels).

    Non-negative least squares for each channel over the frames where both are known; a channel that is
    never known gets gain 1.
    """
    count = envelopes.shape[1]
    gains, rests = np.ones(count), np.zeros(count)
    for c in range(count):
        use = np.isfinite(envelopes[:, c]) & np.isfinite(activations[:, c])
        if use.any():
            columns = [envelopes[use, c], np.ones(int(use.sum()))][: 2 if offsets else 1]
            (gains[c], *rest), _ = nnls(np.array(columns).T, activations[use, c])
            rests[c] = rest[0] if rest else 0.0
    return gains, rests


def channel_means(channels: ChannelMap, muscles: Sequence[str], activations: Array) -> Array:
    """Activations (frames, channels): the mean over each channel's muscles of `activations` (frames, muscles).

    Raises
    ------
    UnknownName
        where a channel names a muscle that is not there
    """
    chosen = [
        [index_of(f"muscle of EMG channel '{channel}'", name, tuple(muscles)) for name in names]
        for channel, names in channels.items()
    ]
    return np.array([activations[:, one].mean(axis=1) for one in chosen]).T.reshape(len(activations), len(chosen))
