"""The problem of all frames: shared unknowns, what each recording shows, and the prior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.fit.residuals import LinearPrior
from myomorph.core.fit.unknowns import Bools
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
    """Frames of one recording.

    Attributes
    ----------
    observed : (frames, markers, 3) positions [m], NaN where unseen
    targets : (frames, coordinates) values of coordinate tasks, and of coordinates that do not move
        [rad or m]
    known : (coordinates,) 1 / SD^2 of those that are known to be at their target
    """

    observed: Array
    targets: Array
    known: Array


@read_only
class MeanPosture:
    """Prior knowledge of the mean posture: rows @ mean - right has standard deviation 1.

    Attributes
    ----------
    names : of the rows, as "ankle_angle_r - ankle_angle_l"
    rows : (rows, coordinates) [1 / rad]
    right : (rows,)
    sd : (rows,) standard deviation before scaling [rad]
    """

    names: tuple[str, ...]
    rows: Array
    right: Array
    sd: Array

    def misfit(self, angles: Sequence[Array]) -> Array:
        """Compute the misfit of the mean over all frames.

        Parameters
        ----------
        angles : of each recording (frames, coordinates) [rad or m]

        Returns
        -------
        (rows,) in standard deviations
        """
        return self.rows @ np.concatenate(angles).mean(axis=0) - self.right


@dataclass(frozen=True, kw_only=True, eq=False)
class SharedProblem:
    """The problem of all frames.

    Its unknowns x are the factors of the lengths, three shifts [m] for each marker, and the overall
    size, which moves nothing but the prior.

    Attributes
    ----------
    model : the skeleton at its given lengths
    lengths : that may change
    marker_names : in the order of all arrays
    stretch : how marker positions follow the lengths
    pose : the model's markers and what may move, without frames
    sets : frames of each recording
    prior : over x
    posture : (coordinates,) that angles which no marker shows are drawn to [rad or m]
    posture_weight : of that pull
    unit : that changes of marker positions are measured by, see `length_unit` [m]
    mean_posture : prior of the mean of all frames' angles; None for none
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
        """Compute the cost of the priors of unknowns and mean posture.

        Parameters
        ----------
        x : (unknowns,)
        angles : of each recording (frames, coordinates) [rad or m]

        Returns
        -------
        sum of squares in standard deviations
        """
        misfits = [self.prior.rows @ x - self.prior.right]
        if self.mean_posture is not None:
            misfits.append(self.mean_posture.misfit(angles))
        return float(np.sum(np.concatenate(misfits) ** 2))

    def stretched(self, x: Array) -> Model:
        """Stretch the skeleton.

        Parameters
        ----------
        x : (unknowns,)

        Returns
        -------
        the skeleton with these lengths
        """
        return scale(self.model, factors_of(self.lengths, x[: len(self.lengths)]))

    def tied(self, tree: Tree, stretch: Stretch) -> tuple[MarkerArrays, Stretch]:
        """Return the points that loops tie in a stretched tree, and how lengths move them.

        They move as points of their bodies: the lever of a weld does not stretch.

        Parameters
        ----------
        tree : of the stretched model
        stretch : of the model's own markers

        Returns
        -------
        the points as markers, two for each tie, and their stretch
        """
        if not self.model.loops:
            return tied_markers(None), stretch
        unstretched = tied_markers(ties_of(compile_tree(self.model), lever=0.0))
        return tied_markers(ties_of(tree)), stretch._replace(location=unstretched.location)

    def placed(self, x: Array) -> Array:
        """Compute marker positions on the stretched bodies.

        Parameters
        ----------
        x : (unknowns,)

        Returns
        -------
        (markers, 3) on their bodies [m]
        """
        count = len(self.lengths)
        # A body axis that no length scales has the number -1, that of the factor 1.
        padded = np.append(x[:count], 1.0)
        factors = padded[self.stretch.column[self.pose.markers.body]]
        return self.stretch.location * factors + self.shifts(x)

    def shifts(self, x: Array) -> Array:
        """Take the shifts of the markers out of the unknowns.

        Parameters
        ----------
        x : (unknowns,)

        Returns
        -------
        (markers, 3) along the axes of their bodies [m]
        """
        return x[len(self.lengths) : -1].reshape(-1, 3)

    def of_size(self, size: float) -> Array:
        """Give all lengths one factor and no marker a shift.

        Parameters
        ----------
        size : the factor

        Returns
        -------
        (unknowns,) but for the overall size, which is 0: it moves no marker
        """
        x = np.zeros(self.prior.rows.shape[1])
        x[: len(self.lengths)] = size
        return x


@dataclass(frozen=True, kw_only=True, eq=False)
class Stage:
    """One stage of a search: the problem with its priors, and what is taken as known in it.

    Attributes
    ----------
    problem : recordings, lengths and priors
    noise : standard deviation of a marker along one axis [m]
    free : (unknowns,) which may change
    """

    problem: SharedProblem
    noise: float
    free: Bools

    @property
    def variance(self) -> float:
        """Of a marker along one axis [m^2]."""
        return self.noise**2

    @property
    def prior_rows(self) -> Array:
        """(rows, free) of the prior over the free unknowns."""
        return self.problem.prior.rows[:, self.free]


@dataclass(frozen=True, kw_only=True, eq=False)
class Point:
    """The problem at some x, every frame at its best angles.

    Attributes
    ----------
    x : (unknowns,)
    tree : of the model that x makes
    poses : of each recording
    angles : of each recording (frames, coordinates) [rad or m]
    data : of each recording (frames,) cost [m^2]
    settled : share of frames whose angles converged
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Reduced:
    """Normal equations of the shared unknowns.

    Attributes
    ----------
    H, g : (unknowns, unknowns), (unknowns,) with the angles eliminated [m^2 per unknown]
    fixed_H, fixed_g : the same at fixed angles
    errors : of each recording (frames, markers) distances [m], NaN where unseen
    angles_free : number of angles, over all frames, that lie at no bound and that no loop takes
    """

    H: Array
    g: Array
    fixed_H: Array
    fixed_g: Array
    errors: tuple[Array, ...]
    angles_free: int
