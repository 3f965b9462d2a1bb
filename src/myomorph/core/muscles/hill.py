"""Hill-type muscles as flat arrays, which kernels read: with rigid tendons, and with elastic ones.

A new class is one line of `OWN_MODELS`, and a module with the class. With a rigid tendon at its
slack length, length and velocity of the path give those of the fiber, and the force along the
tendon is linear in the activation a (F0 maximum isometric force, l and v normalized fiber length
and velocity, alpha pennation; Zajac 1989):

    F = a F0 f_L(l) f_V(v) cos(alpha) + F0 f_PE(l) cos(alpha)

Beside it stands the force of a damper along the whole path, `Muscle.viscosity` times the
lengthening velocity ([S] eq. 3), which may push. Fiber damping of Millard2012EquilibriumMuscle is
not part of these forces.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, frozen_array
from myomorph.core.model.errors import BadData, BadModel
from myomorph.core.model.extension import load
from myomorph.core.model.latest import Latest
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle
from myomorph.core.model.registry import with_extensions
from myomorph.core.model.shapes import MuscleValues
from myomorph.core.muscles.curves import Curve, CurveArrays, curve_value, pack_curves
from myomorph.core.muscles.muscle_model import (
    FiberCurves,
    FiberSizes,
    MuscleModel,
    StaticOptimization,
)
from myomorph.core.rigid.kernels import inner, kernel

OWN_MODELS = {
    "Thelen2003Muscle": "myomorph.core.muscles.models.thelen:Thelen2003",
    "Millard2012EquilibriumMuscle": "myomorph.core.muscles.models.millard:Millard2012",
    "Millard2012AccelerationMuscle": "myomorph.core.muscles.models.millard:Millard2012Acceleration",
    "DeGrooteFregly2016Muscle": "myomorph.core.muscles.models.degroote:DeGrooteFregly2016",
    "RigidTendonMuscle": "myomorph.core.muscles.models.thelen:RigidTendon",
    "Thelen2003Muscle_Deprecated": "myomorph.core.muscles.models.thelen:DeprecatedThelen2003",
    "Schutte1993Muscle_Deprecated": "myomorph.core.muscles.models.thelen:Schutte1993",
    "mujoco": "myomorph.core.muscles.models.mujoco:MujocoMuscle",
}
MODELS: dict[str, str] = with_extensions(
    OWN_MODELS, "muscle model", lambda extension: extension.muscle_models
)
"""Places of the classes of muscles, by their names in files."""


def muscle_model(muscle: Muscle) -> MuscleModel:
    """Find the class of a muscle.

    Raises
    ------
    BadModel : the curves of the muscle's class are not known
    """
    if muscle.kind not in MODELS:
        raise BadModel(
            f"muscle '{muscle.name}' is a {muscle.kind}: curves are known for {', '.join(MODELS)}"
        )
    return loaded(MODELS[muscle.kind])


@lru_cache(maxsize=64)
def loaded(place: str) -> MuscleModel:
    """Load the class at a place of `MODELS`."""
    return load(place)()


Convention = Literal["rigid-tendon", "opensim"]
CONVENTIONS: tuple[Convention, ...] = ("rigid-tendon", "opensim")


class HillArrays(NamedTuple):
    """Muscles as the kernels read them.

    Attributes
    ----------
    force, fiber, tendon, height, shortest, shortest_along, cos_optimal, speed : (muscles,) sizes,
        see `FiberSizes`
    least_along : (muscles,) least part of the fibers along the tendon [m]
    ends : (muscles,) whether fibers have no active force there
    turning : (muscles,) whether the path's velocity is projected on the fibers
    pennation_by : (muscles,) see `StaticOptimization`, -1 for None
    curve : (muscles, 3) rows in `curves` of the active, velocity and passive curve
    resting : (muscles,) row of the curve of the tendon with which a muscle is in equilibrium at
        rest, -1 for a rigid one
    curves : of all muscles
    """

    force: Array
    fiber: Array
    tendon: Array
    height: Array
    shortest: Array
    shortest_along: Array
    cos_optimal: Array
    speed: Array
    least_along: Array
    ends: NDArray[np.bool_]
    turning: NDArray[np.bool_]
    pennation_by: Array
    curve: NDArray[np.int64]
    resting: NDArray[np.int64]
    curves: CurveArrays


class ElasticArrays(NamedTuple):
    """Muscles and their tendons as the kernels read them.

    Rows of muscles without an elastic tendon are not used.

    Attributes
    ----------
    hill : sizes
    curve : (muscles, 4) rows in `curves` of the active, velocity and passive curve, and of the
        tendon's length over normalized force
    curves : of all muscles
    damping : (muscles,) of the fibers, normalized
    passive : (muscles,) 1 where the passive force of the fibers takes part, else 0
    slowed : (muscles,) see `MuscleModel.slowed`
    """

    hill: HillArrays
    curve: NDArray[np.int64]
    curves: CurveArrays
    damping: Array
    passive: Array
    slowed: Array


def muscle_models(model: Model) -> list[MuscleModel]:
    """Find the classes of the model's muscles, in the model's order."""
    return [muscle_model(muscle) for muscle in model.muscles]


def compile_hill(model: Model, convention: Convention = "rigid-tendon") -> HillArrays:
    """Compile the model's muscles to flat arrays; the same model compiles once.

    Parameters
    ----------
    model : with muscles
    convention : see `hill_forces`

    Raises
    ------
    BadModel : a muscle's class or curve is not known, or a size is not positive
    """
    return _latest[convention](model)


def compile_hill_as(model: Model, like: Model) -> HillArrays:
    """Compile a model that differs from another in sizes of its muscles alone.

    Forces, fiber and tendon lengths may differ. What was compiled of the other is used again.

    Parameters
    ----------
    model : to compile
    like : the other one, with the same muscles in the same order
    """
    sizes = _size_arrays(model)
    compiled = compile_hill(like)._replace(**sizes, least_along=sizes["shortest_along"])
    _latest["rigid-tendon"].put(model, compiled)
    return compiled


def has_elastic_tendon(muscle: Muscle) -> bool:
    """Whether the class of a muscle has a tendon with a curve, and the model lets it stretch."""
    return muscle.kind in MODELS and muscle_model(muscle).has_elastic_tendon(muscle)


@lru_cache(maxsize=8)
def compile_elastic(model: Model, passive: bool) -> ElasticArrays:
    """Compile the model's muscles and tendons to flat arrays, in the model's order.

    Parameters
    ----------
    model : with muscles
    passive : whether the passive force of the fibers takes part
    """
    count = len(model.muscles)
    table = _NumberedCurves()
    curve = np.full((count, 4), -1, np.int64)
    damping = np.zeros(count)
    slowed = np.zeros(count)
    for m, (muscle, kind) in enumerate(zip(model.muscles, muscle_models(model), strict=True)):
        if kind.has_elastic_tendon(muscle):
            curve[m] = table.numbers([*kind.smooth_curves(muscle), kind.stretch(muscle)])
            damping[m] = kind.fiber_damping(muscle)
            damping[m] *= damping[m] >= kind.undamped
            slowed[m] = kind.slowed
    return ElasticArrays(
        hill=compile_hill(model),
        curve=curve,
        curves=pack_curves(table.curves),
        damping=damping,
        passive=np.full(count, float(passive)),
        slowed=slowed,
    )


def activation_times(model: Model) -> Array:
    """Time constants of activation and deactivation.

    Parameters
    ----------
    model : with muscles

    Returns
    -------
    (2, muscles) [s]
    """
    result = np.empty((2, len(model.muscles)))
    for m, (muscle, kind) in enumerate(zip(model.muscles, muscle_models(model), strict=True)):
        rise, fall = kind.times
        result[:, m] = [
            muscle.parameters.get("activation_time_constant", rise),
            muscle.parameters.get("deactivation_time_constant", fall),
        ]
    return result


def viscosities(model: Model) -> Array:
    """Viscosity of each muscle, 0 of one that is switched off.

    Parameters
    ----------
    model : with or without muscles

    Returns
    -------
    (muscles,) [N s/m]
    """
    return np.array([muscle.viscosity if muscle.enabled else 0.0 for muscle in model.muscles])


class _NumberedCurves:
    """Curves and their numbers; the same curve of several muscles has one."""

    def __init__(self) -> None:
        self.curves: list[Curve] = []
        self._number: dict[Curve, int] = {}

    def numbers(self, curves: Iterable[Curve]) -> list[int]:
        """Numbers of curves, which are added where they are new."""
        for curve in curves:
            if curve not in self._number:
                self._number[curve] = len(self.curves)
                self.curves.append(curve)
        return [self._number[curve] for curve in curves]


def _compile(model: Model, convention: Convention) -> HillArrays:
    """Compile muscles to flat arrays."""
    models = muscle_models(model)
    table = _NumberedCurves()
    is_opensim = convention == "opensim"
    pairs = list(zip(models, model.muscles, strict=True))
    curve = np.empty((len(pairs), 3), np.int64)
    resting = np.full(len(pairs), -1, np.int64)
    for m, (kind, muscle) in enumerate(pairs):
        curve[m] = table.numbers(_checked_curves(kind, muscle))
        tendon = kind.resting_tendon(muscle) if is_opensim else None
        if tendon is not None:
            resting[m] = table.numbers([tendon])[0]

    sizes = _size_arrays(model)
    rules = [kind.static_optimization if is_opensim else StaticOptimization() for kind in models]
    bounded = [rule.bounded for rule in rules]
    ends = [kind.greatest_pennation(muscle) is not None for kind, muscle in pairs]
    factors = [-1.0 if rule.pennation_by is None else rule.pennation_by for rule in rules]
    return HillArrays(
        force=sizes["force"],
        fiber=sizes["fiber"],
        tendon=sizes["tendon"],
        height=sizes["height"],
        shortest=sizes["shortest"],
        shortest_along=sizes["shortest_along"],
        cos_optimal=sizes["cos_optimal"],
        speed=sizes["speed"],
        least_along=np.where(bounded, sizes["shortest_along"], -np.inf),
        ends=np.array(ends, np.bool_),
        turning=np.array([rule.turning for rule in rules], np.bool_),
        pennation_by=np.array(factors),
        curve=curve,
        resting=resting,
        curves=pack_curves(table.curves),
    )


def _checked_curves(kind: MuscleModel, muscle: Muscle) -> FiberCurves:
    """Curves of a muscle whose sizes can be used; errors name the muscle."""
    if not (muscle.optimal_fiber_length > 0 and muscle.max_contraction_velocity > 0):
        raise BadModel(
            f"muscle '{muscle.name}' has optimal fiber length {muscle.optimal_fiber_length:g} m"
            f" and maximum contraction velocity {muscle.max_contraction_velocity:g}/s: both"
            " must be positive"
        )
    try:
        return kind.curves(muscle)
    except BadModel as error:
        raise BadModel(f"muscle '{muscle.name}': {error}") from error


_latest = {
    convention: Latest(partial(_compile, convention=convention)) for convention in CONVENTIONS
}


def _size_arrays(model: Model) -> dict[str, Any]:
    """Arrays (muscles,) of each field of `FiberSizes`."""
    rows = [
        kind.sizes(muscle) for kind, muscle in zip(muscle_models(model), model.muscles, strict=True)
    ]
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(FiberSizes._fields))
    return {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(FiberSizes._fields)}


@dataclass(frozen=True, eq=False)
class HillForces:
    """Forces of muscles along their tendons.

    Attributes
    ----------
    active : (frames, muscles) per unit activation [N]
    passive : (frames, muscles) passive elastic force [N]
    viscous : (frames, muscles) force of the muscles' viscosity, alike in both conventions [N]
    """

    active: MuscleValues
    passive: MuscleValues
    viscous: MuscleValues


@inner(counted=False, forceinline=True)
def rigid_forces(H, m, length, speed, wanted):
    """Active force per unit activation and passive force of a muscle with a rigid tendon.

    With the part of the fibers along the tendon x = length - slack length and the fibers' height h,
    the fiber length is sqrt(x^2 + h^2) and cos(alpha) = x / fiber length:

        active = F0 f_L f_V cos(alpha),   passive = F0 f_PE cos(alpha)

    Parameters
    ----------
    H : `HillArrays`
    m : number of the muscle
    length, speed : of the path [m], [m/s]
    wanted : whether the passive force is computed, else it is 0

    Returns
    -------
    active, passive : along the tendon [N]; NaN where length or speed is
    """
    h = H.height[m]
    curve = H.curve[m]
    along = length - H.tendon[m]
    ended = not along > H.least_along[m]
    if ended:
        along = H.least_along[m]
    fiber = np.sqrt(along * along + h * h)
    cosine = along / fiber if fiber > 0.0 else 1.0
    x = fiber / H.fiber[m]
    passive = (
        H.force[m] * max(curve_value(H.curves, curve[2], x), 0.0) * max(cosine, 0.0)
        if wanted
        else 0.0
    )
    v = (speed * cosine if H.turning[m] else speed) / H.speed[m]
    if H.pennation_by[m] >= 0.0:
        cosine = _cosine_of_normalized(H, m, x)
    active = (
        H.force[m]
        * max(curve_value(H.curves, curve[0], x), 0.0)
        * max(curve_value(H.curves, curve[1], v), 0.0)
    )
    if np.isnan(length) or np.isnan(speed):
        return np.nan, np.nan
    return 0.0 if ended and H.ends[m] else active * cosine, passive


@inner(counted=False, forceinline=True)
def _cosine_of_normalized(H, m, x):
    """Pennation cosine that OpenSim 4.6 takes in static optimization of some classes.

    For Millard2012EquilibriumMuscle it divides the fibers' height [m] by the normalized instead of
    the actual fiber length x.
    """
    if H.height[m] <= 0.0:
        return 1.0
    x *= H.pennation_by[m]
    sine = H.height[m] / x
    max_sine = H.height[m] / H.shortest[m]
    if not (x > H.shortest[m] and sine < max_sine):
        sine = max_sine
    return np.sqrt(1.0 - sine * sine)


@inner(counted=False)
def _pull(H, m, x):
    """Add f_L and f_PE: the normalized force of fully active resting fibers at x."""
    return max(curve_value(H.curves, H.curve[m, 0], x), 0.0) + curve_value(
        H.curves, H.curve[m, 2], x
    )


@inner(counted=False)
def _residual(H, m, length, fiber):
    """Tendon force less fiber force, normalized, of a fully active resting muscle."""
    cosine = np.sqrt(max(1.0 - (H.height[m] / fiber) ** 2, 0.0))
    strain = (length - fiber * cosine) / H.tendon[m] - 1.0
    return curve_value(H.curves, H.resting[m], strain) - _pull(H, m, fiber / H.fiber[m]) * cosine


@inner(counted=False)
def isometric_force(H, m, length):
    """Force of a fully active muscle at rest on an elastic tendon, passive force included [N].

    The fiber length at which tendon and fibers pull alike is found by regula falsi (Illinois).

    Parameters
    ----------
    H : `HillArrays`
    m : number of the muscle
    length : of the path [m]
    """
    h = H.height[m]
    slack = H.tendon[m]
    if length < slack:
        return 0.0
    longest = np.sqrt((length - slack) ** 2 + h * h)
    if slack < 1e-13:
        return H.force[m] * _pull(H, m, longest / H.fiber[m]) * length / longest
    low = max(h, 1e-6 * H.fiber[m])
    high = longest
    f_low = _residual(H, m, length, low)
    f_high = _residual(H, m, length, high)
    if not (f_low > 0.0 and f_high < 0.0):
        cosine = (length - slack) / longest if longest > 0.0 else 1.0
        return H.force[m] * curve_value(
            H.curves, H.resting[m], (length - longest * cosine) / slack - 1.0
        )
    side = 0
    fiber = high
    for _ in range(100):
        fiber = (f_low * high - f_high * low) / (f_low - f_high)
        error = _residual(H, m, length, fiber)
        if abs(error) < 1e-10 or high - low < 1e-13 * H.fiber[m]:
            break
        if error > 0.0:
            low = fiber
            f_low = error
            if side == 1:
                f_high *= 0.5
            side = 1
        else:
            high = fiber
            f_high = error
            if side == -1:
                f_low *= 0.5
            side = -1
    cosine = np.sqrt(max(1.0 - (h / fiber) ** 2, 0.0))
    return H.force[m] * curve_value(H.curves, H.resting[m], (length - fiber * cosine) / slack - 1.0)


@kernel(counted=False)
def _rigid_frames(H, lengths, speeds, wanted, active, passive):
    """`rigid_forces` of all muscles over frames.

    Parameters
    ----------
    lengths, speeds : (frames, muscles) of the paths [m], [m/s]
    wanted : whether passive forces are computed
    active, passive : (frames, muscles) filled [N]
    """
    for frame in range(lengths.shape[0]):
        for m in range(lengths.shape[1]):
            active[frame, m], passive[frame, m] = rigid_forces(
                H, m, lengths[frame, m], speeds[frame, m], wanted
            )


@kernel(counted=False)
def _resting_frames(H, lengths, speeds, active, passive):
    """Replace the forces of muscles that OpenSim's static optimization takes in rest.

    Parameters
    ----------
    lengths, speeds : (frames, muscles) of the paths [m], [m/s]
    active, passive : (frames, muscles) filled for these muscles [N]
    """
    for m in range(lengths.shape[1]):
        if H.resting[m] < 0:
            continue
        for frame in range(lengths.shape[0]):
            if not np.isnan(active[frame, m]):
                v = H.cos_optimal[m] * speeds[frame, m] / H.speed[m]
                factor = max(curve_value(H.curves, H.curve[m, 1], v), 0.0)
                active[frame, m] = isometric_force(H, m, lengths[frame, m]) * factor
                passive[frame, m] = 0.0


def rigid_tendon_forces(
    H: HillArrays, lengths: MuscleValues, speeds: MuscleValues, passive_too: bool
) -> tuple[MuscleValues, MuscleValues]:
    """Compute forces of muscles with rigid tendons from compiled arrays.

    Parameters
    ----------
    H : of the muscles
    lengths, speeds : (frames, muscles) of the paths [m], [m/s]
    passive_too : whether passive forces are computed, else they are 0

    Returns
    -------
    active, passive : (frames, muscles) per unit activation, and passive, along the tendons [N]
    """
    active = np.empty_like(lengths)
    passive = np.empty_like(lengths)
    _rigid_frames(H, lengths, speeds, passive_too, active, passive)
    # A kernel of its own, which models without these classes need not compile.
    if (H.resting >= 0).any():
        _resting_frames(H, lengths, speeds, active, passive)
    return active, passive


def hill_forces(
    model: Model, lengths: Array, velocities: Array, convention: Convention = "rigid-tendon"
) -> HillForces:
    """Force per unit activation and passive force of every muscle, along its tendon.

    "rigid-tendon" is the formula at the top of this file for every class. "opensim" is what OpenSim
    4.6 takes in its static optimization, which departs from it in some classes
    (`MuscleModel.static_optimization`): Millard2012EquilibriumMuscle (pennation from the normalized
    length, so its cosine is nearly 1), DeGrooteFregly2016Muscle (no pennation cosine),
    RigidTendonMuscle (the fibers' velocity is the path's), and the two deprecated classes (force of
    a resting muscle in equilibrium with its elastic tendon, passive force included, times a generic
    force-velocity curve; their `passive` is then 0).

    Parameters
    ----------
    model : with muscles
    lengths, velocities : (frames, muscles) of the muscle paths, in the model's order [m], [m/s]
    convention : "rigid-tendon" or "opensim"

    Returns
    -------
    HillForces, NaN where a length or velocity is NaN

    Raises
    ------
    BadData : the convention or the shape of an array is wrong
    BadModel : see `compile_hill`
    """
    if convention not in CONVENTIONS:
        raise BadData(f"unknown convention '{convention}': there are {', '.join(CONVENTIONS)}")
    arrays = compile_hill(model, convention)
    lengths = np.ascontiguousarray(lengths, dtype=np.float64)
    velocities = np.ascontiguousarray(velocities, dtype=np.float64)
    expected = (len(lengths), len(model.muscles))
    if lengths.shape != expected or velocities.shape != expected:
        raise BadData(
            f"expected lengths and velocities of shape (frames, {len(model.muscles)}), "
            f"but got {lengths.shape} and {velocities.shape}"
        )
    active, passive = rigid_tendon_forces(arrays, lengths, velocities, passive_too=True)
    return HillForces(
        active=frozen_array(active),
        passive=frozen_array(passive),
        viscous=frozen_array(viscosities(model) * velocities),
    )
