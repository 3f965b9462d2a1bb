"""Both sides of nearly straight knees: where they touch, and what they carry without muscles."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadModel
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.leg_angles import leg_angles
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.joint_contact import ContactPoint, points_in_ground
from myomorph.core.tension.knee_points import knee_points
from myomorph.core.tension.reaction import JointReactions, joint_reactions
from myomorph.core.tension.terms.joint_load import crossing_muscles
from myomorph.core.tension.terms.knee_contact import Side

MAX_FLEXION = np.radians(30.0)  # Beyond which nothing is asked of a knee [rad]


def knee_sides(model: Model, motion: Motion, wrenches: Wrenches | None) -> tuple[Side, ...]:
    """Find both sides of all knees.

    Parameters
    ----------
    model : with muscles, and knees that they cross
    motion : with velocities and accelerations
    wrenches : external forces at the motion's times, None for none

    Returns
    -------
    two sides of each knee

    Raises
    ------
    BadModel : the model closes loops, has no weight or no knee
    """
    if model.loops or not model.weight > 0.0:
        raise BadModel(
            f"knee_contact: model '{model.name}' closes loops or has no weight: leave it out"
        )
    coordinates = compile_tree(model).coordinates_of(motion)
    points = knee_points(model, {}).points
    sides: list[Side] = []
    for leg in leg_angles(model):
        knee = leg.knee.joint
        own = [point for point in points if point.joint == knee.name]
        load = joint_reactions(model, motion, None, wrenches, [knee.name], frame="ground")
        asked = leg.knee.of(coordinates) < MAX_FLEXION
        sides += _sides(model, motion, load, own, asked)
    if not sides:
        raise BadModel(f"knee_contact: no knee of model '{model.name}' bends: leave it out")
    return tuple(sides)


def _sides(
    model: Model, motion: Motion, load: JointReactions, points: list[ContactPoint], asked: Array
) -> list[Side]:
    """Make both sides of a knee.

    Parameters
    ----------
    load : of the knee without muscles, in ground
    points : two, of the knee
    asked : (frames,) whether it is straight enough
    """
    paths = compile_paths(model)
    joint = next(joint for joint in model.joints if joint.name == load.joints[0])
    places, normals = points_in_ground(compile_tree(model), motion, joint, points)
    normal = normals.mean(axis=1)
    force = load.forces[:, 0]
    moment = load.moments[:, 0] + np.cross(load.points[:, 0], force)
    muscles = np.flatnonzero(crossing_muscles(model)[joint.name])
    pairs = np.flatnonzero(paths.tree.hanging(joint.child)[paths.pull_body])
    owners = (muscles[:, None] == paths.pull_muscle[pairs]).astype(np.float64)
    sides = []
    for number, point in enumerate(points):
        opposite = places[:, 1 - number]
        arm = np.cross(places[:, number] - opposite, normal)
        per_moment = arm / np.einsum("fi,fi->f", arm, arm)[:, None]
        about = moment - np.cross(opposite, force)
        sides.append(
            Side(
                knee=joint.name,
                point=point.name,
                opposite=opposite,
                per_moment=per_moment,
                alone=np.einsum("fi,fi->f", about, per_moment) / model.weight,
                asked=asked,
                muscles=muscles,
                pairs=pairs,
                owners=owners,
            )
        )
    return sides
