"""The equations of fibers and elastic tendons, class by class, for one muscle over frames."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.paths import Muscle
from myomorph.muscles.hill import active_length_factor, passive_length_factor, velocity_factor
from myomorph.muscles.hill_arrays import HillArrays, compile_hill
from myomorph.muscles.hill_classes import DEGROOTE, KINDS, MILLARD, RIGID, inverse_force_velocity
from myomorph.muscles.hill_curves import Curve, tendon_force_length
from myomorph.rigid.kernels import kernel

UNDAMPED = 0.001
"""Fiber damping below which Millard2012EquilibriumMuscle has none."""

EPS = 2.0**-52
BUCKLED = EPS**0.875
"""SimTK's "significant": a rigid tendon that much shorter than its slack length buckles [m]."""

STEPS = 64
"""Halvings of the bracket of a fiber velocity: to rounding."""


@dataclass(frozen=True, eq=False)
class Fibers:
    """One muscle over time, every array (frames,); several muscles are a `fiber_states.FiberStates`.

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
    active_power, passive_power, tendon_power, muscle_power : positive where force does work on the outside [W]
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


def fibers_of(model: Model, m: int, length: Array, speed: Array, activation: Array, state: Array | None) -> Fibers:
    """Fibers and tendon of muscle m.

    Parameters
    ----------
    length, speed : (frames,) of the path [m], [m/s]
    activation : (frames,)
    state : (frames,) fiber length [m] or normalized tendon force; None for a rigid tendon
    """
    H, muscle = compile_hill(model), model.muscles[m]
    kind = KINDS[muscle.kind]
    a = clamped_activation(muscle, activation)
    # A state far from any balance, which a file may hold, gives infinite numbers as it does in OpenSim.
    with np.errstate(all="ignore"):
        if kind == RIGID:
            return _rigid(H, m, length, speed, a)
        if kind == DEGROOTE:
            return _degroote(H, m, muscle, length, speed, a, state)
        return _clamped_fibers(H, m, muscle, length, speed, a, state)


def clamped_activation(muscle: Muscle, activation: Array) -> Array:
    """The activation within the bounds of the muscle's class."""
    kind = KINDS[muscle.kind]
    if kind in (RIGID, DEGROOTE):
        return np.asarray(activation, dtype=np.float64)
    least = muscle.parameters.get("minimum_activation", 0.01)
    if kind == MILLARD and not _singular(muscle):
        least = 0.0
    return np.clip(activation, least, 1.0)


def _singular(muscle: Muscle) -> bool:
    rigid = bool(muscle.parameters.get("ignore_tendon_compliance", 0.0))
    return not rigid and muscle.parameters.get("fiber_damping", 0.1) < UNDAMPED


def shortest_fiber(H: HillArrays, m: int, muscle: Muscle) -> float:
    """Least fiber length of a muscle [m]; Millard2012EquilibriumMuscle's ends with its active force-length curve."""
    least = float(H.shortest[m])
    if KINDS[muscle.kind] != MILLARD:
        return max(least, 0.0)
    name = "min_norm_active_fiber_length"
    end = muscle.parameters.get(f"ActiveForceLengthCurve/{name}", muscle.parameters.get(name, 0.4441))
    return max(least, BUCKLED, end * float(H.fiber[m]))


def pennation(H: HillArrays, m: int, fiber: Array) -> Array:
    """Angle of fibers of a length, bounded at the shortest [rad]."""
    if H.height[m] <= 0.0:
        return np.zeros_like(fiber)
    most = np.arctan2(H.height[m], H.shortest_along[m])
    sine = np.minimum(H.height[m] / np.maximum(fiber, H.shortest[m]), 1.0)
    return np.where((fiber > H.shortest[m]) & (sine < np.sin(most)), np.arcsin(sine), most)


def fiber_at(H: HillArrays, m: int, along: Array) -> Array:
    """Length of fibers whose part along the tendon is given, not below the greatest pennation's [m]."""
    return np.where(along >= H.shortest_along[m], np.sqrt(along**2 + H.height[m] ** 2), H.shortest[m])


def length_factors(H: HillArrays, m: int, x: Array) -> tuple[Array, Array]:
    """f_L and f_PE of muscle m at normalized fiber lengths (frames,)."""
    active, passive = np.empty_like(x), np.empty_like(x)
    _length_factors(H, m, x, active, passive)
    return active, passive


def velocity_factors(H: HillArrays, m: int, v: Array) -> Array:
    """f_V of muscle m at normalized fiber velocities (frames,)."""
    result = np.empty_like(v)
    _velocity_factors(H, m, v, result)
    return result


@kernel
def _length_factors(H, m, x, active, passive):
    for index in range(x.shape[0]):
        active[index] = active_length_factor(H, m, x[index])
        passive[index] = passive_length_factor(H, m, x[index])


@kernel
def _velocity_factors(H, m, v, found):
    for index in range(v.shape[0]):
        found[index] = velocity_factor(H, m, v[index])


def tendon_factor(muscle: Muscle, stretch: Array) -> Array:
    """f_SE at tendon lengths over the slack length, of the two classes with a fiber length as state."""
    if KINDS[muscle.kind] == MILLARD:
        return millard_tendon(muscle)(stretch)
    toe, toe_force, slope = thelen_tendon(muscle)
    strain = stretch - 1.0
    curved = toe_force / np.expm1(3.0) * np.expm1(3.0 * np.clip(strain, 0.0, toe) / toe)
    return np.where(strain > toe, slope * (strain - toe) + toe_force, np.where(strain > 0.0, curved, 0.0))


def thelen_tendon(muscle: Muscle) -> tuple[float, float, float]:
    """Strain and force at the end of the toe of Thelen2003Muscle's tendon, and the slope after it."""
    e0, cube = muscle.parameters.get("FmaxTendonStrain", 0.04), np.exp(3.0)
    toe = 99.0 * e0 * cube / (166.0 * cube - 67.0)
    return toe, 0.33, 0.67 / (e0 - toe)


def millard_tendon(muscle: Muscle) -> Curve:
    """Normalized force of Millard2012EquilibriumMuscle's tendon over its length by its slack length."""
    names = ("strain_at_one_norm_force", "stiffness_at_one_norm_force", "norm_force_at_toe_end", "curviness")
    own = [muscle.parameters.get(f"TendonForceLengthCurve/{name}") for name in names]
    strain, *shape = own
    return _tendon_curve(0.049 if strain is None else strain, *(shape if None not in shape else (None, None, None)))


@lru_cache(maxsize=64)
def _tendon_curve(strain: float, stiffness: float | None, toe: float | None, curviness: float | None) -> Curve:
    if stiffness is None or toe is None or curviness is None:
        return tendon_force_length(strain)
    return tendon_force_length(strain, stiffness, toe, curviness)


def _clamped_fibers(
    H: HillArrays, m: int, muscle: Muscle, length: Array, speed: Array, a: Array, state: Array | None
) -> Fibers:
    """Thelen2003Muscle and Millard2012EquilibriumMuscle, whose fibers have a least length."""
    shortest, slack, force = shortest_fiber(H, m, muscle), H.tendon[m], H.force[m]
    if state is None:
        fiber = np.maximum(fiber_at(H, m, length - slack), shortest)
    else:
        fiber = np.maximum(state, shortest)
    angle = pennation(H, m, fiber)
    cosine, sine = np.cos(angle), np.sin(angle)
    active, passive = length_factors(H, m, fiber / H.fiber[m])
    tendon = length - fiber * cosine
    damping = muscle.parameters.get("fiber_damping", 0.1) if KINDS[muscle.kind] == MILLARD else 0.0
    if state is None:
        buckled = tendon < slack - BUCKLED
        v = np.where(buckled, 0.0, speed * cosine / H.speed[m])
        f_v = np.where(buckled, 1.0, velocity_factors(H, m, v))
        pull = np.full_like(v, np.nan)
    else:
        pull = tendon_factor(muscle, tendon / slack)
        v, f_v = _balancing_velocity(H, m, muscle, a, active, passive, pull / cosine)
    unstretched = fiber if state is None else np.asarray(state)
    stuck = (unstretched <= shortest) & (v <= 0.0)
    v, f_v = np.where(stuck, 0.0, v), np.where(stuck, 1.0, f_v)
    dv = v * H.speed[m]
    turning = -dv / fiber * np.tan(angle) if muscle.pennation_at_optimal > EPS else np.zeros_like(dv)
    tendon_speed = speed - dv * cosine + fiber * sine * turning
    if state is None:
        tendon_speed = np.where(stuck, speed, 0.0)
    pulls = np.where(stuck, 0.0, a * active * f_v) * force
    elastic, damped = passive * force, damping * v * force
    if KINDS[muscle.kind] == MILLARD:
        elastic = np.where(stuck, 0.0, elastic)
    if state is None:
        damped = np.where(pulls + elastic + damped < 0.0, -pulls - elastic, damped)
    total = np.where(stuck, 0.0, pulls + elastic + damped)
    pull_force = total * cosine if state is None else pull * force
    return Fibers(
        a, fiber, tendon, angle, dv, v, turning, pulls, elastic + damped, total, pull_force,
        -(pulls + damped) * dv, -elastic * dv, -pull_force * tendon_speed, -pull_force * speed,
    )  # fmt: skip


def _balancing_velocity(
    H: HillArrays, m: int, muscle: Muscle, a: Array, active: Array, passive: Array, pull: Array
) -> tuple[Array, Array]:
    """Normalized fiber velocity at which the fibers pull as wanted (normalized), and f_V there."""
    if KINDS[muscle.kind] != MILLARD:
        v = thelen_velocity(muscle, a, active, pull - passive)
        return v, (pull - passive) / (a * active)
    if _singular(muscle):
        f_v = (pull - passive) / (a * active)
        return inverse_force_velocity(muscle)(f_v), f_v
    damping = muscle.parameters.get("fiber_damping", 0.1)
    rest, most = pull - passive, a * active * float(velocity_factors(H, m, np.array([1e6]))[0])
    low, high = (rest - most) / damping, rest / damping
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        above = a * active * velocity_factors(H, m, middle) + damping * middle > rest
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    v = 0.5 * (low + high)
    return v, velocity_factors(H, m, v)


def thelen_velocity(muscle: Muscle, a: Array, active: Array, force: Array) -> Array:
    """Normalized fiber velocity at a normalized active force, straight beyond the ends (Thelen 2003, eq. 6 and 7)."""
    shape, most = muscle.parameters.get("Af", 0.25), muscle.parameters.get("Flen", 1.4)
    last = muscle.parameters.get("fv_linear_extrap_threshold", 0.95) * most
    isometric = a * active
    at = np.clip(force, 0.0, last * isometric)
    shortening = at <= isometric
    b = np.where(shortening, isometric + at / shape, (2.0 + 2.0 / shape) * (isometric * most - at) / (most - 1.0))
    slope = np.where(shortening, 1.0 / shape, -(2.0 + 2.0 / shape) / (most - 1.0))
    speed = 0.25 + 0.75 * a
    return speed * (at - isometric) / b + speed * (1.0 / b - (at - isometric) / b**2 * slope) * (force - at)


def _degroote(
    H: HillArrays, m: int, muscle: Muscle, length: Array, speed: Array, a: Array, state: Array | None
) -> Fibers:
    force, slack = H.force[m], H.tendon[m]
    tendon = np.full_like(length, slack) if state is None else slack * degroote_stretch(muscle, state)
    along = length - tendon
    fiber = np.sqrt(along**2 + H.height[m] ** 2)
    cosine, angle = along / fiber, np.arcsin(H.height[m] / fiber)
    active, passive = length_factors(H, m, fiber / H.fiber[m])
    if state is None:
        v = speed * cosine / H.speed[m]
        f_v = degroote_velocity_factor(v)
        tendon_speed = np.zeros_like(speed)
    else:
        f_v = (state / cosine - passive) / (a * active)
        v = _degroote_velocity(f_v)
        tendon_speed = speed - v * H.speed[m] / cosine
    dv = v * H.speed[m]
    pulls, elastic = a * active * f_v * force, passive * force
    damped = muscle.parameters.get("fiber_damping", 0.0) * v * force
    total = pulls + elastic + damped
    pull_force = total * cosine if state is None else state * force
    turning = -dv / fiber * H.height[m] / along
    return Fibers(
        a, fiber, tendon, angle, dv, v, turning, pulls, elastic + damped, total, pull_force,
        -(pulls + damped) * dv, -elastic * dv, -pull_force * tendon_speed, -pull_force * speed,
    )  # fmt: skip


def _degroote_velocity(f_v: Array) -> Array:
    return (np.sinh((f_v - 0.8825327733249912) / -0.3211346127989808) + 0.374) / -8.149


def degroote_velocity_factor(v: Array) -> Array:
    """f_V of De Groote et al. 2016, at normalized velocities (frames,)."""
    return -0.3211346127989808 * np.arcsinh(-8.149 * v - 0.374) + 0.8825327733249912


def degroote_stretch(muscle: Muscle, force: Array) -> Array:
    """Tendon length over slack length at a normalized tendon force."""
    stiffness = np.log(6.0) / muscle.parameters.get("tendon_strain_at_one_norm_force", 0.049)
    return np.log(5.0 * (force + 0.2)) / stiffness + 1.0


def _rigid(H: HillArrays, m: int, length: Array, speed: Array, a: Array) -> Fibers:
    """RigidTendonMuscle, whose fiber velocity is the path's in OpenSim."""
    along = np.maximum(length - H.tendon[m], 0.0)
    fiber = np.sqrt(along**2 + H.height[m] ** 2)
    cosine = np.where(fiber > 0.0, along / fiber, 1.0)
    active, passive = length_factors(H, m, fiber / H.fiber[m])
    v, force = speed / H.speed[m], H.force[m]
    pulls, elastic = a * active * velocity_factors(H, m, v) * force, passive * force
    pull_force = (pulls + elastic) * cosine
    unknown = np.full_like(speed, np.nan)
    return Fibers(
        a, fiber, np.full_like(length, H.tendon[m]), np.arccos(cosine), speed, v, unknown, pulls, elastic,
        pulls + elastic, pull_force, -pulls * speed, -elastic * speed, np.zeros_like(speed), -pull_force * speed,
    )  # fmt: skip
