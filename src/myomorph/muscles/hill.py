"""Hill-type muscles with a rigid tendon: force per unit activation and passive force.

With the tendon at its slack length, length and velocity of the path give those of the fiber, and
the force along the tendon is linear in the activation a (F0 maximum isometric force, l and v
normalized fiber length and velocity, alpha pennation):

    F = a F0 f_L(l) f_V(v) cos(alpha) + F0 f_PE(l) cos(alpha)

Beside it stands the force of a damper along the whole path, `Muscle.viscosity` times the lengthening velocity
([S] eq. 3), which may push. Fiber damping of Millard2012EquilibriumMuscle is not part of these forces.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.muscles.hill_arrays import HillArrays, compile_hill
from myomorph.muscles.hill_classes import (
    ACCELERATION,
    DEGROOTE,
    DEPRECATED_THELEN,
    MILLARD,
    MUJOCO,
    RIGID,
    SCHUTTE,
    THELEN,
)
from myomorph.muscles.hill_curves import curve_value
from myomorph.rigid.kernels import inner, kernel


@inner(forceinline=True)
def active_length_factor(H, m, x):
    """f_L of muscle m at the normalized fiber length x."""
    kind = H.kind[m]
    if H.curve[m, 0] >= 0:
        return curve_value(H.curves, H.curve[m, 0], x)
    if kind == DEGROOTE:
        x = (x - 1.0) / H.parameters[m, 0] + 1.0
        one = (x - 1.055033428970575) / (0.162384573599574 + 0.063303448465465 * x)
        two = (x - 0.716775413397760) / (-0.029947116970696 + 0.200356847296188 * x)
        three = (x - 1.0) / 0.353553390593274
        return (
            0.8150671134243542 * np.exp(-0.5 * one * one)
            + 0.433004984392647 * np.exp(-0.5 * two * two)
            + 0.1 * np.exp(-0.5 * three * three)
        )
    if kind == MUJOCO:
        low, high = H.parameters[m, 0], H.parameters[m, 1]
        if x < low or x > high:
            return 0.0
        if x <= 1.0:
            middle = 0.5 * (low + 1.0)
            if x <= middle:
                u = (x - low) / max(1e-15, middle - low)
                return 0.5 * u * u
            u = (1.0 - x) / max(1e-15, 1.0 - middle)
            return 1.0 - 0.5 * u * u
        middle = 0.5 * (1.0 + high)
        if x <= middle:
            u = (x - 1.0) / max(1e-15, middle - 1.0)
            return 1.0 - 0.5 * u * u
        u = (high - x) / max(1e-15, high - middle)
        return 0.5 * u * u
    return np.exp(-(x - 1.0) * (x - 1.0) / H.parameters[m, 0])


@inner(forceinline=True)
def velocity_factor(H, m, v):
    """f_V of muscle m, fully active, at the normalized fiber velocity v (negative: shortening); never below 0."""
    kind = H.kind[m]
    if H.curve[m, 1] >= 0 and kind != SCHUTTE:
        return max(curve_value(H.curves, H.curve[m, 1], v), 0.0)
    if kind == THELEN:
        shape, most = H.parameters[m, 3], H.parameters[m, 4]
        if v <= -1.0:
            return 0.0
        if v <= 0.0:
            return (1.0 + v) / (1.0 - v / shape)
        k = (2.0 + 2.0 / shape) / (most - 1.0)
        last = H.parameters[m, 5] * most
        f = (1.0 + v * k * most) / (1.0 + v * k)
        if f < last:
            return f
        b = k * (most - last)
        start = (last - 1.0) / b
        return last + (v - start) / (1.0 / b + (last - 1.0) * k / (b * b))
    if kind == DEGROOTE:
        return max(-0.3211346127989808 * np.arcsinh(-8.149 * v - 0.374) + 0.8825327733249912, 0.0)
    if kind == MUJOCO:
        most = H.parameters[m, 3]
        if v <= -1.0:
            return 0.0
        if v <= 0.0:
            return (v + 1.0) * (v + 1.0)
        if v <= most - 1.0:
            return most - (most - 1.0 - v) ** 2 / max(1e-15, most - 1.0)
        return most
    return 1.8 - 1.8 / (1.0 + np.exp((0.04 + v) / 0.18))


@inner(forceinline=True)
def passive_length_factor(H, m, x):
    """f_PE of muscle m at the normalized fiber length x; never below 0."""
    kind = H.kind[m]
    if H.curve[m, 2] >= 0:
        return min(max(curve_value(H.curves, H.curve[m, 2], x), 0.0), 10.0 if kind == RIGID else np.inf)
    if kind == THELEN:
        return (
            (np.exp(H.parameters[m, 2] * (x - 1.0) / H.parameters[m, 1]) - 1.0) / (np.exp(H.parameters[m, 2]) - 1.0)
            if x > 1.0
            else 0.0
        )
    if kind == DEGROOTE:
        least = np.exp(4.0 * (0.2 - 1.0) / H.parameters[m, 1])
        return H.parameters[m, 2] * max(
            (np.exp(4.0 * (x - 1.0) / H.parameters[m, 1]) - least) / (np.exp(4.0) - least), 0.0
        )
    if kind == MUJOCO:
        middle = 0.5 * (1.0 + H.parameters[m, 1])
        if x <= 1.0:
            return 0.0
        u = (x - 1.0) / max(1e-15, middle - 1.0)
        return H.parameters[m, 2] * (0.5 * u * u if x <= middle else u - 0.5)
    if kind == SCHUTTE:
        return np.exp(8.0 * (x - 1.0) - 4.0)
    if x > 1.0 + H.parameters[m, 1]:
        return 1.0 + H.parameters[m, 2] / H.parameters[m, 1] * (x - 1.0 - H.parameters[m, 1])
    return np.exp(H.parameters[m, 2] * (x - 1.0) / H.parameters[m, 1] - H.parameters[m, 2])


Convention = Literal["rigid-tendon", "opensim"]
CONVENTIONS: tuple[Convention, ...] = ("rigid-tendon", "opensim")


@dataclass(frozen=True, eq=False)
class HillForces:
    """What muscles can pull with, along their tendons.

    Attributes
    ----------
    active : (frames, muscles) force per unit activation [N]
    passive : (frames, muscles) passive elastic force [N]
    viscous : (frames, muscles) force of the muscles' viscosity, alike in both conventions [N]
    """

    active: Array
    passive: Array
    viscous: Array


@inner(forceinline=True)
def rigid_forces(H, m, length, speed, opensim, wanted):
    """Active force per unit activation and passive force of muscle m, along the tendon [N].

    Parameters
    ----------
    length, speed : of the path [m], [m/s]
    opensim : whether to follow OpenSim's static optimization where it departs from the formula
    wanted : whether the passive force is; else it is 0
    """
    kind, h = H.kind[m], H.height[m]
    along = length - H.tendon[m]
    clamped = False
    if kind <= ACCELERATION:
        clamped = not along > H.shortest_along[m]
        if clamped:
            along = H.shortest_along[m]
    elif kind != MUJOCO and (kind != DEGROOTE or not opensim):
        along = max(along, 0.0)
    fiber = np.sqrt(along * along + h * h) if kind != MUJOCO else along
    cosine = along / fiber if fiber > 0.0 and kind != MUJOCO else 1.0
    x = fiber / H.fiber[m]
    passive = H.force[m] * passive_length_factor(H, m, x) * max(cosine, 0.0) if wanted else 0.0
    v = speed * cosine / H.speed[m]
    if opensim:
        if kind == MILLARD:
            cosine = _cosine_of_normalized(H, m, x)
        elif kind == DEGROOTE:
            cosine = 1.0
        elif kind == RIGID:
            v = speed / H.speed[m]
    active = H.force[m] * max(active_length_factor(H, m, x), 0.0) * velocity_factor(H, m, v) * cosine
    if np.isnan(length) or np.isnan(speed):
        return np.nan, np.nan
    return 0.0 if clamped else active, passive


@inner(forceinline=True)
def _cosine_of_normalized(H, m, x):
    """The pennation cosine OpenSim 4.6 takes for Millard2012EquilibriumMuscle in static optimization.

    It divides the fibers' height [m] by the normalized instead of the actual fiber length.
    """
    if H.height[m] <= 0.0:
        return 1.0
    sine = H.height[m] / x
    most = H.height[m] / H.shortest[m]
    if not (x > H.shortest[m] and sine < most):
        sine = most
    return np.sqrt(1.0 - sine * sine)


@inner
def _tendon_factor(H, m, strain):
    if H.kind[m] == SCHUTTE:
        return curve_value(H.curves, H.curve[m, 1], strain) if strain > 0.0 else 0.0
    toe = 0.609 * H.parameters[m, 3]
    if strain > toe:
        force = 1.712 / H.parameters[m, 3] * (strain - toe) + 0.333333
    elif strain > 0.0:
        force = 0.333333 * (np.exp(3.0 * strain / toe) - 1.0) / (np.exp(3.0) - 1.0)
    else:
        force = 0.0
    return force + 0.001 * (1.0 + strain)


@inner
def _imbalance(H, m, length, fiber):
    """Tendon force less fiber force, normalized, of a fully active resting muscle."""
    cosine = np.sqrt(max(1.0 - (H.height[m] / fiber) ** 2, 0.0))
    x = fiber / H.fiber[m]
    pull = max(active_length_factor(H, m, x), 0.0) + passive_length_factor(H, m, x)
    return _tendon_factor(H, m, (length - fiber * cosine) / H.tendon[m] - 1.0) - pull * cosine


@inner
def isometric_force(H, m, length):
    """Force of a fully active resting muscle on an elastic tendon, passive force included [N].

    Of the two deprecated classes; the fiber length is found by regula falsi (Illinois).
    """
    h, slack = H.height[m], H.tendon[m]
    if length < slack:
        return 0.0
    longest = np.sqrt((length - slack) ** 2 + h * h)
    if slack < 1e-13:
        x = longest / H.fiber[m]
        pull = max(active_length_factor(H, m, x), 0.0) + passive_length_factor(H, m, x)
        return H.force[m] * pull * length / longest
    low = max(h, 1e-6 * H.fiber[m])
    high = longest
    f_low, f_high = _imbalance(H, m, length, low), _imbalance(H, m, length, high)
    if not (f_low > 0.0 and f_high < 0.0):
        cosine = (length - slack) / longest if longest > 0.0 else 1.0
        return H.force[m] * _tendon_factor(H, m, (length - longest * cosine) / slack - 1.0)
    side = 0
    fiber = high
    for _ in range(100):
        fiber = (f_low * high - f_high * low) / (f_low - f_high)
        error = _imbalance(H, m, length, fiber)
        if abs(error) < 1e-10 or high - low < 1e-13 * H.fiber[m]:
            break
        if error > 0.0:
            low, f_low = fiber, error
            if side == 1:
                f_high *= 0.5
            side = 1
        else:
            high, f_high = fiber, error
            if side == -1:
                f_low *= 0.5
            side = -1
    cosine = np.sqrt(max(1.0 - (h / fiber) ** 2, 0.0))
    return H.force[m] * _tendon_factor(H, m, (length - fiber * cosine) / slack - 1.0)


@kernel
def _rigid_frames(H, lengths, speeds, opensim, wanted, active, passive):
    """`rigid_forces` of all muscles over frames: lengths, speeds, active, passive (frames, muscles)."""
    for frame in range(lengths.shape[0]):
        for m in range(lengths.shape[1]):
            active[frame, m], passive[frame, m] = rigid_forces(
                H, m, lengths[frame, m], speeds[frame, m], opensim, wanted
            )


@kernel
def _elastic_frames(H, lengths, speeds, active, passive):
    """Replace the forces of the deprecated classes by what OpenSim's static optimization takes."""
    for m in range(lengths.shape[1]):
        if H.kind[m] != DEPRECATED_THELEN and H.kind[m] != SCHUTTE:
            continue
        for frame in range(lengths.shape[0]):
            if not np.isnan(active[frame, m]):
                v = H.cos_optimal[m] * speeds[frame, m] / H.speed[m]
                active[frame, m] = isometric_force(H, m, lengths[frame, m]) * velocity_factor(H, m, v)
                passive[frame, m] = 0.0


def fill_hill_forces(
    H: HillArrays,
    lengths: Array,
    speeds: Array,
    convention: Convention,
    passive_too: bool,
    active: Array,
    passive: Array,
) -> None:
    """Fill active and passive (frames, muscles); without `passive_too` the latter with zeros."""
    opensim = convention == "opensim"
    _rigid_frames(H, lengths, speeds, opensim, passive_too, active, passive)
    # A kernel of its own, which models without these classes need not compile.
    if opensim and ((H.kind == DEPRECATED_THELEN) | (H.kind == SCHUTTE)).any():
        _elastic_frames(H, lengths, speeds, active, passive)


def hill_forces(model: Model, lengths: Array, velocities: Array, convention: Convention = "rigid-tendon") -> HillForces:
    """Force per unit activation and passive force of every muscle, along its tendon.

    Parameters
    ----------
    lengths, velocities : (frames, muscles) of the muscle paths, in the model's order [m], [m/s]
    convention : "rigid-tendon" is the formula at the top of this file for every class. "opensim" is
        what OpenSim 4.6 takes in its static optimization, which departs from it in three classes:
        Millard2012EquilibriumMuscle (pennation from the normalized length, so its cosine is nearly
        1), DeGrooteFregly2016Muscle (no pennation cosine), and the two deprecated classes (force of
        a resting muscle in equilibrium with its elastic tendon, passive force included, times a
        generic force-velocity curve; their `passive` is then 0).

    Returns
    -------
    HillForces
        NaN where a length or velocity is NaN

    Raises
    ------
    BadData
        where the arrays do not have one column a muscle
    BadModel
        for a class whose curves are not known
    """
    arrays = compile_hill(model)
    lengths = np.ascontiguousarray(lengths, dtype=np.float64)
    velocities = np.ascontiguousarray(velocities, dtype=np.float64)
    if lengths.ndim != 2 or lengths.shape[1] != len(model.muscles) or velocities.shape != lengths.shape:
        raise BadData(
            f"expected lengths and velocities of shape (frames, {len(model.muscles)}), "
            f"but got {lengths.shape} and {velocities.shape}"
        )
    if convention not in CONVENTIONS:
        raise BadData(f"unknown convention '{convention}': there are {', '.join(CONVENTIONS)}")
    active, passive = np.empty_like(lengths), np.empty_like(lengths)
    fill_hill_forces(arrays, lengths, velocities, convention, True, active, passive)
    return HillForces(frozen_array(active), frozen_array(passive), frozen_array(viscosities(model) * velocities))


def viscosities(model: Model) -> Array:
    """(muscles,) viscosity of each muscle [N s/m], 0 of one that is switched off."""
    return np.array([muscle.viscosity if muscle.enabled else 0.0 for muscle in model.muscles])
