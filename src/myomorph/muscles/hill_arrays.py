"""Hill-type muscles as flat arrays, which the kernels of their forces read."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array
from myomorph.model.errors import BadModel
from myomorph.model.latest import Latest
from myomorph.model.model import Model
from myomorph.model.paths import Muscle
from myomorph.muscles.hill_classes import ACCELERATION, KINDS, MILLARD, THELEN, class_parameters
from myomorph.muscles.hill_curves import Curve, CurveArrays, pack_curves

_NUMBERS = ("force", "fiber", "tendon", "height", "shortest", "shortest_along", "cos_optimal", "speed")


class HillArrays(NamedTuple):
    """Muscles as the kernels read them.

    Attributes
    ----------
    kind : (muscles,) number of the class
    force, fiber, tendon : (muscles,) maximum isometric force [N], optimal fiber length [m] and
        tendon slack length [m]
    height : (muscles,) constant height of the fibers over the tendon's line [m]
    shortest, shortest_along : (muscles,) least fiber length [m] and its part along the tendon [m]
    cos_optimal : (muscles,) cosine of the pennation at optimal length
    speed : (muscles,) maximum contraction velocity [m/s]
    parameters : (muscles, 6) of the class
    curve : (muscles, 3) active, velocity (or tendon) and passive curve, -1 for a formula
    """

    kind: NDArray[np.int64]
    force: Array
    fiber: Array
    tendon: Array
    height: Array
    shortest: Array
    shortest_along: Array
    cos_optimal: Array
    speed: Array
    parameters: Array
    curve: NDArray[np.int64]
    curves: CurveArrays


def compile_hill(model: Model) -> HillArrays:
    """The model's muscles as flat arrays, in the model's order; the same model compiles once.

    Raises
    ------
    BadModel
        for a class whose curves are not known, or parameters no curve can be made of
    """
    return _latest(model)


def compile_hill_as(model: Model, like: Model) -> HillArrays:
    """`compile_hill` of a model made of another by changing forces, fiber and tendon lengths of its muscles alone.

    Parameters
    ----------
    like : the other one, with the same muscles in the same order; what was compiled of it is used again
    """
    arrays = compile_hill(like)
    made = arrays._replace(
        **_columns([_sizes(muscle, kind) for muscle, kind in zip(model.muscles, arrays.kind, strict=True)])
    )
    _latest.put(model, made)
    return made


def _compile(model: Model) -> HillArrays:
    curves: list[Curve] = []
    index: dict[tuple[object, ...], int] = {}
    rows = [_compile_muscle(muscle, curves, index) for muscle in model.muscles]
    return HillArrays(
        kind=np.array([row[0] for row in rows], np.int64),
        **_columns([row[1] for row in rows]),
        parameters=np.array([row[2] for row in rows], dtype=np.float64).reshape(len(rows), 6),
        curve=np.array([row[3] for row in rows], np.int64).reshape(len(rows), 3),
        curves=pack_curves(curves),
    )


_latest = Latest(_compile)


def _columns(rows: list[list[float]]) -> dict[str, Any]:
    numbers = np.array(rows, dtype=np.float64).reshape(len(rows), len(_NUMBERS))
    return {name: np.ascontiguousarray(numbers[:, i]) for i, name in enumerate(_NUMBERS)}


def _compile_muscle(
    muscle: Muscle, curves: list[Curve], index: dict[tuple[object, ...], int]
) -> tuple[int, list[float], list[float], list[int]]:
    if muscle.kind not in KINDS:
        raise BadModel(f"muscle '{muscle.name}' is a {muscle.kind}: curves are known for {', '.join(KINDS)}")
    if not (muscle.optimal_fiber_length > 0 and muscle.max_contraction_velocity > 0):
        raise BadModel(
            f"muscle '{muscle.name}' has optimal fiber length {muscle.optimal_fiber_length:g} m and maximum "
            f"contraction velocity {muscle.max_contraction_velocity:g}/s: both must be positive"
        )
    kind = KINDS[muscle.kind]
    try:
        numbers, makers = class_parameters(muscle, kind)
        used = [_numbered(key, maker, curves, index) for key, maker in makers]
    except BadModel as error:
        raise BadModel(f"muscle '{muscle.name}': {error}") from error
    return kind, _sizes(muscle, kind), numbers + [0.0] * (6 - len(numbers)), used + [-1] * (3 - len(used))


def _sizes(muscle: Muscle, kind: int) -> list[float]:
    """What `_NUMBERS` names."""
    height = muscle.optimal_fiber_length * np.sin(muscle.pennation_at_optimal)
    most = muscle.parameters.get("maximum_pennation_angle", float(np.arccos(0.1)))
    most = np.pi / 2 if kind == ACCELERATION else most
    clamped = kind in (THELEN, MILLARD, ACCELERATION)
    shortest = (height / np.sin(most) if most > 1e-14 else 0.01 * muscle.optimal_fiber_length) if clamped else height
    return [
        muscle.max_isometric_force,
        muscle.optimal_fiber_length,
        muscle.tendon_slack_length,
        height,
        shortest,
        shortest * np.cos(most) if clamped else 0.0,
        np.cos(muscle.pennation_at_optimal),
        muscle.max_contraction_velocity * muscle.optimal_fiber_length,
    ]


def _numbered(key, maker, curves: list[Curve], index: dict[tuple[object, ...], int]) -> int:
    """Number of the curve `maker(*key)`; muscles of equal parameters share one."""
    if (maker, *key) not in index:
        index[(maker, *key)] = len(curves)
        curves.append(maker(*key))
    return index[(maker, *key)]
