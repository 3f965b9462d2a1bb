"""Hypotheses about a recording, compared by their evidence.

What a sound laboratory has without a fault (masses of segments that are off by a tenth, a clock by
some milliseconds, ...) is marginalised: the residual r is made white by W over what is left of it.
Of a hypothesis h with values v ~ N(0, sd),

    log E_h = -(nu + n) / 2 log(1 + (|W r_h(v)|^2 + |v / sd|^2) / nu)
              - 1/2 log det(1 + sd J'J sd / s^2)

with Student's t for the size of the noise, and Laplace's approximation for the values.

Source: MacKay 1992.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from myomorph.core.contact.consistency.corrections import Correction, Hypothesis
from myomorph.core.contact.consistency.scene import TEMPER, Scene
from myomorph.core.model.arrays import Array, read_only

PRIOR_COUNT = 15.0
"""How firmly the noise's size is believed, as a number of frames."""
MASS_SD = 0.08
WOBBLE_SD = 0.08
CENTER_SD = 0.01
CLOCK_SD = 0.004
TILT_SD = 0.008
GAIN_SD = 0.015
POINT_SD = 0.006
SOLE_SD = 0.015
"""What a sound laboratory has: segments' masses and accelerations by a share, the body's center of
mass [m], clocks [s], tilts [rad], gains, points [m], soles along the foot [m].
"""
DISCRETE = 1.5
"""Price of a hypothesis without values, in log evidence."""
STEP = 0.02
"""Step of a derivative, over the standard deviation of the value."""
STEPS = 6
SHORTER = (1.0, 1.0 / 3.0, 1.0 / 9.0, 1.0 / 27.0)
"""Most steps of a search, and parts of one that are tried."""
PROMISING = 8
"""Hypotheses that are looked at closely."""


class Tried(NamedTuple):
    """A hypothesis with its best values.

    Attributes
    ----------
    gain : log evidence over that of nothing wrong
    hypothesis : what may be wrong
    values : the best ones
    spread : (values,) half widths of their 95 % intervals
    left : what the correction leaves, over the noise
    """

    gain: float
    hypothesis: Hypothesis
    values: Array
    spread: Array
    left: float

    @property
    def matters(self) -> bool:
        """Whether a value is so large that it changes results."""
        sized = len(self.values) > 0
        return not sized or float(np.abs(self.values).max()) >= self.hypothesis.least

    @property
    def text(self) -> str:
        """What is wrong with the forces, after a colon."""
        return self.hypothesis.text(self.values, self.spread)

    @property
    def size(self) -> float | None:
        """Size of what is wrong, in the unit of its message."""
        return None if self.hypothesis.size is None else self.hypothesis.size(self.values)

    @property
    def possible(self) -> bool:
        """Whether values of this size are this fault."""
        return not len(self.values) or float(self.values.min()) > self.hypothesis.lowest

    @property
    def correction(self) -> Correction:
        """What puts the recording right."""
        return self.hypothesis.make(self.values)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Hypotheses by their evidence.

    Attributes
    ----------
    tried : the likeliest first
    left : what is left of the balance with nothing put right, over its noise
    """

    tried: tuple[Tried, ...]
    left: float


@read_only
@dataclass(frozen=True, eq=False)
class _Whitening:
    """What is left of a residual beside what is uncertain without a fault.

    Attributes
    ----------
    directions : (residuals, uncertain) orthonormal
    shrink : (uncertain,) part of each that is taken off
    """

    scene: Scene
    directions: Array
    shrink: Array

    def residual(self, correction: Correction) -> Array:
        """(residuals,) white, over the noise."""
        values = self.scene.residual(correction)
        along = self.directions.T @ values
        return np.sqrt(TEMPER) * (values - self.directions @ (self.shrink * along))


def _whitening(scene: Scene, live: Sequence[int]) -> _Whitening:
    """Take off what is uncertain without a fault."""
    columns = np.array(list(_uncertain(scene, live)))
    directions, sizes, _ = np.linalg.svd(np.sqrt(TEMPER) * columns.T, full_matrices=False)
    return _Whitening(scene, directions, 1.0 - 1.0 / np.sqrt(1.0 + sizes**2))


def _uncertain(scene: Scene, live: Sequence[int]) -> Iterator[Array]:
    """Yield changes of the residual by one standard deviation of what is uncertain."""
    none = scene.nothing
    before = scene.residual(none)
    needs = scene.frames
    total = needs.segments.sum(axis=1)
    rows = np.zeros(len(before))

    def column(balance: Array) -> Array:
        values = rows.copy()
        values[: balance.size] = (balance / scene.sd).ravel()
        return values

    for segment, share in enumerate(needs.shares):
        yield column(MASS_SD * (needs.segments[:, segment] - share * total))
    for axis in np.eye(3):
        yield column(
            WOBBLE_SD * np.concatenate([needs.inertial * axis, needs.moment * axis], axis=1)
        )
    level = np.eye(3)[scene.flat]
    plates = len(none.lag)
    small = [replace(none, lag=np.full(plates, CLOCK_SD))]
    small += [replace(none, gravity=TILT_SD * axis) for axis in np.eye(2)]
    small += [replace(none, center=CENTER_SD * axis) for axis in level]
    small += [replace(none, ahead=SOLE_SD)]
    for number in live:
        one = np.eye(plates)[number]
        small.append(replace(none, force=none.force * (1.0 + GAIN_SD * one)[:, None, None]))
        small += [replace(none, shift=POINT_SD * np.outer(one, axis)) for axis in level]
    for correction in small:
        yield scene.residual(correction) - before


class _Best(NamedTuple):
    """Least cost, its values, and the derivative of the residual there (residuals, values)."""

    cost: float
    values: Array
    slope: Array


def compared(scene: Scene, hypotheses: Sequence[Hypothesis], live: Sequence[int]) -> Comparison:
    """Compare hypotheses by their evidence over nothing wrong.

    Each is looked at by one step from where it starts; the most promising ones are followed to
    their best values.

    Parameters
    ----------
    scene : the body and its plates
    hypotheses : what may be wrong
    live : numbers of the plates that are stepped on

    Returns
    -------
    the hypotheses, the likeliest first
    """
    white = _whitening(scene, live)
    start = white.residual(scene.nothing)
    count = TEMPER * len(scene.residual(scene.nothing))
    cost = float(start @ start)

    def tried(hypothesis: Hypothesis, steps: int) -> Tried:
        best = _least(
            lambda values: white.residual(hypothesis.make(values)),
            hypothesis.first_values,
            hypothesis.sd,
            steps,
        )
        gain = _log_evidence(best.cost, count) - _log_evidence(cost, count)
        return Tried(
            gain=gain - _price(best, hypothesis.sd, count) + hypothesis.prior,
            hypothesis=hypothesis,
            values=best.values,
            spread=_spread(best, hypothesis.sd, count),
            left=float(np.sqrt(best.cost / count)),
        )

    first = sorted((tried(item, 1) for item in hypotheses), key=lambda item: -item.gain)
    close = [tried(item.hypothesis, STEPS) for item in first[:PROMISING]]
    ranked = sorted([*close, *first[PROMISING:]], key=lambda item: -item.gain)
    ranked = [item for item in ranked if item.possible]
    return Comparison(tried=tuple(ranked), left=float(np.sqrt(cost / count)))


def misfit(scene: Scene, live: Sequence[int]) -> float:
    """Compute what is left of the balance with nothing put right, over its noise.

    Parameters
    ----------
    scene : the body and its plates
    live : numbers of the plates that are stepped on
    """
    left = _whitening(scene, live).residual(scene.nothing)
    return float(np.sqrt(left @ left / (TEMPER * len(left))))


def _log_evidence(cost: float, count: float) -> float:
    """Log evidence of a cost under Student's t, the size of values beside."""
    return -0.5 * (PRIOR_COUNT + count) * float(np.log1p(cost / PRIOR_COUNT))


def _price(best: _Best, sd: Array, count: float) -> float:
    """Price of the values that a hypothesis may choose."""
    if not len(sd):
        return DISCRETE
    scale = (PRIOR_COUNT + best.cost) / (PRIOR_COUNT + count)
    slope = best.slope * sd
    return 0.5 * float(np.linalg.slogdet(np.eye(len(sd)) + slope.T @ slope / scale)[1])


def _spread(best: _Best, sd: Array, count: float) -> Array:
    """Half widths of the values' 95 % intervals, by Laplace's approximation, (values,)."""
    scale = (PRIOR_COUNT + best.cost) / (PRIOR_COUNT + count)
    information = best.slope.T @ best.slope / scale + np.diag(sd**-2.0)
    return np.asarray(1.96 * np.sqrt(np.diag(np.linalg.inv(information))))


def _least(residual: Callable[[Array], Array], starts: Array, sd: Array, steps: int) -> _Best:
    """Find values of least cost |r(v)|^2 + |v / sd|^2 by Gauss-Newton steps.

    Parameters
    ----------
    residual : from values to (residuals,)
    starts : (starts, values) of which the best is followed
    sd : (values,) standard deviations
    steps : the most that are made
    """

    def cost_of(values: Array, left: Array) -> float:
        return float(left @ left + ((values / sd) ** 2).sum())

    begun = [(values, residual(values)) for values in starts]
    values, left = min(begun, key=lambda pair: cost_of(*pair))
    cost = cost_of(values, left)
    slope = np.zeros((len(left), len(values)))
    for _ in range(steps if len(values) else 0):
        moved = [residual(values + STEP * sd * axis) for axis in np.eye(len(values))]
        slope = np.column_stack(
            [(item - left) / (STEP * size) for item, size in zip(moved, sd, strict=True)]
        )
        right = slope.T @ left + values / sd**2
        step = -np.linalg.solve(slope.T @ slope + np.diag(sd**-2.0), right)
        before = cost
        for part in SHORTER:
            there = residual(values + part * step)
            reached = cost_of(values + part * step, there)
            if reached < cost:
                values, left, cost = values + part * step, there, reached
                break
        if before - cost < 1e-3 * cost:
            break
    return _Best(cost, values, slope)
