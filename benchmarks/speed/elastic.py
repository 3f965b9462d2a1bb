"""Tensions on elastic tendons: a stride of 110 frames and 60 s of walking, 80 muscles; seconds, memory, programs.

The walk is Rajagopal's (rajagopal-walk-emg), 1.1 s of it at 100 Hz. The long recording is that stride again and
again, made to close; its torques are those of the stride. Times are on the cores of
MYOMORPH_THREADS, everything from coordinates and torques on.
"""

from __future__ import annotations

import argparse
import statistics
import time
from dataclasses import replace

import numpy as np

from benchmarks.cases import data_folder
from benchmarks.speed.size import MEGABYTE, peak, resident
from myomorph.model.model import Model
from myomorph.model.series import Motion, Series
from myomorph.motion.filters import differentiate
from myomorph.motion.sync import resample_wrenches
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.study.inputs.external_forces import read_loads
from myomorph.study.inputs.reading import open_model, read_motion
from myomorph.tension.solve import TensionOptions, solve_tension

FRAMES, FIRST, RATE = 110, 0.4, 100.0
LONG = 60.0
ROUNDS = 7


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the command line."""
    parser.add_argument(
        "--degroote", action="store_true", help="De Groote's muscles in the place of the model's Millard"
    )


def stride() -> tuple[Model, Motion, Series]:
    """A stride of the walk at 100 Hz and its torques."""
    folder = data_folder() / "rajagopal-walk-emg"
    model = open_model(folder / "subject_walk_scaled.osim")
    whole = differentiate(read_motion(folder / "coordinates.sto", model), cutoff=6.0)
    every = round(1.0 / (RATE * float(np.median(np.diff(whole.time)))))
    keep = np.searchsorted(whole.time, FIRST) + every * np.arange(FRAMES)
    motion = picked(whole, keep[keep < len(whole.time)])
    loads = resample_wrenches(read_loads(folder / "grf_walk.xml", model, motion), motion.time)
    return model, motion, inverse_dynamics(model, motion, loads)


def picked(motion: Motion, keep: np.ndarray) -> Motion:
    """Some frames of a motion."""
    assert motion.velocities is not None
    assert motion.accelerations is not None
    return Motion(
        motion.time[keep], motion.names, motion.values[keep], motion.velocities[keep], motion.accelerations[keep]
    )


def with_degroote(model: Model) -> Model:
    """The model with De Groote's muscles of the same parameters."""
    kind = "DeGrooteFregly2016Muscle"
    return replace(model, muscles=tuple(replace(one, kind=kind, parameters={}) for one in model.muscles))


def tiled(motion: Motion, torques: Series, seconds: float) -> tuple[Motion, Series]:
    """The stride again and again, made to close: what the last frame differs from the first is taken off evenly."""
    count, frames = len(motion), int(seconds * RATE)

    def closed(values: np.ndarray) -> np.ndarray:
        drift = np.linspace(0.0, 1.0, count)[:, None] * (values[-1] - values[0])
        return np.resize((values - drift)[:-1], (frames, values.shape[1]))

    time_ = np.arange(frames) / RATE
    long = differentiate(Motion(time_, motion.names, closed(motion.values)), cutoff=6.0)
    return long, Series(time_, torques.names, closed(torques.values))


def run(degroote: bool = False) -> list[dict[str, object]]:
    """A row for the stride, one each for 15 and 60 s."""
    model, motion, torques = stride()
    if degroote:
        model = with_degroote(model)
    options = TensionOptions(tendons="elastic")
    solve_tension(model, motion, torques, options)
    rows = []
    for seconds in (len(motion) / RATE, LONG / 4.0, LONG):
        given = (motion, torques) if seconds < 2.0 else tiled(motion, torques, seconds)
        before, taken, found = resident(), [], None
        for _ in range(ROUNDS if seconds < 2.0 else 1):
            began = time.perf_counter()
            found = solve_tension(model, *given, options)
            taken.append(time.perf_counter() - began)
        assert found is not None
        assert found.fibers is not None
        certificate = found.fibers.certificate
        rows.append(
            {
                "muscles": f"{len(model.muscles)} {model.muscles[0].kind}",
                "frames": len(given[0]),
                "seconds": statistics.median(taken),
                "ms/frame": 1e3 * statistics.median(taken) / len(given[0]),
                "memory [MB]": max(peak() - before, 0) / MEGABYTE,
                "most programs": certificate.steps,
                "KKT residual": certificate.residual,
                "frames optimal": int(found.optimal.sum()),
            }
        )
    return rows
