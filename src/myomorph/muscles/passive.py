"""Generalized forces of what resists by itself: springs, dampers and limits of joints, and viscosity of muscles."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from myomorph.model.model import Model
from myomorph.model.series import Motion, Series
from myomorph.muscles.hill import viscosities
from myomorph.muscles.path import muscle_kinematics
from myomorph.rigid.dynamics import rates_of
from myomorph.rigid.tree import compile_tree


def passive_generalized_forces(model: Model, motion: Motion, without: Collection[str] = ()) -> Series:
    """What the model's passive torques and its muscles' viscosity do at every coordinate.

        tau = sum torque(q) - damping(q) qdot  +  R^T (viscosity * lengthening velocity)

    Every coordinate keeps its own share, as in `inverse_dynamics`: taken off its torques, this leaves what
    muscles and reserves have to give. Elastic passive force of muscles is not part of it.

    Parameters
    ----------
    motion : with velocities; a coordinate it lacks rests at its default
    without : names of passive torques (a limit's, with or without "_upper" or "_lower") and of muscles'
        dampers ("<muscle>_viscosity") that are left out

    Returns
    -------
    Series of (frames, coordinates) [N m or N]

    Raises
    ------
    BadData
        where the motion has no velocities
    """
    tree = compile_tree(model)
    coordinates, rates = rates_of(tree, motion)
    tau = np.zeros_like(coordinates)
    for one in model.passive_torques:
        if not {one.name, one.name.removesuffix("_upper"), one.name.removesuffix("_lower")} & set(without):
            j = model.coordinate_names.index(one.coordinate)
            tau[:, j] += one.total(coordinates[:, j], rates[:, j])
    viscosity = viscosities(model) * [f"{name}_viscosity" not in without for name in model.muscle_names]
    if viscosity.any():
        tau += _of_muscles(model, motion, viscosity)
    return Series(motion.time, model.coordinate_names, tau)


def _of_muscles(model: Model, motion: Motion, viscosity: np.ndarray) -> np.ndarray:
    """(frames, coordinates) generalized forces of dampers along muscles."""
    moved = muscle_kinematics(model, motion)
    assert moved.arms is not None
    assert moved.velocities is not None
    force = viscosity * moved.velocities
    tau = np.zeros((len(motion), len(model.coordinates)))
    for k, (m, j) in enumerate(zip(moved.paths.arm_muscle, moved.paths.arm_coordinate, strict=True)):
        tau[:, j] += moved.arms[:, k] * force[:, m]
    # The arms hold what reaches a muscle through couplers; here dependent coordinates keep their share.
    tree = moved.paths.tree.arrays
    for k, dependent in enumerate(tree.coupler_coordinate):
        for s, source in enumerate(tree.coupler_source[k]):
            if source >= 0:
                tau[:, source] -= moved.coupler_slopes[:, k, s] * tau[:, dependent]
    return tau
