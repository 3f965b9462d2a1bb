"""Fiber lengths and tendon forces at which fibers and tendon pull alike, as OpenSim's muscles find them.

Millard2012EquilibriumMuscle takes the fiber at rest; Thelen2003Muscle shares the path's velocity between fiber and
tendon by their stiffness; DeGrooteFregly2016Muscle gives it all to the fiber. The search is OpenSim's: a Newton
iteration with halved steps from a tendon stretched by 1 %, so that of several solutions the same one is found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.paths import Muscle
from myomorph.muscles.fiber_equations import (
    EPS,
    clamped_activation,
    degroote_stretch,
    degroote_velocity_factor,
    fiber_at,
    length_factors,
    pennation,
    shortest_fiber,
    tendon_factor,
    thelen_velocity,
)
from myomorph.muscles.hill_arrays import HillArrays, compile_hill
from myomorph.muscles.hill_classes import DEGROOTE, KINDS, MILLARD

NEWTON_STEPS = {True: 200, False: 20}
"""By whether it is Millard's class."""

NUDGE = EPS**0.5
HIGHEST = 5.0
"""Largest normalized tendon force of DeGrooteFregly2016Muscle."""


def equilibrium(model: Model, m: int, length: Array, speed: Array, activation: Array) -> Array:
    """Fiber length [m], or normalized tendon force of DeGrooteFregly2016Muscle, of muscle m in equilibrium.

    Parameters
    ----------
    length, speed : (frames,) of the path [m], [m/s]
    activation : (frames,)

    Returns
    -------
    (frames,) NaN where none is found
    """
    H, muscle = compile_hill(model), model.muscles[m]
    with np.errstate(all="ignore"):
        if KINDS[muscle.kind] == DEGROOTE:
            return _degroote(H, m, muscle, length, speed, activation)
        return _fiber_length(_Search(H, m, muscle, length, speed, activation))


@dataclass(eq=False)
class _Search:
    """What the search for a fiber length knows of a muscle."""

    H: HillArrays
    m: int
    muscle: Muscle
    length: Array
    speed: Array
    a: Array

    @property
    def at_rest(self) -> bool:
        return KINDS[self.muscle.kind] == MILLARD

    @property
    def shortest(self) -> float:
        return shortest_fiber(self.H, self.m, self.muscle)

    def tendon(self, fiber: Array) -> Array:
        return self.length - fiber * np.cos(pennation(self.H, self.m, fiber))

    def error(self, fiber: Array, f_v: Array) -> Array:
        """Fibers' pull along the tendon less the tendon's [N]."""
        active, passive = length_factors(self.H, self.m, fiber / self.H.fiber[self.m])
        pull = (self.a * active * f_v + passive) * np.cos(pennation(self.H, self.m, fiber))
        return self.H.force[self.m] * (pull - self.tendon_factor(fiber))

    def tendon_factor(self, fiber: Array) -> Array:
        return tendon_factor(self.muscle, self.tendon(fiber) / self.H.tendon[self.m])

    def slope(self, fiber: Array, f_v: Array) -> Array:
        """Slope of the error over the fiber length [N/m]."""
        step = 1e-6 * self.H.fiber[self.m]
        return (self.error(fiber + step, f_v) - self.error(fiber - step, f_v)) / (2.0 * step)

    def shared_velocity_factor(self, fiber: Array, f_v: Array, turning: bool = True) -> Array:
        """f_V where fiber and tendon share the path's velocity by their stiffness.

        Parameters
        ----------
        turning : whether the fibers' stiffness counts that they turn as they lengthen
        """
        if self.at_rest:
            return f_v
        H, m = self.H, self.m
        step = 1e-6 * H.fiber[m]
        cosine = np.cos(pennation(H, m, fiber))

        def pull(x: Array) -> Array:
            active, passive = length_factors(H, m, x / H.fiber[m])
            return (self.a * active * f_v + passive) * (np.cos(pennation(H, m, x)) if turning else cosine)

        fibers = (pull(fiber + step) - pull(fiber - step)) / (2.0 * step) * cosine
        stretch = self.tendon(fiber) / H.tendon[m]
        rise = tendon_factor(self.muscle, stretch + 1e-6) - tendon_factor(self.muscle, stretch - 1e-6)
        tendon = rise / (2e-6 * H.tendon[m])
        shares = (np.abs(fibers + tendon) * H.force[m] > EPS**0.875) & (stretch > 1.0)
        of_tendon = np.where(shares, fibers / (fibers + tendon), 1.0) * self.speed
        v = (self.speed - of_tendon) * cosine / H.speed[m]
        return _inverted(self.muscle, self.a, length_factors(H, m, fiber / H.fiber[m])[0], v)


def _inverted(muscle: Muscle, a: Array, active: Array, v: Array) -> Array:
    """f_V at which Thelen2003Muscle has a normalized velocity; not below 0."""
    low, high = np.full_like(v, -100.0), np.full_like(v, 100.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = thelen_velocity(muscle, a, active, middle * a * active) > v
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.maximum(0.5 * (low + high), 0.0)


def _fiber_length(s: _Search) -> Array:
    H, m = s.H, s.m
    s.a = np.asarray(s.a, dtype=np.float64)
    fiber = np.maximum(fiber_at(H, m, s.length - 1.01 * H.tendon[m]), s.shortest)
    # OpenSim's first guess of the stiffness has no force yet that turns with the fibers.
    f_v = s.shared_velocity_factor(fiber, np.ones_like(fiber), turning=False)
    error, slope = s.error(fiber, f_v), s.slope(fiber, f_v)
    tolerance = max(1e-8 * H.force[m], 10.0 * EPS**0.875)
    for _ in range(NEWTON_STEPS[s.at_rest]):
        wanted = np.abs(error) > tolerance
        if not wanted.any():
            break
        fiber, error = _stepped(s, fiber, f_v, error, slope, wanted)
        # The velocity follows only now: error and slope of a step are those of the velocity before it.
        slope = s.slope(fiber, f_v)
        f_v = np.where(wanted, s.shared_velocity_factor(fiber, f_v), f_v)
    found = np.isfinite(s.length) & ((np.abs(error) < tolerance) | (fiber <= s.shortest))
    return np.where(found, fiber, np.nan)


def _stepped(
    s: _Search, fiber: Array, f_v: Array, error: Array, slope: Array, wanted: np.ndarray
) -> tuple[Array, Array]:
    """One Newton step, halved until the error falls, of the frames that are wanted."""
    new, best, h = fiber.copy(), error.copy(), 1.0
    open_ = wanted
    while open_.any():
        step = -h * error / slope
        moved = np.where(np.abs(step) > EPS**0.875, fiber + step, fiber - np.sign(step) * NUDGE)
        stuck = np.abs(step) <= EPS**0.875
        moved = np.maximum(moved, s.shortest)
        new = np.where(open_, moved, new)
        best = np.where(open_, s.error(new, f_v), best)
        open_ = open_ & ~stuck & (np.abs(best) >= np.abs(error))
        if h <= NUDGE:
            break
        h *= 0.5
    return new, best


def _degroote(H: HillArrays, m: int, muscle: Muscle, length: Array, speed: Array, a: Array) -> Array:
    a = clamped_activation(muscle, a)

    def residual(force: Array) -> Array:
        along = length - H.tendon[m] * degroote_stretch(muscle, force)
        fiber = np.sqrt(along**2 + H.height[m] ** 2)
        cosine = along / fiber
        active, passive = length_factors(H, m, fiber / H.fiber[m])
        v = speed * cosine / H.speed[m]
        pull = a * active * degroote_velocity_factor(v) + passive
        pull += muscle.parameters.get("fiber_damping", 0.0) * v
        return force - pull * cosine

    return _bisected(residual, np.zeros_like(length), np.full_like(length, HIGHEST))


def _bisected(residual: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Zero of a function between bounds, NaN where it has the same sign at both."""
    rising = residual(high) > 0.0
    crossed = (residual(low) > 0.0) != rising
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = (residual(middle) > 0.0) == rising
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.where(crossed, 0.5 * (low + high), np.nan)
