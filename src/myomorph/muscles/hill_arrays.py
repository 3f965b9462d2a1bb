"""Hill-type muscles as flat arrays, which kernels read: with rigid tendons, and with elastic ones.

A new class is one line of `MODELS`, and a module with the class.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache, partial
from importlib import import_module
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array
from myomorph.model.errors import BadModel
from myomorph.model.latest import Latest
from myomorph.model.model import Model
from myomorph.model.paths import Muscle
from myomorph.muscles.curves import Curve, CurveArrays, pack_curves
from myomorph.muscles.muscle_model import FiberSizes, MuscleModel, StaticOptimization

MODELS: dict[str, str] = {
    "Thelen2003Muscle": "myomorph.muscles.models.thelen:Thelen2003",
    "Millard2012EquilibriumMuscle": "myomorph.muscles.models.millard:Millard2012",
    "Millard2012AccelerationMuscle": "myomorph.muscles.models.millard:Millard2012Acceleration",
    "DeGrooteFregly2016Muscle": "myomorph.muscles.models.degroote:DeGrooteFregly2016",
    "RigidTendonMuscle": "myomorph.muscles.models.thelen:RigidTendon",
    "Thelen2003Muscle_Deprecated": "myomorph.muscles.models.thelen:DeprecatedThelen2003",
    "Schutte1993Muscle_Deprecated": "myomorph.muscles.models.thelen:Schutte1993",
    "mujoco": "myomorph.muscles.models.mujoco:MujocoMuscle",
}


def muscle_model(muscle: Muscle) -> MuscleModel:
    """The class of a muscle."""
    if muscle.kind not in MODELS:
        raise BadModel(f"muscle '{muscle.name}' is a {muscle.kind}: curves are known for {', '.join(MODELS)}")
    return loaded(MODELS[muscle.kind])


@lru_cache(maxsize=64)
def loaded(place: str) -> MuscleModel:
    """The class at a place of `MODELS`."""
    module, name = place.split(":")
    return getattr(import_module(module), name)()


Convention = Literal["rigid-tendon", "opensim"]
CONVENTIONS: tuple[Convention, ...] = ("rigid-tendon", "opensim")


class HillArrays(NamedTuple):
    """Muscles as the kernels read them. `force`, `...`, `speed` (muscles,) see `FiberSizes`."""

    force: Array
    fiber: Array
    tendon: Array
    height: Array
    shortest: Array
    shortest_along: Array
    cos_optimal: Array
    speed: Array
    least_along: Array  # (muscles,) least part of the fibers along the tendon [m]
    ends: NDArray[np.bool_]  # (muscles,) whether fibers have no active force there
    turning: NDArray[np.bool_]  # (muscles,) whether the path's velocity is projected on the fibers
    pennation_by: Array  # (muscles,) see `StaticOptimization`, -1 for None
    curve: NDArray[np.int64]  # (muscles, 3) active, velocity and passive curve
    # (muscles,) curve of the tendon with which a muscle is in equilibrium at rest, -1 for a rigid one
    resting: NDArray[np.int64]
    curves: CurveArrays


class ElasticArrays(NamedTuple):
    """Muscles and their tendons as the kernels read them; rows of muscles without an elastic tendon are not used."""

    hill: HillArrays  # sizes
    # (muscles, 4) active, velocity and passive curve, and stretch of the tendon over normalized force
    curve: NDArray[np.int64]
    curves: CurveArrays
    damping: Array  # (muscles,) of the fibers, normalized
    passive: Array  # (muscles,) 1 where the passive force of the fibers takes part, else 0
    slowed: Array  # (muscles,) how far activation slows the fibers


def muscle_models(model: Model) -> list[MuscleModel]:
    """The classes of the model's muscles, in the model's order."""
    return [muscle_model(muscle) for muscle in model.muscles]


def compile_hill(model: Model, convention: Convention = "rigid-tendon") -> HillArrays:
    """The model's muscles as flat arrays, in the model's order; the same model compiles once."""
    return _latest[convention](model)


def compile_hill_as(model: Model, like: Model) -> HillArrays:
    """`compile_hill` of a model made of another by changing forces, fiber and tendon lengths of its muscles alone.
    `like`: the other one, with the same muscles in the same order; what was compiled of it is used again.
    """
    sizes = _size_arrays(model)
    made = compile_hill(like)._replace(**sizes, least_along=sizes["shortest_along"])
    _latest["rigid-tendon"].put(model, made)
    return made


def has_elastic_tendon(muscle: Muscle) -> bool:
    """Whether the class of a muscle has a tendon with a curve, and the model lets it stretch."""
    return muscle.kind in MODELS and muscle_model(muscle).has_elastic_tendon(muscle)


@lru_cache(maxsize=8)
def compile_elastic(model: Model, passive: bool) -> ElasticArrays:
    """The model's muscles and tendons as flat arrays, in the model's order."""
    count = len(model.muscles)
    table = _Numbered()
    curve, damping, slowed = np.full((count, 4), -1, np.int64), np.zeros(count), np.zeros(count)
    for m, (muscle, kind) in enumerate(zip(model.muscles, muscle_models(model), strict=True)):
        if kind.has_elastic_tendon(muscle):
            curve[m] = table.numbers([*kind.smooth_curves(muscle), kind.stretch(muscle)])
            damping[m] = kind.fiber_damping(muscle)
            damping[m] *= damping[m] >= kind.undamped
            slowed[m] = kind.slowed
    return ElasticArrays(
        compile_hill(model), curve, pack_curves(table.curves), damping, np.full(count, float(passive)), slowed
    )


def activation_times(model: Model) -> Array:
    """(2, muscles) time constants of activation and deactivation [s]."""
    result = np.empty((2, len(model.muscles)))
    for m, (muscle, kind) in enumerate(zip(model.muscles, muscle_models(model), strict=True)):
        rise, fall = kind.times
        result[:, m] = [
            muscle.parameters.get("activation_time_constant", rise),
            muscle.parameters.get("deactivation_time_constant", fall),
        ]
    return result


def viscosities(model: Model) -> Array:
    """(muscles,) viscosity of each muscle [N s/m], 0 of one that is switched off."""
    return np.array([muscle.viscosity if muscle.enabled else 0.0 for muscle in model.muscles])


class _Numbered:
    """Curves and their numbers; the same curve of several muscles has one."""

    def __init__(self) -> None:
        self.curves: list[Curve] = []
        self._number: dict[Curve, int] = {}

    def numbers(self, curves: Iterable[Curve]) -> list[int]:
        for curve in curves:
            if curve not in self._number:
                self._number[curve] = len(self.curves)
                self.curves.append(curve)
        return [self._number[curve] for curve in curves]


def _compile(model: Model, convention: Convention) -> HillArrays:
    models, table, opensim = muscle_models(model), _Numbered(), convention == "opensim"
    pairs = list(zip(models, model.muscles, strict=True))
    curve, resting = np.empty((len(pairs), 3), np.int64), np.full(len(pairs), -1, np.int64)
    for m, (kind, muscle) in enumerate(pairs):
        if not (muscle.optimal_fiber_length > 0 and muscle.max_contraction_velocity > 0):
            raise BadModel(
                f"muscle '{muscle.name}' has optimal fiber length {muscle.optimal_fiber_length:g} m and maximum "
                f"contraction velocity {muscle.max_contraction_velocity:g}/s: both must be positive"
            )
        try:
            curve[m] = table.numbers(kind.curves(muscle))
        except BadModel as error:
            raise BadModel(f"muscle '{muscle.name}': {error}") from error
        tendon = kind.resting_tendon(muscle) if opensim else None
        if tendon is not None:
            resting[m] = table.numbers([tendon])[0]
    sizes = _size_arrays(model)
    rules = [kind.static_optimization if opensim else StaticOptimization() for kind in models]
    return HillArrays(
        **sizes,
        least_along=np.where([rule.bounded for rule in rules], sizes["shortest_along"], -np.inf),
        ends=np.array([kind.greatest_pennation(muscle) is not None for kind, muscle in pairs], np.bool_),
        turning=np.array([rule.turning for rule in rules], np.bool_),
        pennation_by=np.array([-1.0 if rule.pennation_by is None else rule.pennation_by for rule in rules]),
        curve=curve,
        resting=resting,
        curves=pack_curves(table.curves),
    )


_latest = {convention: Latest(partial(_compile, convention=convention)) for convention in CONVENTIONS}


def _size_arrays(model: Model) -> dict[str, Any]:
    rows = [kind.sizes(muscle) for kind, muscle in zip(muscle_models(model), model.muscles, strict=True)]
    table = np.array(rows, dtype=np.float64).reshape(len(rows), len(FiberSizes._fields))
    return {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(FiberSizes._fields)}
