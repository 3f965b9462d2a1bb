"""From EMG to activation: electromechanical delay, found by cross-correlation, then gain and offset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import nnls

from myomorph.model.arrays import Array, frozen_array, read_only
from myomorph.model.errors import BadData
from myomorph.model.model import index_of
from myomorph.model.series import Emg, Series

USUAL = 0.05
"""Delay where none can be found [s]: 49.5 to 55.5 ms on average in Cavanagh and Komi (1979)."""

DOUBT = 1.92
"""Drop of the log-likelihood at the ends of a 95 % interval: half the 95th percentile of chi^2 with one degree."""


@dataclass(frozen=True)
class DelayOptions:
    """How the delay is looked for.

    Attributes
    ----------
    least, most : bounds of the delay [s]
    step : between the delays that are tried [s]
    by : one delay for all channels of the subject, or one for each
    correlation : least correlation that makes a delay believed; below it stands `USUAL`
    """

    least: float = 0.010
    most: float = 0.150
    step: float = 0.001
    by: Literal["subject", "channel"] = "subject"
    correlation: float = 0.3

    def __post_init__(self) -> None:
        if not (0.0 <= self.least < self.most and self.step > 0.0):
            raise BadData(f"delays from {self.least:g} to {self.most:g} s by {self.step:g} s: expected a rising range")
        if self.by not in ("subject", "channel"):
            raise BadData(f"unknown delay by '{self.by}': there are 'subject', 'channel'")


@read_only
@dataclass(frozen=True, eq=False)
class Delays:
    """Delay of each channel, and how sure it is.

    Attributes
    ----------
    channels : names
    seconds : (channels,) [s]
    interval : (channels, 2) 95 % interval [s]; the whole range where the delay was not found
    correlation : (channels,) of the envelope with the prediction at that delay, NaN where one of them is flat
    found : (channels,) whether the recording tells the delay: its correlation is believed (else `seconds` is
        `USUAL`), and it lies inside the bounds (else it is the bound)
    """

    channels: tuple[str, ...]
    seconds: Array
    interval: Array
    correlation: Array
    found: np.ndarray

    def __post_init__(self) -> None:
        count = len(self.channels)
        object.__setattr__(self, "seconds", frozen_array(self.seconds, (count,)))
        object.__setattr__(self, "interval", frozen_array(self.interval, (count, 2)))
        object.__setattr__(self, "correlation", frozen_array(self.correlation, (count,)))


def shifted(emg: Emg, time: Array, delays: Array) -> Array:
    """Envelopes (frames, channels) of `delays` (channels,) seconds before `time`, linearly; NaN outside."""
    columns = [
        np.interp(time - delay, emg.time, column, left=np.nan, right=np.nan)
        for delay, column in zip(np.broadcast_to(delays, len(emg.names)), emg.values.T, strict=True)
    ]
    return np.array(columns).T.reshape(len(time), len(emg.names))


def find_delays(recordings: Sequence[tuple[Emg, Series]], options: DelayOptions | None = None) -> Delays:
    """Delays at which envelopes correlate most with what the model predicts of the same muscles.

    With correlation r_c(d) of channel c at delay d, the profile log-likelihood of a straight line with
    unknown gain, offset and noise is  l(d) = -1/2 sum_c n_c log(1 - r_c(d)^2),  where n_c counts
    independent samples (Bartlett 1946) and channels that correlate negatively tell nothing. The interval
    holds the delays whose l is less than `DOUBT` below the best. It knows of noise, not of a prediction
    that is wrong.

    Parameters
    ----------
    recordings : envelopes, and the activation (frames, channels) of each channel's muscles by a solution
        without EMG, at the motion's times; its names are channels of the envelopes, the same in all

    Raises
    ------
    UnknownName
        where the envelopes lack a channel
    BadData
        where a recording's two sides share less than a second, or fewer than 20 frames
    """
    options = options or DelayOptions()
    lags = np.arange(options.least, options.most + 0.5 * options.step, options.step)
    names = recordings[0][1].names
    tables = [_likelihood(emg, predicted, lags) for emg, predicted in recordings]
    told = np.sum([likely for likely, _ in tables], axis=0)
    # Of several recordings the mean correlation by independent samples, where it is known.
    weights = np.array([np.where(np.isfinite(table), sure[:, None], 0.0) for table, sure in (t[1] for t in tables)])
    summed = (weights * np.nan_to_num([t[1][0] for t in tables])).sum(axis=0)
    mean = np.where(weights.sum(axis=0) > 0.0, summed / np.maximum(weights.sum(axis=0), 1e-300), np.nan)
    count = len(names)
    groups = [np.arange(count)] if options.by == "subject" else [np.array([c]) for c in range(count)]
    seconds, interval = np.full(count, USUAL), np.empty((count, 2))
    interval[:] = options.least, options.most
    found = np.zeros(count, dtype=bool)
    for group in groups:
        likely = told[group].sum(axis=0)
        best = int(np.argmax(likely))
        if np.nanmax(np.append(mean[group, best], -1.0)) >= options.correlation:
            near = np.flatnonzero(likely >= likely[best] - DOUBT)
            seconds[group], interval[group] = lags[best], (lags[near[0]], lags[near[-1]])
            found[group] = 0 < best < len(lags) - 1
    chosen = np.abs(lags[None] - seconds[:, None]).argmin(axis=1)
    return Delays(tuple(names), seconds, interval, mean[np.arange(count), chosen], found)


def _likelihood(emg: Emg, predicted: Series, lags: Array) -> tuple[Array, tuple[Array, Array]]:
    """Profile log-likelihood (channels, lags), correlations of that shape and independent samples (channels,)."""
    envelopes = np.array([emg[name] for name in predicted.names])
    inside = (predicted.time - lags[-1] >= emg.time[0]) & (predicted.time - lags[0] <= emg.time[-1])
    time, wanted = predicted.time[inside], predicted.values[inside]
    if len(time) < 20 or time[-1] - time[0] < 1.0:
        raise BadData(
            f"EMG runs from {emg.time[0]:g} to {emg.time[-1]:g} s, the motion from {predicted.time[0]:g} to "
            f"{predicted.time[-1]:g} s: a delay needs a second in common"
        )
    count = len(predicted.names)
    table, sure = np.full((count, len(lags)), np.nan), np.zeros(count)
    for c in range(count):
        moved = np.interp(time[None] - lags[:, None], emg.time, envelopes[c], left=np.nan, right=np.nan)
        use = np.isfinite(wanted[:, c]) & np.isfinite(moved).all(axis=0)
        if use.sum() >= 20:
            table[c] = _correlations(moved[:, use], wanted[use, c])
            sure[c] = independent_samples(moved[len(lags) // 2, use], wanted[use, c])
    told = -0.5 * sure[:, None] * np.log1p(-(np.clip(np.nan_to_num(table), 0.0, 0.999999) ** 2))
    return told, (table, sure)


def independent_samples(first: Array, second: Array) -> float:
    """How many independent samples two series (frames,) are worth for their correlation (Bartlett 1946).

    n / (1 + 2 sum_k r1_k r2_k) with the autocorrelations at lags k up to a quarter of the series.
    """
    frames = len(first)
    both = []
    for one in (first, second):
        centered = one - one.mean()
        spectrum = np.abs(np.fft.rfft(centered, 2 * frames)) ** 2
        auto = np.fft.irfft(spectrum)[: max(frames // 4, 2)]
        both.append(auto / auto[0] if auto[0] > 0.0 else np.zeros_like(auto))
    spread = 1.0 + 2.0 * float(both[0][1:] @ both[1][1:])
    return float(np.clip(frames / max(spread, 1.0), 3.0, frames))


def _correlations(rows: Array, wanted: Array) -> Array:
    """Pearson's correlation (rows,) of each row with `wanted`, NaN where one of them is flat."""
    centered, other = rows - rows.mean(axis=1, keepdims=True), wanted - wanted.mean()
    sizes, size = np.linalg.norm(centered, axis=1), float(np.linalg.norm(other))
    flat = (sizes <= 1e-9 * np.linalg.norm(rows, axis=1)) | (size <= 1e-9 * np.linalg.norm(wanted))
    return np.where(flat, np.nan, (centered @ other) / np.where(flat, 1.0, sizes * size))


ChannelMap = Mapping[str, Sequence[str]]
"""EMG channel to the muscles it tells of; muscles may be told of by several channels."""


@read_only
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
