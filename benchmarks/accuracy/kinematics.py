"""Inverse kinematics and inverse dynamics against OpenSim's tools, case by case, with their times."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks import opensim_tools
from benchmarks.cases import FORCE_CASES, MARKER_CASES, ForceCase, MarkerCase
from benchmarks.recordings import read_markers
from myomorph.io.loads import read_external_loads
from myomorph.io.osim.setup_parts import read_ik_tasks
from myomorph.io.sto import table_from_motion
from myomorph.motion.sync import cut
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree


def marker_rmse(
    model: mm.Model, names: tuple[str, ...], weights: np.ndarray, markers: mm.Markers, values: np.ndarray
) -> float:
    """Weighted root mean square distance of the model's markers from those seen, over all frames [m]."""
    tree = compile_tree(model)
    poses = forward_kinematics(tree, values)
    bodies = np.array([tree.body_index[model.marker(name).body] for name in names])
    placed = poses.points(bodies, np.array([model.marker(name).location for name in names]))
    seen = markers.values[:, [markers.names.index(name) for name in names]]
    squares = ((placed - seen) ** 2).sum(axis=2)
    shares = np.where(np.isfinite(squares), weights, 0.0)
    return float(np.sqrt((shares * np.nan_to_num(squares)).sum() / shares.sum()))


def measure_inverse_kinematics(folder: Path) -> Iterator[dict[str, object]]:
    """A row a recording."""
    return (_inverse_kinematics(folder, case) for case in MARKER_CASES)


def _inverse_kinematics(folder: Path, case: MarkerCase) -> dict[str, object]:
    """Marker RMSE of both programs with the same weights, and their milliseconds a frame."""
    model = mm.read_model(folder / case.model)
    markers = read_markers(folder / case.markers)
    markers = cut(markers, markers.time[0], markers.time[min(case.most_frames, len(markers)) - 1])
    given = read_ik_tasks(folder / case.tasks).marker_weights if case.tasks else dict.fromkeys(model.marker_names, 1.0)
    shared = {name: weight for name, weight in given.items() if name in markers.names and name in model.marker_names}
    options = mm.InverseKinematicsOptions(marker_weights=shared, only_weighted=True)
    mm.inverse_kinematics(model, markers, options)
    began = time.perf_counter()
    fit = mm.inverse_kinematics(model, markers, options)
    ours = time.perf_counter() - began
    theirs = opensim_tools.inverse_kinematics(
        folder / case.model, folder / case.markers, shared, markers.time[0], markers.time[-1]
    )
    table = motion_from_opensim(model, theirs)
    common = markers_at(markers, table.time)
    values = compile_tree(model).coordinates_of(table)
    ours_at = compile_tree(model).coordinates_of(motion_at(fit.motion, table.time))
    rotational = [j for j, c in enumerate(model.coordinates) if c.motion == "rotational"]
    difference = np.degrees(np.abs((ours_at - values + np.pi) % (2 * np.pi) - np.pi)[:, rotational])
    return {
        "case": case.name,
        "frames": len(table),
        "coordinates": len(model.coordinates),
        "RMSE ours [mm]": 1e3 * marker_rmse(model, fit.marker_names, fit.weights, common, ours_at),
        "RMSE OpenSim [mm]": 1e3 * marker_rmse(model, fit.marker_names, fit.weights, common, values),
        "median angle difference [deg]": float(np.median(difference)),
        "converged": float(fit.converged.mean()),
        "ours [ms/frame]": 1e3 * ours / len(markers),
        "OpenSim [ms/frame]": 1e3 * theirs.seconds / len(theirs.time),
    }


def motion_from_opensim(model: mm.Model, result: opensim_tools.ToolResult) -> mm.Motion:
    """Coordinates a tool wrote, degrees turned into radians."""
    names = [name for name in result.names if name in model.coordinate_names]
    columns = [
        result.values[:, result.names.index(name)]
        * (np.pi / 180.0 if model.coordinate(name).motion == "rotational" else 1.0)
        for name in names
    ]
    return mm.Motion(result.time, tuple(names), np.column_stack(columns))


def motion_at(motion: mm.Motion, at: np.ndarray) -> mm.Motion:
    """The frames nearest to the given times."""
    index = np.abs(motion.time[:, None] - at[None]).argmin(axis=0)
    return mm.Motion(at, motion.names, motion.values[index])


def markers_at(markers: mm.Markers, at: np.ndarray) -> mm.Markers:
    """The frames nearest to the given times."""
    index = np.abs(markers.time[:, None] - at[None]).argmin(axis=0)
    return mm.Markers(at, markers.names, markers.values[index])


def written_whole(model: mm.Model, motion: mm.Motion, folder: Path) -> tuple[mm.Motion, Path]:
    """The motion with every coordinate, and a file of it: OpenSim's tools overlook columns named as states."""
    whole = mm.Motion(motion.time, model.coordinate_names, compile_tree(model).coordinates_of(motion))
    path = folder / "motion.mot"
    mm.write_sto(table_from_motion(whole, model), path)
    return whole, path


def measure_inverse_dynamics(folder: Path) -> Iterator[dict[str, object]]:
    """A row a recording."""
    return (_inverse_dynamics(folder, case) for case in FORCE_CASES)


def _inverse_dynamics(folder: Path, case: ForceCase) -> dict[str, object]:
    """Largest RMS difference of a coordinate relative to its range, and milliseconds a frame."""
    model = mm.read_model(folder / case.model)
    given = mm.read_motion(folder / case.motion, model)
    loads = folder / case.loads if case.loads else None

    def chain() -> mm.Series:
        differentiated = cut(mm.differentiate(motion), case.start, case.end)
        wrenches = None
        if loads is not None:
            wrenches = mm.resample_wrenches(read_external_loads(loads), differentiated.time)
        return mm.inverse_dynamics(model, differentiated, wrenches)

    with tempfile.TemporaryDirectory() as work:
        motion, motion_path = written_whole(model, given, Path(work))
        chain()
        began = time.perf_counter()
        ours = chain()
        seconds = time.perf_counter() - began
        theirs = opensim_tools.inverse_dynamics(
            folder / case.model, motion_path, loads, float(ours.time[0]), float(ours.time[-1])
        )
    index = np.abs(ours.time[:, None] - theirs.time[None]).argmin(axis=0)
    worst, worst_name = 0.0, ""
    for j, label in enumerate(theirs.names):
        name = label.rsplit("_", 1)[0]
        difference = ours[name][index] - theirs.values[:, j]
        spread = np.ptp(theirs.values[:, j])
        relative = float(np.sqrt(np.mean(difference**2)) / spread) if spread > 1e-6 else 0.0
        if relative > worst:
            worst, worst_name = relative, name
    return {
        "case": case.name,
        "frames": len(theirs.time),
        "coordinates": len(model.coordinates),
        "worst RMS / range [%]": 100.0 * worst,
        "worst coordinate": worst_name,
        "ours [ms/frame]": 1e3 * seconds / len(ours),
        "OpenSim [ms/frame]": 1e3 * theirs.seconds / len(theirs.time),
    }
