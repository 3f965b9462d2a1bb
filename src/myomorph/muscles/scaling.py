"""What scaling a model needs to know of its muscles: how long their paths are."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.series import Motion
from myomorph.muscles.kinematics import muscle_kinematics


def default_path_lengths(model: Model) -> Array:
    """Lengths of a model's muscle paths in its default pose.

    Given to `calibrate` as `path_lengths`, it lets fibers and tendons keep their ratio to the path.

    Parameters
    ----------
    model : with muscles

    Returns
    -------
    (muscles,) [m]

    Raises
    ------
    BadModel
        where closed loops do not close

    Examples
    --------
    >>> import myomorph as mm
    >>> mm.default_path_lengths(mm.read_model("arm.osim")).round(2).tolist()
    [0.28, 0.24]
    """
    still = Motion(np.zeros(1), (), np.zeros((1, 0)))
    return muscle_kinematics(model, still, velocities=False, moment_arms=False).lengths[0]
