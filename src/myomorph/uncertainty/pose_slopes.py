"""How poses follow the markers: derivatives of inverse kinematics at its optimum.

Those of the normal equations, residuals taken as small, dc = (J^T W J)^-1 J^T W dx. Coordinates that lie on a bound
stay there; those that follow others follow.
"""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.motion.ik import InverseKinematicsOptions, pose_problem
from myomorph.rigid.couplers import couple_frames
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import Tree, compile_tree

STEP = 1e-6
"""Of the finite differences, in units of the coordinates: markers move smoothly with them."""
BLOCK = 32
"""Frames whose poses, each with every coordinate moved, are computed in one go."""
BOUND = 1e-9
"""Nearer to its bound than this a coordinate is held by it [rad or m]."""


class SlopeFinder:
    """Derivatives of poses in the places of markers, set up once."""

    def __init__(self, model: Model, names: tuple[str, ...], weights: Array, options: InverseKinematicsOptions):
        self.names, self._weights, self._tree = names, weights, compile_tree(model)
        self._problem, self._posture = pose_problem(self._tree, names, weights, options), options.posture_weight

    def at(self, coordinates: Array, seen: np.ndarray) -> Array:
        """(frames, coordinates, 3 markers) derivatives at poses (frames, coordinates) [rad/m or 1]; what is not seen
        has none.
        """
        blocks = range(0, len(coordinates), BLOCK)
        parts = [self._block(coordinates[block : block + BLOCK], seen[block : block + BLOCK]) for block in blocks]
        return np.concatenate(parts) if len(parts) > 1 else parts[0]

    def _block(self, coordinates: Array, seen: np.ndarray) -> Array:
        problem, free = self._problem, self._problem.free
        frames, width, values = len(coordinates), 3 * len(self.names), np.array(coordinates)
        # All poses, and behind them each with one coordinate after the other moved, in one go.
        steps = STEP * problem.unit[free]
        shifted = np.tile(values, (len(free) + 1, 1)).reshape(len(free) + 1, frames, -1)
        for index, j in enumerate(free):
            shifted[index + 1, :, j] += steps[index]
        flat = shifted.reshape(-1, values.shape[1])
        couple_frames(self._tree.arrays, flat)
        places = _places(self._tree, self.names, flat).reshape(len(free) + 1, frames, width)
        shifted = flat.reshape(shifted.shape)
        J = np.moveaxis((places[1:] - places[0]) / steps[:, None, None], 0, 2)
        C = np.moveaxis((shifted[1:] - shifted[0]) / steps[:, None, None], 0, 2)
        J *= _movable(values[:, free], problem.lower, problem.upper)[:, None]
        share = np.repeat(seen * self._weights, 3, axis=1)
        share /= np.maximum(share.sum(axis=1, keepdims=True) / 3.0, 1e-12)
        weighted = J * share[:, :, None]
        H = np.swapaxes(J, 1, 2) @ weighted
        own_weight = problem.coordinates.weight[free] + self._posture * np.einsum("fii->f", H)[:, None] / len(free)
        # What no marker shows has no derivative: it stays.
        H += np.maximum(own_weight / problem.unit[free] ** 2, 1e-12)[:, :, None] * np.eye(len(free))
        return np.asarray(C @ np.linalg.solve(H, np.swapaxes(weighted, 1, 2)))


def _movable(values: Array, lower: Array, upper: Array) -> Array:
    """(frames, variables) 1, 0 for those on a bound."""
    return ((values > lower + BOUND) & (values < upper - BOUND)).astype(np.float64)


def _places(tree: Tree, names: tuple[str, ...], coordinates: Array) -> Array:
    """(frames, markers, 3) of a model's markers, in ground [m]."""
    marked = [tree.model.marker(name) for name in names]
    bodies = np.array([tree.body_number(marker.body) for marker in marked], np.int64)
    return forward_kinematics(tree, coordinates).points(bodies, np.array([marker.location for marker in marked]))
