"""Every step of the main job against OpenSim's tools: same input, one process, in turn, medians."""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import opensim

import myomorph as mm
from benchmarks import opensim_static, opensim_tools
from benchmarks.accuracy.kinematics.kinematics import written_whole
from benchmarks.accuracy.tension import tension as accuracy_tension
from benchmarks.recordings import RECORDINGS, Recording, read_markers
from benchmarks.speed.timing import alternate, compared
from data_collection import data_folder
from myomorph.core.io.loads import read_external_loads, read_load_entries
from myomorph.core.io.mjcf.read import read_mjcf
from myomorph.core.io.osim.setup_parts import read_ik_tasks
from myomorph.core.motion.sync import cut
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.tree import compile_tree

COUPLED = "Rajagopal 2016 (generic), 39 coordinates, 80 muscles, coupled knees"
BONE_PINS = "bone-pin shoulder, 17 coordinates, a closed loop, first 3 s"
PLAIN = "gait2354, 23 coordinates, 54 muscles, no couplers"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command line."""
    parser.add_argument("--rounds", type=int, default=3, help="turns of each program")


def run(rounds: int = 3) -> list[dict[str, object]]:
    """Measure ms a frame and ratios of each step, medians of some rounds."""
    folder = data_folder()
    rajagopal = RECORDINGS["rajagopal"]
    bone_pins = RECORDINGS["bone-pins"]
    scaled = "Rajagopal, scaled, 33 coordinates"
    return [
        inverse_kinematics_row(f"{scaled}, coupled knees", folder, rajagopal, rounds),
        inverse_kinematics_row(PLAIN, folder, RECORDINGS["gait2354"], rounds),
        inverse_kinematics_row(BONE_PINS, folder, bone_pins, rounds, end=3.0),
        inverse_dynamics_row(scaled, folder, rajagopal, rounds),
        inverse_dynamics_row(PLAIN, folder, RECORDINGS["gait2354-dynamics"], rounds),
        muscle_row(COUPLED, folder / rajagopal.generic, folder / rajagopal.motion, rounds),
        static_optimization_row(folder, rounds),
    ]


def inverse_kinematics_row(
    name: str, folder: Path, files: Recording, rounds: int, *, end: float = np.inf
) -> dict[str, object]:
    """Solve a marker recording to its end, or to that time [s]; weights of OpenSim's task set."""
    model_path = folder / files.model
    markers_path = folder / files.markers
    model = mm.read_model(model_path)
    markers = read_markers(markers_path)
    markers = cut(markers, float(markers.time[0]), min(end, float(markers.time[-1])))
    weights = {
        marker: weight
        for marker, weight in read_ik_tasks(folder / files.tasks).marker_weights.items()
        if marker in markers.names and marker in model.marker_names
    }
    options = mm.InverseKinematicsOptions(marker_weights=weights, only_weighted=True)
    span = (float(markers.time[0]), float(markers.time[-1]))
    taken: list[float] = []

    def theirs() -> None:
        result = opensim_tools.inverse_kinematics(model_path, markers_path, weights, span)
        taken.append(result.seconds)

    seconds = alternate(
        {"ours": lambda: mm.inverse_kinematics(model, markers, options), "OpenSim": theirs},
        rounds=rounds,
    )
    # Without the reading of the model, which ours has behind it as well.
    seconds["OpenSim"] = float(np.median(taken[1:]))
    return compared("inverse kinematics", name, len(markers), seconds)


def inverse_dynamics_row(
    name: str, folder: Path, files: Recording, rounds: int
) -> dict[str, object]:
    """Compute derivatives, external loads at the motion's times and generalized forces.

    Neither program's time counts the reading of the two tables: OpenSim's is measured and taken
    off.
    """
    model_path = folder / files.model
    loads = folder / files.loads
    model = mm.read_model(model_path)
    wrenches = read_external_loads(loads)
    taken: list[float] = []
    frames: list[int] = []
    with tempfile.TemporaryDirectory() as work:
        motion, whole = written_whole(
            model, mm.read_motion(folder / files.motion, model), Path(work)
        )
        tables = [whole, read_load_entries(loads)[0].data]

        def ours() -> None:
            moving = mm.differentiate(motion)
            mm.inverse_dynamics(model, moving, mm.resample_wrenches(wrenches, moving.time))

        def theirs() -> None:
            result = opensim_tools.inverse_dynamics(
                model_path, whole, loads, float(motion.time[0]), float(motion.time[-1])
            )
            began = time.perf_counter()
            for table in tables:
                opensim.Storage(str(table))
            taken.append(result.seconds - (time.perf_counter() - began))
            frames.append(len(result.time))

        seconds = alternate({"ours": ours, "OpenSim": theirs}, rounds=rounds)
    seconds["OpenSim"] = float(np.median(taken[1:]))
    return compared("inverse dynamics", name, len(motion), seconds, frames[-1])


def muscle_row(name: str, model_path: Path, motion_path: Path, rounds: int) -> dict[str, object]:
    """All lengths and the whole moment-arm matrix; OpenSim by its Python loop, on a few frames."""
    model = mm.read_model(model_path)
    motion = mm.read_motion(motion_path, model)
    tree = compile_tree(model)
    values = tree.coordinates_of(motion)
    paths = compile_paths(model)
    few = np.linspace(0, len(values) - 1, 5).astype(int)
    theirs = opensim_muscles(model_path, model, values[few])
    seconds = alternate(
        {"ours": lambda: paths.evaluate(values, None), "OpenSim": theirs}, rounds=rounds
    )
    return compared("lengths and moment-arm matrix", name, len(values), seconds, len(few))


def opensim_muscles(model_path: Path, model: mm.Model, values: np.ndarray) -> Callable[[], None]:
    """Return a loop over frames, muscles and coordinates, as OpenSim's users write it.

    Parameters
    ----------
    model_path : OpenSim's model
    model : the same of ours, with the order of coordinates
    values : (frames, coordinates) [rad or m]

    Returns
    -------
    The loop
    """
    theirs = opensim.Model(str(model_path))
    state = theirs.initSystem()
    muscles = theirs.getMuscles()
    coordinates = theirs.getCoordinateSet()

    def loop() -> None:
        for row in values:
            for name, value in zip(model.coordinate_names, row, strict=True):
                coordinates.get(name).setLocked(state, False)
                coordinates.get(name).setValue(state, float(value), False)
            theirs.realizePosition(state)
            for i in range(muscles.getSize()):
                muscle = muscles.get(i)
                muscle.getLength(state)
                for j in range(coordinates.getSize()):
                    muscle.computeMomentArm(state, coordinates.get(j))

    return loop


def static_optimization_row(folder: Path, rounds: int) -> dict[str, object]:
    """Go from coordinates to activations.

    The steps are derivatives, inverse dynamics, muscles and the tension problem. Both read the same
    complete motion, loads and reserves; OpenSim stops at its own default criterion.
    """
    case = next(
        case for case in accuracy_tension.CASES if case.name == "walk, Rajagopal, 80 muscles"
    )
    with tempfile.TemporaryDirectory() as work:
        prepared = accuracy_tension.prepare(folder, case, Path(work))
        inputs = opensim_static.AnalyzeInputs(
            model=prepared.model_path,
            motion=prepared.motion_path,
            loads=prepared.loads,
            actuators=prepared.actuator_path,
        )
        options = opensim_static.StaticOptions(interval=100)
        taken: list[float] = []
        frames: list[int] = []

        def theirs() -> None:
            result = opensim_static.static_optimization(inputs, case.start, case.end, options)
            taken.append(result.seconds)
            frames.append(len(result.time))

        count = len(accuracy_tension.ours(prepared))
        seconds = alternate(
            {"ours": lambda: accuracy_tension.ours(prepared), "OpenSim": theirs}, rounds=rounds
        )
        seconds["OpenSim"] = float(np.median(taken[1:]))
    return compared("static optimization, from coordinates", case.name, count, seconds, frames[-1])


FRAMES = 400


def run_mujoco() -> list[dict[str, object]]:
    """One row: lengths with Jacobian of all 416 muscles."""
    from musclemimic_models import get_xml_path

    path = get_xml_path("myofullbody")
    model = read_mjcf(path)
    theirs = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(theirs)
    rng = np.random.default_rng(0)
    poses = np.tile(theirs.qpos0, (FRAMES, 1))
    for joint in range(theirs.njnt):
        if theirs.jnt_limited[joint]:
            low, high = theirs.jnt_range[joint]
            poses[:, theirs.jnt_qposadr[joint]] = rng.uniform(low, high, FRAMES)
    tree = compile_tree(model)
    paths = compile_paths(model)
    values = np.tile(tree.defaults, (FRAMES, 1))
    for j, coordinate in enumerate(model.coordinates):
        if np.isfinite(coordinate.range).all():
            values[:, j] = rng.uniform(*coordinate.range, FRAMES)
    values = tree.coordinates_of(
        mm.Motion(np.arange(FRAMES) * 0.01, model.coordinate_names, values)
    )

    def ours() -> None:
        paths.evaluate(values, None)

    def mujoco_loop() -> None:
        for pose in poses:
            data.qpos[:] = pose
            mujoco.mj_kinematics(theirs, data)
            mujoco.mj_comPos(theirs, data)
            mujoco.mj_tendon(theirs, data)

    before = os.environ.get("MYOMORPH_THREADS")
    os.environ["MYOMORPH_THREADS"] = "1"
    try:
        seconds = alternate({"ours": ours, "MuJoCo": mujoco_loop}, rounds=7)
    finally:
        if before is None:
            del os.environ["MYOMORPH_THREADS"]
        else:
            os.environ["MYOMORPH_THREADS"] = before
    name = (
        f"MyoFullBody, {len(model.muscles)} muscles, {len(model.coordinates)} coordinates, one"
        " thread"
    )
    return [compared("lengths and moment arms", name, FRAMES, seconds)]
