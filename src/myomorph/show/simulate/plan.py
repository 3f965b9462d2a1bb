"""The plan of two simulated fighters: a pull, a sway or a step.

Its poses have feet on the mat and grips closed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import mujoco
import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import check_name
from myomorph.core.model.spatial import axis_rotation
from myomorph.show.simulate.fighter import APART, CUFF, GRIP, LAPEL, LEG, PARTS, Build, sole_points

ROUNDS = 60
WHOLE = "whole body"


@read_only
class Aim:
    """What a pose should reach."""

    # whose point, or whose attitude, is aimed at; `WHOLE` for the mass center of a person alone
    body: str
    point: Array | None  # (3,) in its frame [m]; None aims at the attitude
    # (3,) in ground [m], or a (3, 3) attitude; None with `other` for a point that moves along
    target: Array | None = None
    # other, other_point: body and point that the first one's point should stand at
    other: str = ""
    other_point: Array | None = None
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # (3,) from there, in ground [m]
    weight: float = 1.0  # against the others


def posed(compiled: Any, start: Array, aims: Sequence[Aim], posture: float = 0.03) -> Array:
    """Find the pose that meets aims, by damped Gauss-Newton steps.

    Parameters
    ----------
    compiled : mujoco.MjModel
    start : (nq,) the pose to stay near
    aims : what the pose has to reach
    posture : weight of `start`

    Returns
    -------
    (nq,)
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
        keep[roots(compiled)] = 1e-4
        rows = [np.diag(keep)]
        errors = [keep * away]
        for aim in aims:
            J, error = _row(compiled, data, aim)
            rows.append(aim.weight * J)
            errors.append(aim.weight * error)
        A = np.vstack(rows)
        b = np.concatenate(errors)
        step = np.linalg.solve(A.T @ A + 1e-9 * np.eye(n), A.T @ b)
        step *= min(1.0, 0.3 / max(1e-12, float(np.abs(step).max())))
        mujoco.mj_integratePos(compiled, q, step, 1.0)
        if np.abs(step).max() < 1e-9:
            break
    return q


def roots(compiled: Any) -> np.ndarray:
    """Find the rates of free joints.

    Parameters
    ----------
    compiled : mujoco.MjModel

    Returns
    -------
    Indices into the rates
    """
    free = [j for j in range(compiled.njnt) if compiled.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE]
    return np.concatenate([compiled.jnt_dofadr[j] + np.arange(6) for j in free])


def _row(compiled: Any, data: Any, aim: Aim) -> tuple[Array, Array]:
    n = compiled.nv
    if aim.body == WHOLE:
        J = np.zeros((3, n))
        mujoco.mj_jacSubtreeCom(compiled, data, J, 0)
        return J, np.asarray(aim.target) - data.subtree_com[0]
    body = compiled.body(aim.body).id
    if aim.point is None:
        turning = np.zeros((3, n))
        mujoco.mj_jacBody(compiled, data, None, turning, body)
        miss = np.asarray(aim.target) @ data.xmat[body].reshape(3, 3).T
        axis = 0.5 * np.array(
            [miss[2, 1] - miss[1, 2], miss[0, 2] - miss[2, 0], miss[1, 0] - miss[0, 1]]
        )
        return turning, axis
    J, place = jacobian(compiled, data, body, aim.point)
    if aim.other:
        there = compiled.body(aim.other).id
        K, target = jacobian(compiled, data, there, np.asarray(aim.other_point))
        return J - K, target + aim.offset - place
    return J, np.asarray(aim.target) - place


def jacobian(compiled: Any, data: Any, body: int, point: Array) -> tuple[Array, Array]:
    """Compute d(position)/d(rates) of a point fixed to a body, and its position.

    Parameters
    ----------
    compiled : mujoco.MjModel
    data : the state
    body : number
    point : (3,) in the body's frame [m]

    Returns
    -------
    (3, nv), and (3,) in ground [m]
    """
    J = np.zeros((3, compiled.nv))
    place = data.xpos[body] + data.xmat[body].reshape(3, 3) @ point
    mujoco.mj_jac(compiled, data, J, None, place, body)
    return J, place


Kind = Literal["pull", "sway", "step"]
FEET = {
    "tori": {"r": (-0.2, 0.15), "l": (0.08, -0.14)},
    "uke": {"r": (0.2, -0.15), "l": (-0.08, 0.14)},
}
"""Places of the ankles on the mat from the middle of each stance, x and z in ground [m]."""
MIDDLE = {"tori": 0.0, "uke": APART}
BACKWARD = {"tori": -1.0, "uke": 1.0}
BENT = {
    "knee_angle": -0.5,
    "hip_flexion": 0.45,
    "ankle_angle": 0.12,
    "elbow_flex": 1.0,
    "arm_flex": 0.5,
}
"""Joints of the pose that all poses start from [rad]."""
# From where the sleeve is sewn on to the fist that holds it, in ground [m].
HOLD = (-0.065, 0.0, -0.01)


@dataclass(frozen=True)
class Stance:
    """One instant of the plan."""

    time: float  # [s]
    # how far each pelvis is behind the middle of its stance [m]
    back: tuple[float, float] = (0.1, 0.1)
    lean: tuple[float, float] = (0.1, 0.1)  # how far each trunk leans back [rad]
    sway: tuple[float, float] = (0.0, 0.0)  # of the pelves to tori's right [m]
    drop: float = 0.07  # of the pelves below straight legs [m]
    twist: float = 0.0  # of tori's trunk to the left [rad]
    # lapel, sleeve: pulls intended [N]
    lapel: float = 40.0
    sleeve: float = 25.0
    foot: tuple[float, float] = (0.0, 0.0)  # shift of tori's right foot, backward and up [m]


@read_only
class Plan:
    """Stances as poses, and what lies between them."""

    stances: tuple[Stance, ...]  # in the order of time
    poses: Array  # (stances, nq)
    # from when to when tori's right foot is off the mat [s]; both 0 for never
    lifted: tuple[float, float] = (0.0, 0.0)

    @property
    def duration(self) -> float:
        """[s]."""
        return self.stances[-1].time

    def at(self, compiled: Any, time: float) -> tuple[Array, Array, Array]:
        """Interpolate the plan.

        Parameters
        ----------
        compiled : mujoco.MjModel
        time : [s]

        Returns
        -------
        Pose (nq,), rates and accelerations (nv,)
        """
        times = np.array([stance.time for stance in self.stances])
        pose = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 2))
        length = float(times[pose + 1] - times[pose])
        x = float(np.clip((time - times[pose]) / length, 0.0, 1.0))
        weight = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        first = 30.0 * x * x * (1.0 - x) ** 2 / length
        second = 60.0 * x * (1.0 - 3.0 * x + 2.0 * x * x) / length**2
        way = np.empty(compiled.nv)
        mujoco.mj_differentiatePos(compiled, way, 1.0, self.poses[pose], self.poses[pose + 1])
        q = self.poses[pose].copy()
        mujoco.mj_integratePos(compiled, q, way, weight)
        return q, first * way, second * way

    def pulls(self, time: float) -> tuple[float, float]:
        """Intended pulls at lapel and sleeve [N]."""
        times = [stance.time for stance in self.stances]
        lapel = [stance.lapel for stance in self.stances]
        sleeve = [stance.sleeve for stance in self.stances]
        return float(np.interp(time, times, lapel)), float(np.interp(time, times, sleeve))


def make_plan(
    compiled: Any,
    builds: Mapping[str, Build],
    kind: str,
    random: np.random.Generator,
    vigor: float = 1.0,
) -> Plan:
    """Draw a plan of one kind.

    `vigor` is a factor of the pulls, and of how far the fighters lean back.
    """
    check_name("kind of bout", kind, get_args(Kind), "the simulation")
    base = Stance(
        0.0,
        (0.12 * vigor, 0.12 * vigor),
        (-0.05, -0.05),
        drop=random.uniform(0.07, 0.1),
        lapel=50.0 * vigor,
        sleeve=35.0 * vigor,
    )
    hard = replace(
        base,
        back=(random.uniform(0.2, 0.23) * vigor, random.uniform(0.2, 0.23) * vigor),
        lean=(random.uniform(-0.1, 0.0), random.uniform(-0.1, 0.0)),
        lapel=random.uniform(100.0, 140.0) * vigor,
        sleeve=random.uniform(60.0, 90.0) * vigor,
    )
    lifted = (0.0, 0.0)
    still = replace(base, time=0.3)
    if kind == "pull":
        stances = [
            base,
            still,
            replace(hard, time=1.0),
            replace(hard, time=1.4),
            replace(base, time=2.1),
        ]
    elif kind == "sway":
        s = random.uniform(0.015, 0.03)
        stances = [base, still, replace(hard, time=1.0, sway=(s, s), twist=0.05)]
        stances += [replace(hard, time=1.8, sway=(-s, -s), twist=-0.05), replace(hard, time=2.5)]
    else:
        far = random.uniform(0.08, 0.14)
        over = (-0.115, -0.02)
        stances = [
            base,
            still,
            replace(base, time=1.2, sway=over),
            replace(base, time=1.3, sway=over),
        ]
        stances += [replace(base, time=1.55, sway=over, foot=(0.5 * far, 0.05))]
        stances += [
            replace(base, time=1.8, sway=over, foot=(far, 0.0)),
            replace(base, time=2.8, foot=(far, 0.0)),
        ]
        lifted = (1.3, 1.8)
    start = start_pose(compiled)
    poses = []
    for stance in stances:
        start = posed(compiled, start, aims_of(builds, stance), 0.02)
        poses.append(start)
    return Plan(tuple(stances), np.array(poses), lifted)


def start_pose(compiled: Any, begins: Sequence[str] = ("tori_", "uke_")) -> Array:
    """Bend knees and elbows, for a pose from which others are sought.

    Parameters
    ----------
    compiled : mujoco.MjModel
    begins : of the names of each person's joints

    Returns
    -------
    (nq,)
    """
    q = np.array(compiled.qpos0)
    for begin in begins:
        for name, angle in BENT.items():
            for side in "rl":
                q[compiled.joint(f"{begin}{name}_{side}").qposadr[0]] = angle
    return q


def aims_of(builds: Mapping[str, Build], stance: Stance) -> Sequence[Aim]:
    """Return what a pose has to reach.

    Feet are on their positions, grips closed, pelves and trunks as the stance has them.
    """
    aims: list[Aim] = []
    size = {part: builds[part].size for part in PARTS}
    for part, forward in (("tori", 1.0), ("uke", -1.0)):
        for side, (x, z) in FEET[part].items():
            moves = part == "tori" and side == "r"
            back, up = stance.foot if moves else (0.0, 0.0)
            for point in sole_points(side).values():
                place = np.array([x + MIDDLE[part] - back, up, z]) + forward * size[
                    part
                ] * point * (1.0, 0.0, 1.0)
                aims.append(Aim(f"{part}_foot_{side}", size[part] * point, place, weight=10.0))
        fighter = PARTS.index(part)
        straight = size[part] * LEG
        pelvis = np.array(
            [
                MIDDLE[part] + BACKWARD[part] * stance.back[fighter],
                straight - stance.drop,
                stance.sway[fighter],
            ]
        )
        aims.append(Aim(f"{part}_pelvis", np.zeros(3), pelvis))
        turn, twist = (0.0, stance.twist) if part == "tori" else (np.pi, 0.0)
        for body, share in (("torso", 1.0), ("pelvis", 0.6)):
            lean = axis_rotation((0, 0, 1), share * stance.lean[fighter])
            aims.append(
                Aim(
                    f"{part}_{body}",
                    None,
                    axis_rotation((0, 1, 0), turn + share * twist) @ lean,
                    weight=0.5,
                )
            )
    fist = size["tori"] * np.array(GRIP)
    other = size["uke"]
    aims.append(
        Aim("tori_forearm_r", fist, other="uke_torso", other_point=other * LAPEL, weight=10.0)
    )
    aims.append(
        Aim("tori_forearm_l", fist, other="uke_forearm_r", other_point=other * CUFF, offset=HOLD)
    )
    return aims
