"""Muscle lengths, lengthening velocities and moment arms against OpenSim.

They are on recorded motions and random poses. OpenSim's moment arms are about its speeds u; ours,
about q, are carried over by qdot = N u. Where one still differs, a finite difference of OpenSim's
own length along u decides whose it fits better.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

import myomorph as mm
from benchmarks.recordings import RECORDINGS
from myomorph.core.muscles.kinematics import MuscleKinematics
from myomorph.core.muscles.model_paths import Paths, compile_paths

SAME = 1e-4
STEP = 1e-5
MILLIMETERS = 1e3


@dataclass(frozen=True)
class MuscleCase:
    """A model, a motion ("" for random poses), and how many frames of it OpenSim is asked for."""

    model: str
    motion: str = ""
    frames: int = 20
    opensim: bool = True


def _case(
    recording: str, motion: bool = True, frames: int = 20, opensim: bool = True
) -> MuscleCase:
    files = RECORDINGS[recording]
    return MuscleCase(
        model=files.model, motion=files.motion if motion else "", frames=frames, opensim=opensim
    )


CASES = (
    _case("rajagopal"),
    MuscleCase("rajagopal-walk-emg/raw/Rajagopal2016.osim"),
    _case("treadmill"),
    MuscleCase("passive-joint-moments/Rajagopal_modifiedAbductors.osim"),
    _case("opencap-jump"),
    _case("gait2392"),
    _case("gait2354-dynamics"),
    _case("gait10"),
    _case("run-2", motion=False),
    _case("arm26", motion=False),
    MuscleCase("c3d-functional-joints/models/Wu_Shoulder_Model_via_points.osim"),
    _case("wholebody"),
    MuscleCase(
        "shoulder-thoracoscapular/model_rmr/TSM_subject_2kgWeight.osim",
        "shoulder-thoracoscapular/ik/FLX01.mot",
    ),
    MuscleCase("bones-landmarks-leg/make-a-leg_final.osim"),
    _case("cyclist", frames=4),
    _case("lenhart", opensim=False),
)


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """One row a model; differences in mm."""
    for case in CASES:
        yield measure_case(folder, case)


def measure_case(folder: Path, case: MuscleCase) -> dict[str, object]:
    """Largest and 99th percentile differences of one model, and the names of the worst."""
    model = mm.read_model(folder / case.model)
    motion = _poses(model, folder / case.motion if case.motion else None, case.frames)
    ours = mm.muscle_kinematics(model, motion)
    paths = compile_paths(model)
    row: dict[str, object] = {
        "model": Path(case.model).name,
        "poses": Path(case.motion).name or "random",
        "muscles": len(model.muscles),
        "frames": len(motion),
        "moment arms a frame": len(paths.arm_coordinate),
    }
    if not case.opensim:
        return row | _against_own_lengths(model, paths, motion, ours)
    return row | _against_opensim(folder / case.model, model, paths, motion, ours)


@dataclass(kw_only=True, eq=False)
class _Differences:
    """Differences of muscles in all frames.

    Attributes
    ----------
    lengths : (frames, muscles) [m]
    speeds : (frames, muscles) [m/s]
    arms : (frames, pairs) of moment arms [m], NaN where ours fit OpenSim's lengths better
    beyond : number of moment arms that differ
    ours_nearer : number of those where ours fit OpenSim's lengths better
    seconds : that OpenSim took
    """

    lengths: np.ndarray
    speeds: np.ndarray
    arms: np.ndarray
    beyond: int = 0
    ours_nearer: int = 0
    seconds: float = 0.0


def _poses(model: mm.Model, file: Path | None, frames: int) -> mm.Motion:
    """Return frames spread over a motion, or random poses within three quarters of the ranges.

    Random poses have random speeds.
    """
    rng = np.random.default_rng(5)
    if file is not None:
        motion = mm.read_motion(file, model)
        kept = np.unique(np.linspace(0, len(motion) - 1, frames).astype(int))
        time_ = motion.time[kept]
        values = compile_paths(model).tree.coordinates_of(motion)[kept]
    else:
        values = np.tile([one.default for one in model.coordinates], (frames, 1))
        for j, one in enumerate(model.coordinates):
            low, high = one.range if np.ptp(one.range) < 2.1 * np.pi else (-0.5, 0.5)
            if not one.locked:
                # Off the ends of the ranges, where moving points stop and no slope is defined.
                share = 0.75 * rng.uniform(-0.5, 0.5, frames) * (high - low)
                rim = 0.02 * (high - low)
                values[:, j] = np.clip(one.default + share, low + rim, high - rim)
        time_ = np.arange(float(frames))
    return mm.Motion(time_, model.coordinate_names, values, rng.normal(size=values.shape))


def _against_own_lengths(
    model: mm.Model, paths: Paths, motion: mm.Motion, ours: MuscleKinematics
) -> dict[str, object]:
    """Compare moment arms with finite differences of our own lengths.

    It is done where OpenSim does not open the model.
    """
    assert ours.arms is not None
    differences = np.zeros(ours.arms.shape)
    for j in np.unique(paths.arm_coordinate):
        shifted = [
            paths.evaluate(motion.values + side * STEP * _unit(model, j))[0] for side in (-1.0, 1.0)
        ]
        pairs = np.flatnonzero(paths.arm_coordinate == j)
        slopes = (shifted[1] - shifted[0]) / (2.0 * STEP)
        differences[:, pairs] = np.abs(ours.arms[:, pairs] + slopes[:, paths.arm_muscle[pairs]])
    found = _Differences(lengths=np.full(1, np.nan), speeds=np.full(1, np.nan), arms=differences)
    return _row(found, np.nan, model, paths) | {
        "compared with": "finite differences of our lengths"
    }


def _unit(model: mm.Model, j: int) -> np.ndarray:
    return np.eye(len(model.coordinates))[j]


class _Theirs:
    """OpenSim's model at a pose, loops left open and coordinates unlocked."""

    def __init__(self, file: Path, model: mm.Model):
        import opensim

        opensim.Logger.setLevelString("Off")
        self.model = opensim.Model(str(file))
        for k in range(self.model.getConstraintSet().getSize() if model.loops else 0):
            self.model.updConstraintSet().get(k).set_isEnforced(False)
        self.state = self.model.initSystem()
        self.coordinates = [
            self.model.getCoordinateSet().get(name) for name in model.coordinate_names
        ]
        self.paths = [
            self.model.getMuscles().get(name).getGeometryPath() for name in model.muscle_names
        ]
        for one in self.coordinates:
            one.setLocked(self.state, False)

    def place(self, values: np.ndarray) -> None:
        for one, value in zip(self.coordinates, values, strict=True):
            one.setValue(self.state, float(value), False)
        self.model.realizePosition(self.state)

    def lengths(self) -> np.ndarray:
        return np.array([path.getLength(self.state) for path in self.paths])

    def arms(self, paths: Paths) -> list[float]:
        """Moment arms of the pairs of our paths [m]."""
        return [
            self.paths[m].computeMomentArm(self.state, self.coordinates[j])
            for m, j in zip(paths.arm_muscle, paths.arm_coordinate, strict=True)
        ]

    def rates(self, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rates of the coordinates and lengthening speeds at the speeds u."""
        for one, speed in zip(self.coordinates, speeds, strict=True):
            one.setSpeedValue(self.state, float(speed))
        self.model.realizeVelocity(self.state)
        rates = [one.getQDotValue(self.state) for one in self.coordinates]
        return np.array(rates), np.array(
            [path.getLengtheningSpeed(self.state) for path in self.paths]
        )


def _against_opensim(
    file: Path, model: mm.Model, paths: Paths, motion: mm.Motion, ours: MuscleKinematics
) -> dict[str, object]:
    theirs = _Theirs(file, model)
    values = paths.tree.coordinates_of(motion)
    speeds = _consistent_speeds(paths, values, motion)
    shape = ours.muscle_length.shape
    found = _Differences(
        lengths=np.zeros(shape),
        speeds=np.zeros(shape),
        arms=np.zeros((len(motion), len(paths.arm_muscle))),
    )
    for f, row in enumerate(values):
        theirs.place(row)
        began = time.perf_counter()
        lengths = theirs.lengths()
        arms = theirs.arms(paths)
        found.seconds += time.perf_counter() - began
        found.lengths[f] = np.abs(ours.muscle_length[f] - lengths)
        # Couplers do not occur together with joints whose speeds are not rates.
        change = np.eye(len(row))
        if not model.couplers:
            change = np.column_stack([theirs.rates(_unit(model, j))[0] for j in range(len(row))])
        table = ours.dense(slice(f, f + 1))[0] @ change
        found.arms[f] = np.abs(table[paths.arm_muscle, paths.arm_coordinate] - arms)
        qdot, rates = theirs.rates(speeds[f])
        found.speeds[f] = np.abs(paths.evaluate(row[None], qdot[None])[1][0] - rates)
        _decide(found, theirs, paths, _at(motion, f, row), _Arms(f, table, np.array(arms), change))
    return _row(found, 1e3 * found.seconds / len(motion), model, paths) | {
        "compared with": "OpenSim"
    }


class _Arms(NamedTuple):
    """Moment arms in a frame.

    Attributes
    ----------
    frame : number
    ours : (muscles, coordinates) about OpenSim's speeds [m]
    theirs : (pairs,) of OpenSim [m]
    change : (coordinates, coordinates) rates of the coordinates per OpenSim's speed
    """

    frame: int
    ours: np.ndarray
    theirs: np.ndarray
    change: np.ndarray


def _decide(
    found: _Differences, theirs: _Theirs, paths: Paths, pose: mm.Motion, arms: _Arms
) -> None:
    """Count moment arms that differ, and those that fit OpenSim's own lengths better than its own.

    The latter do not count as differences.
    """
    frame = arms.frame
    row = pose.values[0]
    for k in np.flatnonzero(found.arms[frame] > SAME):
        m = paths.arm_muscle[k]
        j = paths.arm_coordinate[k]
        ends = []
        for side in (-1.0, 1.0):
            moved = replace(pose, values=(row + side * STEP * arms.change[:, j])[None])
            theirs.place(paths.tree.coordinates_of(moved)[0])
            ends.append(theirs.paths[m].getLength(theirs.state))
        slope = -(ends[1] - ends[0]) / (2.0 * STEP)
        found.beyond += 1
        if abs(arms.ours[m, j] - slope) < abs(arms.theirs[k] - slope):
            found.ours_nearer += 1
            found.arms[frame, k] = np.nan


def _at(motion: mm.Motion, frame: int, values: np.ndarray) -> mm.Motion:
    return mm.Motion(motion.time[frame : frame + 1], motion.names, values[None])


def _consistent_speeds(paths: Paths, values: np.ndarray, motion: mm.Motion) -> np.ndarray:
    """Return the motion's speeds, those of dependent coordinates as their couplers give them."""
    from myomorph.core.rigid.coordinates import couple_rates_frames

    speeds = np.array(motion.velocities)
    couple_rates_frames(
        paths.tree.arrays, np.ascontiguousarray(values), speeds, np.zeros_like(speeds)
    )
    return speeds


def _row(found: _Differences, took: float, model: mm.Model, paths: Paths) -> dict[str, object]:
    known = np.nan_to_num(found.arms)
    worst = int(known.max(axis=0).argmax())
    name = (
        f"{model.muscle_names[paths.arm_muscle[worst]]} about"
        f" {model.coordinate_names[paths.arm_coordinate[worst]]}"
    )
    return {
        "length max [mm]": MILLIMETERS * float(found.lengths.max()),
        "length 99 % [mm]": MILLIMETERS * float(np.percentile(found.lengths, 99)),
        "speed max [mm/s]": MILLIMETERS * float(found.speeds.max()),
        "moment arm max [mm]": MILLIMETERS * float(known.max()),
        "moment arm 99 % [mm]": MILLIMETERS * float(np.nanpercentile(found.arms, 99)),
        "moment arms off by 0.1 mm": found.beyond,
        "of these, ours nearer to OpenSim's own slope": found.ours_nearer,
        "worst": name,
        "OpenSim [ms/frame]": took,
    }
