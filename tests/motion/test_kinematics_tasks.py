"""Gradient and Hessian of the tasks are derivatives of their cost.

They are checked on joints of every kind of function.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.model import Marker
from myomorph.core.model.series import Markers
from myomorph.core.motion.ik import InverseKinematicsOptions, pose_problem
from myomorph.core.motion.pose_problem import gradient_and_hessian
from myomorph.core.motion.tasks.coordinates import CoordinateTask
from myomorph.core.motion.tasks.task import keep_residuals, new_work, sum_of_costs
from myomorph.core.rigid.coordinates import couple
from myomorph.core.rigid.kernels import kernel
from myomorph.core.rigid.kinematics import PoseArrays, body_poses
from myomorph.core.rigid.tree import compile_tree
from trees import functional_tree, random_tree

STEP = 1e-5


@kernel
def equations_at(T, P, independent):
    """Return the cost of poses alone, and the cost with derivatives.

    The derivatives are gradient, Hessian and its Gauss-Newton diagonal; distances are stored.
    """
    c = independent.copy()
    work = new_work(T, c.shape[0])
    couple(T, c)
    body_poses(T, c, PoseArrays(R=work.R, p=work.p, w=work.w, o=work.o, dphi=work.dphi))
    plain = sum_of_costs(P.tasks, c, 0, work)
    cost = gradient_and_hessian(T, P, 0, c, work)
    keep_residuals(P.tasks, c, 0, work)
    return plain, cost, work.g, work.H, work.D


def problem(model, seed):
    """Return kernel arguments for three markers per body, and a pose.

    They hold the markers' positions there, one of them unseen.
    """
    rng = np.random.default_rng(seed)
    markers = tuple(
        Marker(f"{body.name}_{i}", body.name, rng.normal(scale=0.2, size=3))
        for body in model.bodies
        for i in range(3)
    )
    model = replace(model, markers=markers)
    tree = compile_tree(model)
    weights = rng.uniform(0.5, 2.0, len(markers))
    observed = rng.normal(size=(1, len(markers), 3))
    observed[0, 4] = np.nan
    n = len(model.coordinates)
    options = InverseKinematicsOptions(tasks=[CoordinateTask("c7", 0.3, float(rng.normal()))])
    recording = Markers(np.zeros(1), model.marker_names, observed)
    P = pose_problem(tree, model.marker_names, weights, options, recording)
    return tree.arrays, P, rng.uniform(-1.0, 1.0, n)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("made", [random_tree, functional_tree])
def test_the_derivatives_are_those_of_the_cost(made, seed):
    T, P, c = problem(made(seed), seed)
    plain, cost, g, H, _ = equations_at(T, P, c)
    mean = _mean_square(P.markers)
    pulls = P.coordinates.weight @ (c - P.coordinates.value[0]) ** 2
    assert pulls > 0.0
    assert plain == pytest.approx(mean + pulls, rel=1e-12)
    assert cost == pytest.approx(plain, rel=1e-12)
    for i in P.free:
        ahead = equations_at(T, P, c + 1.0 * STEP * np.eye(len(c))[i])
        behind = equations_at(T, P, c + (-1.0) * STEP * np.eye(len(c))[i])
        # Of half the cost.
        slope = (ahead[0] - behind[0]) / (4.0 * STEP)
        assert g[i] == pytest.approx(slope, rel=1e-6, abs=1e-7), i
        column = (ahead[2] - behind[2]) / (2.0 * STEP)
        np.testing.assert_allclose(H[i][P.free], column[P.free], rtol=1e-6, atol=1e-6)


def _mean_square(markers):
    """Return the weighted mean square distance of the markers but the one unseen."""
    distances = markers.errors[0]
    seen = np.isfinite(distances)
    assert seen.sum() == len(distances) - 1
    return markers.weight[seen] @ distances[seen] ** 2 / markers.weight[seen].sum()


def test_where_markers_fit_the_gauss_newton_diagonal_is_the_hessians():
    T, P, c = problem(random_tree(5), 5)
    bare = P.with_coordinates(weight=np.zeros_like(c))
    places = np.zeros_like(P.markers.observed)
    for i in range(3):
        # The distances from two points on an axis give the place along it.
        distances = []
        for point in np.array([1.0, -1.0])[:, None, None, None] * np.eye(3)[i] + np.zeros_like(
            places
        ):
            equations_at(T, bare.with_markers(observed=point), c)
            distances.append(P.markers.errors[0] ** 2)
        places[0, :, i] = (distances[1] - distances[0]) / 4.0
    _, cost, _, H, D = equations_at(T, bare.with_markers(observed=places), c)
    np.testing.assert_allclose(P.markers.errors, 0.0, atol=1e-12)
    assert cost < 1e-24
    np.testing.assert_allclose(D[P.free], np.diag(H)[P.free], rtol=1e-9)
