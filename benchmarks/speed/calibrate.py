"""Kinematic identification of 50, 500 and 2,000 simulated frames of a 39-coordinate model.

Measured are seconds and peak memory.
"""

from __future__ import annotations

import numpy as np

import myomorph as mm
from benchmarks.speed.timing import clocked, in_own_process
from data_collection import data_folder
from myomorph.core.model.scale import scale
from myomorph.core.motion.lengths import factors_of, lengths_of
from myomorph.core.rigid.coordinates import couple_frames
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

SIZES = (50, 500, 2000)
NOISE = 3e-4


def run() -> list[dict[str, object]]:
    """Return a row for each number of frames.

    Each is measured in a process of its own, so that memory is its alone.
    """
    return in_own_process(_rows)


def _rows() -> list[dict[str, object]]:
    generic = mm.read_model(data_folder() / "rajagopal-walk-emg/raw/Rajagopal2016.osim")
    markers = simulated(generic, max(SIZES))
    mm.calibrate(generic, [markers], mm.CalibrationOptions(frames=20))
    rows = []
    for frames in SIZES:
        part = markers.frames(slice(frames))
        taken = clocked(
            lambda part=part: mm.calibrate(generic, [part], mm.CalibrationOptions(frames=len(part)))
        )
        found = taken.result
        used = sum(map(len, found.frames))
        rows.append(
            {
                "frames": used,
                "coordinates": len(generic.coordinates),
                "lengths": len(found.lengths),
                "markers": len(found.markers),
                "seconds": taken.seconds,
                "CPU seconds": taken.cpu,
                "ms/frame": 1e3 * taken.seconds / used,
                "steps of the last stage": len(found.costs),
                "converged": found.converged,
                "RMSE before [mm]": 1e3 * found.rms_before,
                "after [mm]": 1e3 * found.rms_after,
                "peak beyond start [MB]": taken.peak,
            }
        )
    return rows


def simulated(generic: mm.Model, frames: int) -> mm.Markers:
    """Markers of a moving body whose lengths differ from the model's by about 5 %, with noise."""
    rng = np.random.default_rng(0)
    lengths = lengths_of(generic, symmetric=True)
    person = scale(generic, factors_of(lengths, rng.normal(1.03, 0.05, len(lengths))))
    tree = compile_tree(person)
    clock = np.arange(frames) / 20.0
    values = np.tile(tree.defaults, (frames, 1))
    for j in tree.independent:
        coordinate = person.coordinates[j]
        if coordinate.locked:
            continue
        low, high = coordinate.range if coordinate.clamped else (-np.inf, np.inf)
        middle = tree.defaults[j]
        swing = 0.4 if coordinate.motion == "rotational" else 0.2
        if np.isfinite(high - low):
            swing = min(swing, 0.45 * (high - low))
            middle = min(max(middle, low + swing), high - swing)
        values[:, j] = middle + swing * np.sin(rng.uniform(0.5, 5) * clock + rng.uniform(0, 6))
    couple_frames(tree.arrays, values)
    bodies = np.array([tree.body_index[one.body] for one in person.markers])
    places = forward_kinematics(tree, values).points(
        bodies, np.array([one.location for one in person.markers])
    )
    return mm.Markers(clock, person.marker_names, places + NOISE * rng.normal(size=places.shape))
