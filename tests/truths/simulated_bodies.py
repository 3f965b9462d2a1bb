"""The generic bodies that simulated subjects are made from.

They have the markers that a laboratory would put on them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

import myomorph as mm
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Coupler, Joint, Marker
from myomorph.core.model.segments import segments_of

TETRAHEDRON = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
CLUSTERS = FrozenMap(
    {"pelvis": 0.08, "torso": 0.10, "head": 0.08}
    | {
        f"{name}_{side}": size
        for side in "rl"
        for name, size in (
            ("femur", 0.07),
            ("tibia", 0.06),
            ("calcn", 0.04),
            ("toes", 0.02),
            ("scapula", 0.04),
            ("humerus", 0.05),
            ("radius", 0.04),
            ("thirdmc", 0.025),
        )
    }
)
"""Bodies of MyoFullBody that carry four markers, half an edge of the cube they are corners of [m].
"""
LUMBAR = "L5_S1_* L4_L5_* L3_L4_* L2_L3_* L1_L2_*"
SLIDING = ("SternumX", "SternumY", "SternumZ")
FINGERS = ("cmc_", "mp_", "ip_", "mcp", "pm", "md")


def full_body(free: bool = False) -> tuple[Any, mm.Model]:
    """MyoFullBody in MuJoCo and as ours, with clusters of four markers on 17 bodies.

    Fingers are still, as no marker shows them, unless `free`.
    """
    import musclemimic_models

    compiled = mujoco.MjModel.from_xml_path(str(musclemimic_models.get_xml_path("myofullbody")))
    model = model_from_mujoco(compiled, name="MyoFullBody", source="MyoFullBody")
    coordinates = tuple(
        replace(one, locked=one.locked or (not free and one.name.startswith(FINGERS)))
        for one in model.coordinates
    )
    markers = []
    for name, size in CLUSTERS.items():
        for i, offset in enumerate(TETRAHEDRON):
            markers.append(
                Marker(f"{name}_{i + 1}", name, model.body(name).mass_center + size * offset)
            )
    return compiled, replace(model, coordinates=coordinates, markers=tuple(markers))


def many_coordinates(model: mm.Model, free: bool = False) -> mm.Model:
    """Return the 171-coordinate model with ranges that a spine has.

    It has four markers on the head and three on each hand. Its vertebrae, ribs and breast bone move
    as they like only if `free`, when no marker has to show them; otherwise the five lumbar joints
    share each bend and rotate evenly, and the chest is stiff.
    """
    lumbar = [LUMBAR.replace("*", axis).split() for axis in ("FE", "LB", "AR")]
    used = {name for names in lumbar for name in names}
    inside = _joints_of_the_trunk(model)
    coordinates = []
    for one in model.coordinates:
        moves = free or one.name in used or one.name not in inside
        if one.name.startswith(("wrist_", "mtp_")):
            moves = free or one.name.startswith("wrist_")
        if one.name in inside:
            reach = _reach(one.name, inside[one.name], used)
            one = replace(one, range=(one.default - reach, one.default + reach), clamped=True)
        coordinates.append(replace(one, locked=not moves))
    return replace(
        model,
        coordinates=tuple(coordinates),
        couplers=(*model.couplers, *(() if free else _shared_bends(lumbar))),
        markers=(*model.markers, *_head_and_hands(model)),
    )


def _shared_bends(lumbar: list[list[str]]) -> list[Coupler]:
    """Make the lumbar joints follow the first of them about each axis."""
    return [
        Coupler(name=f"{one}_follows", dependent=one, function=linear(1.0), independents=(first,))
        for first, *others in lumbar
        for one in others
    ]


def _joints_of_the_trunk(model: mm.Model) -> dict[str, Joint]:
    """Return the joint of each coordinate between bodies of the trunk."""
    trunk = {"lower_trunk", "upper_trunk"}
    segments = segments_of(model)
    return {
        name: joint
        for joint in model.joints
        for name in joint.coordinates
        if joint.parent != GROUND
        and {segments[joint.parent].name, segments[joint.child].name} <= trunk
    }


def _reach(name: str, joint: Joint, used: set[str]) -> float:
    """Return how far a coordinate of the trunk goes to either side [rad or m]."""
    if name in SLIDING:
        return 0.004
    if name in used:
        return 0.12
    return 0.08 if "vertebra" in joint.child else 0.05


def _head_and_hands(model: mm.Model) -> list[Marker]:
    """Return four markers on the head and three on each hand."""
    clusters = (
        ("head_neck", 0.08, TETRAHEDRON),
        ("hand_r", 0.03, TETRAHEDRON[:3]),
        ("hand_l", 0.03, TETRAHEDRON[:3]),
    )
    return [
        Marker(f"{body}_{i + 1}", body, model.body(body).mass_center + size * offset)
        for body, size, offsets in clusters
        for i, offset in enumerate(offsets)
    ]
