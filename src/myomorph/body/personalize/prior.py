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
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from myomorph.body.personalize.fibers import MuscleShapes, MuscleSizes
from myomorph.body.personalize.recordings import Windows
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap, grouped
from myomorph.core.model.model import Model
from myomorph.core.model.sides import split_side
from myomorph.core.muscles.hill import MODELS, compile_hill, muscle_model

FIBER_BOUND = np.log(1.6)
POINT_BOUND = 0.5
FORCE_BOUND = np.log(3.0)
STRAIN_BOUND = np.log(2.0)
GAIN_BOUND = np.log(5.0)
"""Farthest from the prior: of the logarithms of fiber length, strength, passive strain and gain,
and of the shift.
"""
LEAST_SLACK = 0.3  # Of the tendon slack length of the model that personalization begins with
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
    fiber_spread : of the logarithm of optimal fiber lengths
    point_spread : of normalized fiber lengths in a given pose, which shifts the tendon slack length
    strength_spread : of the logarithm of a muscle group's strength
    passive_spread : of the logarithm of a muscle group's passive fiber strain
    gain_spread : of the logarithm of gains of EMG; 0 where envelopes are activations as they are
    sides : correlation of left and right muscles of the same name
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


@read_only
class Prior:
    """Parameters p of a person's muscles, and what is known of them.

    They are, in this order, log fiber and shift of the operating point of each muscle, log strength
    and log passive strain of each group, log gains of EMG and levels of muscles without it.

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
    def parts(self) -> tuple[slice, slice, slice, slice, slice]:
        """Where the five kinds of parameters lie."""
        muscles = len(self.names)
        groups = len(self.groups)
        sizes = (muscles, muscles, groups, groups, len(self.gains) + self.levels)
        ends = np.cumsum([0, *sizes]).tolist()
        return tuple(slice(*pair) for pair in pairwise(ends))  # type: ignore[return-value]

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
        fiber, point, force, strain, _ = self.parts
        lo = self.start.fiber * np.exp(p[fiber])
        slack = self.reference - (self.point + p[point]) * lo
        rise = np.exp(p[force])[self.group]
        return MuscleSizes(
            fiber=lo,
            slack=slack,
            force=self.start.force * rise,
            strain=self.start.strain * np.exp(p[strain])[self.group],
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
        every = np.append(np.exp(p[self.parts[4]]), 1.0)
        return every[self.gain]

    def kept(self, p: Array) -> Array:
        """Keep parameters within their bounds, with a tendon left to every muscle.

        Parameters
        ----------
        p : (parameters,)

        Returns
        -------
        (parameters,)
        """
        p = np.clip(p, -self.bound, self.bound)
        fiber, point = self.parts[:2]
        least = LEAST_SLACK * self.start.slack
        most = (self.reference - least) / (self.start.fiber * np.exp(p[fiber])) - self.point
        p[point] = np.minimum(p[point], np.maximum(most, -self.bound[point]))
        return p


def sizes_of(model: Model) -> MuscleSizes:
    """Return a model's own muscles."""
    H = compile_hill(model)
    return MuscleSizes(fiber=H.fiber, slack=H.tendon, force=H.force, strain=np.ones(len(H.fiber)))


def prior_of(
    model: Model,
    shapes: MuscleShapes,
    windows: Sequence[Windows],
    rows: Sequence[str],
    options: PriorOptions,
    fixed: np.ndarray,
) -> Prior:
    """Build the prior of a model's muscles.

    Parameters
    ----------
    model : that personalization begins with
    shapes : curves of its muscles
    windows : recordings
    rows : names of the coordinates that are compared
    options : spreads between people
    fixed : (muscles,) muscles that keep their lengths, as those that are switched off or cannot
        reach

    Returns
    -------
    parameters with their spread and bounds
    """
    start = sizes_of(model)
    mean = np.mean(np.concatenate([window.lengths[window.counted] for window in windows]), axis=0)
    point = np.clip((mean - start.slack) / start.fiber, PHYSIOLOGICAL[0], PHYSIOLOGICAL[1])
    # The reference path length belongs to the point: where the point was moved into range, so is
    # the path.
    reference = start.slack + point * start.fiber
    groups, group = muscle_groups(model, windows, rows)
    gains, gain = _shared_emg(model.muscle_names, windows)
    muscles = len(model.muscles)
    # The mean activation of a muscle without EMG lasts: as an error of each frame it would look
    # known.
    levels = (
        np.flatnonzero(gain < 0)
        if any(np.isfinite(window.step) for window in windows)
        else np.zeros(0, np.int64)
    )
    gain[levels] = len(gains) + np.arange(len(levels))
    counts = (muscles, muscles, len(groups), len(groups), len(gains), len(levels))
    spreads = (
        options.fiber_spread,
        options.point_spread,
        options.strength_spread,
        options.passive_spread,
        options.gain_spread,
        LEVEL_SPREAD,
    )
    bounds = (FIBER_BOUND, POINT_BOUND, FORCE_BOUND, STRAIN_BOUND, GAIN_BOUND, GAIN_BOUND)
    deviation = np.repeat(spreads, counts)
    for part in range(2):
        deviation[part * muscles : (part + 1) * muscles][fixed] = 0.0
    precision = _precision(deviation, _pairs(model.muscle_names), muscles, options.sides)
    return Prior(
        names=model.muscle_names,
        start=start,
        point=point,
        reference=reference,
        groups=groups,
        group=group,
        gain=gain,
        gains=gains,
        levels=len(levels),
        deviation=deviation,
        precision=precision,
        bound=np.repeat(bounds, counts),
    )


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


def _pairs(names: Sequence[str]) -> list[tuple[int, int]]:
    """Find muscles of the same name on both sides."""
    by_name: dict[str, dict[str, int]] = {}
    for m, name in enumerate(names):
        base, side = split_side(name)
        if side:
            by_name.setdefault(base, {})[side] = m
    return [tuple(result.values()) for result in by_name.values() if len(result) == 2]  # type: ignore[misc]


def muscle_groups(
    model: Model, windows: Sequence[Windows], rows: Sequence[str]
) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Group muscles by what they do most.

    It is the coordinate and sense of the largest mean moment arm, both sides together.

    Parameters
    ----------
    model : with the muscles
    windows : recordings
    rows : names of the coordinates that are compared

    Returns
    -------
    names, as "knee_angle +", and (muscles,) the group of each muscle
    """
    mean = np.mean(np.concatenate([window.arms[window.counted] for window in windows]), axis=0)
    labels = []
    for m, name in enumerate(model.muscle_names):
        row = int(np.argmax(np.abs(mean[:, m])))
        if not abs(mean[row, m]) > 0.0:
            labels.append(split_side(name)[0])
            continue
        labels.append(f"{split_side(rows[row])[0]} {'+' if mean[row, m] > 0.0 else '-'}")
    names = tuple(dict.fromkeys(labels))
    return names, np.array([names.index(label) for label in labels], np.int64)


def _shared_emg(
    names: Sequence[str], windows: Sequence[Windows]
) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Let muscles whose EMG is the same all along share a gain.

    Recordings at rest know none.

    Returns
    -------
    names of the muscles that share each gain, and (muscles,) its number, -1 without EMG
    """
    count = len(names)
    gain = np.full(len(names), -1, np.int64)
    targets = [window.emg.reshape(-1, count) for window in windows if np.isfinite(window.step)]
    columns = enumerate(np.concatenate([np.zeros((0, count)), *targets]).T)
    known = (
        (np.nan_to_num(column, nan=-1.0).tobytes(), m)
        for m, column in columns
        if np.isfinite(column).any()
    )
    members = list(grouped(known).values())
    for number, muscles in enumerate(members):
        gain[muscles] = number
    return tuple(" ".join(names[m] for m in muscles) for muscles in members), gain


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
