"""Paths that jump: lengths that change between two frames by what no velocity explains."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array

JUMP = 1e-3
"""A path whose length changes by so much more than its velocity explains jumps [m]."""
UNUSUAL = 10.0
"""And by so many times what is usual for the muscle: coarse frames of fast motions are no jumps."""


def path_jumps(time: Array, lengths: Array, velocities: Array) -> Array:
    """Find where paths jump, as where one leaves a surface or snaps over it.

        | l_{k+1} - l_k - (t_{k+1} - t_k) (v_k + v_{k+1}) / 2 |

    Parameters
    ----------
    time : (frames,) [s]
    lengths, velocities : (frames, muscles) of muscle-tendon paths [m] and [m/s]

    Returns
    -------
    (frames - 1, muscles) what no velocity explains where it is a jump, else 0 [m]
    """
    step = np.diff(time)[:, None]
    odd = np.abs(np.diff(lengths, axis=0) - 0.5 * step * (velocities[1:] + velocities[:-1]))
    odd = np.where(np.isfinite(odd), odd, 0.0)
    usual = np.median(odd, axis=0) if len(odd) else np.zeros(odd.shape[1])
    return np.asarray(np.where(odd > np.maximum(JUMP, UNUSUAL * usual), odd, 0.0))
