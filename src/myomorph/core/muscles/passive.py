"""Generalized forces of what resists by itself: springs, limits and bushings of joints, and
viscosity of muscles.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.muscles.hill import viscosities
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.rigid.bushings import bushing_forces
from myomorph.core.rigid.dynamics import rates_of
from myomorph.core.rigid.tree import Tree, compile_tree


def joint_forces(
    tree: Tree, coordinates: Array, rates: Array, without: Collection[str] = ()
) -> Array:
    """What passive torques and bushings do at every coordinate, (frames, coordinates) [N m or N].
    `coordinates`, `rates` (frames, coordinates) consistent; `without`: names that are left out, see
    `passive_generalized_forces`.
    """
    model = tree.model
    left_out = set(without)
    tau = np.zeros_like(coordinates)
    for torque in model.passive_torques:
        if (
            not {
                torque.name,
                torque.name.removesuffix("_upper"),
                torque.name.removesuffix("_lower"),
            }
            & left_out
        ):
            j = model.coordinate_names.index(torque.coordinate)
            tau[:, j] += torque.total(coordinates[:, j], rates[:, j])
    bushings = [bushing for bushing in model.bushings if bushing.name not in left_out]
    if bushings:
        tau += bushing_forces(tree, bushings, coordinates, rates)
    return tau


def passive_generalized_forces(
    model: Model, motion: Motion, without: Collection[str] = ()
) -> Series:
    """What the model's passive torques, bushings and the muscles' viscosity do at every coordinate.

        tau = sum torque(q) - damping(q) qdot  +  bushings  +  R^T (viscosity * lengthening velocity)

    Every coordinate keeps its own share, as in `inverse_dynamics`: taken off its torques, this
    leaves what muscles and reserves have to give. Elastic passive force of muscles is not part of
    it.

    `motion`: with velocities; a coordinate it lacks rests at its default; `without`: names of
    passive torques (a limit's, with or without "_upper" or "_lower"), bushings and muscles' dampers
    ("<muscle>_viscosity") that are left out. Returns Series of (frames, coordinates) [N m or N].
    """
    tree = compile_tree(model)
    coordinates, rates = rates_of(tree, motion)
    tau = joint_forces(tree, coordinates, rates, without)
    viscosity = viscosities(model) * [
        f"{name}_viscosity" not in without for name in model.muscle_names
    ]
    if viscosity.any():
        tau += _of_muscles(model, motion, viscosity)
    return Series(motion.time, model.coordinate_names, tau)


def _of_muscles(model: Model, motion: Motion, viscosity: Array) -> Array:
    """(frames, coordinates) generalized forces of dampers along muscles."""
    moved = muscle_kinematics(model, motion)
    assert moved.arms is not None
    assert moved.velocities is not None
    force = viscosity * moved.velocities
    tau = np.zeros((len(motion), len(model.coordinates)))
    for index, (m, j) in enumerate(
        zip(moved.paths.arm_muscle, moved.paths.arm_coordinate, strict=True)
    ):
        tau[:, j] += moved.arms[:, index] * force[:, m]
    # The arms hold what reaches a muscle through couplers; here dependent coordinates keep their
    # share.
    tree = moved.paths.tree.arrays
    for index, dependent in enumerate(tree.coupler_coordinate):
        for s, source in enumerate(tree.coupler_source[index]):
            if source >= 0:
                tau[:, source] -= moved.coupler_slopes[:, index, s] * tau[:, dependent]
    return tau
