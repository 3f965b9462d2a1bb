"""What the parts of the MJCF reader share: names, poses, drawings, and what has no noun."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array
from myomorph.model.model import GROUND, Kept, Mesh
from myomorph.model.spatial import Transform, rotation_from_quaternion

DRAWN_GROUPS = (0, 1, 2)
_SHAPES = {
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
}


class MjcfNames:
    """Unique names of everything in a compiled model; what the file leaves unnamed gets one.

    Attributes
    ----------
    model : name of the model, "" if none
    bodies : the first is "ground"
    joints, sites, geoms, tendons, actuators, equalities : one name for each
    """

    def __init__(self, compiled: Any):
        m = compiled
        kind = mujoco.mjtObj
        self.model = bytes(m.names).split(b"\0", 1)[0].decode("utf-8", "replace")
        bodies = _names(m, kind.mjOBJ_BODY, m.nbody)
        self.bodies = _unique((name or f"body_{i}" for i, name in enumerate(bodies[1:], 1)), (GROUND,))
        self.bodies = [GROUND, *self.bodies]
        joints = _names(m, kind.mjOBJ_JOINT, m.njnt)
        owners = [self.bodies[b] for b in m.jnt_bodyid]
        self.joints = _unique(name or f"{owner}_joint" for name, owner in zip(joints, owners, strict=True))
        self.sites = self._named(m, kind.mjOBJ_SITE, m.nsite, "site")
        self.geoms = self._named(m, kind.mjOBJ_GEOM, m.ngeom, "geom")
        self.tendons = self._named(m, kind.mjOBJ_TENDON, m.ntendon, "tendon")
        self.actuators = self._named(m, kind.mjOBJ_ACTUATOR, m.nu, "actuator")
        self.equalities = self._named(m, kind.mjOBJ_EQUALITY, m.neq, "equality")

    @staticmethod
    def _named(m: Any, kind: Any, count: int, word: str) -> list[str]:
        return _unique(name or f"{word}_{i}" for i, name in enumerate(_names(m, kind, count)))


def _names(m: Any, kind: Any, count: int) -> list[str]:
    return [mujoco.mj_id2name(m, kind, i) or "" for i in range(count)]


def _unique(names: Iterable[str], taken: Iterable[str] = ()) -> list[str]:
    seen, unique = set(taken), []
    for name in names:
        candidate, count = name, 2
        while candidate in seen:
            candidate, count = f"{name}_{count}", count + 1
        seen.add(candidate)
        unique.append(candidate)
    return unique


def pose_of(position: ArrayLike, quaternion: ArrayLike) -> Transform:
    """Transform of a position [m] and a quaternion (w, x, y, z)."""
    return Transform(rotation_from_quaternion(quaternion), np.asarray(position, dtype=np.float64))


def polynomial_degree(coefficients: Array) -> int:
    """Highest power whose coefficient is not zero."""
    used = np.flatnonzero(coefficients)
    return int(used[-1]) if len(used) else 0


def geom_mesh(m: Any, names: MjcfNames, i: int, source: str) -> Mesh | None:
    """Drawing of geom `i`, None where MuJoCo does not draw it or it is a plane or height field.

    MuJoCo moves a mesh to its center and principal axes when it compiles; the pose given here is that
    of the mesh as its file has it.
    """
    if m.geom_group[i] not in DRAWN_GROUPS or m.geom_rgba[i, 3] == 0.0:
        return None
    pose = pose_of(m.geom_pos[i], m.geom_quat[i])
    if m.geom_type[i] == mujoco.mjtGeom.mjGEOM_MESH:
        k = m.geom_dataid[i]
        file = mesh_file(m, k, source)
        if not file:
            return None
        return Mesh(file, pose @ pose_of(m.mesh_pos[k], m.mesh_quat[k]).inverse(), np.array(m.mesh_scale[k]))
    shape = _SHAPES.get(m.geom_type[i])
    return None if shape is None else Mesh("", pose, np.array(m.geom_size[i]), shape)


def mesh_file(m: Any, k: int, source: str) -> str:
    """File of mesh `k`, relative to the folder of `source` where it has one; "" for a mesh made in the text."""
    start = m.mesh_pathadr[k]
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
    """What a compiled model holds that has no noun, one entry for each kind."""
    mocap = [names.bodies[i] for i in range(m.nbody) if m.body_mocapid[i] >= 0]
    antigravity = [names.bodies[i] for i in range(m.nbody) if m.body_gravcomp[i] != 0.0]
    balls = [names.joints[i] for i in range(m.njnt) if m.jnt_limited[i] and m.jnt_type[i] == mujoco.mjtJoint.mjJNT_BALL]
    found = [
        ("mocap bodies", mocap, "they are fixed where the file puts them"),
        ("gravity compensation", antigravity, "gravity acts in full on these bodies"),
        ("limits of ball joints", balls, "the angle of these joints is not bounded"),
        ("joint armature", _dofs(m, names, m.dof_armature), "rotor inertia is not inertia of a body"),
        ("joint damping", _dofs(m, names, m.dof_damping), "passive joint torques are not part of inverse dynamics"),
        ("joint friction", _dofs(m, names, m.dof_frictionloss), "joint friction is not part of inverse dynamics"),
        (
            "joint stiffness",
            [name for name, k in zip(names.joints, _rows(m.jnt_stiffness), strict=True) if np.any(k)],
            "passive joint torques are not part of inverse dynamics",
        ),
        ("flexible bodies", [str(i) for i in range(m.nflex)], "they are not modelled"),
        ("skins", [str(i) for i in range(m.nskin)], "they only draw"),
        ("contact pairs and plugins", [str(i) for i in range(m.npair + m.nplugin)], "they are not modelled"),
    ]
    return [Kept(kind, _few(which), effect, "", "mujoco") for kind, which, effect in found if which]


def _rows(values: Any) -> list[Array]:
    return [np.atleast_1d(row) for row in values]


def _dofs(m: Any, names: MjcfNames, values: Any) -> list[str]:
    moved = {int(m.dof_jntid[i]) for i, row in enumerate(_rows(values)) if np.any(row)}
    return [names.joints[i] for i in sorted(moved)]


def _few(which: list[str], most: int = 3) -> str:
    return ", ".join(which[:most]) + (f", ... ({len(which)} in all)" if len(which) > most else "")
