"""Forces of muscles on elastic tendons from known activations, and their slopes in the muscles' parameters.

With activation a and path length L over time, the normalized fiber length x follows from

    (a f_L(x) f_V(v) + f_PE(1 + (x - 1) / k) + damping v) cos(alpha) = f_SE((L - lo w(x)) / ls - 1),
    w = sqrt(x^2 - sin(alpha0)^2),  cos(alpha) = w / x,  v = (dx/dt) / v_max,

by the second backward differentiation formula, all muscles and windows at once (De Groote et al. 2016 and Millard et
al. 2013 for the equations). A muscle's force depends on its own parameters alone: the slopes are carried along by
implicit differentiation of each step. With a rigid tendon x and v are those of the path.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.tension.personal.curves import MuscleShapes
from myomorph.tension.personal.fiber_kernels import follow_elastic


@read_only
@dataclass(frozen=True, eq=False)
class MuscleSizes:
    """What personalization changes, each (muscles,)."""

    # fiber, slack: optimal fiber and tendon slack lengths [m]
    fiber: Array
    slack: Array
    force: Array  # maximum isometric force [N]
    strain: Array  # factor on the fiber strain at which passive force reaches its values


class Followed(NamedTuple):
    """Muscles over time, every array (windows, frames, muscles)."""

    force: Array  # along the tendon [N]
    length: Array  # normalized fiber length
    # by_fiber, by_slack: slopes of the force in optimal length and slack length [N/m]
    by_fiber: Array
    by_slack: Array
    by_strain: Array  # slope in the strain factor [N]
    by_activation: Array  # slope in an activation changed alike over time [N]


def follow(
    shapes: MuscleShapes, sizes: MuscleSizes, lengths: Array, speeds: Array, activations: Array, step: float
) -> Followed:
    """Muscle forces along given paths under given activations.
    `lengths`, `speeds` (windows, frames, muscles) of the paths [m], [m/s]; `activations` (windows, frames, muscles);
    `step`: time between frames [s]; infinity holds every frame still, each in equilibrium of its own.
    """
    rigid = shapes.rigid
    if not rigid.any():
        return _elastic(shapes, sizes, lengths, speeds, activations, step)
    result = _rigid(shapes, sizes, lengths, speeds, activations)
    if rigid.all():
        return result
    elastic = _elastic(shapes, sizes, lengths, speeds, activations, step)
    return Followed(*(np.where(rigid, values, other) for values, other in zip(result, elastic, strict=True)))


def rigid_lengths(shapes: MuscleShapes, sizes: MuscleSizes, lengths: Array) -> Array:
    """Normalized fiber lengths on tendons at their slack length, not below the shortest."""
    along = np.maximum(lengths - sizes.slack, 0.0) / sizes.fiber
    return np.maximum(np.sqrt(along**2 + shapes.sine**2), shapes.shortest)


def _rigid(shapes: MuscleShapes, sizes: MuscleSizes, lengths: Array, speeds: Array, a: Array) -> Followed:
    """Rigid tendons; slopes by complex steps, exact to rounding."""

    def pull(fiber, slack, strain, activation):
        """Force and normalized length; any of the parameters may be complex."""
        along = (lengths - slack) / fiber
        least = np.sqrt(shapes.shortest**2 - shapes.sine**2)
        reaches = along.real > least
        along = np.where(reaches, along, least)
        x = np.sqrt(along * along + shapes.sine**2)
        cosine = along / x
        v = speeds * cosine / (fiber * shapes.speed)
        # Linear in the activation, as `hill_forces`: velocity factors of full activation in Thelen's class too.
        f_v = shapes.velocity(v)[0]
        f_v = np.where(f_v.real > 0.0, f_v, 0.0)
        total = activation * shapes.active(x)[0] * f_v + shapes.passive(1.0 + (x - 1.0) / strain)[0]
        total = total + shapes.damping * v
        return sizes.force * np.where(reaches & (total.real > 0.0), total, 0.0) * cosine, x

    h = 1e-30
    plain = (sizes.fiber, sizes.slack, sizes.strain, a)
    force, x = pull(*plain)
    slopes = [
        pull(*(value + 1j * h if i == index else value for i, value in enumerate(plain)))[0].imag / h
        for index in range(4)
    ]
    return Followed(force, x, *slopes)


def _elastic(
    shapes: MuscleShapes, sizes: MuscleSizes, lengths: Array, speeds: Array, a: Array, step: float
) -> Followed:
    lookups = (shapes.active, shapes.passive, shapes.velocity, shapes.tendon)
    tables = tuple((lookup.start, lookup.step, lookup.values, lookup.slopes) for lookup in lookups)
    rows = np.column_stack([lookup.row for lookup in lookups])
    size_table = np.array([sizes.fiber, sizes.slack, sizes.force, sizes.strain])
    kept = np.array([shapes.sine, shapes.damping, shapes.speed, shapes.shortest])
    result = np.zeros((6, *lengths.shape))
    given = (np.ascontiguousarray(values, dtype=np.float64) for values in (lengths, speeds, a))
    follow_elastic(tables, rows, size_table, kept, shapes.slower, shapes.rigid, *given, float(step), result)
    return Followed(*result)
