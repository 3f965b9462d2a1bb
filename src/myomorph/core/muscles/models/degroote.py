"""DeGrooteFregly2016Muscle: its curves (De Groote et al. 2016) and fibers.

The curves are bells, exponentials and an inverse hyperbolic sine.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.paths import Muscle
from myomorph.core.muscles.curves import ASINH, BELL, EXPONENTIAL, LOGARITHM, Curve, Piece, Shape
from myomorph.core.muscles.fiber_equations import TENDON_FORCE, FiberMuscle, Fibers, bisected
from myomorph.core.muscles.muscle_model import (
    NO_PENNATION,
    FiberCurves,
    StaticOptimization,
    numbers,
)

MAX_TENDON_FORCE = 5.0  # Normalized
# f_V = size asinh(rate v + offset) + isometric
SIZE = -0.3211346127989808
RATE = -8.149
OFFSET = -0.374
ISOMETRIC = 0.8825327733249912
TENDON_SIZE = 0.2  # Of f_SE = size exp(stiffness (x - 1)) - size
BELLS = (
    (0.8150671134243542, 1.055033428970575, 0.162384573599574, 0.063303448465465),
    (0.433004984392647, 0.716775413397760, -0.029947116970696, 0.200356847296188),
    (0.1, 1.0, 0.353553390593274, 0.0),
)
"""Size b1, middle b2 and width b3 + b4 x of the bells of f_L = sum b1 exp(-(x - b2)^2 / ...)."""
VELOCITY = Curve(
    (Piece(-np.inf, (ISOMETRIC,), shapes=(Shape(form=ASINH, size=SIZE, a=OFFSET, b=RATE),)),)
)


ForceFactors = tuple[Array, Array]
"""Active force, a f_L, and passive force, f_PE, as shares of the maximum isometric force."""


class FiberSpeeds(NamedTuple):
    """Velocities of fibers and tendon.

    Attributes
    ----------
    normalized : (frames,) fiber velocity v
    force_factor : (frames,) f_V there
    tendon : (frames,) of the tendon [m/s]
    """

    normalized: Array
    force_factor: Array
    tendon: Array


class DeGrooteFregly2016(FiberMuscle):
    """DeGrooteFregly2016Muscle, whose state is the tendon's force."""

    smooth = True
    elastic = True
    passive_strain = ("passive_fiber_strain_at_one_norm_force", 0.6)
    static_optimization = StaticOptimization(bounded=False, pennation_by=NO_PENNATION)
    state = TENDON_FORCE
    first_activation = 0.5

    def curves(self, muscle: Muscle) -> FiberCurves:
        """Curves of the fibers: f_L of three bells, f_V, which goes below 0, exponential f_PE."""
        width, strain = numbers(
            muscle, active_force_width_scale=1.0, passive_fiber_strain_at_one_norm_force=0.6
        )
        left_out = bool(muscle.parameters.get("ignore_passive_fiber_force", 0.0))
        return FiberCurves(_active(width), VELOCITY, _passive(strain, 0.0 if left_out else 1.0))

    def smooth_curves(self, muscle: Muscle) -> FiberCurves:
        """Curves of fibers that do not push."""
        return self.curves(muscle)._replace(velocity=_not_pushing())

    def tendon(self, muscle: Muscle) -> Curve:
        """Tendon curve f_SE = 0.2 (exp(stiffness (x - 1)) - 1)."""
        stiffness = 1.0 / _compliance(muscle)
        rise = Shape(form=EXPONENTIAL, size=TENDON_SIZE, a=-stiffness, b=stiffness)
        return Curve((Piece(-np.inf, (-TENDON_SIZE,), shapes=(rise,)),))

    def stretch(self, muscle: Muscle) -> Curve:
        """Tendon length over force, a logarithm."""
        return _stretch(_compliance(muscle))

    def fibers(
        self, muscle: Muscle, length: Array, speed: Array, a: Array, state: Array | None
    ) -> Fibers:
        """Fibers and tendon from the tendon's force.

        With the tendon's length of its force, the fibers' part along it is the rest of the path,

            f_V = (f_SE / cos(alpha) - f_PE) / (a f_L),   v = f_V^-1(f_V)

        Parameters
        ----------
        muscle : of the class
        length, speed : (frames,) of the path [m], [m/s]
        a : (frames,) activation
        state : (frames,) normalized tendon force; None for a rigid tendon

        Returns
        -------
        arrays (frames,)
        """
        sizes = self.sizes(muscle)
        curves = self.curves(muscle)
        tendon = np.full_like(length, sizes.tendon)
        if state is not None:
            tendon = sizes.tendon * self.stretch(muscle)(state)
        along = length - tendon
        fiber = np.sqrt(along**2 + sizes.height**2)
        cosine = along / fiber
        active = a * curves.active(fiber / sizes.fiber)
        passive = curves.passive(fiber / sizes.fiber)
        speeds = self._speeds(muscle, speed, cosine, state, (active, passive))
        dv = speeds.normalized * sizes.speed
        pulls = active * speeds.force_factor * sizes.force
        elastic = passive * sizes.force
        damped = self.fiber_damping(muscle) * speeds.normalized * sizes.force
        total = pulls + elastic + damped
        tendon_force = total * cosine if state is None else state * sizes.force
        return Fibers(
            activation=a,
            fiber_length=fiber,
            tendon_length=tendon,
            pennation=np.arcsin(sizes.height / fiber),
            fiber_velocity=dv,
            normalized_velocity=speeds.normalized,
            pennation_velocity=-dv / fiber * sizes.height / along,
            active_force=pulls,
            passive_force=elastic + damped,
            fiber_force=total,
            tendon_force=tendon_force,
            active_power=-(pulls + damped) * dv,
            passive_power=-elastic * dv,
            tendon_power=-tendon_force * speeds.tendon,
            muscle_power=-tendon_force * speed,
        )

    def _speeds(
        self,
        muscle: Muscle,
        speed: Array,
        cosine: Array,
        state: Array | None,
        factors: ForceFactors,
    ) -> FiberSpeeds:
        """Compute the velocity of the fibers, of the path on a rigid tendon, else from forces.

        Parameters
        ----------
        muscle : of the class
        speed : (frames,) of the path [m/s]
        cosine : (frames,) of the pennation
        state : (frames,) normalized tendon force; None for a rigid tendon
        factors : a f_L and f_PE, (frames,) each

        Returns
        -------
        arrays (frames,)
        """
        max_speed = self.sizes(muscle).speed
        if state is None:
            v = speed * cosine / max_speed
            factor = self.curves(muscle).velocity(v)
            return FiberSpeeds(normalized=v, force_factor=factor, tendon=np.zeros_like(speed))
        active, passive = factors
        factor = (state / cosine - passive) / active
        v = (np.sinh((factor - ISOMETRIC) / SIZE) - OFFSET) / RATE
        tendon = speed - v * max_speed / cosine
        return FiberSpeeds(normalized=v, force_factor=factor, tendon=tendon)

    def equilibrium(self, muscle: Muscle, length: Array, speed: Array, activation: Array) -> Array:
        """Find the normalized tendon force where the fiber has all of the path's velocity.

        Parameters
        ----------
        muscle : of the class
        length, speed : (frames,) of the path [m], [m/s]
        activation : (frames,)

        Returns
        -------
        (frames,) NaN where there is none up to `MAX_TENDON_FORCE`
        """
        sizes = self.sizes(muscle)
        curves = self.curves(muscle)
        stretch = self.stretch(muscle)

        def residual(force: Array) -> Array:
            """Subtract the fibers' normalized force from the tendon's, (frames,)."""
            along = length - sizes.tendon * stretch(force)
            fiber = np.sqrt(along**2 + sizes.height**2)
            cosine = along / fiber
            v = speed * cosine / sizes.speed
            pull = activation * curves.active(fiber / sizes.fiber) * curves.velocity(v)
            pull += curves.passive(fiber / sizes.fiber) + self.fiber_damping(muscle) * v
            return force - pull * cosine

        return bisected(residual, np.zeros_like(length), np.full_like(length, MAX_TENDON_FORCE))


def _compliance(muscle: Muscle) -> float:
    """Reciprocal of the stiffness of f_SE, which is 1 at the muscle's tendon strain."""
    (strain,) = numbers(muscle, tendon_strain_at_one_norm_force=0.049)
    return strain / float(np.log(6.0))


@lru_cache(maxsize=64)
def _active(width: float) -> Curve:
    """f_L of x = (l - 1) / width + 1."""
    shapes = []
    for size, middle, base, rise in BELLS:
        at_one = 1.0 - 1.0 / width
        rate = 1.0 / width
        half = float(np.sqrt(0.5))
        shapes.append(
            Shape(
                form=BELL,
                size=size,
                a=half * (at_one - middle),
                b=half * rate,
                c=base + rise * at_one,
                d=rise * rate,
            )
        )
    return Curve((Piece(-np.inf, shapes=tuple(shapes)),))


@lru_cache(maxsize=64)
def _passive(strain: float, share: float) -> Curve:
    """f_PE = (exp(4 (x - 1) / strain) - exp(-0.8 4 / strain)) / (exp(4) - ...), not below 0.

    Parameters
    ----------
    share : 1, or 0 where passive force is ignored
    """
    rate = 4.0 / strain
    least = float(np.exp(-0.8 * rate))
    size = share / (float(np.exp(4.0)) - least)
    rise = Piece(
        -np.inf, (-size * least,), shapes=(Shape(form=EXPONENTIAL, size=size, a=-rate, b=rate),)
    )
    return Curve((rise,), bounds=(0.0, np.inf))


@lru_cache(maxsize=64)
def _stretch(compliance: float) -> Curve:
    """Tendon length over force, 1 + compliance log(1 + 5 f)."""
    curved = Piece(-0.199, (1.0,), shapes=(Shape(form=LOGARITHM, size=compliance, a=1.0, b=5.0),))
    return Curve((curved,), slopes=(None, 0.0))


@lru_cache(maxsize=1)
def _not_pushing() -> Curve:
    """f_V, not below 0."""
    return VELOCITY.within(0.0)
