"""The embedded default: a recorded countermovement jump and a leg model fitted to the jumper.

The recording comes with `biomdp` (MIT licence), the model with `myo-sim` (Apache-2.0): nothing of
either is copied here. `jump_study` brings them together: it turns the recording and the model into
one ground frame (x forward, y up, z to the right), scales the model's segments to the recorded joint
centers, puts the recorded markers on it where quiet standing shows them, and shares the force of the
one plate between both feet.
"""

from __future__ import annotations

import importlib.util
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from myomorph.contact.plates import force_plates
from myomorph.io.c3d import read_c3d
from myomorph.model.errors import BadData
from myomorph.model.functions import linear
from myomorph.model.model import GROUND, Axis, Coordinate, Joint, Marker, Model
from myomorph.model.scale import scale
from myomorph.model.series import Analog, Event, Markers, Motion, Trial, Wrenches
from myomorph.model.spatial import Array, Transform
from myomorph.motion.calibrate import place_markers
from myomorph.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.motion.sync import cut
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

RECORDING = "tests/datasets/vicon_CMJ_kinem_kinet_emg.c3d"
QUIET = (1.5, 3.0)
"""When the jumper stands still [s]."""
WINDOW = (3.0, 6.0)
"""From before the countermovement until after landing; at 6.2 s the right foot is lifted and put down again [s]."""
CUTOFF = 15.0
"""Low-pass of motion and forces [Hz]: kept the same so that the landing makes no artefact of its own."""
LAB_TO_GROUND = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""The jumper faces the laboratory's +y, which becomes x; z up becomes y; +x, to the right, becomes z."""
TRUNK_MUSCLES = ("ercspn", "intobl", "extobl")
TRUNK_BEND = "flex_extension"
SEGMENTS = {"pelvis": "pelvis", "thigh": "femur_r", "shank": "tibia_r", "foot": "calcn_r", "trunk": "torso"}
LOCKED = ("lat_bending", "axial_rotation", "mtp_angle_r", "mtp_angle_l")
FREED = ("ankle_angle_r", "ankle_angle_l", "subtalar_angle_r", "subtalar_angle_l")
"""A jumper's ankle bends further than the model's range."""
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
EMG_CHANNELS = ("EMG1.v", "EMG2.v", "EMG3.v", "EMG4.v", "EMG5.v", "EMG6.v")
MIRRORED_WEIGHT = 0.1
"""Of the mirrored left markers: enough to place the left leg, too little to pull on the pelvis."""
SHOULDER_WEIGHT = 0.2
"""Of the shoulder: it moves on the trunk, which is rigid here."""
# Where the model has what the recording's joint centers and bony landmarks name [m]; the spines of the
# pelvis were read off its mesh, the skin over them is some 10 mm thick.
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


@dataclass(frozen=True, eq=False)
class JumpStudy:
    """All that inverse kinematics, inverse dynamics and tensions of the jump need.

    Attributes
    ----------
    model : scaled to the jumper, with the recording's markers; ground x forward, y up, z right
    trial : the recording in that ground, with its plates
    markers : recorded markers of pelvis, trunk and right leg, and the right leg's mirror images
        (named `Left_... (mirrored)`)
    marker_weights : for inverse kinematics
    wrenches : half of plate 1 on each foot, at the plates' clock; see `share`
    analog : the six EMG channels that carry signals [V]
    events : phases of the jump, read off the plate
    mass : of the jumper, from the plate in quiet standing [kg]
    factors : scale factor of each body
    window, cutoff : what to use of the recording [s], low-pass of motion and forces [Hz]
    share : (samples,) share of the right foot in the load that the center of pressure tells, NaN in
        flight; 0.5 is assumed
    real, assumed : sentences for the first lines of a report
    source : path of the recording
    """

    model: Model
    trial: Trial
    markers: Markers
    marker_weights: dict[str, float]
    wrenches: Wrenches
    analog: Analog
    events: tuple[Event, ...]
    mass: float
    factors: dict[str, float]
    window: tuple[float, float]
    cutoff: float
    share: Array
    real: tuple[str, ...]
    assumed: tuple[str, ...]
    source: str


def jump_study(recording: str | Path | None = None) -> JumpStudy:
    """The jump, ready for inverse kinematics, inverse dynamics, muscle paths and tensions.

    Parameters
    ----------
    recording : the C3D file; by default the one in the installed package `biomdp`

    Raises
    ------
    BadData : the packages `biomdp` or `myo-sim` are not installed, or the recording lacks what it needs
    """
    path = Path(recording) if recording is not None else recording_path()
    trial = force_plates(read_c3d(path)).rotated(LAB_TO_GROUND)
    if trial.markers is None or not trial.plates or trial.analog is None:
        raise BadData(f"{path}: expected markers, force plates and analog channels")
    model = leg_model()
    quiet = cut(trial.markers, *QUIET)
    mass = standing_mass(trial, model)
    model, factors = fitted_model(model, quiet, mass)
    markers = with_mirrored(trial.markers)
    model = calibrated(model, cut(markers, *QUIET), quiet)
    wrenches, share = shared_wrenches(trial)
    channels = [trial.analog.names.index(name) for name in EMG_CHANNELS]
    units = tuple(trial.analog.units[i] for i in channels)
    analog = Analog(trial.analog.time, EMG_CHANNELS, trial.analog.values[:, channels], units)
    return JumpStudy(
        model=model,
        trial=trial,
        markers=markers,
        marker_weights=_weights(model),
        wrenches=wrenches,
        analog=analog,
        events=events_of(trial),
        mass=mass,
        factors=factors,
        window=WINDOW,
        cutoff=CUTOFF,
        share=share,
        real=_real(mass),
        assumed=_assumed(factors, share, trial),
        source=str(path),
    )


def recording_path() -> Path:
    """The jump's C3D file in the installed package `biomdp`."""
    found = importlib.util.find_spec("biomdp")
    path = Path(found.origin).parent / RECORDING if found is not None and found.origin else None
    if path is None or not path.exists():
        raise BadData("the recording of the jump comes with the package 'biomdp': install it (pip install biomdp)")
    return path


@contextmanager
def _silent() -> Iterator[None]:
    """MuJoCo prints its warnings and writes them into a file in the user's folder."""
    import mujoco

    mujoco.set_mju_user_warning(lambda text: None)
    level = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(level)
        mujoco.set_mju_user_warning(None)


def leg_model() -> Model:
    """`myo-sim`'s legs (80 muscles) under a trunk that bends, in a ground with x forward, y up, z right.

    The pelvis moves by the six coordinates that OpenSim's gait models have: `pelvis_tilt`, `pelvis_list`
    and `pelvis_rotation` about z, x and y in this order, `pelvis_tx`, `pelvis_ty`, `pelvis_tz`. The
    trunk's few muscles are left out; its side bending, its twist and the toes are locked.
    """
    try:
        import myo_sim
    except ImportError:
        raise BadData(
            "the model of the legs comes with the package 'myo-sim': install it (pip install myo-sim)"
        ) from None
    from myomorph.io.mjcf import model_from_mujoco

    with _silent():
        compiled = myo_sim.load_model("myolegs_abdomen")
    model = model_from_mujoco(compiled, name="myolegs")
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.defaults[None])
    root = model.joints[0]
    start = poses.rotations[0, tree.body_index[root.child]].T @ poses.rotations[0, tree.body_index["pelvis"]]
    joint, coordinates = _pelvis_joint(root.child, start)
    held = tuple(_held(coordinate) for coordinate in model.coordinates[6:])
    return replace(
        model,
        joints=(joint, *model.joints[1:]),
        coordinates=(*coordinates, *held),
        gravity=np.array([0.0, float(model.gravity[2]), 0.0]),
        muscles=tuple(one for one in model.muscles if not one.name.startswith(TRUNK_MUSCLES)),
    )


def _held(coordinate: Coordinate) -> Coordinate:
    if coordinate.name in LOCKED:
        return replace(coordinate, locked=True, default=0.0)
    return replace(coordinate, clamped=False) if coordinate.name in FREED else coordinate


def _pelvis_joint(child: str, start: Array) -> tuple[Joint, tuple[Coordinate, ...]]:
    x, y, z = np.eye(3)
    turns = (("pelvis_tilt", z), ("pelvis_list", x), ("pelvis_rotation", y))
    shifts = (("pelvis_tx", x), ("pelvis_ty", y), ("pelvis_tz", z))
    axes = [Axis("translation", vector, linear(1.0), (name,)) for name, vector in shifts]
    axes += [Axis("rotation", vector, linear(1.0), (name,)) for name, vector in turns]
    coordinates = [Coordinate(name, "rotational") for name, _ in turns]
    coordinates += [Coordinate(name, "translational", default=float(name == "pelvis_ty")) for name, _ in shifts]
    names = tuple(one.name for one in coordinates)
    frame = Transform(start, np.zeros(3))
    joint = Joint("ground_pelvis", "CustomJoint", GROUND, child, Transform.identity(), frame, tuple(axes), names)
    return joint, tuple(coordinates)


def standing_mass(trial: Trial, model: Model) -> float:
    """Mass of the jumper [kg]: mean vertical force of plate 1 in quiet standing over gravity."""
    still = (trial.plate_time >= QUIET[0]) & (trial.plate_time <= QUIET[1])
    return float(trial.plates[0].forces[still, 1].mean() / np.linalg.norm(model.gravity))


def fitted_model(model: Model, quiet: Markers, mass: float) -> tuple[Model, dict[str, float]]:
    """The model with segments as long as the jumper's, and the factors by which each body grew.

    Pelvis by the distance of the hip centers, thighs from hip to knee, shanks and feet from knee to
    ankle, the trunk by the mean of thigh and shank. Both legs get the right leg's factors.
    """
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.defaults[None])

    def place(body: str) -> Array:
        origin: Array = poses.origins[0, tree.body_index[body]]
        return origin

    def ratio(one: str, other: str, marker: str, other_marker: str) -> float:
        recorded = np.linalg.norm(quiet[marker] - quiet[other_marker], axis=1)
        return float(np.mean(recorded) / np.linalg.norm(place(one) - place(other)))

    pelvis = ratio("femur_r", "femur_l", "RHJC", "LHJC")
    thigh = ratio("femur_r", "tibia_r", "RHJC", "RKJC")
    shank = ratio("tibia_r", "talus_r", "RKJC", "RAJC")
    groups = {"femur": thigh, "patella": thigh, "tibia": shank, "talus": shank, "calcn": shank, "toes": shank}
    whole = {"pelvis": pelvis, "sacrum": pelvis}
    factors = {
        name: groups.get(name.rsplit("_", 1)[0], whole.get(name, 0.5 * (thigh + shank))) for name in model.body_names
    }
    sizes = {name: np.full(3, factor) for name, factor in factors.items()}
    return scale(model, sizes, mass, preserve_mass_distribution=True), factors


def with_mirrored(markers: Markers) -> Markers:
    """The recording with the right leg's markers mirrored in the pelvis' own middle plane for a left leg.

    The plane is halfway between the spines of the pelvis, across the line from left to right.
    """
    side = markers["RASI"] - markers["LASI"] + markers["RPSI"] - markers["LPSI"]
    side = side / np.linalg.norm(side, axis=1, keepdims=True)
    middle = 0.25 * (markers["RASI"] + markers["LASI"] + markers["RPSI"] + markers["LPSI"])
    used = (*PELVIS_MARKERS, SHOULDER, *LEG_MARKERS)
    columns = [markers[name] for name in used]
    for name in LEG_MARKERS:
        x = markers[name]
        columns.append(x - 2.0 * np.sum((x - middle) * side, axis=1, keepdims=True) * side)
    names = (*used, *(mirrored_name(name) for name in LEG_MARKERS))
    return Markers(markers.time, names, np.stack(columns, axis=1))


def _weights(model: Model) -> dict[str, float]:
    weights = {name: MIRRORED_WEIGHT if "mirrored" in name else 1.0 for name in model.marker_names}
    return weights | {SHOULDER: SHOULDER_WEIGHT}


def mirrored_name(name: str) -> str:
    """Name of the mirror image of a right marker."""
    return name.replace("Right_", "Left_") + " (mirrored)"


def calibrated(model: Model, markers: Markers, quiet: Markers) -> Model:
    """The model with all markers where quiet standing shows them.

    Its pose there: joint centers and bony landmarks by inverse kinematics, the sole level (the jumper
    wears shoes, so heights of foot markers tell nothing), the trunk upright, the left leg as the right.
    """
    tree = compile_tree(model)
    neutral = forward_kinematics(tree, tree.defaults[None])
    talus, calcn = (neutral.origins[0, tree.body_index[name]] for name in ("talus_r", "calcn_r"))
    still = _mean_frame(quiet)
    values = still.values.copy()
    for name in ("Right_TalonInf", "Right_Meta"):
        values[0, still.names.index(name), 1] = still["RAJC"][0, 1] - (talus - calcn)[1]
    landmarks = tuple(Marker(name, body, np.array(place)) for name, (body, place) in LANDMARKS.items())
    options = InverseKinematicsOptions(marker_weights=LANDMARK_WEIGHTS)
    fit = inverse_kinematics(model.with_markers(landmarks), Markers(still.time, still.names, values), options)
    pose = _upright(model, _left_as_right(fit.motion))
    bodies = dict.fromkeys(PELVIS_MARKERS, "pelvis") | {SHOULDER: "torso"} | LEG_MARKERS
    bodies |= {mirrored_name(name): body.replace("_r", "_l") for name, body in LEG_MARKERS.items()}
    return model.with_markers(place_markers(model, pose, _mean_frame(markers), bodies))


def _mean_frame(markers: Markers) -> Markers:
    return Markers(markers.time[:1], markers.names, markers.values.mean(axis=0)[None])


def _left_as_right(motion: Motion) -> Motion:
    values = motion.values.copy()
    for i, name in enumerate(motion.names):
        if name.endswith("_l"):
            values[:, i] = motion[name[:-2] + "_r"]
    return replace(motion, values=values)


def _upright(model: Model, motion: Motion) -> Motion:
    """The pose with the trunk bent so that the chest's own vertical is the ground's."""
    tree = compile_tree(model)
    column, torso = motion.names.index(TRUNK_BEND), tree.body_index["torso"]

    def lean(bend: float) -> float:
        values = motion.values.copy()
        values[:, column] = bend
        poses = forward_kinematics(tree, tree.coordinates_of(replace(motion, values=values)))
        up = poses.rotations[0, torso, :, 1]
        return float(np.arctan2(up[0], up[1]))

    values = motion.values.copy()
    values[:, column] = brentq(lean, -0.8, 0.7)
    return replace(motion, values=values)


def shared_wrenches(trial: Trial) -> tuple[Wrenches, Array]:
    """Half of plate 1 on each foot, and the right foot's share that the center of pressure tells.

    Both forces act as far forward as the center of pressure of the plate. The right one acts on the line
    from the heel through the ankle's center, the left one where both together make the wrench of the
    plate. With the left foot as far from the middle of the hips as the right one, the plate's center of
    pressure would divide the distance by the shares of the feet.
    """
    plate, markers = trial.plates[0], trial.markers
    assert markers is not None
    clock = trial.plate_time

    def at_plate(column: Array) -> Array:
        return np.column_stack([np.interp(clock, markers.time, one) for one in column.T])

    heel, ankle, left, right = (at_plate(markers[name]) for name in ("Right_TalonInf", "RAJC", "LHJC", "RHJC"))
    still = (clock >= QUIET[0]) & (clock <= QUIET[1])
    run = (ankle - heel)[still].mean(axis=0)
    center = plate.points
    foot = ankle[:, 2] + (center[:, 0] - ankle[:, 0]) * run[2] / run[0]
    points = np.stack([center, center], axis=1)
    points[:, 0, 2], points[:, 1, 2] = foot, 2.0 * center[:, 2] - foot
    half = 0.5 * np.stack([plate.forces, plate.forces], axis=1)
    loaded = np.isfinite(center).all(axis=1)
    half[~loaded] = 0.0
    torques = 0.5 * np.nan_to_num(np.stack([plate.torques, plate.torques], axis=1))
    middle = 0.5 * (left + right)[:, 2]
    share = 0.5 + 0.5 * (center[:, 2] - middle) / (foot - middle)
    wrenches = Wrenches(clock, ("right_foot", "left_foot"), ("calcn_r", "calcn_l"), half, points, torques)
    return wrenches, np.where(loaded, share, np.nan)


def events_of(trial: Trial) -> tuple[Event, ...]:
    """Phases of the jump, read off the vertical force of plate 1.

    Start: the force leaves quiet standing by five of its standard deviations for good; lowest: the
    pelvis markers are lowest before take-off; take-off and landing: the plate is unloaded and loaded
    again; peak: the largest force after landing.
    """
    plate, markers, clock = trial.plates[0], trial.markers, trial.plate_time
    assert markers is not None
    force = plate.forces[:, 1]
    loaded = np.isfinite(plate.points).all(axis=1)
    flight = np.flatnonzero(~loaded & (clock > QUIET[1]))
    if not len(flight):
        raise BadData("plate 1 is never unloaded: this is no jump")
    takeoff, landing = clock[flight[0]], clock[flight[-1]]
    still = (clock >= QUIET[0]) & (clock <= QUIET[1])
    level, spread = force[still].mean(), force[still].std()
    before = np.flatnonzero((clock < takeoff) & (np.abs(force - level) < 5.0 * spread) & (clock < takeoff - 0.5))
    height = np.mean([markers[name][:, 1] for name in PELVIS_MARKERS], axis=0)
    early = markers.time < takeoff
    lowest = markers.time[early][np.argmin(height[early])]
    start = clock[before[before < np.searchsorted(clock, lowest)][-1]]
    peak = clock[np.argmax(np.where(clock >= landing, force, 0.0))]
    found = {"Start": start, "Lowest": lowest, "Take-off": takeoff, "Landing": landing, "Peak": peak}
    return tuple(Event(float(time), label) for label, time in found.items())


def _real(mass: float) -> tuple[str, ...]:
    return (
        "Real: a countermovement jump recorded by Vicon (package biomdp, MIT licence): markers on pelvis, right leg "
        "and right shoulder at 200 Hz, force plates and EMG at 2000 Hz.",
        f"Real: the mass of the jumper, {mass:.1f} kg, from the plate in quiet standing.",
    )


def _assumed(factors: dict[str, float], share: Array, trial: Trial) -> tuple[str, ...]:
    still = (trial.plate_time >= QUIET[0]) & (trial.plate_time <= QUIET[1])
    used = (trial.plate_time >= WINDOW[0]) & (trial.plate_time <= WINDOW[1]) & np.isfinite(share)
    grown = ", ".join(f"{name} {factors[body]:.3f}" for name, body in SEGMENTS.items())
    return (
        "Assumed: both feet stand on one plate, so each gets half of its force; from where the center of pressure lies "
        f"between the feet the right foot would carry {share[still].mean():.0%} in quiet standing and "
        f"{np.nanmedian(share[used]):.0%} (median) in the jump.",
        "Assumed: the left leg has no markers; it is the mirror image of the right one in the pelvis' middle plane.",
        f"Assumed: the model is myo-sim's legs (Apache-2.0), scaled to the recorded joint centers ({grown}), with the "
        "arms' mass in the trunk; toes, side bending and twist of the trunk are locked.",
        "Assumed: in quiet standing the soles are level and the trunk is upright.",
        "Unknown: the file does not name the muscles of EMG channels 1 to 6.",
    )
