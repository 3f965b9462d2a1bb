"""Criteria of recruitment as conic programs with full matrices.

Clarabel solves them, which shares nothing with our solver. Powers are power cones, t^(1/p) >= |a|;
the greatest activation is a variable; joint loads and co-contraction are as docs/method.md defines
them, joint loads from reactions of unit tensions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import clarabel
import numpy as np
import scipy.sparse as sp

import myomorph as mm
from myomorph.core.io.loads import read_external_loads
from myomorph.core.model.arrays import Array
from myomorph.core.muscles.hill import hill_forces
from myomorph.core.tension.recruitment import EFFORT_ALONE, RecruitmentOptions
from myomorph.core.tension.terms.actuators import default_reserves, floating_joints

FOLDER = "rajagopal-walk-emg"
CUTOFF = 6.0
FRAMES = slice(150, 1150, 90)


@dataclass(frozen=True)
class Criterion:
    """A criterion, by the options that a user gives."""

    tension: mm.TensionOptions
    beside: RecruitmentOptions


def criterion(
    joint_load: float = 0.0, joints: str = "knees", co_contraction: float = 0.0, **options: object
) -> Criterion:
    """Options of both kinds."""
    return Criterion(
        mm.TensionOptions(**options),  # type: ignore[arg-type]
        RecruitmentOptions(joint_load, joints, co_contraction),
    )


@dataclass(frozen=True, eq=False)
class Walk:
    """Frames of a walk, and what their equations are made of.

    Attributes
    ----------
    rows : coordinates that muscles turn
    R : (frames, muscles, rows) moment arms [m]
    F : (frames, muscles) force of full activation [N]
    tau : (frames, rows) [N m]
    reserves : (rows,) optimal forces [N m]
    weight : of the body [N]
    """

    model: mm.Model
    motion: mm.Motion
    wrenches: mm.Wrenches
    torques: mm.Series
    rows: tuple[str, ...]
    R: Array
    F: Array
    tau: Array
    reserves: Array
    weight: float


def walk(folder: Path) -> Walk:
    """Twelve frames of the Rajagopal model's walk."""
    here = folder / FOLDER
    model = mm.read_model(here / "subject_walk_scaled.osim")
    whole = mm.differentiate(mm.read_motion(here / "coordinates.sto", model), CUTOFF)
    assert whole.velocities is not None
    assert whole.accelerations is not None
    moving = whole.values[FRAMES], whole.velocities[FRAMES], whole.accelerations[FRAMES]
    motion = mm.Motion(whole.time[FRAMES], whole.names, *moving)
    wrenches = mm.resample_wrenches(read_external_loads(here / "grf_walk.xml"), motion.time)
    torques = mm.inverse_dynamics(model, motion, wrenches)
    found = mm.solve_tension(model, motion, torques, recruitment=EFFORT_ALONE)
    root = {name for joint in floating_joints(model) for name in joint.coordinates}
    by = {one.coordinate: one.optimal_force for one in default_reserves(model)}
    paths = mm.muscle_kinematics(model, motion)
    arms = dict(zip(paths.coordinates, np.abs(paths.moment_arm).max(axis=(0, 1)), strict=True))
    # Of the others reserves alone carry the torque, whatever the criterion.
    rows = tuple(name for name in found.coordinates if name not in root and arms[name] > 0.0)
    return Walk(
        model=model,
        motion=motion,
        wrenches=wrenches,
        torques=torques,
        rows=rows,
        R=paths.moment_arm[:, :, [paths.coordinates.index(name) for name in rows]],
        F=hill_forces(model, paths.muscle_length, paths.muscle_velocity).active,
        tau=found.balanced_torque[:, [found.coordinates.index(name) for name in rows]],
        reserves=np.array([by[name] for name in rows]),
        weight=model.mass * float(np.linalg.norm(model.gravity)),
    )


def loads_of(one: Walk, forces: Array, joints: tuple[str, ...]) -> Array:
    """Return forces that joints transmit.

    Parameters
    ----------
    one : walk
    forces : (frames, muscles) tensions [N]
    joints : names

    Returns
    -------
    (frames, joints, 3) in ground [body weights]
    """
    pulled = mm.Series(one.motion.time, one.model.muscle_names, forces)
    found = mm.joint_reactions(
        one.model, one.motion, pulled, one.wrenches, joints=joints, frame="ground", actuators=()
    )
    return found.forces / one.weight


def load_columns(one: Walk, joints: tuple[str, ...]) -> tuple[Array, Array]:
    """Return loads without any tension, and what each full activation adds.

    Parameters
    ----------
    one : walk
    joints : names

    Returns
    -------
    (frames, 3 joints) and (frames, 3 joints, muscles) [body weights]
    """
    frames = len(one.motion)
    alone = loads_of(one, np.zeros_like(one.F), joints).reshape(frames, -1)
    added = [
        loads_of(one, one.F * (np.arange(one.F.shape[1]) == m), joints).reshape(frames, -1) - alone
        for m in range(one.F.shape[1])
    ]
    return alone, np.stack(added, axis=2)


def both_ways(one: Walk) -> list[int]:
    """Rows that muscles turn both ways in all frames."""
    return [
        k
        for k in range(len(one.rows))
        if (one.R[:, :, k] > 1e-4).any(axis=1).all() and (one.R[:, :, k] < -1e-4).any(axis=1).all()
    ]


class _Program:
    """Variables x with cost 1/2 x^T P x + q^T x, and rows s = b - A x in cones."""

    def __init__(self, size: int):
        self.size = size
        self.P = np.zeros((size, size))
        self.q = np.zeros(size)
        self._rows: list[tuple[Array, Array, object]] = []

    def equal(self, A: Array, b: Array) -> None:
        """Add the rows A x = b."""
        self._rows.append((A, b, clarabel.ZeroConeT(len(b))))

    def at_least(self, A: Array, b: Array) -> None:
        """Add the rows A x >= b."""
        self._rows.append((-A, -b, clarabel.NonnegativeConeT(len(b))))

    def power(self, t: int, x: int, p: float) -> None:
        """x_t >= |x_x|^p."""
        A = np.zeros((3, self.size))
        A[0, t] = -1.0
        A[2, x] = -1.0
        self._rows.append((A, np.array([0.0, 1.0, 0.0]), clarabel.PowerConeT(1.0 / p)))

    def solved(self) -> Array:
        """Return the x of minimum cost."""
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
        A, b, cones = zip(*self._rows, strict=True)
        rows = sp.csc_matrix(np.vstack(A))
        found = clarabel.DefaultSolver(
            sp.csc_matrix(np.triu(self.P)), self.q, rows, np.concatenate(b), list(cones), settings
        ).solve()
        return np.array(found.x)


HIGHEST = mm.TensionOptions(recruitment="minmax")
SMALLEST = 1e-5
TWICE = 100.0
"""Cost of a^2 beside the greatest activation, and of co-contraction that lacks, as
docs/method.md gives them.
"""


def solve_program(
    one: Walk, frame: int, by: Criterion, loads: tuple[Array, Array] | None = None
) -> Array:
    """Solve the activations of a frame.

    Parameters
    ----------
    one : walk
    frame : number
    by : criterion
    loads : as of `load_columns`, where the criterion has joint loads

    Returns
    -------
    (muscles,) activations in 0..1
    """
    p = by.tension.exponent
    # High powers of small numbers: activations in units of about the greatest one, costs in units
    # of its power.
    unit = 1.0
    if p > 4.0:
        unit = float(solve_program(one, frame, replace(by, tension=HIGHEST), loads).max())
    units = _Units(activation=unit, cost=unit**-p if p > 4.0 else 1.0, p=p)
    turned = both_ways(one) if by.beside.co_contraction else []
    layout = _Layout(muscles=one.F.shape[1], rows=len(one.rows))
    made = _Program(layout.greatest + 1 + len(turned))
    _add_balance(made, layout, one, frame, units)
    _add_effort(made, layout, one, by, units)
    if by.beside.joint_load:
        assert loads is not None
        alone = loads[0][frame]
        added = loads[1][frame]
        weight = 2.0 * by.beside.joint_load * units.cost
        made.P[: layout.muscles, : layout.muscles] += weight * unit**2 * added.T @ added
        made.q[: layout.muscles] += weight * unit * added.T @ alone
    for k, row in enumerate(turned):
        lacking = layout.greatest + 1 + k
        made.P[lacking, lacking] = 2.0 * TWICE * units.cost
        share, wanted = _asked(one, frame, row, by.beside.co_contraction)
        line = np.append(unit * share, np.zeros(made.size - layout.muscles))
        line[lacking] += 1.0
        made.at_least(line[None], np.array([wanted]))
    return np.clip(unit * made.solved()[: layout.muscles], 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class _Units:
    """Units in which a program with power p is well scaled."""

    activation: float
    cost: float
    p: float


@dataclass(frozen=True, kw_only=True)
class _Layout:
    """Order of the variables.

    Activations, controls each way, the powers of these, the greatest activation, and co-contraction
    that lacks.
    """

    muscles: int
    rows: int

    @property
    def powers(self) -> int:
        """Number of the first power."""
        return self.muscles + 2 * self.rows

    @property
    def greatest(self) -> int:
        """Number of the greatest activation."""
        return 2 * self.powers


def _add_balance(made: _Program, layout: _Layout, one: Walk, frame: int, units: _Units) -> None:
    """Add the balance of torques, and bounds of all variables."""
    n = layout.muscles
    eye = np.eye(made.size)
    turns = one.R[frame] * one.F[frame][:, None]
    push = one.reserves * (units.cost**-0.5 if units.p > 4.0 else 1.0)
    A = np.zeros((layout.rows, made.size))
    A[:, :n] = units.activation * turns.T
    A[:, n : n + layout.rows] = np.diag(push)
    A[:, n + layout.rows : layout.powers] = -np.diag(push)
    made.equal(A, one.tau[frame])
    made.at_least(eye, np.zeros(made.size))
    made.at_least(-eye[:n], np.full(n, -1.0 / units.activation))


def _add_effort(made: _Program, layout: _Layout, one: Walk, by: Criterion, units: _Units) -> None:
    """Add the cost of activations and controls."""
    n = layout.muscles
    p = units.p
    highest = by.tension.recruitment == "minmax"
    w = _weights(one.model, by.tension)
    cost = np.concatenate([w * (SMALLEST if highest else 1.0), np.ones(2 * layout.rows)])
    power = np.where(np.arange(len(cost)) < n, p, p if p <= 4.0 else 2.0)
    for k in range(len(cost)):
        if power[k] == 2.0:
            made.P[k, k] = 2.0 * cost[k]
        else:
            made.power(layout.powers + k, k, float(power[k]))
            made.q[layout.powers + k] = cost[k]
    made.P[range(n), range(n)] += 2.0 * beside_power(p) * w * units.cost * units.activation**2
    if highest:
        eye = np.eye(made.size)
        made.q[layout.greatest] = 1.0
        made.at_least(eye[layout.greatest] - eye[:n], np.zeros(n))


def cost_of(one: Walk, frame: int, by: Criterion, a: Array, loads: tuple[Array, Array]) -> float:
    """Return the cost of activations, the reserves that balance them included.

    Parameters
    ----------
    one : walk
    frame : number
    by : criterion
    a : (muscles,) activations
    loads : as of `load_columns`

    Returns
    -------
    the cost, without unit
    """
    p = by.tension.exponent
    w = _weights(one.model, by.tension)
    u = (one.tau[frame] - one.R[frame].T @ (one.F[frame] * a)) / one.reserves
    if by.tension.recruitment == "minmax":
        found = a.max() + SMALLEST * w @ a**2 + u @ u
    else:
        found = (
            w @ a**p + beside_power(p) * w @ a**2 + (np.abs(u) ** (p if p <= 4.0 else 2.0)).sum()
        )
    if by.beside.joint_load:
        found += by.beside.joint_load * ((loads[0][frame] + loads[1][frame] @ a) ** 2).sum()
    for row in both_ways(one) if by.beside.co_contraction else []:
        share, wanted = _asked(one, frame, row, by.beside.co_contraction)
        found += TWICE * max(0.0, wanted - share @ a) ** 2
    return float(found)


def beside_power(p: float) -> float:
    """Weight of a^2 beside a^p."""
    return 0.01 * 0.2 ** (p - 2.0) if p > 4.0 else 0.0


def _asked(one: Walk, frame: int, row: int, level: float) -> tuple[Array, float]:
    """Return what activations give to both sides of a coordinate, and the required amount.

    The latter is that of co-contraction, in shares of the weaker side.
    """
    each = one.R[frame, :, row] * one.F[frame]
    weaker = min(np.maximum(each, 0.0).sum(), np.maximum(-each, 0.0).sum())
    return np.abs(each) / weaker, float(abs(one.tau[frame, row]) / weaker + 2.0 * level)


def _weights(model: mm.Model, options: mm.TensionOptions) -> Array:
    strength = np.array([one.max_isometric_force for one in model.muscles])
    length = np.array([one.optimal_fiber_length for one in model.muscles])
    size = {"equal": np.ones(len(strength)), "strength": strength, "volume": strength * length}[
        options.weights
    ]
    return size / size.mean()
