"""Faults of specimen and plate: how often each is named, how often where none is, and what becomes of viscosities."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.accuracy.viscosity.faulty_limbs import Faults, random_faults
from benchmarks.accuracy.viscosity.limbs import LimbRun, Row, limb_runs

LIMBS = 12
FIRST = 40_000
"""Seed of the first limb; thresholds were chosen on limbs of other seeds."""
LEVEL = 0.95
PLATE, GAIN = 0.005, 0.02
"""Faults of every limb's plate: distance from its place [m], of each moment channel's gain."""
LOADED = ("base load", "zero")
CASES: dict[str, Faults] = {
    "nothing": Faults(tared=True),
    "base load": Faults(),
    "dry friction": Faults(tared=True, friction=0.01),
    "moving base": Faults(tared=True, sway=float(np.deg2rad(3.5))),
    "slipped cluster": Faults(tared=True, slip=0.005),
}
"""What is wrong beside instruments and a heavy base."""
NAMED = {kind: name for name in CASES for kind in (LOADED if name == "base load" else (name,))} | {
    "loose wire": "loose wire"
}
"""Case by the kind of what is named."""
WITHIN = {"joint_viscosity": ("d_J", 0.03), "muscle_viscosity": ("d_M", 0.06)}
REFUSED = 0.05


def heavy_limb(seed: int, case: Faults) -> Faults:
    """The faults of a limb: of its case, of its heavy base, and of all instruments."""
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
    )


def is_named(case: str, run: LimbRun) -> bool:
    """Whether a limb's fault is named in each condition that has it, a cluster by its bone."""
    named = {(NAMED.get(kind), condition) for kind, _, condition in run.findings}
    if run.slip is not None:
        return ("slipped cluster", run.slip[2], run.slip[0]) in run.findings
    return {(case, "without")} | ({(case, "with")} if case != "dry friction" else set()) <= named


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
        known = [
            (run.found[quantity], run.truth[quantity], quantity in run.refused) for run in runs if quantity in run.found
        ]
        errors = np.array([abs(found.value / truth - 1.0) for found, truth, _ in known])
        refused = np.array([gone for *_, gone in known])
        held = sum(found.holds(truth) for found, truth, _ in known)
        values[f"{label}: error RMS, largest"] = f"{100 * np.sqrt(np.mean(errors**2)):.2f}, {100 * errors.max():.1f} %"
        values[f"{label}: within {100 * limit:.0f} %"] = f"{(errors <= limit).sum()} of {len(known)}"
        values[f"{label}: 95 % intervals that hold"] = f"{held} of {len(known)}"
        values[f"{label}: withheld, of these within {100 * REFUSED:.0f} %"] = (
            f"{refused.sum()}, {(refused & (errors <= REFUSED)).sum()}"
        )
    return values | {"named by mistake": ", ".join(sorted(set().union(*others))) or "nothing"}


def runs_of(case: str, seeds: Iterable[int]) -> list[LimbRun]:
    """The limbs of a case."""
    return limb_runs([(seed, heavy_limb(seed, CASES[case]), None) for seed in seeds], LEVEL)


def measure() -> Iterable[Row]:
    """A row a case."""
    for case in CASES:
        yield row(case, runs_of(case, range(FIRST, FIRST + LIMBS)))
