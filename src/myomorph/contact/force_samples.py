"""External forces sampled at the times of a motion, and what may be done to all of their samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array, read_only
from myomorph.model.series import Wrenches

Change: TypeAlias = Callable[[Array, Array, Array], tuple[Array, Array, Array]]
"""What makes other forces, points and torques (..., 3) of those of one wrench."""


@read_only
@dataclass(frozen=True, eq=False)
class ForceSamples:
    """External forces at the times of a motion.

    Attributes
    ----------
    forces, points, torques : (frames, wrenches, 3) [N, m, N m]; zero where unknown
    loaded : (frames, wrenches) forces large enough for their center of pressure to be believed
    """

    forces: Array
    points: Array
    torques: Array
    loaded: NDArray[np.bool_]

    def centers(self, up: Array) -> Array:
        """Where each wrench meets the height of its points without horizontal moment (frames, wrenches, 3) [m]."""
        lift = self.forces @ up
        firm = np.abs(lift) > 0.2 * np.linalg.norm(self.forces, axis=2)
        shift = np.cross(up, self.torques) / np.where(firm, lift, np.inf)[..., None]
        return np.asarray(self.points + shift)

    def changed(self, number: int, change: Change) -> ForceSamples:
        """The same with one wrench changed."""
        return replace(self, **_changed(self, number, change))


def sampled(wrenches: Wrenches, time: Array, least: float) -> ForceSamples:
    """The nearest samples of wrenches at some times; nothing acts at times that they do not cover.

    Parameters
    ----------
    least : force from which a wrench counts as loaded [N]
    """
    after = np.clip(np.searchsorted(wrenches.time, time), 1, max(len(wrenches) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(wrenches) - 1)
    nearest = np.where(time - wrenches.time[before] < wrenches.time[after] - time, before, after)
    step = float(np.median(np.diff(wrenches.time))) if len(wrenches) > 1 else 1e-3
    inside = (np.abs(wrenches.time[nearest] - time) <= max(step, 1e-6))[:, None, None]
    forces, points, torques = (
        np.where(inside, np.nan_to_num(one[nearest]), 0.0)
        for one in (wrenches.forces, wrenches.points, wrenches.torques)
    )
    return ForceSamples(forces, points, torques, np.linalg.norm(forces, axis=2) > least)


def changed_wrenches(wrenches: Wrenches, number: int, change: Change) -> Wrenches:
    """Wrenches with one of them changed in all samples."""
    return replace(wrenches, **_changed(wrenches, number, change))


def _changed(forces: ForceSamples | Wrenches, number: int, change: Change) -> dict[str, Any]:
    """Forces, points and torques with those of one wrench changed."""
    parts = {name: np.array(getattr(forces, name)) for name in ("forces", "points", "torques")}
    changed = change(*(part[:, number] for part in parts.values()))
    for part, other in zip(parts.values(), changed, strict=True):
        part[:, number] = other
    return parts
