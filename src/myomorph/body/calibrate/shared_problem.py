"""The problem of all frames at once: what is shared, what each recording shows, and what is held
likely before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.fit.residuals import LinearPrior
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.scale import scale
from myomorph.core.motion.lengths import Length, factors_of
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.motion.stretch import Stretch, tied_markers
from myomorph.core.motion.tasks.loops import ties_of
from myomorph.core.motion.tasks.markers import MarkerArrays
from myomorph.core.rigid.tree import Tree, compile_tree

LENGTHS = "lengths"
MARKERS = "markers"
SIZE = "size"
BLOCKS: tuple[str, ...] = (LENGTHS, MARKERS, SIZE)
"""Blocks of unknowns: factors of lengths, shifts of markers [m], the overall size. Together, in
this order, they are the vector x of `SharedProblem`.
"""


@dataclass(frozen=True, eq=False)
class FrameSet:
    """Frames of one recording: markers (frames, markers, 3) [m], NaN where unseen; (frames,
    coordinates) values of coordinate tasks, and of coordinates that do not move; 1 / SD^2 of those
    known to be at their target.
    """

    observed: Array
    targets: Array
    known: Array


@read_only
class MeanPosture:
    """What is held likely of the mean posture: (rows mean - right) has standard deviation 1.
    `names` are those of the rows, as "ankle_angle_r - ankle_angle_l"; `sd` (rows,) [rad].
    """

    names: tuple[str, ...]
    rows: Array
    right: Array
    sd: Array

    def misfit(self, angles: Sequence[Array]) -> Array:
        """(rows,) of the angles of all frames, in standard deviations."""
        return self.rows @ np.concatenate(angles).mean(axis=0) - self.right


@dataclass(frozen=True, eq=False)
class SharedProblem:
    """The problem of all frames. Its unknowns x are the factors of the lengths, three shifts [m]
    for each marker and the overall size, which moves nothing but the prior. `pose` has the model's
    markers and what may move, but no frames; `unit` measures changes of marker positions [m], see
    `length_unit`; `mean_posture` is what is held likely of the mean of all frames' angles.
    """

    model: Model
    lengths: tuple[Length, ...]
    marker_names: tuple[str, ...]
    stretch: Stretch
    pose: PoseProblem
    sets: tuple[FrameSet, ...]
    prior: LinearPrior
    posture: Array
    posture_weight: float
    unit: float = 1.0
    mean_posture: MeanPosture | None = None

    def prior_cost(self, x: Array, angles: Sequence[Array]) -> float:
        """Of the unknowns and of the mean posture, in squares of standard deviations."""
        misfits = [self.prior.rows @ x - self.prior.right]
        if self.mean_posture is not None:
            misfits.append(self.mean_posture.misfit(angles))
        return float(np.sum(np.concatenate(misfits) ** 2))

    def stretched(self, x: Array) -> Model:
        """The skeleton with its lengths."""
        return scale(self.model, factors_of(self.lengths, x[: len(self.lengths)]))

    def tied(self, tree: Tree, stretch: Stretch) -> tuple[MarkerArrays, Stretch]:
        """The points that loops tie in a stretched tree, as markers, and how they move with the
        lengths: as points of their bodies, for a weld's lever does not stretch.
        """
        if not self.model.loops:
            return tied_markers(None), stretch
        unstretched = tied_markers(ties_of(compile_tree(self.model), lever=0.0))
        return tied_markers(ties_of(tree)), stretch._replace(location=unstretched.location)

    def placed(self, x: Array) -> Array:
        """(markers, 3) positions on the stretched bodies [m]."""
        n = len(self.lengths)
        factors = np.append(x[:n], 1.0)[self.stretch.column[self.pose.markers.body]]
        return self.stretch.location * factors + x[n:-1].reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Point:
    """The problem at some x, every frame at its best angles: for each set its poses, angles
    (frames, coordinates) and cost of each frame (frames,) [m^2]; the share of frames whose angles
    converged.
    """

    x: Array
    tree: Tree
    poses: tuple[PoseProblem, ...]
    angles: tuple[Array, ...]
    data: tuple[Array, ...]
    settled: float

    @property
    def cost(self) -> float:
        """Sum of weighted squares of marker distances [m^2]."""
        return float(sum(costs.sum() for costs in self.data))


@dataclass(frozen=True, eq=False)
class Reduced:
    """Normal equations of the shared unknowns, angles eliminated (`H`, `g`) and at fixed angles
    (`fixed_*`). `errors` are for each set (frames, markers) distances [m], NaN where unseen;
    `angles_free` counts the angles, over all frames, that are not at a bound and that no loop
    takes.
    """

    H: Array
    g: Array
    fixed_H: Array
    fixed_g: Array
    errors: tuple[Array, ...]
    angles_free: int
