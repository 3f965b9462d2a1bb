"""From EMG to activation: electromechanical delay, shape, gain and offset of each channel,
synergies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, freeze, frozen_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import index_of
from myomorph.core.model.series import Emg, Series

# Delay where none can be found [s]: 49.5 to 55.5 ms on average in Cavanagh and Komi (1979)
USUAL = 0.05
LIKELIHOOD_95 = 1.92
"""Drop of the log-likelihood that is no chance: half the 95th percentile of chi^2 with one degree
of freedom.
"""


def shifted(emg: Emg, time: Array, delays: Array) -> Array:
    """Envelopes (frames, channels) of `delays` (channels,) seconds before `time`, linearly; NaN
    outside.
    """
    columns = [
        np.interp(time - delay, emg.time, column, left=np.nan, right=np.nan)
        for delay, column in zip(np.broadcast_to(delays, len(emg.names)), emg.values.T, strict=True)
    ]
    return np.array(columns).T.reshape(len(time), len(emg.names))


def independent_samples(first: Array, second: Array) -> float:
    """How many independent samples two series (frames,) are worth for their correlation (Bartlett
    1946): n / (1 + 2 sum_k r1_k r2_k) with the autocorrelations at lags k up to a quarter of the
    series.
    """
    frames = len(first)
    both = []
    for signal in (first, second):
        centered = signal - signal.mean()
        spectrum = np.abs(np.fft.rfft(centered, 2 * frames)) ** 2
        auto = np.fft.irfft(spectrum)[: max(frames // 4, 2)]
        both.append(auto / auto[0] if auto[0] > 0.0 else np.zeros_like(auto))
    spread = 1.0 + 2.0 * float(both[0][1:] @ both[1][1:])
    return float(np.clip(frames / max(spread, 1.0), 3.0, frames))


ChannelMap = Mapping[str, Sequence[str]]
"""EMG channel to the muscles that it records; a muscle may be recorded by several channels."""

STRAIGHT = 1e-6  # Shape factors nearer to zero than this make no difference


def shaped(envelopes: Array, shapes: Array) -> Array:
    """(exp(A e) - 1) / (exp(A) - 1) of envelopes e (frames, channels), e at a shape A of 0 (Lloyd
    and Besier 2003).
    """
    curved = np.abs(shapes) > STRAIGHT
    factors = np.where(curved, shapes, 1.0)
    return np.where(curved, np.expm1(factors * envelopes) / np.expm1(factors), envelopes)


@read_only
class SynergyWeights:
    """Activations of unmeasured muscles, from the synergies of channels: `weights` (muscles,
    synergies) are the activation where the course of a synergy is 1.
    """

    synergies: Synergies
    muscles: tuple[str, ...]
    weights: Array

    def __post_init__(self) -> None:
        freeze(self, weights=(len(self.muscles), len(self.synergies)))


@read_only
class EmgCalibration:
    """What turns envelopes into activations: a(t) = gain * shaped(envelope(t - delay)) + offset,
    see `shaped`; arrays (channels,).

    Delays in s; shape factors, 0 for a straight line; `intervals` (channels, 2), 95 % of the gains,
    NaN where they were not fitted; `by_torque`, whether torques determine the gain, which else is
    the usual one. `weight` (0 for no part) and `others_weight`, of soft targets and of what
    synergies say, were chosen on channels left out; `held_out` (channels, 2) is the correlation of
    such a channel with its muscles without EMG and with that of the others, NaN where not looked
    at.
    """

    channels: tuple[str, ...]
    delays: Array
    gains: Array
    offsets: Array
    warnings: tuple[str, ...] = ()
    shapes: Array = field(default_factory=lambda: np.zeros(1))
    intervals: Array = field(default_factory=lambda: np.full((1, 2), np.nan))
    by_torque: np.ndarray = field(default_factory=lambda: np.zeros(1, dtype=bool))
    synergies: tuple[SynergyWeights, ...] = ()
    weight: float = 10.0
    held_out: Array = field(default_factory=lambda: np.full((1, 2), np.nan))
    others_weight: float = 1.0

    def __post_init__(self) -> None:
        count = len(self.channels)
        freeze(self, delays=(count,), gains=(count,), offsets=(count,))
        for name, shape in (
            ("shapes", (count,)),
            ("intervals", (count, 2)),
            ("held_out", (count, 2)),
        ):
            object.__setattr__(
                self, name, frozen_array(np.broadcast_to(getattr(self, name), shape))
            )
        object.__setattr__(
            self, "by_torque", np.broadcast_to(np.asarray(self.by_torque, dtype=bool), (count,))
        )
        if not (np.all(self.gains >= 0.0) and np.all(self.offsets >= 0.0)):
            raise BadData(
                f"EMG gains {self.gains.tolist()}, offsets {self.offsets.tolist()}: expected 0 or"
                " more"
            )

    def applied(self, emg: Emg, time: Array) -> Series:
        """Activations (frames, channels) at `time`, NaN where the EMG has nothing; raises
        `UnknownName`.
        """
        activations = self.gains * shaped(self._moved(emg, time), self.shapes) + self.offsets
        return Series(time, self.channels, np.clip(activations, 0.0, 1.0))

    def extrapolated(self, emg: Emg, time: Array) -> Series:
        """Activations (frames, muscles) that synergies say of unmeasured muscles; raises
        `UnknownName`.
        """
        moved = self._moved(emg, time)
        names = list[str]()
        columns = [np.zeros((len(time), 0))]
        for synergy in self.synergies:
            chosen = [self.channels.index(name) for name in synergy.synergies.channels]
            courses = synergy.synergies.courses(moved[:, chosen])
            columns.append(np.clip(courses @ synergy.weights.T, 0.0, 1.0))
            names += synergy.muscles
        return Series(time, tuple(names), np.hstack(columns))

    def _moved(self, emg: Emg, time: Array) -> Array:
        values = np.array([emg[name] for name in self.channels]).T.reshape(
            len(emg), len(self.channels)
        )
        return shifted(Emg(emg.time, self.channels, values), time, self.delays)


def uncalibrated(channels: Sequence[str], delay: float, shape: float = 0.0) -> EmgCalibration:
    """Envelopes that are activations already, but for a delay [s] and a shape factor."""
    count = len(channels)
    shapes = np.full(count, shape)
    return EmgCalibration(
        channels=tuple(channels),
        delays=np.full(count, delay),
        gains=np.ones(count),
        offsets=np.zeros(count),
        shapes=shapes,
    )


def channel_means(channels: ChannelMap, muscles: Sequence[str], activations: Array) -> Array:
    """Activations (frames, channels): the mean over each channel's muscles of `activations`
    (frames, muscles).
    """
    chosen = [
        [index_of(f"muscle of EMG channel '{channel}'", name, tuple(muscles)) for name in names]
        for channel, names in channels.items()
    ]
    return np.array([activations[:, muscles].mean(axis=1) for muscles in chosen]).T.reshape(
        len(activations), len(chosen)
    )


EXPLAINED = 0.9
"""Share of the sum of squares of all channels that synergies explain together (Torres-Oviedo et al.
2006: 0.9).
"""
PASSES = 300
TINY = 1e-12


@read_only
class Synergies:
    """Envelopes (frames, channels) as H V with 0 or more in both factors: `vectors` V (synergies,
    channels), each with a largest entry of 1. `scale` is the envelope that counts as 1, so that no
    channel has more say for its gain; `explained` the share of the sum of squares of the scaled
    envelopes.
    """

    channels: tuple[str, ...]
    scale: Array
    vectors: Array
    explained: float

    def __post_init__(self) -> None:
        freeze(self, scale=(len(self.channels),), vectors=(-1, len(self.channels)))

    def __len__(self) -> int:
        return len(self.vectors)

    def courses(self, envelopes: Array) -> Array:
        """H (frames, synergies) of envelopes by non-negative least squares over known channels; NaN
        where none is.
        """
        scaled = envelopes / self.scale
        known = np.isfinite(scaled)
        result = np.full((len(scaled), len(self)), np.nan)
        for frame in np.flatnonzero(known.any(axis=1)):
            use = known[frame]
            result[frame] = scipy.optimize.nnls(
                self.vectors[:, use].T, np.maximum(scaled[frame, use], 0.0)
            )[0]
        return result


def find_synergies(
    channels: tuple[str, ...],
    envelopes: Array,
    scale: Array | None = None,
    explained: float = EXPLAINED,
) -> Synergies:
    """The fewest synergies that explain a share of envelopes (frames, channels), frames with NaN
    left out. Non-negative matrix factorization by multiplicative steps (Lee and Seung 2001), begun
    with the singular vectors (Boutsidis and Gallopoulos 2008), so that the same data always give
    the same synergies.
    """
    values = envelopes[np.isfinite(envelopes).all(axis=1)]
    if not values.size:
        raise BadData(f"synergies of {len(channels)} EMG channels: no frame has all of them known")
    top = (
        np.maximum(np.percentile(values, 99.0, axis=0), TINY)
        if scale is None
        else np.asarray(scale, dtype=float)
    )
    data = np.maximum(values, 0.0) / top
    total = max(float(np.sum(data**2)), TINY)
    count = 0
    share = 0.0
    vectors = np.eye(len(channels))
    while share < explained and count < min(data.shape):
        count += 1
        courses, vectors = _factors(data, count)
        share = 1.0 - float(np.sum((data - courses @ vectors) ** 2)) / total
    largest = np.maximum(vectors.max(axis=1, keepdims=True), TINY)
    return Synergies(channels=channels, scale=top, vectors=vectors / largest, explained=share)


def _factors(data: Array, count: int) -> tuple[Array, Array]:
    """H (frames, count) and V (count, channels) with the least |data - H V|^2 near the start by
    singular vectors.
    """
    left, sizes, right = np.linalg.svd(data, full_matrices=False)
    mean = float(data.mean())
    courses = np.empty((len(data), count))
    vectors = np.empty((count, data.shape[1]))
    for index in range(count):
        u = left[:, index]
        v = right[index]
        parts = [(np.maximum(sign * u, 0.0), np.maximum(sign * v, 0.0)) for sign in (1.0, -1.0)]
        norms = [float(np.linalg.norm(a) * np.linalg.norm(b)) for a, b in parts]
        a, b = parts[int(norms[1] > norms[0])]
        size = np.sqrt(sizes[index] * max(norms))
        courses[:, index] = size * a / max(float(np.linalg.norm(a)), TINY)
        vectors[index] = size * b / max(float(np.linalg.norm(b)), TINY)
    # A step multiplies, so that a zero would stay one.
    courses = np.maximum(courses, 1e-3 * mean)
    vectors = np.maximum(vectors, 1e-3 * mean)
    for _ in range(PASSES):
        vectors *= (courses.T @ data) / np.maximum(courses.T @ courses @ vectors, TINY)
        courses *= (data @ vectors.T) / np.maximum(courses @ (vectors @ vectors.T), TINY)
    return courses, vectors
