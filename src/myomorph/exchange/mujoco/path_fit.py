"""Sites and spheres in the place of what MuJoCo lacks, moved until lengths fit the model's.

Levenberg and Marquardt's steps, for all muscles at once: each has parameters of its own, so one
evaluation of all paths gives the derivative in one parameter of every muscle.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.paths import PathPoint, WrapObject
from myomorph.core.model.spatial import Transform
from myomorph.core.muscles.model_paths import compile_paths

ITERATIONS = 25
STEP = 1e-6
FIRST_DAMPING = 1e-3
SMALLEST_RADIUS = 1e-3
RADII = (0.6, 1.5)  # Over those of the surfaces, from which spheres begin besides.


@read_only
class Movable:
    """What of a muscle's path the fit may move."""

    muscle: int  # its number
    points: tuple[int, ...]  # numbers of the path's points, three parameters each [m]
    # names of spheres that no other muscle has, center and radius of each [m]
    spheres: tuple[str, ...]


def fitted_paths(
    model: Model, movables: list[Movable], coordinates: Array, lengths: Array, weights: Array
) -> Model:
    """Move sites and spheres of a model to where lengths come nearest to those wanted.

    Parameters
    ----------
    model : with the paths
    movables : sites and spheres of a muscle that may move
    coordinates : (poses, coordinates) of the model, consistent [rad or m]
    lengths : (poses, movables) wanted of each movable's muscle [m]
    weights : (poses, movables) how much each pose counts

    Returns
    -------
    model
    """
    if not movables:
        return model
    parameters = [_parameters(model, movable) for movable in movables]
    count = max(map(len, parameters))
    values = np.zeros((len(movables), count))
    for row, own in zip(values, parameters, strict=True):
        row[: len(own)] = own

    def errors(trial: Array) -> Array:
        """(movables, poses) weighted errors of lengths."""
        moved = _moved(model, movables, trial)
        fewer = replace(
            moved, muscles=tuple(moved.muscles[one.muscle] for one in movables), markers=()
        )
        return np.asarray(
            (np.sqrt(weights) * (compile_paths(fewer).evaluate(coordinates)[0] - lengths)).T
        )

    def descended(start: Array) -> tuple[Array, Array]:
        """Parameters after all steps, and each muscle's sum of squares."""
        values = start.copy()
        damping = np.full(len(movables), FIRST_DAMPING)
        now = errors(values)
        for _ in range(ITERATIONS):
            jacobian = np.stack(
                [(errors(values + STEP * unit) - now) / STEP for unit in np.eye(count)], axis=2
            )
            normal = np.einsum("mpi,mpj->mij", jacobian, jacobian)
            gradient = np.einsum("mpi,mp->mi", jacobian, now)
            size = np.maximum(np.einsum("mii->mi", normal), 1e-12)
            normal = normal + (damping[:, None] * size)[:, :, None] * np.eye(count)
            trial = values - np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
            there = errors(trial)
            better = (there**2).sum(axis=1) < (now**2).sum(axis=1)
            values[better] = trial[better]
            now[better] = there[better]
            damping = np.where(better, 0.3 * damping, 5.0 * damping)
        return values, (now**2).sum(axis=1)

    radii = np.zeros(values.shape, np.bool_)
    for radius, movable in zip(radii, movables, strict=True):
        radius[3 * len(movable.points) + 3 :: 4] = bool(movable.spheres)
    best, least = descended(values)
    for factor in RADII:
        other, cost = descended(np.where(radii, factor * values, values))
        better = cost < least
        best[better] = other[better]
        least[better] = cost[better]
    return _moved(model, movables, best)


def _parameters(model: Model, movable: Movable) -> list[float]:
    muscle = model.muscles[movable.muscle]
    values: list[float] = []
    for index in movable.points:
        point = muscle.path.points[index]
        assert isinstance(point, PathPoint)
        values += point.location.tolist()
    for sphere in model.wrap_objects:
        if sphere.name in movable.spheres:
            values += [*sphere.pose.translation.tolist(), sphere.size[0]]
    return values


def _moved(model: Model, movables: list[Movable], values: Array) -> Model:
    """Give the movable parts of the model their parameters (movables, parameters)."""
    muscles = list(model.muscles)
    spheres = {}
    for movable, row in zip(movables, values, strict=True):
        muscle = muscles[movable.muscle]
        points = list(muscle.path.points)
        for i, index in enumerate(movable.points):
            point = points[index]
            assert isinstance(point, PathPoint)
            points[index] = replace(point, location=row[3 * i : 3 * i + 3])
        at = 3 * len(movable.points)
        for sphere in model.wrap_objects:
            if sphere.name in movable.spheres:
                spheres[sphere.name] = _sphere(sphere, row[at : at + 4])
                at += 4
        muscles[movable.muscle] = replace(muscle, path=replace(muscle.path, points=tuple(points)))
    surfaces = tuple(spheres.get(item.name, item) for item in model.wrap_objects)
    return replace(model, muscles=tuple(muscles), wrap_objects=surfaces)


def _sphere(sphere: WrapObject, row: Array) -> WrapObject:
    radius = max(float(row[3]), SMALLEST_RADIUS)
    return replace(sphere, pose=Transform(sphere.pose.rotation, row[:3]), size=(radius,))
