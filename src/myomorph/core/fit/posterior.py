"""What measurements leave open: covariance, intervals, what they showed and what they did not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.fit.interval_rule import LEVEL, drawn_limits, half_width
from myomorph.core.fit.solver import Solution
from myomorph.core.fit.unknowns import Bools, Unknowns, added
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import check_name
from myomorph.core.model.interval import Interval

SHOWN = 0.75
"""Share of an unknown's variance that the data must take away to count as showing it: they halve
its standard deviation.
"""
HIDDEN = 1e6
"""Standard deviation, in an unknown's scale, from which on nothing shows a direction."""
DRAWS = 2000  # From which intervals of nonlinear numbers are made


@read_only
class Spread:
    """A covariance, and the directions in which it is infinite.

    Attributes
    ----------
    covariance : (n, n) of what is known, 0 along the hidden directions
    hidden : (directions, n) unit directions, in the unknowns' scales, that nothing shows
    scale : (n,) of the unknowns
    """

    covariance: Array
    hidden: Array
    scale: Array

    @classmethod
    def of(cls, H: Array, scale: Array, limit: float) -> Spread:
        """Invert information, but for directions that nothing shows.

        These are the ones that rounding cannot tell from no information, where every unknown has
        the information 1, and those along which an unknown's standard deviation exceeds `limit`
        times its scale.

        Parameters
        ----------
        H : (n, n) information
        scale : (n,) of the unknowns
        limit : standard deviation, in scales, from which on a direction counts as hidden

        Returns
        -------
        the covariance of the rest
        """
        scale = np.where(np.isfinite(scale), scale, 1.0)
        levels, directions = np.linalg.eigh(H * scale[:, None] * scale)
        if limit**-2 > len(H) * np.finfo(float).eps * levels.max(initial=0.0):
            # Rounding does not reach the limit: information in scales tells all directions.
            shown = levels > limit**-2
            known = scale[:, None] * directions[:, shown]
            return cls(
                covariance=(known / levels[shown]) @ known.T,
                hidden=directions[:, ~shown].T,
                scale=scale,
            )
        information = np.diag(H)
        alone = np.divide(1.0, np.sqrt(information), out=np.array(scale), where=information > 0.0)
        levels, directions = np.linalg.eigh(H * alone[:, None] * alone)
        shown = levels > len(H) * np.finfo(float).eps * levels.max(initial=0.0)
        known = alone[:, None] * directions[:, shown]
        covariance = (known / levels[shown]) @ known.T
        hidden = (alone / scale)[:, None] * directions[:, ~shown]

        variances, axes = np.linalg.eigh(covariance / scale[:, None] / scale)
        vague = variances > limit**2
        if vague.any():
            kept = scale[:, None] * axes[:, ~vague]
            covariance = (kept * variances[~vague]) @ kept.T
            hidden = np.hstack([hidden, axes[:, vague]])
        return cls(covariance=covariance, hidden=np.linalg.qr(hidden)[0].T, scale=scale)

    @property
    def variance(self) -> Array:
        """(n,), infinite for what has a part in a hidden direction."""
        return self.variance_of(np.eye(len(self.scale)))

    def variance_of(self, rows: Array) -> Array:
        """Find the variance of linear numbers rows . x.

        Parameters
        ----------
        rows : (rows, n)

        Returns
        -------
        (rows,) infinite for what has a part in a hidden direction
        """
        known = np.einsum("ri,ri->r", rows @ self.covariance, rows)
        scaled = rows * self.scale
        reached = np.abs(scaled @ self.hidden.T).max(axis=1, initial=0.0)
        touched = reached > 1e-6 * np.maximum(np.abs(scaled).max(axis=1, initial=0.0), 1e-300)
        return np.where(touched, np.inf, np.maximum(known, 0.0))


@read_only
class Posterior:
    """What is known of all unknowns together once everything was measured.

    Bounds have no part in it: an unknown at a bound has the spread that it would have beside it.

    Attributes
    ----------
    unknowns : in the order of all arrays
    x : (unknowns,) where the posterior is largest
    free : (unknowns,) which were estimated; the others have no spread
    covariance : (unknowns, unknowns) of what is known, 0 along directions that nothing shows
    after, before : (unknowns,) variance with the data and without them, infinite where nothing
        shows an unknown
    hidden : (directions, unknowns) what nothing shows, data nor prior, in the unknowns' scales
    freedom : degrees of freedom of the noise, where it was taken from the residuals
    """

    unknowns: Unknowns
    x: Array
    free: Bools
    covariance: Array
    after: Array
    before: Array
    hidden: Array
    freedom: float = field(default=np.inf)

    @classmethod
    def of(
        cls,
        solution: Solution,
        extra: Array | None = None,
        freedom: float = np.inf,
        hidden_sd: float = HIDDEN,
    ) -> Posterior:
        """Make the posterior about a solution.

        Parameters
        ----------
        solution : with its normal equations
        extra : (unknowns, unknowns) covariance of the data's gradient J^T r that the noise of the
            rows does not have, as of skin that slides under all markers of a segment
        freedom : degrees of freedom of the noise
        hidden_sd : standard deviation, in an unknown's scale, from which on nothing shows it

        Returns
        -------
        what is known of the unknowns that were searched for
        """
        unknowns = solution.problem.unknowns
        free = solution.free
        inner = np.ix_(free, free)
        scale = unknowns.scale[free]
        H = (solution.data.H + solution.prior.H)[inner]
        spread = Spread.of(H, scale, hidden_sd)
        known = spread.covariance
        if extra is not None:
            known = known + known @ extra[inner] @ known
            spread = Spread(covariance=known, hidden=spread.hidden, scale=scale)
        covariance = np.zeros((len(unknowns), len(unknowns)))
        covariance[inner] = known
        after = np.zeros(len(unknowns))
        after[free] = spread.variance
        before = np.zeros(len(unknowns))
        before[free] = Spread.of(solution.prior.H[inner], scale, hidden_sd).variance
        hidden = np.zeros((len(spread.hidden), len(unknowns)))
        hidden[:, free] = spread.hidden
        return cls(
            unknowns=unknowns,
            x=solution.x,
            free=free,
            covariance=covariance,
            after=after,
            before=before,
            hidden=hidden,
            freedom=freedom,
        )

    @property
    def sd(self) -> Array:
        """(unknowns,) standard deviation; infinite where nothing shows it, 0 where it was held."""
        return np.sqrt(self.after)

    @property
    def share(self) -> Array:
        """(unknowns,) how much the data gave: 1 - variance after / before, 0 to 1."""
        known = np.isfinite(self.after) & (self.before > 0.0)
        ratio = np.divide(self.after, self.before, out=np.ones(len(self.x)), where=known)
        return np.clip(1.0 - ratio, 0.0, 1.0)

    @property
    def shown(self) -> Bools:
        """(unknowns,) whether the data halve the standard deviation at least."""
        return np.asarray(self.share >= SHOWN)

    @cached_property
    def not_shown(self) -> tuple[str, ...]:
        """One line for each direction that neither data nor priors show: what moves along it."""
        lines = []
        for direction in self.hidden:
            parts = np.flatnonzero(np.abs(direction) > 0.1 * np.abs(direction).max())
            order = sorted(parts, key=lambda index: -abs(direction[index]))
            named = ", ".join(self.unknowns.names[index] for index in order[:4])
            others = f" and {len(order) - 4} more" if len(order) > 4 else ""
            together = " together" if len(order) > 1 else ""
            lines.append(f"{named}{others}{together}: not shown")
        return tuple(lines)

    def interval(
        self,
        of: str | ArrayLike | Callable[[Array], float],
        level: float = LEVEL,
        low: float = -np.inf,
        high: float = np.inf,
    ) -> Interval:
        """Find the interval that holds a number with some probability: the rule of all estimates.

        A linear number w . x has x +- t sd (`half_width`). Of another one f(x) the draws f(x_d)
        from the posterior are ranked (`drawn_limits`), and their bias is corrected. Of monotone f
        these limits are f of x's interval; of others, as a distance, that draws make larger, they
        lie on the other side by as much.

        Parameters
        ----------
        of : name of an unknown, weights (unknowns,) of a linear number, or a function of x
        level : probability
        low, high : bounds of the number

        Returns
        -------
        value and limits; infinite limits where nothing shows it
        """
        if callable(of):
            return self._drawn(of, level, low, high)
        if isinstance(of, str):
            check_name("unknown", of, self.unknowns.names, "the estimate")
            index = self.unknowns.names.index(of)
            unknown = tuple(self.unknowns)[index]
            low = max(low, unknown.low)
            high = min(high, unknown.high)
            of = np.eye(len(self.x))[index]
        weights = np.asarray(of, np.float64)
        value = float(weights @ self.x)
        half = float(half_width(np.sqrt(self.variance_of(weights)), level, self.freedom))
        return Interval(value, max(value - half, low), min(value + half, high))

    def variance_of(self, weights: Array) -> float:
        """Find the variance of a linear number weights . x.

        Parameters
        ----------
        weights : (unknowns,)

        Returns
        -------
        infinite where nothing shows it
        """
        free = self.free
        spread = Spread(
            covariance=self.covariance[np.ix_(free, free)],
            hidden=self.hidden[:, free],
            scale=self.unknowns.scale[free],
        )
        return float(spread.variance_of(weights[free][None])[0])

    def draws(self, count: int = DRAWS, seed: int = 0) -> Array:
        """Draw values from the posterior, each with its mirror image.

        Parameters
        ----------
        count : how many
        seed : of the random numbers

        Returns
        -------
        (count, unknowns) within the bounds; what nothing shows stays where it is
        """
        normal = np.random.default_rng(seed).standard_normal((-(-count // 2), len(self.x)))
        if np.isfinite(self.freedom):
            chi = np.random.default_rng(seed + 1).chisquare(self.freedom, len(normal))
            normal = normal * np.sqrt(self.freedom / chi)[:, None]
        sizes, directions = np.linalg.eigh(self.covariance)
        steps = (normal * np.sqrt(np.maximum(sizes, 0.0))) @ directions.T
        steps = np.stack([steps, -steps], axis=1).reshape(-1, len(self.x))[:count]
        moved = self.x + steps
        if any(block.chart is not added for block in self.unknowns.blocks):
            moved = np.array([self.unknowns.moved(self.x, step) for step in steps])
        return np.clip(moved, self.unknowns.low, self.unknowns.high)

    def _drawn(
        self, function: Callable[[Array], float], level: float, low: float, high: float
    ) -> Interval:
        value = float(function(self.x))
        for direction in self.hidden:
            # A number that nothing shows moves along a hidden direction, if only by a little.
            step = (
                1e-3
                * direction
                * np.where(np.isfinite(self.unknowns.scale), self.unknowns.scale, 1.0)
            )
            other = float(function(self.unknowns.moved(self.x, step)))
            if abs(other - value) > 1e-9 * max(1.0, abs(value)):
                return Interval(value, low, high)
        values = np.array([float(function(x)) for x in self.draws()])
        lower, upper = drawn_limits(values, level, value)
        return Interval(value, max(float(lower), low), min(float(upper), high))
