"""Classes of muscles with the states that OpenSim gives them: what fibers and tendon do, one muscle
over frames.

Fiber lengths and tendon forces at which both pull alike are found by OpenSim's search: a Newton
iteration with halved steps from a tendon stretched by 1 %, so that of several solutions the same
one is found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

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


@dataclass(frozen=True, eq=False)
class Fibers:
    """One muscle over time, every array (frames,); several muscles are a
    `fiber_states.FiberStates`.
    """

    activation: Array  # as the class clamps it
    # fiber_length, tendon_length: [m]
    fiber_length: Array
    tendon_length: Array
    pennation: Array  # angle between fibers and tendon [rad]
    fiber_velocity: Array  # lengthening [m/s]
    normalized_velocity: Array  # by the maximum contraction velocity
    pennation_velocity: Array  # [rad/s]
    # active_force, passive_force, fiber_force: along the fibers [N]
    active_force: Array
    passive_force: Array
    fiber_force: Array
    tendon_force: Array  # along the tendon, what the muscle pulls with [N]
    # active_power, passive_power, tendon_power, muscle_power: positive where force does work on the
    # outside [W]
    active_power: Array
    passive_power: Array
    tendon_power: Array
    muscle_power: Array


class FiberMuscle(MuscleModel):
    """A class whose fibers and tendon have states, as in tables of OpenSim's MuscleAnalysis.
    `fibers` and `equilibrium` are those of fibers that have a least length, at which they are stuck
    (Thelen2003Muscle, Millard2012EquilibriumMuscle); a class without one replaces both.
    `state`: the state beside activation, `FIBER_LENGTH`, `TENDON_FORCE` or none; `activated`:
    whether activation is a state; `first_activation`: its value where no file gives it;
    `rests_when_stuck`: whether fibers at their least length have no passive force.
    """

    state: str = FIBER_LENGTH
    activated: bool = True
    first_activation: float = 0.05
    rests_when_stuck: bool = False

    def states(self, muscle: Muscle) -> tuple[str, ...]:
        """The states that OpenSim gives a muscle, as it names them."""
        flags = muscle.parameters if self.obeys_flags else {}
        active = (
            (ACTIVATION,) if self.activated and not flags.get("ignore_activation_dynamics") else ()
        )
        return (
            (*active, self.state)
            if self.state and not flags.get("ignore_tendon_compliance")
            else active
        )

    def first_state(self, muscle: Muscle, name: str) -> float:
        """The value of a state where no file gives it."""
        first = {ACTIVATION: self.first_activation, FIBER_LENGTH: 0.1, TENDON_FORCE: 0.5}[name]
        return float(muscle.parameters.get(f"default_{name}", first))

    def least_activation(self, muscle: Muscle) -> float | None:
        """The activation from which the class takes every lower one for it; None where it takes all
        as they are.
        """
        return None

    def activation(self, muscle: Muscle, activation: Array) -> Array:
        """The activation within the bounds of the class."""
        least = self.least_activation(muscle)
        return (
            np.asarray(activation, dtype=np.float64)
            if least is None
            else np.clip(activation, least, 1.0)
        )

    def shortest_fiber(self, muscle: Muscle) -> float:
        """Least fiber length of a muscle [m]."""
        return max(self.sizes(muscle).shortest, 0.0)

    def balancing_velocity(
        self, muscle: Muscle, a: Array, active: Array, passive: Array, pull: Array
    ) -> tuple[Array, Array]:
        """Normalized fiber velocity at which the fibers pull as the tendon does, and f_V there.
        `a`, `active`, `passive` (frames,) activation, f_L and f_PE; `pull` (frames,) normalized
        force along the fibers.
        """
        raise NotImplementedError

    def equilibrium(self, muscle: Muscle, length: Array, speed: Array, activation: Array) -> Array:
        """The state in equilibrium, (frames,), NaN where none exists; parameters as of `fibers`."""
        raise NotImplementedError

    def fibers(
        self, muscle: Muscle, length: Array, speed: Array, a: Array, state: Array | None
    ) -> Fibers:
        """Fibers and tendon.
        `length`, `speed` (frames,) of the path [m], [m/s]; `a` (frames,) activation within the
        class's bounds; `state` (frames,) fiber length [m] or normalized tendon force; None for a
        rigid tendon.
        """
        sizes = self.sizes(muscle)
        curves = self.curves(muscle)
        shortest = self.shortest_fiber(muscle)
        slack = sizes.tendon
        force = sizes.force
        if state is None:
            fiber = np.maximum(fiber_at(sizes, length - slack), shortest)
        else:
            fiber = np.maximum(state, shortest)
        angle = fiber_pennation(sizes, fiber)
        cosine = np.cos(angle)
        sine = np.sin(angle)
        active = curves.active(fiber / sizes.fiber)
        passive = curves.passive(fiber / sizes.fiber)
        tendon = length - fiber * cosine
        if state is None:
            buckled = tendon < slack - BUCKLED
            v = np.where(buckled, 0.0, speed * cosine / sizes.speed)
            f_v = np.where(buckled, 1.0, curves.velocity(v))
            pull = np.full_like(v, np.nan)
        else:
            pull = self.tendon(muscle)(tendon / slack)
            v, f_v = self.balancing_velocity(muscle, a, active, passive, pull / cosine)
        unstretched = fiber if state is None else np.asarray(state)
        stuck = (unstretched <= shortest) & (v <= 0.0)
        v = np.where(stuck, 0.0, v)
        f_v = np.where(stuck, 1.0, f_v)
        dv = v * sizes.speed
        turning = (
            -dv / fiber * np.tan(angle) if muscle.pennation_at_optimal > EPS else np.zeros_like(dv)
        )
        tendon_speed = speed - dv * cosine + fiber * sine * turning
        if state is None:
            tendon_speed = np.where(stuck, speed, 0.0)
        pulls = np.where(stuck, 0.0, a * active * f_v) * force
        elastic = passive * force
        damped = self.fiber_damping(muscle) * v * force
        if self.rests_when_stuck:
            elastic = np.where(stuck, 0.0, elastic)
        if state is None:
            damped = np.where(pulls + elastic + damped < 0.0, -pulls - elastic, damped)
        total = np.where(stuck, 0.0, pulls + elastic + damped)
        pull_force = total * cosine if state is None else pull * force
        return Fibers(
            activation=a,
            fiber_length=fiber,
            tendon_length=tendon,
            pennation=angle,
            fiber_velocity=dv,
            normalized_velocity=v,
            pennation_velocity=turning,
            active_force=pulls,
            passive_force=elastic + damped,
            fiber_force=total,
            tendon_force=pull_force,
            active_power=-(pulls + damped) * dv,
            passive_power=-elastic * dv,
            tendon_power=-pull_force * tendon_speed,
            muscle_power=-pull_force * speed,
        )


def fiber_pennation(sizes: FiberSizes, fiber: Array) -> Array:
    """Angle of fibers of a length, bounded at the shortest [rad]."""
    if sizes.height <= 0.0:
        return np.zeros_like(fiber)
    most = np.arctan2(sizes.height, sizes.shortest_along)
    sine = np.minimum(sizes.height / np.maximum(fiber, sizes.shortest), 1.0)
    return np.where((fiber > sizes.shortest) & (sine < np.sin(most)), np.arcsin(sine), most)


def fiber_at(sizes: FiberSizes, along: Array) -> Array:
    """Length of fibers by their part along the tendon, not below the greatest pennation's [m]."""
    return np.where(
        along >= sizes.shortest_along, np.sqrt(along**2 + sizes.height**2), sizes.shortest
    )


NUDGE = EPS**0.5


class FiberLengthSearch:
    """The search for a muscle's fiber length, with fibers at rest.
    `length`, `speed` (frames,) of the path [m], [m/s]; `activation` (frames,). `steps`: most Newton
    steps.
    """

    steps = 200

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
        """f_V of fibers that are as long; `turning` is whether a stiffness counts that they turn."""
        return f_v

    def tendon_length(self, fiber: Array) -> Array:
        """(frames,) [m]."""
        return self.length - fiber * np.cos(fiber_pennation(self.sizes, fiber))

    def error(self, fiber: Array, f_v: Array) -> Array:
        """Fibers' pull along the tendon less the tendon's [N]."""
        x = fiber / self.sizes.fiber
        pull = (self.a * self.curves.active(x) * f_v + self.curves.passive(x)) * np.cos(
            fiber_pennation(self.sizes, fiber)
        )
        return self.sizes.force * (
            pull - self.tendon(self.tendon_length(fiber) / self.sizes.tendon)
        )

    def slope(self, fiber: Array, f_v: Array) -> Array:
        """Slope of the error over the fiber length [N/m]."""
        step = 1e-6 * self.sizes.fiber
        return (self.error(fiber + step, f_v) - self.error(fiber - step, f_v)) / (2.0 * step)

    def solve(self) -> Array:
        """(frames,) fiber length [m], NaN where none is found."""
        fiber = np.maximum(
            fiber_at(self.sizes, self.length - 1.01 * self.sizes.tendon), self.shortest
        )
        # OpenSim's first guess of the stiffness has no force yet that turns with the fibers.
        f_v = self.velocity_factor(fiber, np.ones_like(fiber), turning=False)
        error = self.error(fiber, f_v)
        slope = self.slope(fiber, f_v)
        tolerance = max(1e-8 * self.sizes.force, 10.0 * EPS**0.875)
        for _ in range(self.steps):
            wanted = np.abs(error) > tolerance
            if not wanted.any():
                break
            fiber, error = self._stepped(fiber, f_v, error, slope, wanted)
            # The velocity follows only now: error and slope of a step are those of the velocity
            # before it.
            slope = self.slope(fiber, f_v)
            f_v = np.where(wanted, self.velocity_factor(fiber, f_v), f_v)
        settled = np.isfinite(self.length) & (
            (np.abs(error) < tolerance) | (fiber <= self.shortest)
        )
        return np.where(settled, fiber, np.nan)

    def _stepped(
        self, fiber: Array, f_v: Array, error: Array, slope: Array, wanted: np.ndarray
    ) -> tuple[Array, Array]:
        """One Newton step, halved until the error falls, of the frames that are wanted."""
        new = fiber.copy()
        best = error.copy()
        h = 1.0
        open_ = wanted
        while open_.any():
            step = -h * error / slope
            moved = np.where(np.abs(step) > EPS**0.875, fiber + step, fiber - np.sign(step) * NUDGE)
            stuck = np.abs(step) <= EPS**0.875
            moved = np.maximum(moved, self.shortest)
            new = np.where(open_, moved, new)
            best = np.where(open_, self.error(new, f_v), best)
            open_ = open_ & ~stuck & (np.abs(best) >= np.abs(error))
            if h <= NUDGE:
                break
            h *= 0.5
        return new, best


def bisected(residual: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Zero of a function between bounds, NaN where it has the same sign at both."""
    rising = residual(high) > 0.0
    crossed = (residual(low) > 0.0) != rising
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = (residual(middle) > 0.0) == rising
        low = np.where(above, low, middle)
        high = np.where(above, middle, high)
    return np.where(crossed, 0.5 * (low + high), np.nan)
