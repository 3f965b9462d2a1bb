"""Bodies, joints, coordinates and equality constraints of a compiled MuJoCo model."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.io.mjcf.couplings import coupler_of_text
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import MODEL
from myomorph.core.model.errors import quoted
from myomorph.core.model.functions import PiecewisePolynomial, linear
from myomorph.core.model.model import (
    GROUND,
    Axis,
    Body,
    Coordinate,
    Coupler,
    Joint,
    Kept,
    Loop,
    Mesh,
)
from myomorph.core.model.spatial import Transform, rotation_from_quaternion

DRAWN_GROUPS = (0, 1, 2)
_SHAPES = {
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
}

KINDS = {
    int(mujoco.mjtJoint.mjJNT_FREE): "free",
    int(mujoco.mjtJoint.mjJNT_BALL): "ball",
    int(mujoco.mjtJoint.mjJNT_SLIDE): "slide",
    int(mujoco.mjtJoint.mjJNT_HINGE): "hinge",
}
IDENTITY = linear(1.0)


class MjcfNames:
    """Unique names of everything in a compiled model, made up where the file has none.

    Attributes
    ----------
    model : name of the model, "" if none
    bodies : one name for each; the first is "ground"
    joints, sites, geoms, tendons, actuators, equalities : one name for each
    """

    def __init__(self, compiled: Any):
        m = compiled
        kind = mujoco.mjtObj
        self.model = bytes(m.names).split(b"\0", 1)[0].decode("utf-8", "replace")
        bodies = _names(m, kind.mjOBJ_BODY, m.nbody)
        self.bodies = _unique(
            [GROUND, *(name or f"body_{i}" for i, name in enumerate(bodies[1:], 1))]
        )
        joints = _names(m, kind.mjOBJ_JOINT, m.njnt)
        owners = [self.bodies[b] for b in m.jnt_bodyid]
        self.joints = _unique(
            name or f"{owner}_joint" for name, owner in zip(joints, owners, strict=True)
        )
        self.sites = self._named(m, kind.mjOBJ_SITE, m.nsite, "site")
        self.geoms = self._named(m, kind.mjOBJ_GEOM, m.ngeom, "geom")
        self.tendons = self._named(m, kind.mjOBJ_TENDON, m.ntendon, "tendon")
        self.actuators = self._named(m, kind.mjOBJ_ACTUATOR, m.nu, "actuator")
        self.equalities = self._named(m, kind.mjOBJ_EQUALITY, m.neq, "equality")

    @staticmethod
    def _named(m: Any, kind: Any, count: int, word: str) -> list[str]:
        """List unique names of objects of a kind, made up where the file has none."""
        return _unique(name or f"{word}_{i}" for i, name in enumerate(_names(m, kind, count)))


def _names(m: Any, kind: Any, count: int) -> list[str]:
    """List the names of the first objects of a kind, "" for one without."""
    return [mujoco.mj_id2name(m, kind, i) or "" for i in range(count)]


def _unique(names: Iterable[str]) -> list[str]:
    """Make names unique by numbers behind those that occur again."""
    taken: set[str] = set()
    return [new_name(name, taken) for name in names]


def new_name(name: str, taken: set[str]) -> str:
    """Return a name that is not taken, with a number behind it where needed.

    Parameters
    ----------
    name : wanted
    taken : names that are taken; gets the new one
    """
    candidate = name
    count = 2
    while candidate in taken:
        candidate = f"{name}_{count}"
        count = count + 1
    taken.add(candidate)
    return candidate


def pose_of(position: ArrayLike, quaternion: ArrayLike) -> Transform:
    """Make a transform of a position and a quaternion.

    Parameters
    ----------
    position : (3,) [m]
    quaternion : (4,) w, x, y, z

    Returns
    -------
    the transform from the frame to its parent
    """
    return Transform(rotation_from_quaternion(quaternion), np.asarray(position, dtype=np.float64))


def _geom_mesh(m: Any, i: int, source: str) -> Mesh | None:
    """Read the drawing of a geom.

    MuJoCo moves a mesh to its center and principal axes when it compiles; the pose given here is
    that of the mesh as its file has it.

    Parameters
    ----------
    m : the compiled model
    i : index of the geom
    source : path of the model's file

    Returns
    -------
    mesh or shape with its pose in the body; None where MuJoCo does not draw it or it is a plane or
    height field
    """
    if m.geom_group[i] not in DRAWN_GROUPS or m.geom_rgba[i, 3] == 0.0:
        return None
    pose = pose_of(m.geom_pos[i], m.geom_quat[i])
    if m.geom_type[i] == mujoco.mjtGeom.mjGEOM_MESH:
        number = m.geom_dataid[i]
        file = mesh_file(m, number, source)
        if not file:
            return None
        return Mesh(
            file,
            pose @ pose_of(m.mesh_pos[number], m.mesh_quat[number]).inverse(),
            np.array(m.mesh_scale[number]),
        )
    shape = _SHAPES.get(m.geom_type[i])
    return (
        None
        if shape is None
        else Mesh(file="", pose=pose, scale=np.array(m.geom_size[i]), shape=shape)
    )


def mesh_file(m: Any, number: int, source: str) -> str:
    """Find the file of a mesh.

    Parameters
    ----------
    m : the compiled model
    number : index of the mesh
    source : path of the model's file, "" where it has none

    Returns
    -------
    path, relative to the folder of `source` where it has one; "" for a mesh made in the text
    """
    start = m.mesh_pathadr[number]
    if start < 0:
        return ""
    file = bytes(m.paths[start:]).split(b"\0", 1)[0].decode("utf-8", "replace")
    if source and os.path.isabs(file):
        try:
            return Path(os.path.relpath(file, Path(source).resolve().parent)).as_posix()
        except ValueError:
            return file
    return file


def left_out(m: Any, names: MjcfNames) -> list[Kept]:
    """List what a compiled model holds that has no noun here.

    Parameters
    ----------
    m : the compiled model
    names : of its parts

    Returns
    -------
    one entry per kind, with the effect of leaving it out
    """
    mocap = [names.bodies[i] for i in range(m.nbody) if m.body_mocapid[i] >= 0]
    antigravity = [names.bodies[i] for i in range(m.nbody) if m.body_gravcomp[i] != 0.0]
    balls = [
        names.joints[i]
        for i in range(m.njnt)
        if m.jnt_limited[i] and m.jnt_type[i] == mujoco.mjtJoint.mjJNT_BALL
    ]
    kinds = [
        ("mocap bodies", mocap, "they are fixed where the file puts them"),
        ("gravity compensation", antigravity, "gravity acts in full on these bodies"),
        ("limits of ball joints", balls, "the angle of these joints is not bounded"),
        (
            "joint armature",
            _dofs(m, names, m.dof_armature),
            "rotor inertia is not inertia of a body",
        ),
        (
            "joint damping",
            _dofs(m, names, m.dof_damping),
            "passive joint torques are not part of inverse dynamics",
        ),
        (
            "joint friction",
            _dofs(m, names, m.dof_frictionloss),
            "joint friction is not part of inverse dynamics",
        ),
        (
            "joint stiffness",
            [
                name
                for name, row in zip(names.joints, _rows(m.jnt_stiffness), strict=True)
                if np.any(row)
            ],
            "passive joint torques are not part of inverse dynamics",
        ),
        ("flexible bodies", [str(i) for i in range(m.nflex)], "they are not modelled"),
        ("skins", [str(i) for i in range(m.nskin)], "they only draw"),
        (
            "contact pairs and plugins",
            [str(i) for i in range(m.npair + m.nplugin)],
            "they are not modelled",
        ),
    ]
    return [
        Kept(kind=kind, name=quoted(which, 3), effect=effect, text="", room="mujoco")
        for kind, which, effect in kinds
        if which
    ]


def _rows(values: Any) -> list[Array]:
    """Split values into rows, each an array of one dimension or more."""
    return [np.atleast_1d(row) for row in values]


def _dofs(m: Any, names: MjcfNames, values: Any) -> list[str]:
    """List the joints that have a value other than 0 for one of their degrees of freedom."""
    moved = {int(m.dof_jntid[i]) for i, row in enumerate(_rows(values)) if np.any(row)}
    return [names.joints[i] for i in sorted(moved)]


def bodies_and_joints(
    m: Any, names: MjcfNames, meshes: Sequence[tuple[Mesh, ...]]
) -> tuple[tuple[Body, ...], tuple[Joint, ...], list[Coordinate]]:
    """Convert the bodies of a compiled model and their joints.

    Parameters
    ----------
    m : the compiled model
    names : of its parts
    meshes : of each body, the ground first, as of `meshes_of`

    Returns
    -------
    bodies in MuJoCo's order, the joint of each to its parent, and all coordinates [rad or m]
    """
    bodies = []
    joints = []
    coordinates = []
    for b in range(1, m.nbody):
        turn = rotation_from_quaternion(m.body_iquat[b])
        inertia = turn @ np.diag(m.body_inertia[b]) @ turn.T
        bodies.append(
            Body(
                name=names.bodies[b],
                mass=float(m.body_mass[b]),
                mass_center=m.body_ipos[b],
                inertia=inertia,
                meshes=meshes[b],
            )
        )
        joint, owned = _joint(m, names, b)
        joints.append(joint)
        coordinates += owned
    taken: set[str] = set()
    for i, joint in enumerate(joints):
        if joint.name in taken:
            joints[i] = replace(joint, name=f"{joint.child}_{joint.kind}")
        taken.add(joints[i].name)
    return tuple(bodies), tuple(joints), coordinates


def meshes_of(m: Any, source: str) -> list[tuple[Mesh, ...]]:
    """Read the drawings of the geoms of each body.

    Parameters
    ----------
    m : the compiled model
    source : path of its file

    Returns
    -------
    meshes of each body, the ground first
    """
    meshes: list[list[Mesh]] = [[] for _ in range(m.nbody)]
    for i in range(m.ngeom):
        mesh = _geom_mesh(m, i, source)
        if mesh is not None:
            meshes[m.geom_bodyid[i]].append(mesh)
    return list(map(tuple, meshes))


def _joint(m: Any, names: MjcfNames, b: int) -> tuple[Joint, list[Coordinate]]:
    """Convert the MuJoCo joints of a body to one joint.

    Its axes follow each other, each about its anchor in the body's frame.

    Parameters
    ----------
    m : the compiled model
    names : of its parts
    b : index of the body

    Returns
    -------
    the joint and its coordinates
    """
    first = m.body_jntadr[b]
    count = m.body_jntnum[b]
    body = names.bodies[b]
    parent = names.bodies[m.body_parentid[b]]
    parent_frame = pose_of(m.body_pos[b], m.body_quat[b])
    child_frame = Transform.identity()
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
    own_coordinates = tuple(coordinate.name for coordinate in coordinates)
    return Joint(
        name=name,
        kind=kind,
        parent=parent,
        child=body,
        parent_frame=parent_frame,
        child_frame=child_frame,
        axes=tuple(axes),
        coordinates=own_coordinates,
    ), coordinates


def _axes(m: Any, name: str, j: int, kind: str) -> tuple[list[Axis], list[Coordinate]]:
    """Convert a MuJoCo joint to axes and coordinates.

    Parameters
    ----------
    m : the compiled model
    name : of the joint
    j : its index
    kind : "hinge", "slide", "ball" or "free"

    Returns
    -------
    one axis and coordinate of a hinge or slide, three of a ball, six of a free joint
    """
    adr = m.jnt_qposadr[j]
    anchor = np.array(m.jnt_pos[j])
    if kind in ("hinge", "slide"):
        rest = float(m.qpos0[adr])
        low = float(m.jnt_range[j, 0])
        high = float(m.jnt_range[j, 1])
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
            return [
                Axis(
                    kind="rotation",
                    vector=vector,
                    function=amount,
                    coordinates=(name,),
                    origin=anchor,
                )
            ], [coordinate]
        return [Axis(kind="translation", vector=vector, function=amount, coordinates=(name,))], [
            coordinate
        ]
    axes = []
    coordinates = []
    if kind == "free":
        for i, letter in enumerate("xyz"):
            coordinate_name = f"{name}_t{letter}"
            coordinates.append(
                Coordinate(coordinate_name, "translational", default=float(m.qpos0[adr + i]))
            )
            axes.append(
                Axis(
                    kind="translation",
                    vector=np.eye(3)[i],
                    function=IDENTITY,
                    coordinates=(coordinate_name,),
                )
            )
        anchor = np.zeros(3)
    for i, letter in enumerate("xyz"):
        coordinate_name = f"{name}_r{letter}"
        coordinates.append(Coordinate(coordinate_name))
        axes.append(
            Axis(
                kind="rotation",
                vector=np.eye(3)[i],
                function=IDENTITY,
                coordinates=(coordinate_name,),
                origin=anchor,
            )
        )
    return axes, coordinates


def couplers_and_loops(
    m: Any, names: MjcfNames, coordinates: list[Coordinate]
) -> tuple[tuple[Coordinate, ...], tuple[Coupler, ...], tuple[Loop, ...], list[Kept]]:
    """Convert active equality constraints: of joints to couplers or locks, of bodies to loops.

    MuJoCo's joint equality is y - y0 = a0 + a1 (x - x0) + ... + a4 (x - x0)^4 with x0, y0 the
    joints' `qpos0`. Where y follows another joint already and the equality is a line, x follows y
    instead.

    Parameters
    ----------
    m : the compiled model
    names : of its parts
    coordinates : of the model

    Returns
    -------
    the coordinates with locks, couplers, loops, and the rest by name
    """
    couplers: dict[str, Coupler] = {}
    locked: dict[str, float] = {}
    loops: list[Loop] = []
    lost: list[Kept] = []
    off = bool(m.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EQUALITY))
    for e in range(m.neq):
        name = names.equalities[e]
        kind = int(m.eq_type[e])
        word = mujoco.mjtEq(kind).name.removeprefix("mjEQ_").lower()
        if off or not m.eq_active0[e]:
            lost.append(
                Kept(
                    kind=f"{word} equality",
                    name=name,
                    effect="the file switches it off",
                    text="",
                    room="equality",
                )
            )
        elif kind == int(mujoco.mjtEq.mjEQ_JOINT):
            _join(m, names, e, couplers, locked, lost)
        elif kind in (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)):
            loops.append(_loop(m, names, e, word))
        elif (coupler := _curve(m, names, name)) is not None:
            couplers[coupler.dependent] = coupler
        else:
            lost.append(
                Kept(
                    kind=f"{word} equality",
                    name=name,
                    effect="it is not kept: the model moves without it",
                    text="",
                    room="equality",
                )
            )
    held = [
        replace(c, default=locked[c.name], locked=True) if c.name in locked else c
        for c in coordinates
    ]
    return tuple(held), tuple(couplers.values()), tuple(loops), lost


def _join(
    m: Any,
    names: MjcfNames,
    e: int,
    couplers: dict[str, Coupler],
    locked: dict[str, float],
    lost: list[Kept],
) -> None:
    """Convert a joint equality to a coupler, or to a lock of a joint that follows none.

    Parameters
    ----------
    m : the compiled model
    names : of its parts
    e : index of the equality
    couplers : by dependent coordinate; gets a coupler
    locked : value by coordinate [rad or m]; gets a lock
    lost : gets an equality of a joint that follows another already
    """
    y = int(m.eq_obj1id[e])
    x = int(m.eq_obj2id[e])
    y0 = float(m.qpos0[m.jnt_qposadr[y]])
    data = np.array(m.eq_data[e, :5])
    name = names.equalities[e]
    follower = names.joints[y]
    degree = int(np.flatnonzero(data).max(initial=0))
    if x < 0 or degree == 0:
        locked[follower] = y0 + float(data[0])
        return
    x0 = float(m.qpos0[m.jnt_qposadr[x]])
    leader = names.joints[x]
    coefficients = data[: degree + 1].copy()
    coefficients[0] += y0
    if (follower in couplers or _follows(leader, follower, couplers)) and degree == 1:
        follower, leader = leader, follower
        coefficients = np.array([x0 - data[0] / data[1], 1.0 / data[1]])
        x0 = y0
    if follower in couplers or _follows(leader, follower, couplers):
        effect = MODEL.message(
            f"'{follower}' follows another joint already: the model moves without this equality"
        )
        lost.append(Kept(kind="joint equality", name=name, effect=effect, text="", room="equality"))
        return
    function = PiecewisePolynomial(np.array([x0]), coefficients[None])
    couplers[follower] = Coupler(
        name=name, dependent=follower, function=function, independents=(leader,)
    )


def _curve(m: Any, names: MjcfNames, name: str) -> Coupler | None:
    """Read the coupler stored as text for an equality of tendons, see `couplings.Cam`.

    Returns
    -------
    the coupler; None where there is no such text, or it names joints that do not exist
    """
    number = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_TEXT, name)
    if number < 0:
        return None
    start = int(m.text_adr[number])
    text = (
        bytes(m.text_data[start : start + int(m.text_size[number])])
        .rstrip(b"\0")
        .decode("utf-8", "replace")
    )
    follower, _, curve = text.partition(";")
    try:
        coupler = coupler_of_text(name, follower, curve)
    except ValueError:
        return None
    return coupler if {follower, *coupler.independents} <= set(names.joints) else None


def _follows(leader: str, follower: str, couplers: dict[str, Coupler]) -> bool:
    """Return whether `leader` depends on `follower`, so that a coupler would close a circle."""
    seen = set()
    while leader in couplers and leader not in seen:
        seen.add(leader)
        leader = couplers[leader].independents[0]
        if leader == follower:
            return True
    return leader == follower


def _loop(m: Any, names: MjcfNames, e: int, kind: str) -> Loop:
    """Convert a connect or weld equality to a loop, of frames (sites) or of bodies."""
    first = int(m.eq_obj1id[e])
    second = int(m.eq_obj2id[e])
    data = np.array(m.eq_data[e])
    if int(m.eq_objtype[e]) == int(mujoco.mjtObj.mjOBJ_SITE):
        body_1 = int(m.site_bodyid[first])
        body_2 = int(m.site_bodyid[second])
        pose_1 = pose_of(m.site_pos[first], m.site_quat[first])
        pose_2 = pose_of(m.site_pos[second], m.site_quat[second])
    else:
        body_1 = first
        body_2 = second
        if kind == "connect":
            pose_1 = Transform(np.eye(3), data[:3])
            pose_2 = Transform(np.eye(3), data[3:6])
        else:
            pose_1 = pose_of(data[3:6], data[6:10])
            pose_2 = Transform(np.eye(3), data[:3])
    return Loop(
        name=names.equalities[e],
        kind=kind,
        body_1=names.bodies[body_1],
        body_2=names.bodies[body_2],
        pose_1=pose_1,
        pose_2=pose_2,
    )
