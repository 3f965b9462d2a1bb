"""Who is in a recording: bodies that hang on the ground by one joint, each a subject or an object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.analysis.centroid import NAMES, centroid
from myomorph.model.arrays import Array
from myomorph.model.model import GROUND, Model
from myomorph.model.series import Motion, Series
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

_CHUNK = 1024
LEAST_SHARE = 1e-3


@dataclass(frozen=True)
class Subject:
    """One body or object of a model.

    Attributes
    ----------
    name : as printed, "" for the only one
    prefix : what its names begin with in a model of several
    bodies : names
    muscles : names of the muscles on its bodies
    """

    name: str
    prefix: str
    bodies: tuple[str, ...]
    muscles: tuple[str, ...]


def subjects(model: Model) -> tuple[Subject, ...]:
    """Subjects and objects of a model, those with muscles first; what weighs next to nothing is left out."""
    home: dict[str, str] = {}
    for joint in model.joints:
        home[joint.child] = joint.child if joint.parent == GROUND else home.get(joint.parent, joint.parent)
    roots = tuple(dict.fromkeys(home[body.name] for body in model.bodies if body.name in home))
    found = []
    for root in roots:
        bodies = tuple(body.name for body in model.bodies if home.get(body.name) == root)
        mass = sum(model.body(name).mass for name in bodies)
        muscles = tuple(
            muscle.name
            for muscle in model.muscles
            if next((home[point.body] for point in muscle.path.points if point.body in home), "") == root
        )
        if mass > LEAST_SHARE * model.mass:
            prefix = _prefix((*bodies, *muscles)) if len(roots) > 1 else ""
            name = (prefix.rstrip("_") or root) if len(roots) > 1 else ""
            found.append(Subject(name, prefix, bodies, muscles))
    found.sort(key=lambda one: not one.muscles)
    if len(found) == 1:
        return (Subject("", found[0].prefix, found[0].bodies, found[0].muscles),)
    return tuple(found)


def _prefix(names: tuple[str, ...]) -> str:
    """What all names begin with, to the last line in it; of one name to the first."""
    first, last = min(names), max(names)
    if first == last:
        return first.partition("_")[0] + "_" if "_" in first else ""
    alike = next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), min(len(first), len(last)))
    return first[: first.rfind("_", 0, alike) + 1]


def centroids(model: Model, motion: Motion, who: tuple[Subject, ...]) -> tuple[Series, ...]:
    """Center of mass of every subject in ground, each a series of (frames, 3) [m]; see `centroid`."""
    if len(who) == 1:
        return (centroid(model, motion),)
    tree = compile_tree(model)
    masses = np.zeros((len(who), len(tree.arrays.mass)))
    for i, one in enumerate(who):
        for body in one.bodies:
            masses[i, tree.body_index[body]] = tree.arrays.mass[tree.body_index[body]]
    masses /= masses.sum(axis=1, keepdims=True)
    coordinates = tree.coordinates_of(motion)
    values = np.empty((len(motion), len(who), 3))
    for start in range(0, len(motion), _CHUNK):
        part = slice(start, start + _CHUNK)
        poses = forward_kinematics(tree, coordinates[part])
        centers = poses.points(np.arange(len(tree.arrays.mass)), tree.arrays.mass_center)
        values[part] = np.einsum("sb,fbi->fsi", masses, centers)
    return tuple(Series(motion.time, NAMES, values[:, i]) for i in range(len(who)))


def standing_height(model: Model, who: Subject, up: Array) -> float:
    """Height of the center of mass over the lowest joint in the model's default posture [m]."""
    rest = Motion(np.zeros(1), (), np.zeros((1, 0)))
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(rest))
    own = [tree.body_index[body] for body in who.bodies]
    mass = tree.arrays.mass[own]
    centers = poses.points(np.array(own), tree.arrays.mass_center[own])[0] @ up
    return float(mass @ centers / mass.sum() - np.min(poses.origins[0, own] @ up))


def lowest_joint(model: Model, motion: Motion, who: Subject, up: Array) -> float:
    """Least height of a body's origin over the motion along `up` [m]."""
    tree = compile_tree(model)
    own = [tree.body_index[body] for body in who.bodies]
    step = max(1, len(motion) // _CHUNK)
    part = tree.coordinates_of(motion)[::step]
    heights = forward_kinematics(tree, np.ascontiguousarray(part)).origins[:, own] @ up
    return float(np.nanmin(heights))
