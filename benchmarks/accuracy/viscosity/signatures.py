"""Faults of specimen and plate.

Counted is how often each is named, and how often where none is. What becomes of viscosities is
measured too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.accuracy.viscosity.faulty_limbs import Faults, random_faults
from benchmarks.accuracy.viscosity.limbs import LimbRun, Row, limb_runs

LIMBS = 20
LAW_LIMBS = 34
FIRST = 40_000
"""Seed of the first limb; thresholds were chosen on limbs of other seeds."""
LEVEL = 0.95
PLATE = 0.005
GAIN = 0.02
"""Faults of every limb's plate: distance from its place [m], of each moment channel's gain."""
FRICTION = "dry friction"
LOADED = ("base load", "zero")
CASES: dict[str, Faults] = {
    "nothing": Faults(tared=True),
    "base load": Faults(),
    FRICTION: Faults(tared=True, friction=0.01),
    "moving base": Faults(tared=True, sway=float(np.deg2rad(3.5))),
    "slipped cluster": Faults(tared=True, slip=0.005),
}
"""What is wrong beside instruments and a heavy base."""
LAWS: dict[str, tuple[Faults, str, dict[str, tuple[str, ...]]]] = {
    "ball of one viscosity": (Faults(tared=True), "one viscosity", {"d_J": ("joint_viscosity",)}),
    "ball, one an axis": (
        Faults(tared=True, axes=(1.0, 1.0, 1.0)),
        "viscosity",
        {"d_J across the limb": ("viscosity x", "viscosity z"), "d_J along it": ("viscosity y",)},
    ),
    "three hinges": (
        Faults(tared=True, hinges=(1.0, 1.0, 1.0)),
        "hinge",
        {"d_J across the limb": ("hinge first", "hinge second"), "d_J along it": ("hinge third",)},
    ),
}
"""What the joint's viscosity is, the last as [S] has it: faults, how `LimbRun` calls its form, and
what is judged.
"""
NAMED = {kind: name for name in CASES for kind in (LOADED if name == "base load" else (name,))} | {
    "loose wire": "loose wire"
}
"""Case by the kind of what is named."""
WITHIN = {"joint_viscosity": ("d_J", 0.03), "muscle_viscosity": ("d_M", 0.06)}
REFUSED = 0.05


def heavy_limb(seed: int, case: Faults) -> Faults:
    """Return the faults of a limb: of its case, of its heavy base, and of all instruments."""
    random = np.random.default_rng(seed)
    plate = random.standard_normal(3)
    base = float(random.uniform(0.3, 1.2))
    return replace(
        random_faults(random),
        plate=PLATE * plate / np.linalg.norm(plate),
        moment=GAIN * random.choice([-1.0, 1.0], 3),
        attachments=0.0,
        loads=(base, base + float(random.uniform(0.05, 0.25))),
        tared=case.tared,
        friction=case.friction,
        sway=case.sway * float(random.uniform(0.87, 1.14)),
        slip=case.slip,
        axes=tuple(_drawn(random, len(case.axes))),
        hinges=tuple(_drawn(random, len(case.hinges))),
    )


def _drawn(random: np.random.Generator, count: int) -> list[float]:
    """Viscosities in the range of [S] table I [N m s/rad]."""
    return np.exp(random.uniform(np.log(0.03), np.log(0.1), count)).tolist()


def is_named(case: str, run: LimbRun) -> bool:
    """Whether a limb's fault is named in each condition that has it, a cluster by its bone."""
    named = {(NAMED.get(kind), condition) for kind, _, condition in run.findings}
    if run.slip is not None:
        return ("slipped cluster", run.slip[2], run.slip[0]) in run.findings
    return {(case, "without")} | ({(case, "with")} if case != FRICTION else set()) <= named


def row(case: str, runs: Sequence[LimbRun]) -> Row:
    """One case: how often it is named, and how well viscosities are known."""
    others = [{NAMED[kind] for kind, *_ in run.findings if kind in NAMED} - {case} for run in runs]
    values: Row = {
        "what is wrong": case,
        "limbs": len(runs),
        "named": "" if case == "nothing" else sum(is_named(case, run) for run in runs),
        "another fault named": sum(bool(names) for names in others),
    }
    for quantity, (label, limit) in WITHIN.items():
        judged = _judged(runs, (quantity,), limit)
        values |= {
            f"{label}: {name}".replace("within target", f"within {100 * limit:.0f} %"): value
            for name, value in judged.items()
        }
    return values | {"named by mistake": ", ".join(sorted(set().union(*others))) or "nothing"}


def _judged(runs: Sequence[LimbRun], quantities: Sequence[str], limit: float) -> Row:
    """Errors and intervals of some quantities together."""
    known = [
        (run.found[quantity], run.truth[quantity], quantity in run.refused)
        for run in runs
        for quantity in quantities
        if quantity in run.found
    ]
    errors = np.array([abs(found.value / truth - 1.0) for found, truth, _ in known])
    refused = np.array([gone for *_, gone in known])
    held = sum(found.holds(truth) for found, truth, _ in known)
    return {
        "error RMS, largest": (
            f"{100 * np.sqrt(np.mean(errors**2)):.2f}, {100 * errors.max():.1f} %"
        ),
        "within target": f"{(errors <= limit).sum()} of {len(known)}",
        "95 % intervals that hold": f"{held} of {len(known)}",
        f"withheld, of these within {100 * REFUSED:.0f} %": (
            f"{refused.sum()}, {(refused & (errors <= REFUSED)).sum()}"
        ),
    }


def measure(
    cases: Sequence[str] = tuple(case for case in CASES if case != FRICTION),
) -> Iterable[Row]:
    """Yield a row for each case."""
    for case in cases:
        seeds = range(FIRST, FIRST + LIMBS)
        yield row(
            case, limb_runs([(seed, heavy_limb(seed, CASES[case]), None) for seed in seeds], LEVEL)
        )


def measure_friction() -> Iterable[Row]:
    """Yield the rows without a fault and with dry friction."""
    return measure(("nothing", FRICTION))


def measure_laws() -> Iterable[Row]:
    """Rows of each law as truth: what its viscosities and that of the muscles become."""
    for law, (faults, form, quantities) in LAWS.items():
        seeds = range(FIRST, FIRST + LAW_LIMBS)
        runs = limb_runs([(seed, heavy_limb(seed, faults), None) for seed in seeds], LEVEL)
        right = sum(run.form == form for run in runs)
        for label, names in (quantities | {"d_M": ("muscle_viscosity",)}).items():
            limit = WITHIN["muscle_viscosity" if label == "d_M" else "joint_viscosity"][1]
            values = {
                "the joint resists as": law,
                "limbs": len(runs),
                "that law chosen": right,
                "viscosity": label,
            }
            yield values | {"target": f"{100 * limit:.0f} %"} | _judged(runs, names, limit)
