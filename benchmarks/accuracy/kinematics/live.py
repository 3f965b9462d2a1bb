"""Live results against non-causal processing, and jumps where markers are lost and found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.errors import rms_known
from myomorph.core.model.arrays import Array
from myomorph.core.motion.online import OnlineKinematics, SteadyKinematics
from myomorph.core.motion.sync import cut
from myomorph.core.tension.tension import Tension
from myomorph.lab.study.inputs.external_forces import force_table
from myomorph.live.chain import SOLVED, ChainFrame, ChainOptions, LiveChain
from myomorph.live.loop import follow
from myomorph.live.sources import Replay, open_recording

Row = dict[str, object]

RAJAGOPAL = "rajagopal-walk-emg"
HAMNER = "hamner-run-subject04"
CUTOFFS = (6.0, 10.0, 15.0)
AHEAD = 6.0
"""Cutoff of non-causal processing, in a walk [Hz]; twice that in a run."""
LOSSES = 60
HIDDEN = 15
SEED = 7
"""How often markers are hidden, and for how many frames."""


class _Kept:
    """An output that remembers."""

    def __init__(self) -> None:
        self.frames: list[ChainFrame] = []

    def put(self, frame: ChainFrame, markers: Array) -> None:
        self.frames.append(frame)

    def close(self) -> None:
        """Nothing."""


def recordings(folder: Path) -> Iterator[tuple[str, mm.Model, mm.Markers, mm.Wrenches]]:
    """Yield a walk with a plate under every step, and two treadmill runs with the generic model."""
    walk = folder / RAJAGOPAL
    model = mm.read_model(walk / "subject_walk_scaled.osim")
    markers, wrenches = open_recording(model, walk / "markers_walk.trc", walk / "grf_walk.xml")
    assert isinstance(markers, mm.Markers)
    assert wrenches is not None
    yield "walk", model, cut(markers, 0.3, 1.8), wrenches
    model = mm.read_model(folder / HAMNER / "unscaled_generic.osim")
    bodies = {"R_ground_force_": "calcn_r", "L_ground_force_": "calcn_l"}
    for name, speed in (("run200", "run, 2 m/s"), ("run500", "run, 5 m/s")):
        markers, _ = open_recording(model, folder / HAMNER / name / "markers.trc", None)
        assert isinstance(markers, mm.Markers)
        wrenches = force_table(folder / HAMNER / name / "grf.mot", bodies)
        start = max(markers.time[0], wrenches.time[0])
        end = min(markers.time[-1], wrenches.time[-1])
        yield speed, model, cut(markers, start, end), wrenches


@dataclass(frozen=True, kw_only=True, eq=False)
class _Ahead:
    """A recording by zero-lag filters.

    Attributes
    ----------
    name : of the recording
    cutoff : of the filters [Hz]
    motion : with derivatives
    torques : by inverse dynamics
    tension : of the muscles
    turning : coordinates that are rotations and not locked
    joints : those of them that are not the pelvis's
    """

    name: str
    cutoff: float
    motion: mm.Motion
    torques: mm.Series
    tension: Tension
    turning: Sequence[int]
    joints: Sequence[int]


def measure(folder: Path) -> Iterator[Row]:
    """Angles, torques and activations by live cutoffs, compared with zero-lag filters."""
    for name, model, markers, wrenches in recordings(folder):
        ahead = _ahead(name, model, markers, wrenches)
        for cutoff in CUTOFFS:
            source = Replay(markers, wrenches, 0.0)
            kept = _Kept()
            chain = LiveChain(model, source, ChainOptions(cutoff=cutoff))
            follow(chain, source, [kept])
            solved = [one for one in kept.frames if one.state == SOLVED]
            yield _compared(ahead, cutoff, chain.filter.delay, solved)


def _ahead(name: str, model: mm.Model, markers: mm.Markers, wrenches: mm.Wrenches) -> _Ahead:
    cutoff = AHEAD if name == "walk" else 2.0 * AHEAD
    motion = mm.differentiate(mm.inverse_kinematics(model, markers).motion, cutoff)
    torques = mm.inverse_dynamics(
        model, motion, mm.resample_wrenches(wrenches, motion.time, cutoff)
    )
    turning = [
        j
        for j, one in enumerate(model.coordinates)
        if one.motion == "rotational" and not one.locked
    ]
    return _Ahead(
        name=name,
        cutoff=cutoff,
        motion=motion,
        torques=torques,
        tension=mm.solve_tension(model, motion, torques),
        turning=turning,
        joints=[j for j in turning if not model.coordinates[j].name.startswith("pelvis")],
    )


def _compared(ahead: _Ahead, cutoff: float, delay: float, solved: Sequence[ChainFrame]) -> Row:
    """Compare live frames with the zero-lag filters at the times that they are of."""
    then = np.array([one.time for one in solved]) - delay
    motion = ahead.motion
    angles = np.array([one.coordinates for one in solved])[:, ahead.turning]
    angle = angles - _at(motion, motion.values, then)[:, ahead.turning]
    torques = np.array([one.torques for one in solved])[:, ahead.joints]
    torque = torques - _at(motion, ahead.torques.values, then)[:, ahead.joints]
    activations = np.array([one.tension.activations for one in solved])
    activation = activations - _at(motion, ahead.tension.activation, then)
    return {
        "recording": ahead.name,
        "live cutoff [Hz]": cutoff,
        "delay [ms]": 1e3 * delay,
        "ahead cutoff [Hz]": ahead.cutoff,
        "angles: rms [deg]": np.rad2deg(rms_known(angle)),
        "largest [deg]": np.rad2deg(np.abs(angle).max()),
        "joint torques: rms [N m]": rms_known(torque),
        "largest [N m]": float(np.abs(torque).max()),
        "peak torque [N m]": float(np.abs(ahead.torques.values[:, ahead.joints]).max()),
        "activations: rms": rms_known(activation),
    }


def _at(motion: mm.Motion, values: Array, time: Array) -> Array:
    return np.stack([np.interp(time, motion.time, column) for column in values.T], axis=1)


def measure_losses(folder: Path) -> Iterator[Row]:
    """Measure how far coordinates jump when markers are hidden and come back.

    One to three markers are hidden at random for a while.
    """
    for name, model, markers, _ in recordings(folder):
        random = np.random.default_rng(SEED)
        known = np.flatnonzero([one in model.marker_names for one in markers.names])
        jumps: dict[str, list[float]] = {"plain": [], "steady": []}
        back: list[float] = []
        free = _followed(SteadyKinematics(model, markers.names), markers, markers.values)
        turning = [j for j, one in enumerate(model.coordinates) if one.motion == "rotational"]
        for _ in range(LOSSES):
            lost = random.choice(known, random.integers(1, 4), replace=False)
            start = int(random.integers(10, len(markers) - 2 * HIDDEN - 5))
            values = np.array(markers.values)
            values[start : start + HIDDEN, lost] = np.nan
            plain = _plain(OnlineKinematics(model, markers.names), markers, values)
            steady = _followed(SteadyKinematics(model, markers.names), markers, values)
            for way, series in (("plain", plain), ("steady", steady)):
                for event in (start, start + HIDDEN):
                    jumps[way].append(
                        _bend(series[:, turning], event) - _bend(free[:, turning], event)
                    )
            ends = start + HIDDEN + 20
            if ends < len(markers):
                back.append(float(np.abs(steady - free)[ends][turning].max()))
        for way, found in jumps.items():
            degrees = np.rad2deg(np.maximum(found, 0.0))
            yield {
                "recording": name,
                "inverse kinematics": way,
                "events": len(degrees),
                "jump: median [deg]": float(np.median(degrees)),
                "95 % [deg]": float(np.percentile(degrees, 95)),
                "largest [deg]": float(degrees.max()),
                "left after 0.2 s [deg]": (
                    float(np.rad2deg(np.median(back))) if way == "steady" else "-"
                ),
            }


def _followed(kinematics: SteadyKinematics, markers: mm.Markers, values: Array) -> Array:
    pairs = zip(markers.time.tolist(), values, strict=True)
    return np.array([kinematics.solve(time, row).coordinates for time, row in pairs])


def _plain(kinematics: OnlineKinematics, markers: mm.Markers, values: Array) -> Array:
    return np.array(
        [
            kinematics.solve(time, row)[0]
            for time, row in zip(markers.time.tolist(), values, strict=True)
        ]
    )


def _bend(values: Array, frame: int) -> float:
    """Largest second difference that ends in a frame: a jump shows, a steady motion hardly does."""
    return float(np.abs(values[frame] - 2.0 * values[frame - 1] + values[frame - 2]).max())
