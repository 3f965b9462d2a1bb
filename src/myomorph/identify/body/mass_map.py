"""The masses of one part of a body moved onto the bodies of another model, so that their sum is the same."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.inertia import inertial_parameters, pseudo_inertias
from myomorph.model.model import Model
from myomorph.model.series import Motion
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree


def frames_in_ground(model: Model, pose: Motion) -> Array:
    """(bodies, 4, 4) poses of the bodies' frames in the first frame of a motion."""
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(pose)[:1])
    frames = np.tile(np.eye(4), (len(model.bodies), 1, 1))
    frames[:, :3, :3], frames[:, :3, 3] = poses.rotations[0, 1:], poses.origins[0, 1:]
    return frames


def ground_pseudo_inertias(model: Model, pose: Motion) -> Array:
    """(bodies, 4, 4) pseudo-inertia of every body about the ground's origin, in ground."""
    frames = frames_in_ground(model, pose)
    result: Array = frames @ pseudo_inertias(inertial_parameters(model)) @ np.swapaxes(frames, 1, 2)
    return result


def parameters_of(pseudo: Array) -> Array:
    """(..., 10) inertial parameters of pseudo-inertias (..., 4, 4); see `pseudo_inertias`."""
    second = pseudo[..., :3, :3]
    inertia = np.trace(second, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - second
    result = np.empty((*pseudo.shape[:-2], 10))
    result[..., 0], result[..., 1:4] = pseudo[..., 3, 3], pseudo[..., :3, 3]
    for i, (a, b) in enumerate(((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1)), start=4):
        result[..., i] = inertia[..., a, b]
    return result


def spread(own: Array, target: Array) -> Array:
    """(bodies, 4, 4) pseudo-inertias whose sum is `target`, by a change of those given that is as even as possible.

    All masses grow by the same factor and all mass centers move by the same vector, which gives the sum its
    mass and its mass center. With second moments P of the sum and Q of the target about the mass center,
    both in the basis V that makes P = V V^T and Q = V L V^T with L diagonal: where L < 1 the bodies are
    drawn together by the linear map that turns P into V min(L, 1) V^T and moves mass the least (Olkin and
    Pukelsheim 1982); where L > 1 each body gets its share by mass of V max(L - 1, 0) V^T, without moving.
    Every body stays physically possible.

    Parameters
    ----------
    own : (bodies, 4, 4) in ground, their sum of positive mass
    target : (4, 4) in ground

    Raises
    ------
    BadData : the target or the sum of the bodies is no body's with extent in all directions
    """
    total = own.sum(axis=0)
    P, Q = (_moments(one) for one in (total, target))
    half = _root(P)
    inverse = np.linalg.inv(half)
    values, vectors = np.linalg.eigh(inverse @ Q @ inverse)
    V = half @ vectors
    less = V * np.minimum(values, 1.0) @ V.T
    more = V * np.maximum(values - 1.0, 0.0) @ V.T
    G = inverse @ _root(half @ less @ half) @ inverse
    found = _moved(own, total, target, G)
    found[:, :3, :3] += found[:, 3, 3, None, None] * more
    return found


def spread_mass(own: Array, target: Array) -> Array:
    """The same with only the mass and the mass center of the target, moments about them as they grow with mass."""
    return _moved(own, own.sum(axis=0), target, np.eye(3))


def _moved(own: Array, total: Array, target: Array, linear: Array) -> Array:
    growth = target[3, 3] / total[3, 3]
    A = np.eye(4)
    A[:3, :3] = linear
    A[:3, 3] = target[:3, 3] / target[3, 3] - linear @ (total[:3, 3] / total[3, 3])
    result: Array = growth * (A @ own @ A.T)
    return result


def _moments(pseudo: Array) -> Array:
    """Second moments about the mass center per mass [m^2]."""
    mass = pseudo[3, 3]
    if not mass > 0.0:
        raise BadData(f"its mass is {mass:.4g} kg")
    center = pseudo[:3, 3] / mass
    moments: Array = pseudo[:3, :3] / mass - np.outer(center, center)
    least = float(np.linalg.eigvalsh(moments)[0])
    if not least > 0.0:
        raise BadData(f"its least second moment of mass is {least * mass:.3g} kg m^2: no distribution of mass has it")
    return moments


def _root(matrix: Array) -> Array:
    """Square root of a positive semidefinite matrix."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    root: Array = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return root
