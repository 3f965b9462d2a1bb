"""The wrench that a motion needs and known forces do not give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.rigid.dynamics import joint_wrenches, motion_arrays
from myomorph.core.rigid.tree import compile_tree


@read_only
class MissingWrench:
    """What carries a body beside known forces, taken together.

    Attributes
    ----------
    time : (frames,) [s]
    force, moment : (frames, 3) in ground, the moment about its origin [N], [N m]
    up : (3,) unit vector against gravity
    weight : of the body [N]
    """

    time: Array
    force: Array
    moment: Array
    up: Array
    weight: float

    @property
    def upward(self) -> Array:
        """(frames,) upward force over the weight."""
        return np.asarray(self.force @ self.up / self.weight)

    def mean(self, frames: NDArray[np.bool_]) -> MissingWrench:
        """Average over some frames, as of one frame: errors of accelerations mostly cancel.

        Parameters
        ----------
        frames : (frames,) at least one of them

        Returns
        -------
        a wrench of one frame
        """
        return replace(
            self,
            time=self.time[frames].mean(keepdims=True),
            force=np.nanmean(self.force[frames], axis=0, keepdims=True),
            moment=np.nanmean(self.moment[frames], axis=0, keepdims=True),
        )

    def offsets(self, points: Array) -> Array:
        """Find the shortest ways from points to the line along which the force acts.

            d = F x (M - p x F) / |F|^2

        Parameters
        ----------
        points : (frames, 3) p in ground [m]

        Returns
        -------
        (frames, 3) d [m], NaN where no force is missing
        """
        about = self.moment - np.cross(points, self.force)
        square = (self.force**2).sum(axis=1, keepdims=True)
        square = np.where(square > (1e-3 * self.weight) ** 2, square, np.nan)
        return np.asarray(np.cross(self.force, about) / square)

    def between(self, first: Array, second: Array) -> tuple[Array, Array]:
        """Find where the line passes two points, seen along the force.

        Parameters
        ----------
        first, second : (frames, 3) in ground [m]

        Returns
        -------
        share : (frames,) of the way from the first to the second at which it passes, 0 to 1
        distance : (frames,) by which it passes beside the way between both [m]
        """
        from_first = self.offsets(first)
        way = from_first - self.offsets(second)
        square = np.maximum((way**2).sum(axis=1), 1e-12)
        share = np.clip((from_first * way).sum(axis=1) / square, 0.0, 1.0)
        return share, np.linalg.norm(from_first - share[:, None] * way, axis=1)


def missing_wrench(
    model: Model, motion: Motion, known: Wrenches | None = None, believed: float = 1.0
) -> MissingWrench:
    """Find what a motion needs beside known forces, by Newton's and Euler's equations.

    Parameters
    ----------
    model : of the body
    motion : with velocities and accelerations
    known : external forces at the motion's times, whatever bodies they act on; None for none
    believed : share of the model's mass that the body truly has

    Raises
    ------
    BadData : derivatives are missing
    """
    tree = compile_tree(model)
    nothing = np.zeros((len(motion), len(tree.arrays.parent), 6))
    whole = joint_wrenches(tree, *motion_arrays(tree, motion), nothing)
    force = believed * whole.forces[:, 0]
    moment = believed * whole.moments[:, 0]
    if known is not None:
        forces = np.nan_to_num(known.forces)
        points = np.nan_to_num(known.points)
        force -= forces.sum(axis=1)
        moment -= (np.nan_to_num(known.torques) + np.cross(points, forces)).sum(axis=1)
    return MissingWrench(
        time=motion.time, force=force, moment=moment, up=np.asarray(model.up), weight=model.weight
    )
