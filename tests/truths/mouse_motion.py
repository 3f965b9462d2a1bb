"""What the recordings of mice give.

A model of each animal, its motion, strides and muscle lengths, and its paw alone. Everything is
computed once a process; sections of the validation and the figure share it.
"""

from __future__ import annotations

import re
import time
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import myomorph as mm
from myomorph.body.calibrate.calibration import Calibration
from myomorph.core.contact.plates import wrenches_from_plates
from myomorph.core.io.mjcf.read import read_mjcf
from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.scale import scale
from myomorph.core.motion.crossings import crossings, within_crossings
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.motion.measurements import default_markers, place_markers
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.surfaces.linear_maps import procrustes
from myomorph.core.tension.tension import Tension
from myomorph.lab.analysis.length_analysis import LengthAnalysis, length_analysis
from myomorph.lab.analysis.strides import Strides
from myomorph.lab.analysis.walking import walking_strides
from truths.mouse_recordings import (
    GAIT_LABELS,
    LOOSE,
    SKELETON,
    TREADMILL,
    TREADMILL_LABELS,
    both_hindlimbs,
    clips,
    gait_files,
    recording,
)

CUTOFF = 20.0
"""Low-pass of motion and forces, about five times the frequency of strides [Hz]."""

BELT = 0.25
"""15 m/min [m/s]."""

PAW = 0.015
"""A center of pressure so near to the toes' joint of the table's mouse is under the paw [m]."""

SHOULDERS = ((0.045, 0.0, 0.01), (0.045, 0.0, -0.01))
"""From the middle between the hips to about the shoulders, under which the forepaws are, on the
table's mouse [m].
"""

TRACKING = mm.InverseKinematicsOptions(marker_weights=LOOSE)
UNDERDETERMINED = mm.InverseKinematicsOptions(posture_weight=1e-3)
"""34 points cannot show 229 coordinates: a pull towards the default pose, a thousandth of theirs,
spreads what they leave open evenly over the vertebrae.
"""


@dataclass(frozen=True, eq=False)
class Mouse:
    """One recording of one animal.

    Attributes
    ----------
    trial : with the model's names, in its ground
    used : its markers, hidden outside of the crossings
    spans : the crossings [s]
    calibration : of the generic model to all crossings
    generic, fit : inverse kinematics of the generic and of the calibrated model
    seconds : that inverse kinematics of the calibrated model took [s]
    """

    name: str
    trial: mm.Trial
    used: mm.Markers
    spans: tuple[tuple[float, float], ...]
    calibration: Calibration
    generic: KinematicsFit
    fit: KinematicsFit
    seconds: float

    @property
    def model(self) -> mm.Model:
        """Of this animal."""
        return self.calibration.model

    @property
    def shown(self) -> NDArray[np.bool_]:
        """(frames,) in which any marker is used."""
        return np.asarray(np.isfinite(self.fit.marker_error).any(axis=1))


def names(folder: Path) -> tuple[str, ...]:
    """Return the names of recordings of markers that exist."""
    found = [path.stem.split("_trial")[0].removeprefix("Cage6_") for path in gait_files(folder)]
    return (*found, *(("treadmill",) if (folder / TREADMILL).is_file() else ()))


@lru_cache(maxsize=8)
def mouse(folder: Path, name: str) -> Mouse:
    """Run a recording through calibration and inverse kinematics."""
    belt = name == "treadmill"
    generic = both_hindlimbs(folder, back=belt)
    path = (
        folder / TREADMILL
        if belt
        else next(one for one in gait_files(folder) if f"_{name}_" in one.stem)
    )
    trial = recording(path, generic, TREADMILL_LABELS if belt else GAIT_LABELS)
    assert trial.markers is not None
    spans = crossings(trial.markers, generic)
    used = within_crossings(trial.markers, spans)
    calibration = mm.calibrate(
        generic,
        [used],
        mm.CalibrationOptions(marker_weights=LOOSE),
        path_lengths=default_path_lengths,
    )
    mm.inverse_kinematics(calibration.model, used, TRACKING)
    began = time.perf_counter()
    fit = mm.inverse_kinematics(calibration.model, used, TRACKING)
    seconds = time.perf_counter() - began
    return Mouse(
        name=name,
        trial=trial,
        used=used,
        spans=spans,
        calibration=calibration,
        generic=mm.inverse_kinematics(generic, used, TRACKING),
        fit=fit,
        seconds=seconds,
    )


def held_out(folder: Path, name: str) -> float:
    """Return the root mean square marker error of the later half of the frames [m].

    The model is made from the earlier half.
    """
    one = mouse(folder, name)
    frames = np.flatnonzero(one.shown)
    middle = frames[len(frames) // 2]
    earlier = one.used.values.copy()
    later = one.used.values.copy()
    earlier[middle:] = np.nan
    later[:middle] = np.nan
    made = mm.calibrate(
        both_hindlimbs(folder, back=name == "treadmill"),
        [replace(one.used, values=earlier)],
        mm.CalibrationOptions(marker_weights=LOOSE),
    )
    return rms(mm.inverse_kinematics(made.model, replace(one.used, values=later), TRACKING))


def rms(fit: KinematicsFit, leave_out: tuple[str, ...] = ()) -> float:
    """Root mean square of all marker errors [m]."""
    kept = [k for k, name in enumerate(fit.marker_names) if name not in leave_out]
    return float(np.sqrt(np.nanmean(fit.marker_error[:, kept] ** 2)))


@lru_cache(maxsize=8)
def motion_of(folder: Path, name: str) -> mm.Motion:
    """Return filtered coordinates with derivatives."""
    return mm.differentiate(mouse(folder, name).fit.motion, CUTOFF)


def strides_of(folder: Path, name: str) -> Strides | None:
    """Strides of the hindlimbs; on the treadmill, whose feet carry no marker, told by the knees."""
    one = mouse(folder, name)
    if name != "treadmill":
        return walking_strides(one.model, motion_of(folder, name), one.fit)
    markers = one.trial.markers
    assert markers is not None
    limbs = (mm.Limb("Foot_r", ("Right_Knee",)), mm.Limb("Foot_l", ("Left_Knee",)))
    forward = np.array([1.0, 0.0, 0.0])
    hips = ("Right_Hip", "Left_Hip")
    return mm.find_strides(markers, limbs, hips, one.model.up, direction=forward, ground_speed=BELT)


@lru_cache(maxsize=8)
def lengths_of(folder: Path, name: str) -> LengthAnalysis:
    """Muscle lengths over the strides."""
    strides = strides_of(folder, name)
    assert strides is not None
    return lengths_over(mouse(folder, name).model, motion_of(folder, name), strides)


def lengths_over(model: mm.Model, motion: mm.Motion, strides: Strides) -> LengthAnalysis:
    """Muscle lengths and velocities over strides of a motion whose poses are not all known."""
    known = np.isfinite(motion.values).all(axis=1)
    found = mm.muscle_kinematics(model, part_of(motion, np.flatnonzero(known)), moment_arms=False)
    lengths = np.full((len(motion), len(model.muscles)), np.nan)
    rates = np.full((len(motion), len(model.muscles)), np.nan)
    lengths[known] = found.muscle_length
    rates[known] = found.muscle_velocity
    muscles = model.muscle_names
    return length_analysis(
        model,
        mm.Series(motion.time, muscles, lengths),
        strides,
        mm.Series(motion.time, muscles, rates),
    )


def part_of(motion: mm.Motion, frames: NDArray[np.int64]) -> mm.Motion:
    """Return a motion in some of its frames.

    Parameters
    ----------
    motion : with or without derivatives
    frames : (chosen,) numbers

    Returns
    -------
    Motion of the chosen frames, derivatives included
    """
    rows = (
        None if one is None else one[frames] for one in (motion.velocities, motion.accelerations)
    )
    return mm.Motion(motion.time[frames], motion.names, motion.values[frames], *rows)


@dataclass(frozen=True, eq=False)
class Alone:
    """A hind paw that is all that stands on the plate.

    Attributes
    ----------
    side : "r" or "l"
    frames : of the motion
    wrenches : of the plate on the foot, at the motion's times
    beside : (frames,) horizontal distance of the center of pressure from the toes' joint [m]
    torques : of inverse dynamics (frames, coordinates)
    active, passive : muscle forces without and with the muscles' passive forces
    """

    side: str
    frames: Array
    wrenches: mm.Wrenches
    beside: Array
    torques: mm.Series
    active: Tension
    passive: Tension


def alone(folder: Path, name: str) -> Alone | None:
    """Frames in which by geometry one hind paw is alone on the plate.

    It is over the plate, the other and the shoulders are beyond its edges, and the center of
    pressure is under it. The longest run of loaded frames; the root's residuals are what the
    forelimbs and the rest of the body would explain, and are not looked at.
    """
    one = mouse(folder, name)
    motion = motion_of(folder, name)
    if not one.trial.plates:
        return None
    plate = one.trial.plates[0]
    wrenches = wrenches_from_plates(one.trial.plates, one.trial.plate_time, motion.time)
    toes = {side: place_of(one.model, motion, f"Toes_{side}") for side in "rl"}
    free = _loaded(motion, wrenches) & ~_shoulders_over(one, motion, plate.corners)
    right = _over(plate.corners, toes["r"])
    left = _over(plate.corners, toes["l"])
    near = PAW * one.calibration.size
    runs_of = {
        "r": longest(free & right & ~left & (_apart(wrenches, toes["r"]) < near)),
        "l": longest(free & left & ~right & (_apart(wrenches, toes["l"]) < near)),
    }
    side = max(runs_of, key=lambda each: len(runs_of[each]))
    frames = runs_of[side]
    if not len(frames):
        return None
    part = part_of(motion, frames)
    loads = mm.Wrenches(
        time=part.time,
        names=wrenches.names,
        bodies=(f"Foot_{side}",),
        forces=wrenches.forces[frames],
        points=wrenches.points[frames],
        torques=wrenches.torques[frames],
    )
    torques = mm.inverse_dynamics(one.model, part, loads)
    return Alone(
        side=side,
        frames=frames,
        wrenches=loads,
        beside=_apart(wrenches, toes[side])[frames],
        torques=torques,
        active=mm.solve_tension(one.model, part, torques, mm.TensionOptions(passive=False)),
        passive=mm.solve_tension(one.model, part, torques, mm.TensionOptions(passive=True)),
    )


def _apart(wrenches: mm.Wrenches, place: Array) -> Array:
    """Return the level distance (frames,) of the center of pressure from a place, inf unknown."""
    apart = np.linalg.norm((wrenches.points[:, 0] - place)[:, [0, 2]], axis=1)
    return np.nan_to_num(apart, nan=np.inf)


def _loaded(motion: mm.Motion, wrenches: mm.Wrenches) -> NDArray[np.bool_]:
    """Return the frames with a known pose and at least a tenth of the largest force."""
    known: NDArray[np.bool_] = np.isfinite(motion.values).all(axis=1)
    up = wrenches.forces[:, 0, 1]
    return known & (up > 0.1 * np.nanmax(up[known]))


def _shoulders_over(one: Mouse, motion: mm.Motion, corners: Array) -> NDArray[np.bool_]:
    """Return the frames in which a shoulder is over the plate."""
    over = np.zeros(len(motion), np.bool_)
    for offset in SHOULDERS:
        place = one.calibration.size * np.array(offset)
        over |= _over(corners, place_of(one.model, motion, "Pelvis", place))
    return over


def place_of(model: mm.Model, motion: mm.Motion, body: str, offset: Array | None = None) -> Array:
    """Return a point of a body in ground.

    Parameters
    ----------
    model : with the body
    motion : of the model; frames may be NaN
    body : name
    offset : (3,) of the point in the body's frame [m]; its joint's center by default

    Returns
    -------
    (frames, 3) [m]; NaN where the pose is not known
    """
    tree = compile_tree(model)
    known = np.isfinite(motion.values).all(axis=1)
    values = tree.coordinates_of(
        replace(motion, values=np.where(known[:, None], motion.values, 0.0))
    )
    poses = forward_kinematics(tree, np.ascontiguousarray(values))
    b = tree.body_index[body]
    joint = next(one for one in model.joints if one.child == body)
    own = joint.child_frame.translation if offset is None else offset
    places = poses.origins[:, b] + poses.rotations[:, b] @ own
    places[~known] = np.nan
    return np.asarray(places, np.float64)


def _over(corners: Array, places: Array) -> NDArray[np.bool_]:
    """(frames,) whether a place is over a plate."""
    low = corners.min(axis=0)
    high = corners.max(axis=0)
    inside = (places[:, [0, 2]] >= low[[0, 2]]) & (places[:, [0, 2]] <= high[[0, 2]])
    return np.asarray(inside.all(axis=1))


def longest(state: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the frames of the longest run.

    Parameters
    ----------
    state : (frames,) whether a frame counts

    Returns
    -------
    (run,) frame numbers
    """
    start, stop = max(runs(state), key=lambda span: span[1] - span[0], default=(0, 0))
    return np.arange(start, stop)


@dataclass(frozen=True, eq=False)
class Clip:
    """A clip of keypoints on the whole skeleton.

    Errors are before and after its points were put where they lie [m].
    """

    model: mm.Model
    fit: KinematicsFit
    size: float
    first: float
    placed: float
    other: float
    seconds: float
    frames: int


def clip_fits(folder: Path, generic: mm.Model, count: int = 3) -> list[Clip]:
    """Clips through size, inverse kinematics and the places of their points, three rounds in turn.

    `other` is the error of the next clip (the first for the last) on the model that this one made.
    """
    every = clips(folder, generic, count)
    own = default_markers(generic, every[0].names)
    size = float(
        np.median(
            [procrustes(own, frame, scale=True).scale for clip in every for frame in clip.values]
        )
    )
    made = []
    found = []
    for clip in every:
        model = scale(generic, {body: np.full(3, size) for body in generic.body_names})
        fit = mm.inverse_kinematics(model, clip, UNDERDETERMINED)
        first = rms(fit)
        for _ in range(3):
            bodies = {one.name: one.body for one in model.markers}
            model = model.with_markers(place_markers(model, fit.motion, clip, bodies))
            began = time.perf_counter()
            fit = mm.inverse_kinematics(model, clip, UNDERDETERMINED)
            seconds = time.perf_counter() - began
        made.append(model)
        found.append(
            Clip(
                model=model,
                fit=fit,
                size=size,
                first=first,
                placed=rms(fit),
                other=float("nan"),
                seconds=seconds,
                frames=len(clip),
            )
        )
    return [
        replace(
            one,
            other=rms(mm.inverse_kinematics(model, every[(k + 1) % len(every)], UNDERDETERMINED)),
        )
        for k, (one, model) in enumerate(zip(found, made, strict=True))
    ]


PARTS = FrozenMap(
    {
        "head and neck": r"Head|Cervical",
        "trunk": r"Thoracic|Lumbar|^mouse$",
        "forelimbs": r"Scapula|Clavicle|Humerus|Ulna|Radius|Carp|FPhalange",
        "hindlimbs": r"Femur|Tibia|Tarsus|Metatarsus|BPhalange",
        "tail": r"Tail",
    }
)
"""Bodies of the skeleton by what part of the mouse they are."""


def part_masses(folder: Path) -> dict[str, float]:
    """Masses of the skeleton's parts [kg], as its file has them."""
    bodies = read_mjcf(folder / SKELETON / "mouse_with_meshes.xml").bodies
    return {
        part: sum(
            body.mass for body in bodies if re.search(pattern, body.name.removesuffix("_interim_0"))
        )
        for part, pattern in PARTS.items()
    }
