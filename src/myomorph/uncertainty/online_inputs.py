"""Filtered motion and forces of live frames with the errors of all draws at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.model.arrays import Array
from myomorph.uncertainty.bodies import Draw

CARRIES = 1.0
"""Vertical force from which on a center of pressure is taken from a wrench [N]."""


class OnlineInputs:
    """What a causal filter gives, with the errors of all draws but those of the pose.

    Parameters
    ----------
    bodies : that external forces act on
    delay : of the filter [s]
    up : (3,) against gravity
    """

    def __init__(self, draws: Sequence[Draw], bodies: Sequence[str], delay: float, up: Array):
        shifts = _each(draws, bodies, "plate_position")
        self._shifts, self._up = shifts - (shifts @ up)[..., None] * up, up
        self._gains = np.exp(_each(draws, bodies, "plate_gain"))
        self._late = np.array([draw.of("clock", "forces")[0] for draw in draws])
        # A filter with a delay r T passes exp(-w^2 T^2 (r^2 - 1) / 14) of what one with T does: for slow motion
        # the second derivative, times this share of T^2.
        ratios = np.array([1.0 / draw.factor("filter_cutoff", "cutoff") for draw in draws])
        self._smooth = delay**2 * (ratios**2 - 1.0) / 14.0

    def motion(self, motion: Array) -> Array:
        """(draws, 3, coordinates) value, velocity and acceleration through other filters, of five derivatives."""
        return np.asarray(motion[:3] + self._smooth[:, None, None] * motion[2:])

    def loads(self, loads: Array) -> Array:
        """(draws, bodies, 6) wrenches of plates that stand elsewhere, with other gains, clocks and filters.

        Parameters
        ----------
        loads : (3, bodies, 6) filtered wrenches and their first two derivatives
        """
        shifted = loads[0] + self._smooth[:, None, None] * loads[2] - self._late[:, None, None] * loads[1]
        moments, forces = shifted[..., :3], shifted[..., 3:]
        lift = forces @ self._up
        acts = np.abs(lift) > CARRIES
        points = np.where(acts[..., None], np.cross(self._up, moments) / np.where(acts, lift, 1.0)[..., None], 0.0)
        other = self._gains * forces
        moments = moments + np.cross(points, other - forces) + np.cross(self._shifts, other)
        return np.concatenate([moments, other], axis=2)


def _each(draws: Sequence[Draw], bodies: Sequence[str], source: str) -> Array:
    """(draws, bodies, 3) errors of a source."""
    return np.array([[draw.of(source, name, 3) for name in bodies] for draw in draws]).reshape(len(draws), -1, 3)
