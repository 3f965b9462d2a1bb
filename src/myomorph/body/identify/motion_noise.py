"""What noise of the motion does to identified masses: the regressor is made of coordinates that
were measured too.

Noise of the coordinates, filtered as they are, is added to them once more and the rows are made
again. What that adds to the squares of the rows, on the mean, is what the noise that is there
already added to them, to the first order of its variance. Taken off, it leaves the equations of the
motion without noise on the mean: least squares with a corrected score (Fuller 1987, Measurement
Error Models, 3.1; Nakamura 1990, Biometrika 77:127), the correction found by adding noise as in
SIMEX (Cook and Stefanski 1994, Journal of the American Statistical Association 89:1314). Without it
masses shrink along all that noise hides, and no interval about them holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import scipy

from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.parts import Parts, parts_of
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.motion.filters import differentiate

DRAWS = 12  # Times that noise is added
CUTOFF = 6.0  # Of the filter of motions that came filtered already [Hz]
# Coordinates that move by less are locked or coupled to nothing: they get no noise [rad or m]
STILL = 1e-6


@read_only
class MotionNoise:
    """What noise of the motion adds to squares of rows [A, b] of base parameters."""

    sd: float  # of the noise of a coordinate after filtering [rad or m]
    parts: Parts  # that it was added to
    # (parts, 2, n + 1, n + 1) added on the mean, moments and forces apart [(N m)^2], [N^2]
    squares: Array
    # (draws, 2, n + 1, n + 1) squares of all parts together, with noise added once more
    draws: Array

    @property
    def corrected(self) -> Parts:
        """The parts, whose equations are to be corrected by what noise added."""
        return replace(self.parts, added=self.squares)

    def misfit(self, parameters: Array) -> Array:
        """(2,) root mean square of a moment's and a force's misfit that the noise alone makes [N
        m], [N].
        """
        x = self.parts.unknowns(parameters)
        mean = np.einsum("pkij,i,j->k", self.squares, x, x) / self.parts.frames.sum()
        return np.sqrt(np.maximum(mean, 0.0))

    def scores(self, noise: Array, parameters: Array) -> Array:
        """(draws, 10 bodies) how each draw pulls at parameters (bodies, 10), about the mean, in
        units of noise (2,).
        """
        x = self.parts.unknowns(parameters)
        g = self.parts.groups
        squares = np.einsum("dkij,k->dij", self.draws, np.square(self.parts.weights(noise)))
        pulls = -(squares @ x)[:, :-1]
        if g:
            pulls = pulls[:, g:] - pulls[:, :g] @ self.parts.carried(noise)
        return (pulls - pulls.mean(axis=0)) @ self.parts.base.combination

    def at_most(self, misfit: Array, parameters: Array) -> MotionNoise:
        """The same noise, or less where it alone would make a larger misfit (2,) than there is."""
        noise_alone = self.misfit(parameters)
        share = float(
            np.min(np.where(noise_alone > 0.0, misfit / np.maximum(noise_alone, 1e-300), np.inf))
        )
        if share >= 1.0:
            return self
        whole = np.einsum("pkji,pkjl->kil", self.parts.factors, self.parts.factors)
        # Squares grow with the variance of the noise, what one draw does to them with its standard
        # deviation.
        mean = self.squares.sum(axis=0)
        draws = whole + share**2 * mean + share * (self.draws - whole - mean)
        return MotionNoise(
            sd=share * self.sd, parts=self.parts, squares=share**2 * self.squares, draws=draws
        )


def motion_noise(
    model: Model,
    recordings: Sequence[Recording],
    parts: Parts,
    sd: float,
    cutoff: float | None = None,
    draws: int = DRAWS,
) -> MotionNoise:
    """What noise of the motion adds to the parts made of these recordings.
    `parts`: of `parts_of` from the same model and recordings; `sd`: of the noise of a coordinate
    after filtering [rad or m]; `cutoff`: of its low-pass filter [Hz]; `CUTOFF` where None.
    """
    random = np.random.default_rng(0)
    made = []
    mean = np.zeros_like(parts.factors)
    for _ in range(draws):
        noisy_ones = [
            recording.moved(
                partial(plus, noise=noise_of(recording.motion, sd, cutoff or CUTOFF, random))
            )
            for recording in recordings
        ]
        factors = parts_of(
            model, noisy_ones, parts.base, least=parts.least, tissue=parts.tissue
        ).factors
        squares = np.einsum("pkji,pkjl->pkil", factors, factors)
        mean += squares / draws
        made.append(squares.sum(axis=0))
    before = np.einsum("pkji,pkjl->pkil", parts.factors, parts.factors)
    return MotionNoise(sd=sd, parts=parts, squares=mean - before, draws=np.array(made))


def noise_of(motion: Motion, sd: float, cutoff: float, random: np.random.Generator) -> Motion:
    """Low-passed noise of a given standard deviation for every coordinate of a motion that moves,
    with derivatives.
    """
    rate = 1.0 / float(np.median(np.diff(motion.time)))
    white = random.normal(size=motion.values.shape)
    if 2.0 * cutoff < 0.95 * rate and len(white) > 30:
        white = scipy.signal.sosfiltfilt(
            scipy.signal.butter(2, cutoff, fs=rate, output="sos"), white, axis=0
        )
    seen = np.where(np.isfinite(motion.values), motion.values, np.nanmean(motion.values, axis=0))
    moving = np.ptp(seen, axis=0) > STILL
    # The noise is differentiated by itself: derivatives of the motion stay those of its own filter.
    return differentiate(
        Motion(motion.time, motion.names, white * (sd * moving / white.std(axis=0))), None
    )


def plus(motion: Motion, noise: Motion) -> Motion:
    """A motion with noise."""
    if motion.velocities is None or motion.accelerations is None:
        raise BadData(
            "noise can be added to a motion with derivatives only: differentiate it first"
        )
    return replace(
        motion,
        values=motion.values + noise.values,
        velocities=motion.velocities + np.asarray(noise.velocities, float),
        accelerations=motion.accelerations + np.asarray(noise.accelerations, float),
    )
