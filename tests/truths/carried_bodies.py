"""What carries a body.

The foot that is over each plate's center of pressure, and the wrench that its motion needs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.contact.assign import Assignment, assign_bodies
from myomorph.core.contact.site_motion import site_motion
from myomorph.core.model.contacts import Site
from myomorph.core.model.errors import check_name
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.rigid.dynamics import external_arrays, joint_wrenches, motion_arrays
from myomorph.core.rigid.tree import compile_tree


def assign_feet(
    model: Model, motion: Motion, sites: Sequence[Site], wrenches: Wrenches
) -> Assignment:
    """Give each plate's force to the foot whose sole its center of pressure is under.

    The bodies are those of the first site of each group: the heels. See `assign_bodies`, whose
    warnings name plates that carried two feet at once; `shared_wrenches` is for these. `wrenches`:
    at the motion's times; the bodies they name are not regarded.
    """
    places = site_motion(model, motion, sites).places
    positions = {}
    for site in sites:
        members = [index for index, other in enumerate(sites) if other.group == site.group]
        positions[sites[members[0]].body] = places[:, members]
    return assign_bodies(wrenches, positions)


def needed_wrench(
    model: Model, motion: Motion, body: str, known: Wrenches | None = None
) -> Wrenches:
    """Return the force and moment that reach a body, and all that it carries, from its parent.

    By Newton's and Euler's equations of these bodies: for a free object, what hands and floor give
    it together; for the trunk, what passes through its joint with the pelvis, muscles included.
    `motion`: with velocities and accelerations; `known`: other external forces, at the motion's
    times; those on bodies that it does not carry have no effect. Returns Wrenches with one force on
    `body`, at the center of its joint, with the moment about it as the torque.
    """
    tree = compile_tree(model)
    check_name("body", body, model.body_names)
    number = tree.body_index[body]
    bodies, forces, points, torques = external_arrays(tree, motion, known)
    applied = np.zeros((len(motion), len(tree.arrays.parent), 6))
    for index, each_body in enumerate(bodies):
        applied[:, each_body, :3] += forces[:, index]
        applied[:, each_body, 3:] += torques[:, index] + np.cross(
            points[:, index], forces[:, index]
        )
    result = joint_wrenches(tree, *motion_arrays(tree, motion), applied)
    center = model.joints[number - 1].child_frame.translation
    at = result.rotations[:, number] @ center + result.origins[:, number]
    force = result.forces[:, number]
    torque = result.moments[:, number] - np.cross(at, force)
    return Wrenches(
        time=motion.time,
        names=(body,),
        bodies=(body,),
        forces=force[:, None],
        points=at[:, None],
        torques=torque[:, None],
    )
