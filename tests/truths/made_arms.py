"""Markers on arms that reach about, with the angles that made them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

FRAMES = 97
RATE = 50.0
SKIN = 0.008  # Standard deviation of markers from where the model has them [m]
NOISE = 0.001  # From frame to frame [m]
REACHED: Mapping[str, tuple[float, float]] = {
    "elv_angle": (-40.0, 100.0),
    "shoulder_elv": (5.0, 110.0),
    "shoulder_rot": (-60.0, 60.0),
    "elbow_flexion": (3.0, 60.0),
    "pro_sup": (-60.0, 60.0),
}
"""Between which angles of each side lie [degrees]."""


@read_only
class MadeArms:
    """Markers, and the motion that made them (frames, coordinates) [rad or m]."""

    markers: Markers
    motion: Motion


def made_arms(model: Model, seed: int) -> MadeArms:
    """Reach about with both arms, on markers that skin has moved.

    Parameters
    ----------
    model : with arms of myo-sim and markers
    seed : of angles, skin and noise

    Returns
    -------
    markers and truth
    """
    random = np.random.default_rng(seed)
    tree = compile_tree(model)
    time = np.arange(FRAMES) / RATE
    values = np.tile(tree.defaults, (FRAMES, 1))
    for side in "rl":
        for name, limits in REACHED.items():
            column = model.coordinate_names.index(f"{name}_{side}")
            values[:, column] = np.radians(_wave(time, limits, random))
    motion = Motion(time, model.coordinate_names, values)
    bodies = np.array([tree.body_index[marker.body] for marker in model.markers])
    places = np.array([marker.location for marker in model.markers])
    points = forward_kinematics(tree, tree.coordinates_of(motion)).points(bodies, places)
    moved = points + random.normal(0.0, SKIN, (1, len(bodies), 3))
    seen = moved + random.normal(0.0, NOISE, points.shape)
    return MadeArms(markers=Markers(time, model.marker_names, seen), motion=motion)


def _wave(time: Array, limits: tuple[float, float], random: np.random.Generator) -> Array:
    """Swing (frames,) between two values within limits."""
    low, high = np.sort(random.uniform(*limits, 2))
    phase = random.uniform(0.0, 2.0 * np.pi)
    frequency = random.uniform(0.3, 0.9)
    share = 0.5 + 0.5 * np.sin(2.0 * np.pi * frequency * time + phase)
    return np.asarray(low + (high - low) * share)
