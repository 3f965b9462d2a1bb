"""OpenSim's BodyKinematics, PointKinematics and Kinematics: how bodies, points and coordinates move."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from myomorph.io.osim.tool_setups import Analysis
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, UnknownName
from myomorph.model.model import GROUND, Model
from myomorph.model.series import Motion, Table
from myomorph.opensim_tools.muscles import Tables, listed
from myomorph.opensim_tools.states import Analyzed
from myomorph.rigid.body_motion import BodyMotion, body_motion
from myomorph.rigid.dynamics import motion_arrays
from myomorph.rigid.tree import compile_tree

WHOLE = "center_of_mass"


def body_kinematics(here: Analyzed, analysis: Analysis) -> tuple[Tables, str, tuple[str, ...]]:
    """Mass centers and orientations of bodies, and the center of mass of the model: pos, vel and acc.

    In ground; velocities and accelerations in the bodies' own axes where the analysis says so. Orientations are
    body-fixed X-Y-Z angles.

    Raises
    ------
    BadData
        None of the bodies asked for is in the model.
    """
    model = here.model
    known = (*model.body_names, WHOLE)
    names, unknown = listed(analysis.options.get("bodies", ""), known)
    notes = tuple(f"{analysis.name}: body '{name}' is not in the model: left out" for name in unknown)
    if not names:
        raise BadData(f"{analysis.name}: none of its bodies ({', '.join(unknown)}) is in model '{model.name}'")
    bodies = [name for name in names if name != WHOLE]
    moved, numbers = _moved(here)
    index = np.array([numbers[name] for name in bodies], np.int64)
    centers = np.array([model.body(name).mass_center for name in bodies]).reshape(-1, 3)
    own = analysis.flag("express_results_in_body_local_frame", False)
    factor = 180.0 / np.pi if in_degrees(analysis) else 1.0
    turns = moved.rotations[:, index]
    angles = (euler_angles(turns), moved.angular_velocities[:, index], moved.angular_accelerations[:, index])
    tables: Tables = {}
    titles = (("pos", "Positions"), ("vel", "Velocities"), ("acc", "Accelerations"))
    whole = _center_of_mass(model, moved, numbers) if WHOLE in names else None
    columns = tuple(f"{body}_{axis}" for body in bodies for axis in ("X", "Y", "Z", "Ox", "Oy", "Oz"))
    for k, (kind, title) in enumerate(titles):
        places, turning = moved.of_points(index, centers)[k], angles[k]
        if own and kind != "pos":
            places, turning = (np.einsum("fbji,fbj->fbi", turns, one) for one in (places, turning))
        values = np.concatenate([places, factor * turning], axis=2).reshape(len(here.motion), -1)
        labels = columns
        if whole is not None:
            values = np.hstack([values, whole[k]])
            labels = (*columns, *(f"{WHOLE}_{axis}" for axis in "XYZ"))
        name = f"{kind}_bodyLocal" if own and kind != "pos" else f"{kind}_global"
        tables[name] = _table(here.motion, labels, values, title, analysis)
    text = f"body kinematics: {len(here.motion)} frames, {len(bodies)} bodies"
    return tables, text, notes


def point_kinematics(here: Analyzed, analysis: Analysis) -> tuple[Tables, str, tuple[str, ...]]:
    """Place, velocity and acceleration of a point of a body, in ground or in the axes of another body.

    Raises
    ------
    UnknownName
        A body is not in the model.
    BadData
        The point is not three numbers.
    """
    moved, numbers = _moved(here)
    body, other = (
        analysis.options.get(tag, default).strip().rsplit("/", 1)[-1]
        for tag, default in (("body_name", GROUND), ("relative_to_body_name", "none"))
    )
    for name in (body, other):
        if name not in numbers and name != "none":
            raise UnknownName("body", name, tuple(numbers), f"for {analysis.name} the model")
    told = analysis.options.get("point", "0 0 0")
    try:
        place = np.array([float(one) for one in told.split()])
    except ValueError:
        place = np.zeros(0)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise BadData(f"{analysis.name}: point is '{told}': expected three numbers")
    found = [one[:, 0] for one in moved.of_points(np.array([numbers[body]]), place[None])]
    if other != "none":
        turn, origin = moved.rotations[:, numbers[other]], moved.origins[:, numbers[other]]
        found[0] = found[0] - origin
        found = [np.einsum("fji,fj->fi", turn, one) for one in found]
    point = analysis.options.get("point_name", "") or "NONAME"
    titles = {"pos": "PointPosition", "vel": "PointVelocity", "acc": "PointAcceleration"}
    tables = {
        f"{point}_{kind}": Table(
            here.motion.time, ("state_0", "state_1", "state_2"), values, facts=MappingProxyType({"name": title})
        )
        for (kind, title), values in zip(titles.items(), found, strict=True)
    }
    return tables, f"point kinematics: {len(here.motion)} frames, point '{point}' of {body}", ()


def kinematics(here: Analyzed, analysis: Analysis) -> tuple[Tables, str, tuple[str, ...]]:
    """Coordinates, speeds, and the accelerations that all forces cause: tables q, u and dudt."""
    model = here.model
    names, unknown = listed(analysis.options.get("coordinates", ""), model.coordinate_names)
    notes = tuple(f"{analysis.name}: coordinate '{name}' is not in the model: left out" for name in unknown)
    arrays = motion_arrays(compile_tree(model), here.caused)
    columns = [model.coordinate_names.index(name) for name in names]
    turning = np.array([in_degrees(analysis) and model.coordinate(name).motion == "rotational" for name in names])
    factor = np.where(turning, 180.0 / np.pi, 1.0)
    titles = (("q", "Coordinates"), ("u", "Speeds"), ("dudt", "Accelerations"))
    tables = {
        kind: _table(here.motion, names, values[:, columns] * factor, title, analysis)
        for (kind, title), values in zip(titles, arrays, strict=True)
    }
    return tables, f"kinematics: {len(here.motion)} frames, {len(names)} coordinates", notes


def in_degrees(analysis: Analysis) -> bool:
    """Whether the analysis wants angles in degrees, as it does by default."""
    return analysis.flag("in_degrees", True)


def euler_angles(rotations: Array) -> Array:
    """Body-fixed X-Y-Z angles (..., 3) of rotation matrices (..., 3, 3) [rad]."""
    sine = np.clip(rotations[..., 0, 2], -1.0, 1.0)
    level = np.abs(sine) >= 1.0 - 1e-14
    first = np.arctan2(-rotations[..., 1, 2], rotations[..., 2, 2])
    last = np.arctan2(-rotations[..., 0, 1], rotations[..., 0, 0])
    # Where the first and the last axis coincide, the first angle takes all.
    first = np.where(level, np.arctan2(rotations[..., 2, 1], rotations[..., 1, 1]), first)
    return np.stack([first, np.arcsin(sine), np.where(level, 0.0, last)], axis=-1)


def _moved(here: Analyzed) -> tuple[BodyMotion, dict[str, int]]:
    tree = compile_tree(here.model)
    return body_motion(tree, *motion_arrays(tree, here.caused)), dict(tree.body_index)


def _center_of_mass(model: Model, moved: BodyMotion, numbers: dict[str, int]) -> tuple[Array, ...]:
    """Place, velocity and acceleration (frames, 3) of the model's center of mass."""
    index = np.array([numbers[name] for name in model.body_names], np.int64)
    mass = np.array([one.mass for one in model.bodies])
    found = moved.of_points(index, np.array([one.mass_center for one in model.bodies]))
    return tuple(np.einsum("b,fbi->fi", mass, one) / mass.sum() for one in found)


def _table(motion: Motion, names: tuple[str, ...], values: Array, title: str, analysis: Analysis) -> Table:
    facts = MappingProxyType({"name": title})
    return Table(motion.time, names, values, in_degrees=in_degrees(analysis), facts=facts)
