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

import numpy as np

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.muscles.curves import curve_value
from myomorph.muscles.hill_arrays import CONVENTIONS, Convention, HillArrays, compile_hill, viscosities
from myomorph.rigid.kernels import inner, kernel


@dataclass(frozen=True, eq=False)
class HillForces:
    """What muscles can pull with, along their tendons."""

    active: Array  # (frames, muscles) force per unit activation [N]
    passive: Array  # (frames, muscles) passive elastic force [N]
    viscous: Array  # (frames, muscles) force of the muscles' viscosity, alike in both conventions [N]


@inner(counted=False, forceinline=True)
def rigid_forces(H, m, length, speed, wanted):
    """Active force per unit activation and passive force of muscle m, along the tendon [N].
    `length`, `speed`: of the path [m], [m/s]; `wanted`: whether the passive force is; else it is 0.
    """
    h, curve = H.height[m], H.curve[m]
    along = length - H.tendon[m]
    ended = not along > H.least_along[m]
    if ended:
        along = H.least_along[m]
    fiber = np.sqrt(along * along + h * h)
    cosine = along / fiber if fiber > 0.0 else 1.0
    x = fiber / H.fiber[m]
    passive = H.force[m] * max(curve_value(H.curves, curve[2], x), 0.0) * max(cosine, 0.0) if wanted else 0.0
    v = (speed * cosine if H.turning[m] else speed) / H.speed[m]
    if H.pennation_by[m] >= 0.0:
        cosine = _cosine_of_normalized(H, m, x)
    active = H.force[m] * max(curve_value(H.curves, curve[0], x), 0.0) * max(curve_value(H.curves, curve[1], v), 0.0)
    if np.isnan(length) or np.isnan(speed):
        return np.nan, np.nan
    return 0.0 if ended and H.ends[m] else active * cosine, passive


@inner(counted=False, forceinline=True)
def _cosine_of_normalized(H, m, x):
    """The pennation cosine that OpenSim 4.6 takes in static optimization of some classes.
    For Millard2012EquilibriumMuscle it divides the fibers' height [m] by the normalized instead of the actual fiber
    length.
    """
    if H.height[m] <= 0.0:
        return 1.0
    x *= H.pennation_by[m]
    sine = H.height[m] / x
    most = H.height[m] / H.shortest[m]
    if not (x > H.shortest[m] and sine < most):
        sine = most
    return np.sqrt(1.0 - sine * sine)


@inner(counted=False)
def _pull(H, m, x):
    """Normalized force of fully active resting fibers, at their normalized length."""
    return max(curve_value(H.curves, H.curve[m, 0], x), 0.0) + curve_value(H.curves, H.curve[m, 2], x)


@inner(counted=False)
def _residual(H, m, length, fiber):
    """Tendon force less fiber force, normalized, of a fully active resting muscle."""
    cosine = np.sqrt(max(1.0 - (H.height[m] / fiber) ** 2, 0.0))
    strain = (length - fiber * cosine) / H.tendon[m] - 1.0
    return curve_value(H.curves, H.resting[m], strain) - _pull(H, m, fiber / H.fiber[m]) * cosine


@inner(counted=False)
def isometric_force(H, m, length):
    """Force of a fully active resting muscle on an elastic tendon, passive force included [N].
    The fiber length is found by regula falsi (Illinois).
    """
    h, slack = H.height[m], H.tendon[m]
    if length < slack:
        return 0.0
    longest = np.sqrt((length - slack) ** 2 + h * h)
    if slack < 1e-13:
        return H.force[m] * _pull(H, m, longest / H.fiber[m]) * length / longest
    low = max(h, 1e-6 * H.fiber[m])
    high = longest
    f_low, f_high = _residual(H, m, length, low), _residual(H, m, length, high)
    if not (f_low > 0.0 and f_high < 0.0):
        cosine = (length - slack) / longest if longest > 0.0 else 1.0
        return H.force[m] * curve_value(H.curves, H.resting[m], (length - longest * cosine) / slack - 1.0)
    side = 0
    fiber = high
    for _ in range(100):
        fiber = (f_low * high - f_high * low) / (f_low - f_high)
        error = _residual(H, m, length, fiber)
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
    return H.force[m] * curve_value(H.curves, H.resting[m], (length - fiber * cosine) / slack - 1.0)


@kernel(counted=False)
def _rigid_frames(H, lengths, speeds, wanted, active, passive):
    """`rigid_forces` of all muscles over frames: lengths, speeds, active, passive (frames, muscles)."""
    for frame in range(lengths.shape[0]):
        for m in range(lengths.shape[1]):
            active[frame, m], passive[frame, m] = rigid_forces(H, m, lengths[frame, m], speeds[frame, m], wanted)


@kernel(counted=False)
def _resting_frames(H, lengths, speeds, active, passive):
    """Replace the forces of muscles that are in equilibrium at rest, as OpenSim's static optimization takes them."""
    for m in range(lengths.shape[1]):
        if H.resting[m] < 0:
            continue
        for frame in range(lengths.shape[0]):
            if not np.isnan(active[frame, m]):
                v = H.cos_optimal[m] * speeds[frame, m] / H.speed[m]
                factor = max(curve_value(H.curves, H.curve[m, 1], v), 0.0)
                active[frame, m] = isometric_force(H, m, lengths[frame, m]) * factor
                passive[frame, m] = 0.0


def fill_hill_forces(
    H: HillArrays, lengths: Array, speeds: Array, passive_too: bool, active: Array, passive: Array
) -> None:
    """Fill active and passive (frames, muscles); without `passive_too` the latter with zeros."""
    _rigid_frames(H, lengths, speeds, passive_too, active, passive)
    # A kernel of its own, which models without these classes need not compile.
    if (H.resting >= 0).any():
        _resting_frames(H, lengths, speeds, active, passive)


def hill_forces(model: Model, lengths: Array, velocities: Array, convention: Convention = "rigid-tendon") -> HillForces:
    """Force per unit activation and passive force of every muscle, along its tendon.
    `lengths`, `velocities` (frames, muscles) of the muscle paths, in the model's order [m], [m/s]; `convention`:
    "rigid-tendon" is the formula at the top of this file for every class. "opensim" is what OpenSim 4.6 takes in its
    static optimization, which departs from it in some classes (`MuscleModel.static_optimization`):
    Millard2012EquilibriumMuscle (pennation from the normalized length, so its cosine is nearly 1),
    DeGrooteFregly2016Muscle (no pennation cosine), RigidTendonMuscle (the fibers' velocity is the path's), and the two
    deprecated classes (force of a resting muscle in equilibrium with its elastic tendon, passive force included, times
    a generic force-velocity curve; their `passive` is then 0). Returns HillForces: NaN where a length or velocity is
    NaN.
    """
    if convention not in CONVENTIONS:
        raise BadData(f"unknown convention '{convention}': there are {', '.join(CONVENTIONS)}")
    arrays = compile_hill(model, convention)
    lengths = np.ascontiguousarray(lengths, dtype=np.float64)
    velocities = np.ascontiguousarray(velocities, dtype=np.float64)
    if lengths.ndim != 2 or lengths.shape[1] != len(model.muscles) or velocities.shape != lengths.shape:
        raise BadData(
            f"expected lengths and velocities of shape (frames, {len(model.muscles)}), "
            f"but got {lengths.shape} and {velocities.shape}"
        )
    active, passive = np.empty_like(lengths), np.empty_like(lengths)
    fill_hill_forces(arrays, lengths, velocities, True, active, passive)
    return HillForces(frozen_array(active), frozen_array(passive), frozen_array(viscosities(model) * velocities))
