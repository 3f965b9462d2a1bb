"""OpenSim's Actuation, ForceReporter, StatesReporter, JointReaction and InverseDynamics.

The last is of OpenSim 3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from myomorph.core.io.sto import read_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.messages import Message, located
from myomorph.core.model.model import GROUND, Actuator, Model
from myomorph.core.model.paths import PassiveTorque
from myomorph.core.model.series import Series
from myomorph.core.muscles.fiber_states import state_names
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import BodyMotion, body_motion, forward_kinematics
from myomorph.core.tension.reaction import joint_reactions
from myomorph.exchange.causes import SETUPS
from myomorph.exchange.opensim.states import Analyzed, Result
from myomorph.exchange.opensim.tool_setups import Analysis
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.trial.steps.id import torque_table


def actuation(here: Analyzed, analysis: Analysis) -> Result:
    """Force, speed and power of every muscle and actuator that is switched on."""
    forces = here.forces
    if forces is None:
        raise BadData(f"{analysis.name}: model '{here.model.name}' has no muscles and no actuators")
    speeds = _speeds(here, forces.names)
    # OpenSim's speed of a muscle is that of its lengthening.
    signs = np.array([-1.0 if name in here.model.muscle_names else 1.0 for name in forces.names])
    quantities = {"force": forces.values, "speed": speeds, "power": signs * forces.values * speeds}
    titles = {"force": "ActuatorForces", "speed": "ActuatorSpeeds", "power": "ActuatorPowers"}
    tables = {
        name: here.table(forces.names, values, titles[name]) for name, values in quantities.items()
    }
    return tables, f"actuation: {len(here.motion)} frames, {len(forces.names)} actuators", ()


def _speeds(here: Analyzed, names: tuple[str, ...]) -> Array:
    """How fast muscles lengthen and actuators move, (frames, actuators) [m/s or rad/s]."""
    model = here.model
    tree = here.tree
    result = np.full((len(here.motion), len(names)), np.nan)
    arrays = here.arrays
    actuators = {actuator.name: actuator for actuator in (*model.actuators, *here.actuators)}
    moved: BodyMotion | None = None
    for index, name in enumerate(names):
        if name in model.muscle_names:
            assert here.paths.muscle_velocity is not None
            result[:, index] = here.paths.muscle_velocity[:, model.muscle_names.index(name)]
        elif actuators[name].kind == "coordinate":
            result[:, index] = arrays[1][
                :, model.coordinate_names.index(actuators[name].coordinate)
            ]
        else:
            moved = body_motion(tree, *arrays) if moved is None else moved
            result[:, index] = _speed_on_bodies(actuators[name], moved, tree.body_index)
    return result


def _speed_on_bodies(actuator: Actuator, moved: BodyMotion, numbers: Mapping[str, int]) -> Array:
    """Return OpenSim's speed of an actuator between bodies.

    It is that of a point without sign, or of a torque about its axis in ground.
    """
    body = numbers[actuator.body or GROUND]
    other = numbers[actuator.other_body or GROUND]
    if actuator.kind == "torque":
        axis = actuator.direction / (np.linalg.norm(actuator.direction) or 1.0)
        turning = moved.angular_velocities[:, body] - moved.angular_velocities[:, other]
        return np.asarray(turning @ axis)

    def place(number: int, point: Array) -> tuple[Array, Array]:
        arm = (
            point - moved.origins[:, number]
            if actuator.point_is_global
            else moved.rotations[:, number] @ point
        )
        return moved.origins[:, number] + arm, moved.velocities[:, number] + np.cross(
            moved.angular_velocities[:, number], arm
        )

    at, velocity = place(body, actuator.point)
    if actuator.kind == "point":
        return np.asarray(np.linalg.norm(velocity, axis=1))
    end, back = place(other, actuator.other_point)
    apart = at - end
    return np.asarray(np.einsum("fi,fi->f", velocity - back, apart) / np.linalg.norm(apart, axis=1))


def reported_forces(here: Analyzed, analysis: Analysis) -> Result:
    """Return forces of muscles, of what holds coordinates, of actuators, and external forces."""
    names, values, notes = force_columns(here, here.forces)
    if analysis.flag("include_constraint_forces", False):
        notes = (SETUPS.message("forces of constraints are left out"), *notes)
    text = f"forces: {len(here.motion)} frames, {len(names)} columns"
    tables = {"forces": here.table(names, values, "ModelForces")}
    return tables, text, located(analysis.name, notes)


def force_columns(
    here: Analyzed, forces: Series | None
) -> tuple[tuple[str, ...], Array, tuple[Message, ...]]:
    """Return all forces of muscles and actuators at each frame as OpenSim reports them.

    External forces and torques are in ground, the points that they act on in the frame of their
    body.

    Parameters
    ----------
    here : model, motion and loads
    forces : (frames, muscles and actuators) [N, or N m]; None without

    Returns
    -------
    names, values (frames, columns) [N, N m or m], and notes of what is left out
    """
    muscles = here.model.muscle_names
    columns: dict[str, Array] = {}
    if forces is not None:
        columns |= {name: forces[name] for name in forces.names if name in muscles}
    _add_passive_torques(columns, here)
    if forces is not None:
        columns |= {name: forces[name] for name in forces.names if name not in muscles}
    columns |= _external(here)
    frames = len(here.motion)
    values = np.stack(list(columns.values()), axis=1) if columns else np.zeros((frames, 0))
    return tuple(columns), values, tuple(_left_out(here.model))


def _add_passive_torques(columns: dict[str, Array], here: Analyzed) -> None:
    """Add the passive torques of coordinates, (frames,) each; both sides of a limit are one."""
    coordinates, rates, _ = here.arrays
    for torque in here.model.passive_torques:
        j = here.model.coordinate_names.index(torque.coordinate)
        name = _limit_name(torque) if _limit(torque) else f"{torque.name}_Force"
        before = columns.get(name, np.zeros(len(here.motion)))
        columns[name] = before + torque.total(coordinates[:, j], rates[:, j])


def _left_out(model: Model) -> list[Message]:
    """Report columns that OpenSim would have beside these."""
    limits = {_limit_name(torque) for torque in model.passive_torques if _limit(torque)}
    notes = []
    if limits:
        notes.append(
            SETUPS.message(f"the column PotentialEnergy of {', '.join(sorted(limits))} is left out")
        )
    if model.bushings:
        names = ", ".join(bushing.name for bushing in model.bushings)
        notes.append(SETUPS.message(f"forces of {names} are left out"))
    return notes


def _limit_name(torque: PassiveTorque) -> str:
    """Return the name of the CoordinateLimitForce of which a torque is a side."""
    return torque.name.removesuffix("_upper").removesuffix("_lower")


def _limit(passive_torque: PassiveTorque) -> bool:
    """Whether it is a side of a CoordinateLimitForce, as the reader of models names it."""
    return passive_torque.name.endswith(("_upper", "_lower"))


def _external(here: Analyzed) -> dict[str, Array]:
    loads = here.wrenches
    if loads is None:
        return {}
    tree = here.tree
    poses = forward_kinematics(tree, tree.coordinates_of(here.motion))
    result: dict[str, Array] = {}
    for index, (name, body) in enumerate(zip(loads.names, loads.bodies, strict=True)):
        b = tree.body_index[body]
        apart = loads.points[:, index] - poses.origins[:, b]
        point = np.einsum("fji,fj->fi", poses.rotations[:, b], apart)
        for letter, vector in (
            ("F", loads.forces[:, index]),
            ("p", point),
            ("T", loads.torques[:, index]),
        ):
            result |= {
                f"{body}_{name}_{letter}{axis}": vector[:, i] for i, axis in enumerate("xyz")
            }
    return result


def reported_states(here: Analyzed, analysis: Analysis) -> Result:
    """Return the states at every frame, as OpenSim 4 names them."""
    model = here.model
    arrays = here.arrays
    columns: dict[str, Array] = {}
    for joint in model.joints:
        for name in joint.coordinates:
            column = model.coordinate_names.index(name)
            columns[f"/jointset/{joint.name}/{name}/value"] = arrays[0][:, column]
            columns[f"/jointset/{joint.name}/{name}/speed"] = arrays[1][:, column]
    notes: tuple[Message, ...] = ()
    if here.without_fibers:
        notes = (
            (
                SETUPS.message(
                    f"{analysis.name} leaves out states of muscles:"
                    f" {', '.join(here.without_fibers)}: not supported"
                )
            ),
        )
    else:
        for muscle in model.muscles:
            for state in state_names(muscle):
                columns[f"/forceset/{muscle.name}/{state}"] = here.states[muscle.name, state]
    values = np.stack(list(columns.values()), axis=1)
    text = f"states: {len(here.motion)} frames, {len(columns)} states"
    return {"states": here.table(tuple(columns), values, "ModelStates")}, text, notes


def inverse_dynamics_analysis(here: Analyzed, analysis: Analysis) -> Result:
    """Return the generalized forces that the motion needs.

    It is the InverseDynamics analysis of OpenSim 3, which 4 no longer has.
    """
    reading.has_mass(here.model, "inverse dynamics")
    if analysis.flag("use_model_force_set", True):
        raise BadData(
            f"{analysis.name}: use_model_force_set is not supported: expected false, or"
            " InverseDynamicsTool"
        )
    torques = inverse_dynamics(here.model, here.motion, here.wrenches)
    text = f"inverse dynamics: {len(torques)} frames, {len(torques.names)} coordinates"
    return {"": torque_table(torques, here.model)}, text, ()


def joint_reaction(here: Analyzed, analysis: Analysis) -> Result:
    """Return the table `..._ReactionLoads.sto` of a JointReaction analysis, and warnings.

    As OpenSim, the analysis takes the accelerations that all forces together cause; those of the
    motion are not read. Without a forces_file, forces of muscles are those of their states.
    """
    reading.has_mass(here.model, "joint reactions")
    model = here.model
    motion = here.motion
    actuators = here.actuators
    known = tuple(joint.name for joint in model.joints)
    names = tuple(analysis.options.get("joint_names", "").split()) or ("ALL",)
    if names[0].upper() == "ALL":
        names = known
    kept = [index for index, name in enumerate(names) if name in known]
    if not kept:
        raise UnknownName("joint", names[0], known)
    warnings = [
        SETUPS.message(f"'{name}' is not a joint: left out") for name in names if name not in known
    ]
    # OpenSim takes the words for sides in any case.
    sides = _of_each(analysis, "apply_on_bodies", "child", names, kept, str.lower)
    frames = _of_each(analysis, "express_in_frame", "ground", names, kept)
    forces, notes = _forces(here, analysis.forces)
    reactions = joint_reactions(
        model,
        motion,
        forces,
        here.wrenches,
        [names[index] for index in kept],
        sides,  # type: ignore[arg-type]
        frames,
        actuators=actuators,
        accelerations="forces",
        patella="string",
    )
    text = f"joint reactions: {len(reactions)} frames, {len(reactions.joints)} joints"
    if np.isfinite(reactions.forces).any():
        sizes = np.linalg.norm(reactions.forces, axis=2)
        worst = np.unravel_index(int(np.nanargmax(sizes)), sizes.shape)
        text += f", largest force {sizes[worst]:.0f} N ({reactions.joints[worst[1]]})"
    return {"ReactionLoads": reactions.table()}, text, (*warnings, *notes)


def _of_each(
    analysis: Analysis,
    tag: str,
    default: str,
    names: Sequence[str],
    kept: Sequence[int],
    spelt: Callable[[str], str] = str,
) -> list[str]:
    """Return the word of a list for each joint that is kept.

    The list has one for all, or one per joint as they are listed.
    """
    words = [spelt(word) for word in analysis.options.get(tag, "").split()] or [default]
    if len(words) not in (1, len(names)):
        raise BadData(
            f"{analysis.name}: {tag} names {len(words)} for {len(names)} joints: expected 1 or as"
            " many"
        )
    return [words[index] if len(words) > 1 else words[0] for index in kept]


def _forces(here: Analyzed, path: Path | None) -> tuple[Series | None, tuple[Message, ...]]:
    """Read forces of all muscles and actuators at the motion's times.

    Between rows of the file they follow straight lines.
    """
    model = here.model
    time = here.motion.time
    actuators = here.actuators
    added = {actuator.name for actuator in actuators}
    helpers = [actuator.name for actuator in (*model.actuators, *actuators) if actuator.enabled]
    names = tuple(
        dict.fromkeys([muscle.name for muscle in model.muscles if muscle.enabled] + helpers)
    )
    if path is None:
        notes = (
            (SETUPS.message(f"no forces_file: {len(helpers)} actuators are taken to do nothing"),)
            if helpers
            else ()
        )
        return here.forces, notes
    with reading.about(path):
        table = read_sto(path)
        values = np.empty((len(time), len(names)))
        for index, name in enumerate(names):
            if name not in table.names:
                where = "the forces_file" + (" (force_set_files added it)" if name in added else "")
                raise UnknownName("actuator", name, existing=table.names, where=where)
            values[:, index] = np.interp(time, table.time, table[name])
        if time[0] < table.time[0] - 1e-6 or time[-1] > table.time[-1] + 1e-6:
            raise BadData(
                f"has forces from {table.time[0]:g} to {table.time[-1]:g} s, but the analysis runs"
                f" from {time[0]:g} to {time[-1]:g} s"
            )
    return Series(time, names, values), ()
