"""The truth of a simulated subject in the frames of an estimated model.

Also what either predicts.
"""

from __future__ import annotations

import numpy as np

import myomorph as mm
from myomorph.core.model.arrays import Array
from myomorph.core.model.inertia import pseudo_inertias
from myomorph.core.model.model import GROUND, Joint
from myomorph.core.motion.lengths import segments_that_stretch
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.regressor import regressor_blocks
from myomorph.core.rigid.tree import compile_tree
from truths.simulated_subject import parameters_of


def joint_distances(model: mm.Model) -> dict[tuple[str, str], float]:
    """Return distances between the joint centers of each segment in the default pose [m].

    Keys are their bodies' names. A joint to the ground is no joint of the body, and massless
    bodies' joints are not counted.
    """
    parents = {joint.child: joint.parent for joint in model.joints}
    centers = _joint_centers(model)
    found = {}
    for bodies in segments_that_stretch(model):
        joints = [
            one
            for one in centers
            if one == bodies[0] or (parents[one] in bodies and one not in bodies)
        ]
        for i, one in enumerate(joints):
            for other in joints[:i]:
                found[other, one] = float(np.linalg.norm(centers[one] - centers[other]))
    return {pair: distance for pair, distance in found.items() if distance > 0.01}


def _joint_centers(model: mm.Model) -> dict[str, Array]:
    """Return centers (3,) in ground of joints that move, by their child in the default pose [m]."""
    tree = compile_tree(model)
    pose = forward_kinematics(tree, tree.defaults[None])
    unlocked = {one.name for one in model.coordinates if not one.locked}
    free = unlocked - set(model.dependent_coordinates)
    joints = [
        joint for joint in model.joints if free & set(joint.coordinates) and joint.parent != GROUND
    ]
    bodies = np.array([tree.body_index[joint.child] for joint in joints], np.int64)
    # MuJoCo's joints turn about their anchors, OpenSim's about their child frames' origins.
    anchors = np.array([_anchor(joint) for joint in joints]).reshape(-1, 3)
    places = pose.points(bodies, anchors)[0]
    return {joint.child: place for joint, place in zip(joints, places, strict=True)}


def _anchor(joint: Joint) -> Array:
    if joint.parent_frame_name or not joint.axes:
        return joint.child_frame.translation
    return joint.axes[-1].origin


def frames_between(
    person: mm.Model, true: mm.Motion, model: mm.Model, motion: mm.Motion
) -> tuple[Array, Array]:
    """Return the pose of the person's body frames in the model's, as a recording shows them.

    Where a joint's zero lies, and where a body's frame lies between its joints, is convention: no
    recording shows it, and markers and masses are compared without it.

    Parameters
    ----------
    person : the truth
    true : its motion
    model : the estimate
    motion : its motion, at times of the true one; frames may be NaN

    Returns
    -------
    rotations (bodies, 3, 3) and origins (bodies, 3) [m], means over frames
    """
    at = np.isin(np.round(true.time, 6), np.round(motion.time, 6))
    poses = [
        forward_kinematics(tree, tree.coordinates_of(one))
        for tree, one in (
            (compile_tree(person), at_frames(true, at)),
            (compile_tree(model), motion),
        )
    ]
    seen = np.isfinite(poses[1].origins).all(axis=(1, 2))
    back = np.swapaxes(poses[1].rotations[seen, 1:], -1, -2)
    turns = (back @ poses[0].rotations[seen, 1:]).mean(axis=0)
    U, _, V = np.linalg.svd(turns)
    shifts = (back @ (poses[0].origins[seen, 1:] - poses[1].origins[seen, 1:])[..., None])[..., 0]
    return U @ V, shifts.mean(axis=0)


def at_frames(motion: mm.Motion, at: np.ndarray) -> mm.Motion:
    """Return some frames of a motion.

    Parameters
    ----------
    motion : values alone are kept
    at : (frames,) flags, or (chosen,) numbers

    Returns
    -------
    Motion without derivatives
    """
    return mm.Motion(motion.time[at], motion.names, motion.values[at])


def moved(parameters: Array, rotations: Array, origins: Array) -> Array:
    """Return parameters in other frames of the bodies, J -> T J T^T.

    Parameters
    ----------
    parameters : (bodies, 10)
    rotations : (bodies, 3, 3) of the old frames in the new ones
    origins : (bodies, 3) of the old frames in the new ones [m]

    Returns
    -------
    (bodies, 10)
    """
    T = np.tile(np.eye(4), (len(parameters), 1, 1))
    T[:, :3, :3] = rotations
    T[:, :3, 3] = origins
    return parameters_of(T @ pseudo_inertias(parameters) @ np.swapaxes(T, -1, -2))


def predicted(model: mm.Model, motion: mm.Motion, center: Array, parameters: Array) -> Array:
    """Return the wrench that inertial parameters need.

    Parameters
    ----------
    model : with the bodies
    motion : with velocities and accelerations
    center : (3,) point of the ground, about which the moment is [m]
    parameters : (bodies, 10)

    Returns
    -------
    (frames, 6) moment and force [N m; N]
    """
    phi = np.asarray(parameters).ravel()
    return np.concatenate([block.rows @ phi for block in regressor_blocks(model, motion, center)])


def own_wrench(model: mm.Model, motion: mm.Motion, center: Array, frames: int = 500) -> Array:
    """Return the wrench that the model's own parameters need, by inverse dynamics.

    Parameters
    ----------
    model : with one joint to the ground
    motion : with velocities and accelerations
    center : (3,) point of the ground, about which the moment is [m]
    frames : number of evenly chosen frames

    Returns
    -------
    (frames of the motion, 6) moment and force, NaN in frames that are not chosen [N m; N]
    """
    tree = compile_tree(model)
    joint = next(one for one in model.joints if one.parent == GROUND)
    columns = [model.coordinate_names.index(name) for name in joint.coordinates]
    torques = mm.inverse_dynamics(model, motion).values[:, columns]
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    result = np.full((len(motion), 6), np.nan)
    chosen = np.linspace(0, len(motion) - 1, min(frames, len(motion)), dtype=int)
    jacobian = poses.jacobian(tree.body_index[joint.child], center)[chosen][:, :, columns]
    result[chosen] = np.linalg.solve(jacobian.swapaxes(1, 2), torques[chosen, :, None])[..., 0]
    return result
