"""EMG channels whose names are exchanged: each follows what the other's muscles have to do, and not its own."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from myomorph.model.arrays import Array

CLEARER = 0.2
"""By how much the correlation of both channels has to rise. In three walks without a fault no pair rises at all."""
FOLLOWS = 0.3
"""Correlation from which on a channel follows muscles."""
SHORTEST = 30
"""Frames that are needed."""


class Swap(NamedTuple):
    """Two channels (their columns) and the mean correlation of both with their own muscles and with the other's."""

    first: int
    second: int
    own: float
    other: float


def swapped_channels(envelopes: Array, activations: Array) -> tuple[Swap, ...]:
    """Pairs of channels that look exchanged, the clearest first; no channel is in two pairs.

    Both channels must follow the other's muscles better than their own. Muscles that work at the same time
    (gastrocnemius and soleus, vasti and gluteus medius in walking) cannot be told apart so.

    `envelopes` (frames, channels) at the delay of EMG, NaN where unknown; `activations` (frames, channels) means of
    each channel's muscles, found without EMG from joint torques.
    """
    use = np.isfinite(envelopes).all(axis=1) & np.isfinite(activations).all(axis=1)
    count = envelopes.shape[1]
    if use.sum() < SHORTEST:
        return ()
    both = np.hstack([envelopes[use], activations[use]])
    both = both - both.mean(axis=0)
    size = np.linalg.norm(both, axis=0)
    both = both / np.where(size > 0.0, size, np.inf)
    result = both[:, :count].T @ both[:, count:]
    pairs = []
    for i, j in itertools.combinations(range(count), 2):
        rise = min(result[i, j] - result[i, i], result[j, i] - result[j, j])
        if rise > CLEARER and min(result[i, j], result[j, i]) > FOLLOWS:
            direct, other = 0.5 * (result[i, i] + result[j, j]), 0.5 * (result[i, j] + result[j, i])
            pairs.append((float(rise), Swap(i, j, float(direct), float(other))))
    chosen: list[Swap] = []
    for _, pair in sorted(pairs, reverse=True):
        taken = {number for item in chosen for number in item[:2]}
        if not taken & set(pair[:2]):
            chosen.append(pair)
    return tuple(chosen)


def swap_lines(names: tuple[str, ...], swaps: tuple[Swap, ...]) -> tuple[str, ...]:
    """One line for each pair."""
    return tuple(
        f"EMG channels '{names[swap.first]}' and '{names[swap.second]}' look exchanged: each follows the "
        f"other's muscles "
        f"(correlation with what joint torques ask of them {swap.other:.2f}, with their own {swap.own:.2f}); they take "
        "part under their names"
        for swap in swaps
    )
