"""36,000 frames of the 520-muscle, 171-coordinate model: milliseconds a frame of each step, and peak memory.

The motion is simulated: every coordinate that may move swings slowly about the recorded static pose, and
the markers are the model's own, so that the size is real and the truth is known.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable

import numpy as np

from benchmarks.cases import data_folder
from myomorph.io.formats import read_model
from myomorph.io.trc import read_trc
from myomorph.model.model import Model
from myomorph.model.series import Markers, Motion
from myomorph.motion.filters import differentiate
from myomorph.motion.ik import inverse_kinematics
from myomorph.muscles.path import compile_paths
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree
from myomorph.tension.solve import TensionOptions, solve_tension

FRAMES = 36_000
RATE = 100.0
MEGABYTE = 2.0**20


def run() -> list[dict[str, object]]:
    """Rows of the steps, measured in a process of its own so that memory is theirs alone."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_chain)


def _chain() -> list[dict[str, object]]:
    folder = data_folder() / "fullbody-many-muscles"
    model = read_model(folder / "cyclistFullBodyMuscle.osim")
    recorded = read_trc(folder / "s01_static.trc").markers
    assert recorded is not None
    pose = inverse_kinematics(model, recorded).motion.values[0]
    _whole(model, *simulated(model, pose, 64))
    markers, _ = simulated(model, pose, FRAMES)
    return _whole(model, markers, None)


def simulated(model: Model, pose: np.ndarray, frames: int) -> tuple[Markers, Motion]:
    """Markers and coordinates of a slow swing about a pose."""
    rng = np.random.default_rng(0)
    tree = compile_tree(model)
    time_ = np.arange(frames) / RATE
    free = [j for j in tree.independent if not model.coordinates[j].locked]
    values = np.tile(pose, (frames, 1))
    values[:, free] += 0.03 * np.sin(time_[:, None] * rng.uniform(1, 6, len(free)) + rng.uniform(0, 6, len(free)))
    motion = Motion(time_, model.coordinate_names, values)
    values = tree.coordinates_of(motion)
    bodies = np.array([tree.body_index[marker.body] for marker in model.markers])
    locations = np.array([marker.location for marker in model.markers])
    positions = np.empty((frames, len(bodies), 3))
    for start in range(0, frames, 500):
        span = slice(start, start + 500)
        positions[span] = forward_kinematics(tree, values[span]).points(bodies, locations)
    return Markers(time_, model.marker_names, positions), motion


def _whole(model: Model, markers: Markers, _: Motion | None) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    frames = len(markers)

    def step(name: str, work: Callable[[], object], result_bytes: Callable[[object], int]) -> object:
        before = resident()
        began = time.perf_counter()
        result = work()
        seconds = time.perf_counter() - began
        size = result_bytes(result)
        rows.append(
            {
                "step": name,
                "frames": frames,
                "ms/frame": 1e3 * seconds / frames,
                "results [MB]": size / MEGABYTE,
                "peak beyond start and results [MB]": (peak() - before - size) / MEGABYTE,
            }
        )
        return result

    fit = step(
        "inverse kinematics", lambda: inverse_kinematics(model, markers), lambda r: nbytes(r.motion.values, r.errors)
    )
    moving = step(
        "derivatives", lambda: differentiate(fit.motion), lambda r: nbytes(r.values, r.velocities, r.accelerations)
    )
    torques = step("inverse dynamics", lambda: inverse_dynamics(model, moving), lambda r: nbytes(r.values))
    paths = compile_paths(model)

    def lengths_and_arms() -> None:
        # As the command writes them to files: chunk by chunk, nothing kept.
        for start in range(0, frames, 512):
            span = slice(start, start + 512)
            paths.evaluate(moving.values[span], moving.velocities[span])

    step("lengths, velocities, moment arms (streamed)", lengths_and_arms, lambda _: 0)
    step(
        "muscle tensions",
        lambda: solve_tension(model, moving, torques, TensionOptions(passive=False)),
        lambda r: nbytes(r.activations, r.forces, r.reserves, r.torques),
    )
    total = sum(float(row["ms/frame"]) for row in rows if not str(row["step"]).startswith("lengths"))
    rows.append({"step": "whole chain", "frames": frames, "ms/frame": total})
    return rows


def nbytes(*arrays: np.ndarray) -> int:
    """Bytes of some arrays."""
    return sum(array.nbytes for array in arrays)


def _status(key: str) -> int:
    with open("/proc/self/status") as file:
        for line in file:
            if line.startswith(key):
                return int(line.split()[1]) * 1024
    return 0


def resident() -> int:
    """Memory in use now, the peak forgotten [bytes]; Linux only."""
    with open("/proc/self/clear_refs", "w") as file:
        file.write("5")
    return _status("VmRSS")


def peak() -> int:
    """Most memory in use since `resident` [bytes]."""
    return _status("VmHWM")
