"""The wrench of the outside world that a motion of a whole body takes."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Motion
from myomorph.core.rigid.dynamics import joint_wrenches, motion_arrays
from myomorph.core.rigid.tree import Tree


@read_only
class TotalWrench:
    """All forces from outside but gravity, taken together.

    Attributes
    ----------
    time : (frames,) [s]
    force, moment : (frames, 3) in ground, the moment about its origin [N], [N m]
    """

    time: Array
    force: Array
    moment: Array

    @property
    def center_of_pressure(self) -> Array:
        """(frames, 3) where the line of action meets the ground, y = 0, but for a free moment [m].

        NaN where nothing presses.
        """
        vertical = np.where(self.force[:, 1] > 0.0, self.force[:, 1], np.nan)
        x = self.moment[:, 2] / vertical
        z = -self.moment[:, 0] / vertical
        return np.stack([x, np.zeros(len(x)), z], axis=1)

    def about(self, points: Array) -> Array:
        """Move the moment to points.

        Parameters
        ----------
        points : (frames, 3) in ground [m]

        Returns
        -------
        (frames, 3) moment about them [N m]
        """
        return np.asarray(self.moment - np.cross(points, self.force))


def total_wrench(tree: Tree, motion: Motion) -> TotalWrench:
    """Compute the wrench that a body needs to move as it does, with derivatives of its motion."""
    arrays = motion_arrays(tree, motion)
    nothing = np.zeros((len(motion), len(tree.arrays.parent), 6))
    whole = joint_wrenches(tree, *arrays, nothing)
    return TotalWrench(time=motion.time, force=whole.forces[:, 0], moment=whole.moments[:, 0])
