"""A bout: two simulated fighters moved through a plan by their muscles.

Every force that passed is known. Each fighter chooses its muscles' activations for the movement and
the pull it intends. The choice is no copy of the criterion that the estimate uses. At every instant
the activations a, the forces f under the soles and the force g of the lapel minimise

    |qdd - wanted|^2 + |feet and lapel stay|^2 + |g - intended|^2 + |sleeve - intended|^2
    + sum_m w_m |a_m - a0_m|^3

over a in 0..1 and f in a friction pyramid, with qdd of the equations of motion of both bodies.
Weights w differ from muscle to muscle by a random factor, a0 is a random tone, the cube is taken as
a square weighted by the distance an instant before, and the pull is intended, not economical. What
then acts at the soles and in the grips is what MuJoCo's contacts and constraints make of the
activations, not f and g.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import from_extra
from myomorph.show.simulate.fighter import (
    PARTS,
    SLEEVE_DAMPING,
    SLEEVE_LENGTH,
    SLEEVE_STIFFNESS,
    STEP,
    Build,
    sole_points,
)
from myomorph.show.simulate.plan import Plan, jacobian, roots

# Time over which a choice of activations is to give the accelerations that are wanted [s].
HORIZON = 0.012
SMALL = 1e-3  # Difference of speeds for a slope [m/s].


# How far off each aim may be for a cost of 1; the smaller, the more the fighters want it.
ACCELERATION = 6.0
ROOT = 2.0  # Accelerations of joints and of pelves [rad/s^2, m/s^2]
FOOT = 0.3
LAPEL = 1.0
SLEEVE = 1.0  # Those of soles, of the lapel's gap and of the sleeve's length [m/s^2]
PULL = 25.0  # The intended force at the lapel [N]
EFFORT = 0.3  # Factor of the muscles' cost
FRICTION = 0.6  # Coefficient that the fighters count on
STIFFNESS = 120.0  # Of the way back to the plan [1/s^2]


class Habits(NamedTuple):
    """How both fighters recruit their muscles, w and a0 of the cost above."""

    weight: Array  # (muscles,)
    tone: Array  # (muscles,) activation at rest


class Controller:
    """Activations of both fighters from the state, instant by instant."""

    def __init__(self, compiled: Any, habits: Habits):
        self._m = compiled
        self._weight = habits.weight
        self._tone = habits.tone
        self._before = habits.tone.copy()
        self._scale = np.full(compiled.nv, ACCELERATION)
        self._scale[roots(compiled)] = ROOT

    def activations(
        self,
        data: Any,
        wanted: Array,
        standing: Sequence[tuple[int, Array, Array]],
        lapel: Array,
        pull: float,
    ) -> Array:
        """Choose the activations at a state.

        Parameters
        ----------
        data : the state, of which positions and velocities are up to date
        wanted : (nv,) accelerations [rad/s^2 or m/s^2]
        standing : corners of soles on the mat: number of the body, point in it (3,), and where it
            came down (3,) [m]
        lapel : (3,) intended force on tori's hand [N]
        pull : intended at the sleeve [N]

        Returns
        -------
        (muscles,) from 0 to 1
        """
        m = self._m
        soles = [jacobian(m, data, body, point) for body, point, _ in standing]
        feet = np.vstack([J for J, _ in soles]) if soles else np.zeros((0, m.nv))
        grip, gap = _between(m, data, "tori_grip_r", "lapel")
        B, b = self._accelerations(data, feet, grip)
        aims = _Aims(B, b)
        aims.add(np.eye(m.nv), wanted, self._scale)
        if soles:
            missed = np.concatenate(
                [at - kept for (_, at), (_, _, kept) in zip(soles, standing, strict=True)]
            )
            aims.add(feet, -_RATE * (feet @ data.qvel) - _STIFF * missed, FOOT)
        aims.add(grip, -_RATE * (grip @ data.qvel) - _STIFF * gap, LAPEL)
        sleeve, longer, rate = self._sleeve(data, pull)
        aims.add(sleeve[None], np.array([_STIFF * longer - _RATE * rate]), SLEEVE)
        muscles = slice(0, m.nu)
        effort = EFFORT * self._weight * (0.05 + np.abs(self._before - self._tone))
        aims.pull(muscles, self._tone, effort)
        aims.pull(slice(m.nu, None), np.zeros(B.shape[1] - m.nu), 1e-7)
        aims.pull(slice(-3, None), lapel, PULL**-2)
        self._before = np.clip(_solve(aims.H, aims.c, m.nu, len(feet) // 3)[muscles], 0.0, 1.0)
        return self._before

    def _accelerations(self, data: Any, feet: Array, grip: Array) -> tuple[Array, Array]:
        """Qdd = B x + b with x the activations, the forces of soles and that of the lapel."""
        m = self._m
        arms = -moments(m, data)
        active, passive, slope = muscle_strength(m, data)
        # What muscles lose by moving faster is stiff on light bodies such as feet: a step of
        # implicit Euler.
        mass = mass_matrix(m, data) + HORIZON * (arms.T * (self._before * slope)) @ arms
        # The passive forces of MuJoCo are the sleeve's alone.
        free = data.qfrc_passive - data.qfrc_bias + arms.T @ passive
        B = np.linalg.solve(mass, np.column_stack([arms.T * active, feet.T, grip.T, free]))
        return B[:, :-1], B[:, -1]

    def _sleeve(self, data: Any, pull: float) -> tuple[Array, float, float]:
        """Compute d(length)/d(rates) (nv,) of the sleeve.

        What it lacks for a pull [m], and how fast it grows [m/s], come with it.
        """
        J, apart = _between(self._m, data, "tori_grip_l", "cuff")
        length = float(np.linalg.norm(apart))
        slope = apart / length @ J
        return slope, SLEEVE_LENGTH + pull / SLEEVE_STIFFNESS - length, float(slope @ data.qvel)


_STIFF = 400.0
_RATE = 40.0
"""Of what holds soles, lapel and sleeve where they should be: critically damped [1/s^2], [1/s]."""


class _Aims:
    """A sum of squares x'Hx / 2 + c'x of accelerations B x + b and of x itself."""

    def __init__(self, B: Array, b: Array):
        self._B = B
        self._b = b
        self.H = np.zeros((B.shape[1], B.shape[1]))
        self.c = np.zeros(B.shape[1])

    def add(self, J: Array, target: Array, scale: Array | float) -> None:
        """Add the square of (J qdd - target) / scale."""
        A = J @ self._B / np.reshape(scale, (-1, 1))
        miss = (target - J @ self._b) / scale
        self.H += A.T @ A
        self.c -= A.T @ miss

    def pull(self, some: slice, target: Array, weight: Array | float) -> None:
        """Weight (x - target)^2 of some of x."""
        chosen = np.arange(len(self.c))[some]
        self.H[chosen, chosen] += weight
        self.c[chosen] -= weight * target


def mass_matrix(m: Any, data: Any) -> Array:
    """Compute the mass matrix at a state.

    Parameters
    ----------
    m : mujoco.MjModel
    data : the state

    Returns
    -------
    (nv, nv)
    """
    M = np.empty((m.nv, m.nv))
    column = np.empty(m.nv)
    for j, unit in enumerate(np.eye(m.nv)):
        mujoco.mj_mulM(m, data, column, unit)
        M[j] = column
    return M


def moments(m: Any, data: Any) -> Array:
    """Compute the moment-arm matrix at a state.

    Parameters
    ----------
    m : mujoco.MjModel
    data : the state

    Returns
    -------
    (muscles, nv) d(lengths of muscles)/d(rates)
    """
    result = np.zeros((m.nu, m.nv))
    for i in range(m.nu):
        some = slice(data.moment_rowadr[i], data.moment_rowadr[i] + data.moment_rownnz[i])
        result[i, data.moment_colind[some]] = data.actuator_moment[some]
    return result


def muscle_strength(m: Any, data: Any) -> tuple[Array, Array, Array]:
    """Compute what every muscle can pull at a state.

    Parameters
    ----------
    m : mujoco.MjModel
    data : the state

    Returns
    -------
    (muscles,) pull per activation [N], passive pull [N], and what the first gains by speed [N s/m]
    """
    active = np.empty(m.nu)
    passive = np.empty(m.nu)
    slope = np.empty(m.nu)
    for i in range(m.nu):
        length = float(data.actuator_length[i])
        speed = float(data.actuator_velocity[i])
        limits = m.actuator_lengthrange[i], float(m.actuator_acc0[i])
        slow = -mujoco.mju_muscleGain(length, speed - SMALL, *limits, m.actuator_gainprm[i, :9])
        active[i] = -mujoco.mju_muscleGain(length, speed, *limits, m.actuator_gainprm[i, :9])
        fast = -mujoco.mju_muscleGain(length, speed + SMALL, *limits, m.actuator_gainprm[i, :9])
        slope[i] = (fast - slow) / (2.0 * SMALL)
        passive[i] = -mujoco.mju_muscleBias(length, *limits, m.actuator_biasprm[i, :9])
    return active, passive, slope


def _between(m: Any, data: Any, first: str, second: str) -> tuple[Array, Array]:
    """d/d(rates) (3, nv) of the way from the second site to the first, and that way (3,) [m]."""
    first_jacobian = np.zeros((3, m.nv))
    other = np.zeros((3, m.nv))
    a = m.site(first).id
    b = m.site(second).id
    mujoco.mj_jacSite(m, data, first_jacobian, None, a)
    mujoco.mj_jacSite(m, data, other, None, b)
    return first_jacobian - other, data.site_xpos[a] - data.site_xpos[b]


def _solve(H: Array, c: Array, muscles: int, corners: int) -> Array:
    """Min x'Hx/2 + c'x with activations in 0..1 and forces of corners inside pyramids about y."""
    n = len(c)
    low = np.full(n, -np.inf)
    high = np.full(n, np.inf)
    low[:muscles] = 0.0
    high[:muscles] = 1.0
    forces = slice(muscles, muscles + 3 * corners)
    low[forces][1::3] = 0.0
    G = np.zeros((4 * corners, n))
    G[:, forces] = pyramids(corners, FRICTION)
    return least(Program(H=H, c=c, low=low, high=high, G=G if corners else None), 1e-5)


def pyramids(corners: int, friction: float) -> Array:
    """Make the matrix of friction pyramids about y.

    Parameters
    ----------
    corners : points with a force each
    friction : coefficient

    Returns
    -------
    G (4 corners, 3 corners); the forces f inside are those of G f <= 0
    """
    across = [
        [1.0, -friction, 0.0],
        [-1.0, -friction, 0.0],
        [0.0, -friction, 1.0],
        [0.0, -friction, -1.0],
    ]
    return np.asarray(np.kron(np.eye(corners), across), dtype=np.float64)


class Program(NamedTuple):
    """Minimize x'Hx/2 + c'x with low <= x <= high and G x <= 0."""

    H: Array  # (n, n)
    c: Array  # (n,)
    low: Array  # (n,)
    high: Array  # (n,)
    G: Array | None = None  # (rows, n); None for no such rows


def least(program: Program, accuracy: float) -> Array:
    """Solve a convex quadratic program.

    Parameters
    ----------
    program : its matrices
    accuracy : of the solution, absolute and relative

    Returns
    -------
    (n,) x
    """
    H, c, low, high, G = program
    solver = from_extra("demo", "piqp").DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = accuracy
    solver.setup(H, c, None, None, G, None, None if G is None else np.zeros(len(G)), low, high)
    solver.solve()
    return np.array(solver.result.x)


FEET = tuple(f"{part}_foot_{side}" for part in PARTS for side in "rl")
GRIPS = ("lapel", "sleeve")
CONTROL = 4  # Steps of the integrator between choices of activations.
LAG = 0.01  # Time constant of activations after them [s].


@read_only
class Run:
    """What happened, step by step."""

    time: Array  # (steps,) [s]
    qpos: Array  # (steps, nq)
    # activations, tensions: (steps, muscles) [1, N]
    activations: Array
    tensions: Array
    # forces, moments: (steps, contacts, 3) on tori (of soles: on the foot), moments about the
    # ground's origin, of the four feet and the two grips [N], [N m]
    forces: Array
    moments: Array
    places: Array  # (steps, grips, 3) where the grips' forces act [m]
    strayed: Array  # (steps,) greatest distance of a joint from the plan [rad]


def simulate_bout(
    compiled: Any,
    builds: Mapping[str, Build],
    plan: Plan,
    habits: Habits,
    until: float = np.inf,
) -> Run:
    """Move both fighters through a plan.

    Parameters
    ----------
    compiled : mujoco.MjModel of both
    builds : by fighter
    plan : poses and pulls over time
    habits : weights and tone of the muscles
    until : time at which it ends, where the plan is longer [s]

    Returns
    -------
    What happened at every step
    """
    m = compiled
    data = mujoco.MjData(m)
    data.qpos[:] = plan.poses[0]
    controller = Controller(m, habits)
    steps = round(min(plan.duration, until) / STEP)
    record = _empty_record(m, steps)
    anchors: dict[str, list[tuple[int, Array, Array]]] = {}
    activation = habits.tone.copy()
    chosen = habits.tone
    for index in range(steps):
        mujoco.mj_step1(m, data)
        if index % CONTROL == 0:
            standing = _standing(m, data, builds, plan, index * STEP, anchors)
            aim, strayed = _aim(m, data, plan, index * STEP)
            record["strayed"][index : index + CONTROL] = strayed
            lapel, sleeve = plan.pulls(index * STEP)
            chosen = controller.activations(
                data, aim, standing, np.array([lapel, 0.0, 0.0]), sleeve
            )
        activation = activation + (chosen - activation) * (1.0 - np.exp(-STEP / LAG))
        data.ctrl[:] = activation
        record["time"][index] = index * STEP
        record["qpos"][index] = data.qpos
        record["activations"][index] = activation
        mujoco.mj_step2(m, data)
        record["tensions"][index] = -data.actuator_force
        _record_soles(m, data, record, index)
        _record_grips(m, data, record, index)
    return Run(
        time=record["time"],
        qpos=record["qpos"],
        activations=record["activations"],
        tensions=record["tensions"],
        forces=record["forces"],
        moments=record["moments"],
        places=record["places"],
        strayed=record["strayed"],
    )


def _empty_record(m: Any, steps: int) -> dict[str, Array]:
    """Allocate the fields of `Run` for so many steps."""
    contacts = len(FEET) + len(GRIPS)
    return {
        "time": np.empty(steps),
        "qpos": np.empty((steps, m.nq)),
        "activations": np.empty((steps, m.nu)),
        "tensions": np.empty((steps, m.nu)),
        "forces": np.zeros((steps, contacts, 3)),
        "moments": np.zeros((steps, contacts, 3)),
        "places": np.zeros((steps, len(GRIPS), 3)),
        "strayed": np.zeros(steps),
    }


def _aim(m: Any, data: Any, plan: Plan, time: float) -> tuple[Array, float]:
    """Find the accelerations (nv,) that lead back to the plan, and how far off a joint is."""
    q, rates, accelerations = plan.at(m, time)
    error = np.empty(m.nv)
    mujoco.mj_differentiatePos(m, error, 1.0, data.qpos, q)
    aim = accelerations + STIFFNESS * error + 2.0 * np.sqrt(STIFFNESS) * (rates - data.qvel)
    return aim, np.abs(error).max()


def _standing(
    m: Any,
    data: Any,
    builds: Mapping[str, Build],
    plan: Plan,
    time: float,
    anchors: dict[str, list[tuple[int, Array, Array]]],
) -> list[tuple[int, Array, Array]]:
    """Corners of the soles that should stand, and where each was when its foot came down."""
    off, on = plan.lifted
    if off < time < on:
        anchors.pop("tori_foot_r", None)
    for foot in FEET:
        if foot in anchors or (foot == "tori_foot_r" and off < time < on):
            continue
        body = m.body(foot).id
        size = builds[foot.partition("_")[0]].size
        corners = [size * point for point in sole_points(foot[-1]).values()]
        places = [data.xpos[body] + data.xmat[body].reshape(3, 3) @ point for point in corners]
        anchors[foot] = [
            (body, corner, at * (1.0, 0.0, 1.0)) for corner, at in zip(corners, places, strict=True)
        ]
    return [corner for corners in anchors.values() for corner in corners]


def _record_soles(m: Any, data: Any, record: Mapping[str, Array], step: int) -> None:
    """Add up what MuJoCo's contacts of the mat do to the feet."""
    mat = m.geom("mat").id
    feet = {m.body(name).id: c for c, name in enumerate(FEET)}
    count = int(data.ncon)
    forces = np.empty((count, 3))
    owners = np.empty(count, int)
    wrench = np.empty(6)
    for i in range(count):
        contact = data.contact[i]
        mujoco.mj_contactForce(m, data, i, wrench)
        below = contact.geom1 == mat
        forces[i] = contact.frame.reshape(3, 3).T @ wrench[:3] * (1.0 if below else -1.0)
        owners[i] = feet[int(m.geom_bodyid[contact.geom2 if below else contact.geom1])]
    np.add.at(record["forces"][step], owners, forces)
    np.add.at(record["moments"][step], owners, np.cross(data.contact.pos.reshape(-1, 3), forces))


def _record_grips(m: Any, data: Any, record: Mapping[str, Array], step: int) -> None:
    """Record the forces of the lapel's constraint and of the sleeve on tori's fists."""
    lapel = len(FEET)
    sleeve = len(FEET) + 1
    rows = (data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)) & (
        data.efc_id == m.equality("lapel").id
    )
    record["places"][step, 0] = data.site_xpos[m.site("tori_grip_r").id]
    record["forces"][step, lapel] = data.efc_force[rows]
    fist = data.site_xpos[m.site("tori_grip_l").id]
    cuff = data.site_xpos[m.site("cuff").id]
    t = m.tendon("sleeve").id
    stretch = float(data.ten_length[t]) - SLEEVE_LENGTH
    tension = (SLEEVE_STIFFNESS * stretch if stretch > 0.0 else 0.0) + SLEEVE_DAMPING * float(
        data.ten_velocity[t]
    )
    record["places"][step, 1] = fist
    record["forces"][step, sleeve] = tension * (cuff - fist) / np.linalg.norm(cuff - fist)
    record["moments"][step, lapel:] = np.cross(
        record["places"][step], record["forces"][step, lapel:]
    )
