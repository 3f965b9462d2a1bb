"""Fiber lengths and tendon forces at which fibers and tendon pull alike, as OpenSim's muscles find them.

The search is OpenSim's: a Newton iteration with halved steps from a tendon stretched by 1 %, so that of several
solutions the same one is found.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.paths import Muscle
from myomorph.muscles.fiber_equations import EPS, FiberMuscle, fiber_at, fiber_pennation

NUDGE = EPS**0.5


class FiberLengthSearch:
    """The search for a muscle's fiber length, with fibers at rest.
    `length`, `speed` (frames,) of the path [m], [m/s]; `activation` (frames,). `steps`: most Newton steps.
    """

    steps = 200

    def __init__(self, model: FiberMuscle, muscle: Muscle, length: Array, speed: Array, activation: Array):
        self.muscle, self.sizes, self.curves = muscle, model.sizes(muscle), model.curves(muscle)
        self.tendon, self.shortest = model.tendon(muscle), model.shortest_fiber(muscle)
        self.length, self.speed, self.a = length, speed, np.asarray(activation, dtype=np.float64)

    def velocity_factor(self, fiber: Array, f_v: Array, turning: bool = True) -> Array:
        """f_V of fibers that are as long; `turning` is whether a stiffness counts that they turn."""
        return f_v

    def tendon_length(self, fiber: Array) -> Array:
        """(frames,) [m]."""
        return self.length - fiber * np.cos(fiber_pennation(self.sizes, fiber))

    def error(self, fiber: Array, f_v: Array) -> Array:
        """Fibers' pull along the tendon less the tendon's [N]."""
        x = fiber / self.sizes.fiber
        pull = (self.a * self.curves.active(x) * f_v + self.curves.passive(x)) * np.cos(
            fiber_pennation(self.sizes, fiber)
        )
        return self.sizes.force * (pull - self.tendon(self.tendon_length(fiber) / self.sizes.tendon))

    def slope(self, fiber: Array, f_v: Array) -> Array:
        """Slope of the error over the fiber length [N/m]."""
        step = 1e-6 * self.sizes.fiber
        return (self.error(fiber + step, f_v) - self.error(fiber - step, f_v)) / (2.0 * step)

    def solve(self) -> Array:
        """(frames,) fiber length [m], NaN where none is found."""
        fiber = np.maximum(fiber_at(self.sizes, self.length - 1.01 * self.sizes.tendon), self.shortest)
        # OpenSim's first guess of the stiffness has no force yet that turns with the fibers.
        f_v = self.velocity_factor(fiber, np.ones_like(fiber), turning=False)
        error, slope = self.error(fiber, f_v), self.slope(fiber, f_v)
        tolerance = max(1e-8 * self.sizes.force, 10.0 * EPS**0.875)
        for _ in range(self.steps):
            wanted = np.abs(error) > tolerance
            if not wanted.any():
                break
            fiber, error = self._stepped(fiber, f_v, error, slope, wanted)
            # The velocity follows only now: error and slope of a step are those of the velocity before it.
            slope = self.slope(fiber, f_v)
            f_v = np.where(wanted, self.velocity_factor(fiber, f_v), f_v)
        settled = np.isfinite(self.length) & ((np.abs(error) < tolerance) | (fiber <= self.shortest))
        return np.where(settled, fiber, np.nan)

    def _stepped(self, fiber: Array, f_v: Array, error: Array, slope: Array, wanted: np.ndarray) -> tuple[Array, Array]:
        """One Newton step, halved until the error falls, of the frames that are wanted."""
        new, best, h = fiber.copy(), error.copy(), 1.0
        open_ = wanted
        while open_.any():
            step = -h * error / slope
            moved = np.where(np.abs(step) > EPS**0.875, fiber + step, fiber - np.sign(step) * NUDGE)
            stuck = np.abs(step) <= EPS**0.875
            moved = np.maximum(moved, self.shortest)
            new = np.where(open_, moved, new)
            best = np.where(open_, self.error(new, f_v), best)
            open_ = open_ & ~stuck & (np.abs(best) >= np.abs(error))
            if h <= NUDGE:
                break
            h *= 0.5
        return new, best


def bisected(residual: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Zero of a function between bounds, NaN where it has the same sign at both."""
    rising = residual(high) > 0.0
    crossed = (residual(low) > 0.0) != rising
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = (residual(middle) > 0.0) == rising
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.where(crossed, 0.5 * (low + high), np.nan)
