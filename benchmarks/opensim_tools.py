"""OpenSim's own tools on our cases: results as arrays, and the seconds they took.

Every function keeps the model referenced while a tool runs: OpenSim's Python tools crash when the
model they point to is collected.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import opensim

opensim.Logger.setLevelString("Off")


@dataclass(frozen=True)
class ToolResult:
    """What a tool wrote, and how long it ran [s]."""

    time: np.ndarray
    names: tuple[str, ...]
    values: np.ndarray
    seconds: float


def read_table(path: Path) -> tuple[np.ndarray, tuple[str, ...], np.ndarray]:
    """Read a MOT or STO file.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    (rows,) times [s], names of the other columns, and (rows, columns) their values
    """
    with open(path) as file:
        for line in file:
            if line.strip().lower() == "endheader":
                break
        names = file.readline().split()
        values = np.loadtxt(file, ndmin=2)
    return values[:, 0], tuple(names[1:]), values[:, 1:]


def _result(path: Path, seconds: float) -> ToolResult:
    clock, names, values = read_table(path)
    return ToolResult(time=clock, names=names, values=values, seconds=seconds)


def load(path: Path) -> opensim.Model:
    """Read a model, and build its system."""
    model = opensim.Model(str(path))
    model.initSystem()
    return model


def inverse_kinematics(
    model_path: Path,
    markers: Path,
    weights: dict[str, float],
    span: tuple[float, float],
    accuracy: float | None = None,
) -> ToolResult:
    """Run OpenSim's InverseKinematicsTool; degrees as it writes them.

    `span`: start and end [s]; `accuracy`: its own (1e-5) where it is None.
    """
    start, end = span
    model = load(model_path)
    tool = opensim.InverseKinematicsTool()
    tool.setModel(model)
    tool.setMarkerDataFileName(str(markers))
    tool.setStartTime(start)
    tool.setEndTime(end)
    if accuracy is not None:
        tool.set_accuracy(accuracy)
    for name, weight in weights.items():
        task = opensim.IKMarkerTask()
        task.setName(name)
        task.setWeight(weight)
        tool.upd_IKTaskSet().cloneAndAppend(task)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "ik.mot"
        tool.setOutputMotionFileName(str(out))
        tool.setResultsDir(folder)
        tool.set_report_errors(False)
        began = time.perf_counter()
        tool.run()
        seconds = time.perf_counter() - began
        return _result(out, seconds)


def inverse_dynamics(
    model_path: Path, motion: Path, loads: Path | None, start: float, end: float
) -> ToolResult:
    """OpenSim's InverseDynamicsTool without a filter."""
    model = load(model_path)
    tool = opensim.InverseDynamicsTool()
    tool.setModel(model)
    tool.setCoordinatesFileName(str(motion))
    tool.setStartTime(start)
    tool.setEndTime(end)
    if loads is not None:
        tool.setExternalLoadsFileName(str(loads))
    exclude = opensim.ArrayStr()
    exclude.append("Muscles")
    tool.setExcludedForces(exclude)
    with tempfile.TemporaryDirectory() as folder:
        tool.setResultsDir(folder)
        tool.setOutputGenForceFileName("id.sto")
        began = time.perf_counter()
        tool.run()
        seconds = time.perf_counter() - began
        return _result(Path(folder) / "id.sto", seconds)


EARTH = (-np.pi / 2, 0.0, 0.0)
"""From the earth of sensors, whose z points up, to OpenSim's ground [rad]."""


def imu_placement(model_path: Path, placement: Path, base: tuple[str, str], placed: Path) -> None:
    """Write the model with a frame for each sensor, placed by a calibration pose.

    `base`: sensor that shows the heading, and its axis that points forward.
    """
    placer = opensim.IMUPlacer()
    placer.set_model_file(str(model_path))
    placer.set_orientation_file_for_calibration(str(placement))
    placer.set_sensor_to_opensim_rotations(opensim.Vec3(*EARTH))
    placer.set_base_imu_label(base[0])
    placer.set_base_heading_axis(base[1])
    placer.run(False)
    placer.getCalibratedModel().printToXML(str(placed))


def without_couplers(model_path: Path, out: Path) -> None:
    """Write the model with every dependent coordinate locked at its default."""
    model = opensim.Model(str(model_path))
    constraints = model.updConstraintSet()
    coordinates = model.updCoordinateSet()
    for index in range(constraints.getSize()):
        coupler = opensim.CoordinateCouplerConstraint.safeDownCast(constraints.get(index))
        coordinates.get(coupler.getDependentCoordinateName()).set_locked(True)
    constraints.clearAndDestroy()
    model.initSystem()
    model.printToXML(str(out))


def imu_inverse_kinematics(
    placed: Path, walking: Path, span: tuple[float, float], folder: Path
) -> ToolResult:
    """Inverse kinematics of sensors that are frames of the model."""
    tool = opensim.IMUInverseKinematicsTool()
    tool.set_model_file(str(placed))
    tool.set_orientations_file(str(walking))
    tool.set_sensor_to_opensim_rotations(opensim.Vec3(*EARTH))
    tool.set_time_range(0, span[0])
    tool.set_time_range(1, span[1])
    tool.set_results_directory(str(folder))
    tool.set_output_motion_file("angles.sto")
    tool.set_report_errors(False)
    began = time.process_time()
    tool.run(False)
    seconds = time.process_time() - began
    return _result(folder / "angles.sto", seconds)
