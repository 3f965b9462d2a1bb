"""Damping and stiffness of a ball joint as those of the coordinates that a model has there.

With omega = E(q) qdot the passive torque tau = -D omega - K theta of a joint is, on a model's
coordinates,

    tau_q = -E^T D E qdot - E^T K theta(q),

a full matrix that changes with the pose. OpenSim's springs of coordinates have a constant and no
coupling: here is what comes nearest over a motion, and the share that is lost, to compare with a
bushing (`viscosity.identified_model`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

import myomorph as mm
from myomorph.core.model.arrays import Array
from myomorph.core.rigid.dynamics import values_and_rates
from myomorph.core.rigid.tree import compile_tree
from myomorph.swings.viscosity.identified_model import along_axes, joint_jacobian, share

STILL = 1e-6
"""A coordinate whose root mean square rate is less does not tell its damping [rad/s]."""


@dataclass(frozen=True, eq=False)
class CoordinateDamping:
    """A ball joint's damping as dampers of coordinates.

    Attributes
    ----------
    values : by coordinate [N m s/rad], for `model.passive_dynamics.with_passive_dynamics`
    residual : root mean square of the torque that they do not express, as a share of the whole
    matrix : (coordinates, coordinates) mean of E^T D E over the motion, what the joint has [N m
        s/rad]
    still : coordinates that hardly move, whose value is the matrix's own
    """

    values: Mapping[str, float]
    residual: float
    matrix: Array
    still: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class CoordinateStiffness:
    """A ball joint's stiffness as springs of coordinates.

    Attributes
    ----------
    values, rest : by coordinate [N m/rad], [rad]
    residual : root mean square of the torque that they do not express, as a share of the whole
    """

    values: Mapping[str, float]
    rest: Mapping[str, float]
    residual: float


def coordinate_damping(
    model: mm.Model, base: str, first: str, viscosity: ArrayLike, motion: mm.Motion
) -> CoordinateDamping:
    """Fit dampers of coordinates to the damping of the joint between two bodies, over a motion.

        min over d_k >= 0 of sum over frames of |E^T D E qdot - diag(d) qdot|^2

    Parameters
    ----------
    model : with both bodies
    base, first : the bodies on both sides of the joint (scapula and humerus)
    viscosity : one value, or three along the axes of `first` [N m s/rad]
    motion : with velocities, such as the model will be used for

    Raises
    ------
    BadData
        where the viscosity is not one or three numbers from 0 on, or the motion has no velocities
    BadModel
        where no coordinate rotates the bodies against each other
    """
    D = along_axes("viscosity", viscosity)
    tree = compile_tree(model)
    coordinates, rates = values_and_rates(tree, motion)
    E, _, moving = joint_jacobian(tree, base, first, coordinates)
    speeds = rates[:, moving]
    full = np.einsum("fak,a,faj->fkj", E, D, E)
    torque = np.einsum("fkj,fj->fk", full, speeds)
    square = (speeds**2).mean(axis=0)
    still = square < STILL**2
    mean = full.mean(axis=0)
    damping = np.where(
        still, np.diag(mean), (torque * speeds).mean(axis=0) / np.where(still, 1.0, square)
    )
    damping = np.maximum(damping, 0.0)
    names = tuple(model.coordinate_names[j] for j in moving)
    return CoordinateDamping(
        values=dict(zip(names, damping.tolist(), strict=True)),
        residual=share(torque - damping * speeds, torque),
        matrix=mean,
        still=tuple(name for name, one in zip(names, still, strict=True) if one),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class JointSpring:
    """A spring of the joint between two bodies.

    Attributes
    ----------
    stiffness : one value, or three along the axes of the body that moves [N m/rad]
    rest : coordinates of the pose at which the joint's torque is zero, the model's defaults for the
        others [rad or m]
    """

    stiffness: ArrayLike
    rest: Mapping[str, float]


def coordinate_stiffness(
    model: mm.Model, base: str, first: str, spring: JointSpring, motion: mm.Motion
) -> CoordinateStiffness:
    """Fit springs of coordinates to the stiffness of the joint between two bodies, over a motion.

    A line -k_q (q - rest) is laid through every coordinate's share of -E^T K theta; one that would
    push away from rest becomes no spring.

    Parameters
    ----------
    model : with both bodies
    base, first : the bodies on both sides of the joint (scapula and humerus)
    spring : of the joint, along the axes of `first`
    motion : such as the model will be used for

    Raises
    ------
    BadData
        where the stiffness is not one or three numbers from 0 on
    BadModel
        where no coordinate rotates the bodies against each other
    """
    K = along_axes("stiffness", spring.stiffness)
    tree = compile_tree(model)
    rest = np.array([list(spring.rest.values())], dtype=np.float64).reshape(1, -1)
    at_rest = tree.coordinates_of(mm.Motion(np.zeros(1), tuple(spring.rest), rest))
    R_rest = joint_jacobian(tree, base, first, at_rest)[1]
    coordinates = tree.coordinates_of(motion)
    E, R, moving = joint_jacobian(tree, base, first, coordinates)
    theta = Rotation.from_matrix(np.swapaxes(R_rest, 1, 2) @ R).as_rotvec()
    torque = -np.einsum("fak,a,fa->fk", E, K, theta)
    values = {}
    ends = {}
    line = np.zeros_like(torque)
    for i, j in enumerate(moving):
        name = model.coordinate_names[j]
        values[name], ends[name] = _spring_line(coordinates[:, j], torque[:, i])
        line[:, i] = -values[name] * (coordinates[:, j] - ends[name])
    return CoordinateStiffness(values, ends, share(torque - line, torque))


def _spring_line(q: Array, torque: Array) -> tuple[float, float]:
    """Fit a stiffness of at least 0 and its rest to the torque (frames,) over a coordinate."""
    spread = q - q.mean()
    moved = float(spread @ spread)
    slope = -float(spread @ torque) / moved if moved > 1e-12 * len(q) else 0.0
    end = float(q.mean() + torque.mean() / slope) if slope > 0.0 else float(q.mean())
    return max(slope, 0.0), end
