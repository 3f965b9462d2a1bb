"""36,000 frames of the 520-muscle, 171-coordinate model, simulated.

Measured are milliseconds per frame of each step, and memory.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import myomorph as mm
from benchmarks.recordings import read_markers
from benchmarks.speed.timing import MEGABYTE, clocked, in_own_process
from data_collection import data_folder
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.recruitment import EFFORT_ALONE

FRAMES = 36_000
RATE = 100.0


def run() -> list[dict[str, object]]:
    """Rows of the steps, measured in a process of its own so that memory is theirs alone."""
    return in_own_process(_chain)


def _chain() -> list[dict[str, object]]:
    folder = data_folder() / "fullbody-many-muscles"
    model = mm.read_model(folder / "cyclistFullBodyMuscle.osim")
    recorded = read_markers(folder / "s01_static.trc")
    pose = mm.inverse_kinematics(model, recorded).motion.values[0]
    _whole(model, *simulated(model, pose, 64))
    markers, _ = simulated(model, pose, FRAMES)
    return _whole(model, markers, None)


def simulated(model: mm.Model, pose: np.ndarray, frames: int) -> tuple[mm.Markers, mm.Motion]:
    """Simulate a slow swing about a pose.

    Parameters
    ----------
    model : that swings
    pose : (coordinates,) [rad or m]
    frames : of the swing

    Returns
    -------
    Markers and motion
    """
    rng = np.random.default_rng(0)
    tree = compile_tree(model)
    time_ = np.arange(frames) / RATE
    free = [j for j in tree.independent if not model.coordinates[j].locked]
    values = np.tile(pose, (frames, 1))
    values[:, free] += 0.03 * np.sin(
        time_[:, None] * rng.uniform(1, 6, len(free)) + rng.uniform(0, 6, len(free))
    )
    motion = mm.Motion(time_, model.coordinate_names, values)
    values = tree.coordinates_of(motion)
    bodies = np.array([tree.body_index[marker.body] for marker in model.markers])
    locations = np.array([marker.location for marker in model.markers])
    positions = np.empty((frames, len(bodies), 3))
    for start in range(0, frames, 500):
        span = slice(start, start + 500)
        positions[span] = forward_kinematics(tree, values[span]).points(bodies, locations)
    return mm.Markers(time_, model.marker_names, positions), motion


def _whole(model: mm.Model, markers: mm.Markers, _: mm.Motion | None) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    frames = len(markers)

    def step(
        name: str, work: Callable[[], object], result_bytes: Callable[[object], int]
    ) -> object:
        taken = clocked(work)
        size = result_bytes(taken.result) / MEGABYTE
        rows.append(
            {
                "step": name,
                "frames": frames,
                "ms/frame": 1e3 * taken.seconds / frames,
                "results [MB]": size,
                "peak beyond start and results [MB]": taken.peak - size,
            }
        )
        return taken.result

    fit = step(
        "inverse kinematics",
        lambda: mm.inverse_kinematics(model, markers),
        lambda r: nbytes(r.motion.values, r.marker_error),
    )
    moving = step(
        "derivatives",
        lambda: mm.differentiate(fit.motion),
        lambda r: nbytes(r.values, r.velocities, r.accelerations),
    )
    torques = step(
        "inverse dynamics", lambda: mm.inverse_dynamics(model, moving), lambda r: nbytes(r.values)
    )
    paths = compile_paths(model)

    def lengths_and_arms() -> None:
        # As the command writes them to files: chunk by chunk, nothing kept.
        for start in range(0, frames, 512):
            span = slice(start, start + 512)
            paths.evaluate(moving.values[span], moving.velocities[span])

    step("lengths, velocities, moment arms (streamed)", lengths_and_arms, lambda _: 0)
    step(
        "muscle tensions",
        lambda: mm.solve_tension(model, moving, torques, recruitment=EFFORT_ALONE),
        lambda r: nbytes(r.activation, r.muscle_force, r.actuator_force, r.balanced_torque),
    )
    total = sum(
        float(row["ms/frame"]) for row in rows if not str(row["step"]).startswith("lengths")
    )
    rows.append({"step": "whole chain", "frames": frames, "ms/frame": total})
    return rows


def nbytes(*arrays: np.ndarray) -> int:
    """Bytes of some arrays."""
    return sum(array.nbytes for array in arrays)
