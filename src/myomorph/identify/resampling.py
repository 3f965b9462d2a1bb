"""Block bootstrap: how often each block of swings counts in a draw."""

from __future__ import annotations

import numpy as np

from myomorph.model.spatial import Array


def block_counts(trial: np.ndarray, draws: int, generator: np.random.Generator) -> Array:
    """(draws, blocks) counts of blocks drawn with replacement within each trial, as many as the trial has.

    Drawn within trials, every draw keeps each trial's direction of swing: with a few trials, each released
    another way, a draw that lacked one would lack the axis that it shows.

    Parameters
    ----------
    trial : (blocks,) which trial a block belongs to
    """
    counts = np.zeros((draws, len(trial)))
    for number in np.unique(trial):
        own = np.flatnonzero(trial == number)
        counts[:, own] = generator.multinomial(len(own), np.full(len(own), 1.0 / len(own)), size=draws)
    return counts
