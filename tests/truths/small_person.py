"""A person of eleven boxes in MuJoCo, which moves and is weighed in seconds."""

from __future__ import annotations

from typing import Any

import mujoco

SIZE = {
    "pelvis": 0.12,
    "torso": 0.22,
    "humerus": 0.14,
    "ulna": 0.12,
    "femur": 0.2,
    "tibia": 0.2,
    "calcn": 0.1,
}
BALL = (
    '<joint name="{0}_x" axis="1 0 0" range="-0.9 0.9"/><joint name="{0}_y" axis="0 1 0"'
    ' range="-0.9 0.9"/>' + '<joint name="{0}_z" axis="0 0 1" range="-0.9 0.9"/>'
)
HINGE = '<joint name="{0}_flexion" axis="0 1 0" range="0.1 1.5"/>'


def body(name: str, place: str, joints: str, inside: str = "") -> str:
    """Write a box with its joints, at a place on its parent, and what hangs on it."""
    half = SIZE[name.split("_")[0]]
    return (
        f'<body name="{name}" pos="{place}">{joints.format(name)}<geom type="box" size="0.05 0.06'
        f' {half}" pos="0.01 0.01 -{half}" density="700"/>{inside}</body>'
    )


def person() -> Any:
    """Compile eleven bodies that stand on two feet."""
    limbs = ""
    for side, y in (("r", -1.0), ("l", 1.0)):
        shank = body(f"tibia_{side}", "0 0 -0.4", HINGE, body(f"calcn_{side}", "0 0 -0.4", HINGE))
        limbs += body(f"femur_{side}", f"0 {0.09 * y} -0.1", BALL, shank)
    arms = "".join(
        body(f"humerus_{side}", f"0 {y} 0.45", BALL, body(f"ulna_{side}", "0 0 -0.28", HINGE))
        for side, y in (("r", -0.2), ("l", 0.2))
    )
    tree = body(
        "pelvis",
        "0 0 1",
        "<freejoint name='root'/>",
        body("torso", "-0.05 0 0.1", BALL, arms) + limbs,
    )
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><compiler angle='radian'/><worldbody>{tree}</worldbody></mujoco>"
    )
