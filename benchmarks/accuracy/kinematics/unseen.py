"""Bodies whose trunk, arms and head no marker shows.

Full-body recordings without these markers, against themselves with all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks import hands_lift
from benchmarks.recordings import RECORDINGS, read_markers
from benchmarks.results import Row
from myomorph.core.fit.interval_rule import drawn_limits
from myomorph.core.model.arrays import Array
from myomorph.core.model.segments import segments_if_human
from myomorph.core.model.spatial import vector_from_rotation
from myomorph.core.motion.ik import InverseKinematicsOptions, KinematicsFit
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.motion.upright import forward_axis
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.uncertainty.drawn_inputs import drawn_unseen

UPPER = ("head", "upper_trunk", "upper_arm", "lower_arm", "hand")
PLAIN = InverseKinematicsOptions(untracked_coordinates="default")
"""As before: every hidden joint at its default, so that the trunk is fixed to the pelvis."""
RATE = 100.0  # Of motions that somebody else found, at most [Hz]
MAX_FRAMES = 1000
EDGE = 10  # Frames at both ends that are not judged
DRAWS = 40
WITHIN = 1.645  # Standard deviations of the half of a 90 % interval


@dataclass(frozen=True, kw_only=True)
class Case:
    """A full-body recording.

    `title`: of it; `recording`: of `RECORDINGS`, or a lift of `hands_lift`; `cutoff`: of the filter
    [Hz]; `flexed`: by so much more the trunk is flexed, in simulated markers [rad].
    """

    title: str
    recording: str
    cutoff: float = 6.0
    flexed: float = 0.0


CASES = (
    Case(title="walk, Rajagopal", recording="rajagopal"),
    Case(title="walk, gait2354", recording="gait2354"),
    Case(title="walk, OpenCap", recording="opencap-walk"),
    Case(title="walk, implant 1", recording="implant-1"),
    Case(title="walk, implant 3", recording="implant-3"),
    Case(title="walk, treadmill", recording="treadmill"),
    Case(title="walk, gait2392", recording="gait2392"),
    Case(title="walk, Lenhart", recording="lenhart"),
    Case(title="run, 2 m/s", recording="run-2", cutoff=12.0),
    Case(title="run, 5 m/s", recording="run-5", cutoff=15.0),
    Case(title="drop jump", recording="opencap-jump", cutoff=12.0),
    Case(title="sit to stand", recording="opencap-rise"),
    Case(title="stoop lift", recording="stoop1"),
    Case(title="walk, trunk flexed by 35 degrees more", recording="rajagopal", flexed=0.61),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracked:
    """Inverse kinematics of a recording.

    `full`: of all markers; `fixed`, `upright`: without those of the upper body, with the trunk
    fixed to the pelvis and upright.
    """

    model: mm.Model
    full: KinematicsFit
    fixed: KinematicsFit
    upright: KinematicsFit


@lru_cache(maxsize=len(CASES))
def tracked(folder: Path, case: Case) -> Tracked:
    """Inverse kinematics of a case."""
    model, markers = _recorded(folder, case)
    segments = segments_if_human(model)
    upper = {one.name for one in model.markers if segments[one.body].name in UPPER}
    lower = markers.columns([i for i, name in enumerate(markers.names) if name not in upper])
    return Tracked(
        model=model,
        full=mm.inverse_kinematics(model, markers, PLAIN),
        fixed=mm.inverse_kinematics(model, lower, PLAIN),
        upright=mm.inverse_kinematics(model, lower),
    )


def _recorded(folder: Path, case: Case) -> tuple[mm.Model, mm.Markers]:
    """Model and markers of a case: recorded, or the model's own on a motion."""
    if case.recording in hands_lift.LIFTS:
        lifter = hands_lift.lifter(folder).model
        return lifter, hands_lift.recorded(folder, case.recording).markers
    files = RECORDINGS[case.recording]
    model = mm.read_model(folder / files.model)
    if files.markers and not case.flexed:
        return model, read_markers(folder / files.markers)
    motion = mm.read_motion(folder / files.motion, model)
    span = float(motion.time[-1] - motion.time[0])
    step = max(1, round((len(motion) - 1) / span / RATE))
    motion = motion.frames(slice(0, step * MAX_FRAMES, step))
    values = np.array(motion.values)
    if case.flexed:
        values[:, motion.names.index("lumbar_extension")] -= case.flexed
    return model, mm.marker_positions(model, replace(motion, values=values))


def measure_posture(folder: Path) -> Iterator[Row]:
    """Yield a row a recording: how far the assumed trunk is from the one that markers show."""
    for case in CASES:
        found = tracked(folder, case)
        fixed = _leaning(found.model, found.full, found.fixed)
        upright = _leaning(found.model, found.full, found.upright)
        sizes = _trunk_sizes(found.upright)
        inside = np.abs(upright) <= WITHIN * sizes
        row: Row = {
            "recording": case.title,
            "fixed to the pelvis [deg]": np.degrees(_rms(fixed)),
            "upright [deg]": np.degrees(_rms(upright)),
        }
        for index, way in enumerate(("ahead", "aside", "about the vertical")):
            row[f"{way}, lasting [deg]"] = np.degrees(upright[:, index].mean())
            row[f"{way}, changing [deg]"] = np.degrees(upright[:, index].std())
        yield row | {"inside 90 % [%]": 100.0 * inside.mean()}


def _leaning(model: mm.Model, full: KinematicsFit, other: KinematicsFit) -> Array:
    """Rotation of the trunk from an assumed orientation to that of all markers.

    Returns
    -------
    (frames, 3) ahead, aside and about the vertical [rad]
    """
    tree = compile_tree(model)
    segments = segments_if_human(model)
    trunks = [body for body in model.bodies if segments[body.name].name == "upper_trunk"]
    trunk = tree.body_index[max(trunks, key=lambda body: body.mass).name]
    known = full.seen & other.seen
    true = forward_kinematics(tree, full.motion.values[known]).rotations[:, trunk]
    assumed = forward_kinematics(tree, other.motion.values[known]).rotations[:, trunk]
    ahead = forward_axis(tree, model.up)
    axes = np.stack([np.cross(model.up, ahead), ahead, model.up])
    return np.asarray(vector_from_rotation(true @ np.swapaxes(assumed, 1, 2)) @ axes.T)


def _trunk_sizes(fit: KinematicsFit) -> Array:
    """Stack the standard deviations (frames, 3) of an upright trunk [rad]."""
    trunk = [mode for mode in fit.modes if mode.name.startswith("upper_trunk")]
    sizes = [np.hypot(mode.lasting, mode.changing) for mode in trunk]
    return np.column_stack(sizes)[fit.seen]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(np.sum(np.atleast_2d(values.T) ** 2, axis=0))))


def measure_forces(folder: Path) -> Iterator[Row]:
    """Yield a row a recording: forces and torques beside those of all markers.

    External forces are the same for both, so they do not count.
    """
    for case in CASES:
        found = tracked(folder, case)
        torques = _torques_of(found.model, case.cutoff)
        true = torques(found.full.motion)
        fixed = torques(found.fixed.motion)
        upright = torques(found.upright.motion)
        limits = _limits(found.upright, torques)
        row: Row = {"recording": case.title}
        for part, columns in _parts(found.model).items():
            for name, assumed in (("fixed to the pelvis", fixed), ("upright", upright)):
                row[f"{part}, {name}"] = _rms((assumed - true)[EDGE:-EDGE, columns])
        for part in ("force on the pelvis [N]", "low back [N m]"):
            columns = _parts(found.model)[part]
            inside = (true >= limits[0]) & (true <= limits[1])
            known = np.isfinite(true[:, columns])
            row[f"{part.split(' [')[0]}, inside 90 % [%]"] = (
                100.0 * inside[:, columns][known].mean()
            )
        yield row


def _parts(model: mm.Model) -> dict[str, list[int]]:
    """Columns of torques by what they are of."""
    floating = floating_coordinates(model)
    sliding = [name for name in floating if model.coordinate(name).motion == "translational"]

    def beginning(*words: str) -> list[str]:
        return [name for name in model.coordinate_names if name.startswith(words)]

    parts = {
        "force on the pelvis [N]": sliding,
        "low back [N m]": beginning("lumbar"),
        "hips [N m]": beginning("hip"),
        "knees [N m]": beginning("knee_angle_r", "knee_angle_l", "knee_flex"),
    }
    return {
        part: [model.coordinate_names.index(name) for name in names if "beta" not in name]
        for part, names in parts.items()
    }


def _torques_of(model: mm.Model, cutoff: float) -> Callable[[mm.Motion], Array]:
    """Inverse dynamics without external forces, (frames, coordinates) [N m or N]."""

    def torques(motion: mm.Motion) -> Array:
        return np.asarray(mm.inverse_dynamics(model, mm.differentiate(motion, cutoff)).values)

    return torques


def _limits(fit: KinematicsFit, torques: Callable[[mm.Motion], Array]) -> tuple[Array, Array]:
    """Limits (frames, coordinates) of 90 % of the draws of what is assumed."""
    normals = mm.uncertainty.Normals(DRAWS)
    drawn = []
    for number in range(DRAWS):
        draw = mm.uncertainty.Draw(number, mm.uncertainty.Sources(), normals)
        errors = drawn_unseen(fit.modes, fit.motion.time, draw)
        drawn.append(torques(replace(fit.motion, values=fit.motion.values + errors)))
    return drawn_limits(np.array(drawn))


GAPS = (0.1, 0.2, 0.4)
"""Durations for which markers are hidden [s]."""
HIDDEN = {
    "one marker of each thigh": ("thigh",),
    "a shank and its foot": ("shank", "foot"),
    "trunk, arms and head": UPPER,
}
GAPS_EACH = 4  # Gaps in a recording
GAPS_IN = ("opencap-rise", "run-2", "lenhart", "implant-1")
MOVING = 0.02  # Standard deviation of an angle that counts [rad]


def measure_gaps(folder: Path) -> Iterator[Row]:
    """Yield a row for what is hidden for how long: errors of acceleration over the own ones."""
    cases = [case for case in CASES if case.recording in GAPS_IN]
    for what, segments in HIDDEN.items():
        for duration in GAPS:
            parts = [_gap_errors(folder, case, segments, duration) for case in cases]
            default, bridged, inside = np.array(parts).T
            row: Row = {
                "hidden": what,
                "for [s]": duration,
                "error of acceleration, default pose": default.mean(),
                "error of acceleration, bridged": bridged.mean(),
            }
            known = inside[np.isfinite(inside)]
            yield row | {"inside 90 % [%]": 100.0 * known.mean() if len(known) else ""}


def _gap_errors(
    folder: Path, case: Case, hidden: tuple[str, ...], duration: float
) -> tuple[float, float, float]:
    """Errors of accelerations while markers are hidden, over the accelerations' own size.

    Returns
    -------
    root mean squares over all joints that move, within the gaps and beside them, with the default
    pose and bridged; share of assumed values inside their 90 % interval, NaN without any
    """
    model, markers = _recorded(folder, case)
    gaps = _gaps(markers.time, duration)
    values = np.array(markers.values)
    values[np.ix_(gaps, _columns(model, markers, hidden))] = np.nan
    shown = replace(markers, values=values)
    whole = mm.inverse_kinematics(model, markers, PLAIN).motion
    joints = _moving(model, whole)
    true = mm.differentiate(whole, case.cutoff).accelerations
    assert true is not None
    own = np.nanstd(true[:, joints], axis=0)
    beside = np.convolve(gaps, np.ones(2 * EDGE + 1), "same") > 0
    fit = mm.inverse_kinematics(model, shown)

    def error(motion: mm.Motion) -> float:
        found = mm.differentiate(motion, case.cutoff).accelerations
        assert found is not None
        return float(np.sqrt(np.nanmean(((found - true)[:, joints][beside] / own) ** 2)))

    inside = float("nan")
    assumed = np.zeros(whole.values.shape, bool)
    if fit.assumed_sd is not None:
        bridged = np.array([how == "bridged" for how in fit.assumed_as])
        assumed = (fit.assumed_sd > 0.0) & bridged
    if assumed.any() and fit.assumed_sd is not None:
        away = np.abs(fit.motion.values - whole.values)
        inside = float((away <= WITHIN * fit.assumed_sd)[assumed].mean())
    return error(mm.inverse_kinematics(model, shown, PLAIN).motion), error(fit.motion), inside


def _gaps(time: Array, duration: float) -> np.ndarray:
    """Flag the frames (frames,) of gaps spread evenly over a recording."""
    gaps = np.zeros(len(time), bool)
    for middle in np.linspace(time[0], time[-1], GAPS_EACH + 2)[1:-1]:
        gaps |= np.abs(time - middle) < 0.5 * duration
    return gaps


def _columns(model: mm.Model, markers: mm.Markers, hidden: tuple[str, ...]) -> list[int]:
    """Markers that are hidden: of one side's segments, of a thigh one on each."""
    segments = segments_if_human(model)
    chosen: dict[str, str] = {}
    for marker in model.markers:
        segment = segments[marker.body]
        if segment.name not in hidden or marker.name not in markers.names:
            continue
        if hidden == ("thigh",):
            chosen.setdefault(segment.side, marker.name)
        elif segment.side != "left" or hidden == UPPER:
            chosen[marker.name] = marker.name
    return [markers.names.index(name) for name in chosen.values()]


def _moving(model: mm.Model, motion: mm.Motion) -> np.ndarray:
    """Angles of joints that move."""
    turning = [coordinate.motion == "rotational" for coordinate in model.coordinates]
    return np.flatnonzero(np.array(turning) & (np.nanstd(motion.values, axis=0) > MOVING))
