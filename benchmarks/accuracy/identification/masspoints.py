"""The mass-point problem against general solvers.

Its optimality is measured, and what the grid and the weight map change.
`python -m benchmarks.accuracy.identification.masspoints` measures this part alone.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import piqp
from scipy.optimize import nnls

import myomorph as mm
from benchmarks.errors import rms
from benchmarks.speed.masspoints import LINKS, MASS, Program, made_body, measured
from myomorph.body.identify.mass_points import MassPointFit, MassPointOptions, solve_mass_points
from myomorph.body.shape.envelope import envelope_points
from myomorph.body.shape.fit_pose import pose_model_to_skin
from myomorph.body.shape.points import Links, MassPoints, fill, links_of
from myomorph.body.shape.shape import body_shape
from myomorph.body.shape.weights import (
    WeightMap,
    bone_weights,
    cog_weights,
    links_with_mass,
    nearest_weights,
)
from myomorph.core.model.arrays import Array
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.segments import Segment, segments_of

Row = dict[str, object]

WEIGHTS: dict[str, WeightMap] = {"w_d": cog_weights, "w_n": nearest_weights}


@dataclass(frozen=True)
class Case:
    """A problem of 1,000 points.

    It is named by how far the measurement is from what positive masses can produce [units of
    noise].
    """

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
    solver.settings.eps_abs = 1e-12
    solver.settings.eps_rel = 1e-13
    solver.settings.max_iter = 500
    free = np.full(len(program.sd), 1e30)
    linear = -program.B.T @ program.t
    solver.setup(
        np.asfortranarray(program.matrix), linear, None, None, None, None, None, program.low, free
    )
    solver.solve()
    masses: Array = body.reference + program.sd * solver.result.x
    return masses


GRIDS = (2_000, 16_000, 128_000)
PAPER = 1e3
"""W_rho that makes both priors about equally strong at the coarsest grid."""
PRIORS = {
    "relative": MassPointOptions(),
    "paper": MassPointOptions(prior="paper", W_rho=PAPER),
}


class _GridFit(NamedTuple):
    """Masses that one grid finds.

    Attributes
    ----------
    change : (links,) masses less the reference [kg]
    bound : share of the points on the bound
    """

    change: Array
    bound: float


def measure_grid() -> Iterator[Row]:
    """Compare masses of the links for one measurement, by the number of points.

    The measurement is weak, so that the prior matters.
    """
    finest = made_body(GRIDS[-1], bone_weights)
    A_part, b_part = measured(finest)
    A = 0.01 * A_part[:40]
    b = 0.01 * b_part[:40]
    # The same change is required of every grid.
    wished = b - A @ finest.parameters(finest.reference).ravel()
    found: dict[int, dict[str, _GridFit]] = {}
    spacing = {}
    for points in GRIDS:
        body = made_body(points, bone_weights)
        spacing[points] = body.spacing
        found[points] = {
            prior: _grid_fit(body, A, wished, options) for prior, options in PRIORS.items()
        }
    last = found[GRIDS[-1]]
    for points in GRIDS:
        row: Row = {"points": points, "grid [mm]": 1e3 * spacing[points], "links": LINKS}
        for prior, fit in found[points].items():
            row[f"RMS change of a link's mass, {prior} prior [kg]"] = rms(fit.change)
            row[f"its difference from the finest, {prior} prior [kg]"] = rms(
                fit.change - last[prior].change
            )
            row[f"points on the bound, {prior} prior"] = f"{100.0 * fit.bound:.0f} %"
        yield row


def _grid_fit(body: MassPoints, A: Array, wished: Array, options: MassPointOptions) -> _GridFit:
    reference = body.parameters(body.reference)
    fit: MassPointFit = solve_mass_points(
        body, A, A @ reference.ravel() + wished, mass=MASS, options=options
    )
    return _GridFit(
        change=(fit.parameters - reference)[:, 0], bound=fit.on_bound / len(body.points)
    )


PUBLISHED = {
    "athletes": ("", "", 6.9, 2.7, 1.6, 0.6, 11.0, 5.1, 1.1),
    "[D], w_d": (0.46, 0.32, 7.79, 2.77, 2.69, 0.51, 6.36, 4.26, 2.36),
    "[D], w_n": (0.60, 0.63, 7.05, 3.03, 2.68, 0.51, 5.52, 3.67, 2.67),
}
"""[D] tables 3.3 and 3.4: SD of lumbar and thoracic vertebrae [kg], shares of segments [%]."""

OPEN = {
    "shoulder_elv_r": 1.0,
    "shoulder_elv_l": 1.0,
    "hip_adduction_r": -0.2,
    "hip_adduction_l": -0.2,
}
"""Coordinates that open arms and legs, as [D] does before mass is shared out [rad]."""

OWN = "the model's envelopes"
SUBJECT = (1.822, 0.870, 66.8)
"""Height [m], chest [m] and mass [kg] of the subject of [D]."""

SEGMENTS = ("head", "upper_arm", "lower_arm", "hand", "thigh", "shank", "foot")


def measure_maps(folder: Path) -> Iterator[Row]:
    """Compare where a body's mass goes by each weight map.

    The 171-coordinate model in two bodies stands next to what is published.
    """
    model = mm.read_model(folder / "fullbody-many-muscles" / "cyclistFullBodyMuscle.osim")
    taking = links_with_mass(model)
    segments = segments_of(model)
    maps: dict[str, WeightMap] = {
        "w_d": partial(cog_weights, taking=taking),
        "w_n": partial(nearest_weights, taking=taking),
        "w_b": partial(bone_weights, taking=taking),
        "w_b, exponent 8": partial(bone_weights, taking=taking, exponent=8.0),
    }

    def row(body: str, name: str, links: Links, masses: Array, change: float | str = "") -> Row:
        of = dict(zip(links.names, masses, strict=True))
        return {
            "body": body,
            "masses": name,
            "SD of lumbar vertebrae [kg]": float(np.std([of[f"lumbar{i}"] for i in range(1, 6)])),
            "SD of thoracic vertebrae [kg]": float(
                np.std([of[f"thoracic{i}"] for i in range(1, 13)])
            ),
            **{f"{segment} [%]": _share(of, segments, segment) for segment in SEGMENTS},
            "largest change of a link by dropping small shares [g]": change,
        }

    for body, points, reference, links in _bodies(model):
        if body == OWN:
            yield row(body, "the model itself", links, inertial_parameters(model)[:, 0])
        for name, weights in maps.items():
            masses = weights(points, links).T @ reference
            whole = (
                cog_weights(points, links, taking=taking, smallest=0.0).T @ reference
                if name == "w_d"
                else masses
            )
            yield row(
                body,
                name,
                links,
                masses,
                1e3 * float(np.abs(masses - whole).max()) if name == "w_d" else "",
            )
    for name, numbers in PUBLISHED.items():
        keys = (
            "SD of lumbar vertebrae [kg]",
            "SD of thoracic vertebrae [kg]",
            *(f"{one} [%]" for one in SEGMENTS),
        )
        yield {"body": "published", "masses": name, **dict(zip(keys, numbers, strict=True))}


def _bodies(model: mm.Model) -> Iterator[tuple[str, Array, Array, Links]]:
    """Yield what the points fill, the points, their masses, and the links in the same pose."""
    values = np.array(
        [[OPEN.get(coordinate.name, coordinate.default) for coordinate in model.coordinates]]
    )
    pose = mm.Motion(np.zeros(1), model.coordinate_names, values)
    envelope = envelope_points(model, pose)
    yield OWN, envelope.points, envelope.masses, links_of(model, pose)
    if importlib.util.find_spec("anny"):
        height, chest, mass = SUBJECT
        fitted = pose_model_to_skin(model, body_shape(height, chest, mass, "male"))
        points = fill(fitted.skin)
        yield (
            "statistical body",
            points,
            np.full(len(points), mass / len(points)),
            links_of(model, fitted.motion),
        )


def _share(masses: dict[str, float], segments: Mapping[str, Segment], name: str) -> float:
    """Percent of the whole in a segment, of the right side where there are two."""
    own = [
        mass
        for body, mass in masses.items()
        if segments[body].name == name and segments[body].side != "left"
    ]
    return 100.0 * float(sum(own)) / float(sum(masses.values()))


if __name__ == "__main__":
    from benchmarks.__main__ import print_rows
    from data_collection import data_folder

    for part in (measure_solvers, measure_grid, lambda: measure_maps(data_folder())):
        print_rows(list(part()))
