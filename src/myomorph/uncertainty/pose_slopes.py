"""How poses follow the markers: derivatives of inverse kinematics at its optimum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.series import Markers, Motion
from myomorph.motion.ik import InverseKinematicsOptions, marker_arrays, tracked_markers
from myomorph.rigid.couplers import couple_frames
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import Tree, compile_tree

STEP = 1e-6
"""Of the finite differences, in units of the coordinates: markers move smoothly with them."""
IN_MEMORY = 100e6
"""Derivatives take at most so much [bytes]; of a longer recording those of the nearest frame are taken."""
BOUND = 1e-9
"""Nearer to its bound than this a coordinate is held by it [rad or m]."""


@read_only
@dataclass(frozen=True, eq=False)
class PoseSlopes:
    """Derivatives of the coordinates of a motion in the places of its markers.

    Attributes
    ----------
    names : markers that take part
    coordinates : (frames, coordinates) of the motion [rad or m]
    places : (frames, markers, 3) of the model's markers in it, in ground [m]
    slopes : (kept, coordinates, 3 markers) [rad/m or 1]
    nearest : (frames,) which of them belong to a frame
    """

    names: tuple[str, ...]
    coordinates: Array
    places: Array
    slopes: Array
    nearest: NDArray[np.int64]

    def errors(self, model: Model, markers: Markers, moved: Markers) -> Array:
        """(frames, coordinates) errors of the coordinates by errors of markers and model, to first order.

        Parameters
        ----------
        model : with errors
        markers, moved : without and with errors, at the motion's times
        """
        columns = [markers.names.index(name) for name in self.names]
        apart = moved.values[:, columns] - markers.values[:, columns]
        apart = apart - (_places(compile_tree(model), self.names, self.coordinates) - self.places)
        # What is hidden has no slope either.
        flat = np.nan_to_num(apart).reshape(len(apart), -1, 1)
        return np.asarray((self.slopes[self.nearest] @ flat)[:, :, 0])


def pose_slopes(
    model: Model, markers: Markers, motion: Motion, options: InverseKinematicsOptions | None = None
) -> PoseSlopes:
    """Derivatives of inverse kinematics at its optimum: of the normal equations, residuals taken as small.

        dc = (J^T W J)^-1 J^T W dx

    Coordinates that lie on a bound stay there; those that follow others follow.

    Parameters
    ----------
    markers : as observed, NaN where hidden (frames, markers, 3) [m]
    motion : what inverse kinematics made of them, all coordinates of the model
    options : it was found with

    Raises
    ------
    BadData
        the model closes loops
    """
    if model.loops:
        raise BadData(f"model '{model.name}' closes loops: limits by derivatives know none; take method = 'sampled'")
    options = options or InverseKinematicsOptions()
    tree = compile_tree(model)
    names, weights = tracked_markers(model, markers, options)
    arrays = marker_arrays(tree, names, weights, options)
    c = np.array(motion.values)
    blank = np.asarray(~np.isfinite(c).all(axis=1))
    c[blank] = tree.defaults
    count = max(1, int(IN_MEMORY / (8.0 * c.shape[1] * 3 * len(names))))
    kept = np.unique(np.linspace(0, len(c) - 1, min(count, len(c))).round().astype(np.int64))
    nearest = np.searchsorted(0.5 * (kept[1:] + kept[:-1]), np.arange(len(c)))
    places, own = _places(tree, names, c), c[kept]
    free = arrays.free
    J, C = np.empty((len(kept), 3 * len(names), len(free))), np.empty((len(kept), c.shape[1], len(free)))
    for k, j in enumerate(free):
        shifted, step = own.copy(), STEP * arrays.unit[j]
        shifted[:, j] += step
        couple_frames(tree.arrays, shifted)
        J[:, :, k] = (_places(tree, names, shifted) - places[kept]).reshape(len(kept), -1) / step
        C[:, :, k] = (shifted - own) / step
    J *= _movable(own[:, free], arrays.lower, arrays.upper)[:, None]
    columns = [markers.names.index(name) for name in names]
    seen = np.isfinite(markers.values[kept][:, columns]).all(axis=2) & ~blank[kept, None]
    share = np.repeat(seen * weights, 3, axis=1)
    share /= np.maximum(share.sum(axis=1, keepdims=True) / 3.0, 1e-12)
    weighted = J * share[:, :, None]
    H = np.swapaxes(J, 1, 2) @ weighted
    own_weight = arrays.task_weight[free] + options.posture_weight * np.einsum("fii->f", H)[:, None] / len(free)
    # What no marker shows has no derivative: it stays.
    H += np.maximum(own_weight / arrays.unit[free] ** 2, 1e-12)[:, :, None] * np.eye(len(free))
    slopes = C @ np.linalg.solve(H, np.swapaxes(weighted, 1, 2))
    return PoseSlopes(names, c, places, slopes, nearest)


def _movable(values: Array, lower: Array, upper: Array) -> Array:
    """(frames, variables) 1, 0 for those on a bound."""
    return ((values > lower + BOUND) & (values < upper - BOUND)).astype(np.float64)


def _places(tree: Tree, names: tuple[str, ...], coordinates: Array) -> Array:
    """(frames, markers, 3) of a model's markers, in ground [m]."""
    marked = [tree.model.marker(name) for name in names]
    bodies = np.array([tree.body_number(one.body) for one in marked], np.int64)
    return forward_kinematics(tree, coordinates).points(bodies, np.array([one.location for one in marked]))
