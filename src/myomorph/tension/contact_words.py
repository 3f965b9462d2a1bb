"""Words for combinations of contact forces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.model.arrays import Array

PART = 0.35
"""A group whose part of a unit combination is smaller is not named."""


def axis_words(vector: Array, up: Array) -> str:
    """The axis that a vector (3,) is most along: "vertically", or "along x" of the ground's axes across `up`."""
    height = up / (np.linalg.norm(up) or 1.0)
    along = float(vector @ height)
    across = vector - along * height
    if abs(along) >= np.linalg.norm(across):
        return "vertically"
    return f"along {'xyz'[int(np.abs(across).argmax())]}"


def direction_words(groups: Sequence[str], direction: Array, spread: float, share: float, up: Array) -> str:
    """One clause on a unit combination (groups, 3) of contact forces, "" where it is unknown.

    Parameters
    ----------
    spread : how far forces may go along it [N] at `share` more of the cost
    up : (3,) away from gravity
    """
    if not np.isfinite(direction).all() or not np.isfinite(spread):
        return ""
    if spread < 0.05:
        return "contact forces are determined"
    sizes = np.linalg.norm(direction, axis=1)
    order = [int(k) for k in np.argsort(-sizes) if sizes[k] >= PART][:2]
    first = direction[order[0]]
    words = axis_words(first, up)
    names = [f"'{groups[k]}'" for k in order]
    if len(order) == 1:
        what = f"the force at {names[0]} {words}"
    elif first @ direction[order[1]] < 0.0:
        what = f"shifting force between {names[0]} and {names[1]} {words}"
    else:
        what = f"the forces at {names[0]} and {names[1]} together {words}"
    return f"{what}, by {spread:.3g} N for {100.0 * share:g} % more cost"
