"""Shares of what moves a body: generalized forces of muscles, reserves, torques and feedback."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.series import Series
from myomorph.core.muscles.hill import viscosities
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.forward import gathered
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.terms.actuators import floating_joints
from myomorph.forward.drives import Drives
from myomorph.forward.simulation import Simulation

JOINTS = "Joints"
UNITS = {"rotational": "N m", "translational": "N"}


@dataclass(frozen=True, kw_only=True)
class Share:
    """Root mean squares over time and coordinates of a part of the body.

    Attributes
    ----------
    where : the joints, or the body that floats
    unit : N m of coordinates that rotate, N of others
    sizes : by cause [unit]
    """

    where: str
    unit: str
    sizes: Mapping[str, float]

    @property
    def sentence(self) -> str:
        """Causes with their sizes."""
        parts = [f"{cause} {size:.3g}" for cause, size in self.sizes.items()]
        return f"{', '.join(parts)} {self.unit}"


def shares_of(simulation: Simulation, drives: Drives) -> tuple[Share, ...]:
    """Find what moved the joints, and what held a body that floats.

    Parameters
    ----------
    simulation : done
    drives : of it

    Returns
    -------
    joints first; a part without coordinates is left out
    """
    model = simulation.model
    forces = _by_cause(simulation, drives)
    names = model.coordinate_names
    floating = {name: joint.child for joint in floating_joints(model) for name in joint.coordinates}
    groups: dict[tuple[str, str], list[int]] = {}
    for name in simulation.free:
        where = floating.get(name, JOINTS)
        unit = UNITS["rotational" if model.motion_kinds[name] == "rotational" else "translational"]
        groups.setdefault((where, unit), []).append(names.index(name))
    ordered = sorted(groups, key=lambda group: group[0] != JOINTS)
    return tuple(
        Share(where=where, unit=unit, sizes=_sizes(forces, groups[where, unit]))
        for where, unit in ordered
    )


def _sizes(forces: Mapping[str, Array], columns: Sequence[int]) -> dict[str, float]:
    """Root mean squares of some coordinates; muscles that do not reach them are left out."""
    sizes = {
        cause: float(np.sqrt(np.mean(np.square(values[:, columns]))))
        for cause, values in forces.items()
    }
    return {cause: size for cause, size in sizes.items() if size > 0.0}


def _by_cause(simulation: Simulation, drives: Drives) -> dict[str, Array]:
    """Generalized forces (frames, coordinates) by cause [N m or N]."""
    model = simulation.model
    forces = {}
    if simulation.muscles:
        forces["muscles"] = muscle_torques(simulation)
    for cause, table in (("reserves", drives.reserves), ("torques", drives.torques)):
        if table is not None:
            forces[cause] = gathered(
                compile_tree(model), simulation.motion.values, _at(simulation.time, table, model)
            )
    if drives.follow is not None:
        feedback = np.zeros(simulation.motion.values.shape)
        columns = [model.coordinate_names.index(name) for name in simulation.free]
        feedback[:, columns] = simulation.feedback
        forces["feedback"] = feedback
    return forces


def muscle_torques(simulation: Simulation) -> Array:
    """Generalized forces of all muscles, viscous ones of their paths included.

    Parameters
    ----------
    simulation : with muscles

    Returns
    -------
    (frames, coordinates) 0 of coordinates that are not independent [N m or N]
    """
    model = simulation.model
    paths = compile_paths(model)
    values = paths.evaluate(simulation.motion.values, simulation.motion.velocities)
    pulls = simulation.muscle_force + viscosities(model) * simulation.muscle_velocity
    acting = values.arms * pulls[:, paths.arm_muscle] * paths.arm_free
    torques = np.zeros(simulation.motion.values.shape)
    np.add.at(torques.T, paths.arm_coordinate, acting.T)
    return torques


def _at(time: Array, table: Series, model: Model) -> Array:
    """Values of a table at some times, (frames, coordinates), 0 where it has no column."""
    values = np.zeros((len(time), len(model.coordinates)))
    for column, name in enumerate(table.names):
        at = np.interp(time, table.time, table.values[:, column])
        values[:, model.coordinate_names.index(name)] = at
    return values
