"""Every step of the main job against OpenSim's tools: same input, one process, in turn, medians."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import opensim

from benchmarks import opensim_static, opensim_tools
from benchmarks.accuracy import tension as accuracy_tension
from benchmarks.accuracy.kinematics import written_whole
from benchmarks.cases import data_folder
from benchmarks.speed.timing import alternate, compared
from myomorph.io.formats import read_model
from myomorph.io.loads import read_external_loads, read_load_entries
from myomorph.io.osim.setup_parts import read_ik_tasks
from myomorph.io.sto import motion_from_table, read_sto
from myomorph.io.trc import read_trc
from myomorph.model.model import Model
from myomorph.motion.filters import differentiate
from myomorph.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.motion.sync import cut, resample_wrenches
from myomorph.muscles.path import compile_paths
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.rigid.tree import compile_tree

COUPLED = "Rajagopal 2016 (generic), 39 coordinates, 80 muscles, coupled knees"
PLAIN = "gait2354, 23 coordinates, 54 muscles, no couplers"


def run() -> list[dict[str, object]]:
    """Rows of ms a frame and ratios for each step."""
    folder = data_folder()
    rajagopal = folder / "rajagopal-walk-emg"
    gait = folder / "opensim-gait-subject01"
    return [
        inverse_kinematics_row(
            "Rajagopal, scaled, 33 coordinates, coupled knees",
            rajagopal / "subject_walk_scaled.osim",
            rajagopal / "markers_walk.trc",
            rajagopal / "ik_tasks_walk.xml",
        ),
        inverse_kinematics_row(
            PLAIN,
            gait / "ref_scale/std_subject01_simbody.osim",
            gait / "experiment/subject01_walk1.trc",
            gait / "ref_ik/gait2354_IK_Tasks.xml",
        ),
        inverse_kinematics_row(
            "bone-pin shoulder, 17 coordinates, a closed loop, first 3 s",
            folder / "shoulder-bonepin/subject1_abdbonepin.osim",
            folder / "shoulder-bonepin/abdbonepin.trc",
            folder / "shoulder-bonepin/setup_ik_abdbonepin.xml",
            end=3.0,
        ),
        inverse_dynamics_row(
            "Rajagopal, scaled, 33 coordinates",
            rajagopal / "subject_walk_scaled.osim",
            rajagopal / "coordinates.sto",
            rajagopal / "grf_walk.xml",
        ),
        inverse_dynamics_row(
            PLAIN,
            gait / "ref_id/subject01.osim",
            gait / "ref_id/subject01_walk1_ik.mot",
            gait / "ref_id/subject01_walk1_grf.xml",
        ),
        muscle_row(COUPLED, rajagopal / "raw/Rajagopal2016.osim", rajagopal / "coordinates.sto"),
        static_optimization_row(folder),
    ]


def inverse_kinematics_row(
    name: str, model_path: Path, markers_path: Path, tasks: Path, end: float = np.inf
) -> dict[str, object]:
    """A marker recording to its end, or to that time [s]; weights of OpenSim's task set."""
    model = read_model(model_path)
    markers = read_trc(markers_path).markers
    assert markers is not None
    markers = cut(markers, float(markers.time[0]), min(end, float(markers.time[-1])))
    weights = {
        marker: weight
        for marker, weight in read_ik_tasks(tasks).marker_weights.items()
        if marker in markers.names and marker in model.marker_names
    }
    options = InverseKinematicsOptions(marker_weights=weights, only_weighted=True)
    start, last = float(markers.time[0]), float(markers.time[-1])
    taken: list[float] = []

    def theirs() -> None:
        taken.append(opensim_tools.inverse_kinematics(model_path, markers_path, weights, start, last).seconds)

    seconds = alternate({"ours": lambda: inverse_kinematics(model, markers, options), "OpenSim": theirs}, rounds=3)
    # Without the reading of the model, which ours has behind it as well.
    seconds["OpenSim"] = float(np.median(taken[1:]))
    return compared("inverse kinematics", name, len(markers), seconds)


def inverse_dynamics_row(name: str, model_path: Path, motion_path: Path, loads: Path) -> dict[str, object]:
    """Derivatives, external loads at the motion's times and generalized forces.

    Neither program's time counts the reading of the two tables: OpenSim's is measured and taken off.
    """
    model = read_model(model_path)
    wrenches = read_external_loads(loads)
    taken: list[float] = []
    frames: list[int] = []
    with tempfile.TemporaryDirectory() as work:
        motion, whole = written_whole(model, motion_from_table(read_sto(motion_path), model), Path(work))
        tables = [whole, read_load_entries(loads)[0].data]

        def ours() -> None:
            moving = differentiate(motion)
            inverse_dynamics(model, moving, resample_wrenches(wrenches, moving.time))

        def theirs() -> None:
            result = opensim_tools.inverse_dynamics(
                model_path, whole, loads, float(motion.time[0]), float(motion.time[-1])
            )
            began = time.perf_counter()
            for table in tables:
                opensim.Storage(str(table))
            taken.append(result.seconds - (time.perf_counter() - began))
            frames.append(len(result.time))

        seconds = alternate({"ours": ours, "OpenSim": theirs}, rounds=3)
    seconds["OpenSim"] = float(np.median(taken[1:]))
    return compared("inverse dynamics", name, len(motion), seconds, frames[-1])


def muscle_row(name: str, model_path: Path, motion_path: Path) -> dict[str, object]:
    """All lengths and the whole moment-arm matrix; OpenSim by its Python loop, on a few frames."""
    model = read_model(model_path)
    motion = motion_from_table(read_sto(motion_path), model)
    tree = compile_tree(model)
    values = tree.coordinates_of(motion)
    paths = compile_paths(model)
    few = np.linspace(0, len(values) - 1, 5).astype(int)
    theirs = opensim_muscles(model_path, model, values[few])
    seconds = alternate({"ours": lambda: paths.evaluate(values, None), "OpenSim": theirs}, rounds=3)
    return compared("lengths and moment-arm matrix", name, len(values), seconds, len(few))


def opensim_muscles(model_path: Path, model: Model, values: np.ndarray) -> Callable[[], None]:
    """A loop over frames, muscles and coordinates, as OpenSim's users write it."""
    theirs = opensim.Model(str(model_path))
    state = theirs.initSystem()
    muscles, coordinates = theirs.getMuscles(), theirs.getCoordinateSet()

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


def static_optimization_row(folder: Path) -> dict[str, object]:
    """From coordinates to activations: derivatives, inverse dynamics, muscles and the tension problem.

    Both read the same complete motion, loads and reserves; OpenSim stops at its own default criterion.
    """
    case = next(case for case in accuracy_tension.CASES if case.name == "walk, Rajagopal, 80 muscles")
    with tempfile.TemporaryDirectory() as work:
        prepared = accuracy_tension.prepare(folder, case, Path(work))
        taken: list[float] = []
        frames: list[int] = []

        def theirs() -> None:
            result = opensim_static.static_optimization(
                prepared.model_path,
                prepared.motion_path,
                prepared.loads,
                case.start,
                case.end,
                prepared.actuator_path,
                interval=100,
            )
            taken.append(result.seconds)
            frames.append(len(result.time))

        count = len(accuracy_tension.ours(prepared))
        seconds = alternate({"ours": lambda: accuracy_tension.ours(prepared), "OpenSim": theirs}, rounds=3)
        seconds["OpenSim"] = float(np.median(taken[1:]))
    return compared("static optimization, from coordinates", case.name, count, seconds, frames[-1])
