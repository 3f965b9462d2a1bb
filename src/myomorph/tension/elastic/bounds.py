"""Bounds of the solver's unknowns: barrier, multipliers, and how far a step may go."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array

NEAR = 1e-2  # How far from its bounds, in shares of their distance, an unknown begins at least


class Box:
    """Unknowns between bounds, which may be infinite, with multipliers.
    `low`, `high`: broadcast to the unknowns; `z`, `w`: multipliers of the lower and the upper bound, 0 of an infinite
    one.
    """

    def __init__(self, low: Array, high: Array, v: Array, mu: float):
        self.low, self.high = np.broadcast_to(low, v.shape), np.broadcast_to(high, v.shape)
        self.below, self.above = np.isfinite(self.low), np.isfinite(self.high)
        self._both = bool(self.below.all() and self.above.all())
        self._known: list[tuple[Array, Array, Array]] = []
        down, up = self._distances(v)
        self.z = np.where(self.below, mu / down, 0.0)
        self.w = np.where(self.above, mu / up, 0.0)

    def _distances(self, v: Array) -> tuple[Array, Array]:
        """Distances to the bounds, 1 of an infinite one; of the last two points they are kept."""
        for value, down, up in self._known:
            if value is v:
                return down, up
        if self._both:
            down, up = v - self.low, self.high - v
        else:
            down, up = np.where(self.below, v - self.low, 1.0), np.where(self.above, self.high - v, 1.0)
        self._known = [*self._known[-1:], (v, down, up)]
        return down, up

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
        down, up = (1.0 / distance for distance in self._distances(v))
        pushed = up - down if self._both else up * self.above - down * self.below
        return mu * pushed, self.z * down + self.w * up

    def logs(self, v: Array) -> float:
        """Sum of the logarithms of the distances to the bounds."""
        down, up = self._distances(v)
        if not (down.min(initial=1.0) > 0.0 and up.min(initial=1.0) > 0.0):
            return -np.inf
        return float(np.log(down).sum() + np.log(up).sum())

    def complementarity(self, v: Array, mu: float) -> float:
        """Greatest difference of a multiplier times its distance from the barrier parameter."""
        down, up = self._distances(v)
        one, other = np.abs(self.z * down - mu), np.abs(self.w * up - mu)
        if not self._both:
            one, other = one * self.below, other * self.above
        return float(max(one.max(initial=0.0), other.max(initial=0.0)))

    def changes(self, v: Array, dv: Array, mu: float) -> tuple[Array, Array]:
        """Steps of the multipliers."""
        down, up = self._distances(v)
        dz, dw = (mu - self.z * dv) / down - self.z, (mu + self.w * dv) / up - self.w
        return (dz, dw) if self._both else (np.where(self.below, dz, 0.0), np.where(self.above, dw, 0.0))

    def reach(self, v: Array, dv: Array, share: float) -> float:
        """Longest step that keeps a share of the distance to the bounds."""
        down, up = self._distances(v)
        one, other = dv / down, dv / up
        if not self._both:
            one, other = one * self.below, other * self.above
        worst = max(-float(one.min(initial=0.0)), float(other.max(initial=0.0)))
        return min(1.0, share / worst) if worst > 0.0 else 1.0

    def dual_reach(self, dz: Array, dw: Array, share: float) -> float:
        """Longest step that keeps a share of the multipliers."""
        if self._both:
            worst = -min(float((dz / self.z).min(initial=0.0)), float((dw / self.w).min(initial=0.0)))
        else:
            worst = max(
                float((-dz / np.where(self.z > 0.0, self.z, 1.0)).max(initial=0.0)),
                float((-dw / np.where(self.w > 0.0, self.w, 1.0)).max(initial=0.0)),
            )
        return min(1.0, share / worst) if worst > 0.0 else 1.0

    def keep_near(self, v: Array, mu: float) -> None:
        """Multipliers within a wide corridor of the barrier's own."""
        down, up = (mu / distance for distance in self._distances(v))
        z, w = np.clip(self.z, down / 1e10, down * 1e10), np.clip(self.w, up / 1e10, up * 1e10)
        self.z, self.w = (z, w) if self._both else (np.where(self.below, z, 0.0), np.where(self.above, w, 0.0))
