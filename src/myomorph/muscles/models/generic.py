"""OpenSim's classes with splines: those of SIMM's generic muscle (Delp et al. 1990), and of Schutte et al. 1993."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.paths import Muscle
from myomorph.muscles.curves import EXPONENTIAL, LOGISTIC, Curve, Piece, Shape, spline_curve
from myomorph.muscles.fiber_equations import FiberMuscle, Fibers
from myomorph.muscles.muscle_model import FiberCurves, MuscleModel, StaticOptimization

DELP_ACTIVE = spline_curve(
    (-5.307692, -4.307692, -1.923077, -0.884615, -0.269231, 0.230769, 0.461538, 0.52725, 0.62875, 0.71875, 0.86125,
     1.045, 1.2175, 1.43875, 1.5, 1.615385, 2.0, 2.961538, 3.692308, 5.461538, 9.901902),
    (0.012188, 0.021899, 0.036466, 0.052493, 0.075312, 0.114158, 0.157859, 0.226667, 0.636667, 0.856667, 0.95,
     0.993333, 0.77, 0.246667, 0.193821, 0.133252, 0.072683, 0.044417, 0.036341, 0.021899, 0.007332),
)  # fmt: skip
DELP_PASSIVE = spline_curve(
    (-5.0, 0.998, 0.999, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.601, 1.602, 5.0),
    (0.0, 0.0, 0.0, 0.0, 0.035, 0.12, 0.26, 0.55, 1.17, 2.0, 2.0, 2.0, 2.0),
).within(0.0, 10.0)
DELP_VELOCITY = spline_curve(
    (-1.001, -1.0, *(0.05 * i - 1.0 for i in range(1, 41))),
    (0.0, 0.0, 0.010417, 0.021739, 0.034091, 0.047619, 0.0625, 0.078947, 0.097222, 0.117647, 0.140625, 0.166667,
     0.196429, 0.230769, 0.270833, 0.318182, 0.375, 0.444444, 0.53125, 0.642857, 0.791667, 1.0, 1.482014,
     1.601571, 1.655791, 1.686739, 1.706751, 1.720753, 1.731099, 1.739055, 1.745365, 1.75049, 1.754736,
     1.758312, 1.761364, 1.763999, 1.766298, 1.768321, 1.770115, 1.771717, 1.773155, 1.774455),
).within(0.0)  # fmt: skip
SCHUTTE_TENDON = spline_curve(
    (-10.0, -0.002, -0.001, 0.0, 0.00131, 0.00281, 0.00431, 0.00581, 0.00731, 0.00881, 0.0103, 0.0118, 0.0123,
     9.2, 9.201, 9.202, 20.0),
    (0.0, 0.0, 0.0, 0.0, 0.0108, 0.0257, 0.0435, 0.0652, 0.0915, 0.123, 0.161, 0.208, 0.227,
     345.0, 345.0, 345.0, 345.0),
)  # fmt: skip
GENERIC_VELOCITY = Curve(
    (Piece(-np.inf, (1.8,), shapes=(Shape(LOGISTIC, -1.8, 0.04 / 0.18, 1.0 / 0.18),)),), bounds=(0.0, np.inf)
)
"""What OpenSim's static optimization takes of classes that have no force-velocity curve of their own."""


class RigidTendon(FiberMuscle):
    """RigidTendonMuscle, with the default splines of its curves; its fiber velocity is the path's in OpenSim."""

    static_optimization = StaticOptimization(turning=False)
    state, activated = "", False

    def curves(self, muscle: Muscle) -> FiberCurves:
        """SIMM's generic splines; its class bounds the passive force."""
        return FiberCurves(DELP_ACTIVE, DELP_VELOCITY, DELP_PASSIVE)

    def fibers(self, muscle: Muscle, length: Array, speed: Array, a: Array, state: Array | None) -> Fibers:
        """Fibers on a tendon of its slack length."""
        sizes, curves = self.sizes(muscle), self.curves(muscle)
        along = np.maximum(length - sizes.tendon, 0.0)
        fiber = np.sqrt(along**2 + sizes.height**2)
        cosine = np.where(fiber > 0.0, along / fiber, 1.0)
        v, force = speed / sizes.speed, sizes.force
        pulls = a * curves.active(fiber / sizes.fiber) * curves.velocity(v) * force
        elastic = curves.passive(fiber / sizes.fiber) * force
        pull_force = (pulls + elastic) * cosine
        unknown = np.full_like(speed, np.nan)
        return Fibers(
            a, fiber, np.full_like(length, sizes.tendon), np.arccos(cosine), speed, v, unknown, pulls, elastic,
            pulls + elastic, pull_force, -pulls * speed, -elastic * speed, np.zeros_like(speed), -pull_force * speed,
        )  # fmt: skip


class Schutte1993(MuscleModel):
    """Schutte1993Muscle_Deprecated."""

    def curves(self, muscle: Muscle) -> FiberCurves:
        """SIMM's active spline and an exponential."""
        passive = Curve((Piece(-np.inf, shapes=(Shape(EXPONENTIAL, 1.0, -12.0, 8.0),)),))
        return FiberCurves(DELP_ACTIVE, GENERIC_VELOCITY, passive)

    def resting_tendon(self, muscle: Muscle) -> Curve:
        """The spline of its tendon, which pulls only where it is stretched."""
        pieces = tuple(piece for piece in SCHUTTE_TENDON.pieces if piece.start >= 0.0)
        return Curve(pieces, SCHUTTE_TENDON.end, (0.0, SCHUTTE_TENDON.slopes[1]))
