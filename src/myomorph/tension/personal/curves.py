"""Hill-type curves of many muscles as tables, so that values and slopes of all of them come from one lookup.

Personalization evaluates every muscle's curves thousands of times with other lengths but the same shapes. The
curves are those of `muscles.fiber_equations`, class by class, sampled finely and joined by cubic Hermite pieces.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array, frozen_array, read_only
from myomorph.model.model import Model
from myomorph.model.paths import Muscle
from myomorph.muscles.fiber_equations import (
    degroote_velocity_factor,
    length_factors,
    shortest_fiber,
    tendon_factor,
    velocity_factors,
)
from myomorph.muscles.hill_arrays import HillArrays, compile_hill
from myomorph.muscles.hill_classes import DEGROOTE, KINDS, MILLARD, THELEN

STEP = 0.002
LENGTHS = np.arange(0.0, 2.5 + STEP / 2, STEP)
SPEEDS = np.arange(-2.0, 2.0 + STEP / 2, STEP)
STRAINS = np.arange(-0.2, 0.3, STEP / 4)


@read_only
@dataclass(frozen=True, eq=False)
class Lookup:
    """Functions on one even grid, several of them, and which of them each muscle has.

    Attributes
    ----------
    start, step : of the grid
    values, slopes : (functions, points), slopes times the step
    row : (muscles,) function of each muscle
    """

    start: float
    step: float
    values: Array
    slopes: Array
    row: NDArray[np.int64]

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Values and slopes at x (..., muscles), straight beyond the grid; x may be complex, for complex steps."""
        u = (x - self.start) / self.step
        k = np.clip(np.floor(u.real).astype(np.int64), 0, self.values.shape[1] - 2)
        flat = k + self.row * self.values.shape[1]
        y, d = self.values.ravel(), self.slopes.ravel()
        y0, y1, d0, d1 = y[flat], y[flat + 1], d[flat], d[flat + 1]
        s = u - k
        beyond = np.where(s.real < 0.0, s, np.where(s.real > 1.0, s - 1.0, 0.0))
        s = s - beyond
        rise = y1 - y0
        b, c = 3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise
        slope = d0 + s * (2.0 * b + s * 3.0 * c)
        return y0 + s * (d0 + s * (b + s * c)) + beyond * slope, slope / self.step


@read_only
@dataclass(frozen=True, eq=False)
class MuscleShapes:
    """What personalization leaves as it is of a model's muscles.

    Attributes
    ----------
    active, passive, velocity, tendon : f_L and f_PE over normalized fiber length, f_V over normalized velocity, f_SE
        over the tendon's strain
    sine : (muscles,) of the pennation at optimal length: fibers keep their height
    damping : (muscles,) normalized force at maximum contraction velocity
    speed : (muscles,) maximum contraction velocity [optimal lengths / s]
    shortest : (muscles,) least normalized fiber length
    slower : (muscles,) whether contraction velocity falls with activation (Thelen 2003)
    rigid : (muscles,) whether the tendon is
    """

    active: Lookup
    passive: Lookup
    velocity: Lookup
    tendon: Lookup
    sine: Array
    damping: Array
    speed: Array
    shortest: Array
    slower: np.ndarray
    rigid: np.ndarray


def muscle_shapes(model: Model, elastic: bool = True) -> MuscleShapes:
    """Tables of all muscles' curves.

    Parameters
    ----------
    elastic : whether tendons stretch, where their class has a curve for it

    Raises
    ------
    BadModel
        for a class whose curves are not known
    """
    H, muscles = compile_hill(model), model.muscles
    kinds = [KINDS[muscle.kind] for muscle in muscles]
    sine = H.height / H.fiber
    least = [shortest_fiber(H, m, muscle) / H.fiber[m] for m, muscle in enumerate(muscles)]
    stretches = [kind in (THELEN, MILLARD, DEGROOTE) and H.tendon[m] > 0.0 for m, kind in enumerate(kinds)]
    default = [0.1 if kind == MILLARD else 0.0 for kind in kinds]
    return MuscleShapes(
        active=_table(LENGTHS, muscles, lambda m: length_factors(H, m, LENGTHS)[0]),
        passive=_table(LENGTHS, muscles, lambda m: length_factors(H, m, LENGTHS)[1]),
        velocity=_table(SPEEDS, muscles, lambda m: _velocity(H, m)),
        tendon=_table(STRAINS, muscles, lambda m: _tendon(muscles[m]) if stretches[m] else np.zeros_like(STRAINS)),
        sine=frozen_array(sine),
        damping=frozen_array(
            [muscle.parameters.get("fiber_damping", d) for muscle, d in zip(muscles, default, strict=True)]
        ),
        speed=frozen_array(H.speed / H.fiber),
        shortest=frozen_array(np.maximum(np.maximum(least, 1.02 * sine), 0.1)),
        slower=np.array(kinds) == THELEN,
        rigid=~np.array(stretches, bool) | (not elastic),
    )


def _velocity(H: HillArrays, m: int) -> Array:
    # Not clamped at 0, where the kernel's is: the equilibrium of De Groote's class takes it as it is.
    return degroote_velocity_factor(SPEEDS) if H.kind[m] == DEGROOTE else velocity_factors(H, m, SPEEDS)


def _tendon(muscle: Muscle) -> Array:
    if KINDS[muscle.kind] == DEGROOTE:
        stiffness = np.log(6.0) / muscle.parameters.get("tendon_strain_at_one_norm_force", 0.049)
        return 0.2 * np.exp(stiffness * STRAINS) - 0.2
    return tendon_factor(muscle, 1.0 + STRAINS)


def _table(grid: Array, muscles: tuple[Muscle, ...], make: Callable[[int], Array]) -> Lookup:
    """One function a muscle, those alike kept once."""
    rows: dict[bytes, int] = {}
    values: list[Array] = []
    index = []
    for m in range(len(muscles)):
        made = np.asarray(make(m), dtype=np.float64)
        key = made.tobytes()
        if key not in rows:
            rows[key] = len(values)
            values.append(made)
        index.append(rows[key])
    stacked = np.array(values)
    step = float(grid[1] - grid[0])
    return Lookup(float(grid[0]), step, stacked, np.gradient(stacked, axis=1), np.array(index, np.int64))
