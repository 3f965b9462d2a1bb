"""Bounds of the solver's unknowns: barrier, multipliers, and how far a step may go."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array

NEAR = 1e-2
"""How far from its bounds, in shares of their distance, an unknown begins at least."""


class Box:
    """Unknowns between bounds, which may be infinite, with multipliers.

    Attributes
    ----------
    low, high : broadcast to the unknowns
    z, w : multipliers of the lower and the upper bound, 0 of an infinite one
    """

    def __init__(self, low: Array, high: Array, v: Array, mu: float):
        self.low, self.high = np.broadcast_to(low, v.shape), np.broadcast_to(high, v.shape)
        self.below, self.above = np.isfinite(self.low), np.isfinite(self.high)
        self.z = np.where(self.below, mu / self._down(v), 0.0)
        self.w = np.where(self.above, mu / self._up(v), 0.0)

    def _down(self, v: Array) -> Array:
        return np.where(self.below, v - self.low, 1.0)

    def _up(self, v: Array) -> Array:
        return np.where(self.above, self.high - v, 1.0)

    @staticmethod
    def inside(low: Array, high: Array, v: Array, near: float = NEAR) -> Array:
        """The values moved off their bounds."""
        span = np.where(np.isfinite(high - low), high - low, 1.0)
        gap = np.minimum(near * np.maximum(1.0, np.abs(v)), near * span)
        return np.where(v - low < gap, low + gap, np.where(high - v < gap, high - gap, v))

    def force(self) -> Array:
        """What the bounds add to the gradient of the Lagrangian."""
        return self.w - self.z

    def barrier(self, v: Array, mu: float) -> tuple[Array, Array]:
        """Gradient of the barrier, and the curvature of a primal-dual step."""
        down, up = 1.0 / self._down(v), 1.0 / self._up(v)
        return mu * (up * self.above - down * self.below), self.z * down + self.w * up

    def logs(self, v: Array) -> float:
        """Sum of the logarithms of the distances to the bounds."""
        down, up = np.where(self.below, v - self.low, 1.0), np.where(self.above, self.high - v, 1.0)
        if not (down > 0.0).all() or not (up > 0.0).all():
            return -np.inf
        return float(np.log(down).sum() + np.log(up).sum())

    def complementarity(self, v: Array, mu: float) -> float:
        """Greatest difference of a multiplier times its distance from the barrier parameter."""
        one = np.abs(self.z * self._down(v) - mu) * self.below
        other = np.abs(self.w * self._up(v) - mu) * self.above
        return float(max(one.max(initial=0.0), other.max(initial=0.0)))

    def changes(self, v: Array, dv: Array, mu: float) -> tuple[Array, Array]:
        """Steps of the multipliers."""
        down, up = self._down(v), self._up(v)
        return np.where(self.below, (mu - self.z * dv) / down - self.z, 0.0), np.where(
            self.above, (mu + self.w * dv) / up - self.w, 0.0
        )

    def reach(self, v: Array, dv: Array, share: float) -> float:
        """Longest step that keeps a share of the distance to the bounds."""
        worst = max(
            float((-dv * self.below / self._down(v)).max(initial=0.0)),
            float((dv * self.above / self._up(v)).max(initial=0.0)),
        )
        return min(1.0, share / worst) if worst > 0.0 else 1.0

    def dual_reach(self, dz: Array, dw: Array, share: float) -> float:
        """Longest step that keeps a share of the multipliers."""
        worst = max(
            float((-dz / np.where(self.z > 0.0, self.z, 1.0)).max(initial=0.0)),
            float((-dw / np.where(self.w > 0.0, self.w, 1.0)).max(initial=0.0)),
        )
        return min(1.0, share / worst) if worst > 0.0 else 1.0

    def keep_near(self, v: Array, mu: float) -> None:
        """Multipliers within a wide corridor of the barrier's own."""
        down, up = mu / self._down(v), mu / self._up(v)
        self.z = np.where(self.below, np.clip(self.z, down / 1e10, down * 1e10), 0.0)
        self.w = np.where(self.above, np.clip(self.w, up / 1e10, up * 1e10), 0.0)
