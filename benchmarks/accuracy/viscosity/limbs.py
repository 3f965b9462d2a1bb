"""Limbs whose instruments and models are in error.

Measured are the estimates, and how often intervals hold the truth.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.accuracy.viscosity.faulty_limbs import Faults, faulty_limb, random_faults
from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.cohort import specimen_row
from myomorph.swings.viscosity.identification.base_load import BaseLoad as BaseMass
from myomorph.swings.viscosity.identification.identify import QUANTITIES_OF, is_narrow
from myomorph.swings.viscosity.study.conditions import Identified, Prepared, identify_conditions
from myomorph.swings.viscosity.study.options import StudyOptions
from myomorph.swings.viscosity.study.specimen_files import SpecimenFiles
from myomorph.swings.viscosity.tracking.track import track
from myomorph.swings.viscosity.trust.acting import DRY
from myomorph.swings.viscosity.trust.checks import TOO_SMALL, condition_findings

Row = dict[str, object]

RANGES = "ranges"
LIMBS = 100
LEVEL = 0.9
WORKERS = 2
QUANTITIES = {
    "joint_viscosity": "d_J",
    "muscle_viscosity": "d_M",
    "mass_muscles_removed": "mass, muscles removed",
    "mass_intact": "mass, intact",
    "com_muscles_removed": "mass center, muscles removed",
    "com_intact": "mass center, intact",
}
"""What is judged, by the names of `cohort.QUANTITIES`."""


class LimbRun(NamedTuple):
    """One limb, its truth and what was found, by the names of `QUANTITIES`.

    Attributes
    ----------
    laws : chosen of the conditions, muscles removed first
    refused : viscosities that were withheld, and why conditions could not be used
    findings : kind, place and condition of what is named
    slip : condition, trial and bone of a cluster that slips
    form : of the joint's viscosity: "one viscosity", "viscosity" an axis, or "hinge"
    """

    seed: int
    truth: dict[str, float]
    found: dict[str, Interval]
    laws: tuple[str, ...]
    refused: tuple[str, ...]
    findings: tuple[tuple[str, str, str], ...]
    slip: tuple[str, str, str] | None
    form: str


def limb_run(given: tuple[int, Faults, float | None], level: float = LEVEL) -> LimbRun:
    """Identify a limb as a study does.

    It is specified by its seed, its faults and its viscosity if that is not drawn.
    """
    threadpool_limits(1, "blas")
    seed, faults, _ = given
    limb = faulty_limb(*given)
    settings: dict[str, dict[str, float]] = {"identification": {"level": level, "seed": seed}}
    if faults.attachments <= 0.0:
        # Muscles that lie where the model has them: a laboratory that digitized them says so.
        settings["moment_arms"] = {"offset": 0.0}
    options = StudyOptions.of(settings)
    tracked = {}
    for name, trials in limb.trials.items():
        one = track(limb.known, trials, options.tracking)
        tracked[name] = Prepared(one, one.notes)
    files = SpecimenFiles(str(seed), Path(), base_load=_base_load(faults))
    result = identify_conditions(limb.known, files, tracked, options)
    row = _estimates(result)
    return LimbRun(
        seed=seed,
        truth=limb.truth,
        found={
            name: row[name] for name in limb.truth if name in row and np.isfinite(row[name].high)
        },
        laws=tuple(one.chosen.name for one in result.compared.values()),
        refused=(*_refused(result), *result.lost),
        findings=tuple(_findings(result)),
        slip=limb.slip,
        form=_form(result),
    )


def _base_load(faults: Faults) -> BaseMass:
    """Return what a laboratory states of the base's load: nothing, or bounds of a tared one."""
    if not faults.tared:
        return BaseMass()
    without, intact = faults.loads
    return BaseMass((0.0, 0.0), (0.0, 2.0 * (intact - without)))


def _estimates(result: Identified) -> dict[str, Interval]:
    """Return estimates with their intervals, by the names of `QUANTITIES`."""
    row = dict(specimen_row(result.found))
    bare = result.conditions.get("without")
    without = result.found.without
    if without is not None and bare is not None:
        axes = bare.recordings[0].axes
        for axis, value in zip(axes, without.axis_viscosity, strict=True):
            row[f"viscosity {axis}"] = value
    return row | {name: value for name, value in result.law.items() if name != "viscosity"}


def _form(result: Identified) -> str:
    """Return the form of the law, by the first word of its terms."""
    return next(
        (name.partition(" ")[0] for name in result.law if " " in name and name != DRY),
        "one viscosity",
    )


def _refused(result: Identified) -> Iterator[str]:
    """Yield quantities that the swings do not show."""
    for name, one in result.by_swings.conditions.items():
        if any(finding.kind == TOO_SMALL for finding in condition_findings(one)):
            yield QUANTITIES_OF[name][-1]
    muscles = result.by_swings.muscles
    if muscles is not None and not is_narrow(muscles.common):
        yield "muscle_viscosity"


def _findings(result: Identified) -> Iterator[tuple[str, str, str]]:
    """Yield kind, place and condition of what was found wrong."""
    for name, one in result.conditions.items():
        for finding in one.findings:
            yield finding.kind, finding.place, name
    if any("dry friction of" in note for note in result.found.notes):
        yield "dry friction", "joint", "without"


def limb_runs(
    given: Sequence[tuple[int, Faults, float | None]], level: float = LEVEL
) -> list[LimbRun]:
    """Run limbs on both cores, a process each."""
    with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
        return list(pool.imap(partial(limb_run, level=level), given, chunksize=4))


SYSTEMATIC: dict[str, Faults] = {
    "nothing": Faults(),
    "plate 5 mm off along x": Faults(plate=(0.005, 0.0, 0.0)),
    "plate 5 mm off along y": Faults(plate=(0.0, 0.005, 0.0)),
    "plate 5 mm off upwards": Faults(plate=(0.0, 0.0, 0.005)),
    "plate turned by 1 degree about each axis": Faults(turn=(0.0175, 0.0175, 0.0175)),
    "moment gains +2, -1, +2 %": Faults(moment=(0.02, -0.01, 0.02)),
    "force gains +0.5, -0.5, +0.5 %": Faults(force=(0.005, -0.005, 0.005)),
    "model's joint center 8 mm off": Faults(center=(0.0046, 0.0046, 0.0046)),
    "model's joint center 3 mm off": Faults(center=(0.0, 0.003, 0.0)),
    "clusters 1 mm off their bones": Faults(clusters=((0.001, 0.0, 0.0), (0.0, 0.001, 0.0))),
    "clock 20 ms and 50 millionths off": Faults(clock=0.02, drift=5e-5),
    "3 and 10 % of the mass loose at 8 Hz": Faults(tissue=(0.03, 0.1)),
    "all of these at once": Faults(
        plate=(0.003, -0.003, 0.003),
        turn=(0.005, -0.005, 0.005),
        force=(0.005, -0.005, 0.005),
        moment=(0.02, -0.01, 0.02),
        clock=0.02,
        drift=5e-5,
        center=(0.0046, 0.0046, 0.0046),
        clusters=((0.001, 0.0, 0.0), (0.0, 0.001, 0.0)),
        tissue=(0.03, 0.1),
    ),
}
"""What may be wrong with one limb; the limb and its releases are the same in every row."""
FIXED = 3
DAMPING = 0.055
"""Seed of that limb, and its viscosity [N m s/rad]."""


def measure_systematic() -> Iterable[Row]:
    """Yield a row for each fault.

    It has errors of estimates, their intervals, and whether these hold the truth.
    """
    runs = limb_runs([(FIXED, faults, DAMPING) for faults in SYSTEMATIC.values()])
    for name, one in zip(SYSTEMATIC, runs, strict=True):
        row: Row = {"wrong": name}
        for quantity in (
            "joint_viscosity",
            "muscle_viscosity",
            "mass_muscles_removed",
            "com_muscles_removed",
        ):
            row[f"{QUANTITIES[quantity]}: error (90 % interval)"] = _told(one, quantity)
        yield row | {"laws chosen": "; ".join(one.laws), "withheld": len(one.refused)}


def _told(one: LimbRun, quantity: str) -> str:
    if quantity not in one.found:
        return "withheld"
    found = one.found[quantity]
    truth = one.truth[quantity]
    misses = "" if found.holds(truth) else ", misses"
    low = 100.0 * (found.low / truth - 1.0)
    high = 100.0 * (found.high / truth - 1.0)
    if not np.isfinite(found.value):
        return f"range, {low:+.1f} to {high:+.1f} %{misses}"
    error = 100.0 * (found.value / truth - 1.0)
    return f"{error:+.2f} % ({low:+.2f} to {high:+.2f}{misses})"


def measure_coverage() -> Iterable[Row]:
    """Yield a row for each quantity over `LIMBS` limbs with random faults.

    Rows of the chosen laws and of what was withheld follow.
    """
    runs = limb_runs(
        [(seed, random_faults(np.random.default_rng(1000 + seed)), None) for seed in range(LIMBS)]
    )
    for quantity, label in QUANTITIES.items():
        own = [(one.found[quantity], one.truth[quantity]) for one in runs if quantity in one.found]
        errors = np.array([100.0 * (found.value / truth - 1.0) for found, truth in own])
        errors = errors[np.isfinite(errors)]
        widths = np.array([50.0 * (found.high - found.low) / truth for found, truth in own])
        held = sum(found.holds(truth) for found, truth in own)
        yield {
            "quantity": label,
            "of limbs": len(own),
            "error RMS": f"{np.sqrt(np.mean(errors**2)):.2f} %" if len(errors) else RANGES,
            "mean": f"{errors.mean():+.2f} %" if len(errors) else RANGES,
            "largest": f"{np.abs(errors).max():.2f} %" if len(errors) else RANGES,
            "median half-width": f"{np.median(widths):.2f} %",
            "90 % intervals that hold": f"{held} ({100.0 * held / max(len(own), 1):.0f} %)",
        }
    plain = {"viscosity", "muscles"}
    wrong = sum(any(set(law.split(" + ")) - plain for law in one.laws) for one in runs)
    refused = sum(bool(one.refused) for one in runs)
    for label, count in (
        ("a law with more than equations 1 to 3 chosen", wrong),
        ("a viscosity withheld", refused),
    ):
        yield {"quantity": f"{label}: {count} limbs", "of limbs": len(runs)}
