"""Poses of two simulated fighters that keep feet on the mat and grips closed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from myomorph.model.arrays import Array

ROUNDS = 60


@dataclass(frozen=True, eq=False)
class Aim:
    """What a pose should reach.

    Attributes
    ----------
    body : whose point, or whose attitude, is aimed at
    point : (3,) in its frame [m]; None aims at the attitude
    target : (3,) in ground [m], or a (3, 3) attitude; None with `other` for a point that moves along
    other, other_point : body and point that the first one's point should stand at
    offset : (3,) from there, in ground [m]
    weight : against the others
    """

    body: str
    point: Array | None
    target: Array | None = None
    other: str = ""
    other_point: Array | None = None
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    weight: float = 1.0


def posed(compiled: Any, start: Array, aims: Sequence[Aim], posture: float = 0.03) -> Array:
    """The pose (nq,) nearest to `start` that meets the aims, by damped Gauss-Newton steps.

    Parameters
    ----------
    posture : weight of staying at `start`, against an aim's 1
    """
    data = mujoco.MjData(compiled)
    q = start.copy()
    n = compiled.nv
    for _ in range(ROUNDS):
        data.qpos[:] = q
        mujoco.mj_kinematics(compiled, data)
        mujoco.mj_comPos(compiled, data)
        away = np.empty(n)
        mujoco.mj_differentiatePos(compiled, away, 1.0, q, start)
        keep = np.full(n, posture)
        keep[_roots(compiled)] = 1e-4
        rows, errors = [np.diag(keep)], [keep * away]
        for aim in aims:
            J, error = _row(compiled, data, aim)
            rows.append(aim.weight * J)
            errors.append(aim.weight * error)
        A, b = np.vstack(rows), np.concatenate(errors)
        step = np.linalg.solve(A.T @ A + 1e-9 * np.eye(n), A.T @ b)
        step *= min(1.0, 0.3 / max(1e-12, float(np.abs(step).max())))
        mujoco.mj_integratePos(compiled, q, step, 1.0)
        if np.abs(step).max() < 1e-9:
            break
    return q


def _roots(compiled: Any) -> np.ndarray:
    free = [j for j in range(compiled.njnt) if compiled.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE]
    return np.concatenate([compiled.jnt_dofadr[j] + np.arange(6) for j in free])


def _row(compiled: Any, data: Any, aim: Aim) -> tuple[Array, Array]:
    n = compiled.nv
    body = compiled.body(aim.body).id
    if aim.point is None:
        turning = np.zeros((3, n))
        mujoco.mj_jacBody(compiled, data, None, turning, body)
        miss = np.asarray(aim.target) @ data.xmat[body].reshape(3, 3).T
        axis = 0.5 * np.array([miss[2, 1] - miss[1, 2], miss[0, 2] - miss[2, 0], miss[1, 0] - miss[0, 1]])
        return turning, axis
    J, place = jacobian(compiled, data, body, aim.point)
    if aim.other:
        there = compiled.body(aim.other).id
        K, target = jacobian(compiled, data, there, np.asarray(aim.other_point))
        return J - K, target + aim.offset - place
    return J, np.asarray(aim.target) - place


def jacobian(compiled: Any, data: Any, body: int, point: Array) -> tuple[Array, Array]:
    """d(place)/d(rates) (3, nv) of a point fixed to a body, and its place (3,) in ground [m]."""
    J = np.zeros((3, compiled.nv))
    place = data.xpos[body] + data.xmat[body].reshape(3, 3) @ point
    mujoco.mj_jac(compiled, data, J, None, place, body)
    return J, place
