"""Paths of markers over gaps: by what goes on at both ends, and by other markers of the body."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array

FEW = 3  # Markers that show how a body is turned.


def bridge(time: Array, path: Array, start: int, stop: int) -> Array:
    """Bridge a gap by the cubic that continues position and velocity from before and after.

    With u from 0 to 1 over the span, positions p and velocities v times the span (Hermite),

        (1 + 2 u)(1 - u)^2 p_0 + u (1 - u)^2 v_0 + u^2 (3 - 2 u) p_1 + u^2 (u - 1) v_1

    Parameters
    ----------
    time : (frames,) [s]
    path : (frames, 3) [m]
    start, stop : frames [start, stop) of the gap

    Returns
    -------
    (stop - start, 3) [m], NaN without two frames before and after
    """
    if start < 2 or stop > len(path) - 2:
        return np.full((stop - start, 3), np.nan)
    t0 = time[start - 1]
    t1 = time[stop]
    span = t1 - t0
    slope0 = span * (path[start - 1] - path[start - 2]) / (t0 - time[start - 2])
    slope1 = span * (path[stop + 1] - path[stop]) / (time[stop + 1] - t1)
    u = ((time[start:stop] - t0) / span)[:, None]
    before = (1.0 + 2.0 * u) * (1.0 - u) ** 2 * path[start - 1] + u * (1.0 - u) ** 2 * slope0
    after = u**2 * (3.0 - 2.0 * u) * path[stop] + u**2 * (u - 1.0) * slope1
    return np.asarray(before + after)


def carried_path(time: Array, path: Array, mates: Array, start: int, stop: int) -> Array:
    """Fill a gap by the other markers of the body.

    With the rotation R and the middle m of the body by the others, the place of the marker on it

        l = R^T (x - m)

    hardly changes, and is bridged; x = m + R l. Fewer than three others show no rotation.

    Parameters
    ----------
    time : (frames,) [s]
    path : (frames, 3) of the marker [m]
    mates : (frames, others, 3) [m], NaN where hidden
    start, stop : frames [start, stop) of the gap

    Returns
    -------
    (stop - start, 3) [m], NaN without two frames before and after
    """
    window = slice(max(start - 2, 0), stop + 2)
    seen = np.isfinite(mates[window]).all(axis=(0, 2))
    others = mates[window][:, seen]
    here = path[window]
    middles = others.mean(axis=1) if others.shape[1] else np.zeros(here.shape)
    rotations = np.tile(np.eye(3), (len(here), 1, 1))
    if others.shape[1] >= FEW:
        rotations = _rotations(others - middles[:, None])
    local = np.einsum("fji,fj->fi", rotations, here - middles)
    gap = slice(start - window.start, stop - window.start)
    filled = bridge(time[window], local, gap.start, gap.stop)
    return np.asarray(middles[gap] + np.einsum("fij,fj->fi", rotations[gap], filled))


def _rotations(offsets: Array) -> Array:
    """Rotations of a body against its first frame, by markers about their middle (least squares).

    Parameters
    ----------
    offsets : (frames, markers, 3) [m]

    Returns
    -------
    (frames, 3, 3)
    """
    products = np.einsum("fmi,mj->fij", offsets, offsets[0])
    left, _, right = np.linalg.svd(products)
    signs = np.ones((len(offsets), 3))
    signs[:, 2] = np.sign(np.linalg.det(left @ right))
    return np.asarray((left * signs[:, None]) @ right)
