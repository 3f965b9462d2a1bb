"""A virtual specimen as the files that a laboratory would have: its model in MJCF, markers in TRC, forces in MOT."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from myomorph.io.sto import write_sto
from myomorph.io.trc import write_trc
from myomorph.model.arrays import Array
from myomorph.model.errors import BadModel
from myomorph.model.inertia import inertial_parameters
from myomorph.model.model import Joint
from myomorph.model.paths import WrapObject
from myomorph.model.series import Table, Wrenches
from myomorph.model.spatial import Transform
from myomorph.simulate.limb import fixed_points, quaternion, tendon_wraps
from myomorph.simulate.recording import VirtualTrial, inertial, words
from myomorph.viscosity.specimen.model import Specimen


def write_recording(trial: VirtualTrial, stem: Path) -> None:
    """`<stem>.trc` with the markers and `<stem>.mot` with force, point and torque on the base, in ground."""
    write_trc(trial.markers, stem.with_suffix(".trc"))
    write_sto(loads_table(trial.wrenches), stem.with_suffix(".mot"))


def loads_table(wrenches: Wrenches) -> Table:
    """One wrench as OpenSim writes it, to 1 mN, 1 um and 0.1 mN m, far below the noise."""
    parts = ((wrenches.forces, 3), (wrenches.points, 6), (wrenches.torques, 4))
    columns = np.concatenate([np.round(values[:, 0], digits) for values, digits in parts], axis=1)
    names = [f"{what}{axis}" for what in ("ground_force_v", "ground_force_p", "ground_torque_") for axis in "xyz"]
    return Table(wrenches.time, tuple(names), columns)


def specimen_mjcf(specimen: Specimen) -> str:
    """The specimen as an MJCF model: bones, joints, markers as sites, muscles on tendons.

    The base stands in the world; wires, clusters' places and viscosities are not in it, as a laboratory would
    not know them.
    """
    model = specimen.model
    children: dict[str, list[str]] = {name: [] for name in ("ground", *model.body_names)}
    for joint in model.joints:
        children[joint.parent].append(joint.child)
    inside = _contents(specimen)
    joints = {one.child: one for one in model.joints}
    rows = dict(zip(model.body_names, inertial_parameters(model), strict=True))

    def body(name: str) -> str:
        pose, freedoms = (specimen.stand, "") if name == specimen.base else _joint(joints[name])
        below = "".join(body(child) for child in children[name])
        place = f'pos="{words(pose.translation)}" quat="{words(quaternion(pose.rotation))}"'
        return f'<body name="{name}" {place}>{freedoms}{inertial(rows[name])}{"".join(inside[name])}{below}</body>\n'

    tendons, actuators = _muscles(specimen)
    return f"""<mujoco model="{model.name}">
<compiler autolimits="true"/>
<option gravity="{words(model.gravity)}"/>
<default><geom contype="0" conaffinity="0" group="4"/><site size="0.002"/></default>
<worldbody>
{body(specimen.base)}</worldbody>
<tendon>{"".join(tendons)}</tendon>
<actuator>{"".join(actuators)}</actuator>
</mujoco>
"""


def _joint(joint: Joint) -> tuple[Transform, str]:
    """Where a body is when its joint does not turn, and the joint's axes as MuJoCo's, one after another."""
    pose = joint.parent_frame @ joint.child_frame.inverse()
    back = joint.child_frame
    if joint.kind == "ball":
        return pose, f'<joint name="{joint.name}" type="ball" pos="{words(back.translation)}"/>'
    parts = []
    for axis in joint.axes:
        if axis.kind != "rotation" or float(axis.function(1.0)) != 1.0 or float(axis.function(0.0)) != 0.0:
            raise BadModel(f"joint '{joint.name}' does more than turn: a virtual specimen has hinges only")
        anchor = f'pos="{words(back.apply(axis.origin))}" axis="{words(back.rotation @ axis.vector)}"'
        parts.append(f'<joint name="{axis.coordinates[0]}" type="hinge" {anchor}/>')
    return pose, "".join(parts)


def _contents(specimen: Specimen) -> dict[str, list[str]]:
    """Sites and surfaces of every body."""
    model = specimen.model
    inside: dict[str, list[str]] = {name: [] for name in model.body_names}
    for one in model.markers:
        inside[one.body].append(_site(one.name, one.location))
    for surface in model.wrap_objects:
        inside[surface.body].append(_surface(surface))
    for muscle in model.muscles:
        for i, point in enumerate(fixed_points(muscle), 1):
            inside[point.body].append(_site(f"{muscle.name}-{i}", point.location))
        for wrap in tendon_wraps(muscle):
            if wrap.side is not None:
                inside[wrap.side_body].append(_site(f"{muscle.name}-side-{wrap.wrap_object}", wrap.side))
    return inside


def _site(name: str, place: Array) -> str:
    return f'<site name="{name}" pos="{words(place)}"/>'


def _surface(one: WrapObject) -> str:
    size = words(one.size[:1]) + (" 0.1" if one.kind == "cylinder" else "")
    place = f'pos="{words(one.pose.translation)}" quat="{words(quaternion(one.pose.rotation))}"'
    return f'<geom name="{one.name}" type="{one.kind}" size="{size}" {place}/>'


def _muscles(specimen: Specimen) -> tuple[list[str], list[str]]:
    """Tendons, and the muscles that pull on them."""
    tendons, actuators = [], []
    for muscle in specimen.model.muscles:
        path = []
        for i, _ in enumerate(fixed_points(muscle)):
            path.append(f'<site site="{muscle.name}-{i + 1}"/>')
            for wrap in (one for one in tendon_wraps(muscle) if one.after == i):
                side = "" if wrap.side is None else f' sidesite="{muscle.name}-side-{wrap.wrap_object}"'
                path.append(f'<geom geom="{wrap.wrap_object}"{side}/>')
        tendons.append(f'<spatial name="{muscle.name}_tendon">{"".join(path)}</spatial>\n')
        force = f'force="{muscle.max_isometric_force!r}" lengthrange="0.01 1"'
        actuators.append(f'<muscle name="{muscle.name}" tendon="{muscle.name}_tendon" {force}/>\n')
    return tendons, actuators
