"""A simulated fighter of 29 degrees of freedom and 62 muscles, as a model of MuJoCo.

Two of them on one mat are another. Masses are shares of the whole as de Leva (1996) gives them for
men. Muscles run straight between points that were laid by hand so that each joint can turn both
ways; they are no anatomy. Axes: x forward, y up, z right.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np

from myomorph.core.io.mjcf.write import text
from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap, grouped

HEIGHT = 1.75  # Of the body whose measures stand below [m].
Point = tuple[str, float, float, float]


@dataclass(frozen=True)
class Segment:
    """A body: its joints on its parent, and what it is made of."""

    name: str
    parent: str
    place: tuple[float, float, float]  # (3,) of its origin in the parent's frame [m]
    joints: tuple[tuple[str, tuple[int, int, int]], ...]  # names of hinges and their axes in order
    share: float  # of the body's mass
    center: tuple[float, float, float]  # (3,) mass center [m]
    size: tuple[float, float, float]  # (3,) half sizes of the box whose inertia it has [m]


X = (1, 0, 0)
Y = (0, 1, 0)
Z = (0, 0, 1)
LUMBAR = (("lumbar_flexion", Z), ("lumbar_bending", X), ("lumbar_rotation", Y))
HIP = (("hip_flexion", Z), ("hip_adduction", X), ("hip_rotation", Y))
ANKLE = (("ankle_angle", Z), ("subtalar_angle", X))
SHOULDER = (("arm_flex", Z), ("arm_add", X), ("arm_rot", Y))
ELBOW = (("elbow_flex", Z),)
MIDDLE = (
    Segment(
        name="pelvis",
        parent="",
        place=(0.0, 0.0, 0.0),
        joints=(),
        share=0.112,
        center=(-0.01, 0.05, 0.0),
        size=(0.08, 0.09, 0.15),
    ),
    Segment(
        name="torso",
        parent="pelvis",
        place=(-0.03, 0.12, 0.0),
        joints=LUMBAR,
        share=0.392,
        center=(0.02, 0.27, 0.0),
        size=(0.09, 0.26, 0.15),
    ),
)
SIDED = (
    Segment(
        name="thigh",
        parent="pelvis",
        place=(0.0, 0.0, 0.09),
        joints=HIP,
        share=0.142,
        center=(0.0, -0.17, 0.0),
        size=(0.06, 0.21, 0.06),
    ),
    Segment(
        name="shank",
        parent="thigh",
        place=(0.0, -0.42, 0.0),
        joints=(("knee_angle", Z),),
        share=0.043,
        center=(0.0, -0.18, 0.0),
        size=(0.04, 0.2, 0.04),
    ),
    Segment(
        name="foot",
        parent="shank",
        place=(0.0, -0.42, 0.0),
        joints=ANKLE,
        share=0.014,
        center=(0.05, -0.04, 0.0),
        size=(0.12, 0.03, 0.04),
    ),
    Segment(
        name="upperarm",
        parent="torso",
        place=(0.03, 0.38, 0.18),
        joints=SHOULDER,
        share=0.027,
        center=(0.0, -0.14, 0.0),
        size=(0.04, 0.14, 0.04),
    ),
    Segment(
        name="forearm",
        parent="upperarm",
        place=(0.0, -0.28, 0.0),
        joints=ELBOW,
        share=0.022,
        center=(0.0, -0.15, 0.0),
        size=(0.03, 0.17, 0.03),
    ),
)
GRIP = (0.0, -0.32, 0.0)  # Middle of the fist in the forearm [m].
SOLE = {
    "heel_in": (-0.06, -0.035),
    "heel_out": (-0.06, 0.035),
    "toe_in": (0.18, -0.05),
    "toe_out": (0.18, 0.05),
}
"""Corners of the right sole: x and z in the foot's frame [m]."""
SOLE_HEIGHT = 0.075  # Of the ankle above the sole [m].
LEG = 0.42 + 0.42 + SOLE_HEIGHT  # From the hip to the mat, straight [m].
BALL = 0.01  # Radius of the balls that the soles stand on [m].
HEAD = ((0.03, 0.62, 0.0), (0.09, 0.12, 0.08))
"""Where the head is seen on the trunk, and its half sizes [m]; its mass is part of the trunk's."""
# Share of a muscle's path in the first pose that is optimal fiber; the rest is tendon.
FIBER_SHARE = 0.6
RANGE = (0.75, 1.05)  # Lengths of fibers at the ends of MuJoCo's range of lengths, in optimal ones.

# Name, maximum isometric force [N] and points of the right side (body; a * before it takes the left
# one's).
SIDE_MUSCLES: tuple[tuple[str, float, tuple[Point, ...]], ...] = (
    (
        "glut_max",
        2200,
        (
            ("pelvis", -0.10, 0.06, 0.05),
            ("pelvis", -0.085, -0.03, 0.07),
            ("thigh", -0.025, -0.2, 0.03),
        ),
    ),
    ("glut_med", 2000, (("pelvis", -0.02, 0.11, 0.10), ("thigh", -0.005, -0.03, 0.065))),
    ("glut_ant", 1000, (("pelvis", 0.05, 0.09, 0.12), ("thigh", 0.01, -0.03, 0.065))),
    ("glut_post", 1000, (("pelvis", -0.09, 0.09, 0.07), ("thigh", -0.02, -0.03, 0.065))),
    (
        "iliopsoas",
        2200,
        (("pelvis", -0.02, 0.12, 0.04), ("pelvis", 0.05, 0.0, 0.08), ("thigh", -0.01, -0.06, 0.0)),
    ),
    ("add_mag", 2000, (("pelvis", -0.04, -0.06, 0.02), ("thigh", 0.0, -0.22, 0.01))),
    ("add_long", 900, (("pelvis", 0.04, -0.03, 0.02), ("thigh", 0.01, -0.2, 0.0))),
    ("rotators", 900, (("pelvis", -0.10, 0.02, 0.02), ("thigh", -0.015, 0.0, 0.05))),
    (
        "rect_fem",
        1300,
        (("pelvis", 0.04, 0.04, 0.1), ("thigh", 0.055, -0.39, 0.0), ("shank", 0.05, -0.04, 0.0)),
    ),
    (
        "vasti",
        5000,
        (("thigh", 0.04, -0.2, 0.01), ("thigh", 0.055, -0.39, 0.0), ("shank", 0.05, -0.04, 0.0)),
    ),
    ("semimem", 1800, (("pelvis", -0.06, -0.05, 0.07), ("shank", -0.035, -0.06, -0.02))),
    ("bifemlh", 1400, (("pelvis", -0.06, -0.05, 0.08), ("shank", -0.035, -0.06, 0.03))),
    ("gas_lat", 2500, (("thigh", -0.03, -0.4, 0.0), ("foot", -0.055, -0.03, 0.0))),
    ("soleus", 4500, (("shank", -0.02, -0.1, 0.0), ("foot", -0.055, -0.035, 0.0))),
    (
        "tib_ant",
        1600,
        (
            ("shank", 0.03, -0.1, 0.01),
            ("shank", 0.035, -0.38, -0.01),
            ("foot", 0.07, -0.02, -0.025),
        ),
    ),
    (
        "peroneus",
        1600,
        (("shank", 0.0, -0.1, 0.03), ("shank", -0.02, -0.41, 0.03), ("foot", 0.0, -0.055, 0.035)),
    ),
    (
        "tib_post",
        2000,
        (
            ("shank", -0.01, -0.1, 0.0),
            ("shank", -0.02, -0.41, -0.025),
            ("foot", 0.03, -0.05, -0.025),
        ),
    ),
    ("erector_spinae", 3500, (("pelvis", -0.08, 0.06, 0.04), ("torso", -0.06, 0.15, 0.04))),
    ("rect_abd", 1200, (("pelvis", 0.07, 0.0, 0.03), ("torso", 0.11, 0.2, 0.04))),
    ("ext_obl", 1400, (("pelvis", 0.08, 0.02, 0.03), ("torso", 0.06, 0.15, 0.13))),
    ("int_obl", 1400, (("pelvis", 0.0, 0.1, 0.12), ("torso", 0.11, 0.15, 0.02))),
    ("quad_lumb", 900, (("pelvis", -0.04, 0.09, 0.1), ("torso", -0.02, 0.12, 0.08))),
    ("delt_ant", 1400, (("torso", 0.09, 0.41, 0.15), ("upperarm", 0.015, -0.12, 0.02))),
    ("delt_mid", 1800, (("torso", 0.03, 0.43, 0.21), ("upperarm", 0.0, -0.12, 0.035))),
    ("supraspin", 900, (("torso", 0.0, 0.42, 0.08), ("upperarm", 0.0, 0.025, 0.03))),
    ("delt_post", 1200, (("torso", -0.04, 0.40, 0.15), ("upperarm", -0.01, -0.12, 0.025))),
    ("pectoralis", 1400, (("torso", 0.13, 0.30, 0.03), ("upperarm", 0.01, -0.10, -0.01))),
    (
        "lat_dorsi",
        1400,
        (
            ("torso", -0.06, 0.14, 0.08),
            ("torso", -0.05, 0.28, 0.15),
            ("upperarm", 0, -0.07, -0.015),
        ),
    ),
    ("infraspin", 2600, (("torso", -0.07, 0.34, 0.10), ("upperarm", 0.0, -0.01, 0.035))),
    ("subscap", 2200, (("torso", -0.02, 0.35, 0.06), ("upperarm", 0.03, -0.01, -0.005))),
    (
        "bic_long",
        1000,
        (
            ("torso", 0.06, 0.41, 0.165),
            ("upperarm", 0.03, -0.12, 0.0),
            ("forearm", 0.015, -0.045, 0.0),
        ),
    ),
    ("brachialis", 1200, (("upperarm", 0.02, -0.15, 0.0), ("forearm", 0.015, -0.04, 0.0))),
    (
        "tri_lat",
        2200,
        (
            ("torso", 0.0, 0.35, 0.16),
            ("upperarm", -0.03, -0.25, 0.0),
            ("forearm", -0.028, 0.015, 0.0),
        ),
    ),
)
MARKED = {
    "pelvis": ((0.08, 0.09, 0.12), (0.08, 0.09, -0.12), (-0.1, 0.09, 0.04), (-0.1, 0.09, -0.04)),
    "torso": ((0.12, 0.2, 0.0), (-0.08, 0.3, 0.0), (0.03, 0.42, 0.15), (0.03, 0.42, -0.15)),
    "thigh": ((0.07, -0.15, 0.03), (0.0, -0.3, 0.07), (0.0, -0.4, -0.05)),
    "shank": ((0.05, -0.1, 0.02), (0.03, -0.28, 0.04), (0.0, -0.42, 0.045)),
    "foot": ((-0.06, -0.03, 0.0), (0.12, -0.03, 0.05), (0.13, -0.03, -0.04)),
    "upperarm": ((0.04, -0.1, 0.03), (0.0, -0.2, 0.05), (0.03, -0.27, -0.02)),
    "forearm": ((0.03, -0.1, 0.02), (0.02, -0.24, 0.03), (-0.01, -0.25, -0.03)),
}
"""Places of markers on bodies, of the right side for those that come twice [m]."""


@dataclass(frozen=True)
class Build:
    """How one fighter differs from the tables."""

    mass: float = 75.0  # [kg]
    height: float = HEIGHT  # [m]
    strength: float = 1.0  # of all muscles, as a factor
    # of single muscles by name, factors beside that
    strengths: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    # lengths of muscles' paths by name where their fibers have their optimal length [m]; muscles of
    # no length where it is empty
    paths: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))

    @property
    def size(self) -> float:
        """Of lengths, against the tables."""
        return self.height / HEIGHT


def segments() -> Iterator[Segment]:
    """All segments, parents first, both sides named."""
    yield from MIDDLE
    for side, sign in (("r", 1.0), ("l", -1.0)):
        for segment in SIDED:
            parent = (
                segment.parent
                if segment.parent in ("pelvis", "torso")
                else f"{segment.parent}_{side}"
            )
            # Mirrored axes: the same sign means the same movement on both sides.
            joints = tuple(
                (f"{name}_{side}", axis if axis == Z else tuple(int(sign) * x for x in axis))
                for name, axis in segment.joints
            )
            place = (segment.place[0], segment.place[1], sign * segment.place[2])
            yield Segment(
                name=f"{segment.name}_{side}",
                parent=parent,
                place=place,
                joints=joints,  # type: ignore[arg-type]
                share=segment.share,
                center=segment.center,
                size=segment.size,
            )


def muscle_points() -> dict[str, tuple[float, tuple[Point, ...]]]:
    """Strength [N] and points of all muscles by name, both sides."""
    result = {}
    for name, force, points in SIDE_MUSCLES:
        for side, sign in (("r", 1.0), ("l", -1.0)):
            placed = tuple((_sided(body, side), x, y, sign * z) for body, x, y, z in points)
            result[f"{name}_{side}"] = (float(force), placed)
    return result


def sole_points(side: str) -> dict[str, Array]:
    """Return the corners of a sole in the foot's frame, for a body of `HEIGHT`.

    Parameters
    ----------
    side : "r" or "l"

    Returns
    -------
    (3,) by name [m]
    """
    sign = 1.0 if side == "r" else -1.0
    return {name: np.array([x, -SOLE_HEIGHT, sign * z]) for name, (x, z) in SOLE.items()}


def marker_points() -> dict[str, tuple[str, Array]]:
    """Return where all markers are, for a body of `HEIGHT`.

    Returns
    -------
    By name the body, and the (3,) position in its frame [m]
    """
    result = {}
    for body, places in MARKED.items():
        sides = (("", 1.0),) if body in ("pelvis", "torso") else (("r", 1.0), ("l", -1.0))
        for side, sign in sides:
            for index, (x, y, z) in enumerate(places):
                whole = _sided(body, side) if side else body
                result[f"{whole}_{index + 1}"] = (whole, np.array([x, y, sign * z]))
    return result


def _sided(body: str, side: str) -> str:
    return body if body in ("pelvis", "torso") else f"{body}_{side}"


def fighter_mjcf(
    prefix: str, build: Build, place: tuple[float, float, float], turn: float
) -> tuple[str, str, str]:
    """Write the fighter as text: its tree of bodies, its tendons and its actuators.

    `turn` is about the vertical [rad].
    """
    s = build.size
    children = grouped((segment.parent, segment) for segment in segments())
    sites: dict[str, list[str]] = {segment.name: [] for segment in segments()}
    for name, (body, place_on) in marker_points().items():
        sites[body].append(f'<site name="{prefix}marker_{name}" pos="{text(s * place_on)}"/>')
    for side in "rl":
        sites[f"forearm_{side}"].append(
            f'<site name="{prefix}grip_{side}" pos="{text(s * np.array(GRIP))}"/>'
        )
    tendons = []
    actuators = []
    for name, (force, points) in muscle_points().items():
        path = []
        for index, (body, *at) in enumerate(points):
            sites[body].append(
                f'<site name="{prefix}{name}-{index}" pos="{text(s * np.array(at))}"/>'
            )
            path.append(f'<site site="{prefix}{name}-{index}"/>')
        tendons.append(f'<spatial name="{prefix}{name}_tendon">{"".join(path)}</spatial>')
        strength = force * build.strength * build.strengths.get(name, 1.0)
        actuators.append(_muscle(f"{prefix}{name}", strength, build.paths.get(name, 0.0)))

    def tree(segment: Segment) -> str:
        inner = [
            _joints(segment, prefix),
            _inertial(segment, build),
            *_geoms(segment, prefix, s),
            *sites[segment.name],
        ]
        inner += [tree(child) for child in children.get(segment.name, [])]
        if segment.parent:
            start = f'pos="{text(s * np.array(segment.place))}"'
        else:
            start = f'pos="{text(place)}" euler="0 {turn!r} 0"'
        return f'<body name="{prefix}{segment.name}" {start}>{"".join(inner)}</body>'

    return tree(MIDDLE[0]), "".join(tendons), "".join(actuators)


def _joints(segment: Segment, prefix: str) -> str:
    if not segment.joints:
        return f'<freejoint name="{prefix}{segment.name}"/>'
    return "".join(
        f'<joint name="{prefix}{name}" axis="{text(axis)}"/>' for name, axis in segment.joints
    )


def _inertial(segment: Segment, build: Build) -> str:
    mass = segment.share * build.mass
    square = (build.size * np.array(segment.size)) ** 2
    moments = mass / 3.0 * (square.sum() - square)
    place = build.size * np.array(segment.center)
    return f'<inertial mass="{mass!r}" pos="{text(place)}" diaginertia="{text(moments)}"/>'


def _geoms(segment: Segment, prefix: str, s: float) -> list[str]:
    """Write what is seen of a segment, and what of a foot stands on the mat."""
    shown = [(segment.center, segment.size), *([HEAD] if segment.name == "torso" else [])]
    geoms = [
        f'<geom class="shown" pos="{text(s * np.array(a))}" size="{text(s * np.array(b))}"/>'
        for a, b in shown
    ]
    if segment.name.startswith("foot"):
        for name, at in sole_points(segment.name[-1]).items():
            geoms.append(
                f'<geom name="{prefix}{segment.name}_{name}" class="sole"'
                f' pos="{text(s * at + (0.0, BALL, 0.0))}"/>'
            )
    return geoms


def _muscle(name: str, force: float, path: float) -> str:
    """Write a muscle without dynamics of activation: its control is its activation."""
    fiber = FIBER_SHARE * path
    low_share, high_share = RANGE
    low = path + (low_share - 1.0) * fiber
    high = path + (high_share - 1.0) * fiber
    parameters = f"{RANGE[0]} {RANGE[1]} {force!r} 200 0.4 1.8 8 1.0 1.4"
    return (
        f'<general name="{name}" tendon="{name}_tendon" class="muscle" gainprm="{parameters}"'
        f' biasprm="{parameters}" lengthrange="{low!r} {high!r}"/>'
    )


STEP = 1e-3  # Of the integrator [s].
PARTS = ("tori", "uke")
APART = 0.32  # Distance of the two pelves at the start [m].
# Where tori's right hand holds uke, in uke's torso for a body of `HEIGHT` [m].
LAPEL = np.array([0.11, 0.33, -0.14])
CUFF = np.array([0.03, -0.05, 0.0])
"""Where the sleeve that tori's left hand holds is sewn on, in uke's right forearm [m]."""
SLEEVE_LENGTH = 0.06
SLEEVE_STIFFNESS = 4000.0
SLEEVE_DAMPING = 30.0
"""Of the sleeve between fist and forearm; it can only pull [m, N/m, N s/m]."""

SETUP = f"""
<mujoco>
  <compiler angle="radian" autolimits="false"><lengthrange mode="none"/></compiler>
  <option gravity="0 -9.80665 0" timestep="{STEP}" integrator="implicitfast" \
cone="elliptic" impratio="20"
    jacobian="dense" solver="Newton" iterations="50" tolerance="1e-10"/>
  <default>
    <default class="sole">\
<geom type="sphere" size="0.01" mass="0" contype="1" conaffinity="2" friction="1 0 0"
      condim="3" solref="0.006 1" solimp="0.95 0.99 0.001"/></default>
    <default class="shown"><geom type="ellipsoid" mass="0" contype="0" conaffinity="0" group="1"/>\
</default>
    <default class="muscle">\
<general gaintype="muscle" biastype="muscle" dyntype="none" ctrllimited="true"
      ctrlrange="0 1"/></default>
  </default>
"""
FLOOR = (
    '<geom name="mat" type="plane" size="4 4 0.1" euler="-1.5707963267948966 0 0" contype="2"'
    ' conaffinity="1" friction="1 0 0" condim="3" solref="0.006 1" solimp="0.95 0.99 0.001"/>'
)


def compile_pair(builds: Mapping[str, Build]) -> Any:
    """Both fighters face to face, tori gripping uke's lapel and sleeve."""
    fragments = [
        fighter_mjcf(f"{part}_", builds[part], (place, builds[part].size * LEG, 0.0), turn)
        for part, place, turn in zip(PARTS, (0.0, APART), (0.0, np.pi), strict=True)
    ]
    s = builds["uke"].size
    trees, tendons, actuators = map("".join, zip(*fragments, strict=True))
    trees = _with_site(trees, "uke_torso", "lapel", s * LAPEL)
    trees = _with_site(trees, "uke_forearm_r", "cuff", s * CUFF)
    sleeve = (
        f'<spatial name="sleeve" stiffness="{SLEEVE_STIFFNESS}" damping="{SLEEVE_DAMPING}" '
        f'springlength="0 {SLEEVE_LENGTH}"><site site="tori_grip_l"/><site site="cuff"/></spatial>'
    )
    return mujoco.MjModel.from_xml_string(
        f"{SETUP}<worldbody>{FLOOR}{trees}</worldbody><tendon>{tendons}{sleeve}</tendon>"
        f'<equality><connect name="lapel" site1="tori_grip_r" site2="lapel" solref="0.006'
        f' 1"/></equality>'
        f"<actuator>{actuators}</actuator></mujoco>"
    )


def fighter_text(part: str, build: Build) -> str:
    """MJCF of one fighter alone on the mat, its names without its part's before them."""
    turn = 0.0 if part == "tori" else np.pi
    tree, tendons, actuators = fighter_mjcf("", build, (0.0, build.size * LEG, 0.0), turn)
    driven = f"<tendon>{tendons}</tendon><actuator>{actuators}</actuator>"
    return f"{SETUP}<worldbody>{FLOOR}{tree}</worldbody>{driven}</mujoco>"


def _with_site(tree: str, body: str, name: str, place: Array) -> str:
    start = tree.index(">", tree.index(f'<body name="{body}"')) + 1
    return f'{tree[:start]}<site name="{name}" pos="{text(place)}"/>{tree[start:]}'


def misjudged(build: Build, error: float, random: np.random.Generator) -> Build:
    """Draw a build whose muscles' strengths are not well known."""
    factors = np.exp(error * random.standard_normal(len(build.paths)))
    return replace(build, strengths=dict(zip(build.paths, factors.tolist(), strict=True)))


def with_fibers(builds: Mapping[str, Build], compiled: Any, qpos: Array) -> dict[str, Build]:
    """Give the muscles of builds fibers that have their optimal length in a pose.

    Parameters
    ----------
    builds : by fighter, "" of one alone
    compiled : mujoco.MjModel of them
    qpos : (nq,) the pose

    Returns
    -------
    The builds, with the lengths of their muscles' paths [m]
    """
    data = mujoco.MjData(compiled)
    data.qpos[:] = qpos
    mujoco.mj_fwdPosition(compiled, data)
    lengths = {
        compiled.actuator(i).name: float(data.actuator_length[i]) for i in range(compiled.nu)
    }
    begins = {part: f"{part}_" if part else "" for part in builds}
    paths = {
        part: {
            name.removeprefix(begin): length
            for name, length in lengths.items()
            if name.startswith(begin)
        }
        for part, begin in begins.items()
    }
    return {part: replace(build, paths=paths[part]) for part, build in builds.items()}
