"""Lengths, marker positions and size as unknowns, and what markers and posture say of them.

The angles of every frame follow these unknowns: they are settled by inverse kinematics on the model
that the unknowns make, and eliminated from the normal equations by the kernels of `reduce`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from myomorph.body.calibrate.angle_slopes import angle_slopes
from myomorph.body.calibrate.frame_sums import reduce, settle
from myomorph.body.calibrate.shared_problem import (
    BLOCKS,
    LENGTHS,
    MARKERS,
    SIZE,
    MeanPosture,
    Point,
    Reduced,
    SharedProblem,
    Stage,
)
from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import NormalEquations, Residuals
from myomorph.core.fit.unknowns import Block, Bools, Unknown, Unknowns, Values
from myomorph.core.model.arrays import Array

MIN_FACTOR = 0.1
"""Of a length. Below it lengths vanish and the quadratic model says nothing."""


def calibration_unknowns(problem: SharedProblem, free: Bools) -> Unknowns:
    """List factors of lengths, shifts of markers and the overall size.

    What is known of them beforehand ties them to each other (`SharedProblem.prior`), so that none
    has a prior of its own.

    Parameters
    ----------
    problem : whose lengths and markers they are
    free : (unknowns,) which may change; the others stay where a search begins

    Returns
    -------
    blocks in the order of `BLOCKS`
    """
    moves = iter(free.tolist())
    lengths = [
        Unknown(
            name=f"{length.name} length",
            where=f"model: length {length.name}",
            start=1.0,
            low=MIN_FACTOR,
            fixed=not next(moves),
        )
        for length in problem.lengths
    ]
    shifts = [
        Unknown(
            name=f"{name} {axis}",
            unit="m",
            where=f"marker {name}: {axis} on its body",
            scale=problem.unit,
            fixed=not next(moves),
        )
        for name in problem.marker_names
        for axis in "xyz"
    ]
    size = Unknown(
        name="overall size", where="model: all lengths", start=1.0, fixed=not next(moves)
    )
    return Unknowns(
        (
            Block(name=LENGTHS, unknowns=tuple(lengths)),
            Block(name=MARKERS, unknowns=tuple(shifts)),
            Block(name=SIZE, unknowns=(size,)),
        )
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class MarkersAt:
    """Distances of markers on the model of a point, every frame at its best angles.

    Attributes
    ----------
    problem : with the recordings
    variance : of a marker along one axis [m^2]
    point : with every frame settled
    """

    problem: SharedProblem
    variance: float
    point: Point

    @property
    def cost(self) -> float:
        """Sum of weighted squares, in units of the noise."""
        return self.point.cost / self.variance

    @property
    def count(self) -> int:
        """Of recorded numbers."""
        return sum(
            3 * int(np.isfinite(one.observed).all(axis=2).sum()) for one in self.problem.sets
        )

    @cached_property
    def reduced(self) -> Reduced:
        """The normal equations [m^2], angles eliminated, and at fixed angles."""
        return reduce(self.problem, self.point)

    def normal(self) -> NormalEquations:
        """In units of the noise, angles eliminated."""
        return NormalEquations(H=self.reduced.H / self.variance, g=self.reduced.g / self.variance)


@dataclass(frozen=True, kw_only=True, eq=False)
class MarkerResiduals:
    """Recorded markers as residuals of lengths, marker positions and size.

    Attributes
    ----------
    problem : with the recordings
    variance : of a marker along one axis [m^2]
    begin : the point whose angles the frames begin with
    name, blocks, prior : of these residuals; they are no prior
    """

    problem: SharedProblem
    variance: float
    begin: Point
    name: str = field(default="markers", init=False)
    blocks: tuple[str, ...] = field(default=BLOCKS, init=False)
    prior: bool = field(default=False, init=False)

    def at(self, values: Values, before: MarkersAt | None = None) -> MarkersAt:
        """Settle every frame from the angles of the point before.

        Parameters
        ----------
        values : of the unknowns
        before : point before; None begins with `begin`

        Returns
        -------
        markers at these values
        """
        begin = self.begin if before is None else before.point
        point = posed(self.problem, values, begin, self.variance)
        return MarkersAt(problem=self.problem, variance=self.variance, point=point)


@dataclass(frozen=True, kw_only=True, eq=False)
class PostureAt:
    """The mean posture at a point, in standard deviations.

    Attributes
    ----------
    problem : with the recordings
    posture : what is known of the mean
    point : with every frame settled
    """

    problem: SharedProblem
    posture: MeanPosture
    point: Point

    @cached_property
    def residuals(self) -> Array:
        """(rows,) in standard deviations."""
        return self.posture.misfit(self.point.angles)

    @property
    def cost(self) -> float:
        """Sum of squares."""
        return float(np.sum(self.residuals**2))

    @property
    def count(self) -> int:
        """Of rows."""
        return len(self.residuals)

    def normal(self) -> NormalEquations:
        """By how the mean angles follow the unknowns."""
        slopes = self.posture.rows @ angle_slopes(self.problem, self.point).mean
        return NormalEquations(H=slopes.T @ slopes, g=slopes.T @ self.residuals)


@dataclass(frozen=True, kw_only=True, eq=False)
class PostureResiduals:
    """The symmetry of the mean posture, which is likely beforehand, as residuals.

    Attributes
    ----------
    problem : with the recordings
    posture : what is known of the mean
    variance : of a marker along one axis [m^2]
    begin : the point whose angles the frames begin with
    name, blocks, prior : of these residuals; they are a prior
    """

    problem: SharedProblem
    posture: MeanPosture
    variance: float
    begin: Point
    name: str = field(default="symmetric posture", init=False)
    blocks: tuple[str, ...] = field(default=BLOCKS, init=False)
    prior: bool = field(default=True, init=False)

    def at(self, values: Values, before: PostureAt | None = None) -> PostureAt:
        """Compute the mean posture at the angles of the markers' residuals.

        Parameters
        ----------
        values : of the unknowns
        before : point before; None begins with `begin`

        Returns
        -------
        the posture at these values
        """
        begin = self.begin if before is None else before.point
        point = posed(self.problem, values, begin, self.variance)
        return PostureAt(problem=self.problem, posture=self.posture, point=point)


def posed(problem: SharedProblem, values: Values, begin: Point, variance: float) -> Point:
    """Settle all frames for some values, once for all residuals there.

    Parameters
    ----------
    problem : with the recordings
    values : of the unknowns
    begin : the point whose angles the frames begin with
    variance : of a marker along one axis [m^2]

    Returns
    -------
    every frame at its best angles
    """
    x = np.concatenate([values[name] for name in BLOCKS])
    if np.array_equal(x, begin.x):
        return begin
    return values.shared("poses", lambda: settle(problem, x, begin.angles, variance))


def as_fit(stage: Stage, begin: Point) -> Problem:
    """State the problem as unknowns and residuals.

    Parameters
    ----------
    stage : recordings, lengths, priors, noise, and which unknowns may change
    begin : with every frame at its best angles

    Returns
    -------
    residuals of markers first
    """
    problem = stage.problem
    variance = stage.variance
    markers = MarkerResiduals(problem=problem, variance=variance, begin=begin)
    residuals: list[Residuals] = [markers, problem.prior]
    if problem.mean_posture is not None:
        posture = PostureResiduals(
            problem=problem, posture=problem.mean_posture, variance=variance, begin=begin
        )
        residuals.append(posture)
    return Problem(calibration_unknowns(problem, stage.free), tuple(residuals))
