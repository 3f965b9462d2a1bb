"""The wrench that a plate measures on a base: about the joint's center, on the clock of the markers."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.series import Wrenches
from myomorph.motion.filters import lowpass, natural_spline

ANTI_ALIAS = 0.4
"""Cutoff of the low-pass before samples are thinned out, as part of the new rate: at a quarter of it, where limbs
swing and filters cut, it takes less than 1 in 10^3."""


def wrench_about(wrenches: Wrenches, center: Array) -> Array:
    """(samples, 6) moment about a point (3,) in ground and force of all wrenches together; NaN where one lacks.

    A point of application that is unknown counts only where there is a force.
    """
    still = (wrenches.forces == 0.0).all(axis=2)[..., None]
    arms = np.where(still & ~np.isfinite(wrenches.points), 0.0, wrenches.points - center)
    moments = np.where(still & ~np.isfinite(wrenches.torques), 0.0, wrenches.torques) + np.cross(arms, wrenches.forces)
    total: Array = np.concatenate([moments.sum(axis=1), wrenches.forces.sum(axis=1)], axis=1)
    return total


def on_clock(time: Array, values: Array, frames: Array) -> Array:
    """(frames, columns) values (samples, columns) at other times; NaN outside the samples and at their gaps.

    Samples that come faster than the frames pass a zero-lag low-pass at `ANTI_ALIAS` of the frames' rate first.

    Raises
    ------
    BadData : fewer than four samples are finite
    """
    known = np.isfinite(values).all(axis=1)
    if known.sum() < 4:
        raise BadData(f"the wrench on the base has {int(known.sum())} finite samples of {len(values)}: 4 are needed")
    filled = np.array(values)
    for column in filled.T:
        column[~known] = np.interp(time[~known], time[known], column[known])
    rate, wanted = ((len(one) - 1) / float(one[-1] - one[0]) if len(one) > 1 else np.inf for one in (time, frames))
    reach = 0.5 / wanted
    if rate > 1.5 * wanted:
        filled = lowpass(filled, rate, ANTI_ALIAS * wanted)
        reach = 1.0 / (ANTI_ALIAS * wanted)
    inside = (frames >= time[0] - 1e-9) & (frames <= time[-1] + 1e-9)
    found = np.full((len(frames), values.shape[1]), np.nan)
    found[inside] = natural_spline(time, filled, degree=3)(np.clip(frames[inside], time[0], time[-1]))
    if not known.all():
        near = binary_dilation(~known, iterations=max(1, round(reach * rate)))
        nearest = np.clip(np.searchsorted(time, frames), 0, len(time) - 1)
        found[near[nearest]] = np.nan
    return found


def lowpass_runs(values: Array, rate: float, cutoff: float | None) -> Array:
    """Every gap-free run of rows filtered by itself; runs shorter than six are lost, as those of the motion."""
    if cutoff is None:
        return values
    found = np.full(values.shape, np.nan)
    seen = np.isfinite(values).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], seen, [False]]).astype(int)))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if stop - start > 5:
            found[start:stop] = lowpass(values[start:stop], rate, cutoff)
    return found
