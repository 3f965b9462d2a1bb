"""The tension problem by our dual Newton and by maintained QP solvers: same frames, one process, alternating.

`python -m benchmarks qp` prints milliseconds a frame, ratios and the distance from our solution. Set-up
of matrices is not timed; every solver gets the matrices in the form it likes best.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from benchmarks.cases import data_folder
from myomorph.io.formats import read_model
from myomorph.io.loads import read_external_loads
from myomorph.io.sto import motion_from_table, read_sto
from myomorph.model.model import Model
from myomorph.model.series import Motion, Wrenches
from myomorph.motion.filters import differentiate
from myomorph.motion.sync import resample_wrenches
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.tension.dual import solve_separable
from myomorph.tension.separable import Separable, no_links, no_penalties
from myomorph.tension.solve import TensionOptions, tension_problem
from myomorph.tension.terms.actuators import free_coordinates


@dataclass(frozen=True)
class QpCase:
    """A model and a motion ("" for a made one), every `step`-th frame of [start, end] seconds, filter [Hz]."""

    name: str
    model: str
    motion: str = ""
    loads: str = ""
    start: float = -np.inf
    end: float = np.inf
    step: int = 1
    cutoff: float | None = 6.0


CASES = (
    QpCase(
        "gait, 18 muscles, 10 coordinates",
        "opensim-gait-subject01/ref_so_10dof18musc/subject01_adjusted_spring.osim",
        "opensim-gait-subject01/ref_so_10dof18musc/walk_subject01_Kinematics_q.sto",
        start=0.5,
        end=1.3,
        step=10,
    ),
    QpCase(
        "Rajagopal walk, 80 muscles, 31 free coordinates",
        "rajagopal-walk-emg/subject_walk_scaled.osim",
        "rajagopal-walk-emg/coordinates.sto",
        "rajagopal-walk-emg/grf_walk.xml",
        0.6,
        1.6,
        20,
    ),
    QpCase("made motion, 520 muscles, 115 free coordinates", "fullbody-many-muscles/cyclistFullBodyMuscle.osim"),
)


@dataclass(frozen=True)
class QuadraticFrames:
    """Frames of minimise sum x^2 subject to A x = b and bounds: in our form and as dense arrays."""

    separable: Separable
    values: np.ndarray
    right: np.ndarray
    A: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


def made_motion(model: Model, frames: int) -> Motion:
    """Every free coordinate of a model swings a little about its default, at 100 frames a second."""
    names = free_coordinates(model)
    time = 0.01 * np.arange(frames)
    columns = []
    for k, name in enumerate(names):
        coordinate = model.coordinate(name)
        reach = 0.5 if coordinate.motion == "rotational" else 0.01
        low, high = np.clip(coordinate.range, coordinate.default - reach, coordinate.default + reach)
        columns.append(coordinate.default + 0.03 * (high - low) * np.sin(2.0 * np.pi * (0.7 + 0.01 * k) * time + k))
    return Motion(time, names, np.column_stack(columns))


def frames_of(folder: Path, case: QpCase) -> QuadraticFrames:
    """The quadratic programs of a case."""
    model = read_model(folder / case.model)
    whole = (
        differentiate(motion_from_table(read_sto(folder / case.motion), model), case.cutoff)
        if case.motion
        else differentiate(made_motion(model, 30))
    )
    keep = np.flatnonzero((whole.time >= case.start) & (whole.time <= case.end))[:: case.step]
    assert whole.velocities is not None
    assert whole.accelerations is not None
    motion = Motion(
        whole.time[keep],
        whole.names,
        whole.values[keep],
        velocities=whole.velocities[keep],
        accelerations=whole.accelerations[keep],
    )
    wrenches: Wrenches | None = None
    if case.loads:
        wrenches = resample_wrenches(read_external_loads(folder / case.loads), motion.time)
    torques = inverse_dynamics(model, motion, wrenches)
    problem, _ = tension_problem(model, motion, torques, TensionOptions(passive=False, reserve=10.0, residual=100.0))
    values, right = problem.balance(0, len(motion))[:2]
    S = problem.separable
    columns = np.repeat(np.arange(len(S.weight)), np.diff(S.start))
    A = np.zeros((len(motion), right.shape[1], len(S.weight)))
    A[:, S.row, columns] = values
    return QuadraticFrames(S, values, right, A, S.lower, S.upper)


def by_dual(frames: QuadraticFrames, warm: bool) -> np.ndarray:
    """Ours; warm-started from frame to frame, or each frame cold."""
    count, n = len(frames.values), len(frames.separable.weight)
    rows = frames.right.shape[1]
    x, y = np.empty((count, n)), np.empty((count, rows))
    residual, iterations, status = np.empty(count), np.empty(count, np.int64), np.empty(count, np.int8)
    targets = np.zeros((count, n))
    parts = [slice(0, count)] if warm else [slice(k, k + 1) for k in range(count)]
    for part in parts:
        solve_separable(
            frames.separable,
            frames.values[part],
            frames.right[part],
            targets[part],
            no_penalties(n),
            no_links(),
            np.zeros(rows),
            x[part],
            y[part],
            residual[part],
            iterations[part],
            status[part],
        )
    assert np.all(status == 0)
    return x


def by_piqp(frames: QuadraticFrames, sparse: bool) -> Callable[[], np.ndarray]:
    """PIQP (proximal interior point)."""
    import piqp

    n = len(frames.lower)
    H = sp.csc_matrix(2.0 * sp.eye(n)) if sparse else np.asfortranarray(2.0 * np.eye(n))
    matrices = [sp.csc_matrix(one) if sparse else np.asfortranarray(one) for one in frames.A]

    def run() -> np.ndarray:
        found = []
        for A, b in zip(matrices, frames.right, strict=True):
            solver = piqp.SparseSolver() if sparse else piqp.DenseSolver()
            solver.setup(H, np.zeros(n), A, b, None, None, None, frames.lower, frames.upper)
            solver.solve()
            found.append(np.array(solver.result.x))
        return np.array(found)

    return run


def by_proxqp(frames: QuadraticFrames) -> Callable[[], np.ndarray]:
    """ProxQP, dense (augmented Lagrangian); a new object each frame, as updating one crashes in 0.8.0."""
    import proxsuite

    n, rows = len(frames.lower), frames.right.shape[1]
    H = 2.0 * np.eye(n)
    low, high = np.maximum(frames.lower, -1e20), np.minimum(frames.upper, 1e20)

    def run() -> np.ndarray:
        found = []
        for A, b in zip(frames.A, frames.right, strict=True):
            qp = proxsuite.proxqp.dense.QP(n, rows, 0, True)
            qp.settings.eps_abs = 1e-8
            # Absent inequalities must be given as empty arrays: None ends the process.
            qp.init(H, np.zeros(n), A, b, np.zeros((0, n)), np.zeros(0), np.zeros(0), low, high)
            qp.solve()
            found.append(qp.results.x.copy())
        return np.array(found)

    return run


def by_clarabel(frames: QuadraticFrames) -> Callable[[], np.ndarray]:
    """Clarabel (interior point)."""
    import clarabel

    n, rows = len(frames.lower), frames.right.shape[1]
    P = sp.csc_matrix(2.0 * sp.eye(n))
    bounded_below, bounded_above = np.isfinite(frames.lower), np.isfinite(frames.upper)
    eye = sp.eye(n, format="csr")
    bounds = sp.vstack([-eye[bounded_below], eye[bounded_above]])
    limits = np.concatenate([-frames.lower[bounded_below], frames.upper[bounded_above]])
    cones = [clarabel.ZeroConeT(rows), clarabel.NonnegativeConeT(len(limits))]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    matrices = [sp.csc_matrix(sp.vstack([sp.csr_matrix(A), bounds])) for A in frames.A]

    def run() -> np.ndarray:
        found = []
        for A, b in zip(matrices, frames.right, strict=True):
            solver = clarabel.DefaultSolver(P, np.zeros(n), A, np.concatenate([b, limits]), cones, settings)
            found.append(np.array(solver.solve().x))
        return np.array(found)

    return run


def by_daqp(frames: QuadraticFrames) -> Callable[[], np.ndarray]:
    """DAQP (dual active set)."""
    import ctypes

    import daqp

    n, rows = len(frames.lower), frames.right.shape[1]
    H, f = 2.0 * np.eye(n), np.zeros(n)
    low, high = np.maximum(frames.lower, -1e30), np.minimum(frames.upper, 1e30)
    kind = np.concatenate([np.zeros(n), np.full(rows, 5)]).astype(ctypes.c_int)
    matrices = [np.ascontiguousarray(A) for A in frames.A]

    def run() -> np.ndarray:
        found = []
        for A, b in zip(matrices, frames.right, strict=True):
            x, _, _, _ = daqp.solve(H, f, A, np.concatenate([high, b]), np.concatenate([low, b]), kind.copy())
            found.append(np.array(x))
        return np.array(found)

    return run


def measure_case(folder: Path, case: QpCase, rounds: int = 5) -> Iterator[dict[str, object]]:
    """Rows of one case: solver, milliseconds a frame, how many times ours, distance from ours."""
    frames = frames_of(folder, case)
    solvers: dict[str, Callable[[], np.ndarray]] = {
        "ours, warm": lambda: by_dual(frames, True),
        "ours, cold": lambda: by_dual(frames, False),
        "piqp dense": by_piqp(frames, False),
        "piqp sparse": by_piqp(frames, True),
        "proxqp dense": by_proxqp(frames),
        "clarabel": by_clarabel(frames),
        "daqp": by_daqp(frames),
    }
    times: dict[str, list[float]] = {name: [] for name in solvers}
    found = {name: solver() for name, solver in solvers.items()}
    for _ in range(rounds):
        for name, solver in solvers.items():
            began = time.perf_counter()
            solver()
            times[name].append(1e3 * (time.perf_counter() - began) / len(frames.values))
    ours = float(np.median(times["ours, warm"]))
    for name in solvers:
        spent = float(np.median(times[name]))
        apart = np.abs(found[name] - found["ours, warm"])
        yield {
            "case": case.name,
            "solver": name,
            "variables": len(frames.lower),
            "rows": frames.right.shape[1],
            "frames": len(frames.values),
            "ms/frame": spent,
            "times ours": spent / ours,
            "max |x - ours|": float(np.nanmax(apart)) if np.isfinite(apart).any() else np.nan,
        }


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """Rows of all cases."""
    for case in CASES:
        yield from measure_case(folder, case)


def run() -> list[dict[str, object]]:
    """Rows of all cases, for `python -m benchmarks qp`."""
    return list(measure(data_folder()))
