"""One specimen of the shoulder experiment from raw recordings to its row of tables.

Runs of virtual joints are timed too. The specimen is simulated in MuJoCo (not timed). Timed are
tracking with the clocks, the cutoff, the equations of the swings with moment arms, and the
identification with a bootstrap of 500; then 16 virtual joints, in one process and two.
"""

from __future__ import annotations

import multiprocessing
import time

from benchmarks.accuracy.viscosity.virtual import joint_run
from myomorph.swings.simulate.shoulder import VirtualSpecimen, virtual_specimen
from myomorph.swings.viscosity.identification.identify import ViscosityOptions, identify_specimen
from myomorph.swings.viscosity.tracking.track import track
from myomorph.swings.viscosity.tracking.tracked import swing_recordings
from myomorph.swings.viscosity.trust.cutoff import choose_cutoff

SECONDS = 30.0
TRIALS = 4
DRAWS = 500
RUNS = 16


def run() -> list[dict[str, object]]:
    """Return a row for the specimen, and a row for the runs."""
    specimen_steps(virtual_specimen(1, seconds=6.0, trials=1))
    steps = specimen_steps(virtual_specimen(1, seconds=SECONDS, trials=TRIALS))
    one = joint_seconds(1)
    two = joint_seconds(2)
    return [
        {
            "specimen": (
                f"{TRIALS} trials of {SECONDS:g} s without muscles and {TRIALS} with, bootstrap of"
                f" {DRAWS}"
            ),
            **steps,
            "total [s]": sum(steps.values()),
            "target [s]": 60.0,
        },
        {
            "runs of the virtual joint": RUNS,
            "one process [s]": one,
            "two processes [s]": two,
            "times faster": one / two,
            "200 runs [s]": 200.0 / RUNS * two,
        },
    ]


def specimen_steps(made: VirtualSpecimen) -> dict[str, float]:
    """Seconds of each step."""
    marks = [time.perf_counter()]
    tracked = [track(made.specimen, one.swing_trials()) for one in (made.without, made.intact)]
    marks.append(time.perf_counter())
    cutoff = choose_cutoff(tracked).cutoff
    marks.append(time.perf_counter())
    without = swing_recordings(tracked[0], cutoff, muscles=False)
    intact = swing_recordings(tracked[1], cutoff, muscles=True)
    marks.append(time.perf_counter())
    identify_specimen("virtual", without, intact, options=ViscosityOptions(draws=DRAWS))
    marks.append(time.perf_counter())
    names = ("bones and clocks [s]", "cutoff [s]", "equations [s]", "identification [s]")
    return {
        name: after - before
        for name, before, after in zip(names, marks[:-1], marks[1:], strict=True)
    }


def joint_seconds(workers: int) -> float:
    """Seconds of the runs in so many processes, started and warm."""
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        pool.map(joint_run, range(2 * workers), chunksize=1)
        began = time.perf_counter()
        pool.map(joint_run, range(RUNS), chunksize=1)
        return time.perf_counter() - began
