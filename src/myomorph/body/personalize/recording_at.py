"""One recording at some parameters: fibers followed, activations marginalized, misfits whitened."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from myomorph.body.personalize.activations import (
    Marginal,
    TorqueMisfit,
    frame_products,
    known_activations,
    marginalized,
)
from myomorph.body.personalize.fiber_kernel import Paths
from myomorph.body.personalize.fibers import follow
from myomorph.body.personalize.muscle_curves import MuscleShapes
from myomorph.body.personalize.parameter_slopes import (
    MORE,
    MusclesAt,
    torque_slopes,
    widening_slopes,
)
from myomorph.body.personalize.prior import Prior
from myomorph.body.personalize.recorded import Recorded
from myomorph.core.fit.correlation import correlation_times
from myomorph.core.fit.residuals import NormalEquations
from myomorph.core.model.arrays import Array, read_only

MIN_ERROR = 10.0  # Frames over which errors of a movement are alike at least
MAX_POSES = 50  # Over which errors of poses are taken to be alike at most
MIN_ALIKE = 0.05  # Correlation from which on errors of poses are alike
MAX_CHANGE = 0.2  # Of an activation in a step


@read_only
class Noise:
    """Errors of torques and activations.

    Attributes
    ----------
    torque : (rows,) standard deviation [N m or N]
    rest : (rows,) of measured passive torques: none of the errors of inverse dynamics are theirs [N
        m or N]
    emg : factor on the variance of activations that EMG shows
    """

    torque: Array
    rest: Array
    emg: float = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Muscles:
    """What parameters of muscles act on: the prior that says what they are, and the curves."""

    prior: Prior
    shapes: MuscleShapes


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class RecordingAt:
    """One recording at some parameters and activations.

    Attributes
    ----------
    recorded : the recording
    activations : (windows, frames, muscles) present ones, of all frames
    at : muscles there
    torques : at these activations
    marginal : the misfit with activations marginalized
    whitening : (frames, rows, rows) L^-1 with S = L L^T
    slopes : (frames, rows, parameters) of the muscles' torques; without parameters where only the
        misfit is needed
    widening : (parameters,) slopes of half the logarithm of det S, summed over frames
    weight : what a frame counts
    """

    recorded: Recorded
    activations: Array
    at: MusclesAt
    torques: TorqueMisfit
    marginal: Marginal
    whitening: Array
    slopes: Array
    widening: Array
    weight: float = 1.0

    @cached_property
    def white(self) -> Array:
        """(frames, rows) misfit L^-1 r."""
        return frame_products(self.whitening, self.marginal.error)

    @property
    def cost(self) -> float:
        """Sum of squares of the whitened misfit, by what a frame counts."""
        return float(self.weight * np.sum(self.white**2))

    @property
    def count(self) -> int:
        """Of measured torques."""
        return int(self.recorded.known.sum())

    @cached_property
    def equations(self) -> NormalEquations:
        """Normal equations of all parameters, with the slope of the logarithm of det S."""
        jacobian = (self.whitening @ self.slopes).reshape(-1, self.slopes.shape[-1])
        missed = jacobian.T @ self.white.ravel()
        return NormalEquations(
            H=self.weight * jacobian.T @ jacobian, g=-self.weight * (missed - self.widening)
        )

    def settled(self, step: Array) -> Array:
        """Move activations to their mean given the recording, after a step of the parameters.

        Parameters
        ----------
        step : (parameters,); empty where slopes were not computed

        Returns
        -------
        (windows, frames, muscles) within 0 and 1
        """
        counted = self.recorded.windows.counted
        error = self.marginal.error - self.slopes @ step
        wanted = np.clip(self.marginal.mean_activations(error), 0.0, 1.0)
        moved = self.activations.copy()
        now = moved[counted]
        change = np.clip(wanted - now, -MAX_CHANGE, MAX_CHANGE)
        moved[counted] = np.clip(now + change, 0.0, 1.0)
        return moved

    def score(self) -> float:
        """Sum half the whitened misfit and the logarithm of the spread over frames."""
        _, logarithm = np.linalg.slogdet(self.marginal.covariance)
        return float(0.5 * np.sum(self.white.ravel() ** 2) + 0.5 * np.sum(logarithm))

    def error_length(self) -> float:
        """Measure over how many frames whitened misfits are alike, in all rows together."""
        counted = self.recorded.windows.counted
        frames = np.full((*counted.shape, self.white.shape[1]), np.nan)
        frames[counted] = np.where(self.recorded.known, self.white, np.nan)
        if self.recorded.at_rest:
            return _pose_length(frames[0])
        return max(float(correlation_times(list(frames), together=True)[0]), MIN_ERROR)


def _pose_length(misfits: Array) -> float:
    """Measure over how many successive poses misfits are alike: 1 + 2 sum rho_k.

    Poses may be in any order, and they are few. Of 40 in random order the positive pairs of
    `correlation_times` came to 2.7, which is noise: the sum ends where errors are hardly alike.

    Parameters
    ----------
    misfits : (poses, rows) NaN where no torque was measured
    """
    square = max(float(np.nanmean(misfits**2)), 1e-12)
    length = 1.0
    for lag in range(1, min(MAX_POSES, len(misfits) // 2)):
        pairs = misfits[:-lag] * misfits[lag:]
        known = np.isfinite(pairs)
        rho = float(pairs[known].sum()) / max(int(known.sum()), 1) / square
        if rho < MIN_ALIKE:
            break
        length += 2.0 * rho
    return length


def recording_at(
    muscles: Muscles, recorded: Recorded, p: Array, activations: Array, noise: Noise
) -> RecordingAt:
    """Follow the fibers, and whiten the misfit, without slopes.

    Parameters
    ----------
    muscles : whose parameters p are
    recorded : the recording
    p : (parameters,)
    activations : (windows, frames, muscles) present ones
    noise : errors of torques and EMG

    Returns
    -------
    the recording at these parameters
    """
    sizes = muscles.prior.sizes(p)
    followed = follow(muscles.shapes, sizes, _paths(recorded, activations))
    now = followed.frames(recorded.windows.counted)
    errors = noise.rest if recorded.at_rest else noise.torque
    torques = TorqueMisfit(
        left=recorded.torques - frame_products(recorded.arms, now.force),
        columns=recorded.arms * now.by_activation[:, None],
        variance=np.where(recorded.known, errors**2, 1.0),
    )
    known = known_activations(recorded, muscles.prior, p, noise.emg)
    marginal = marginalized(torques, recorded.counted(activations), known)
    whitening = np.linalg.inv(np.linalg.cholesky(marginal.covariance))
    return RecordingAt(
        recorded=recorded,
        activations=activations,
        at=MusclesAt(
            p=p,
            sizes=sizes,
            followed=now,
            expected=known.mean,
            present=recorded.counted(activations),
            growth=known.growth,
        ),
        torques=torques,
        marginal=marginal,
        whitening=np.asarray(whitening, dtype=np.float64),
        slopes=np.zeros((*recorded.torques.shape, 0)),
        widening=np.zeros(0),
    )


def with_slopes(
    muscles: Muscles, part: RecordingAt, weight: float, widening: Array | None = None
) -> RecordingAt:
    """Add the slopes in the parameters to a recording.

    Parameters
    ----------
    muscles : whose parameters they are
    part : the recording at some parameters
    weight : what a frame counts
    widening : (parameters,) slopes of half the logarithm of det S from an earlier step, as they
        change little from step to step; None to compute them

    Returns
    -------
    the recording with slopes
    """
    recorded = part.recorded
    prior = muscles.prior
    if widening is None:
        paths = _paths(recorded, part.activations + MORE)
        more = follow(muscles.shapes, part.at.sizes, paths).frames(recorded.windows.counted)
        widening = widening_slopes(recorded, prior, part.at, more, part.marginal.gain)
    slopes = torque_slopes(recorded, prior, part.at, part.torques)
    return replace(part, slopes=slopes, widening=widening, weight=weight)


def _paths(recorded: Recorded, activations: Array) -> Paths:
    """Give paths of a recording activations (windows, frames, muscles)."""
    windows = recorded.windows
    return Paths(
        lengths=windows.lengths,
        speeds=windows.speeds,
        activations=activations,
        step=windows.step,
    )
