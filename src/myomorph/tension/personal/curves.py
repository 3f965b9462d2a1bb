"""Hill-type curves of many muscles as tables, so that values and slopes of all of them come from one lookup.

Personalization evaluates every muscle's curves thousands of times with other lengths but the same shapes. The
curves are those of each muscle's class, sampled finely and joined by cubic Hermite pieces.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array, frozen_array, read_only
from myomorph.model.model import Model
from myomorph.muscles.curves import Curve
from myomorph.muscles.fiber_equations import FiberMuscle
from myomorph.muscles.hill_arrays import muscle_models
from myomorph.muscles.muscle_model import FiberSizes

STEP = 0.002
LENGTHS = np.arange(0.0, 2.5 + STEP / 2, STEP)
SPEEDS = np.arange(-2.0, 2.0 + STEP / 2, STEP)
STRAINS = np.arange(-0.2, 0.3, STEP / 4)


@read_only
class Lookup:
    """Functions on one even grid, several of them, and which of them each muscle has."""

    # start, step: of the grid
    start: float
    step: float
    # values, slopes: (functions, points), slopes times the step
    values: Array
    slopes: Array
    row: NDArray[np.int64]  # (muscles,) function of each muscle

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Values and slopes at x (..., muscles), straight beyond the grid; x may be complex, for complex steps."""
        u = (x - self.start) / self.step
        index = np.clip(np.floor(u.real).astype(np.int64), 0, self.values.shape[1] - 2)
        flat = index + self.row * self.values.shape[1]
        y, d = self.values.ravel(), self.slopes.ravel()
        y0, y1, d0, d1 = y[flat], y[flat + 1], d[flat], d[flat + 1]
        s = u - index
        beyond = np.where(s.real < 0.0, s, np.where(s.real > 1.0, s - 1.0, 0.0))
        s = s - beyond
        rise = y1 - y0
        b, c = 3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise
        slope = d0 + s * (2.0 * b + s * 3.0 * c)
        return y0 + s * (d0 + s * (b + s * c)) + beyond * slope, slope / self.step


@read_only
class MuscleShapes:
    """What personalization leaves as it is of a model's muscles."""

    # active, passive, velocity, tendon: f_L and f_PE over normalized fiber length, f_V over normalized velocity, f_SE
    # over the tendon's strain
    active: Lookup
    passive: Lookup
    velocity: Lookup
    tendon: Lookup
    sine: Array  # (muscles,) of the pennation at optimal length: fibers keep their height
    damping: Array  # (muscles,) normalized force at maximum contraction velocity
    speed: Array  # (muscles,) maximum contraction velocity [optimal lengths / s]
    shortest: Array  # (muscles,) least normalized fiber length
    slower: np.ndarray  # (muscles,) whether contraction velocity falls with activation (Thelen 2003)
    rigid: np.ndarray  # (muscles,) whether the tendon is


def muscle_shapes(model: Model, elastic: bool = True) -> MuscleShapes:
    """Tables of all muscles' curves. `elastic`: whether tendons stretch, where their class has a curve for it."""
    models, muscles = muscle_models(model), model.muscles
    pairs = list(zip(models, muscles, strict=True))
    sizes = FiberSizes(*np.array([kind.sizes(muscle) for kind, muscle in pairs]).reshape(-1, 8).T)
    sine = sizes.height / sizes.fiber
    curves = [kind.curves(muscle) for kind, muscle in pairs]
    shortest = np.array(
        [
            kind.shortest_fiber(muscle) if isinstance(kind, FiberMuscle) else kind.sizes(muscle).shortest
            for kind, muscle in pairs
        ]
    )
    stretches = np.array([kind.elastic for kind in models], bool) & (sizes.tendon > 0.0)
    tendons = [
        kind.tendon(muscle) if stretched else None for (kind, muscle), stretched in zip(pairs, stretches, strict=True)
    ]
    return MuscleShapes(
        active=_table(LENGTHS, [curve.active for curve in curves]),
        passive=_table(LENGTHS, [curve.passive for curve in curves]),
        velocity=_table(SPEEDS, [curve.velocity for curve in curves]),
        tendon=_table(STRAINS, tendons, 1.0),
        sine=frozen_array(sine),
        damping=frozen_array([kind.fiber_damping(muscle) for kind, muscle in pairs]),
        speed=frozen_array(sizes.speed / sizes.fiber),
        shortest=frozen_array(np.maximum(np.maximum(shortest / sizes.fiber, 1.02 * sine), 0.1)),
        slower=np.array([kind.slowed > 0.0 for kind in models], bool),
        rigid=~stretches | (not elastic),
    )


def _table(grid: Array, curves: Sequence[Curve | None], shift: float = 0.0) -> Lookup:
    """One function a muscle, those alike kept once; None is 0 everywhere.
    `shift`: from the grid to what the curves are over.
    """
    rows: dict[bytes, int] = {}
    sampled: dict[Curve | None, Array] = {None: np.zeros_like(grid)}
    values: list[Array] = []
    index = []
    for curve in curves:
        if curve is not None and curve not in sampled:
            sampled[curve] = curve(grid + shift)
        key = sampled[curve].tobytes()
        if key not in rows:
            rows[key] = len(values)
            values.append(sampled[curve])
        index.append(rows[key])
    stacked = np.array(values)
    step = float(grid[1] - grid[0])
    return Lookup(float(grid[0]), step, stacked, np.gradient(stacked, axis=1), np.array(index, np.int64))
