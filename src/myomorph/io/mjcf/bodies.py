"""Bodies, joints, coordinates and equality constraints of a compiled MuJoCo model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from myomorph.io.mjcf.names import MjcfNames, geom_mesh, polynomial_degree, pose_of
from myomorph.model.functions import PiecewisePolynomial, linear
from myomorph.model.model import Axis, Body, Coordinate, Coupler, Joint, Kept, Loop, Mesh
from myomorph.model.spatial import Transform, rotation_from_quaternion

KINDS = {
    int(mujoco.mjtJoint.mjJNT_FREE): "free",
    int(mujoco.mjtJoint.mjJNT_BALL): "ball",
    int(mujoco.mjtJoint.mjJNT_SLIDE): "slide",
    int(mujoco.mjtJoint.mjJNT_HINGE): "hinge",
}
IDENTITY = linear(1.0)


def bodies_and_joints(
    m: Any, names: MjcfNames, source: str
) -> tuple[tuple[Body, ...], tuple[Joint, ...], list[Coordinate]]:
    """Bodies in MuJoCo's order, the joint of each to its parent, and all coordinates."""
    meshes = _meshes_of_bodies(m, names, source)
    bodies, joints, coordinates = [], [], []
    for b in range(1, m.nbody):
        turn = rotation_from_quaternion(m.body_iquat[b])
        inertia = turn @ np.diag(m.body_inertia[b]) @ turn.T
        bodies.append(Body(names.bodies[b], float(m.body_mass[b]), m.body_ipos[b], inertia, meshes[b]))
        joint, owned = _joint(m, names, b)
        joints.append(joint)
        coordinates += owned
    taken: set[str] = set()
    for i, joint in enumerate(joints):
        if joint.name in taken:
            joints[i] = replace(joint, name=f"{joint.child}_{joint.kind}")
        taken.add(joints[i].name)
    return tuple(bodies), tuple(joints), coordinates


def _meshes_of_bodies(m: Any, names: MjcfNames, source: str) -> list[tuple[Mesh, ...]]:
    meshes: list[list[Mesh]] = [[] for _ in range(m.nbody)]
    for i in range(m.ngeom):
        if m.geom_bodyid[i]:
            mesh = geom_mesh(m, names, i, source)
            if mesh is not None:
                meshes[m.geom_bodyid[i]].append(mesh)
    return [tuple(some) for some in meshes]


def _joint(m: Any, names: MjcfNames, b: int) -> tuple[Joint, list[Coordinate]]:
    """The joint of body `b`: its MuJoCo joints one after another, each about its anchor in the body's frame."""
    first, count = m.body_jntadr[b], m.body_jntnum[b]
    body, parent = names.bodies[b], names.bodies[m.body_parentid[b]]
    parent_frame, child_frame = pose_of(m.body_pos[b], m.body_quat[b]), Transform.identity()
    axes: list[Axis] = []
    coordinates: list[Coordinate] = []
    kinds = [KINDS[int(m.jnt_type[j])] for j in range(first, first + count)]
    for j, kind in enumerate(kinds, first):
        if kind == "free":
            parent_frame = Transform.identity()
            start = rotation_from_quaternion(m.qpos0[m.jnt_qposadr[j] + 3 : m.jnt_qposadr[j] + 7])
            child_frame = Transform(start.T, np.zeros(3))
        more_axes, more_coordinates = _axes(m, names.joints[j], j, kind)
        axes += more_axes
        coordinates += more_coordinates
    name = names.joints[first] if count == 1 else body
    kind = "+".join(kinds) or "weld"
    own = tuple(coordinate.name for coordinate in coordinates)
    return Joint(name, kind, parent, body, parent_frame, child_frame, tuple(axes), own), coordinates


def _axes(m: Any, name: str, j: int, kind: str) -> tuple[list[Axis], list[Coordinate]]:
    """Axes and coordinates of MuJoCo joint `j`."""
    adr, anchor = m.jnt_qposadr[j], np.array(m.jnt_pos[j])
    if kind in ("hinge", "slide"):
        rest = float(m.qpos0[adr])
        low, high = float(m.jnt_range[j, 0]), float(m.jnt_range[j, 1])
        coordinate = Coordinate(
            name,
            "rotational" if kind == "hinge" else "translational",
            default=rest,
            range=(low, high) if low < high else (-np.inf, np.inf),
            clamped=bool(m.jnt_limited[j]),
        )
        amount = linear(1.0, -rest) if rest else IDENTITY
        vector = np.array(m.jnt_axis[j])
        if kind == "hinge":
            return [Axis("rotation", vector, amount, (name,), anchor)], [coordinate]
        return [Axis("translation", vector, amount, (name,))], [coordinate]
    axes, coordinates = [], []
    if kind == "free":
        for i, letter in enumerate("xyz"):
            own = f"{name}_t{letter}"
            coordinates.append(Coordinate(own, "translational", default=float(m.qpos0[adr + i])))
            axes.append(Axis("translation", np.eye(3)[i], IDENTITY, (own,)))
        anchor = np.zeros(3)
    for i, letter in enumerate("xyz"):
        own = f"{name}_r{letter}"
        coordinates.append(Coordinate(own))
        axes.append(Axis("rotation", np.eye(3)[i], IDENTITY, (own,), anchor))
    return axes, coordinates


def couplers_and_loops(
    m: Any, names: MjcfNames, coordinates: list[Coordinate]
) -> tuple[tuple[Coordinate, ...], tuple[Coupler, ...], tuple[Loop, ...], list[Kept]]:
    """Active equality constraints: of joints to couplers or locks, of bodies to loops, the rest by name.

    MuJoCo's joint equality is y - y0 = a0 + a1 (x - x0) + ... + a4 (x - x0)^4 with x0, y0 the joints'
    `qpos0`. Where y follows another joint already and the equality is a line, x follows y instead.
    """
    couplers: dict[str, Coupler] = {}
    locked: dict[str, float] = {}
    loops: list[Loop] = []
    lost: list[Kept] = []
    off = bool(m.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY))
    for e in range(m.neq):
        name, kind = names.equalities[e], int(m.eq_type[e])
        word = mujoco.mjtEq(kind).name.removeprefix("mjEQ_").lower()
        if off or not m.eq_active0[e]:
            lost.append(Kept(f"{word} equality", name, "the file switches it off", "", "equality"))
        elif kind == int(mujoco.mjtEq.mjEQ_JOINT):
            _join(m, names, e, couplers, locked, lost)
        elif kind in (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)):
            loops.append(_loop(m, names, e, word))
        else:
            lost.append(Kept(f"{word} equality", name, "it is not kept: the model moves without it", "", "equality"))
    held = [replace(c, default=locked[c.name], locked=True) if c.name in locked else c for c in coordinates]
    return tuple(held), tuple(couplers.values()), tuple(loops), lost


def _join(
    m: Any, names: MjcfNames, e: int, couplers: dict[str, Coupler], locked: dict[str, float], lost: list[Kept]
) -> None:
    y, x = int(m.eq_obj1id[e]), int(m.eq_obj2id[e])
    y0, data = float(m.qpos0[m.jnt_qposadr[y]]), np.array(m.eq_data[e, :5])
    name, follower = names.equalities[e], names.joints[y]
    degree = polynomial_degree(data)
    if x < 0 or degree == 0:
        locked[follower] = y0 + float(data[0])
        return
    x0, leader = float(m.qpos0[m.jnt_qposadr[x]]), names.joints[x]
    coefficients = data[: degree + 1].copy()
    coefficients[0] += y0
    if (follower in couplers or _follows(leader, follower, couplers)) and degree == 1:
        follower, leader = leader, follower
        coefficients = np.array([x0 - data[0] / data[1], 1.0 / data[1]])
        x0 = y0
    if follower in couplers or _follows(leader, follower, couplers):
        effect = f"'{follower}' follows another joint already: the model moves without this equality"
        lost.append(Kept("joint equality", name, effect, "", "equality"))
        return
    function = PiecewisePolynomial(np.array([x0]), coefficients[None])
    couplers[follower] = Coupler(name, follower, function, (leader,))


def _follows(leader: str, follower: str, couplers: dict[str, Coupler]) -> bool:
    """Whether `leader` already depends on `follower`, so that a coupler would close a circle."""
    seen = set()
    while leader in couplers and leader not in seen:
        seen.add(leader)
        leader = couplers[leader].independents[0]
        if leader == follower:
            return True
    return leader == follower


def _loop(m: Any, names: MjcfNames, e: int, kind: str) -> Loop:
    one, two = int(m.eq_obj1id[e]), int(m.eq_obj2id[e])
    data = np.array(m.eq_data[e])
    if int(m.eq_objtype[e]) == int(mujoco.mjtObj.mjOBJ_SITE):
        body_1, body_2 = int(m.site_bodyid[one]), int(m.site_bodyid[two])
        pose_1 = pose_of(m.site_pos[one], m.site_quat[one])
        pose_2 = pose_of(m.site_pos[two], m.site_quat[two])
    else:
        body_1, body_2 = one, two
        if kind == "connect":
            pose_1, pose_2 = Transform(np.eye(3), data[:3]), Transform(np.eye(3), data[3:6])
        else:
            pose_1, pose_2 = pose_of(data[3:6], data[6:10]), Transform(np.eye(3), data[:3])
    return Loop(names.equalities[e], kind, names.bodies[body_1], names.bodies[body_2], pose_1, pose_2)
