"""The tension problem by our dual Newton and by maintained QP solvers.

They solve the same frames in one process, alternating. Set-up of matrices is not timed; every
solver gets the matrices in the form it likes best.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp

import myomorph as mm
from benchmarks.recordings import RECORDINGS, read_torques
from benchmarks.speed.timing import alternate
from data_collection import data_folder
from myomorph.core.tension.dual import OPTIMAL
from myomorph.core.tension.problem import TensionInputs, solve_frames, tension_problem
from myomorph.core.tension.separable import Separable
from myomorph.core.tension.terms.actuators import balanced_coordinates


@dataclass(frozen=True)
class QpCase:
    """A model and a motion ("" for a synthetic one).

    It has every `step`-th frame of [start, end] seconds, and the filter [Hz].
    """

    name: str
    model: str
    motion: str = ""
    loads: str = ""
    start: float = -np.inf
    end: float = np.inf
    step: int = 1
    cutoff: float | None = 6.0


def _case(
    name: str, recording: str, start: float, end: float, step: int, loads: bool = True
) -> QpCase:
    files = RECORDINGS[recording]
    return QpCase(
        name=name,
        model=files.model,
        motion=files.motion,
        loads=files.loads if loads else "",
        start=start,
        end=end,
        step=step,
    )


CASES = (
    _case("gait, 18 muscles, 10 coordinates", "gait10", 0.5, 1.3, 10, loads=False),
    _case("Rajagopal walk, 80 muscles, 31 free coordinates", "rajagopal", 0.6, 1.6, 20),
    QpCase("made motion, 520 muscles, 115 free coordinates", RECORDINGS["cyclist"].model),
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


def made_motion(model: mm.Model, frames: int) -> mm.Motion:
    """Every free coordinate of a model swings a little about its default, at 100 Hz."""
    names = balanced_coordinates(model)
    time = 0.01 * np.arange(frames)
    columns = []
    for k, name in enumerate(names):
        coordinate = model.coordinate(name)
        reach = 0.5 if coordinate.motion == "rotational" else 0.01
        low, high = np.clip(
            coordinate.range, coordinate.default - reach, coordinate.default + reach
        )
        columns.append(
            coordinate.default
            + 0.03 * (high - low) * np.sin(2.0 * np.pi * (0.7 + 0.01 * k) * time + k)
        )
    return mm.Motion(time, names, np.column_stack(columns))


def frames_of(folder: Path, case: QpCase) -> QuadraticFrames:
    """Return the quadratic programs of a case."""
    model = mm.read_model(folder / case.model)
    whole = (
        mm.differentiate(mm.read_motion(folder / case.motion, model), case.cutoff)
        if case.motion
        else mm.differentiate(made_motion(model, 30))
    )
    keep = np.flatnonzero((whole.time >= case.start) & (whole.time <= case.end))[:: case.step]
    motion = whole.frames(keep)
    torques = read_torques(folder / case.loads if case.loads else None, model, motion)
    problem = tension_problem(
        TensionInputs(
            model=model,
            motion=motion,
            torques=torques,
            options=mm.TensionOptions(passive=False, reserve=10.0, residual=100.0),
        )
    )
    values, right = problem.balance(0, len(motion))[:2]
    S = problem.separable
    columns = np.repeat(np.arange(len(S.weight)), np.diff(S.start))
    A = np.zeros((len(motion), right.shape[1], len(S.weight)))
    A[:, S.row, columns] = values
    return QuadraticFrames(
        separable=S, values=values, right=right, A=A, lower=S.lower, upper=S.upper
    )


def by_dual(frames: QuadraticFrames, warm: bool) -> np.ndarray:
    """Solve by ours.

    Parameters
    ----------
    frames : the programs
    warm : started from frame to frame, else each frame cold

    Returns
    -------
    (frames, variables)
    """
    count = len(frames.values)
    penalties = np.zeros((1, 3, len(frames.separable.weight)))
    parts = [slice(0, count)] if warm else [slice(k, k + 1) for k in range(count)]
    solved = [
        solve_frames(frames.separable, frames.values[part], frames.right[part], penalties)
        for part in parts
    ]
    assert all((found.status == OPTIMAL).all() for found in solved)
    return np.vstack([found.x for found in solved])


def by_piqp(frames: QuadraticFrames, sparse: bool) -> Callable[[], np.ndarray]:
    """Prepare PIQP (proximal interior point).

    Parameters
    ----------
    frames : the programs
    sparse : matrices, else dense ones

    Returns
    -------
    Function that solves them: (frames, variables)
    """
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
    """Prepare ProxQP, dense (augmented Lagrangian).

    There is a new object for each frame, as updating one crashes in 0.8.0.

    Parameters
    ----------
    frames : the programs

    Returns
    -------
    Function that solves them: (frames, variables)
    """
    import proxsuite

    n = len(frames.lower)
    rows = frames.right.shape[1]
    H = 2.0 * np.eye(n)
    low = np.maximum(frames.lower, -1e20)
    high = np.minimum(frames.upper, 1e20)

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
    """Prepare Clarabel (interior point).

    Parameters
    ----------
    frames : the programs

    Returns
    -------
    Function that solves them: (frames, variables)
    """
    import clarabel

    n = len(frames.lower)
    rows = frames.right.shape[1]
    P = sp.csc_matrix(2.0 * sp.eye(n))
    bounded_below = np.isfinite(frames.lower)
    bounded_above = np.isfinite(frames.upper)
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
            solver = clarabel.DefaultSolver(
                P, np.zeros(n), A, np.concatenate([b, limits]), cones, settings
            )
            found.append(np.array(solver.solve().x))
        return np.array(found)

    return run


def by_daqp(frames: QuadraticFrames) -> Callable[[], np.ndarray]:
    """Prepare DAQP (dual active set).

    Parameters
    ----------
    frames : the programs

    Returns
    -------
    Function that solves them: (frames, variables)
    """
    import ctypes

    import daqp

    n = len(frames.lower)
    rows = frames.right.shape[1]
    H = 2.0 * np.eye(n)
    f = np.zeros(n)
    low = np.maximum(frames.lower, -1e30)
    high = np.minimum(frames.upper, 1e30)
    kind = np.concatenate([np.zeros(n), np.full(rows, 5)]).astype(ctypes.c_int)
    matrices = [np.ascontiguousarray(A) for A in frames.A]

    def run() -> np.ndarray:
        found = []
        for A, b in zip(matrices, frames.right, strict=True):
            x, _, _, _ = daqp.solve(
                H, f, A, np.concatenate([high, b]), np.concatenate([low, b]), kind.copy()
            )
            found.append(np.array(x))
        return np.array(found)

    return run


def solvers_of(frames: QuadraticFrames) -> dict[str, Callable[[], np.ndarray]]:
    """Prepare ours and maintained solvers.

    Parameters
    ----------
    frames : the programs

    Returns
    -------
    By name, functions that solve them: (frames, variables)
    """
    return {
        "ours, warm": lambda: by_dual(frames, True),
        "ours, cold": lambda: by_dual(frames, False),
        "piqp dense": by_piqp(frames, False),
        "piqp sparse": by_piqp(frames, True),
        "proxqp dense": by_proxqp(frames),
        "clarabel": by_clarabel(frames),
    }


def measure_case(folder: Path, case: QpCase, rounds: int = 5) -> Iterator[dict[str, object]]:
    """Rows of one case: solver, milliseconds a frame, how many times ours, distance from ours."""
    frames = frames_of(folder, case)
    solvers = solvers_of(frames) | {"daqp": by_daqp(frames)}
    found = {name: solver() for name, solver in solvers.items()}
    times = {
        name: 1e3 * taken / len(frames.values) for name, taken in alternate(solvers, rounds).items()
    }
    ours = times["ours, warm"]
    for name, spent in times.items():
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


def run() -> list[dict[str, object]]:
    """Rows of all cases, for `python -m benchmarks qp`."""
    return [row for case in CASES for row in measure_case(data_folder(), case)]
