"""Fibers and tendons of classes of muscles that have states, one muscle over frames.

States and conventions are OpenSim's.
Fiber lengths and tendon forces at which both pull alike are found by OpenSim's search: a Newton
iteration with halved steps from a tendon stretched by 1 %, so that of several solutions the same
one is found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.paths import Muscle
from myomorph.core.muscles.muscle_model import FiberSizes, MuscleModel

ACTIVATION = "activation"
FIBER_LENGTH = "fiber_length"
TENDON_FORCE = "normalized_tendon_force"
EPS = 2.0**-52
# SimTK's "significant": a rigid tendon that much shorter than its slack length buckles [m]
BUCKLED = EPS**0.875
NUDGE = EPS**0.5  # Step of a search that Newton's method does not move [m]
BISECTIONS = 60  # Halvings of an interval down to rounding


@dataclass(frozen=True, eq=False)
class Fibers:
    """One muscle over time, every array (frames,); `fiber_states.FiberStates` has several.

    Attributes
    ----------
    activation : as the class clamps it
    fiber_length, tendon_length : [m]
    pennation : angle between fibers and tendon [rad]
    fiber_velocity : lengthening [m/s]
    normalized_velocity : by the maximum contraction velocity
    pennation_velocity : [rad/s]
    active_force, passive_force, fiber_force : along the fibers [N]
    tendon_force : along the tendon, what the muscle pulls with [N]
    active_power, passive_power, tendon_power, muscle_power : positive where force does work on the
        outside [W]
    """

    activation: Array
    fiber_length: Array
    tendon_length: Array
    pennation: Array
    fiber_velocity: Array
    normalized_velocity: Array
    pennation_velocity: Array
    active_force: Array
    passive_force: Array
    fiber_force: Array
    tendon_force: Array
    active_power: Array
    passive_power: Array
    tendon_power: Array
    muscle_power: Array


class FiberGeometry(NamedTuple):
    """Path, fibers and tendon of one muscle over time, every array (frames,).

    Attributes
    ----------
    path_length, path_speed : of the muscle-tendon unit [m], [m/s]
    fiber : length of the fibers [m]
    angle : pennation [rad]
    """

    path_length: Array
    path_speed: Array
    fiber: Array
    angle: Array

    @property
    def cosine(self) -> Array:
        """Cosine of the pennation."""
        return np.cos(self.angle)

    @property
    def tendon(self) -> Array:
        """Length of the tendon [m]."""
        return self.path_length - self.fiber * self.cosine


class ForceFactors(NamedTuple):
    """Normalized forces of one muscle over time, every array (frames,).

    Attributes
    ----------
    active, passive : f_L and f_PE at the fiber length
    v : normalized fiber velocity
    f_v : f_V there
    tendon : normalized force of an elastic tendon, None for a rigid one
    """

    active: Array
    passive: Array
    v: Array
    f_v: Array
    tendon: Array | None


class FiberMuscle(MuscleModel):
    """A class whose fibers and tendon have states, as in tables of OpenSim's MuscleAnalysis.

    `fibers` and `equilibrium` are those of fibers that have a least length, at which they are stuck
    (Thelen2003Muscle, Millard2012EquilibriumMuscle). A class without one replaces both.

    Attributes
    ----------
    state : beside activation, `FIBER_LENGTH`, `TENDON_FORCE` or none
    activated : whether activation is a state
    first_activation : its value where no file has it
    rests_when_stuck : whether fibers at their least length have no passive force
    """

    state: str = FIBER_LENGTH
    activated: bool = True
    first_activation: float = 0.05
    rests_when_stuck: bool = False

    def states(self, muscle: Muscle) -> tuple[str, ...]:
        """Names of the states that OpenSim gives a muscle."""
        flags = muscle.parameters if self.obeys_flags else {}
        names = []
        if self.activated and not flags.get("ignore_activation_dynamics"):
            names.append(ACTIVATION)
        if self.state and not flags.get("ignore_tendon_compliance"):
            names.append(self.state)
        return tuple(names)

    def first_state(self, muscle: Muscle, name: str) -> float:
        """Value of a state where no file has it."""
        first = {ACTIVATION: self.first_activation, FIBER_LENGTH: 0.1, TENDON_FORCE: 0.5}[name]
        return float(muscle.parameters.get(f"default_{name}", first))

    def least_activation(self, muscle: Muscle) -> float | None:
        """Lower bound that the class sets to activation, None where it has none."""
        return None

    def activation(self, muscle: Muscle, activation: Array) -> Array:
        """Clamp activation to the bounds of the class.

        Parameters
        ----------
        muscle : of the class
        activation : (frames,)

        Returns
        -------
        (frames,)
        """
        least = self.least_activation(muscle)
        if least is None:
            return np.asarray(activation, dtype=np.float64)
        return np.clip(activation, least, 1.0)

    def shortest_fiber(self, muscle: Muscle) -> float:
        """Least fiber length of a muscle [m]."""
        return max(self.sizes(muscle).shortest, 0.0)

    def balancing_velocity(
        self, muscle: Muscle, a: Array, active: Array, passive: Array, pull: Array
    ) -> tuple[Array, Array]:
        """Find the fiber velocity at which the fibers pull as the tendon does.

            a f_L f_V(v) + f_PE + damping v = pull

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
        raise NotImplementedError

    def equilibrium(self, muscle: Muscle, length: Array, speed: Array, activation: Array) -> Array:
        """Find the state in equilibrium.

        Parameters
        ----------
        muscle : of the class
        length, speed : (frames,) of the path [m], [m/s]
        activation : (frames,)

        Returns
        -------
        (frames,) NaN where there is none
        """
        raise NotImplementedError

    def fibers(
        self, muscle: Muscle, length: Array, speed: Array, a: Array, state: Array | None
    ) -> Fibers:
        """Fibers and tendon of a muscle with a known state.

        Parameters
        ----------
        muscle : of the class
        length, speed : (frames,) of the path [m], [m/s]
        a : (frames,) activation within the class's bounds
        state : (frames,) fiber length [m] or normalized tendon force; None for a rigid tendon

        Returns
        -------
        arrays (frames,)
        """
        sizes = self.sizes(muscle)
        shortest = self.shortest_fiber(muscle)
        unbounded = fiber_at(sizes, length - sizes.tendon) if state is None else np.asarray(state)
        fiber = np.maximum(unbounded, shortest)
        geometry = FiberGeometry(
            path_length=length, path_speed=speed, fiber=fiber, angle=fiber_pennation(sizes, fiber)
        )
        factors = self._factors(muscle, geometry, a, state is None)
        # Fibers at their shortest do not shorten further, and then pull with nothing.
        unstretched = fiber if state is None else unbounded
        stuck = (unstretched <= shortest) & (factors.v <= 0.0)
        factors = factors._replace(
            v=np.where(stuck, 0.0, factors.v), f_v=np.where(stuck, 1.0, factors.f_v)
        )
        return self._forces(muscle, geometry, a, factors, stuck)

    def _factors(
        self, muscle: Muscle, geometry: FiberGeometry, a: Array, is_rigid: bool
    ) -> ForceFactors:
        """Compute normalized forces and fiber velocity, as if fibers had no least length.

        Parameters
        ----------
        a : (frames,) activation
        is_rigid : whether the tendon is, so that fibers have the path's velocity
        """
        sizes = self.sizes(muscle)
        curves = self.curves(muscle)
        active = curves.active(geometry.fiber / sizes.fiber)
        passive = curves.passive(geometry.fiber / sizes.fiber)
        if is_rigid:
            buckled = geometry.tendon < sizes.tendon - BUCKLED
            v = np.where(buckled, 0.0, geometry.path_speed * geometry.cosine / sizes.speed)
            f_v = np.where(buckled, 1.0, curves.velocity(v))
            pull = None
        else:
            pull = self.tendon(muscle)(geometry.tendon / sizes.tendon)
            along_fibers = pull / geometry.cosine
            v, f_v = self.balancing_velocity(muscle, a, active, passive, along_fibers)
        return ForceFactors(active=active, passive=passive, v=v, f_v=f_v, tendon=pull)

    def _forces(
        self,
        muscle: Muscle,
        geometry: FiberGeometry,
        a: Array,
        factors: ForceFactors,
        stuck: np.ndarray,
    ) -> Fibers:
        """Compute forces, velocities and powers of fibers and tendon.

        Parameters
        ----------
        a : (frames,) activation
        stuck : (frames,) whether fibers are at their shortest
        """
        sizes = self.sizes(muscle)
        force = sizes.force
        is_rigid = factors.tendon is None
        fiber_speed = factors.v * sizes.speed
        turning = np.zeros_like(fiber_speed)
        if muscle.pennation_at_optimal > EPS:
            turning = -fiber_speed / geometry.fiber * np.tan(geometry.angle)
        if is_rigid:
            tendon_speed = np.where(stuck, geometry.path_speed, 0.0)
        else:
            tendon_speed = (
                geometry.path_speed
                - fiber_speed * geometry.cosine
                + geometry.fiber * np.sin(geometry.angle) * turning
            )

        active = np.where(stuck, 0.0, a * factors.active * factors.f_v) * force
        elastic = factors.passive * force
        damped = self.fiber_damping(muscle) * factors.v * force
        if self.rests_when_stuck:
            elastic = np.where(stuck, 0.0, elastic)
        if is_rigid:
            # Fibers on a rigid tendon do not push: the damper gives no more than they pull.
            damped = np.where(active + elastic + damped < 0.0, -active - elastic, damped)
        total = np.where(stuck, 0.0, active + elastic + damped)
        if factors.tendon is None:
            tendon_force = total * geometry.cosine
        else:
            tendon_force = factors.tendon * force
        return Fibers(
            activation=a,
            fiber_length=geometry.fiber,
            tendon_length=geometry.tendon,
            pennation=geometry.angle,
            fiber_velocity=fiber_speed,
            normalized_velocity=factors.v,
            pennation_velocity=turning,
            active_force=active,
            passive_force=elastic + damped,
            fiber_force=total,
            tendon_force=tendon_force,
            active_power=-(active + damped) * fiber_speed,
            passive_power=-elastic * fiber_speed,
            tendon_power=-tendon_force * tendon_speed,
            muscle_power=-tendon_force * geometry.path_speed,
        )


def fiber_pennation(sizes: FiberSizes, fiber: Array) -> Array:
    """Pennation of fibers, sin(alpha) = height / length, bounded at the shortest.

    Parameters
    ----------
    sizes : of the muscle
    fiber : (frames,) length [m]

    Returns
    -------
    (frames,) [rad]
    """
    if sizes.height <= 0.0:
        return np.zeros_like(fiber)
    greatest = np.arctan2(sizes.height, sizes.shortest_along)
    sine = np.minimum(sizes.height / np.maximum(fiber, sizes.shortest), 1.0)
    is_free = (fiber > sizes.shortest) & (sine < np.sin(greatest))
    return np.where(is_free, np.arcsin(sine), greatest)


def fiber_at(sizes: FiberSizes, along: Array) -> Array:
    """Length of fibers by their part along the tendon, not below the shortest.

    Parameters
    ----------
    sizes : of the muscle
    along : (frames,) part along the tendon [m]

    Returns
    -------
    (frames,) [m]
    """
    return np.where(
        along >= sizes.shortest_along, np.sqrt(along**2 + sizes.height**2), sizes.shortest
    )


class FiberLengthSearch:
    """Search for a muscle's fiber length in equilibrium, with fibers at rest.

        (a f_L f_V + f_PE) cos(alpha) = f_SE

    Parameters
    ----------
    model : class of the muscle
    muscle : of the class
    length, speed : (frames,) of the path [m], [m/s]
    activation : (frames,)

    Attributes
    ----------
    max_steps : of Newton's method
    """

    max_steps = 200

    def __init__(
        self, model: FiberMuscle, muscle: Muscle, length: Array, speed: Array, activation: Array
    ):
        self.muscle = muscle
        self.sizes = model.sizes(muscle)
        self.curves = model.curves(muscle)
        self.tendon = model.tendon(muscle)
        self.shortest = model.shortest_fiber(muscle)
        self.length = length
        self.speed = speed
        self.a = np.asarray(activation, dtype=np.float64)

    def velocity_factor(self, fiber: Array, f_v: Array, turning: bool = True) -> Array:
        """Factor f_V of fibers of a length.

        Parameters
        ----------
        fiber : (frames,) length [m]
        f_v : (frames,) the factor so far
        turning : whether the fibers' stiffness counts that they turn as they lengthen

        Returns
        -------
        (frames,)
        """
        return f_v

    def tendon_length(self, fiber: Array) -> Array:
        """Tendon length at a fiber length.

        Parameters
        ----------
        fiber : (frames,) [m]

        Returns
        -------
        (frames,) [m]
        """
        return self.length - fiber * np.cos(fiber_pennation(self.sizes, fiber))

    def error(self, fiber: Array, f_v: Array) -> Array:
        """Force of the fibers along the tendon less that of the tendon.

        Parameters
        ----------
        fiber : (frames,) length [m]
        f_v : (frames,)

        Returns
        -------
        (frames,) [N]
        """
        x = fiber / self.sizes.fiber
        cosine = np.cos(fiber_pennation(self.sizes, fiber))
        pull = (self.a * self.curves.active(x) * f_v + self.curves.passive(x)) * cosine
        tendon_pull = self.tendon(self.tendon_length(fiber) / self.sizes.tendon)
        return self.sizes.force * (pull - tendon_pull)

    def slope(self, fiber: Array, f_v: Array) -> Array:
        """Slope of the error over the fiber length, by differences.

        Parameters
        ----------
        fiber, f_v : as of `error`

        Returns
        -------
        (frames,) [N/m]
        """
        step = 1e-6 * self.sizes.fiber
        return (self.error(fiber + step, f_v) - self.error(fiber - step, f_v)) / (2.0 * step)

    def solve(self) -> Array:
        """Search by Newton's method from a tendon stretched by 1 %.

        Returns
        -------
        (frames,) fiber length [m], NaN where none is found
        """
        start = fiber_at(self.sizes, self.length - 1.01 * self.sizes.tendon)
        fiber = np.maximum(start, self.shortest)
        # OpenSim's first guess of the stiffness has no force yet that turns with the fibers.
        f_v = self.velocity_factor(fiber, np.ones_like(fiber), turning=False)
        error = self.error(fiber, f_v)
        slope = self.slope(fiber, f_v)
        tolerance = max(1e-8 * self.sizes.force, 10.0 * EPS**0.875)
        for _ in range(self.max_steps):
            is_open = np.abs(error) > tolerance
            if not is_open.any():
                break
            fiber, error = self._stepped(fiber, f_v, error, slope, is_open)
            # The velocity follows only now: error and slope of a step are those of the velocity
            # before it.
            slope = self.slope(fiber, f_v)
            f_v = np.where(is_open, self.velocity_factor(fiber, f_v), f_v)
        balanced = (np.abs(error) < tolerance) | (fiber <= self.shortest)
        return np.where(np.isfinite(self.length) & balanced, fiber, np.nan)

    def _stepped(
        self, fiber: Array, f_v: Array, error: Array, slope: Array, pending: np.ndarray
    ) -> tuple[Array, Array]:
        """Take one Newton step, halved until the error falls.

        Parameters
        ----------
        fiber, f_v, error, slope : (frames,) before the step
        pending : (frames,) whether each takes a step

        Returns
        -------
        fiber, error : (frames,) after it
        """
        new = fiber.copy()
        new_error = error.copy()
        share = 1.0
        while pending.any():
            step = -share * error / slope
            is_small = ~(np.abs(step) > BUCKLED)
            moved = np.where(is_small, fiber - np.sign(step) * NUDGE, fiber + step)
            moved = np.maximum(moved, self.shortest)
            new = np.where(pending, moved, new)
            new_error = np.where(pending, self.error(new, f_v), new_error)
            too_small = np.abs(step) <= BUCKLED
            pending = pending & ~too_small & (np.abs(new_error) >= np.abs(error))
            if share <= NUDGE:
                break
            share *= 0.5
        return new, new_error


def bisected(residual: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Find the zero of a function between bounds.

    Parameters
    ----------
    residual : takes and gives (frames,)
    low, high : (frames,)

    Returns
    -------
    (frames,) NaN where the function has the same sign at both bounds
    """
    rising = residual(high) > 0.0
    crossed = (residual(low) > 0.0) != rising
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        above = (residual(middle) > 0.0) == rising
        low = np.where(above, low, middle)
        high = np.where(above, middle, high)
    return np.where(crossed, 0.5 * (low + high), np.nan)
