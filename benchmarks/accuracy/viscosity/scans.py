"""The six virtual specimens as raw recordings.

They come with CT scans of bones that are not those of the model.
"""

from __future__ import annotations

import multiprocessing
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.interval import Interval

Row = dict[str, object]

WORKERS = 2
SECONDS = 8.0
TRIALS = 2
STRETCH = (1.03, 0.98, 1.02)
WAVES = (
    ((20.0, 9.0, -14.0), (0.9, 0.1, 0.4), 0.3),
    ((-17.0, 24.0, 13.0), (0.2, 0.3, -0.9), 1.9),
    ((21.0, -15.0, 22.0), (-0.5, 0.8, 0.3), 4.1),
)
"""Wave vectors [rad/m], directions and phases of what makes the model's bones others than the
specimen's.
"""
AMPLITUDE = 0.001
"""Of each wave [m]."""
SHOWN = {
    "joint_viscosity": "d_J",
    "total_viscosity": "d_{M+J}",
    "muscle_viscosity": "d_M",
    "mass_muscles_removed": "mass",
    "com_muscles_removed": "mass center",
}


class ScanRun(NamedTuple):
    """A specimen, and what was found by the names of `SHOWN`.

    `fit`: mean root mean square of scans on the model's bones [mm]; `arms`: 95 % of d_M under
    errors of attachments as the report assumes them [N s/m].
    """

    name: str
    truth: dict[str, float]
    found: dict[str, Interval]
    fit: float
    arms: tuple[float, float]


def modelled(points: Array) -> Array:
    """Return points of a specimen's bone as the model's bone has them.

    Parameters
    ----------
    points : (..., 3) [m]

    Returns
    -------
    (..., 3) [m]
    """
    moved = np.asarray(points) * STRETCH
    for wave, direction, phase in WAVES:
        moved = moved + AMPLITUDE * np.sin(np.asarray(points) @ wave + phase)[..., None] * np.array(
            direction
        )
    return moved


def scan_run(number: int) -> ScanRun:
    """One specimen with muscles of full size from its files, by the defaults of a study."""
    from myomorph.swings.demo import ShoulderStudyOptions, write_shoulder_study
    from myomorph.swings.viscosity.study.options import StudyOptions
    from myomorph.swings.viscosity.study.plan import read_viscosity_plan
    from myomorph.swings.viscosity.study.specimen import study_specimen

    with tempfile.TemporaryDirectory() as folder:
        options = ShoulderStudyOptions(
            seconds=SECONDS, trials=TRIALS, raw=(number,), full_size=True, modelled=modelled
        )
        path = write_shoulder_study(Path(folder), (number,), options)
        plan = read_viscosity_plan(path)
        settings = StudyOptions.of(dict(plan.settings))
        report = study_specimen(plan.specimens[0], settings, lambda part: None).report
    kinds = () if report.arms is None else report.arms.kinds
    arms = next(
        ((one.low, one.high) for one in kinds if one.kind.startswith("offset")),
        (float("nan"), float("nan")),
    )
    fits = [one.value for one in report.calibration if one.what.startswith("CT of")]
    return ScanRun(
        name=report.name,
        truth=dict(report.truth),
        found=dict(report.row),
        fit=float(np.mean(fits)),
        arms=arms,
    )


def measure() -> Iterable[Row]:
    """Yield a row for each specimen.

    It has how well scans lie on the model's bones, errors, and which intervals hold the truth.
    """
    with multiprocessing.get_context("spawn").Pool(WORKERS) as pool:
        runs = pool.map(scan_run, range(1, 7), chunksize=1)
    for one in runs:
        row: Row = {
            "specimen": one.name,
            "scans on the model's bones, mean of 5 [mm]": f"{one.fit:.2f}",
        }
        for name, label in SHOWN.items():
            found = one.found.get(name)
            truth = one.truth[name]
            if found is None:
                row[f"{label}: error, 95 % interval"] = "withheld"
                continue
            low = 100.0 * (found.low / truth - 1.0)
            high = 100.0 * (found.high / truth - 1.0)
            holds = "holds" if found.holds(truth) else "misses"
            row[f"{label}: error, 95 % interval"] = (
                f"{100.0 * (found.value / truth - 1.0):+.2f} % ({low:+.2f} to {high:+.2f}, {holds})"
            )
        low_end, high_end = one.arms
        low = 100.0 * (low_end / one.truth["muscle_viscosity"] - 1.0)
        high = 100.0 * (high_end / one.truth["muscle_viscosity"] - 1.0)
        yield row | {"d_M with attachments in error, 95 %": f"{low:+.0f} to {high:+.0f} %"}
