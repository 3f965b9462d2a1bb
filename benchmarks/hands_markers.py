"""Plug-in Gait's markers on the Rajagopal model, by their anatomical definitions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import myomorph as mm
from myomorph.model.model import Marker
from myomorph.model.sides import split_side

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
    ("RFIN", "hand_r", (-0.015, -0.080, 0.014), "back of the hand below the head of the second metacarpal"),
)
"""Name, body, place in the body's frame [m] and what it lies on: the guide to Plug-in Gait (Vicon).

Places are those of the model's own markers where it has the landmark, else read off its bones, 1 to 2 cm outside.
Head markers are left out: the head is one with the trunk in this model.
"""


def with_plug_in_gait(model: mm.Model) -> mm.Model:
    """A model in Rajagopal's frames with these markers alone, the left as the right mirrored."""
    markers: list[Marker] = []
    for name, body, place, _ in PLUG_IN_GAIT:
        markers.append(Marker(name, body, np.array(place)))
        if name[0] == "R" and name != "RBAK":
            stem, side = split_side(body)
            other = f"{stem}_l" if side else body
            markers.append(Marker(f"L{name[1:]}", other, np.array(place) * (1.0, 1.0, -1.0)))
    return replace(model, markers=tuple(markers))
