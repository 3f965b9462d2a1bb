"""Gradient and Hessian of the marker cost are derivatives of the cost, on joints of every kind of function."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.model.model import Marker
from myomorph.motion.ik import CoordinateTask, InverseKinematicsOptions, marker_arrays
from myomorph.motion.marker_cost import marker_cost, marker_distances, new_work, normal_equations
from myomorph.rigid.couplers import couple
from myomorph.rigid.kernels import kernel
from myomorph.rigid.kinematics import body_poses
from myomorph.rigid.tree import compile_tree
from trees import functional_tree, random_tree

STEP = 1e-5


@kernel
def equations_at(T, K, observed, target, independent):
    """Cost of poses alone, cost with derivatives, gradient, Hessian, its Gauss-Newton diagonal, distances."""
    c, distances = independent.copy(), np.empty(K.body.shape[0])
    work = new_work(T, c.shape[0])
    couple(T, c)
    body_poses(T, c, work.R, work.p, work.w, work.o, work.dphi)
    plain = marker_cost(K, observed, target, c, work.R, work.p)
    cost = normal_equations(T, K, observed, target, c, work)
    marker_distances(T, K, observed, c, work, distances)
    return plain, cost, work.g, work.H, work.D, distances


def problem(model, seed):
    """Kernel arguments for three markers a body, their places there, one of them unseen, and a pose."""
    rng = np.random.default_rng(seed)
    markers = tuple(
        Marker(f"{body.name}_{i}", body.name, rng.normal(scale=0.2, size=3)) for body in model.bodies for i in range(3)
    )
    model = replace(model, markers=markers)
    tree = compile_tree(model)
    options = InverseKinematicsOptions(coordinate_tasks={"c7": CoordinateTask(0.3)})
    K = marker_arrays(tree, model.marker_names, rng.uniform(0.5, 2.0, len(markers)), options)
    observed = rng.normal(size=(len(markers), 3))
    observed[4] = np.nan
    n = len(model.coordinates)
    return tree.arrays, K, observed, rng.normal(size=n), rng.uniform(-1.0, 1.0, n)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("made", [random_tree, functional_tree])
def test_the_derivatives_are_those_of_the_cost(made, seed):
    T, K, observed, target, c = problem(made(seed), seed)
    plain, cost, g, H, _, distances = equations_at(T, K, observed, target, c)
    seen = np.isfinite(distances)
    assert seen.sum() == len(observed) - 1
    mean = K.weight[seen] @ distances[seen] ** 2 / K.weight[seen].sum()
    assert plain == pytest.approx(mean + K.task_weight @ (c - target) ** 2, rel=1e-12)
    assert cost == pytest.approx(plain, rel=1e-12)
    for i in K.free:
        ahead, behind = (equations_at(T, K, observed, target, c + s * STEP * np.eye(len(c))[i]) for s in (1.0, -1.0))
        # Of half the cost.
        slope = (ahead[0] - behind[0]) / (4.0 * STEP)
        assert g[i] == pytest.approx(slope, rel=1e-6, abs=1e-7), i
        column = (ahead[2] - behind[2]) / (2.0 * STEP)
        np.testing.assert_allclose(H[i][K.free], column[K.free], rtol=1e-6, atol=1e-6)


def test_where_markers_fit_the_gauss_newton_diagonal_is_the_hessians():
    T, K, observed, target, c = problem(random_tree(5), 5)
    fitting = np.zeros_like(observed)
    for i in range(3):
        # The distances from two points on an axis give the place along it.
        at = [np.zeros_like(observed) for _ in range(2)]
        at[0][:, i], at[1][:, i] = 1.0, -1.0
        ahead, behind = (equations_at(T, K, one, target, c)[5] ** 2 for one in at)
        fitting[:, i] = (behind - ahead) / 4.0
    _, cost, _, H, D, distances = equations_at(T, K, fitting, c, c)
    np.testing.assert_allclose(distances, 0.0, atol=1e-12)
    assert cost < 1e-24
    np.testing.assert_allclose(D[K.free], np.diag(H)[K.free], rtol=1e-9)
