"""Damping of a ball joint as one bushing: OpenSim's nearest form of a torque -D omega.

A BushingForce damps the rates of three body-fixed angles x, y, z of one frame in another: along the axes of the
first frame the torque -E^-T C E^-1 omega, with omega = E(x, y) (xdot, ydot, zdot). For equal damping in all
directions this is -d omega but for what sin y couples, so frames are sought in which y stays small over a motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.paths import Bushing
from myomorph.model.series import Motion
from myomorph.model.spatial import Transform
from myomorph.rigid.bushings import angular_velocities, bushing_forces, deflection
from myomorph.rigid.dynamics import rates_of
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree
from myomorph.viscosity.coordinate_damping import along_axes, share, turning

STARTS = 6
"""Frames the search begins from; several, because it ends in the nearest minimum."""

POSES = 150
"""Frames of the motion that the search looks at."""


@dataclass(frozen=True, eq=False)
class JointBushing:
    """A ball joint's damping as a bushing.

    Attributes
    ----------
    bushing : for `model.passive_dynamics.with_passive_dynamics`
    residual : root mean square of the generalized torque that it does not express, as a share of the whole;
        comparable with that of `CoordinateDamping`
    middle : greatest middle angle over the motion [rad]; at a quarter turn a bushing is singular
    """

    bushing: Bushing
    residual: float
    middle: float


def joint_bushing(
    model: Model, base: str, first: str, viscosity: ArrayLike, motion: Motion, name: str = ""
) -> JointBushing:
    """The rotational bushing between two bodies nearest to the damping of the joint between them, over a motion.

    Parameters
    ----------
    base, first : the bodies on both sides of the joint (scapula and humerus)
    viscosity : one value, or three along the axes of `first` [N m s/rad]
    motion : with velocities, such as the model will be used for
    name : of the bushing, "passive_<base>_<first>" by default

    Raises
    ------
    BadData
        where the viscosity is not one or three numbers from 0 on, or the motion has no velocities
    BadModel
        where no coordinate turns the bodies against each other
    """
    D = along_axes("viscosity", viscosity)
    tree = compile_tree(model)
    coordinates, rates = rates_of(tree, motion)
    E, R, moving = turning(tree, base, first, coordinates)
    omega = np.einsum("fak,fk->fa", E, rates[:, moving])
    some = np.unique(np.linspace(0, len(R) - 1, POSES).astype(int))
    lost = _lost(R[some], omega[some], D)
    begun = np.log(np.maximum(D, 1e-3 * max(D.max(), 1e-12)))
    found = [
        least_squares(lost, np.concatenate([*Rotation.random(2, random_state=k).as_rotvec(), begun]), max_nfev=60)
        for k in range(STARTS)
    ]
    best = min(found, key=lambda one: float(one.cost)).x
    turns = Rotation.from_rotvec(best[:6].reshape(2, 3)).as_matrix()
    pose_1, pose_2 = (Transform(turn, np.zeros(3)) for turn in turns)
    damping = np.exp(best[6:]) * (D.max() > 0.0)
    bushing = Bushing(name or f"passive_{base}_{first}", base, first, pose_1, pose_2, rotational_damping=damping)
    torque = np.zeros_like(coordinates)
    torque[:, moving] = -np.einsum("fak,fa->fk", E, D * omega)
    given = bushing_forces(tree, [bushing], coordinates, rates)
    q, _ = deflection(tree, forward_kinematics(tree, coordinates), bushing)
    return JointBushing(bushing, share((given - torque)[:, moving], torque[:, moving]), float(np.abs(q[:, 1]).max()))


def _lost(R: Array, omega: Array, D: Array) -> Callable[[Array], Array]:
    """What a bushing's torque lacks, of frames' rotation vectors and logarithms of its damping (9,).

    R (frames, 3, 3) of the limb in its base; omega (frames, 3) along the limb's axes [rad/s].
    """
    turned = np.einsum("fab,fb->fa", R, omega)
    torque = np.einsum("fab,fb->fa", R, D * omega)
    scale = float(np.sqrt((torque**2).sum())) or 1.0

    def lost(x: Array) -> Array:
        first, second = Rotation.from_rotvec(x[:6].reshape(2, 3)).as_matrix()
        Q = first.T @ R @ second
        E = angular_velocities(np.arctan2(-Q[:, 1, 2], Q[:, 2, 2]), np.arcsin(np.clip(Q[:, 0, 2], -0.999, 0.999)))
        rates = np.linalg.solve(E, (turned @ first)[:, :, None])[:, :, 0]
        damped = np.linalg.solve(np.swapaxes(E, 1, 2), (np.exp(x[6:]) * rates)[:, :, None])[:, :, 0]
        missing: Array = ((damped - torque @ first) / scale).ravel()
        return missing

    return lost
