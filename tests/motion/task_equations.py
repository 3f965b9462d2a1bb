"""Sums of the tasks of inverse kinematics, held against finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.series import Markers
from myomorph.core.motion.ik import InverseKinematicsOptions, pose_problem
from myomorph.core.motion.pose_problem import gradient_and_hessian
from myomorph.core.motion.tasks.task import new_work, sum_of_costs
from myomorph.core.rigid.coordinates import couple
from myomorph.core.rigid.kernels import kernel
from myomorph.core.rigid.kinematics import PoseArrays, body_poses

STEP = 1e-5


@kernel
def equations_at(T, P, independent):
    """Cost of the pose alone, cost with derivatives, gradient and Hessian of half of it."""
    c = independent.copy()
    work = new_work(T, c.shape[0])
    couple(T, c)
    body_poses(T, c, PoseArrays(R=work.R, p=work.p, w=work.w, o=work.o, dphi=work.dphi))
    plain = sum_of_costs(P.tasks, c, 0, work)
    return plain, gradient_and_hessian(T, P, 0, c, work), work.g, work.H


def held_against_differences(tree, tasks, fitting, away):
    """Compare tasks with differences of their cost.

    At a pose that they fit, the Gauss-Newton curvature is complete; away from it cost and gradient
    are compared.
    """
    options = InverseKinematicsOptions(tasks=tasks)
    P = pose_problem(tree, (), np.empty(0), options, Markers(np.zeros(1), (), np.empty((1, 0, 3))))
    plain, cost, g, H = equations_at(tree.arrays, P, fitting)
    assert plain < 1e-20
    assert cost < 1e-20
    np.testing.assert_allclose(g, 0.0, atol=1e-10)
    plain, cost, slope, _ = equations_at(tree.arrays, P, away)
    assert cost == pytest.approx(plain, rel=1e-12)
    for i in P.free:
        step = STEP * np.eye(len(fitting))[i]
        around = [
            equations_at(tree.arrays, P, pose + sign * step)
            for pose in (fitting, away)
            for sign in (1.0, -1.0)
        ]
        np.testing.assert_allclose(
            H[i][P.free], ((around[0][2] - around[1][2]) / (2.0 * STEP))[P.free], atol=1e-6
        )
        assert slope[i] == pytest.approx((around[2][0] - around[3][0]) / (4.0 * STEP), abs=1e-7)
