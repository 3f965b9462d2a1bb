"""The mass-point problem of [D] eq. 3.10 at full size, and grids of points.

General QP solvers solve it as far as they get. A synthetic body: an ellipsoid of 70 kg, 53 links,
430 rows of random combinations of their parameters with noise. Every solver has a process of its
own, and is given up where one size takes more than a minute or `MEMORY`.
"""

from __future__ import annotations

import multiprocessing
import resource
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np
from scipy import sparse
from scipy.spatial.transform import Rotation

import myomorph as mm
from benchmarks.speed.timing import MEGABYTE, clocked, in_own_process, resident
from data_collection import data_folder
from myomorph.body.identify.mass_points import MassPointOptions, prior_variances, solve_mass_points
from myomorph.body.identify.pseudo_inertia import solve_pseudo_inertia
from myomorph.body.shape.fit_pose import pose_model_to_skin
from myomorph.body.shape.points import SPACING, Links, MassPoints, fill, links_of, point_moments
from myomorph.body.shape.shape import body_shape
from myomorph.body.shape.weights import (
    WeightMap,
    bone_weights,
    cog_weights,
    links_with_mass,
    nearest_weights,
)

AXES = np.array([0.2, 0.85, 0.155])
"""Semi-axes of the body [m]."""

MASS = 70.0
LINKS = 53
ROWS = 430
FULL = 530_000
SIZES = (1_000, 2_000, 4_000, 8_000, 16_000, 32_000)
PATIENCE = 60.0
"""Seconds a general solver may take for one size before it is given up."""

MEMORY = 12 * 2**30
"""Bytes of address space that a general solver may have."""

WEIGHTS: dict[str, WeightMap] = {"w_d": cog_weights, "w_n": nearest_weights, "w_b": bone_weights}

Row = dict[str, object]


def made_body(points: int, weights: WeightMap) -> MassPoints:
    """About so many mass points in the ellipsoid, and links along it."""
    spacing = float((4.0 / 3.0 * np.pi * AXES.prod() / points) ** (1.0 / 3.0))
    grid = np.stack(
        np.meshgrid(*(np.arange(-a, a, spacing) for a in AXES), indexing="ij"), axis=-1
    ).reshape(-1, 3)
    x = grid[((grid / AXES) ** 2).sum(axis=1) < 1.0]
    links = made_links()
    return MassPoints(
        points=x,
        reference=np.full(len(x), MASS / len(x)),
        weights=weights(x, links),
        links=links,
        spacing=spacing,
        source="an ellipsoid",
    )


def made_links() -> Links:
    """Links with random places and axes within the ellipsoid, each with a bone of 20 cm."""
    random = np.random.default_rng(0)
    centers = 0.8 * random.uniform(-1.0, 1.0, (LINKS, 3)) * AXES
    rotations = Rotation.random(LINKS, rng=random).as_matrix()
    bones = np.stack(
        [centers - 0.1 * rotations[:, :, 0], centers + 0.1 * rotations[:, :, 0]], axis=1
    )
    return Links(
        names=tuple(f"link{i}" for i in range(LINKS)),
        rotations=rotations,
        origins=centers,
        centers=centers,
        bones=bones,
        bone_links=np.arange(LINKS),
    )


def measured(body: MassPoints) -> tuple[np.ndarray, np.ndarray]:
    """Return the equations A phi = b of a true body.

    Its points weigh 0 to 2 times the reference, unevenly.

    Parameters
    ----------
    body : points with their reference masses

    Returns
    -------
    (`ROWS`, 10 `LINKS`) A, and (`ROWS`,) b with noise, in units of noise
    """
    random = np.random.default_rng(1)
    A = 30.0 * random.normal(size=(ROWS, 10 * LINKS))
    A /= np.tile(np.abs(body.parameters(body.reference)).mean(axis=0), LINKS)
    phase = random.uniform(0.0, 6.0, 3)
    truth = body.reference * (1.0 + np.prod(np.sin(25.0 * body.points + phase), axis=1))
    return A, A @ body.parameters(truth).ravel() + random.normal(size=ROWS)


def run() -> list[Row]:
    """Ours at full size for each weight map, then general solvers size by size beside ours."""
    rows = [alone(full_size, (name,)) for name in WEIGHTS]
    rows += [alone(conic_size, (words,)) for words in CONIC]
    solvers = [*GENERAL]
    for points in SIZES:
        rows.append(alone(general_size, ("ours", points)))
        for name in list(solvers):
            rows.append(alone(general_size, (name, points), PATIENCE))
            if "gave up" in rows[-1]:
                solvers.remove(name)
    return rows


def alone(
    work: Callable[..., Iterator[Row | None]], arguments: tuple, patience: float = np.inf
) -> Row:
    """Return the row of some work in a process of its own, or one with the reason for its lack.

    The work first yields None, when its problem is set up: patience [s] runs from there.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(theirs, work, arguments))
    process.start()
    theirs.close()
    row: Row = dict(zip(("solver", "points"), arguments, strict=False))
    try:
        ours.recv()
        if ours.poll(None if patience == np.inf else patience):
            row = ours.recv()
        else:
            row["gave up"] = f"more than {patience:.0f} s"
    except EOFError:
        row["gave up"] = "the process ended"
    process.kill()
    process.join()
    return row


def _send(pipe: Connection, work: Callable[..., Iterator[Row | None]], arguments: tuple) -> None:
    try:
        for row in work(*arguments):
            pipe.send(row)
    except MemoryError:
        pipe.send(
            {**dict(zip(("solver", "points"), arguments, strict=False)), "gave up": "out of memory"}
        )


def full_size(name: str) -> Iterator[Row | None]:
    """Our solver, and the weights before it, at the size of an adult with a grid of 5 mm."""
    warm = made_body(1_000, WEIGHTS[name])
    solve_mass_points(warm, *measured(warm), mass=MASS)
    yield None
    before = resident() / MEGABYTE
    made = clocked(lambda: made_body(FULL, WEIGHTS[name]))
    body = made.result
    A, b = measured(body)
    solved = clocked(lambda: solve_mass_points(body, A, b, mass=MASS))
    fit = solved.result
    yield {
        "solver": "ours",
        "points": len(body.points),
        "links": LINKS,
        "weights": name,
        "links a point": body.weights.nnz / len(body.points),
        "grid and weights [s]": made.seconds,
        "QP [s]": solved.seconds,
        "Newton steps": fit.iterations,
        "on the bound": fit.on_bound,
        "converged": fit.converged,
        "optimality residual": fit.optimality.worst,
        "peak beyond start, points included [MB]": max(
            part.before + part.peak for part in (made, solved)
        )
        - before,
    }


CONIC = {"pseudo-inertia, a body's wrench": 0.0, "pseudo-inertia, no body's wrench": 1e3}
"""The second method, and the error put on its measurement [units of noise]."""


def conic_size(words: str) -> Iterator[Row | None]:
    """Run the pseudo-inertia method for as many links."""
    body = made_body(20_000, bone_weights)
    A, b = measured(body)
    b += CONIC[words] * np.random.default_rng(2).normal(size=len(b))
    reference = body.parameters(body.reference)
    yield None
    taken = clocked(lambda: solve_pseudo_inertia(A, b, reference, mass=MASS))
    yield {
        "solver": words,
        "links": LINKS,
        "seconds": taken.seconds,
        "status": taken.result.status,
        "peak beyond start [MB]": taken.peak,
    }


def general_size(name: str, points: int) -> Iterator[Row | None]:
    """One solver at one size, w_d: seconds, memory, and how far its masses are from ours."""
    body = made_body(points, cog_weights)
    A, b = measured(body)
    ours = solve_mass_points(body, A, b)
    yield None
    if name == "ours":
        taken = clocked(lambda: solve_mass_points(body, A, b).masses)
    else:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        program = Program.of(body, A, b)
        taken = clocked(lambda: body.reference + program.sd * GENERAL[name](program))
    yield {
        "solver": name,
        "points": len(body.points),
        "seconds": taken.seconds,
        "peak beyond start [MB]": taken.peak,
        "farthest from ours [of a mean mass]": float(
            np.abs(taken.result - ours.masses).max() / body.reference.mean()
        ),
    }


@dataclass(frozen=True, eq=False)
class Program:
    """A bounded least-squares problem of the masses.

    With u the masses from the reference over their prior SD,

        minimize |B u - t|^2 / 2 + |u|^2 / 2 subject to u >= low

    `B`: (rows, points) a column for each point; `t`: (rows,); `low`, `sd`: (points,).
    """

    B: np.ndarray
    t: np.ndarray
    low: np.ndarray
    sd: np.ndarray

    @staticmethod
    def of(
        body: MassPoints, A: np.ndarray, b: np.ndarray, options: MassPointOptions | None = None
    ) -> Program:
        """Return the problem with all that ours never forms.

        Parameters
        ----------
        body : points with their reference masses
        A : (rows, 10 links) in units of noise
        b : (rows,) in units of noise
        options : of the prior, defaults for None

        Returns
        -------
        The program
        """
        options = options or MassPointOptions()
        sd = np.sqrt(prior_variances(body, options))
        moments = point_moments(body.points).T
        by_link = np.einsum("rli,lij->lrj", A.reshape(len(A), -1, 10), body.places)
        B = np.zeros((len(A), len(sd)))
        for link, rows in enumerate(by_link):
            B += (rows @ moments) * body.weights[:, [link]].toarray()[:, 0]
        t = b - B @ body.reference
        return Program(
            B=B * sd, t=t, low=(options.floor * body.reference.mean() - body.reference) / sd, sd=sd
        )

    @property
    def matrix(self) -> np.ndarray:
        """(points, points) of eq. 3.12."""
        return self.B.T @ self.B + np.eye(len(self.sd))

    def objective(self, change: np.ndarray) -> float:
        """Return the cost of masses.

        Parameters
        ----------
        change : (points,) masses less the reference [kg]

        Returns
        -------
        |B u - t|^2 / 2 + |u|^2 / 2
        """
        u = change / self.sd
        return 0.5 * float(np.sum((self.B @ u - self.t) ** 2) + u @ u)


def by_piqp(program: Program) -> np.ndarray:
    """Solve by PIQP with the dense matrix.

    Parameters
    ----------
    program : to solve

    Returns
    -------
    (points,) u
    """
    import piqp

    n = len(program.sd)
    solver = piqp.DenseSolver()
    solver.setup(
        np.asfortranarray(program.matrix),
        -program.B.T @ program.t,
        None,
        None,
        None,
        None,
        None,
        program.low,
        np.full(n, 1e30),
    )
    solver.solve()
    return np.array(solver.result.x)


def by_piqp_rows(program: Program) -> np.ndarray:
    """Solve by PIQP with the rows' residuals as variables, so that it can use the low rank.

    Parameters
    ----------
    program : to solve

    Returns
    -------
    (points,) u
    """
    import piqp

    rows, n = program.B.shape
    A = sparse.csc_matrix(sparse.hstack([sparse.csc_matrix(program.B), -sparse.eye(rows)]))
    solver = piqp.SparseSolver()
    solver.setup(
        sparse.csc_matrix(sparse.eye(n + rows)),
        np.zeros(n + rows),
        A,
        program.t,
        None,
        None,
        None,
        np.concatenate([program.low, np.full(rows, -1e30)]),
        np.full(n + rows, 1e30),
    )
    solver.solve()
    return np.array(solver.result.x)[:n]


def by_clarabel_rows(program: Program) -> np.ndarray:
    """Solve by Clarabel with the rows' residuals as variables.

    Parameters
    ----------
    program : to solve

    Returns
    -------
    (points,) u
    """
    import clarabel

    rows, n = program.B.shape
    A = sparse.vstack(
        [
            sparse.hstack([sparse.csc_matrix(program.B), -sparse.eye(rows)]),
            sparse.hstack([-sparse.eye(n), sparse.csc_matrix((n, rows))]),
        ]
    )
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones = [clarabel.ZeroConeT(rows), clarabel.NonnegativeConeT(n)]
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(sparse.eye(n + rows)),
        np.zeros(n + rows),
        sparse.csc_matrix(A),
        np.concatenate([program.t, -program.low]),
        cones,
        settings,
    )
    return np.array(solver.solve().x)[:n]


def by_proxqp(program: Program) -> np.ndarray:
    """Solve by ProxQP, dense.

    Parameters
    ----------
    program : to solve

    Returns
    -------
    (points,) u
    """
    import proxsuite

    n = len(program.sd)
    qp = proxsuite.proxqp.dense.QP(n, 0, 0, True)
    qp.settings.eps_abs = 1e-8
    none = np.zeros(0)
    rows = np.zeros((0, n))
    qp.init(
        program.matrix,
        -program.B.T @ program.t,
        rows,
        none,
        rows,
        none,
        none,
        program.low,
        np.full(n, 1e20),
    )
    qp.solve()
    return np.array(qp.results.x)


GENERAL: dict[str, Callable[[Program], np.ndarray]] = {
    "piqp, dense matrix": by_piqp,
    "piqp, misses as variables": by_piqp_rows,
    "clarabel, misses as variables": by_clarabel_rows,
    "proxqp, dense matrix": by_proxqp,
}


GRID_MODEL = "fullbody-many-muscles/cyclistFullBodyMuscle.osim"


def run_grid() -> list[dict[str, object]]:
    """Rows of the steps, measured in a process of its own so that memory is theirs alone."""
    return in_own_process(_steps)


def _steps() -> list[dict[str, object]]:
    model = mm.read_model(data_folder() / GRID_MODEL)
    posed = pose_model_to_skin(model, body_shape(1.822, 0.870, 66.8, "male"))
    links = links_of(model, posed.motion)
    taking = links_with_mass(model)
    # What is compiled and loaded on first use is not timed.
    bone_weights(fill(posed.skin, 0.05), links, taking=taking)
    grid = clocked(lambda: fill(posed.skin, SPACING))
    points = grid.result
    weighted = clocked(lambda: bone_weights(points, links, taking=taking))
    table = weighted.result
    steps = {
        "grid inside the skin": (grid, points.nbytes),
        f"weights by bone of {int(np.sum(taking))} links": (
            weighted,
            table.data.nbytes + table.indices.nbytes + table.indptr.nbytes,
        ),
    }
    return [
        {
            "step": step,
            "points": len(points),
            "s": taken.seconds,
            "CPU s": taken.cpu,
            "peak beyond start and results [MB]": taken.peak - size / MEGABYTE,
        }
        for step, (taken, size) in steps.items()
    ]
