"""Two simulated fighters on one mat as models of MuJoCo, with the grips that join them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from myomorph.model.arrays import Array
from myomorph.simulate.fighter import LEG, Build, fighter_mjcf

STEP = 1e-3
"""Of the integrator [s]."""
PARTS = ("tori", "uke")
APART = 0.32
"""Distance of the two pelves at the start [m]."""
LAPEL = np.array([0.11, 0.33, -0.14])
"""Where tori's right hand holds uke, in uke's torso for a body of `HEIGHT` [m]."""
CUFF = np.array([0.03, -0.05, 0.0])
"""Where the sleeve that tori's left hand holds is sewn on, in uke's right forearm [m]."""
SLEEVE_LENGTH, SLEEVE_STIFFNESS, SLEEVE_DAMPING = 0.06, 4000.0, 30.0
"""Of the sleeve between fist and forearm; it can only pull [m, N/m, N s/m]."""

HEAD = f"""
<mujoco>
  <compiler angle="radian" autolimits="false"><lengthrange mode="none"/></compiler>
  <option gravity="0 -9.80665 0" timestep="{STEP}" integrator="implicitfast" cone="elliptic" impratio="20"
    jacobian="dense" solver="Newton" iterations="50" tolerance="1e-10"/>
  <default>
    <default class="sole"><geom type="sphere" size="0.01" mass="0" contype="1" conaffinity="2" friction="1 0 0"
      condim="3" solref="0.006 1" solimp="0.95 0.99 0.001"/></default>
    <default class="shown"><geom type="ellipsoid" mass="0" contype="0" conaffinity="0" group="1"/></default>
    <default class="muscle"><general gaintype="muscle" biastype="muscle" dyntype="none" ctrllimited="true"
      ctrlrange="0 1"/></default>
  </default>
"""
FLOOR = (
    '<geom name="mat" type="plane" size="4 4 0.1" euler="-1.5707963267948966 0 0" contype="2" conaffinity="1" '
    'friction="1 0 0" condim="3" solref="0.006 1" solimp="0.95 0.99 0.001"/>'
)


def compile_pair(builds: Mapping[str, Build]) -> Any:
    """Both fighters face to face, tori gripping uke's lapel and sleeve."""
    fragments = []
    for part, place, turn in zip(PARTS, (0.0, APART), (0.0, np.pi), strict=True):
        fragments.append(fighter_mjcf(f"{part}_", builds[part], (place, builds[part].size * LEG, 0.0), turn))
    s = builds["uke"].size
    trees = "".join(tree for tree, _, _ in fragments)
    trees = _with_site(trees, "uke_torso", "lapel", s * LAPEL)
    trees = _with_site(trees, "uke_forearm_r", "cuff", s * CUFF)
    tendons = "".join(one for _, one, _ in fragments)
    actuators = "".join(one for _, _, one in fragments)
    sleeve = (
        f'<spatial name="sleeve" stiffness="{SLEEVE_STIFFNESS}" damping="{SLEEVE_DAMPING}" '
        f'springlength="0 {SLEEVE_LENGTH}"><site site="tori_grip_l"/><site site="cuff"/></spatial>'
    )
    return mujoco.MjModel.from_xml_string(
        f"{HEAD}<worldbody>{FLOOR}{trees}</worldbody><tendon>{tendons}{sleeve}</tendon>"
        f'<equality><connect name="lapel" site1="tori_grip_r" site2="lapel" solref="0.006 1"/></equality>'
        f"<actuator>{actuators}</actuator></mujoco>"
    )


def fighter_text(part: str, build: Build) -> str:
    """MJCF of one fighter alone on the mat, its names without its part's before them."""
    turn = 0.0 if part == "tori" else np.pi
    tree, tendons, actuators = fighter_mjcf("", build, (0.0, build.size * LEG, 0.0), turn)
    return (
        f"{HEAD}<worldbody>{FLOOR}{tree}</worldbody><tendon>{tendons}</tendon><actuator>{actuators}</actuator></mujoco>"
    )


def _with_site(tree: str, body: str, name: str, place: Array) -> str:
    start = tree.index(">", tree.index(f'<body name="{body}"')) + 1
    return f'{tree[:start]}<site name="{name}" pos="{" ".join(map(repr, map(float, place)))}"/>{tree[start:]}'


def with_fibers(builds: Mapping[str, Build], compiled: Any, qpos: Array) -> dict[str, Build]:
    """The builds with muscles whose fibers have their optimal length in a pose (nq,) of the pair."""
    data = mujoco.MjData(compiled)
    data.qpos[:] = qpos
    mujoco.mj_fwdPosition(compiled, data)
    lengths = {compiled.actuator(i).name: float(data.actuator_length[i]) for i in range(compiled.nu)}
    return {
        part: replace(
            build,
            paths={name[len(part) + 1 :]: one for name, one in lengths.items() if name.startswith(f"{part}_")},
        )
        for part, build in builds.items()
    }
