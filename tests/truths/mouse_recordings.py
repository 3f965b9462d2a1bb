"""Real mice and the models that their recordings are fitted to.

Both hindlimbs by an anatomist, and a whole skeleton.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

import myomorph as mm
from myomorph.bones.morph.mirror.model import with_other_side
from myomorph.bones.morph.species.masses import with_markers_of
from myomorph.bones.study.species_morphing import read_species
from myomorph.core.io.mjcf.read import read_mjcf
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import GROUND, Coordinate, Joint, Marker
from myomorph.core.motion.measurements import default_markers
from myomorph.core.surfaces.linear_maps import procrustes
from myomorph.lab.study.inputs.reading import fitted_to
from truths.mouse_hindlimb import FILE, mouse_hindlimb_model

GAIT = "mouse-gait-c3d-force"
TREADMILL = "mouse-markers-treadmill/treadmill_15m_per_min.mat"
SKELETON = "mouse-skeleton-keypoints"
KEYPOINTS = f"{SKELETON}/mouse_mocap_3600_frames.h5"

GAIT_LABELS = FrozenMap(
    {
        "RASI": "Right_Illiac",
        "LASI": "Left_Illiac",
        "RightHIP": "Right_Hip",
        "LeftHIP": "Left_Hip",
        "LEFT_HIP": "Left_Hip",
        "RightKNEE": "Right_Knee",
        "LeftKNEE": "Left_Knee",
        "RightANKLE": "Right_Ankle",
        "LeftANKLE": "Left_Ankle",
        "RightMET": "Right_Met",
        "LeftMET": "Left_Met",
        "TAIL": "Tail",
        "Spine": "Spine",
    }
)
"""Labels of mouse-gait-c3d-force, which differ from file to file, and what the model calls these
markers.
"""

TREADMILL_LABELS = FrozenMap(
    {
        f"{side}_{label}": f"{side.capitalize()}_{name}"
        for side in ("right", "left")
        for label, name in (
            ("hip", "Hip"),
            ("coord", "Illiac"),
            ("back", "Back"),
            ("knee", "Knee"),
            ("ankle", "Ankle"),
        )
    }
)

MIDLINE = FrozenMap({"Tail": (-0.014, 0.002, 0.0), "Spine": (0.004, 0.006, 0.0)})
"""Where two markers of the pelvis that the table lacks are about, from their distances to the
others [m].
"""

BACK = (0.031, 0.005, 0.006)
"""Where the treadmill mouse's right marker on the back is about, by its distances to others, on the
pelvis [m].
"""

CROUCHED = FrozenMap({"Hip_flexion": 0.2, "Knee_extension": -2.0, "Ankle_flexion": 0.3})
"""Where searches for a pose begin: a mouse that stands, for the table's straight hanging legs lie
at bounds [rad].
"""

LOOSE = FrozenMap({"Right_Knee": 0.1, "Left_Knee": 0.1})
"""Weights of markers on loose skin: over the knee it slides by a third of the thigh's length (seen
here: the markers of knee and ankle are 10 to 19 mm apart, on bones 19 mm long).
"""

ADDUCTION = (-0.7, 0.35)
"""Range of the hip's adduction, which the table leaves without bounds [rad]."""


def gait_files(folder: Path) -> tuple[Path, ...]:
    """Return recordings of mice that trot over a plate; () where the data set is absent."""
    return tuple(sorted((folder / GAIT).glob("*.c3d")))


def both_hindlimbs(folder: Path, back: bool = False) -> mm.Model:
    """Join the anatomist's right hindlimb and its mirror image on a pelvis that moves freely.

    The markers are the recordings'.

    Freed: the pelvis' rotations and the hip's rotation, which the table locks; the pelvis rotates
    about y, z, x in this order, for about x, y, z a mouse that runs along z would stand where these
    angles are not unique. Locked: the toes, which no marker shows. The left iliac marker, which the
    table has on the right, is put on the left. By default it stands on bent legs.

    Parameters
    ----------
    folder : of the data collection
    back : with two markers on the back, as on the treadmill; else with those of spine and tail
    """
    right = mouse_hindlimb_model(folder / FILE)
    right = replace(
        right,
        coordinates=tuple(_freed(one) for one in right.coordinates),
        joints=tuple(_heading_first(one) for one in right.joints),
    )
    model = with_other_side(right)
    mirror = np.array([1.0, 1.0, -1.0])
    own = [
        replace(one, location=one.location * mirror) if one.name == "Left_Illiac" else one
        for one in model.markers
    ]
    added = (
        {"Right_Back": np.array(BACK), "Left_Back": np.array(BACK) * mirror} if back else MIDLINE
    )
    own += [Marker(name, "Pelvis", np.array(place)) for name, place in added.items()]
    return model.with_markers(tuple(own))


def _freed(one: Coordinate) -> Coordinate:
    one = next(
        (
            replace(one, default=angle)
            for name, angle in CROUCHED.items()
            if one.name.startswith(name)
        ),
        one,
    )
    if one.name.startswith("PelvisToGround_R"):
        return replace(one, locked=False)
    if one.name.startswith("Hip_rotation"):
        return replace(one, locked=False, clamped=True)
    if one.name.startswith("Hip_adduction"):
        return replace(one, range=ADDUCTION, clamped=True)
    return replace(one, locked=True) if one.name.startswith("MTP") else one


def _heading_first(one: Joint) -> Joint:
    """Return the joint to the ground with its rotations in the order y, z, x.

    Other joints stay as they are.
    """
    if one.parent != GROUND:
        return one
    slides = tuple(axis for axis in one.axes if axis.kind == "translation")
    turns = {
        int(np.argmax(np.abs(axis.vector))): axis for axis in one.axes if axis.kind == "rotation"
    }
    return replace(one, axes=(*slides, turns[1], turns[2], turns[0]))


def recording(path: Path, model: mm.Model, labels: Mapping[str, str]) -> mm.Trial:
    """Read a recording with the model's names of markers, in the model's ground."""
    trial = mm.read_recording(path)
    assert trial.markers is not None
    named = replace(
        trial.markers, names=tuple(labels.get(name, name) for name in trial.markers.names)
    )
    return fitted_to(model, replace(trial, markers=named))


def whole_skeleton(folder: Path) -> mm.Model:
    """Return the skeleton of 100 bones with the 34 keypoints of `human-mouse` as markers.

    The file beside the skeleton gives other bodies for some: its Trunk is on the first thoracic
    vertebra and its Spine on the last, but in the recording the Trunk lies a quarter of the way
    from the base of the tail to the nose, the Spine half way; and its offsets are all zero.
    """
    return with_keypoints(read_mjcf(folder / SKELETON / "mouse_with_meshes.xml"))


def with_keypoints(model: mm.Model) -> mm.Model:
    """Return a model of the skeleton's bones with the keypoints as markers, nothing locked."""
    return with_markers_of(model, read_species("human-mouse").markers, "mouse-keypoints")[0]


def clips(
    folder: Path, model: mm.Model, count: int = 3, frames: int = 360, step: int = 18
) -> tuple[mm.Markers, ...]:
    """Return some of the ten clips of keypoints, evenly spaced, every 18th frame.

    They are rotated to lie along the model. The axes are those of the cameras: each clip is rotated
    as its first frame's points lie best on the model's.
    """
    markers = mm.read_recording(folder / KEYPOINTS).markers
    assert markers is not None
    every = len(markers) // frames
    chosen = np.unique(np.linspace(0, every - 1, count).round().astype(int))
    own = default_markers(model, markers.names)
    found = []
    for k in chosen:
        span = slice(k * frames, (k + 1) * frames, step)
        turn = procrustes(markers.values[k * frames], own, scale=True).rotation
        found.append(
            replace(markers, time=markers.time[span], values=markers.values[span] @ turn.T)
        )
    return tuple(found)
