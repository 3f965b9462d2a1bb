"""Factors by which limits are widened, because drawn errors do not know all that is wrong with a result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from myomorph.model.frozen_map import FrozenMap
from myomorph.uncertainty.spread import Spread

FACTORS: Mapping[str, float] = FrozenMap(
    {
        "coordinates": 1.17,
        "torques": 1.11,
        "activations": 1.03,
        "forces": 1.03,
        "contact_forces": 1.23,
        "contact_groups": 1.23,
        "joint_reactions": 1.05,
        "joint_contact_forces": 1.05,
    }
)
"""By table; found on simulated motions and held against others, as docs/validation/uncertainty.md says. Of a table
that is not named nothing is known: its limits stay as drawn."""
NOT_NEGATIVE = ("activations", "forces")
"""Tables whose values are never below 0, as magnitudes of forces (columns `..._f`, `..._force`) are not."""


def widened(name: str, spread: Spread, factor: float) -> Spread:
    """Limits further apart by a factor, about their middle; what cannot be negative stays at 0 or above.

    Parameters
    ----------
    name : of the table
    """
    if factor == 1.0:
        return spread
    middle, half = 0.5 * (spread.low + spread.high), 0.5 * factor * (spread.high - spread.low)
    low, high = middle - half, middle + half
    positive = [name in NOT_NEGATIVE or column.endswith(("_f", "_force")) for column in spread.names]
    low[:, positive] = np.maximum(low, np.minimum(spread.low, 0.0))[:, positive]
    if name == "activations":
        high = np.minimum(high, np.maximum(spread.high, 1.0))
    return replace(spread, low=low, high=high)
