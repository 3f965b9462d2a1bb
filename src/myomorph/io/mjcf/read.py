"""MuJoCo models in: MJCF compiled by the `mujoco` package, then turned into our nouns.

What has no noun here (contacts, damping, fixed tendons, skins, ...) is listed in `Model.kept`, each
with what leaving it out means.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from myomorph.io.mjcf.bodies import bodies_and_joints, couplers_and_loops
from myomorph.io.mjcf.guard import DEFAULT_TIME_LIMIT, compile_guarded
from myomorph.io.mjcf.muscles import actuators_of, muscles_of
from myomorph.io.mjcf.names import MjcfNames, geom_mesh, left_out, pose_of
from myomorph.model.errors import BadModel
from myomorph.model.model import Frame, Kept, Marker, Mesh, Model


def read_mjcf(
    path: str | Path,
    *,
    root: str | Path | None = None,
    marker_sites: str | None = None,
    time_limit: float = DEFAULT_TIME_LIMIT,
) -> Model:
    """Model of an MJCF file.

    The text is checked before MuJoCo sees it, in a process of its own that is stopped after
    `time_limit`. Files that the model names (includes, meshes, height fields, textures, skins,
    attached models) must lie inside the model's folder tree: the folder of the file or, where that
    belongs to a Python package, a git checkout or a folder with a LICENSE file, the top folder of
    that. A relative path that leaves the tree is refused by name, and so is an absolute path to an
    existing file outside. A mesh that is missing is left out with its geoms and listed in
    `Model.kept`.

    Parameters
    ----------
    path : the MJCF file
    root : top folder of the model's tree, where the rule above does not find it
    marker_sites : regular expression; sites whose whole name matches become markers too
    time_limit : most seconds that MuJoCo may take to compile the model [s]

    Raises
    ------
    BadFile : the file cannot be read, is not MJCF, is unsafe, or MuJoCo refuses it
    BadModel : what it describes cannot be a tree of joints
    """
    path = Path(path)
    compiled, missing = compile_guarded(path, None if root is None else Path(root), time_limit)
    return model_from_mujoco(compiled, source=str(path), marker_sites=marker_sites, kept=missing)


def model_from_mujoco(
    compiled: Any,
    *,
    name: str = "",
    source: str = "",
    marker_sites: str | None = None,
    kept: Sequence[Kept] = (),
) -> Model:
    """Model of a compiled `mujoco.MjModel`.

    Every body becomes a body with one joint; several MuJoCo joints of a body are the axes of that
    joint, in order. Hinge and slide joints are one coordinate each, named as they are, whose value is
    MuJoCo's `qpos` (the axis moves by `qpos - qpos0`). A ball joint has three coordinates,
    `<joint>_rx`, `_ry`, `_rz`: body-fixed X, Y, Z angles from its default orientation. A free joint
    has `<joint>_tx`, `_ty`, `_tz` (position of the body's origin in ground) and `_rx`, `_ry`, `_rz`:
    rotation = R_x R_y R_z R_0 with R_0 the body's orientation in the file, so that the default pose
    has zero angles. `qpos_from_coordinates` and `coordinates_from_qpos` convert.

    Sites become frames; geoms of the groups that MuJoCo draws (0 to 2) become meshes.

    Parameters
    ----------
    compiled : mujoco.MjModel
    name : of the model; its own name by default
    source : path of its file, for messages and for the place of meshes
    marker_sites : regular expression; sites whose whole name matches become markers too
    kept : what was left out before

    Raises
    ------
    BadModel : there is no body, or a number that is not finite
    """
    _check(compiled, source)
    names = MjcfNames(compiled)
    bodies, joints, free_coordinates = bodies_and_joints(compiled, names, source)
    coordinates, couplers, loops, lost_equalities = couplers_and_loops(compiled, names, free_coordinates)
    muscles, wraps, lost_tendons = muscles_of(compiled, names)
    actuators, lost_actuators = actuators_of(compiled, names)
    gravity_is_off = bool(compiled.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY))
    return Model(
        name=name or names.model or Path(source).stem or "model",
        bodies=bodies,
        joints=joints,
        coordinates=coordinates,
        gravity=np.zeros(3) if gravity_is_off else np.array(compiled.opt.gravity),
        markers=_markers(compiled, names, marker_sites),
        muscles=muscles,
        wrap_objects=wraps,
        actuators=actuators,
        couplers=couplers,
        loops=loops,
        frames=_frames(compiled, names),
        ground_meshes=_ground_meshes(compiled, names, source),
        kept=(*kept, *left_out(compiled, names), *lost_equalities, *lost_tendons, *lost_actuators),
        source=source,
    )


def _check(m: Any, source: str) -> None:
    where = source or "the MuJoCo model"
    if m.nbody < 2:
        raise BadModel(f"{where}: has no body besides the world")
    fields = ("body_pos", "body_quat", "body_mass", "body_ipos", "body_inertia", "jnt_pos", "jnt_axis", "qpos0")
    for name in (*fields, "jnt_range", "site_pos", "geom_pos", "geom_size", "eq_data", "actuator_lengthrange"):
        if not np.all(np.isfinite(getattr(m, name))):
            raise BadModel(f"{where}: a value of '{name}' is not finite")


def _frames(m: Any, names: MjcfNames) -> tuple[Frame, ...]:
    return tuple(
        Frame(names.sites[i], names.bodies[m.site_bodyid[i]], pose_of(m.site_pos[i], m.site_quat[i]))
        for i in range(m.nsite)
    )


def _markers(m: Any, names: MjcfNames, pattern: str | None) -> tuple[Marker, ...]:
    if pattern is None:
        return ()
    wanted = re.compile(pattern)
    return tuple(
        Marker(names.sites[i], names.bodies[m.site_bodyid[i]], m.site_pos[i])
        for i in range(m.nsite)
        if wanted.fullmatch(names.sites[i])
    )


def _ground_meshes(m: Any, names: MjcfNames, source: str) -> tuple[Mesh, ...]:
    meshes = (geom_mesh(m, names, i, source) for i in range(m.ngeom) if m.geom_bodyid[i] == 0)
    return tuple(mesh for mesh in meshes if mesh is not None)
