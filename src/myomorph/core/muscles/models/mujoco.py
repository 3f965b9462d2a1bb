"""MuJoCo's muscles: parabolas over fiber length and velocity, along a tendon without pennation.

The formulas are those of `mju_muscleGain` and `mju_muscleBias`.
"""

from __future__ import annotations

from functools import lru_cache

from myomorph.core.model.paths import Muscle
from myomorph.core.muscles.curves import Curve, Piece
from myomorph.core.muscles.muscle_model import FiberCurves, MuscleModel, numbers


class MujocoMuscle(MuscleModel):
    """A muscle of an MJCF file, with the parameters lmin, lmax, fpmax and fvmax."""

    def curves(self, muscle: Muscle) -> FiberCurves:
        """Its curves."""
        return _curves(*numbers(muscle, lmin=0.5, lmax=1.6, fpmax=1.3, fvmax=1.2))

    def pennation(self, muscle: Muscle) -> float:
        """None."""
        return 0.0


@lru_cache(maxsize=256)
def _curves(low: float, high: float, passive: float, fastest: float) -> FiberCurves:
    rising = 0.5 * (low + 1.0)
    falling = 0.5 * (1.0 + high)
    active = Curve(
        (
            _parabola(low, rising, (0.0, 0.0, 0.5)),
            _parabola(rising, 1.0, (0.5, 1.0, -0.5)),
            _parabola(1.0, falling, (1.0, 0.0, -0.5)),
            _parabola(falling, high, (0.5, -1.0, 0.5)),
        ),
        high,
    )
    velocity = Curve(
        (
            Piece(-1.0, (0.0, 0.0, 1.0)),
            _parabola(0.0, fastest - 1.0, (1.0, 2.0 * (fastest - 1.0), 1.0 - fastest)),
        ),
        fastest - 1.0,
    )
    slope = passive / max(1e-15, falling - 1.0)
    return FiberCurves(
        active,
        velocity,
        Curve((_parabola(1.0, falling, (0.0, 0.0, 0.5 * passive)),), falling, (0.0, slope)),
    )


def _parabola(start: float, stop: float, y: tuple[float, ...]) -> Piece:
    return Piece(start, y, (start, max(1e-15, stop - start)))
