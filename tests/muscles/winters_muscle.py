"""A muscle model written outside the package: its curves and parameters, whole.

After Winters 1995, simplified: a bell over length, Hill's hyperbola, exponentials for the fibers'
rest and the tendon.
"""

from __future__ import annotations

import numpy as np

from myomorph.core.model.paths import Muscle
from myomorph.core.muscles.curves import BELL, EXPONENTIAL, LOGARITHM, RATIO, Curve, Piece, Shape
from myomorph.core.muscles.muscle_model import FiberCurves, MuscleModel, numbers


class Winters1995(MuscleModel):
    """Parameters `width`, `hill`, `passive_strain` and `tendon_strain`."""

    times = (0.020, 0.050)
    damping = 0.05
    elastic = True

    def curves(self, muscle: Muscle) -> FiberCurves:
        """Return the active, velocity and passive curves.

        They are exp(-((l - 1) / width)^2), (1 + v) / (1 - v / hill) and (exp(4 (l - 1) / strain) -
        1) / (exp(4) - 1).
        """
        width, hill, strain = numbers(muscle, width=0.45, hill=0.3, passive_strain=0.6)
        active = Curve(
            (Piece(-np.inf, shapes=(Shape(form=BELL, size=1.0, a=-1.0 / width, b=1.0 / width),)),)
        )
        # Lengthening: slope at rest as of shortening, up to 1.4.
        rate = (1.0 + 1.0 / hill) / 0.4
        velocity = Curve(
            (
                Piece(
                    -1.0, shapes=(Shape(form=RATIO, size=1.0, a=1.0, b=1.0, c=1.0, d=-1.0 / hill),)
                ),
                Piece(
                    0.0, shapes=(Shape(form=RATIO, size=1.0, a=1.0, b=1.4 * rate, c=1.0, d=rate),)
                ),
            )
        )
        size = 1.0 / np.expm1(4.0)
        rise = Piece(
            1.0,
            (-size,),
            shapes=(Shape(form=EXPONENTIAL, size=size, a=-4.0 / strain, b=4.0 / strain),),
        )
        return FiberCurves(active, velocity, Curve((rise,)))

    def smooth_curves(self, muscle: Muscle) -> FiberCurves:
        """Return the curves with a rounded corner where the passive force begins with a slope."""
        curves = self.curves(muscle)
        return curves._replace(passive=curves.passive.rounded(1.0, 0.02))

    def tendon(self, muscle: Muscle) -> Curve:
        """(exp(3 (s - 1) / strain) - 1) / (exp(3) - 1)."""
        (strain,) = numbers(muscle, tendon_strain=0.05)
        size = 1.0 / np.expm1(3.0)
        return Curve(
            (
                Piece(
                    1.0,
                    (-size,),
                    shapes=(Shape(form=EXPONENTIAL, size=size, a=-3.0 / strain, b=3.0 / strain),),
                ),
            )
        )

    def stretch(self, muscle: Muscle) -> Curve:
        """1 + strain / 3 log(1 + (exp(3) - 1) f)."""
        (strain,) = numbers(muscle, tendon_strain=0.05)
        return Curve(
            (
                Piece(
                    0.0,
                    (1.0,),
                    shapes=(
                        Shape(form=LOGARITHM, size=strain / 3.0, a=1.0, b=float(np.expm1(3.0))),
                    ),
                ),
            )
        )
