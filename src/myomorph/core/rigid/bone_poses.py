"""Positions and rotations of a model's bodies over time, to draw bones by."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arguments import check_argument
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import check_name
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.model.shapes import BodyRotations, BodyVectors, FixedPoints, Points
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree


@read_only
class BonePoses:
    """Poses of all bodies of a model over time.

    Attributes
    ----------
    time : (frames,) [s]
    bodies : names, the ground first
    rotations : (frames, bodies, 3, 3) from a body's axes to ground
    origins : (frames, bodies, 3) in ground [m]
    """

    time: Array
    bodies: tuple[str, ...]
    rotations: BodyRotations
    origins: BodyVectors

    def rotation(self, body: str) -> Array:
        """Rotation of a body over time.

        Parameters
        ----------
        body : by name

        Returns
        -------
        (frames, 3, 3) from the body's axes to ground

        Raises
        ------
        UnknownName : no body has that name
        """
        check_name("body", body, self.bodies)
        return np.asarray(self.rotations[:, self.bodies.index(body)])

    def points(self, body: str, locations: FixedPoints) -> Points:
        """Positions of points that are fixed to a body, as the vertices of its mesh.

        Parameters
        ----------
        body : by name
        locations : (points, 3) in the body's frame [m]

        Returns
        -------
        (frames, points, 3) in ground [m]

        Raises
        ------
        UnknownName : no body has that name
        """
        check_name("body", body, self.bodies)
        number = self.bodies.index(body)
        turned = locations @ self.rotations[:, number].swapaxes(1, 2)
        return turned + self.origins[:, None, number]


def bone_poses(model: Model, motion: Motion) -> BonePoses:
    """Poses of a model's bodies in a motion.

    Source: Featherstone 2008, forward kinematics.

    Parameters
    ----------
    model : whose bodies move
    motion : coordinates over time; what it lacks stands at the model's default

    Returns
    -------
    rotations (frames, bodies, 3, 3) and origins (frames, bodies, 3) in ground [m], at the motion's
    times; NaN where a coordinate is

    Raises
    ------
    UnknownName : the motion has a coordinate that the model does not have

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> poses = mm.viewer.bone_poses(model, mm.read_motion("reach.mot", model))
    >>> poses.bodies, poses.origins.shape
    (('ground', 'upper', 'fore'), (61, 3, 3))
    """
    check_argument("model", model, Model)
    check_argument("motion", motion, Motion)
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    return BonePoses(
        time=motion.time,
        bodies=tuple(tree.body_index),
        rotations=poses.rotations,
        origins=poses.origins,
    )
