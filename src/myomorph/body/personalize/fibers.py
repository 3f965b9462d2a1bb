"""Forces of muscles along given paths under given activations, and their slopes.

On elastic tendons fibers are followed over time (`fiber_kernel`); with a rigid tendon length and
velocity of a fiber are those of the path.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.body.personalize.fiber_kernel import (
    CurveTables,
    MuscleArrays,
    Paths,
    Table,
    follow_elastic,
)
from myomorph.body.personalize.muscle_curves import Lookup, MuscleShapes
from myomorph.core.model.arrays import Array, read_only

Numbers = NDArray[Any]  # Real or complex

IMAGINARY = 1e-30  # Step h of complex differentiation, df/dx = Im f(x + i h) / h


@read_only
class MuscleSizes:
    """Properties of a model's muscles that personalization changes.

    Attributes
    ----------
    fiber, slack : (muscles,) optimal fiber and tendon slack lengths [m]
    force : (muscles,) maximum isometric force [N]
    strain : (muscles,) factor on the fiber strain at which passive force reaches its values
    """

    fiber: Array
    slack: Array
    force: Array
    strain: Array


class Followed(NamedTuple):
    """Muscles over time, every array (windows, frames, muscles) or (frames, muscles).

    Attributes
    ----------
    force : along the tendon [N]
    length : normalized fiber length
    by_fiber, by_slack : slopes of the force in optimal length and slack length [N/m]
    by_strain : slope in the strain factor [N]
    by_activation : slope in an activation changed alike over time [N]
    """

    force: Array
    length: Array
    by_fiber: Array
    by_slack: Array
    by_strain: Array
    by_activation: Array

    def frames(self, counted: np.ndarray) -> Followed:
        """Select frames.

        Parameters
        ----------
        counted : (windows, frames) whether a frame is selected

        Returns
        -------
        arrays (frames, muscles)
        """
        return Followed(
            force=self.force[counted],
            length=self.length[counted],
            by_fiber=self.by_fiber[counted],
            by_slack=self.by_slack[counted],
            by_strain=self.by_strain[counted],
            by_activation=self.by_activation[counted],
        )


def follow(shapes: MuscleShapes, sizes: MuscleSizes, paths: Paths) -> Followed:
    """Compute muscle forces along given paths under given activations.

    Parameters
    ----------
    shapes : curves of the muscles
    sizes : lengths and strengths of the muscles
    paths : lengths, speeds and activations; an infinite step holds every frame still, each in
        equilibrium of its own

    Returns
    -------
    (windows, frames, muscles) forces, lengths and slopes
    """
    rigid = shapes.rigid
    if not rigid.any():
        return _elastic(shapes, sizes, paths)
    result = _rigid(shapes, sizes, paths)
    if rigid.all():
        return result
    elastic = _elastic(shapes, sizes, paths)
    return Followed(
        force=np.where(rigid, result.force, elastic.force),
        length=np.where(rigid, result.length, elastic.length),
        by_fiber=np.where(rigid, result.by_fiber, elastic.by_fiber),
        by_slack=np.where(rigid, result.by_slack, elastic.by_slack),
        by_strain=np.where(rigid, result.by_strain, elastic.by_strain),
        by_activation=np.where(rigid, result.by_activation, elastic.by_activation),
    )


def rigid_lengths(shapes: MuscleShapes, sizes: MuscleSizes, lengths: Array) -> Array:
    """Compute normalized fiber lengths on tendons at their slack length.

    Parameters
    ----------
    shapes : with the pennation and the shortest lengths
    sizes : optimal fiber and tendon slack lengths
    lengths : (..., muscles) of the paths [m]

    Returns
    -------
    (..., muscles) not below the shortest
    """
    along = np.maximum(lengths - sizes.slack, 0.0) / sizes.fiber
    return np.maximum(np.sqrt(along**2 + shapes.sine**2), shapes.shortest)


class _Pull(NamedTuple):
    """Force [N] and normalized fiber length, (windows, frames, muscles); may be complex."""

    force: Numbers
    length: Numbers


def _rigid(shapes: MuscleShapes, sizes: MuscleSizes, paths: Paths) -> Followed:
    """Follow muscles on rigid tendons, slopes by complex steps, exact to rounding."""
    a = paths.activations

    def pull(fiber: Numbers, slack: Numbers, strain: Numbers, activation: Numbers) -> _Pull:
        """Compute the force of sizes (muscles,) and an activation, one of which may be complex."""
        along = (paths.lengths - slack) / fiber
        least = np.sqrt(shapes.shortest**2 - shapes.sine**2)
        reaches = along.real > least
        along = np.where(reaches, along, least)
        x = np.sqrt(along * along + shapes.sine**2)
        cosine = along / x
        v = paths.speeds * cosine / (fiber * shapes.speed)
        # Linear in the activation, as `hill_forces`: velocity factors of full activation in
        # Thelen's class too.
        f_v = shapes.velocity(v)[0]
        f_v = np.where(f_v.real > 0.0, f_v, 0.0)
        passive = shapes.passive(1.0 + (x - 1.0) / strain)[0]
        total = activation * shapes.active(x)[0] * f_v + passive
        total = total + shapes.damping * v
        pulls = reaches & (total.real > 0.0)
        return _Pull(force=sizes.force * np.where(pulls, total, 0.0) * cosine, length=x)

    h = IMAGINARY
    fiber = sizes.fiber
    slack = sizes.slack
    strain = sizes.strain
    now = pull(fiber, slack, strain, a)
    return Followed(
        force=now.force,
        length=now.length,
        by_fiber=pull(fiber + 1j * h, slack, strain, a).force.imag / h,
        by_slack=pull(fiber, slack + 1j * h, strain, a).force.imag / h,
        by_strain=pull(fiber, slack, strain + 1j * h, a).force.imag / h,
        by_activation=pull(fiber, slack, strain, a + 1j * h).force.imag / h,
    )


def _elastic(shapes: MuscleShapes, sizes: MuscleSizes, paths: Paths) -> Followed:
    """Follow muscles on elastic tendons; rigid ones stay 0."""
    lookups = (shapes.active, shapes.passive, shapes.velocity, shapes.tendon)
    tables = CurveTables(
        active=_kernel_table(shapes.active),
        passive=_kernel_table(shapes.passive),
        velocity=_kernel_table(shapes.velocity),
        tendon=_kernel_table(shapes.tendon),
    )
    muscles = MuscleArrays(
        sizes=np.array([sizes.fiber, sizes.slack, sizes.force, sizes.strain]),
        shapes=np.array([shapes.sine, shapes.damping, shapes.speed, shapes.shortest]),
        rows=np.column_stack([lookup.row for lookup in lookups]),
        slower=shapes.slower,
        rigid=shapes.rigid,
    )
    even = Paths(
        lengths=np.ascontiguousarray(paths.lengths, dtype=np.float64),
        speeds=np.ascontiguousarray(paths.speeds, dtype=np.float64),
        activations=np.ascontiguousarray(paths.activations, dtype=np.float64),
        step=float(paths.step),
    )
    found = np.zeros((6, *paths.lengths.shape))
    follow_elastic(tables, muscles, even, found)
    return Followed(
        force=found[0],
        length=found[1],
        by_fiber=found[2],
        by_slack=found[3],
        by_strain=found[4],
        by_activation=found[5],
    )


def _kernel_table(lookup: Lookup) -> Table:
    """Give a kernel the numbers of a table."""
    return Table(start=lookup.start, step=lookup.step, values=lookup.values, slopes=lookup.slopes)
