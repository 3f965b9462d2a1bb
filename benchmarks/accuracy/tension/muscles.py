"""Muscle lengths, lengthening velocities and moment arms against OpenSim.

They are on recorded motions and random poses. OpenSim's moment arms are about its speeds u; ours,
about q, are carried over by qdot = N u. Where one still differs, a finite difference of OpenSim's
own length along u decides whose it fits better.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

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
    return _row(np.full(1, np.nan), np.full(1, np.nan), differences, 0, 0, np.nan, model, paths) | {
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
    pairs = list(zip(paths.arm_muscle, paths.arm_coordinate, strict=True))
    lengths = np.zeros(ours.muscle_length.shape)
    rates = np.zeros(ours.muscle_length.shape)
    arms = np.zeros((len(motion), len(pairs)))
    beyond = 0
    ours_nearer = 0
    seconds = 0.0
    for f, row in enumerate(values):
        theirs.place(row)
        began = time.perf_counter()
        expected = theirs.lengths()
        expected_arms = [
            theirs.paths[m].computeMomentArm(theirs.state, theirs.coordinates[j]) for m, j in pairs
        ]
        seconds += time.perf_counter() - began
        lengths[f] = np.abs(ours.muscle_length[f] - expected)
        # Couplers do not occur together with joints whose speeds are not rates.
        change = np.eye(len(row))
        if not model.couplers:
            change = np.column_stack([theirs.rates(_unit(model, j))[0] for j in range(len(row))])
        table = ours.dense(slice(f, f + 1))[0] @ change
        arms[f] = np.abs(table[paths.arm_muscle, paths.arm_coordinate] - expected_arms)
        qdot, expected_rates = theirs.rates(speeds[f])
        rates[f] = np.abs(paths.evaluate(row[None], qdot[None])[1][0] - expected_rates)
        for k in np.flatnonzero(arms[f] > SAME):
            m, j = pairs[k]
            ends = []
            for side in (-1.0, 1.0):
                theirs.place(
                    paths.tree.coordinates_of(_at(motion, f, row + side * STEP * change[:, j]))[0]
                )
                ends.append(theirs.paths[m].getLength(theirs.state))
            slope = -(ends[1] - ends[0]) / (2.0 * STEP)
            beyond += 1
            if abs(table[m, j] - slope) < abs(expected_arms[k] - slope):
                ours_nearer += 1
                arms[f, k] = np.nan
    took = 1e3 * seconds / len(motion)
    return _row(lengths, rates, arms, beyond, ours_nearer, took, model, paths) | {
        "compared with": "OpenSim"
    }


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


def _row(
    lengths: np.ndarray,
    speeds: np.ndarray,
    arms: np.ndarray,
    beyond: int,
    ours_nearer: int,
    took: float,
    model: mm.Model,
    paths: Paths,
) -> dict[str, object]:
    known = np.nan_to_num(arms)
    worst = int(known.max(axis=0).argmax())
    name = (
        f"{model.muscle_names[paths.arm_muscle[worst]]} about"
        f" {model.coordinate_names[paths.arm_coordinate[worst]]}"
    )
    return {
        "length max [mm]": MILLIMETERS * float(lengths.max()),
        "length 99 % [mm]": MILLIMETERS * float(np.percentile(lengths, 99)),
        "speed max [mm/s]": MILLIMETERS * float(speeds.max()),
        "moment arm max [mm]": MILLIMETERS * float(known.max()),
        "moment arm 99 % [mm]": MILLIMETERS * float(np.nanpercentile(arms, 99)),
        "moment arms off by 0.1 mm": beyond,
        "of these, ours nearer to OpenSim's own slope": ours_nearer,
        "worst": name,
        "OpenSim [ms/frame]": took,
    }
