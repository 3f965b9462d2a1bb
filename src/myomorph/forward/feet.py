"""Spheres under the feet of a model, which touch the floor."""

from __future__ import annotations

import numpy as np

from myomorph.core.contact.sites import foot_sites
from myomorph.core.io.mesh import mesh_folders, read_surfaces
from myomorph.core.model.errors import BadModel
from myomorph.core.model.model import Model
from myomorph.core.model.segments import feet_of
from myomorph.core.model.series import Motion
from myomorph.core.rigid.kinematics import forward_kinematics, standing_poses
from myomorph.core.rigid.tree import compile_tree
from myomorph.forward.contact_law import ContactSphere, Ground

RADIUS = 0.025  # Of a sphere at a corner of a sole [m]
MAX_DEPTH = 0.01  # Of a sphere in the floor at the start, without a word [m]


def floor_under_feet(model: Model, height: float = 0.0) -> Ground:
    """Put spheres at the corners of every sole, that touch the floor.

    Each lies above one of the six sites of a foot (`foot_sites`), so that its lowest point in the
    model's default posture is the site.

    Parameters
    ----------
    model : with feet
    height : of the floor, along the direction against gravity [m]

    Raises
    ------
    BadModel : no foot is found by the names of its bodies
    """
    if not feet_of(model):
        raise BadModel(
            f"model '{model.name}' has no foot that is found by its bodies' names"
            f" ({', '.join(model.body_names[:5])}, ...): simulate it without contacts"
        )
    surfaces, _ = read_surfaces(model, mesh_folders(model))
    poses = standing_poses(model)
    spheres = []
    for site in foot_sites(model, surfaces):
        up = poses[site.body].rotation.T @ model.up
        spheres.append(
            ContactSphere(body=site.body, center=site.points[0] + RADIUS * up, radius=RADIUS)
        )
    return Ground(spheres=tuple(spheres), height=height)


def depth_at(model: Model, ground: Ground, start: Motion | None) -> float:
    """Find how deep the lowest sphere is in the floor at the start [m].

    Parameters
    ----------
    model : with the spheres
    ground : that they touch
    start : its first frame; None for the model's default pose
    """
    tree = compile_tree(model)
    values = tree.defaults[None] if start is None else tree.coordinates_of(start)[:1]
    bodies = np.array([tree.body_number(sphere.body) for sphere in ground.spheres], np.int64)
    centers = np.array([sphere.center for sphere in ground.spheres])
    heights = forward_kinematics(tree, values).points(bodies, centers)[0] @ model.up
    radii = np.array([sphere.radius for sphere in ground.spheres])
    return float(np.max(ground.height - heights + radii))
