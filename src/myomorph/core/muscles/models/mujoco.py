"""MuJoCo's muscles: parabolas over fiber length and velocity, along a tendon without pennation.

The formulas are those of `mju_muscleGain` and `mju_muscleBias`.
"""

from __future__ import annotations

from functools import lru_cache

from myomorph.core.model.paths import Muscle
from myomorph.core.muscles.curves import Curve, Piece
from myomorph.core.muscles.muscle_model import FiberCurves, MuscleModel, numbers

MIN_SPAN = 1e-15  # Of a parabola, as MuJoCo's


class MujocoMuscle(MuscleModel):
    """A muscle of an MJCF file, with the parameters lmin, lmax, fpmax and fvmax."""

    def curves(self, muscle: Muscle) -> FiberCurves:
        """Curves of the parameters lmin, lmax, fpmax and fvmax."""
        return _curves(*numbers(muscle, lmin=0.5, lmax=1.6, fpmax=1.3, fvmax=1.2))

    def pennation(self, muscle: Muscle) -> float:
        """Pennation of MuJoCo's muscles: none."""
        return 0.0


@lru_cache(maxsize=256)
def _curves(low: float, high: float, passive: float, fastest: float) -> FiberCurves:
    """Parabolas of `mju_muscleGain` and `mju_muscleBias`.

    Parameters
    ----------
    low, high : normalized lengths between which there is active force
    passive : normalized passive force at the middle of 1 and `high`
    fastest : normalized force of fast lengthening
    """
    rising = 0.5 * (low + 1.0)
    falling = 0.5 * (1.0 + high)
    active = (
        _parabola(low, rising, (0.0, 0.0, 0.5)),
        _parabola(rising, 1.0, (0.5, 1.0, -0.5)),
        _parabola(1.0, falling, (1.0, 0.0, -0.5)),
        _parabola(falling, high, (0.5, -1.0, 0.5)),
    )
    lengthening = fastest - 1.0
    velocity = (
        Piece(-1.0, (0.0, 0.0, 1.0)),
        _parabola(0.0, lengthening, (1.0, 2.0 * lengthening, 1.0 - fastest)),
    )
    toe = _parabola(1.0, falling, (0.0, 0.0, 0.5 * passive))
    slope = passive / max(MIN_SPAN, falling - 1.0)
    return FiberCurves(
        active=Curve(active, high),
        velocity=Curve(velocity, lengthening),
        passive=Curve((toe,), falling, (0.0, slope)),
    )


def _parabola(start: float, stop: float, y: tuple[float, ...]) -> Piece:
    """Make a piece with power coefficients y in (x - start) / (stop - start)."""
    return Piece(start, y, (start, max(MIN_SPAN, stop - start)))
