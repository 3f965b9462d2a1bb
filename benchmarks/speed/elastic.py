"""Tensions on elastic tendons: a stride of 110 frames and 60 s of walking, 80 muscles.

Measured are seconds, memory and programs. The long recording is the stride of rajagopal-walk-emg
again and again, made to close, with the torques of the stride.
"""

from __future__ import annotations

import argparse
import statistics
from dataclasses import replace
from functools import partial

import numpy as np

import myomorph as mm
from benchmarks.speed.timing import clocked
from data_collection import data_folder

FRAMES = 110
FIRST = 0.4
RATE = 100.0
LONG = 60.0
ROUNDS = 7


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the command line."""
    parser.add_argument(
        "--degroote",
        action="store_true",
        help="De Groote's muscles in the place of the model's Millard",
    )


def stride() -> tuple[mm.Model, mm.Motion, mm.Series]:
    """Read a stride of the walk at 100 Hz and its torques."""
    folder = data_folder() / "rajagopal-walk-emg"
    model = mm.read_model(folder / "subject_walk_scaled.osim")
    whole = mm.differentiate(mm.read_motion(folder / "coordinates.sto", model), cutoff=6.0)
    every = round(1.0 / (RATE * float(np.median(np.diff(whole.time)))))
    keep = np.searchsorted(whole.time, FIRST) + every * np.arange(FRAMES)
    motion = whole.frames(keep[keep < len(whole.time)])
    loads = mm.resample_wrenches(mm.read_loads(folder / "grf_walk.xml", model, motion), motion.time)
    return model, motion, mm.inverse_dynamics(model, motion, loads)


def with_degroote(model: mm.Model) -> mm.Model:
    """Return the model with De Groote's muscles of the same parameters."""
    kind = "DeGrooteFregly2016Muscle"
    return replace(
        model, muscles=tuple(replace(one, kind=kind, parameters={}) for one in model.muscles)
    )


def tiled(motion: mm.Motion, torques: mm.Series, seconds: float) -> tuple[mm.Motion, mm.Series]:
    """Repeat the stride, made to close.

    The difference of the last frame from the first is taken off evenly.
    """
    count = len(motion)
    frames = int(seconds * RATE)

    def closed(values: np.ndarray) -> np.ndarray:
        drift = np.linspace(0.0, 1.0, count)[:, None] * (values[-1] - values[0])
        return np.resize((values - drift)[:-1], (frames, values.shape[1]))

    time_ = np.arange(frames) / RATE
    long = mm.differentiate(mm.Motion(time_, motion.names, closed(motion.values)), cutoff=6.0)
    return long, mm.Series(time_, torques.names, closed(torques.values))


def run(degroote: bool = False) -> list[dict[str, object]]:
    """Return a row for the stride, one each for 15 and 60 s."""
    model, motion, torques = stride()
    if degroote:
        model = with_degroote(model)
    options = mm.TensionOptions(tendons="elastic")
    mm.solve_tension(model, motion, torques, options)
    rows = []
    for seconds in (len(motion) / RATE, LONG / 4.0, LONG):
        given = (motion, torques) if seconds < 2.0 else tiled(motion, torques, seconds)
        work = partial(mm.solve_tension, model, *given, options)
        taken = [clocked(work) for _ in range(ROUNDS if seconds < 2.0 else 1)]
        found = taken[-1].result
        median = statistics.median(one.seconds for one in taken)
        assert found.fibers is not None
        certificate = found.fibers.certificate
        rows.append(
            {
                "muscles": f"{len(model.muscles)} {model.muscles[0].kind}",
                "frames": len(given[0]),
                "seconds": median,
                "ms/frame": 1e3 * median / len(given[0]),
                "memory [MB]": max(one.peak for one in taken),
                "maximum programs": certificate.steps,
                "KKT residual": certificate.residual,
                "frames optimal": int(found.optimal.sum()),
            }
        )
    return rows
