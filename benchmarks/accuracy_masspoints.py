"""The mass-point problem against general solvers, its optimality, and what the grid and the weight map change.

`python -m benchmarks.accuracy_masspoints` measures this part alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import piqp
from scipy.optimize import nnls

from benchmarks.speed_masspoints import LINKS, MASS, Program, made_body, measured
from myomorph.identify.mass_points import MassPointFit, MassPointOptions, solve_mass_points
from myomorph.identify.points import MassPoints
from myomorph.identify.weights import WeightMap, bone_weights, cog_weights, nearest_weights
from myomorph.model.spatial import Array

Row = dict[str, object]

WEIGHTS: dict[str, WeightMap] = {"w_d": cog_weights, "w_n": nearest_weights}


@dataclass(frozen=True)
class Case:
    """A problem of 1,000 points: how far the measurement is from what positive masses can do [units of noise]."""

    name: str
    noise: float
    options: MassPointOptions = field(default_factory=MassPointOptions)


CASES = (
    Case("whitened, prior of 15 % of a link's mass", 1.0),
    Case("the same, a wrench that no body has", 300.0),
    Case("the paper's weights (1, 1)", 1.0, MassPointOptions(prior="paper")),
)


def measure_solvers() -> Iterator[Row]:
    """Ours beside Lawson and Hanson's non-negative least squares and PIQP."""
    for name, weights in WEIGHTS.items():
        body = made_body(1_000, weights)
        A, b = measured(body)
        for case in CASES:
            target = b + case.noise * np.random.default_rng(3).normal(size=len(b))
            fit = solve_mass_points(body, A, target, options=case.options)
            program = Program.of(body, A, target, case.options)
            rows = np.vstack([program.B, np.eye(len(program.sd))])
            missing = np.append(program.t, np.zeros(len(program.sd))) - rows @ program.low
            exact = body.reference + program.sd * (program.low + nnls(rows, missing)[0])
            yield {
                "weights": name,
                "problem": case.name,
                "points": len(body.points),
                "on the bound": fit.on_bound,
                "Newton steps": fit.iterations,
                "farthest mass from NNLS [kg]": float(np.abs(fit.masses - exact).max()),
                "from PIQP [kg]": float(np.abs(fit.masses - _by_piqp(body, program)).max()),
                "objective less NNLS's, relative": program.objective(fit.masses - body.reference)
                / program.objective(exact - body.reference)
                - 1.0,
                "optimality residual": fit.optimality.worst,
            }


def _by_piqp(body: MassPoints, program: Program) -> Array:
    solver = piqp.DenseSolver()
    solver.settings.eps_abs, solver.settings.eps_rel, solver.settings.max_iter = 1e-12, 1e-13, 500
    free = np.full(len(program.sd), 1e30)
    linear = -program.B.T @ program.t
    solver.setup(np.asfortranarray(program.matrix), linear, None, None, None, None, None, program.low, free)
    solver.solve()
    masses: Array = body.reference + program.sd * solver.result.x
    return masses


def measure_grid() -> Iterator[Row]:
    """Masses of the links for one measurement, by the number of points."""
    sizes = (2_000, 16_000, 128_000)
    finest = made_body(sizes[-1], bone_weights)
    A, b = measured(finest)
    wished = b - A @ finest.parameters(finest.reference).ravel()
    found: dict[tuple[int, str], Array] = {}
    spacing, bound = {}, {}
    for points in sizes:
        body = made_body(points, bone_weights)
        spacing[points] = body.spacing
        for prior in ("relative", "paper"):
            # The same change is asked of every grid; the paper's prior is made as strong at the coarsest.
            options = MassPointOptions(prior=prior, W_rho=1e4) if prior == "paper" else MassPointOptions()
            fit: MassPointFit = solve_mass_points(
                body, A, A @ body.parameters(body.reference).ravel() + wished, mass=MASS, options=options
            )
            found[points, prior] = (fit.parameters - body.parameters(body.reference))[:, 0]
            bound[points, prior] = fit.on_bound / len(body.points)
    for points in sizes:
        row: Row = {"points": points, "grid [mm]": 1e3 * spacing[points], "links": LINKS}
        for prior in ("relative", "paper"):
            change, last = found[points, prior], found[sizes[-1], prior]
            row[f"RMS change of a link's mass, {prior} prior [kg]"] = float(np.sqrt(np.mean(change**2)))
            row[f"its difference from the finest, {prior} prior [kg]"] = float(np.sqrt(np.mean((change - last) ** 2)))
            row[f"points on the bound, {prior} prior"] = f"{100.0 * bound[points, prior]:.0f} %"
        yield row


if __name__ == "__main__":
    from benchmarks.__main__ import print_rows

    for part in (measure_solvers, measure_grid):
        print_rows(list(part()))
