"""MuJoCo models: MJCF compiled by the `mujoco` package, then turned into our nouns.

What has no noun here (contacts, damping, fixed tendons, skins, ...) is listed in `Model.kept`, each
with what leaving it out means.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.io.mjcf.bodies import (
    MjcfNames,
    bodies_and_joints,
    couplers_and_loops,
    left_out,
    meshes_of,
    pose_of,
)
from myomorph.core.io.mjcf.compile import DEFAULT_TIME_LIMIT, compile_guarded
from myomorph.core.io.mjcf.muscles import actuators_of, muscles_of
from myomorph.core.io.mjcf.original import original_of
from myomorph.core.io.mjcf.write import MARKERS
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import MUSCLES
from myomorph.core.model.errors import BadData, BadModel, quoted
from myomorph.core.model.inertia import made_up_inertias
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Frame, Kept, Marker, Model
from myomorph.core.model.paths import Muscle, impossible_fibers
from myomorph.core.model.spatial import euler_xyz_from_rotation, rotation_from_quaternion

WIDTHS = {"free": (7, 6), "ball": (4, 3), "slide": (1, 1), "hinge": (1, 1), "weld": (0, 0)}


def read_mjcf(
    path: str | Path,
    *,
    root: str | Path | None = None,
    marker_sites: str | None = None,
    time_limit: float = DEFAULT_TIME_LIMIT,
) -> Model:
    """Read the model of an MJCF file.

    The text is checked before MuJoCo sees it, in a process of its own that is stopped after
    `time_limit`, and that gets 8 GiB of memory. Files that the model names (includes, meshes,
    height fields, textures, skins, attached models) must lie inside the model's folder tree:
    `root`, or the folder of the file or, where that belongs to a Python package, a git checkout or
    a folder with a LICENSE file, the top folder of that. A relative path that leaves the tree is
    refused by name, and so is an absolute path to an existing file outside. A mesh that is missing
    is left out with its geoms and listed in `Model.kept`.

    A file that `write_mjcf` wrote gives the model that it was written from, unless it was edited
    since or `marker_sites` is given: then it is read as MuJoCo has it.

    Source: Todorov, Erez and Tassa 2012.

    Parameters
    ----------
    path : of the file
    root : top folder of the model's files; None finds it
    marker_sites : regular expression; sites whose whole name matches become markers, instead of
        those of a tuple named "markers"
    time_limit : of processor time for compiling; of time by the clock four times as much [s]

    Returns
    -------
    the model in meters, radians and kilograms; `kept` has what is not modelled

    Raises
    ------
    BadFile : it cannot be read, is not MJCF, is unsafe, or MuJoCo refuses it
    BadModel : what it describes cannot be a tree of joints
    """
    path = Path(path)
    original = original_of(path) if marker_sites is None else None
    if original is not None:
        return original
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
    """Convert a compiled `mujoco.MjModel`.

    Every body becomes a body with one joint; several MuJoCo joints of a body are the axes of that
    joint, in order. Hinge and slide joints are one coordinate each, named as they are, whose value
    is MuJoCo's `qpos` (the axis moves by `qpos - qpos0`). A ball joint has three coordinates,
    `<joint>_rx`, `_ry`, `_rz`: body-fixed X, Y, Z angles from its default orientation. A free joint
    has `<joint>_tx`, `_ty`, `_tz` (position of the body's origin in ground) and `_rx`, `_ry`,
    `_rz`: rotation = R_x R_y R_z R_0 with R_0 the body's orientation in the file, so that the
    default pose has zero angles; `coordinates_from_qpos` converts.

    Sites become frames; geoms of the groups that MuJoCo draws (0 to 2) become meshes.

    Parameters
    ----------
    compiled : the `mujoco.MjModel`
    name : of the model, its own by default
    source : path of its file, for messages and for the folder of meshes
    marker_sites : as of `read_mjcf`
    kept : what was left out before

    Returns
    -------
    the model in meters, radians and kilograms

    Raises
    ------
    BadModel : there is no body, or a number that is not finite
    """
    _check(compiled, source)
    names = MjcfNames(compiled)
    meshes = meshes_of(compiled, source)
    bodies, joints, free_coordinates = bodies_and_joints(compiled, names, meshes)
    coordinates, couplers, loops, lost_equalities = couplers_and_loops(
        compiled, names, free_coordinates
    )
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
        frames=tuple(
            Frame(
                names.sites[i],
                names.bodies[body],
                pose_of(compiled.site_pos[i], compiled.site_quat[i]),
            )
            for i, body in enumerate(compiled.site_bodyid)
        ),
        ground_meshes=meshes[0],
        kept=(*kept, *left_out(compiled, names), *lost_equalities, *lost_tendons, *lost_actuators),
        source=source,
        warnings=(*made_up_inertias(bodies), *_of_fibers(muscles)),
    )


def _of_fibers(muscles: Sequence[Muscle]) -> tuple[Message, ...]:
    """Warn of muscles whose fibers cannot be as long as the file makes them."""
    names = impossible_fibers(muscles)
    if not names:
        return ()
    return (
        MUSCLES.message(
            f"the fibers of {len(names)} of {len(muscles)} muscles would be longer than the"
            f" muscles, or their tendons shorter than 0 ({quoted(names, 3)}): the numbers of the"
            " file give their forces and no length of fibers, so none is reported, stretched or"
            " personalized",
            severity="good to know",
        ),
    )


def _check(m: Any, source: str) -> None:
    """Raise `BadModel` where a model has no body, or a number that is not finite."""
    where = source or "the MuJoCo model"
    if m.nbody < 2:
        raise BadModel(f"{where}: has no body besides the world")
    fields = (
        "body_pos",
        "body_quat",
        "body_mass",
        "body_ipos",
        "body_inertia",
        "jnt_pos",
        "jnt_axis",
        "qpos0",
    )
    for name in (
        *fields,
        "jnt_range",
        "site_pos",
        "geom_pos",
        "geom_size",
        "eq_data",
        "actuator_lengthrange",
    ):
        if not np.all(np.isfinite(getattr(m, name))):
            raise BadModel(f"{where}: a value of '{name}' is not finite")


def _markers(m: Any, names: MjcfNames, pattern: str | None) -> tuple[Marker, ...]:
    """List the sites that are markers: those of a pattern, or of the tuple of markers.

    Parameters
    ----------
    m : the compiled model
    names : of its parts
    pattern : regular expression of whole names; None takes the tuple

    Returns
    -------
    markers with locations (3,) in their bodies [m]
    """
    if pattern is not None:
        wanted = re.compile(pattern)
        sites = [i for i in range(m.nsite) if wanted.fullmatch(names.sites[i])]
    else:
        number = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_TUPLE, MARKERS)
        first = int(m.tuple_adr[number]) if number >= 0 else 0
        members = range(first, first + int(m.tuple_size[number])) if number >= 0 else ()
        sites = [
            int(m.tuple_objid[i])
            for i in members
            if m.tuple_objtype[i] == int(mujoco.mjtObj.mjOBJ_SITE)
        ]
    return tuple(
        Marker(names.sites[i], names.bodies[m.site_bodyid[i]], m.site_pos[i]) for i in sites
    )


def coordinates_from_qpos(model: Model, qpos: ArrayLike) -> Array:
    """Convert MuJoCo's `qpos` to the values of all coordinates.

    Parameters
    ----------
    model : that `read_mjcf` made
    qpos : (..., nq) [rad, m, quaternions w, x, y, z]

    Returns
    -------
    (..., coordinates) [rad or m]; angles of ball and free joints in (-pi, pi], the middle one in
    [-pi/2, pi/2]

    Raises
    ------
    BadData : the width is not that of the model's joints, or a joint is not MuJoCo's
    """
    q = np.asarray(qpos, dtype=np.float64)
    layout = list(_layout(model))
    needed = sum(WIDTHS[kind][0] for kind, *_ in layout)
    if q.shape[-1:] != (needed,):
        raise BadData(f"expected qpos of width {needed}, but got shape {q.shape}")
    flat = q.reshape(-1, needed)
    result = np.empty((len(flat), len(model.coordinates)))
    for row, out in zip(flat, result, strict=True):
        for kind, at_q, at_c, start in layout:
            width_q, width_c = WIDTHS[kind]
            values = row[at_q : at_q + width_q]
            if kind in ("free", "ball"):
                turn = rotation_from_quaternion(values[-4:]) @ start.T
                values = np.concatenate([values[:-4], euler_xyz_from_rotation(turn)])
            out[at_c : at_c + width_c] = values
    return result.reshape(*q.shape[:-1], -1)


def _layout(model: Model) -> Iterator[tuple[str, int, int, Array]]:
    """Yield kind, index in qpos, index in coordinates and start rotation (3, 3) by joint.

    Raises
    ------
    BadData : a joint is not MuJoCo's
    """
    at_q = at_c = 0
    for joint in model.joints:
        for kind in joint.kind.split("+"):
            if kind not in WIDTHS:
                raise BadData(
                    f"joint '{joint.name}' is a {joint.kind}: only models read from MJCF have a"
                    " qpos"
                )
            start = joint.child_frame.rotation.T if kind == "free" else np.eye(3)
            yield kind, at_q, at_c, start
            at_q = at_q + WIDTHS[kind][0]
            at_c = at_c + WIDTHS[kind][1]
