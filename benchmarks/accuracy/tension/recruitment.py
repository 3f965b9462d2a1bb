"""Criteria of recruitment compared with conic programs.

Measured is also what a wrong criterion makes of a simulated truth.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.errors import rms
from myomorph.core.model.arrays import Array
from myomorph.core.tension.recruitment import EFFORT_ALONE, recruitment_terms
from myomorph.core.tension.tension import Tension
from truths.recruitment_programs import (
    Criterion,
    Walk,
    cost_of,
    criterion,
    load_columns,
    loads_of,
    solve_program,
    walk,
)

KNEE = "walker_knee_r"
LOADED = ("hip_r", KNEE, "ankle_r")

CRITERIA: Mapping[str, Criterion] = {
    "default (exponent 2)": criterion(),
    "exponent 1.5": criterion(exponent=1.5),
    "exponent 3": criterion(exponent=3.0),
    "exponent 10": criterion(exponent=10.0),
    "exponent 20": criterion(exponent=20.0),
    "min/max": criterion(recruitment="minmax"),
    "weights by volume": criterion(weights="volume"),
    "weights by strength": criterion(weights="strength"),
    "joint load 1, three joints": criterion(1.0, ",".join(LOADED)),
    "co-contraction 0.1": criterion(co_contraction=0.1),
    "both": criterion(1.0, ",".join(LOADED), 0.1),
    "co-contraction 0.1, exponent 3": criterion(co_contraction=0.1, exponent=3.0),
}
TRUTHS = (
    "default (exponent 2)",
    "exponent 3",
    "min/max",
    "weights by volume",
    "joint load 1, three joints",
    "co-contraction 0.1",
)
NOISE = 0.05
"""Standard deviation of joint torques in the noisy column, over their own RMS."""


@dataclass(frozen=True, eq=False)
class Solutions:
    """Activations (frames, muscles) that programs found, by criterion."""

    walk: Walk
    found: Mapping[str, Array]
    loads: tuple[Array, Array]


@lru_cache(maxsize=1)
def solutions(folder: Path) -> Solutions:
    """All criteria on the walk, each frame a program."""
    one = walk(folder)
    loads = load_columns(one, LOADED)
    found = {
        name: np.array([solve_program(one, frame, by, loads) for frame in range(len(one.motion))])
        for name, by in CRITERIA.items()
    }
    return Solutions(one, found, loads)


def _above(made: Solutions, by: Criterion, mine: Array, theirs: Array) -> float:
    """Return the greatest relative difference of the costs over frames.

    It is below 0 where ours is always the lesser.
    """
    pairs = [
        [cost_of(made.walk, frame, by, one[frame], made.loads) for one in (mine, theirs)]
        for frame in range(len(mine))
    ]
    return max((own - other) / other for own, other in pairs)


def ours(one: Walk, by: Criterion, torques: mm.Series) -> Tension:
    """Tensions as a user gets them with these options."""
    terms = recruitment_terms(one.model, one.motion, torques, one.wrenches, by.beside)
    return mm.solve_tension(
        one.model, one.motion, torques, by.tension, recruitment=EFFORT_ALONE, terms=terms
    )


def measure_programs(folder: Path) -> Iterator[dict[str, object]]:
    """Each criterion on frames of a walk, by our solver and as a conic program."""
    made = solutions(folder)
    one = made.walk
    for name, by in CRITERIA.items():
        found = ours(one, by, one.torques)
        theirs = made.found[name]
        yield {
            "criterion": name,
            "frames": len(found),
            "optimal": int(found.optimal.sum()),
            "difference of activations, maximum": float(np.abs(found.activation - theirs).max()),
            "difference of activations, RMS": rms(found.activation - theirs),
            "cost above the program's": _above(made, by, found.activation, theirs),
            "difference of forces, RMS [N]": rms(found.muscle_force - theirs * one.F),
            "greatest activation, mean": float(found.activation.max(axis=1).mean()),
            "the program's": float(theirs.max(axis=1).mean()),
            "knee force, mean [BW]": float(
                np.linalg.norm(_knee(one, found.muscle_force), axis=1).mean()
            ),
        }


def measure_truth(folder: Path) -> Iterator[dict[str, object]]:
    """Find muscles that follow one criterion from their joint torques by each.

    The rows have the RMS of activations and of the knee. The truth's activations come from
    programs; torques are what its muscles give.
    """
    made = solutions(folder)
    one = made.walk
    for truth in TRUTHS:
        activations = made.found[truth]
        torques = _torques(one, activations)
        noisy = _noisy(one, torques)
        row: dict[str, object] = {"the muscles keep to": truth, "with 5 % noise": ""}
        for name in TRUTHS:
            row[name] = _errors(one, ours(one, CRITERIA[name], torques), activations)
        row["with 5 % noise"] = _errors(one, ours(one, CRITERIA[truth], noisy), activations)
        yield row


def _torques(one: Walk, activations: Array) -> mm.Series:
    """Joint torques that these activations give; those of the pelvis as they were."""
    given = np.einsum("fmr,fm->fr", one.R, activations * one.F)
    values = np.array(one.torques.values)
    for k, name in enumerate(one.rows):
        values[:, one.torques.names.index(name)] += given[:, k] - one.tau[:, k]
    return mm.Series(one.torques.time, one.torques.names, values)


def _noisy(one: Walk, torques: mm.Series) -> mm.Series:
    values = np.array(torques.values)
    draw = np.random.default_rng(0)
    for name in one.rows:
        k = torques.names.index(name)
        values[:, k] += NOISE * rms(values[:, k]) * draw.standard_normal(len(values))
    return mm.Series(torques.time, torques.names, values)


def _errors(one: Walk, found: Tension, activations: Array) -> str:
    apart = np.linalg.norm(_knee(one, found.muscle_force) - _knee(one, activations * one.F), axis=1)
    return f"{rms(found.activation - activations):.4f} / {rms(apart):.3f}"


def _knee(one: Walk, forces: Array) -> Array:
    return loads_of(one, forces, (KNEE,))[:, 0]
