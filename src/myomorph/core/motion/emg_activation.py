"""From EMG to activation: delay, shape, gain and offset of each channel, synergies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field

import numpy as np
import scipy

from myomorph.core.fit.estimation import Estimate
from myomorph.core.model.arrays import Array, freeze, frozen_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message
from myomorph.core.model.model import index_of
from myomorph.core.model.series import Emg, Series

# Delay where none can be found [s]: 49.5 to 55.5 ms on average in Cavanagh and Komi (1979)
USUAL = 0.05
LIKELIHOOD_95 = 1.92
"""Drop of the log-likelihood that is no chance: half the 95th percentile of chi^2 with one degree
of freedom.
"""


def shifted(emg: Emg, time: Array, delays: Array) -> Array:
    """Delay envelopes, linearly between samples.

    Parameters
    ----------
    emg : envelopes (samples, channels)
    time : (frames,) [s]
    delays : (channels,) or one for all [s]

    Returns
    -------
    (frames, channels) envelopes at `time` less the delays, NaN outside of the EMG
    """
    columns = [
        np.interp(time - delay, emg.time, column, left=np.nan, right=np.nan)
        for delay, column in zip(np.broadcast_to(delays, len(emg.names)), emg.values.T, strict=True)
    ]
    return np.array(columns).T.reshape(len(time), len(emg.names))


def independent_samples(first: Array, second: Array) -> float:
    """Count the independent samples that two series are worth for their correlation.

        n / (1 + 2 sum_k r1_k r2_k)

    with the autocorrelations r1 and r2 at lags k up to a quarter of the series.

    Source: Bartlett 1946.

    Parameters
    ----------
    first, second : (frames,)

    Returns
    -------
    from 3 to the number of frames
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
    """Bend envelopes by a shape factor.

        (exp(A e) - 1) / (exp(A) - 1)

    and e itself at a shape A of 0.

    Source: Lloyd and Besier 2003.

    Parameters
    ----------
    envelopes : (frames, channels) e, 1 at the maximum [-]
    shapes : (channels,) A [-]

    Returns
    -------
    (frames, channels) [-]
    """
    curved = np.abs(shapes) > STRAIGHT
    factors = np.where(curved, shapes, 1.0)
    return np.where(curved, np.expm1(factors * envelopes) / np.expm1(factors), envelopes)


@read_only
class SynergyWeights:
    """Activations of unmeasured muscles, from the synergies of channels.

    Attributes
    ----------
    synergies : of the measured channels
    muscles : without EMG
    weights : (muscles, synergies) activation where the course of a synergy is 1 [-]
    """

    synergies: Synergies
    muscles: tuple[str, ...]
    weights: Array

    def __post_init__(self) -> None:
        freeze(self, weights=(len(self.muscles), len(self.synergies)))


@read_only
class EmgCalibration:
    """Parameters that turn envelopes into activations.

        a(t) = gain * shaped(envelope(t - delay)) + offset

    Attributes
    ----------
    channels : names
    delays : (channels,) [s]
    gains : (channels,) 0 or more [-]
    offsets : (channels,) 0 or more [-]
    warnings : what looks wrong, one line each
    shapes : (channels,) factors of `shaped`, 0 for a straight line
    intervals : (channels, 2) 95 % of the gains, NaN where they were not fitted
    by_torque : (channels,) whether torques determine the gain, which else is the usual one
    synergies : for muscles without EMG
    weight : of soft targets, 0 for no part, chosen on channels left out
    held_out : (channels, 2) correlation of a channel left out with its muscles without EMG, and
        with that of the others; NaN where not computed
    others_weight : of what synergies predict, chosen on channels left out
    estimate : of the gains' logarithms, with what certifies it; None where torques had no part, or
        gains were read from a file
    """

    channels: tuple[str, ...]
    delays: Array
    gains: Array
    offsets: Array
    warnings: tuple[Message, ...] = ()
    shapes: Array = field(default_factory=lambda: np.zeros(1))
    intervals: Array = field(default_factory=lambda: np.full((1, 2), np.nan))
    by_torque: np.ndarray = field(default_factory=lambda: np.zeros(1, dtype=bool))
    synergies: tuple[SynergyWeights, ...] = ()
    weight: float = 10.0
    held_out: Array = field(default_factory=lambda: np.full((1, 2), np.nan))
    others_weight: float = 1.0
    estimate: Estimate | None = None

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
        """Compute activations of the channels.

        Parameters
        ----------
        emg : envelopes (samples, channels)
        time : (frames,) [s]

        Returns
        -------
        (frames, channels) from 0 to 1, NaN where the EMG has no value

        Raises
        ------
        UnknownName : a channel is missing from the EMG
        """
        activations = self.gains * shaped(self._moved(emg, time), self.shapes) + self.offsets
        return Series(time, self.channels, np.clip(activations, 0.0, 1.0))

    def extrapolated(self, emg: Emg, time: Array) -> Series:
        """Predict activations of unmeasured muscles by synergies.

        Parameters
        ----------
        emg : envelopes (samples, channels)
        time : (frames,) [s]

        Returns
        -------
        (frames, muscles) from 0 to 1, NaN where the EMG has no value

        Raises
        ------
        UnknownName : a channel is missing from the EMG
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
        """Delay envelopes of this calibration's channels: (frames, channels)."""
        values = np.array([emg[name] for name in self.channels]).T.reshape(
            len(emg), len(self.channels)
        )
        return shifted(Emg(emg.time, self.channels, values), time, self.delays)


def uncalibrated(channels: Sequence[str], delay: float, shape: float = 0.0) -> EmgCalibration:
    """Calibrate envelopes that are activations already, but for a delay and a shape factor.

    Parameters
    ----------
    channels : names
    delay : of all channels [s]
    shape : factor of all channels, see `shaped` [-]

    Returns
    -------
    gains of 1 and offsets of 0
    """
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
    """Average activations over the muscles of each channel.

    Parameters
    ----------
    channels : muscles of each channel
    muscles : names of the columns
    activations : (frames, muscles) [-]

    Returns
    -------
    (frames, channels) [-]

    Raises
    ------
    UnknownName : a channel's muscle is not among the muscles
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
    """Envelopes (frames, channels) as a product H V of factors that are 0 or more.

    Attributes
    ----------
    channels : names
    scale : (channels,) envelope that counts as 1, so that no channel weighs more for its gain
    vectors : V (synergies, channels), each with a largest entry of 1
    explained : share of the sum of squares of the scaled envelopes [-]
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
        """Solve the courses H of envelopes by non-negative least squares over known channels.

            min |e / scale - h V|^2,   h >= 0

        in each frame.

        Parameters
        ----------
        envelopes : (frames, channels), NaN where unknown

        Returns
        -------
        (frames, synergies), NaN where no channel is known
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
    """Find the fewest synergies that explain a share of envelopes.

    Non-negative matrix factorization by multiplicative steps, begun with the singular vectors, so
    that the same data always give the same synergies.

    Source: Lee and Seung 2001; Boutsidis and Gallopoulos 2008 (start).

    Parameters
    ----------
    channels : names
    envelopes : (frames, channels); frames with NaN are left out
    scale : (channels,) envelope that counts as 1; None takes each channel's 99th percentile
    explained : share of the sum of squares [-]

    Returns
    -------
    the synergies

    Raises
    ------
    BadData : no frame has all channels known
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
    """Factorize data into two factors that are 0 or more.

        min |data - H V|^2,   V <- V (H^T data) / (H^T H V),   H <- H (data V^T) / (H V V^T)

    near the start by singular vectors.

    Parameters
    ----------
    data : (frames, channels), 0 or more
    count : number of synergies

    Returns
    -------
    H (frames, count) and V (count, channels)
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
