"""OpenSim's Actuation, ForceReporter, StatesReporter and (of OpenSim 3) InverseDynamics analyses."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from myomorph.io.osim.tool_setups import Analysis
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import GROUND, Actuator
from myomorph.model.paths import PassiveTorque
from myomorph.model.series import Series, Table
from myomorph.muscles.fiber_states import state_names
from myomorph.opensim_tools.muscles import Tables
from myomorph.opensim_tools.states import Analyzed
from myomorph.rigid.body_motion import BodyMotion, body_motion
from myomorph.rigid.dynamics import inverse_dynamics, motion_arrays
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree
from myomorph.study.trial import inputs
from myomorph.study.trial.steps.id import torque_table


def actuation(here: Analyzed, analysis: Analysis) -> tuple[Tables, str, tuple[str, ...]]:
    """Force, speed and power of every muscle and actuator that is switched on.

    Raises
    ------
    BadData
        where the model has neither
    """
    forces = here.forces
    if forces is None:
        raise BadData(f"{analysis.name}: model '{here.model.name}' has no muscles and no actuators")
    speeds = _speeds(here, forces.names)
    # OpenSim's speed of a muscle is that of its lengthening.
    signs = np.array([-1.0 if name in here.model.muscle_names else 1.0 for name in forces.names])
    found = {"force": forces.values, "speed": speeds, "power": signs * forces.values * speeds}
    titles = {"force": "ActuatorForces", "speed": "ActuatorSpeeds", "power": "ActuatorPowers"}
    tables = {
        name: Table(here.motion.time, forces.names, values, facts=MappingProxyType({"name": titles[name]}))
        for name, values in found.items()
    }
    return tables, f"actuation: {len(here.motion)} frames, {len(forces.names)} actuators", ()


def _speeds(here: Analyzed, names: tuple[str, ...]) -> Array:
    """How fast muscles lengthen and actuators move, (frames, actuators) [m/s or rad/s]."""
    model, tree = here.model, compile_tree(here.model)
    found = np.full((len(here.motion), len(names)), np.nan)
    arrays = motion_arrays(tree, here.motion)
    actuators = {one.name: one for one in (*model.actuators, *here.actuators)}
    moved: BodyMotion | None = None
    for k, name in enumerate(names):
        if name in model.muscle_names:
            assert here.paths.velocities is not None
            found[:, k] = here.paths.velocities[:, model.muscle_names.index(name)]
        elif actuators[name].kind == "coordinate":
            found[:, k] = arrays[1][:, model.coordinate_names.index(actuators[name].coordinate)]
        else:
            moved = body_motion(tree, *arrays) if moved is None else moved
            found[:, k] = _speed_on_bodies(actuators[name], moved, tree.body_index)
    return found


def _speed_on_bodies(one: Actuator, moved: BodyMotion, numbers: Mapping[str, int]) -> Array:
    """OpenSim's speed of an actuator between bodies: of a point without sign, of a torque about its axis in ground."""
    body, other = (numbers[name or GROUND] for name in (one.body, one.other_body))
    if one.kind == "torque":
        axis = one.direction / (np.linalg.norm(one.direction) or 1.0)
        turning = moved.angular_velocities[:, body] - moved.angular_velocities[:, other]
        return np.asarray(turning @ axis)

    def place(number: int, point: Array) -> tuple[Array, Array]:
        arm = point - moved.origins[:, number] if one.point_is_global else moved.rotations[:, number] @ point
        return moved.origins[:, number] + arm, moved.velocities[:, number] + np.cross(
            moved.angular_velocities[:, number], arm
        )

    at, velocity = place(body, one.point)
    if one.kind == "point":
        return np.asarray(np.linalg.norm(velocity, axis=1))
    end, back = place(other, one.other_point)
    apart = at - end
    return np.asarray(np.einsum("fi,fi->f", velocity - back, apart) / np.linalg.norm(apart, axis=1))


def reported_forces(here: Analyzed, analysis: Analysis) -> tuple[Tables, str, tuple[str, ...]]:
    """Forces of muscles, of what holds coordinates, of actuators, and external forces."""
    if analysis.flag("include_constraint_forces", False):
        told: tuple[str, ...] = (f"{analysis.name}: forces of constraints are left out",)
    else:
        told = ()
    names, values, notes = force_columns(here, here.forces)
    facts = MappingProxyType({"name": "ModelForces"})
    table = Table(here.motion.time, names, values, facts=facts)
    text = f"forces: {len(here.motion)} frames, {len(names)} columns"
    return {"forces": table}, text, (*told, *(f"{analysis.name}: {one}" for one in notes))


def force_columns(here: Analyzed, forces: Series | None) -> tuple[tuple[str, ...], Array, tuple[str, ...]]:
    """All forces at each frame as OpenSim reports them: names, values (frames, columns), and what is left out.

    External forces and torques are in ground, the points that they act on in the frame of their body.

    Parameters
    ----------
    forces : of muscles and actuators
    """
    model, frames = here.model, len(here.motion)
    c, rates, _ = motion_arrays(compile_tree(model), here.motion)
    pulling = [] if forces is None else [name for name in forces.names if name in model.muscle_names]
    found: dict[str, Array] = {} if forces is None else {name: forces[name] for name in pulling}
    limits = {one.name.removesuffix("_upper").removesuffix("_lower") for one in model.passive_torques if _limit(one)}
    for one in model.passive_torques:
        j = model.coordinate_names.index(one.coordinate)
        name = one.name.removesuffix("_upper").removesuffix("_lower") if _limit(one) else f"{one.name}_Force"
        found[name] = found.get(name, np.zeros(frames)) + one.total(c[:, j], rates[:, j])
    if forces is not None:
        found |= {name: forces[name] for name in forces.names if name not in pulling}
    found |= _external(here)
    notes = [f"the column PotentialEnergy of {', '.join(sorted(limits))} is left out"] if limits else []
    if model.bushings:
        notes.append(f"forces of {', '.join(one.name for one in model.bushings)} are left out")
    values = np.stack(list(found.values()), axis=1) if found else np.zeros((frames, 0))
    return tuple(found), values, tuple(notes)


def _limit(one: PassiveTorque) -> bool:
    """Whether it is a side of a CoordinateLimitForce, as the reader of models names it."""
    return one.name.endswith(("_upper", "_lower"))


def _external(here: Analyzed) -> dict[str, Array]:
    loads = here.wrenches
    if loads is None:
        return {}
    tree = compile_tree(here.model)
    poses = forward_kinematics(tree, tree.coordinates_of(here.motion))
    found: dict[str, Array] = {}
    for k, (name, body) in enumerate(zip(loads.names, loads.bodies, strict=True)):
        b = tree.body_index[body]
        apart = loads.points[:, k] - poses.origins[:, b]
        point = np.einsum("fji,fj->fi", poses.rotations[:, b], apart)
        for letter, vector in (("F", loads.forces[:, k]), ("p", point), ("T", loads.torques[:, k])):
            found |= {f"{body}_{name}_{letter}{axis}": vector[:, i] for i, axis in enumerate("xyz")}
    return found


def reported_states(here: Analyzed, analysis: Analysis) -> tuple[Tables, str, tuple[str, ...]]:
    """The states at every frame, as OpenSim 4 names them."""
    model = here.model
    arrays = motion_arrays(compile_tree(model), here.motion)
    columns: dict[str, Array] = {}
    for joint in model.joints:
        for name in joint.coordinates:
            k = model.coordinate_names.index(name)
            columns[f"/jointset/{joint.name}/{name}/value"] = arrays[0][:, k]
            columns[f"/jointset/{joint.name}/{name}/speed"] = arrays[1][:, k]
    notes: tuple[str, ...] = ()
    if here.without_fibers:
        notes = (
            f"{analysis.name} leaves out states of muscles: those of {', '.join(here.without_fibers)} are not built",
        )
    else:
        for muscle in model.muscles:
            for state in state_names(muscle):
                columns[f"/forceset/{muscle.name}/{state}"] = here.states[muscle.name, state]
    facts = MappingProxyType({"name": "ModelStates"})
    values = np.stack(list(columns.values()), axis=1)
    text = f"states: {len(here.motion)} frames, {len(columns)} states"
    return {"states": Table(here.motion.time, tuple(columns), values, facts=facts)}, text, notes


def net_torques(here: Analyzed, analysis: Analysis) -> tuple[Tables, str, tuple[str, ...]]:
    """Generalized forces that the motion needs: the InverseDynamics analysis of OpenSim 3, which 4 no longer has."""
    inputs.has_mass(here.model, "inverse dynamics")
    if analysis.flag("use_model_force_set", True):
        raise BadData(
            f"{analysis.name}: use_model_force_set is true, which is not built: expected false, or InverseDynamicsTool"
        )
    torques = inverse_dynamics(here.model, here.motion, here.wrenches)
    text = f"inverse dynamics: {len(torques)} frames, {len(torques.names)} coordinates"
    return {"": torque_table(torques, here.model)}, text, ()
