"""Muscles with elastic tendons as flat arrays: what the kernels of `fiber_jets` read."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.paths import Muscle
from myomorph.muscles.fiber_equations import UNDAMPED, millard_tendon, thelen_tendon
from myomorph.muscles.hill_arrays import HillArrays, compile_hill
from myomorph.muscles.hill_classes import DEGROOTE, KINDS, MILLARD, THELEN
from myomorph.muscles.hill_curves import Curve, CurveArrays, pack_curves

ELASTIC_KINDS = (THELEN, MILLARD, DEGROOTE)
"""Classes whose tendons have a curve of their own."""

TIMES = {THELEN: (0.015, 0.050), MILLARD: (0.010, 0.040), DEGROOTE: (0.015, 0.060)}
"""Time constants of activation and deactivation that OpenSim's classes have by default [s]."""


class ElasticArrays(NamedTuple):
    """Muscles and their tendons as the kernels read them; rows of muscles without an elastic tendon are not used.

    Attributes
    ----------
    hill : fibers
    tendon : (muscles, 4) of a tendon whose force rises exponentially: stretch = p0 log(p1 f + p2) + p3, up to a force
        `straight` from where it is a line; not used by a tendon with a curve
    straight : (muscles, 2) normalized force where the line begins, and its slope, stretch per force
    curve : (muscles,) in `curves`, of stretch over normalized force; -1 for none
    damping : (muscles,) of the fibers, normalized
    passive : (muscles,) 1 where the passive force of the fibers takes part, else 0
    slowed : (muscles,) how far activation slows the fibers: 0.75 of Thelen2003Muscle, else 0
    """

    hill: HillArrays
    tendon: Array
    straight: Array
    curve: NDArray[np.int64]
    curves: CurveArrays
    damping: Array
    passive: Array
    slowed: Array


def has_elastic_tendon(muscle: Muscle) -> bool:
    """Whether the class of a muscle has a tendon with a curve, and the model lets it stretch."""
    kind = KINDS.get(muscle.kind)
    if kind not in ELASTIC_KINDS or not muscle.tendon_slack_length > 0.0:
        return False
    # Thelen2003Muscle has the property, but OpenSim does not read it.
    return kind == THELEN or not muscle.parameters.get("ignore_tendon_compliance")


@lru_cache(maxsize=8)
def compile_elastic(model: Model, passive: bool) -> ElasticArrays:
    """The model's muscles and tendons as flat arrays, in the model's order.

    Parameters
    ----------
    passive : whether the passive force of the fibers takes part

    Raises
    ------
    BadModel
        for a class whose curves are not known, or parameters no curve can be made of
    """
    count = len(model.muscles)
    tendon, straight = np.zeros((count, 4)), np.zeros((count, 2))
    curve, curves = np.full(count, -1, np.int64), list[Curve]()
    damping, slowed = np.zeros(count), np.zeros(count)
    for m, muscle in enumerate(model.muscles):
        if not has_elastic_tendon(muscle):
            continue
        kind = KINDS[muscle.kind]
        if kind == DEGROOTE:
            strain = muscle.parameters.get("tendon_strain_at_one_norm_force", 0.049)
            tendon[m] = strain / np.log(6.0), 5.0, 1.0, 1.0
            straight[m] = np.inf, 0.0
            damping[m] = muscle.parameters.get("fiber_damping", 0.0)
        elif kind == THELEN:
            toe, force, slope = thelen_tendon(muscle)
            tendon[m] = toe / 3.0, np.expm1(3.0) / force, 1.0, 1.0
            straight[m] = force, 1.0 / slope
            slowed[m] = 0.75
        else:
            damping[m] = muscle.parameters.get("fiber_damping", 0.1)
            damping[m] *= damping[m] >= UNDAMPED
            own = millard_tendon(muscle)
            curve[m] = len(curves)
            curves.append(Curve(own.pieces[:, ::-1], (1.0 / max(own.slopes[0], 1e-9), 1.0 / own.slopes[1])))
    return ElasticArrays(
        compile_hill(model),
        tendon,
        straight,
        curve,
        pack_curves(curves),
        damping,
        np.full(count, float(passive)),
        slowed,
    )


def activation_times(model: Model) -> Array:
    """(2, muscles) time constants of activation and deactivation [s]."""
    result = np.empty((2, len(model.muscles)))
    for m, muscle in enumerate(model.muscles):
        first, last = TIMES.get(KINDS.get(muscle.kind, -1), (0.015, 0.060))
        result[:, m] = [
            muscle.parameters.get("activation_time_constant", first),
            muscle.parameters.get("deactivation_time_constant", last),
        ]
    return result
