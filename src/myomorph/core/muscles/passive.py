"""Passive generalized forces: springs, limits and bushings of joints, viscosity of muscles."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.paths import PassiveTorque
from myomorph.core.model.series import Motion, Series
from myomorph.core.model.shapes import Coordinates, GeneralizedForces
from myomorph.core.muscles.hill import viscosities
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.rigid.bushings import bushing_forces
from myomorph.core.rigid.dynamics import values_and_rates
from myomorph.core.rigid.tree import Tree, compile_tree


def joint_forces(
    tree: Tree, coordinates: Coordinates, rates: Coordinates, without: Collection[str] = ()
) -> GeneralizedForces:
    """Generalized forces of passive torques and bushings.

    Parameters
    ----------
    tree : the compiled model
    coordinates, rates : (frames, coordinates) consistent [rad or m, per s]
    without : names that are left out, see `passive_generalized_forces`

    Returns
    -------
    (frames, coordinates) [N m or N]
    """
    model = tree.model
    left_out = set(without)
    tau = np.zeros_like(coordinates)
    for torque in model.passive_torques:
        if left_out.isdisjoint(_names_of(torque)):
            j = model.coordinate_names.index(torque.coordinate)
            tau[:, j] += torque.total(coordinates[:, j], rates[:, j])
    bushings = [bushing for bushing in model.bushings if bushing.name not in left_out]
    if bushings:
        tau += bushing_forces(tree, bushings, coordinates, rates)
    return tau


def _names_of(torque: PassiveTorque) -> tuple[str, ...]:
    """Names by which a passive torque can be left out: its own, or that of a limit's two ends."""
    return torque.name, torque.name.removesuffix("_upper"), torque.name.removesuffix("_lower")


def passive_generalized_forces(
    model: Model, motion: Motion, without: Collection[str] = ()
) -> Series:
    """Generalized forces of passive torques, bushings and the muscles' viscosity.

        tau = sum torque(q) - damping(q) qdot + bushings + R^T (viscosity * lengthening velocity)

    Every coordinate keeps its own share, as in `inverse_dynamics`: taken off its torques, this
    leaves what muscles and reserves have to give. Elastic passive force of muscles is not part of
    it.

    Parameters
    ----------
    model : with or without muscles
    motion : with velocities; a coordinate it lacks rests at its default
    without : names of passive torques (a limit's, with or without "_upper" or "_lower"), bushings
        and muscles' dampers ("<muscle>_viscosity") that are left out

    Returns
    -------
    Series of (frames, coordinates) [N m or N]

    Raises
    ------
    BadData : the motion has no velocities
    """
    tree = compile_tree(model)
    coordinates, rates = values_and_rates(tree, motion)
    tau = joint_forces(tree, coordinates, rates, without)
    counted = [f"{name}_viscosity" not in without for name in model.muscle_names]
    viscosity = viscosities(model) * counted
    if viscosity.any():
        tau += _damper_forces(model, motion, viscosity)
    return Series(motion.time, model.coordinate_names, tau)


def _damper_forces(model: Model, motion: Motion, viscosity: Array) -> GeneralizedForces:
    """Generalized forces R^T (viscosity * lengthening velocity) of dampers along muscles.

    Parameters
    ----------
    viscosity : (muscles,) [N s/m]

    Returns
    -------
    (frames, coordinates) [N m or N]
    """
    kinematics = muscle_kinematics(model, motion)
    assert kinematics.arms is not None
    assert kinematics.muscle_velocity is not None
    force = viscosity * kinematics.muscle_velocity
    tau = np.zeros((len(motion), len(model.coordinates)))
    paths = kinematics.paths
    for pair, (m, j) in enumerate(zip(paths.arm_muscle, paths.arm_coordinate, strict=True)):
        tau[:, j] += kinematics.arms[:, pair] * force[:, m]
    # The arms hold what reaches a muscle through couplers. Here dependent coordinates keep their
    # share.
    tree = paths.tree.arrays
    for coupler, dependent in enumerate(tree.coupler_coordinate):
        for slot, source in enumerate(tree.coupler_source[coupler]):
            if source >= 0:
                tau[:, source] -= kinematics.coupler_slopes[:, coupler, slot] * tau[:, dependent]
    return tau
