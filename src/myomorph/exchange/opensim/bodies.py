"""OpenSim's BodyKinematics, PointKinematics, Kinematics and MuscleAnalysis.

They report how bodies and muscles move.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadModel, UnknownName
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.spatial import euler_xyz_from_rotation
from myomorph.core.rigid.dynamics import motion_arrays
from myomorph.core.rigid.kinematics import BodyMotion, body_motion
from myomorph.exchange.causes import SETUPS
from myomorph.exchange.opensim.states import Analyzed, Result
from myomorph.exchange.opensim.tool_setups import Analysis

WHOLE = "center_of_mass"
TITLES = {"pos": "Positions", "vel": "Velocities", "acc": "Accelerations"}
"""Tables of BodyKinematics by the ends of their names."""

# Moment arms (frames x muscles x coordinates) that are in memory at a time.
MAX_ENTRIES = 20_000_000
FIBERS = {
    "PennationAngle": "pennation",
    "FiberLength": "fiber_length",
    "TendonLength": "tendon_length",
    "FiberVelocity": "fiber_velocity",
    "NormFiberVelocity": "normalized_velocity",
    "PennationAngularVelocity": "pennation_velocity",
    "TendonForce": "tendon_force",
    "FiberForce": "fiber_force",
    "ActiveFiberForce": "active_force",
    "PassiveFiberForce": "passive_force",
    "FiberActivePower": "active_power",
    "FiberPassivePower": "passive_power",
    "TendonPower": "tendon_power",
    "MuscleActuatorPower": "muscle_power",
}
"""OpenSim's tables that are arrays of `FiberStates`."""


def muscle_analysis(here: Analyzed, analysis: Analysis) -> Result:
    """All tables of a MuscleAnalysis by their names, what was found, and warnings."""
    model = here.model
    if not model.muscles:
        raise BadModel(f"model '{model.name}' has no muscles")
    names, notes = listed(analysis, "muscle_list", "muscle", model.muscle_names)
    moving = analysis.flag("compute_moments", True)
    about: tuple[str, ...] = ()
    if moving:
        about, left_out = listed(
            analysis, "moment_arm_coordinate_list", "coordinate", model.coordinate_names
        )
        notes += left_out
    columns = [model.muscle_names.index(name) for name in names]
    quantities: dict[str, Array] = {"Length": here.paths.muscle_length[:, columns]}
    if here.without_fibers:
        classes = ", ".join(here.without_fibers)
        notes.append(
            SETUPS.message(
                f"{analysis.name} writes Length and MomentArm only: fibers of {classes} are not"
                " supported"
            )
        )
    else:
        quantities |= _fibers(here, columns)
        notes += here.unbalanced
    pulls = None if here.without_fibers else here.fibers.tendon_force[:, columns]
    for name, arms in _moment_arms(here, columns, about):
        quantities[f"MomentArm_{name}"] = arms
        if pulls is not None:
            quantities[f"Moment_{name}"] = arms * pulls
    tables = {name: here.table(names, values, name) for name, values in quantities.items()}
    text = (
        f"muscle analysis: {len(here.motion)} frames, {len(names)} muscles, {len(about)}"
        " coordinates"
    )
    return tables, text, tuple(notes)


def _fibers(here: Analyzed, columns: list[int]) -> dict[str, Array]:
    fibers = here.fibers
    result = {name: getattr(fibers, attribute)[:, columns] for name, attribute in FIBERS.items()}
    optimal = np.array([here.model.muscles[column].optimal_fiber_length for column in columns])
    cosine = np.cos(result["PennationAngle"])
    result["NormalizedFiberLength"] = result["FiberLength"] / optimal
    for name in ("ActiveFiberForce", "PassiveFiberForce"):
        result[f"{name}AlongTendon"] = result[name] * cosine
    return result


def _moment_arms(
    here: Analyzed, columns: list[int], about: tuple[str, ...]
) -> Iterator[tuple[str, Array]]:
    """Moment arms (frames, muscles) about each coordinate [m or 1]."""
    if not about:
        return
    model = here.model
    frames = len(here.motion)
    arms = np.empty((len(about), frames, len(columns)))
    wanted = [model.coordinate_names.index(name) for name in about]
    block = max(1, MAX_ENTRIES // (len(model.muscles) * len(model.coordinates)))
    for start in range(0, frames, block):
        part = slice(start, start + block)
        arms[:, part] = np.moveaxis(here.paths.dense(part)[:, columns][:, :, wanted], 2, 0)
    yield from zip(about, arms, strict=True)


def listed(
    analysis: Analysis, tag: str, kind: str, names: tuple[str, ...]
) -> tuple[tuple[str, ...], list[Message]]:
    """Return the names that a list of an analysis requests, in its order.

    The notes name what the model lacks. `tag`: of the list; empty or beginning with "all" it
    requests all names; `kind`: of what is listed, for the notes.
    """
    asked = tuple(analysis.options.get(tag, "").split())
    if not asked or asked[0].lower() == "all":
        return names, []
    notes = [
        SETUPS.message(f"{analysis.name}: {kind} '{name}' is not in the model: left out")
        for name in asked
        if name not in names
    ]
    return tuple(name for name in asked if name in names), notes


def body_kinematics(here: Analyzed, analysis: Analysis) -> Result:
    """Return centers of mass and orientations of bodies, and the model's center of mass.

    The tables are pos, vel and acc, in ground; velocities and accelerations in the bodies' own axes
    where the analysis requests so. Orientations are body-fixed X-Y-Z angles.
    """
    model = here.model
    names, notes = listed(analysis, "bodies", "body", (*model.body_names, WHOLE))
    if not names:
        raise BadData(
            f"{analysis.name}: none of its bodies ({', '.join(analysis.options['bodies'].split())})"
            f" is in model '{model.name}'"
        )
    bodies = [name for name in names if name != WHOLE]
    moved, numbers = _moved(here)
    degrees = in_degrees(analysis)
    in_body = analysis.flag("express_results_in_body_local_frame", False)
    labels = [f"{body}_{axis}" for body in bodies for axis in ("X", "Y", "Z", "Ox", "Oy", "Oz")]
    index = np.array([numbers[name] for name in bodies], np.int64)
    centers = np.array([model.body(name).mass_center for name in bodies]).reshape(-1, 3)
    values = _body_values(moved, index, centers, in_body, 180.0 / np.pi if degrees else 1.0)
    if WHOLE in names:
        labels += [f"{WHOLE}_{axis}" for axis in "XYZ"]
        whole = _center_of_mass(model, moved, numbers)
        values = [np.hstack(pair) for pair in zip(values, whole, strict=True)]
    tables = {
        _table_name(kind, in_body): here.table(labels, part, title, degrees)
        for (kind, title), part in zip(TITLES.items(), values, strict=True)
    }
    return (
        tables,
        f"body kinematics: {len(here.motion)} frames, {len(bodies)} bodies",
        tuple(notes),
    )


def _table_name(kind: str, in_body: bool) -> str:
    """Name a table of BodyKinematics by its frame; positions are in ground."""
    frame = "bodyLocal" if in_body and kind != "pos" else "global"
    return f"{kind}_{frame}"


def _body_values(
    moved: BodyMotion, index: np.ndarray, centers: Array, in_body: bool, factor: float
) -> list[Array]:
    """Return the columns of each table of BodyKinematics.

    Parameters
    ----------
    moved : motion of all bodies
    index : (bodies,) those to report
    centers : (bodies, 3) their centers of mass, in their own frames [m]
    in_body : velocities and accelerations in the bodies' own axes
    factor : of angles, from radians

    Returns
    -------
    positions, velocities and accelerations, (frames, 6 bodies) each
    """
    rotations = moved.rotations[:, index]
    angles = (
        euler_xyz_from_rotation(rotations),
        moved.angular_velocities[:, index],
        moved.angular_accelerations[:, index],
    )
    values = []
    for order, (places, turning) in enumerate(
        zip(moved.of_points(index, centers), angles, strict=True)
    ):
        if in_body and order > 0:
            places = np.einsum("fbji,fbj->fbi", rotations, places)
            turning = np.einsum("fbji,fbj->fbi", rotations, turning)
        both = np.concatenate([places, factor * turning], axis=2)
        values.append(both.reshape(len(rotations), -1))
    return values


def point_kinematics(here: Analyzed, analysis: Analysis) -> Result:
    """Return position, velocity and acceleration of a point of a body.

    They are in ground or in the axes of another body.
    """
    moved, numbers = _moved(here)
    body = analysis.options.get("body_name", GROUND).strip().rsplit("/", 1)[-1]
    other = analysis.options.get("relative_to_body_name", "none").strip().rsplit("/", 1)[-1]
    for name in (body, other):
        if name not in numbers and name != "none":
            raise UnknownName(
                "body", name, existing=tuple(numbers), where=f"for {analysis.name} the model"
            )
    text = analysis.options.get("point", "0 0 0")
    try:
        place = np.array([float(number) for number in text.split()])
    except ValueError:
        place = np.zeros(0)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise BadData(f"{analysis.name}: point is '{text}': expected three numbers")
    derivatives = [
        of_point[:, 0] for of_point in moved.of_points(np.array([numbers[body]]), place[None])
    ]
    if other != "none":
        turn = moved.rotations[:, numbers[other]]
        origin = moved.origins[:, numbers[other]]
        derivatives[0] = derivatives[0] - origin
        derivatives = [np.einsum("fji,fj->fi", turn, vectors) for vectors in derivatives]
    point = analysis.options.get("point_name", "") or "NONAME"
    titles = {"pos": "PointPosition", "vel": "PointVelocity", "acc": "PointAcceleration"}
    tables = {
        f"{point}_{kind}": here.table(("state_0", "state_1", "state_2"), values, title)
        for (kind, title), values in zip(titles.items(), derivatives, strict=True)
    }
    return tables, f"point kinematics: {len(here.motion)} frames, point '{point}' of {body}", ()


def kinematics(here: Analyzed, analysis: Analysis) -> Result:
    """Coordinates, speeds, and the accelerations that all forces cause: tables q, u and dudt."""
    model = here.model
    names, notes = listed(analysis, "coordinates", "coordinate", model.coordinate_names)
    arrays = motion_arrays(here.tree, here.caused)
    columns = [model.coordinate_names.index(name) for name in names]
    turning = np.array(
        [in_degrees(analysis) and model.coordinate(name).motion == "rotational" for name in names]
    )
    factor = np.where(turning, 180.0 / np.pi, 1.0)
    titles = (("q", "Coordinates"), ("u", "Speeds"), ("dudt", "Accelerations"))
    tables = {
        kind: here.table(names, values[:, columns] * factor, title, in_degrees(analysis))
        for (kind, title), values in zip(titles, arrays, strict=True)
    }
    return tables, f"kinematics: {len(here.motion)} frames, {len(names)} coordinates", tuple(notes)


def in_degrees(analysis: Analysis) -> bool:
    """Whether the analysis wants angles in degrees, as it does by default."""
    return analysis.flag("in_degrees", True)


def _moved(here: Analyzed) -> tuple[BodyMotion, dict[str, int]]:
    return body_motion(here.tree, *motion_arrays(here.tree, here.caused)), dict(
        here.tree.body_index
    )


def _center_of_mass(model: Model, moved: BodyMotion, numbers: dict[str, int]) -> tuple[Array, ...]:
    """Position, velocity and acceleration (frames, 3) of the model's center of mass."""
    index = np.array([numbers[name] for name in model.body_names], np.int64)
    mass = np.array([body.mass for body in model.bodies])
    derivatives = moved.of_points(index, np.array([body.mass_center for body in model.bodies]))
    return tuple(np.einsum("b,fbi->fi", mass, vectors) / mass.sum() for vectors in derivatives)
