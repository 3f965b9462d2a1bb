"""One fit of all spectra of a recording: motion that falls steeply, coloured noise, a filter.

    P_j(f) = (S_j(f) + N_j g(f)) A(f)^2                                     column j
    S_j(f) = N_j g(f1_j) ((f1_j^2 + k_j^2) / (f^2 + k_j^2))^(s_j / 2)       its motion
    g(f)   = (1 - a)^2 / (1 - 2 a cos(pi f / fe) + a^2)                     colour of the noise
    A(f)   = 1 / (1 + (f / fe)^(2 m)), or of a cubic spline, or 1           what filtered all

Motion falls by a power s of frequency beyond a knee k and meets the noise at f1. Noise is an
autoregression of first order of samples at the rate 2 fe (a = 0: white). A is a Butterworth filter
both ways, as of a camera's software, or the transfer function of a cubic spline through samples at
2 fe, as of a recording that was resampled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.core.fit.spectra import Spectra
from myomorph.core.model.arrays import Array, read_only

SPLINE = 0  # Stands for the order m of a spline
ORDERS = (2, 4, SPLINE)
FACTORS = (0.0, 0.4, 0.7, 0.9)  # a
COARSE_FACTORS = (0.0, 0.7)
SLOPES = (6.0, 8.0, 11.0, 15.0, 20.0)  # s
KNEES = (0.01, 2.0, 4.0, 8.0, 16.0)  # k over the lowest frequency
EARLY = (0.3, 0.45, 0.7, 1.0)  # f1 over the lowest frequency, where motion is below all bins
POINTS = 36  # Of the grids of f1 and fe, at least
COARSE = 3  # Every third edge is tried first
MIN_SLOPE = 5.0  # Of the motion where it meets the noise: s f1^2 / (f1^2 + k^2)
ENDED = 1e-3  # A recording has ended where f^4 P stays below this share of its maximum
TOP = 0.97  # Share of the bins up to which a recording without a filter has content
HIGHEST_EDGE = 0.85  # Over half the rate; a higher edge leaves nothing beyond it to see it by
BEYOND = 1.1  # Of what lies further beyond the edge nothing is learnt about noise below
USUAL_SHARE = 0.004  # Noise above f1 is seldom more of a column's standard deviation
SHARE_PRIOR = 0.03  # Weight of that, in log power squared
EDGE_PENALTY = 0.15  # In the logarithm of the squared residual of log P
COLOUR_PENALTY = 0.03
ROUGHNESS = 0.02  # Squared residual of log P that a perfect fit is given


@dataclass(frozen=True, kw_only=True)
class NoiseShape:
    """What all columns share: the colour of their noise and what filtered them.

    Attributes
    ----------
    edge : fe of the filter [Hz], None where there is none
    top : up to which noise is described: the edge, else half the rate [Hz]
    factor : a of the autoregression
    order : m of the filter, or `SPLINE`
    """

    edge: float | None
    top: float
    factor: float
    order: int

    def colour(self, frequency: Array) -> Array:
        """Power of the noise over that at no frequency, g.

        Parameters
        ----------
        frequency : (n,) [Hz]; beyond the edge it is folded back

        Returns
        -------
        (n,) [-]
        """
        folded = np.abs((frequency / self.top + 1.0) % 2.0 - 1.0)
        spread = 1.0 - 2.0 * self.factor * np.cos(np.pi * folded) + self.factor**2
        return np.asarray((1.0 - self.factor) ** 2 / spread)

    def passed(self, frequency: Array) -> Array:
        """Share of an amplitude that the filter left, A.

        A cubic spline through samples at 2 fe has, with u = pi f / (2 fe),

            A = 3 (sin u / u)^4 / (1 + 2 cos(u)^2)

        Parameters
        ----------
        frequency : (n,) [Hz]

        Returns
        -------
        (n,) [-]
        """
        if self.edge is None:
            return np.ones_like(frequency)
        if self.order != SPLINE:
            return np.asarray(1.0 / (1.0 + (frequency / self.edge) ** (2.0 * self.order)))
        turn = 0.5 * np.pi * frequency / self.edge
        spline = 3.0 * (np.sin(turn) / turn) ** 4 / (1.0 + 2.0 * np.cos(turn) ** 2)
        # Rounding leaves something at the zeros.
        return np.asarray(spline + 1e-3)


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseFit:
    """A fit of all spectra of a recording.

    Attributes
    ----------
    shape : what all columns share
    ended : highest frequency with content [Hz]
    meets : (columns,) f1, where motion meets noise [Hz]
    slope : (columns,) s
    knee : (columns,) k [Hz]
    """

    shape: NoiseShape
    ended: float
    meets: Array
    slope: Array
    knee: Array


class _Fall(NamedTuple):
    """Falls of motion that are tried, each of shape (candidates,) but `powers`.

    Attributes
    ----------
    meets : f1 [Hz]
    slope : s
    knee : k [Hz]
    powers : (bins, candidates) of the motion over that at f1
    """

    meets: Array
    slope: Array
    knee: Array
    powers: Array


class _Coloured(NamedTuple):
    """Models of log P with noise of one colour, before a filter.

    Attributes
    ----------
    colour : (bins,) g
    at_meeting : (candidates,) log g at f1
    level : (candidates,) mean of the models
    model : (bins, candidates) less these
    squares : (candidates, 1) mean squares of it
    products : (candidates, columns) its mean products with log P
    """

    colour: Array
    at_meeting: Array
    level: Array
    model: Array
    squares: Array
    products: Array


class _Trial(NamedTuple):
    """The best of the fits that were tried with some shapes.

    Attributes
    ----------
    cost : logarithm of the squared residual of log P, with penalties
    shape : of the noise
    which : (columns,) numbers of the falls
    """

    cost: float
    shape: NoiseShape
    which: np.ndarray


def fit_noise(spectra: Spectra) -> NoiseFit:
    """Fit motion, noise and filter to all spectra at once.

    Parameters
    ----------
    spectra : of a recording, each column with power in every bin

    Returns
    -------
    the fit of least squared residuals of log P, columns weighed alike
    """
    content = spectra.frequency <= _ended(spectra)
    used = spectra.only(content)
    search = _Search(used, half_rate=float(spectra.frequency[-1]))
    unfiltered = bool(content[int(TOP * len(content))])
    best = search.least(search.edges(unfiltered))
    if best.shape.edge is not None:
        # What lies beyond says where the edge is, but nothing about the noise below.
        near = used.only(used.frequency <= BEYOND * best.shape.edge)
        search = _Search(near, half_rate=search.half_rate, edge=best.shape.edge)
        shapes = [search.shape(best.shape.edge, factor, best.shape.order) for factor in FACTORS]
        best = search.best(shapes)
    falls = search.falls
    return NoiseFit(
        shape=best.shape,
        ended=float(used.frequency[-1]),
        meets=falls.meets[best.which],
        slope=falls.slope[best.which],
        knee=falls.knee[best.which],
    )


def _ended(spectra: Spectra) -> float:
    """Find the highest frequency at which the accelerations of the median column have content."""
    bend = np.log(spectra.power) + 4.0 * np.log(spectra.frequency)[:, None]
    middle = np.median(bend - bend.max(axis=0), axis=1)
    last = np.flatnonzero(middle > middle.max() + np.log(ENDED))[-1]
    return float(spectra.frequency[last])


class _Search:
    """Least squares over a grid: the sum over columns says fe, a, m; each column says f1, s, k.

    Levels N are free: log P and its model are compared without their means.
    """

    def __init__(self, spectra: Spectra, half_rate: float, edge: float | None = None):
        self.frequency = spectra.frequency
        self.width = spectra.width
        self.half_rate = half_rate
        log = np.log(spectra.power)
        self.level = log.mean(axis=0)
        self.log = log - self.level
        self.variance = np.square(self.log).mean(axis=0)
        self.size = np.log(self.width @ spectra.power)
        stride = max(1, len(self.frequency) // POINTS)
        self.grid = self.frequency[1:-1][::stride]
        self.falls = self._falls(np.array([half_rate if edge is None else edge]))
        self._known: dict[tuple[float, float], _Coloured] = {}

    def _falls(self, tops: Array) -> _Fall:
        """Make the falls of motion that are tried, up to the highest frequency (n,) of noise."""
        lowest = self.frequency[0]
        meets = np.concatenate([lowest * np.array(EARLY), self.grid, tops])
        knees = lowest * np.array(KNEES)
        columns = [column.ravel() for column in np.meshgrid(meets, SLOPES, knees, indexing="ij")]
        f1, s, k = np.stack(columns)
        steep = s * f1**2 / (f1**2 + k**2) >= MIN_SLOPE
        f1, s, k = np.stack([f1, s, k])[:, steep]
        powers = ((f1**2 + k**2) / (self.frequency[:, None] ** 2 + k**2)) ** (0.5 * s)
        return _Fall(meets=f1, slope=s, knee=k, powers=powers)

    def _coloured(self, shape: NoiseShape) -> _Coloured:
        """Make the models with the colour of a shape; that of white noise has no edge."""
        key = (shape.factor, shape.top if shape.factor > 0.0 else 0.0)
        if key not in self._known:
            colour = shape.colour(self.frequency)
            at_meeting = np.interp(self.falls.meets, self.frequency, colour)
            model = np.log(self.falls.powers + colour[:, None] / at_meeting)
            level = model.mean(axis=0)
            model -= level
            self._known[key] = _Coloured(
                colour=colour,
                at_meeting=np.log(at_meeting),
                level=level,
                model=model,
                squares=np.square(model).mean(axis=0)[:, None],
                products=model.T @ self.log / len(colour),
            )
        return self._known[key]

    def shape(self, edge: float | None, factor: float, order: int) -> NoiseShape:
        """Return a shape to try."""
        top = self.half_rate if edge is None else edge
        return NoiseShape(edge=edge, top=top, factor=factor, order=order)

    def edges(self, unfiltered: bool) -> list[float | None]:
        """List the edges to try; None for no filter, where the spectrum may do without."""
        edges: list[float | None] = list(self.grid.tolist())
        if unfiltered:
            limit = HIGHEST_EDGE * self.half_rate
            edges = [None, *(edge for edge in self.grid.tolist() if edge < limit)]
        return edges

    def least(self, edges: Sequence[float | None]) -> _Trial:
        """Try all edges, coarsely first, then those beside the best of each order."""
        real = [edge for edge in edges if edge is not None]
        trials = []
        if None in edges:
            trials.append(self.best([self.shape(None, factor, ORDERS[0]) for factor in FACTORS]))
        for order in ORDERS:
            coarse = [
                self.shape(edge, factor, order)
                for edge in real[::COARSE]
                for factor in COARSE_FACTORS
            ]
            if coarse:
                found = real.index(self.best(coarse).shape.top)
                beside = real[max(found - COARSE + 1, 0) : found + COARSE]
                fine = [self.shape(edge, factor, order) for edge in beside for factor in FACTORS]
                trials.append(self.best(fine))
        return min(trials, key=lambda trial: trial.cost)

    def best(self, shapes: Sequence[NoiseShape]) -> _Trial:
        """Try shapes one after the other."""
        return min(map(self._tried, shapes), key=lambda trial: trial.cost)

    def _tried(self, shape: NoiseShape) -> _Trial:
        """Fit the fall of each column with one shape.

        With the deviations l of log P and m of its model from their means, the mean square of the
        residual is

            mean(l^2) - 2 mean(l m) + mean(m^2),    m = m_coloured + 2 log A
        """
        falls = self.falls
        coloured = self._coloured(shape)
        passed = shape.passed(self.frequency)
        filtered = 2.0 * np.log(passed)
        loss = filtered.mean()
        filtered -= loss
        count = len(filtered)
        own = coloured.squares + (2.0 / count) * (filtered @ coloured.model)[:, None]
        cost = own - 2.0 * coloured.products
        cost += self.variance + np.square(filtered).mean() - (2.0 / count) * (filtered @ self.log)

        # Noise above f1 over the size of the column, as a standard deviation.
        noise = coloured.colour * passed**2 * self.width
        above = np.log(np.interp(falls.meets, self.frequency, np.cumsum(noise[::-1])[::-1]))
        of_noise = above - coloured.at_meeting - coloured.level - loss
        excess = 0.5 * (self.level - self.size) - np.log(USUAL_SHARE) + 0.5 * of_noise[:, None]
        cost += SHARE_PRIOR * np.square(np.maximum(excess, 0.0, out=excess), out=excess)
        cost[falls.meets > shape.top * (1.0 + 1e-9)] = np.inf

        penalty = EDGE_PENALTY * (shape.edge is not None) + COLOUR_PENALTY * (shape.factor > 0.0)
        total = float(np.log(cost.min(axis=0) + ROUGHNESS).mean()) + penalty
        return _Trial(cost=total, shape=shape, which=cost.argmin(axis=0))
