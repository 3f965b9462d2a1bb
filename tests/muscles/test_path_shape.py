"""Paths to be drawn are as long as the paths, and run where they run."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.arrays import Array
from myomorph.core.model.functions import Function
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.paths import MovingPathPoint, Muscle
from myomorph.core.muscles.drawn_paths import ARC_PARTS, drawn_paths
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.kinematics import Poses
from myomorph.core.rigid.tree import compile_tree

MODELS = {
    "OpenSim's wraps": ("rajagopal-walk-emg/subject_walk_scaled.osim", read_osim),
    "moving points": ("opensim-gait-subject01/ref_id/subject01.osim", read_osim),
}


def _poses(model: Model, frames: int = 12) -> np.ndarray:
    random = np.random.default_rng(3)
    low = np.array([max(one.range[0], -0.5) for one in model.coordinates])
    high = np.array([min(one.range[1], 0.5) for one in model.coordinates])
    values = low + (high - low) * random.random((frames, len(low)))
    tree = compile_tree(model)
    return tree.coordinates_of(_motion(model, values))


def _motion(model: Model, values: np.ndarray):
    from myomorph.core.model.series import Motion

    return Motion(np.arange(len(values)) * 0.01, model.coordinate_names, values)


WRAPPED = ("OpenSim's wraps", "MuJoCo's tendons")


@pytest.fixture(scope="module")
def model(request: pytest.FixtureRequest, data: Callable[[str], Path]) -> Model:
    if request.param in MODELS:
        name, read = MODELS[request.param]
        return read(data(name))
    from myomorph.lab.analyze.leg_model import leg_model

    return leg_model()


@pytest.mark.parametrize("model", WRAPPED, indirect=True)
def test_drawn_lengths_are_the_paths_lengths(model: Model) -> None:
    """Chords are shorter than arcs.

    OpenSim measures to where it first placed a point: 3 % at most.
    """
    paths = compile_paths(model)
    coordinates = _poses(model)
    lengths, _, _ = paths.evaluate(coordinates)
    nodes = paths.nodes(coordinates)
    drawn = drawn_paths(paths, coordinates)
    wrapped = straight = 0
    for m in range(len(paths.muscles)):
        own = drawn.places[:, drawn.muscle == m]
        found = np.nansum(np.linalg.norm(np.diff(own, axis=1), axis=2), axis=1)
        arcs = (nodes[:, m, :, 3] > 0.0).any(axis=1)
        assert found[~arcs] == pytest.approx(lengths[~arcs, m], rel=1e-9), paths.muscles[m]
        assert found[arcs] == pytest.approx(lengths[arcs, m], rel=0.03), paths.muscles[m]
        wrapped = wrapped + arcs.sum()
        straight = straight + (~arcs).sum()
    assert wrapped > 0
    assert straight > 0


def _path_points(model: Model, muscle: Muscle, poses: Poses, coordinates: Array) -> Array:
    """Return points (frames, points, 3) of a muscle's path in ground [m].

    They are NaN where a conditional one is unused.
    """
    numbers = poses.tree.body_index
    index = {name: i for i, name in enumerate(model.coordinate_names)}
    placed = np.empty((len(coordinates), len(muscle.path.points), 3))
    for k, point in enumerate(muscle.path.points):
        body = numbers.get(point.body, numbers[GROUND])
        if isinstance(point, MovingPathPoint):
            local = np.stack(
                [
                    _value(function, coordinates, index.get(name))
                    for function, name in zip(point.functions, point.coordinates, strict=True)
                ],
                axis=1,
            )
        else:
            local = np.broadcast_to(point.location, (len(coordinates), 3))
        placed[:, k] = (
            np.einsum("fij,fj->fi", poses.rotations[:, body], local) + poses.origins[:, body]
        )
        if not isinstance(point, MovingPathPoint) and point.coordinate:
            q = coordinates[:, index[point.coordinate]]
            placed[(q < point.range[0]) | (q > point.range[1]), k] = np.nan
    return placed


def _value(function: Function, coordinates: Array, column: int | None) -> Array:
    x = coordinates[:, column] if column is not None else np.zeros(len(coordinates))
    value: Array = np.broadcast_to(np.asarray(function(x)), x.shape)
    return value


@pytest.mark.parametrize("model", [*WRAPPED, "moving points"], indirect=True)
def test_nodes_are_the_points_where_nothing_is_wrapped(model: Model) -> None:
    from myomorph.core.rigid.kinematics import forward_kinematics

    paths = compile_paths(model)
    coordinates = _poses(model)
    placed = forward_kinematics(compile_tree(model), coordinates)
    nodes = paths.nodes(coordinates)
    plain = [m for m, one in enumerate(model.muscles) if not one.path.wraps]
    assert plain
    for m in plain[:10]:
        expected = _path_points(model, model.muscles[m], placed, coordinates)
        for f in range(len(coordinates)):
            used = expected[f][np.isfinite(expected[f, :, 0])]
            assert nodes[f, m, : len(used), :3] == pytest.approx(used, abs=1e-12)
            assert np.isnan(nodes[f, m, len(used) :]).all()
            assert not nodes[f, m, : len(used), 3].any()


@pytest.mark.parametrize("model", WRAPPED, indirect=True)
def test_an_arc_leaves_along_the_straight_parts(model: Model) -> None:
    """The drawn curve turns no more than its parts allow: no corner where it meets the surface."""
    paths = compile_paths(model)
    coordinates = _poses(model)
    nodes = paths.nodes(coordinates)
    drawn = drawn_paths(paths, coordinates)
    f, m, n = np.nonzero(nodes[..., 3] > 0.01)
    f = f[0]
    m = m[0]
    n = n[0]
    own = drawn.places[f, drawn.muscle == m]
    at = int(np.flatnonzero(np.abs(own - nodes[f, m, n, :3]).max(axis=1) < 1e-12)[0])
    arc = np.diff(own[at - ARC_PARTS : at + 1], axis=0)
    turns = [np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b)) for a, b in pairwise(arc)]
    whole = np.arccos(arc[0] @ arc[-1] / np.linalg.norm(arc[0]) / np.linalg.norm(arc[-1]))
    assert max(turns) <= whole + 1e-9
