"""Curves of muscles as tables, for lengths that change thousands of times while shapes never do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle
from myomorph.core.muscles.curves import Curve
from myomorph.core.muscles.fiber_equations import FiberMuscle
from myomorph.core.muscles.hill import muscle_models
from myomorph.core.muscles.muscle_model import MuscleModel

STEP = 0.002
LENGTHS = np.arange(0.0, 2.5 + STEP / 2, STEP)
SPEEDS = np.arange(-2.0, 2.0 + STEP / 2, STEP)
STRAINS = np.arange(-0.2, 0.3, STEP / 4)
"""Grids: normalized fiber lengths, normalized velocities, strains of tendons."""
MIN_LENGTH = 0.1  # Normalized, of any fiber
MIN_OF_HEIGHT = (
    1.02  # Shortest fiber over the height that it keeps, so that its pennation is defined
)


@read_only
class Lookup:
    """Functions on one even grid, joined by cubic Hermite pieces, and which of them a muscle has.

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
        """Look up values and slopes, straight beyond the grid.

        With s from 0 to 1 between two points of values y0, y1 and slopes d0, d1,

            y = y0 + s (d0 + s (b + s c)),
            b = 3 (y1 - y0) - 2 d0 - d1,   c = d0 + d1 - 2 (y1 - y0)

        Parameters
        ----------
        x : (..., muscles); may be complex, for complex steps

        Returns
        -------
        (..., muscles) values and (..., muscles) slopes
        """
        points = self.values.shape[1]
        u = (x - self.start) / self.step
        index = np.clip(np.floor(u.real).astype(np.int64), 0, points - 2)
        flat = index + self.row * points
        y0 = self.values.ravel()[flat]
        d0 = self.slopes.ravel()[flat]
        d1 = self.slopes.ravel()[flat + 1]
        rise = self.values.ravel()[flat + 1] - y0
        b = 3.0 * rise - 2.0 * d0 - d1
        c = d0 + d1 - 2.0 * rise

        s = u - index
        after = np.where(s.real > 1.0, s - 1.0, 0.0)
        beyond = np.where(s.real < 0.0, s, after)
        s = s - beyond
        slope = d0 + s * (2.0 * b + s * 3.0 * c)
        return y0 + s * (d0 + s * (b + s * c)) + beyond * slope, slope / self.step


@read_only
class MuscleShapes:
    """Properties of a model's muscles that personalization leaves as they are.

    Attributes
    ----------
    active, passive, velocity, tendon : f_L and f_PE over normalized fiber length, f_V over
        normalized velocity, f_SE over the tendon's strain
    sine : (muscles,) of the pennation at optimal length: fibers keep their height
    damping : (muscles,) normalized force at maximum contraction velocity
    speed : (muscles,) maximum contraction velocity [optimal lengths / s]
    shortest : (muscles,) shortest normalized fiber length
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
    """Tabulate the curves of all muscles.

    Parameters
    ----------
    model : whose muscles they are
    elastic : whether tendons stretch, where their class has a curve for it

    Returns
    -------
    tables, and what else stays of each muscle
    """
    models = muscle_models(model)
    pairs = list(zip(models, model.muscles, strict=True))
    sizes = [kind.sizes(muscle) for kind, muscle in pairs]
    fiber = np.array([size.fiber for size in sizes])
    height = np.array([size.height for size in sizes])
    speed = np.array([size.speed for size in sizes])
    sine = height / fiber
    shortest = np.array([_shortest_fiber(kind, muscle) for kind, muscle in pairs])
    shortest = np.maximum(shortest / fiber, MIN_OF_HEIGHT * sine)
    curves = [kind.curves(muscle) for kind, muscle in pairs]
    tendons = [_tendon(kind, muscle) for kind, muscle in pairs]
    rigid = np.array([tendon is None for tendon in tendons], bool)
    return MuscleShapes(
        active=_table(LENGTHS, [curve.active for curve in curves]),
        passive=_table(LENGTHS, [curve.passive for curve in curves]),
        velocity=_table(SPEEDS, [curve.velocity for curve in curves]),
        tendon=_table(STRAINS, tendons, 1.0),
        sine=frozen_array(sine),
        damping=frozen_array([kind.fiber_damping(muscle) for kind, muscle in pairs]),
        speed=frozen_array(speed / fiber),
        shortest=frozen_array(np.maximum(shortest, MIN_LENGTH)),
        slower=np.array([kind.slowed > 0.0 for kind in models], bool),
        rigid=rigid | (not elastic),
    )


def _tendon(kind: MuscleModel, muscle: Muscle) -> Curve | None:
    """Return the curve of a muscle's tendon, None for a rigid one."""
    if kind.elastic and kind.sizes(muscle).tendon > 0.0:
        return kind.tendon(muscle)
    return None


def _shortest_fiber(kind: MuscleModel, muscle: Muscle) -> float:
    """Find the shortest fiber that the class of a muscle allows [m]."""
    if isinstance(kind, FiberMuscle):
        return float(kind.shortest_fiber(muscle))
    return float(kind.sizes(muscle).shortest)


def _table(grid: Array, curves: Sequence[Curve | None], shift: float = 0.0) -> Lookup:
    """Sample one function per muscle, those alike once, None as 0.

    Parameters
    ----------
    grid : (points,) even
    curves : of the muscles
    shift : from the grid to what the curves are over
    """
    rows: dict[bytes, int] = {}
    sampled: dict[Curve | None, Array] = {None: np.zeros_like(grid)}
    values: list[Array] = []
    row_of_muscle = []
    for curve in curves:
        if curve is not None and curve not in sampled:
            sampled[curve] = curve(grid + shift)
        key = sampled[curve].tobytes()
        if key not in rows:
            rows[key] = len(values)
            values.append(sampled[curve])
        row_of_muscle.append(rows[key])
    stacked = np.array(values)
    return Lookup(
        start=float(grid[0]),
        step=float(grid[1] - grid[0]),
        values=stacked,
        slopes=np.gradient(stacked, axis=1),
        row=np.array(row_of_muscle, np.int64),
    )
