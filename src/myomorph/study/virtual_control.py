"""How the simulated fighters move: each chooses its muscles' activations for the movement and the pull it intends.

The choice is no copy of the criterion that the estimate uses. At every instant the activations a, the forces f under
the soles and the force g of the lapel minimise

    |qdd - wanted|^2 + |feet and lapel stay|^2 + |g - intended|^2 + |sleeve - intended|^2 + sum_m w_m |a_m - a0_m|^3

over a in 0..1 and f in a friction pyramid, with qdd of the equations of motion of both bodies. Weights w differ from
muscle to muscle by a random factor, a0 is a random tone, the cube is taken as a square weighted by the distance an
instant before, and the pull is intended, not economical. What then acts at the soles and in the grips is what MuJoCo's
contacts and constraints make of the activations, not f and g.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import piqp

from myomorph.model.spatial import Array
from myomorph.study.virtual_mat import SLEEVE_LENGTH, SLEEVE_STIFFNESS
from myomorph.study.virtual_poses import jacobian

HORIZON = 0.012
"""Time over which a choice of activations is to give the accelerations that are wanted [s]."""
SMALL = 1e-3
"""Difference of speeds for a slope [m/s]."""


@dataclass(frozen=True)
class Drives:
    """Weights of what the fighters want, in units of what each may be off."""

    acceleration: float = 6.0
    root: float = 2.0
    foot: float = 0.3
    grip: float = 1.0
    pull: float = 25.0
    sleeve: float = 1.0
    effort: float = 0.3
    friction: float = 0.6
    stiffness: float = 120.0


class Controller:
    """Activations of both fighters from the state, instant by instant.

    Parameters
    ----------
    compiled : mujoco.MjModel
    weight, tone : (muscles,) w and a0
    feet : bodies and corner points (body number, (3,)) that stand
    """

    def __init__(self, compiled: Any, weight: Array, tone: Array, drives: Drives, grip: tuple[int, int]):
        self.m, self.weight, self.tone, self.drives = compiled, weight, tone, drives
        self.before = tone.copy()
        self.grip = grip
        self.sleeve = compiled.tendon("sleeve").id
        self.roots = np.concatenate(
            [compiled.jnt_dofadr[j] + np.arange(6) for j in range(compiled.njnt) if compiled.jnt_type[j] == 0]
        )

    def sleeve_jacobian(self, data: Any) -> Array:
        """d(length of the sleeve)/d(rates), (nv,)."""
        m = self.m
        J1, p1 = _site_jacobian(m, data, m.site("tori_grip_l").id)
        J2, p2 = _site_jacobian(m, data, m.site("cuff").id)
        apart = p1 - p2
        found: Array = (apart / np.linalg.norm(apart)) @ (J1 - J2)
        return found

    def activations(
        self,
        data: Any,
        wanted: Array,
        standing: Sequence[tuple[int, Array, Array]],
        pull: Array,
        sleeve: float,
    ) -> Array:
        """Activations (muscles,) at the state of `data`.

        Parameters
        ----------
        wanted : (nv,) accelerations
        standing : corners of soles on the mat: body, point in it
        pull : (3,) intended force of the lapel on tori's hand [N]
        sleeve : intended pull of the sleeve [N]
        """
        m, drives = self.m, self.drives
        nv, nu = m.nv, m.nu
        M = mass_matrix(m, data)
        arms = -moments(m, data)
        active, passive, slope = muscle_strength(m, data)
        tendon = data.qfrc_passive  # the sleeve's spring
        reached = [jacobian(m, data, body, point) for body, point, _ in standing]
        corner = [J for J, _ in reached]
        missed = [place - anchor for (_, place), (_, _, anchor) in zip(reached, standing, strict=True)]
        one, two = self.grip
        J1, p1 = _site_jacobian(m, data, one)
        J2, p2 = _site_jacobian(m, data, two)
        Jg = J1 - J2
        contacts = np.vstack(corner) if corner else np.zeros((0, nv))
        B = np.hstack([arms.T * active, contacts.T, Jg.T])
        b = -data.qfrc_bias + tendon + arms.T @ passive
        # What muscles lose by moving faster is stiff on light bodies such as feet: a step of implicit Euler.
        M = M + HORIZON * (arms.T * (self.before * slope)) @ arms
        B, b = (np.linalg.solve(M, one) for one in (B, b))
        n, k = B.shape[1], len(contacts)
        H, c = np.zeros((n, n)), np.zeros(n)

        def add(A: Array, target: Array, scale: Array | float) -> None:
            A, target = A / np.reshape(scale, (-1, 1)), target / scale
            H[:] += A.T @ A
            c[:] -= A.T @ target

        scale = np.full(nv, drives.acceleration)
        scale[self.roots] = drives.root
        add(B, wanted - b, scale)
        if k:
            still = -40.0 * (contacts @ data.qvel) - 400.0 * np.concatenate(missed)
            add(contacts @ B, still - contacts @ b, drives.foot)
        speed = Jg @ data.qvel
        add(Jg @ B, -400.0 * (p1 - p2) - 40.0 * speed - Jg @ b, drives.grip)
        Js = self.sleeve_jacobian(data)[None]
        longer = SLEEVE_LENGTH + sleeve / SLEEVE_STIFFNESS - float(data.ten_length[self.sleeve])
        stretch = 400.0 * longer - 40.0 * float(data.ten_velocity[self.sleeve])
        add(Js @ B, np.array([stretch]) - Js @ b, drives.sleeve)
        unit = np.zeros((3, n))
        unit[:, -3:] = np.eye(3)
        add(unit, pull, drives.pull)
        effort = drives.effort * self.weight * (0.05 + np.abs(self.before - self.tone))
        diagonal = np.arange(nu)
        H[diagonal, diagonal] += effort
        c[:nu] -= effort * self.tone
        rest = np.arange(nu, n)
        H[rest, rest] += 1e-7
        found = _solve(H, c, nu, k, drives.friction)
        self.before = np.clip(found[:nu], 0.0, 1.0)
        return self.before


def mass_matrix(m: Any, data: Any) -> Array:
    """(nv, nv)."""
    M, column = np.empty((m.nv, m.nv)), np.empty(m.nv)
    for j, unit in enumerate(np.eye(m.nv)):
        mujoco.mj_mulM(m, data, column, unit)
        M[j] = column
    return M


def moments(m: Any, data: Any) -> Array:
    """d(lengths of muscles)/d(rates), (muscles, nv)."""
    found = np.zeros((m.nu, m.nv))
    for i in range(m.nu):
        some = slice(data.moment_rowadr[i], data.moment_rowadr[i] + data.moment_rownnz[i])
        found[i, data.moment_colind[some]] = data.actuator_moment[some]
    return found


def muscle_strength(m: Any, data: Any) -> tuple[Array, Array, Array]:
    """Of every muscle at the state: pull per activation, passive pull [N], what the first gains by speed [N s/m]."""
    active, passive, slope = np.empty(m.nu), np.empty(m.nu), np.empty(m.nu)
    for i in range(m.nu):
        length, speed = float(data.actuator_length[i]), float(data.actuator_velocity[i])
        given = m.actuator_lengthrange[i], float(m.actuator_acc0[i])
        slow, active[i], fast = (
            -mujoco.mju_muscleGain(length, speed + one, *given, m.actuator_gainprm[i, :9])
            for one in (-SMALL, 0.0, SMALL)
        )
        slope[i] = (fast - slow) / (2.0 * SMALL)
        passive[i] = -mujoco.mju_muscleBias(length, *given, m.actuator_biasprm[i, :9])
    return active, passive, slope


def _site_jacobian(m: Any, data: Any, site: int) -> tuple[Array, Array]:
    J = np.zeros((3, m.nv))
    mujoco.mj_jacSite(m, data, J, None, site)
    return J, data.site_xpos[site].copy()


def _solve(H: Array, c: Array, nu: int, k: int, friction: float) -> Array:
    """Min x'Hx/2 + c'x with activations in 0..1 and forces of corners inside pyramids about y."""
    n = len(c)
    corners = k // 3
    G = np.zeros((4 * corners, n))
    for i in range(corners):
        at = nu + 3 * i
        for r, (axis, sign) in enumerate(((0, 1.0), (0, -1.0), (2, 1.0), (2, -1.0))):
            G[4 * i + r, at + axis] = sign
            G[4 * i + r, at + 1] = -friction
    low, high = np.full(n, -np.inf), np.full(n, np.inf)
    low[:nu], high[:nu] = 0.0, 1.0
    low[nu + 1 : nu + k : 3] = 0.0
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = 1e-5
    solver.settings.eps_rel = 1e-5
    h_low = np.full(len(G), -np.inf)
    solver.setup(
        H,
        c,
        None,
        None,
        G if len(G) else None,
        h_low if len(G) else None,
        np.zeros(len(G)) if len(G) else None,
        low,
        high,
    )
    solver.solve()
    return np.array(solver.result.x)
