"""Thelen2003Muscle (Thelen 2003) with OpenSim's search for its fibers, and classes with splines.

The splines are those of SIMM's generic muscle (Delp et al. 1990) and of Schutte et al. 1993.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.paths import Muscle
from myomorph.core.muscles.curves import (
    BELL,
    EXPONENTIAL,
    LOGARITHM,
    LOGISTIC,
    RATIO,
    Curve,
    Piece,
    Shape,
    spline_curve,
)
from myomorph.core.muscles.fiber_equations import (
    EPS,
    FiberLengthSearch,
    FiberMuscle,
    Fibers,
    fiber_pennation,
)
from myomorph.core.muscles.muscle_model import FiberCurves, MuscleModel, StaticOptimization, numbers

DELP_ACTIVE = spline_curve(
    (
        -5.307692,
        -4.307692,
        -1.923077,
        -0.884615,
        -0.269231,
        0.230769,
        0.461538,
        0.52725,
        0.62875,
        0.71875,
        0.86125,
        1.045,
        1.2175,
        1.43875,
        1.5,
        1.615385,
        2.0,
        2.961538,
        3.692308,
        5.461538,
        9.901902,
    ),
    (
        0.012188,
        0.021899,
        0.036466,
        0.052493,
        0.075312,
        0.114158,
        0.157859,
        0.226667,
        0.636667,
        0.856667,
        0.95,
        0.993333,
        0.77,
        0.246667,
        0.193821,
        0.133252,
        0.072683,
        0.044417,
        0.036341,
        0.021899,
        0.007332,
    ),
)
DELP_PASSIVE = spline_curve(
    (-5.0, 0.998, 0.999, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.601, 1.602, 5.0),
    (0.0, 0.0, 0.0, 0.0, 0.035, 0.12, 0.26, 0.55, 1.17, 2.0, 2.0, 2.0, 2.0),
).within(0.0, 10.0)
DELP_VELOCITY = spline_curve(
    (-1.001, -1.0, *(0.05 * i - 1.0 for i in range(1, 41))),
    (
        0.0,
        0.0,
        0.010417,
        0.021739,
        0.034091,
        0.047619,
        0.0625,
        0.078947,
        0.097222,
        0.117647,
        0.140625,
        0.166667,
        0.196429,
        0.230769,
        0.270833,
        0.318182,
        0.375,
        0.444444,
        0.53125,
        0.642857,
        0.791667,
        1.0,
        1.482014,
        1.601571,
        1.655791,
        1.686739,
        1.706751,
        1.720753,
        1.731099,
        1.739055,
        1.745365,
        1.75049,
        1.754736,
        1.758312,
        1.761364,
        1.763999,
        1.766298,
        1.768321,
        1.770115,
        1.771717,
        1.773155,
        1.774455,
    ),
).within(0.0)
SCHUTTE_TENDON = spline_curve(
    (
        -10.0,
        -0.002,
        -0.001,
        0.0,
        0.00131,
        0.00281,
        0.00431,
        0.00581,
        0.00731,
        0.00881,
        0.0103,
        0.0118,
        0.0123,
        9.2,
        9.201,
        9.202,
        20.0,
    ),
    (
        0.0,
        0.0,
        0.0,
        0.0,
        0.0108,
        0.0257,
        0.0435,
        0.0652,
        0.0915,
        0.123,
        0.161,
        0.208,
        0.227,
        345.0,
        345.0,
        345.0,
        345.0,
    ),
)
# Normalized velocity up to which the corner of the force-velocity curve is rounded, which changes
# it by at most 0.013
ROUNDED_VELOCITY = 0.01
# Normalized length on both sides of 1 over which the passive force sets in, which changes it by at
# most 0.001
ROUNDED_LENGTH = 0.02
GENERIC_VELOCITY = Curve(
    (
        Piece(
            -np.inf, (1.8,), shapes=(Shape(form=LOGISTIC, size=-1.8, a=0.04 / 0.18, b=1.0 / 0.18),)
        ),
    ),
    bounds=(0.0, np.inf),
)
"""Force-velocity curve of classes without their own in OpenSim's static optimization."""


class RigidTendon(FiberMuscle):
    """RigidTendonMuscle, with the default splines of its curves.

    In OpenSim its fiber velocity is that of the path.
    """

    static_optimization = StaticOptimization(turning=False)
    state = ""
    activated = False

    def curves(self, muscle: Muscle) -> FiberCurves:
        """Curves of SIMM's generic muscle; the class bounds the passive force."""
        return FiberCurves(DELP_ACTIVE, DELP_VELOCITY, DELP_PASSIVE)

    def fibers(
        self, muscle: Muscle, length: Array, speed: Array, a: Array, state: Array | None
    ) -> Fibers:
        """Fibers on a tendon of its slack length.

        Parameters
        ----------
        muscle : of the class
        length, speed : (frames,) of the path [m], [m/s]
        a : (frames,) activation
        state : not read

        Returns
        -------
        arrays (frames,)
        """
        sizes = self.sizes(muscle)
        curves = self.curves(muscle)
        along = np.maximum(length - sizes.tendon, 0.0)
        fiber = np.sqrt(along**2 + sizes.height**2)
        cosine = np.where(fiber > 0.0, along / fiber, 1.0)
        v = speed / sizes.speed
        force = sizes.force
        pulls = a * curves.active(fiber / sizes.fiber) * curves.velocity(v) * force
        elastic = curves.passive(fiber / sizes.fiber) * force
        pull_force = (pulls + elastic) * cosine
        unknown = np.full_like(speed, np.nan)
        return Fibers(
            activation=a,
            fiber_length=fiber,
            tendon_length=np.full_like(length, sizes.tendon),
            pennation=np.arccos(cosine),
            fiber_velocity=speed,
            normalized_velocity=v,
            pennation_velocity=unknown,
            active_force=pulls,
            passive_force=elastic,
            fiber_force=pulls + elastic,
            tendon_force=pull_force,
            active_power=-pulls * speed,
            passive_power=-elastic * speed,
            tendon_power=np.zeros_like(speed),
            muscle_power=-pull_force * speed,
        )


class Schutte1993(MuscleModel):
    """Schutte1993Muscle_Deprecated."""

    def curves(self, muscle: Muscle) -> FiberCurves:
        """Curves: SIMM's active spline, a generic f_V and an exponential f_PE."""
        passive = Curve(
            (Piece(-np.inf, shapes=(Shape(form=EXPONENTIAL, size=1.0, a=-12.0, b=8.0),)),)
        )
        return FiberCurves(DELP_ACTIVE, GENERIC_VELOCITY, passive)

    def resting_tendon(self, muscle: Muscle) -> Curve:
        """Tendon spline over strain, which pulls only where it is stretched."""
        pieces = tuple(piece for piece in SCHUTTE_TENDON.pieces if piece.start >= 0.0)
        return Curve(pieces, SCHUTTE_TENDON.end, (0.0, SCHUTTE_TENDON.slopes[1]))


class Thelen2003(FiberMuscle):
    """Thelen2003Muscle; it has the flags of OpenSim's muscles, but does not read them."""

    times = (0.015, 0.050)
    slowed = 0.75
    elastic = True
    obeys_flags = False
    passive_strain = ("FmaxMuscleStrain", 0.6)

    def curves(self, muscle: Muscle) -> FiberCurves:
        """Curves of Thelen 2003.

        f_L is a bell (eq. 4), f_V a hyperbola each for shortening and lengthening (eq. 6, 7), f_PE
        an exponential (eq. 3).
        """
        width, strain, shape = numbers(
            muscle, KshapeActive=0.45, FmaxMuscleStrain=0.6, KshapePassive=5.0
        )
        return FiberCurves(
            active=_bell(width),
            velocity=_velocity(*_speeds(muscle)),
            passive=_passive(strain, shape),
        )

    def smooth_curves(self, muscle: Muscle) -> FiberCurves:
        """Curves without corners at rest and at optimal length, where no Newton step would end."""
        width, strain, shape = numbers(
            muscle, KshapeActive=0.45, FmaxMuscleStrain=0.6, KshapePassive=5.0
        )
        return FiberCurves(
            active=_bell(width),
            velocity=_rounded_velocity(*_speeds(muscle)),
            passive=_rounded_passive(strain, shape),
        )

    def tendon(self, muscle: Muscle) -> Curve:
        """Tendon curve: an exponential toe and a straight line."""
        toe, force, slope = _tendon_numbers(*numbers(muscle, FmaxTendonStrain=0.04))
        size = force / float(np.expm1(3.0))
        curved = Piece(
            1.0, (-size,), shapes=(Shape(form=EXPONENTIAL, size=size, a=-3.0 / toe, b=3.0 / toe),)
        )
        return Curve((curved, Piece(1.0 + toe, (force, slope))), slopes=(0.0, 0.0))

    def stretch(self, muscle: Muscle) -> Curve:
        """Tendon length over force: a logarithm and a straight line."""
        return _stretch(*numbers(muscle, FmaxTendonStrain=0.04))

    def greatest_pennation(self, muscle: Muscle) -> float:
        """Greatest pennation, the parameter `maximum_pennation_angle` [rad]."""
        return muscle.parameters.get("maximum_pennation_angle", float(np.arccos(0.1)))

    def fiber_damping(self, muscle: Muscle) -> float:
        """Damping of the fibers: none."""
        return 0.0

    def least_activation(self, muscle: Muscle) -> float:
        """Least activation, the parameter `minimum_activation`."""
        return muscle.parameters.get("minimum_activation", 0.01)

    def balancing_velocity(
        self, muscle: Muscle, a: Array, active: Array, passive: Array, pull: Array
    ) -> tuple[Array, Array]:
        """Find the fiber velocity in balance by the inverted force-velocity curve.

        Parameters
        ----------
        muscle : of the class
        a, active, passive : (frames,) activation, f_L and f_PE
        pull : (frames,) normalized tendon force, along the fibers

        Returns
        -------
        v : (frames,) normalized fiber velocity
        f_V : (frames,) there
        """
        return _fiber_velocity(muscle, a, active, pull - passive), (pull - passive) / (a * active)

    def equilibrium(self, muscle: Muscle, length: Array, speed: Array, activation: Array) -> Array:
        """Find the fiber length where fiber and tendon share the path's velocity by stiffness.

        Parameters
        ----------
        muscle : of the class
        length, speed : (frames,) of the path [m], [m/s]
        activation : (frames,)

        Returns
        -------
        (frames,) [m], NaN where there is none
        """
        return _Sharing(
            model=self, muscle=muscle, length=length, speed=speed, activation=activation
        ).solve()


class DeprecatedThelen2003(MuscleModel):
    """Thelen2003Muscle_Deprecated, the class before OpenSim 3."""

    def curves(self, muscle: Muscle) -> FiberCurves:
        """Curves: a bell, and an exponential continued by a straight line of another slope."""
        width, strain, shape = numbers(
            muscle, KshapeActive=0.5, FmaxMuscleStrain=0.6, KshapePassive=4.0
        )
        rise = Shape(form=EXPONENTIAL, size=1.0, a=-shape / strain - shape, b=shape / strain)
        return FiberCurves(
            _bell(width),
            GENERIC_VELOCITY,
            Curve((Piece(-np.inf, shapes=(rise,)),), 1.0 + strain, (0.0, shape / strain)),
        )

    def resting_tendon(self, muscle: Muscle) -> Curve:
        """Tendon curve over strain: an exponential toe and a line, on a weak spring."""
        (strain,) = numbers(muscle, FmaxTendonStrain=0.033)
        toe = 0.609 * strain
        size = 0.333333 / np.expm1(3.0)
        curved = Piece(
            0.0,
            (0.001 - size, 0.001),
            shapes=(Shape(form=EXPONENTIAL, size=size, a=0.0, b=3.0 / toe),),
        )
        line = Piece(toe, (0.333333 + 0.001 * (1.0 + toe), 1.712 / strain + 0.001))
        return Curve((curved, line), slopes=(0.001, 0.0))


class _Sharing(FiberLengthSearch):
    """Search for a fiber length, with the velocity by the fiber's share of the stiffness."""

    max_steps = 20

    def velocity_factor(self, fiber: Array, f_v: Array, turning: bool = True) -> Array:
        """Factor f_V where fiber and tendon share the path's velocity by their stiffness.

            tendon speed = K_fiber / (K_fiber + K_tendon) path speed

        Parameters
        ----------
        fiber : (frames,) length [m]
        f_v : (frames,) the factor so far
        turning : whether the fibers' stiffness counts that they turn as they lengthen

        Returns
        -------
        (frames,)
        """
        sizes = self.sizes
        curves = self.curves
        step = 1e-6 * sizes.fiber
        cosine = np.cos(fiber_pennation(sizes, fiber))

        def pull(x: Array) -> Array:
            """Compute the normalized force of fibers of a length [m] along the tendon."""
            pull = self.a * curves.active(x / sizes.fiber) * f_v + curves.passive(x / sizes.fiber)
            return pull * (np.cos(fiber_pennation(sizes, x)) if turning else cosine)

        fibers = (pull(fiber + step) - pull(fiber - step)) / (2.0 * step) * cosine
        stretch = self.tendon_length(fiber) / sizes.tendon
        tendon = (self.tendon(stretch + 1e-6) - self.tendon(stretch - 1e-6)) / (2e-6 * sizes.tendon)
        shares = (np.abs(fibers + tendon) * sizes.force > EPS**0.875) & (stretch > 1.0)
        of_tendon = np.where(shares, fibers / (fibers + tendon), 1.0) * self.speed
        v = (self.speed - of_tendon) * cosine / sizes.speed
        return _velocity_factor_at(self.muscle, self.a, v)


def _speeds(muscle: Muscle) -> tuple[float, ...]:
    """Shape A_f, greatest force F_len and share of it from which on f_V is straight."""
    return numbers(muscle, Af=0.25, Flen=1.4, fv_linear_extrap_threshold=0.95)


def _fiber_velocity(muscle: Muscle, a: Array, active: Array, force: Array) -> Array:
    """Compute the normalized fiber velocity at an active force, straight beyond the ends.

        v = (0.25 + 0.75 a) (F - a f_L) / b
        b = a f_L + F / A_f                                 F <= a f_L
        b = (2 + 2 / A_f) (a f_L F_len - F) / (F_len - 1)   F > a f_L

    Source: Thelen 2003, eq. 6 and 7.

    Parameters
    ----------
    a, active : (frames,) activation and f_L
    force : (frames,) F, normalized active force

    Returns
    -------
    (frames,)
    """
    shape, most, share = _speeds(muscle)
    isometric = a * active
    at = np.clip(force, 0.0, share * most * isometric)
    shortening = at <= isometric
    b = np.where(
        shortening,
        isometric + at / shape,
        (2.0 + 2.0 / shape) * (isometric * most - at) / (most - 1.0),
    )
    slope = np.where(shortening, 1.0 / shape, -(2.0 + 2.0 / shape) / (most - 1.0))
    speed = 0.25 + 0.75 * a
    return speed * (at - isometric) / b + speed * (1.0 / b - (at - isometric) / b**2 * slope) * (
        force - at
    )


def _velocity_factor_at(muscle: Muscle, a: Array, v: Array) -> Array:
    """Find f_V at which a fiber has a normalized velocity, not below 0.

    Activation stretches the axis of velocities, as in `_fiber_velocity`, of which this is the
    inverse.

    Parameters
    ----------
    a : (frames,) activation
    v : (frames,) normalized fiber velocity

    Returns
    -------
    (frames,)
    """
    return np.maximum(_velocity(*_speeds(muscle))(v / (0.25 + 0.75 * a)), 0.0)


@lru_cache(maxsize=256)
def _bell(width: float) -> Curve:
    """exp(-(x - 1)^2 / width), the active force-length curve of Thelen 2003."""
    rate = 1.0 / np.sqrt(width)
    return Curve((Piece(-np.inf, shapes=(Shape(form=BELL, size=1.0, a=-rate, b=rate),)),))


@lru_cache(maxsize=256)
def _velocity(shape: float, most: float, share: float) -> Curve:
    """Force-velocity curve of Thelen 2003 at full activation; parameters as of `_speeds`."""
    rate = (2.0 + 2.0 / shape) / (most - 1.0)
    last = share * most
    shortening = Piece(
        -1.0, shapes=(Shape(form=RATIO, size=1.0, a=1.0, b=1.0, c=1.0, d=-1.0 / shape),)
    )
    lengthening = Piece(
        0.0, shapes=(Shape(form=RATIO, size=1.0, a=1.0, b=rate * most, c=1.0, d=rate),)
    )
    return Curve((shortening, lengthening), (last - 1.0) / (rate * (most - last)), (0.0, None))


@lru_cache(maxsize=256)
def _passive(strain: float, shape: float) -> Curve:
    """f_PE = (exp(shape (x - 1) / strain) - 1) / (exp(shape) - 1) (Thelen 2003, eq. 3)."""
    size = 1.0 / (float(np.exp(shape)) - 1.0)
    return Curve(
        (
            Piece(
                1.0,
                (-size,),
                shapes=(Shape(form=EXPONENTIAL, size=size, a=-shape / strain, b=shape / strain),),
            ),
        )
    )


@lru_cache(maxsize=256)
def _rounded_velocity(shape: float, most: float, share: float) -> Curve:
    """`_velocity` without its corner at rest."""
    return _velocity(shape, most, share).rounded(0.0, ROUNDED_VELOCITY)


@lru_cache(maxsize=256)
def _rounded_passive(strain: float, shape: float) -> Curve:
    """`_passive` without its corner at optimal length."""
    return _passive(strain, shape).rounded(1.0, ROUNDED_LENGTH)


def _tendon_numbers(strain: float) -> tuple[float, float, float]:
    """Strain and force at the end of the toe of the tendon, and the slope after it."""
    cube = float(np.exp(3.0))
    toe = 99.0 * strain * cube / (166.0 * cube - 67.0)
    return toe, 0.33, 0.67 / (strain - toe)


@lru_cache(maxsize=256)
def _stretch(strain: float) -> Curve:
    """Tendon length by slack length over the normalized force."""
    toe, force, slope = _tendon_numbers(strain)
    curved = Piece(
        0.0,
        (1.0,),
        shapes=(Shape(form=LOGARITHM, size=toe / 3.0, a=1.0, b=float(np.expm1(3.0)) / force),),
    )
    return Curve((curved,), force, (None, 1.0 / slope))
