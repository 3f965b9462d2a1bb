"""Prior knowledge of a person's muscles, before any recording.

Parameters, their spread and bounds, and groups. Of every muscle the logarithm of the optimal fiber
length and the shift of the normalized fiber length at the mean pose of the recordings are
estimated; the tendon slack length follows from both. Spreads are those between people. Measured:
fiber lengths normalized to the sarcomere vary by 11 to 27 %, sarcomere lengths in a pose by 0.04 to
0.17 optimal lengths, median 0.09 (Ward et al. 2009, 28 muscles of 21 bodies, sizes of bodies not
taken out; Chen et al. 2016 and Cromie et al. 2013 in the living), strengths by 17 to 39 % (Tedla et
al. 2022, men of one age). Assumed: passive strains, gains of EMG, mean activations without EMG, and
how alike both sides are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.body.personalize.fibers import MuscleSizes
from myomorph.body.personalize.muscle_groups import muscle_groups, shared_emg, side_pairs
from myomorph.body.personalize.recordings import Windows
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.muscles.hill import MODELS, compile_hill, muscle_model

FIBER_BOUND = np.log(1.6)
POINT_BOUND = 0.5
FORCE_BOUND = np.log(3.0)
STRAIN_BOUND = np.log(2.0)
GAIN_BOUND = np.log(5.0)
"""Farthest from the prior: of the logarithms of fiber length, strength, passive strain and gain,
and of the shift.
"""
MIN_SLACK = 0.3  # Of the tendon slack length of the model that personalization begins with
PHYSIOLOGICAL = (0.5, 1.4)
"""Normalized fiber lengths that a recording is expected to stay in (Arnold and Delp 2011; Modenese
et al. 2016).
"""
# Standard deviation of the logarithm of the mean activation of a muscle without EMG; an assumption
LEVEL_SPREAD = 0.7
OUTSIDE = 0.05  # Standard deviation of how far a muscle passes them, or the range it had before


@dataclass(frozen=True)
class PriorOptions:
    """Prior knowledge of a person; spreads are standard deviations.

    Attributes
    ----------
    fiber_spread : standard deviation between people of the logarithm of optimal fiber lengths
    point_spread : standard deviation between people of normalized fiber lengths in a given pose,
        which determine tendon slack lengths
    strength_spread : standard deviation between people of the logarithm of a muscle group's
        strength
    passive_spread : standard deviation between people of the logarithm of a muscle group's passive
        fiber strain
    gain_spread : standard deviation of the logarithm of EMG gains; 0 if envelopes are activations
        already
    sides : correlation between left and right muscles of the same name
    """

    fiber_spread: float = 0.15
    point_spread: float = 0.12
    strength_spread: float = 0.25
    passive_spread: float = 0.2
    gain_spread: float = 0.3
    sides: float = 0.8

    def __post_init__(self) -> None:
        for name in (
            "fiber_spread",
            "point_spread",
            "strength_spread",
            "passive_spread",
            "gain_spread",
        ):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise BadData(f"{name} is {getattr(self, name):g}: expected 0 to 1")
        if not 0.0 <= self.sides < 1.0:
            raise BadData(f"the correlation of sides is {self.sides:g}: expected 0 to below 1")


class Parts(NamedTuple):
    """Where the five kinds of parameters lie in a vector of all, which is the only order there is.

    Attributes
    ----------
    fibers : log of the optimal fiber length of each muscle
    points : shift of the operating point of each muscle
    strength, passive : log of strength and passive strain of each group
    gains : log of gains of EMG, then of levels of muscles without it
    """

    fibers: slice
    points: slice
    strength: slice
    passive: slice
    gains: slice


@read_only
class Prior:
    """Parameters p of a person's muscles, and what is known of them.

    Their order is that of `Parts`; all are 0 before the recordings.

    Attributes
    ----------
    names : (muscles,)
    start : of the model that personalization begins with
    point : (muscles,) its fibers along the tendon at the mean pose, normalized, tendons at slack
        length
    reference : (muscles,) path length there [m]
    groups : names of muscle groups
    group : (muscles,) each muscle's
    gain : (muscles,) number of the gain of each muscle's EMG, and after these of its level, where
        it has no EMG
    gains : names of the muscles that share each gain
    levels : number of muscles without EMG, whose mean activation is a parameter; none without a
        recording in motion
    deviation : (parameters,) prior standard deviation
    precision : (parameters, parameters) inverse of the prior covariance; where a deviation is 0, of
        a fixed parameter
    bound : (parameters,) farthest from 0
    """

    names: tuple[str, ...]
    start: MuscleSizes
    point: Array
    reference: Array
    groups: tuple[str, ...]
    group: NDArray[np.int64]
    gain: NDArray[np.int64]
    gains: tuple[str, ...]
    levels: int
    deviation: Array
    precision: Array
    bound: Array

    @property
    def parts(self) -> Parts:
        """Where the five kinds of parameters lie."""
        muscles = len(self.names)
        groups = len(self.groups)
        strength = 2 * muscles
        passive = strength + groups
        gains = passive + groups
        return Parts(
            fibers=slice(0, muscles),
            points=slice(muscles, strength),
            strength=slice(strength, passive),
            passive=slice(passive, gains),
            gains=slice(gains, gains + len(self.gains) + self.levels),
        )

    def sizes(self, p: Array) -> MuscleSizes:
        """Compute the muscles at some parameters.

            lo = lo_0 exp(p_fiber),   ls = L - (point + p_point) lo

        with the path length L at the mean pose.

        Parameters
        ----------
        p : (parameters,)

        Returns
        -------
        lengths [m], strengths [N] and strain factors
        """
        parts = self.parts
        lo = self.start.fiber * np.exp(p[parts.fibers])
        strength = np.exp(p[parts.strength])[self.group]
        passive = np.exp(p[parts.passive])[self.group]
        return MuscleSizes(
            fiber=lo,
            slack=self.reference - (self.point + p[parts.points]) * lo,
            force=self.start.force * strength,
            strain=self.start.strain * passive,
        )

    def gains_of(self, p: Array) -> Array:
        """Compute the gain of each muscle's EMG, or the factor on its level where it has none.

        Parameters
        ----------
        p : (parameters,)

        Returns
        -------
        (muscles,)
        """
        every = np.append(np.exp(p[self.parts.gains]), 1.0)
        return every[self.gain]

    def with_tendons(self, fibers: Array, points: Array) -> Array:
        """Limit shifts of operating points so that a tendon is left to every muscle.

            ls >= `MIN_SLACK` ls_0

        Parameters
        ----------
        fibers : (muscles,) logarithms of optimal fiber lengths
        points : (muscles,) shifts within their bounds

        Returns
        -------
        (muscles,) shifts
        """
        longest = self.reference - MIN_SLACK * self.start.slack
        most = longest / (self.start.fiber * np.exp(fibers)) - self.point
        return np.minimum(points, np.maximum(most, -self.bound[self.parts.points]))


def sizes_of(model: Model) -> MuscleSizes:
    """Return a model's own muscles."""
    muscles = compile_hill(model)
    return MuscleSizes(
        fiber=muscles.fiber,
        slack=muscles.tendon,
        force=muscles.force,
        strain=np.ones(len(muscles.fiber)),
    )


def prior_of(
    model: Model,
    windows: Sequence[Windows],
    rows: Sequence[str],
    options: PriorOptions,
    fixed: np.ndarray,
) -> Prior:
    """Build the prior of a model's muscles.

    Parameters
    ----------
    model : that personalization begins with
    windows : recordings
    rows : names of the coordinates that are compared
    options : spreads between people
    fixed : (muscles,) muscles that keep their lengths: those that are switched off

    Returns
    -------
    parameters with their spread and bounds
    """
    start = sizes_of(model)
    lengths = np.concatenate([window.lengths[window.counted] for window in windows])
    low, high = PHYSIOLOGICAL
    point = np.clip((np.mean(lengths, axis=0) - start.slack) / start.fiber, low, high)
    groups, group = muscle_groups(model, windows, rows)
    gains, gain = shared_emg(model.muscle_names, windows)
    # The mean activation of a muscle without EMG lasts: as an error of each frame it would look
    # known.
    levels = np.zeros(0, np.int64)
    if not all(window.at_rest for window in windows):
        levels = np.flatnonzero(gain < 0)
    gain[levels] = len(gains) + np.arange(len(levels))

    known = _known_parameters(options, fixed, len(groups), len(gains), len(levels))
    pairs = side_pairs(model.muscle_names)
    return Prior(
        names=model.muscle_names,
        start=start,
        point=point,
        # The reference path length belongs to the point: where the point was moved into range, so
        # is the path.
        reference=start.slack + point * start.fiber,
        groups=groups,
        group=group,
        gain=gain,
        gains=gains,
        levels=len(levels),
        deviation=known.deviation,
        precision=_precision(known.deviation, pairs, len(model.muscles), options.sides),
        bound=known.bound,
    )


class _Known(NamedTuple):
    """Standard deviation before the recordings, and bound, of each parameter (parameters,)."""

    deviation: Array
    bound: Array


def _known_parameters(
    options: PriorOptions, fixed: np.ndarray, groups: int, gains: int, levels: int
) -> _Known:
    """Lay out spreads and bounds in the order of `Parts`.

    Parameters
    ----------
    options : spreads between people
    fixed : (muscles,) muscles that keep their lengths
    groups, gains, levels : numbers of them
    """
    muscles = len(fixed)
    free = np.where(fixed, 0.0, 1.0)
    deviation = (
        options.fiber_spread * free,
        options.point_spread * free,
        np.full(groups, options.strength_spread),
        np.full(groups, options.passive_spread),
        np.full(gains, options.gain_spread),
        np.full(levels, LEVEL_SPREAD),
    )
    bound = (
        np.full(muscles, FIBER_BOUND),
        np.full(muscles, POINT_BOUND),
        np.full(groups, FORCE_BOUND),
        np.full(groups, STRAIN_BOUND),
        np.full(gains, GAIN_BOUND),
        np.full(levels, GAIN_BOUND),
    )
    return _Known(deviation=np.concatenate(deviation), bound=np.concatenate(bound))


def _precision(
    deviation: Array, pairs: Sequence[tuple[int, int]], muscles: int, correlation: float
) -> Array:
    """Invert the prior covariance.

    A parameter without spread has a variance of its own that holds it.

    Parameters
    ----------
    deviation : (parameters,)
    pairs : numbers of muscles of the same name on both sides
    muscles : number of muscles
    correlation : of both sides

    Returns
    -------
    (parameters, parameters)
    """
    covariance = np.diag(np.maximum(deviation, 1e-6) ** 2)
    for i, j in pairs:
        for first in (0, muscles):
            shared = correlation * deviation[first + i] * deviation[first + j]
            covariance[first + i, first + j] = covariance[first + j, first + i] = shared
    return np.linalg.inv(covariance)


def with_sizes(model: Model, sizes: MuscleSizes, before: MuscleSizes) -> Model:
    """Give a model other fiber lengths, tendon slack lengths, strengths and passive strains.

    Parameters
    ----------
    model : whose muscles change
    sizes : of its muscles now
    before : of the model as it is, for the passive strain
    """
    muscles = []
    for m, muscle in enumerate(model.muscles):
        factor = float(sizes.strain[m] / before.strain[m])
        parameters = dict(muscle.parameters)
        if muscle.kind in MODELS and abs(factor - 1.0) >= 1e-12:
            parameters = muscle_model(muscle).stretched_passive(parameters, factor)
        if "default_fiber_length" in parameters:
            parameters["default_fiber_length"] *= (
                float(sizes.fiber[m]) / muscle.optimal_fiber_length
            )
        muscles.append(
            replace(
                muscle,
                optimal_fiber_length=float(sizes.fiber[m]),
                tendon_slack_length=float(sizes.slack[m]),
                max_isometric_force=float(sizes.force[m]),
                parameters=FrozenMap(parameters),
            )
        )
    return replace(model, muscles=tuple(muscles))
