"""What scaling a model needs to know of its muscles: how long their paths are."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.series import Motion
from myomorph.muscles.kinematics import muscle_kinematics


def default_path_lengths(model: Model) -> Array:
    """Lengths (muscles,) of a model's muscle paths in its default pose [m].

    Given to `scale(model, factors, path_lengths=default_path_lengths)`, it lets fibers and tendons
    keep their ratio to the path.
    """
    still = Motion(np.zeros(1), (), np.zeros((1, 0)))
    return muscle_kinematics(model, still, velocities=False, moment_arms=False).lengths[0]
