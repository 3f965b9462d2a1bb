"""A recorded countermovement jump and a leg model fitted to the jumper: the embedded default.

The recording comes with `biomdp` (MIT licence), the model with `myo-sim` (Apache-2.0): nothing of
either is copied here. `jump_study` brings them together: it turns the recording and the model into
one ground frame (x forward, y up, z to the right), scales the model's segments to the recorded
joint centers, puts the recorded markers on it where quiet standing shows them, and shares the force
of the one plate between both feet.
"""

from __future__ import annotations

import importlib.util
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from myomorph.core.contact.plates import force_plates
from myomorph.core.io.c3d.read import read_c3d
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, MissingPackage
from myomorph.core.model.model import Marker, Model
from myomorph.core.model.scale import scale
from myomorph.core.model.series import (
    Analog,
    Event,
    ForcePlate,
    Markers,
    Motion,
    Trial,
    Wrenches,
)
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.core.motion.measurements import place_markers
from myomorph.core.motion.sync import cut
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analyze.leg_model import leg_model

RECORDING = "tests/datasets/vicon_CMJ_kinem_kinet_emg.c3d"
QUIET = (1.5, 3.0)  # When the jumper stands still [s].
PELVIS_MARKERS = ("LASI", "RASI", "LASIMID", "RASIMID", "LPSI", "RPSI")
LEG_MARKERS = {
    "Right_MusloPS": "femur_r",
    "Right_MusloAS": "femur_r",
    "Right_MusloAI": "femur_r",
    "Right_MusloPI": "femur_r",
    "Right_PiernaPS": "tibia_r",
    "Right_PiernaAS": "tibia_r",
    "Right_PiernaAI": "tibia_r",
    "Right_PiernaPI": "tibia_r",
    "Right_TalonSup": "calcn_r",
    "Right_TalonInf": "calcn_r",
    "Right_Meta": "calcn_r",
}
SHOULDER = "Right_Hombro"


def recording_path() -> Path:
    """Find the jump's C3D file in the installed package `biomdp`."""
    spec = importlib.util.find_spec("biomdp")
    path = Path(spec.origin).parent / RECORDING if spec is not None and spec.origin else None
    if path is None or not path.exists():
        raise MissingPackage("biomdp", "demo")
    return path


def with_mirrored(markers: Markers) -> Markers:
    """Mirror the right leg's markers in the pelvis' middle plane, for a left leg."""
    middle, side = middle_plane(markers)
    used = (*PELVIS_MARKERS, SHOULDER, *LEG_MARKERS)
    columns = [markers[name] for name in used]
    columns += [middle + mirrored(markers[name] - middle, side) for name in LEG_MARKERS]
    names = (*used, *(mirrored_name(name) for name in LEG_MARKERS))
    return Markers(markers.time, names, np.stack(columns, axis=1))


def middle_plane(markers: Markers) -> tuple[Array, Array]:
    """Find the upright plane that halves the pelvis.

    It lies halfway between the spines of the pelvis, across the level part of the line from left to
    right: upright, so that the mirror image of a foot on the floor stands on the floor.

    Parameters
    ----------
    markers : with those of the pelvis [m]

    Returns
    -------
    A point (frames, 3) [m] and the unit normal (frames, 3)
    """
    side = markers["RASI"] - markers["LASI"] + markers["RPSI"] - markers["LPSI"]
    side[:, 1] = 0.0
    middle = 0.25 * (markers["RASI"] + markers["LASI"] + markers["RPSI"] + markers["LPSI"])
    return middle, side / np.linalg.norm(side, axis=1, keepdims=True)


def mirrored(vectors: Array, side: Array) -> Array:
    """Mirror vectors in planes through the origin.

    Parameters
    ----------
    vectors : (frames, 3)
    side : (frames, 3) unit normals of the planes

    Returns
    -------
    (frames, 3)
    """
    return vectors - 2.0 * np.sum(vectors * side, axis=1, keepdims=True) * side


def mirrored_name(name: str) -> str:
    """Name of the mirror image of a right marker."""
    return name.replace("Right_", "Left_") + " (mirrored)"


def shared_wrenches(trial: Trial) -> tuple[Wrenches, Array]:
    """Put half of plate 1 on the right foot and its mirror image on the left.

    The force on the right foot acts as far forward as the center of pressure of the plate, on the
    line from the heel through the ankle's center. Were the left foot as far from the middle of the
    hips as the right one, the center of pressure would divide their distance by the shares of the
    feet.

    Parameters
    ----------
    trial : with markers and plate 1

    Returns
    -------
    Wrenches on both feet, and the share (samples,) that the plate shows, NaN where it is not loaded
    """
    markers = trial.markers
    assert markers is not None
    clock = trial.plate_time
    right = _right_foot(trial.plates[0], markers, clock)
    middle_points, side_points = middle_plane(markers)
    middle = _at(clock, markers.time, middle_points)
    side = _at(clock, markers.time, side_points)
    side = side / np.linalg.norm(side, axis=1, keepdims=True)
    left_point = middle + mirrored(right.point - middle, side)
    forces = np.stack([right.force, mirrored(right.force, side)], axis=1)
    points = np.stack([right.point, left_point], axis=1)
    # A torque is an axial vector: its mirror image turns the other way.
    torques = np.stack([right.torque, -mirrored(right.torque, side)], axis=1)
    wrenches = Wrenches(
        time=clock,
        names=("right_foot", "left_foot"),
        bodies=("calcn_r", "calcn_l"),
        forces=forces,
        points=points,
        torques=torques,
    )
    return wrenches, _share_of_plate(trial.plates[0], markers, clock, right.point)


class _FootLoad(NamedTuple):
    """What half of the plate does to the right foot, (samples, 3) each."""

    force: Array  # [N]
    point: Array  # [m]
    torque: Array  # about the point [N m]


def _right_foot(plate: ForcePlate, markers: Markers, clock: Array) -> _FootLoad:
    """Put half of the plate's load on the line from the heel through the ankle's center."""
    center = plate.points
    loaded = np.isfinite(center[:, 0])
    heel = _at(clock, markers.time, markers["Right_TalonInf"])
    ankle = _at(clock, markers.time, markers["RAJC"])
    still = (clock >= QUIET[0]) & (clock <= QUIET[1])
    run = (ankle - heel)[still].mean(axis=0)
    point = center.copy()
    point[:, 2] = ankle[:, 2] + (center[:, 0] - ankle[:, 0]) * run[2] / run[0]
    force = np.where(loaded[:, None], 0.5 * plate.forces, 0.0)
    return _FootLoad(force, point, 0.5 * np.nan_to_num(plate.torques))


def _share_of_plate(plate: ForcePlate, markers: Markers, clock: Array, point: Array) -> Array:
    """Find the share of the right foot (samples,) that the plate's center of pressure shows."""
    left = _at(clock, markers.time, markers["LHJC"])
    right = _at(clock, markers.time, markers["RHJC"])
    hips = 0.5 * (left + right)[:, 2]
    center = plate.points
    share = 0.5 + 0.5 * (center[:, 2] - hips) / (point[:, 2] - hips)
    return np.where(np.isfinite(center[:, 0]), share, np.nan)


def _at(clock: Array, time: Array, column: Array) -> Array:
    return np.column_stack([np.interp(clock, time, values) for values in column.T])


def events_of(trial: Trial) -> tuple[Event, ...]:
    """Find the phases of the jump from the vertical force of plate 1.

    Start: the force leaves quiet standing by five of its standard deviations for good. Lowest: the
    pelvis markers are lowest before take-off. Take-off and landing: the plate is unloaded and
    loaded again. Peak: the largest force after landing.
    """
    plate = trial.plates[0]
    markers = trial.markers
    clock = trial.plate_time
    assert markers is not None
    force = plate.forces[:, 1]
    loaded = np.isfinite(plate.points).all(axis=1)
    flight = np.flatnonzero(~loaded & (clock > QUIET[1]))
    if not len(flight):
        raise BadData("plate 1 is never unloaded: this is no jump")
    takeoff = clock[flight[0]]
    landing = clock[flight[-1]]
    height = np.mean([markers[name][:, 1] for name in PELVIS_MARKERS], axis=0)
    early = markers.time < takeoff
    events = {
        "Start": _start(clock, force, takeoff),
        "Lowest": markers.time[early][np.argmin(height[early])],
        "Take-off": takeoff,
        "Landing": landing,
        "Peak": clock[np.argmax(np.where(clock >= landing, force, 0.0))],
    }
    return tuple(Event(float(time), label) for label, time in events.items())


def _start(clock: Array, force: Array, takeoff: float) -> float:
    """Find when the force leaves quiet standing by five standard deviations for good [s]."""
    still = (clock >= QUIET[0]) & (clock <= QUIET[1])
    level = force[still].mean()
    spread = force[still].std()
    before = np.flatnonzero((np.abs(force - level) < 5.0 * spread) & (clock < takeoff - 0.5))
    return float(clock[before[-1]])


TRUNK_BEND = "lumbar_extension"
# Where the model has what the recording's joint centers and bony landmarks name [m]; the spines of
# the pelvis were read off its mesh, the skin over them is some 10 mm thick.
LANDMARKS = {
    "RASI": ("pelvis", (0.010, 0.0, 0.121)),
    "LASI": ("pelvis", (0.010, 0.0, -0.121)),
    "RPSI": ("pelvis", (-0.148, 0.017, 0.041)),
    "LPSI": ("pelvis", (-0.148, 0.017, -0.041)),
    "RHJC": ("femur_r", (0.0, 0.0, 0.0)),
    "LHJC": ("femur_l", (0.0, 0.0, 0.0)),
    "RKJC": ("tibia_r", (0.0, 0.0, 0.0)),
    "RAJC": ("talus_r", (0.0, 0.0, 0.0)),
    "Right_KneeExt": ("tibia_r", (0.0, 0.0, 0.055)),
    "Right_KneeInt": ("tibia_r", (0.0, 0.0, -0.055)),
    "Right_TalonInf": ("calcn_r", (-0.030, 0.0, -0.006)),
    "Right_Meta": ("calcn_r", (0.190, 0.0, 0.010)),
}
LANDMARK_WEIGHTS = {"RHJC": 10.0, "LHJC": 10.0, "RKJC": 10.0, "RAJC": 10.0}


def _default_poses(model: Model) -> dict[str, Transform]:
    """Poses in ground at the coordinates' defaults, coupled ones too."""
    tree = compile_tree(model)
    return forward_kinematics(tree, tree.defaults[None]).transforms()


def fitted_model(model: Model, quiet: Markers, mass: float) -> tuple[Model, dict[str, float]]:
    """Scale the model to segments as long as the jumper's.

    The pelvis is scaled by the distance of the hip centers, thighs from hip to knee, shanks and
    feet from knee to ankle, the trunk by the mean of thigh and shank. Both legs get the right leg's
    factors. The factors by which each body grew are the second result.
    """
    poses = _default_poses(model)

    def ratio(body: str, other: str, marker: str, other_marker: str) -> float:
        recorded = np.linalg.norm(quiet[marker] - quiet[other_marker], axis=1)
        return float(
            np.mean(recorded) / np.linalg.norm(poses[body].translation - poses[other].translation)
        )

    pelvis = ratio("femur_r", "femur_l", "RHJC", "LHJC")
    thigh = ratio("femur_r", "tibia_r", "RHJC", "RKJC")
    shank = ratio("tibia_r", "talus_r", "RKJC", "RAJC")
    groups = {
        "femur": thigh,
        "patella": thigh,
        "tibia": shank,
        "talus": shank,
        "calcn": shank,
        "toes": shank,
    }
    whole = {"pelvis": pelvis, "sacrum": pelvis}
    factors = {
        name: groups.get(name.rsplit("_", 1)[0], whole.get(name, 0.5 * (thigh + shank)))
        for name in model.body_names
    }
    sizes = {name: np.full(3, factor) for name, factor in factors.items()}
    fitted = scale(
        model, sizes, mass, preserve_mass_distribution=True, path_lengths=default_path_lengths
    )
    return fitted, factors


def calibrated(model: Model, quiet: Markers) -> Model:
    """Move all markers of the model to where quiet standing shows them.

    The pose there comes from joint centers and bony landmarks by inverse kinematics, the sole level
    (the jumper wears shoes, so heights of foot markers show nothing), the trunk upright. The
    mirrored markers lie on the left leg as their originals on the right one.
    """
    neutral = _default_poses(model)
    talus = neutral["talus_r"].translation
    calcn = neutral["calcn_r"].translation
    still = Markers(quiet.time[:1], quiet.names, quiet.values.mean(axis=0)[None])
    values = still.values.copy()
    for name in ("Right_TalonInf", "Right_Meta"):
        values[0, still.names.index(name), 1] = still["RAJC"][0, 1] - (talus - calcn)[1]
    landmarks = tuple(
        Marker(name, body, np.array(place)) for name, (body, place) in LANDMARKS.items()
    )
    options = InverseKinematicsOptions(marker_weights=LANDMARK_WEIGHTS)
    fit = inverse_kinematics(
        model.with_markers(landmarks), Markers(still.time, still.names, values), options
    )
    pose = _upright(model, fit.motion)
    bodies = dict.fromkeys(PELVIS_MARKERS, "pelvis") | {SHOULDER: "shoulder_r"} | LEG_MARKERS
    placed = place_markers(model, pose, still, bodies)
    # Left bodies have the axes of the right ones and the shape of their mirror image.
    left = (
        Marker(
            mirrored_name(one.name), one.body.replace("_r", "_l"), one.location * (1.0, 1.0, -1.0)
        )
        for one in placed
        if one.name in LEG_MARKERS
    )
    return model.with_markers((*placed, *left))


def _upright(model: Model, motion: Motion) -> Motion:
    """Bend the trunk of the pose so that the chest's own vertical is the ground's."""
    tree = compile_tree(model)
    column = motion.names.index(TRUNK_BEND)
    torso = tree.body_index["torso"]

    def lean(bend: float) -> float:
        values = motion.values.copy()
        values[:, column] = bend
        poses = forward_kinematics(tree, tree.coordinates_of(replace(motion, values=values)))
        up = poses.rotations[0, torso, :, 1]
        return float(np.arctan2(up[0], up[1]))

    values = motion.values.copy()
    values[:, column] = brentq(lean, -0.8, 0.7)
    return replace(motion, values=values)


WINDOW = (3.0, 5.6)
"""From quiet standing until after landing; at 6.2 s the right foot is lifted and put down elsewhere
[s].
"""
# Low-pass of motion and forces [Hz]: kept the same so that the landing makes no artefact of its
# own.
CUTOFF = 10.0
LAB_TO_GROUND = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""The jumper faces the laboratory's +y, which becomes x; z up becomes y; +x, to the right, becomes
z.
"""
SEGMENTS = {
    "pelvis": "pelvis",
    "thigh": "femur_r",
    "shank": "tibia_r",
    "foot": "calcn_r",
    "trunk": "torso",
}
EMG_CHANNELS = ("EMG1.v", "EMG2.v", "EMG3.v", "EMG4.v", "EMG5.v", "EMG6.v")
# Of the mirrored left markers: enough to place the left leg, too little to pull on the pelvis.
MIRRORED_WEIGHT = 0.1
SHOULDER_WEIGHT = 0.2  # Of the shoulder: it moves on the trunk, which is rigid here.


@read_only
class JumpStudy:
    """All that inverse kinematics, inverse dynamics and tensions of the jump need."""

    # scaled to the jumper, with the recording's markers; ground x forward, y up, z right
    model: Model
    trial: Trial  # the recording in that ground, with its plates
    # recorded markers of pelvis, trunk and right leg, and the right leg's mirror images (named
    # `Left_... (mirrored)`)
    markers: Markers
    marker_weights: dict[str, float]  # for inverse kinematics
    wrenches: Wrenches  # half of plate 1 on each foot, at the plates' clock; see `share`
    analog: Analog  # the six EMG channels that carry signals [V]
    events: tuple[Event, ...]  # phases of the jump, read off the plate
    mass: float  # of the jumper, from the plate in quiet standing [kg]
    factors: dict[str, float]  # scale factor of each body
    # window, cutoff: what to use of the recording [s], low-pass of motion and forces [Hz]
    window: tuple[float, float]
    cutoff: float
    # (samples,) share of the right foot in the load that the center of pressure shows, NaN in
    # flight; 0.5 is assumed
    share: Array
    # real, assumed: sentences for the first lines of a report
    real: tuple[str, ...]
    assumed: tuple[str, ...]
    source: str  # path of the recording


def jump_study() -> JumpStudy:
    """Prepare the jump for inverse kinematics, inverse dynamics, muscle paths and tensions."""
    path = recording_path()
    # The file is read in a process of its own, which leaves this one free to make the model.
    with ThreadPoolExecutor(1) as pool:
        reading = pool.submit(read_c3d, path)
        model = leg_model()
        trial = force_plates(reading.result()).rotated(LAB_TO_GROUND)
    if trial.markers is None or not trial.plates or trial.analog is None:
        raise BadData(f"{path}: expected markers, force plates and analog channels")
    quiet = cut(trial.markers, *QUIET)
    still = (trial.plate_time >= QUIET[0]) & (trial.plate_time <= QUIET[1])
    # Plate 1 carries the jumper in quiet standing.
    mass = float(trial.plates[0].forces[still, 1].mean() / np.linalg.norm(model.gravity))
    model, factors = fitted_model(model, quiet, mass)
    model = calibrated(model, quiet)
    wrenches, share = shared_wrenches(trial)
    events = events_of(trial)
    channels = [trial.analog.names.index(name) for name in EMG_CHANNELS]
    units = tuple(trial.analog.units[i] for i in channels)
    weights = {name: MIRRORED_WEIGHT if "mirrored" in name else 1.0 for name in model.marker_names}
    return JumpStudy(
        model=model,
        trial=trial,
        markers=with_mirrored(trial.markers),
        marker_weights=weights | {SHOULDER: SHOULDER_WEIGHT},
        wrenches=wrenches,
        analog=Analog(
            time=trial.analog.time,
            names=EMG_CHANNELS,
            values=trial.analog.values[:, channels],
            units=units,
        ),
        events=events,
        mass=mass,
        factors=factors,
        window=WINDOW,
        cutoff=CUTOFF,
        share=share,
        real=(
            (
                "A countermovement jump recorded by Vicon (package biomdp, MIT licence): markers on"
                " pelvis, right leg and right shoulder at 200 Hz, force plates and EMG at 2000 Hz."
            ),
            f"The mass of the jumper, {mass:.1f} kg, from the plate in quiet standing.",
        ),
        assumed=_assumed(factors, share, trial, events),
        source=str(path),
    )


def _assumed(
    factors: dict[str, float], share: Array, trial: Trial, events: tuple[Event, ...]
) -> tuple[str, ...]:
    clock = trial.plate_time
    takeoff = next(event.time for event in events if event.label == "Take-off")
    still = (clock >= QUIET[0]) & (clock <= QUIET[1])
    pushing = (clock > QUIET[1]) & (clock < takeoff) & np.isfinite(share)
    low, high = np.percentile(share[pushing], [5, 95])
    grown = ", ".join(f"{name} {factors[body]:.3f}" for name, body in SEGMENTS.items())
    return (
        (
            "Both feet stand on one plate, so each gets half of its force. As a check, where the"
            " center of pressure lies between the feet gives the right foot"
            f" {share[still].mean():.0%} in quiet standing and {low:.0%} to {high:.0%} until"
            " take-off; after landing the feet stand too close for this check."
        ),
        (
            "The left leg, which has no markers, and its force are the mirror image of the right"
            " one in the upright plane that halves the pelvis."
        ),
        (
            "The model is myo-sim's legs (Apache-2.0), scaled to the recorded joint centers"
            f" ({grown}), with the arms' mass in the trunk, so that what the swing of the arms"
            " takes shows up as residual force; toes, side bending and twist of the trunk are"
            " locked."
        ),
        (
            "In quiet standing the soles are level and the trunk is upright; the shoulder, which"
            " the arms' swing lifts along the trunk, shows how far it bends."
        ),
        (
            "The file does not name the muscles of EMG channels 1 to 6: they are shown without"
            " saying which is which."
        ),
    )
