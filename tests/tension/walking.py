"""A walk of the Rajagopal model with contact sites under its feet, for tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.contacts import Cone, Site
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask

WALK = "rajagopal-walk-emg/"

SOLE = {
    "heel_medial": ("calcn", (0.0, 0.0, -0.02)),
    "heel_lateral": ("calcn", (0.0, 0.0, 0.02)),
    "ball_medial": ("calcn", (0.17, 0.0, -0.04)),
    "ball_lateral": ("calcn", (0.13, 0.0, 0.05)),
    "toe_medial": ("toes", (0.05, 0.0, -0.03)),
    "toe_lateral": ("toes", (0.04, 0.0, 0.03)),
}


def walk(data, keep) -> tuple[Model, Motion, Wrenches]:
    """Frames of the walk, filtered at 6 Hz, and what the plates measured."""
    model = read_osim(data(WALK + "subject_walk_scaled.osim"))
    whole = differentiate(motion_from_table(read_sto(data(WALK + "coordinates.sto")), model), 6.0)
    motion = whole.frames(keep)
    return (
        model,
        motion,
        resample_wrenches(read_external_loads(data(WALK + "grf_walk.xml")), motion.time),
    )


def soles(cone: Cone | None = None) -> tuple[Site, ...]:
    """Six sites under each foot."""
    return tuple(
        Site(
            name=f"{name}_{side}",
            body=f"{body}_{side}",
            points=[[x, y, z * hand]],
            cone=cone or Cone(),
            group=f"foot_{side}",
        )
        for side, hand in (("r", 1.0), ("l", -1.0))
        for name, (body, (x, y, z)) in SOLE.items()
    )


def ready(model: Model, motion: Motion, sites) -> Series:
    """Strengths by height above the lowest position of each site: full to 15 mm, 0 from 45 mm."""
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    bodies = np.array([tree.body_index[site.body] for site in sites])
    height = poses.points(bodies, np.array([site.points[0] for site in sites]))[..., 1]
    rise = height - height.min(axis=0)
    return Series(
        motion.time, tuple(site.name for site in sites), np.clip(1.5 - rise / 0.03, 0.0, 1.0)
    )


def task(model: Model, motion: Motion, sites=None, measured=(), **options) -> ContactTask:
    """Both feet may touch the ground; frames do not know of each other unless asked."""
    sites = soles() if sites is None else sites
    settings = replace(ContactOptions(smoothness=0.0), **options)
    return ContactTask(
        sites=tuple(sites),
        activations=ready(model, motion, sites),
        measured=tuple(measured),
        options=settings,
    )


def full(motion: Motion, sites, strength: float = 1.0) -> Series:
    """Return the same activation at all times."""
    return Series(
        motion.time,
        tuple(site.name for site in sites),
        np.full((len(motion), len(sites)), strength),
    )
