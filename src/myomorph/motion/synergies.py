"""Muscle synergies: EMG envelopes as non-negative mixtures of a few courses that many channels share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from myomorph.model.arrays import Array, frozen_array, read_only
from myomorph.model.errors import BadData

EXPLAINED = 0.9
"""Share of the sum of squares of all channels that synergies explain together (Torres-Oviedo et al. 2006: 0.9)."""
PASSES = 300
TINY = 1e-12


@read_only
@dataclass(frozen=True, eq=False)
class Synergies:
    """Envelopes (frames, channels) as H V with 0 or more in both factors: `vectors` V (synergies, channels), each with
    a largest entry of 1. `scale` is the envelope that counts as 1, so that no channel has more say for its gain;
    `explained` the share of the sum of squares of the scaled envelopes.
    """

    channels: tuple[str, ...]
    scale: Array
    vectors: Array
    explained: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "scale", frozen_array(self.scale, (len(self.channels),)))
        object.__setattr__(self, "vectors", frozen_array(self.vectors, (-1, len(self.channels))))

    def __len__(self) -> int:
        return len(self.vectors)

    def courses(self, envelopes: Array) -> Array:
        """H (frames, synergies) of envelopes (frames, channels), by non-negative least squares over the channels that
        are known in a frame; NaN where none is.
        """
        scaled = envelopes / self.scale
        known = np.isfinite(scaled)
        result = np.full((len(scaled), len(self)), np.nan)
        for frame in np.flatnonzero(known.any(axis=1)):
            use = known[frame]
            result[frame] = nnls(self.vectors[:, use].T, np.maximum(scaled[frame, use], 0.0))[0]
        return result


def find_synergies(
    channels: tuple[str, ...], envelopes: Array, scale: Array | None = None, explained: float = EXPLAINED
) -> Synergies:
    """The fewest synergies that explain a share of envelopes (frames, channels), frames with NaN left out.

    Non-negative matrix factorization by multiplicative steps (Lee and Seung 2001), begun with the singular vectors
    (Boutsidis and Gallopoulos 2008), so that the same data always give the same synergies.
    """
    values = envelopes[np.isfinite(envelopes).all(axis=1)]
    if not values.size:
        raise BadData(f"synergies of {len(channels)} EMG channels: no frame has all of them known")
    top = np.maximum(np.percentile(values, 99.0, axis=0), TINY) if scale is None else np.asarray(scale, dtype=float)
    data = np.maximum(values, 0.0) / top
    total = max(float(np.sum(data**2)), TINY)
    count, share, vectors = 0, 0.0, np.eye(len(channels))
    while share < explained and count < min(data.shape):
        count += 1
        courses, vectors = _factors(data, count)
        share = 1.0 - float(np.sum((data - courses @ vectors) ** 2)) / total
    largest = np.maximum(vectors.max(axis=1, keepdims=True), TINY)
    return Synergies(channels, top, vectors / largest, share)


def _factors(data: Array, count: int) -> tuple[Array, Array]:
    """H (frames, count) and V (count, channels) with the least |data - H V|^2 near the start by singular vectors."""
    left, sizes, right = np.linalg.svd(data, full_matrices=False)
    mean = float(data.mean())
    courses, vectors = np.empty((len(data), count)), np.empty((count, data.shape[1]))
    for index in range(count):
        u, v = left[:, index], right[index]
        parts = [(np.maximum(sign * u, 0.0), np.maximum(sign * v, 0.0)) for sign in (1.0, -1.0)]
        norms = [float(np.linalg.norm(a) * np.linalg.norm(b)) for a, b in parts]
        a, b = parts[int(norms[1] > norms[0])]
        size = np.sqrt(sizes[index] * max(norms))
        courses[:, index] = size * a / max(float(np.linalg.norm(a)), TINY)
        vectors[index] = size * b / max(float(np.linalg.norm(b)), TINY)
    # A step multiplies, so that a zero would stay one.
    courses, vectors = np.maximum(courses, 1e-3 * mean), np.maximum(vectors, 1e-3 * mean)
    for _ in range(PASSES):
        vectors *= (courses.T @ data) / np.maximum(courses.T @ courses @ vectors, TINY)
        courses *= (data @ vectors.T) / np.maximum(courses @ (vectors @ vectors.T), TINY)
    return courses, vectors
