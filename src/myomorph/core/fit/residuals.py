"""What measurements and priors say of unknowns: residuals in units of their noise, and slopes.

Whatever computes residuals is asked for two things: their sum of squares at some values, and the
normal equations there. Rows and slopes give both (`Rows`); a kernel that eliminates the poses of
its frames hands over the equations as they come out of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
import scipy
from numpy.typing import ArrayLike

from myomorph.core.fit.unknowns import Unknowns, Values
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData

STEP = 1e-6  # Of finite differences, in units of the value or of 1


@read_only
class NormalEquations:
    """The quadratic model of a sum of squares about a point: cost + 2 g . d + d . H d.

    Attributes
    ----------
    H : (unknowns, unknowns) J^T J of whitened residuals r with slopes J; eliminated frames taken
        off
    g : (unknowns,) J^T r
    """

    H: Array
    g: Array

    @property
    def covariance(self) -> Array:
        """(unknowns, unknowns) inverse of H, by its Cholesky factor.

        Raises
        ------
        LinAlgError : a direction has no information
        """
        factor, failed = scipy.linalg.lapack.dpotrf(self.H, lower=True)
        if failed:
            raise np.linalg.LinAlgError("the normal equations are not positive definite")
        lower, _ = scipy.linalg.lapack.dpotri(factor, lower=True)
        below = np.tril(lower, -1)
        return np.asarray(below + below.T + np.diag(np.diag(lower)))


class Evaluation(Protocol):
    """Residuals at some values of the unknowns."""

    @property
    def cost(self) -> float:
        """Sum of squares, each in units of its noise."""
        ...

    @property
    def count(self) -> int:
        """Count of the numbers that were compared."""
        ...

    def normal(self) -> NormalEquations:
        """Return the normal equations of the unknowns of the residuals' blocks, in their order."""
        ...


@runtime_checkable
class Following(Evaluation, Protocol):
    """Residuals with unknowns of their own, as the motion of a trial, that step with the others."""

    def damped(self, damping: float) -> tuple[NormalEquations, float]:
        """Return equations of the shared unknowns without the own ones, all diagonals raised.

        Beside them what the own unknowns alone take off the cost.
        """
        ...

    def stepped(self, damping: float, step: Array) -> Evaluation:
        """Return the residuals with their own unknowns moved along with a step of the shared ones.

        Parameters
        ----------
        damping : with which the step was found
        step : (unknowns of the blocks,)

        Returns
        -------
        where `Residuals.at` begins at the point after the step
        """
        ...


class Residuals(Protocol):
    """One source of what is known."""

    @property
    def name(self) -> str:
        """Name of the source for certificates, as "markers of walk1.trc"."""
        ...

    @property
    def blocks(self) -> tuple[str, ...]:
        """The blocks of unknowns that it depends on, in the order of its equations."""
        ...

    @property
    def prior(self) -> bool:
        """Whether it was known before anything was measured."""
        ...

    def at(self, values: Values, before: Any) -> Evaluation:
        """Evaluate the residuals.

        Parameters
        ----------
        values : of the unknowns
        before : the residuals' own evaluation where the search came from, or None: what is
            eliminated frame by frame begins there

        Returns
        -------
        cost, and the normal equations when they are requested
        """
        ...


@read_only
class Rows:
    """Residuals with their slopes.

    Attributes
    ----------
    residuals : (rows,) in units of their noise
    slopes : (rows, unknowns)
    """

    residuals: Array
    slopes: Array

    @property
    def cost(self) -> float:
        """Sum of squares."""
        return float(self.residuals @ self.residuals)

    @property
    def count(self) -> int:
        """Count of rows."""
        return len(self.residuals)

    def normal(self) -> NormalEquations:
        """Return H = J^T J and g = J^T r."""
        return NormalEquations(H=self.slopes.T @ self.slopes, g=self.slopes.T @ self.residuals)


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class Measured:
    """Residuals by a function of the unknowns.

    Attributes
    ----------
    name, blocks : see `Residuals`
    function : from values by block to predicted less measured, (rows,) in their unit
    slopes : from values by block to (rows, unknowns of the block) by block; by default central
        differences
    sd : standard deviation of the noise, of each row or of all, in the rows' unit
    correlation_time : rows in sequence that say as much as one independent one, 1 or more (see
        `correlation_times`); so much less all rows count
    prior : whether it was known before anything was measured
    """

    name: str
    blocks: tuple[str, ...]
    function: Callable[[Values], Array]
    slopes: Callable[[Values], Mapping[str, Array]] | None = None
    sd: ArrayLike = 1.0
    correlation_time: float = 1.0
    prior: bool = False

    def __post_init__(self) -> None:
        if not (np.asarray(self.sd) > 0.0).all():
            raise BadData(f"noise of residuals '{self.name}': expected standard deviations above 0")
        if not self.correlation_time >= 1.0:
            raise BadData(
                f"correlation time of residuals '{self.name}' is {self.correlation_time:g} rows:"
                " expected 1 or more"
            )

    def at(self, values: Values, before: Evaluation | None = None) -> Evaluation:
        """Evaluate the residuals; slopes are computed when they are requested.

        Parameters
        ----------
        values : of the unknowns
        before : not used
        """
        return _MeasuredAt(measured=self, values=values)

    @property
    def weight(self) -> Array:
        """() or (rows,) weight of all rows, or of each: 1 / (sd sqrt(correlation time))."""
        return 1.0 / (np.asarray(self.sd, np.float64) * np.sqrt(self.correlation_time))

    def differences(self, values: Values) -> Array:
        """Find the slopes of the function by central differences.

        Parameters
        ----------
        values : the point

        Returns
        -------
        (rows, unknowns of its blocks)
        """
        columns = []
        for index in values.unknowns.index(self.blocks):
            size = STEP * max(1.0, abs(float(values.x[index])))
            after = np.asarray(self.function(values.nudged(index, size)))
            before = np.asarray(self.function(values.nudged(index, -size)))
            columns.append((after - before) / (2.0 * size))
        return np.column_stack(columns)


@dataclass(frozen=True, eq=False)
class _MeasuredAt:
    """Measured residuals at some values of the unknowns, computed when they are first needed."""

    measured: Measured
    values: Values

    @cached_property
    def residuals(self) -> Array:
        """(rows,) residuals in units of their noise."""
        return np.asarray(self.measured.function(self.values)) * self.measured.weight

    @property
    def cost(self) -> float:
        """Sum of squares."""
        return float(self.residuals @ self.residuals)

    @property
    def count(self) -> int:
        """Count of rows."""
        return len(self.residuals)

    def normal(self) -> NormalEquations:
        """Return the normal equations, with slopes by the function for them or by differences."""
        measured = self.measured
        if measured.slopes is None:
            slopes = measured.differences(self.values)
        else:
            by_block = measured.slopes(self.values)
            slopes = np.hstack([by_block[name] for name in measured.blocks])
        weighted = slopes * np.broadcast_to(measured.weight, self.residuals.shape)[:, None]
        return Rows(residuals=self.residuals, slopes=weighted).normal()


@read_only
class Condensed:
    """Linear measurements condensed to few rows: |rows x - right|^2 is their misfit.

    It is so but for a constant, which no value removes. Rows from a QR decomposition of all
    measurements keep digits that normal equations lose.

    Attributes
    ----------
    name, blocks : see `Residuals`
    rows, right : (rows, unknowns) and (rows,) in units of noise
    prior : False: it was measured
    """

    name: str
    blocks: tuple[str, ...]
    rows: Array
    right: Array
    prior: bool = field(default=False, init=False)

    def at(self, values: Values, before: Evaluation | None = None) -> Rows:
        """Compute the misfits in units of noise.

        Parameters
        ----------
        values : of the unknowns
        before : not used
        """
        return _linear_rows(self, values)


@read_only
class LinearPrior:
    """A normal prior of linear combinations of unknowns: rows x ~ N(right, 1).

    Attributes
    ----------
    name, blocks : see `Residuals`
    rows, right : rows (rows, unknowns) x - right (rows,) has standard deviation 1
    prior : True: it was known before anything was measured
    """

    name: str
    blocks: tuple[str, ...]
    rows: Array
    right: Array
    prior: bool = field(default=True, init=False)

    def at(self, values: Values, before: Evaluation | None = None) -> Rows:
        """Compute the misfits in standard deviations.

        Parameters
        ----------
        values : of the unknowns
        before : not used
        """
        return _linear_rows(self, values)


def own_prior(unknowns: Unknowns) -> LinearPrior:
    """Make residuals of the means and standard deviations that unknowns have themselves.

    Of those with a chart, as rotations, slopes are 1: exact at the minimum, for a rotation vector
    is an axis of its own turn.
    """
    known = np.flatnonzero(np.isfinite(unknowns.sd))
    rows = np.eye(len(unknowns))[known] / unknowns.sd[known, None]
    return LinearPrior(
        name="prior",
        blocks=tuple(unknowns.slices),
        rows=rows,
        right=(unknowns.mean / unknowns.sd)[known],
    )


def _linear_rows(given: Condensed | LinearPrior, values: Values) -> Rows:
    """Compute rows x - right of the blocks that were given, with the rows as slopes."""
    x = np.concatenate([values[name] for name in given.blocks])
    return Rows(residuals=given.rows @ x - given.right, slopes=given.rows)
