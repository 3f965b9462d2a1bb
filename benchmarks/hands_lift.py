"""One man who lifts a box of 15 kg.

His motion is on a calibrated model; the box's motion, and what was measured, go with it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

import myomorph as mm
from myomorph.body.calibrate.calibration import Calibration
from myomorph.core.io.c3d.read import read_c3d
from myomorph.core.model.arrays import Array
from myomorph.core.model.inertia import free_object
from myomorph.core.model.model import Actuator, Marker
from myomorph.core.model.series import Z_UP_TO_Y_UP
from myomorph.core.model.sides import split_side
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.muscles.kinematics import default_path_lengths
from truths.carried_bodies import needed_wrench

FOLDER = "lifting-box-15kg"
GENERIC = "rajagopal-walk-emg/raw/Rajagopal2016.osim"
LIFTS = ("stoop1", "stoop2")
MASS = 81.68
BOX_MASS = 15.0
CUTOFF = 6.0

BOX_SIZE = (0.30, 0.236, 0.30)
"""The height is twice that of the box's center over the floor; the other two are assumed [m]."""

BOX_ACROSS = 0.012
"""Place of the box to the right, from the center of pressure of the plate under it once it is gone
[m].
"""

JOINT_TORQUES = {
    "lumbar_extension": 250.0,
    "lumbar_bending": 150.0,
    "lumbar_rotation": 100.0,
    "arm_flex": 90.0,
    "arm_add": 90.0,
    "arm_rot": 50.0,
    "elbow_flex": 70.0,
    "pro_sup": 12.0,
    "wrist_flex": 15.0,
    "wrist_dev": 15.0,
}
"""What men's joints can do, of the order of isometric measurements (arm: Holzbaur et al. 2007) [N
m].

It is what a control of 1 stands for where the model has no muscles, so that an effort of joints
counts as that of muscles does. The model's own 10 N m would make lifting so dear that forces that
do not exist carry the box.
"""


@dataclass(frozen=True, eq=False)
class Recorded:
    """What the laboratory gives of one lift, in a ground whose y points up.

    `markers`: time from 0 [s]; `plate`, `plate_point`: (frames, 3) force of the plate on the feet
    [N] and its center of pressure [m]; `unloaded`: (frames, 3) force of the plate under the box on
    it, less that of the box at rest [N]; `box`: (frames, 3) of the box's center: forward, up [m],
    pitch [rad]; `bottom_up`, `top_down`: (frames, 3) moments at L5/S1 by the laboratory [N m].
    """

    markers: mm.Markers
    plate: Array
    plate_point: Array
    unloaded: Array
    box: Array
    bottom_up: Array
    top_down: Array


def recorded(folder: Path, lift: str) -> Recorded:
    """One lift's files."""
    here = folder / FOLDER
    forces = np.loadtxt(here / f"{lift}_F1Cop1F2Cop2.csv", delimiter=",")
    turn = Z_UP_TO_Y_UP.T
    return Recorded(
        markers=_markers(here / f"{lift}.c3d"),
        plate=forces[:, 7:10] @ turn,
        plate_point=forces[:, 10:13] @ turn,
        unloaded=forces[:, 1:4] @ turn,
        box=np.loadtxt(here / f"{lift}_box_2D.csv", delimiter=",")[:, 1:],
        bottom_up=np.loadtxt(here / f"{lift}_l5s1_bottom_up.csv", delimiter=",")[:, 1:] @ turn,
        top_down=np.loadtxt(here / f"{lift}_l5s1_top_down.csv", delimiter=",")[:, 1:] @ turn,
    )


def _markers(path: Path) -> mm.Markers:
    trial = read_c3d(path).rotated(Z_UP_TO_Y_UP)
    assert trial.markers is not None
    return trial.markers


@lru_cache(maxsize=2)
def lifter(folder: Path) -> Calibration:
    """Calibrate the Rajagopal model with Plug-in Gait's markers on standing and both lifts.

    It has the man's mass.
    """
    generic = with_plug_in_gait(mm.read_model(folder / GENERIC))
    trials = [recorded(folder, lift).markers for lift in LIFTS]
    static = _markers(folder / FOLDER / "neutral.c3d")
    return mm.calibrate(
        generic,
        trials,
        mm.CalibrationOptions(static=static, mass=MASS),
        path_lengths=default_path_lengths,
    )


@lru_cache(maxsize=4)
def tracked(folder: Path, lift: str) -> KinematicsFit:
    """Inverse kinematics of one lift."""
    return mm.inverse_kinematics(lifter(folder).model, recorded(folder, lift).markers)


def with_joint_torques(model: mm.Model) -> mm.Model:
    """Return the model with torques of `JOINT_TORQUES` in place of its own actuators."""
    torques = {one.name: JOINT_TORQUES.get(split_side(one.name)[0]) for one in model.coordinates}
    return replace(
        model,
        actuators=tuple(
            Actuator(
                name=f"joint_{name}",
                kind="coordinate",
                optimal_force=most,
                min_control=-1.0,
                max_control=1.0,
                coordinate=name,
            )
            for name, most in torques.items()
            if most
        ),
    )


def man(folder: Path, lift: str) -> tuple[mm.Model, mm.Motion]:
    """Return the man's model and his motion with derivatives."""
    return with_joint_torques(lifter(folder).model), mm.differentiate(
        tracked(folder, lift).motion, CUTOFF
    )


def box(folder: Path, lift: str) -> tuple[mm.Model, mm.Motion]:
    """Return the box and its motion: recorded in the plane of the lift, at rest across it."""
    forward, up, pitch = recorded(folder, lift).box.T
    model = free_object("body", BOX_MASS, BOX_SIZE, gravity=lifter(folder).model.gravity)
    values = np.zeros((len(up), 6))
    values[:, 0] = forward
    values[:, 1] = up
    values[:, 2] = BOX_ACROSS
    values[:, 5] = -pitch
    return model, mm.differentiate(
        mm.Motion(recorded(folder, lift).markers.time, model.coordinate_names, values), CUTOFF
    )


def hands_measured(folder: Path, lift: str) -> Array:
    """Return the force of the hands on the box, from its motion and the plate under it.

    It is m (a - g) less what the plate carries, which is the box's weight and `Recorded.unloaded`.

    Parameters
    ----------
    folder : of the collection
    lift : name of the recording

    Returns
    -------
    (frames, 3) [N]
    """
    model, motion = box(folder, lift)
    carried = -BOX_MASS * model.gravity + recorded(folder, lift).unloaded
    needed: Array = needed_wrench(model, motion, "body").forces[:, 0]
    return needed - carried


PLUG_IN_GAIT: tuple[tuple[str, str, tuple[float, float, float], str], ...] = (
    ("RASI", "pelvis", (0.010, 0.018, 0.128), "anterior superior iliac spine"),
    ("RPSI", "pelvis", (-0.155, 0.035, 0.045), "posterior superior iliac spine"),
    ("RTHI", "femur_r", (0.000, -0.220, 0.080), "lateral thigh, on the line from hip to knee"),
    ("RKNE", "femur_r", (0.000, -0.404, 0.050), "lateral epicondyle of the femur"),
    ("RTIB", "tibia_r", (0.000, -0.220, 0.055), "lateral shank"),
    ("RANK", "tibia_r", (-0.005, -0.389, 0.053), "lateral malleolus"),
    ("RHEE", "calcn_r", (-0.025, 0.020, -0.005), "calcaneus"),
    ("RTOE", "calcn_r", (0.175, 0.030, 0.000), "head of the second metatarsal"),
    ("C7", "torso", (-0.085, 0.435, 0.000), "spinous process of the 7th cervical vertebra"),
    ("T10", "torso", (-0.100, 0.200, 0.000), "spinous process of the 10th thoracic vertebra"),
    ("CLAV", "torso", (0.040, 0.380, 0.000), "jugular notch"),
    ("STRN", "torso", (0.095, 0.205, 0.000), "xiphoid process"),
    ("RBAK", "torso", (-0.100, 0.300, 0.090), "middle of the right scapula"),
    ("RSHO", "torso", (-0.003, 0.425, 0.130), "acromioclavicular joint"),
    ("RUPA", "humerus_r", (0.010, -0.150, 0.045), "lateral upper arm"),
    ("RELB", "humerus_r", (0.015, -0.280, 0.040), "lateral epicondyle of the humerus"),
    ("RWRA", "radius_r", (0.000, -0.225, 0.050), "wrist bar, thumb side"),
    ("RWRB", "radius_r", (-0.022, -0.225, -0.022), "wrist bar, side of the little finger"),
    (
        "RFIN",
        "hand_r",
        (-0.015, -0.080, 0.014),
        "back of the hand below the head of the second metacarpal",
    ),
)
"""Name, body, place in the body's frame [m] and what it lies on: the guide to Plug-in Gait (Vicon).

Places are those of the model's own markers where it has the landmark, else read off its bones, 1 to
2 cm outside. Head markers are left out: the head is one with the trunk in this model.
"""


def with_plug_in_gait(model: mm.Model) -> mm.Model:
    """Return a model in Rajagopal's frames with these markers alone.

    The left ones are the right ones mirrored.
    """
    markers: list[Marker] = []
    for name, body, place, _ in PLUG_IN_GAIT:
        markers.append(Marker(name, body, np.array(place)))
        if name[0] == "R" and name != "RBAK":
            stem, side = split_side(body)
            other = f"{stem}_l" if side else body
            markers.append(Marker(f"L{name[1:]}", other, np.array(place) * (1.0, 1.0, -1.0)))
    return replace(model, markers=tuple(markers))
