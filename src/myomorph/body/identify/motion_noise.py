"""Noise of the motion, and what it does to identified masses.

The regressor is made of coordinates that were measured too.

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
from myomorph.core.fit.noise import RecordingNoise
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.motion.filters import differentiate

DRAWS = 12  # Times that noise is added
CUTOFF = 6.0  # Of the filter of motions that came filtered already [Hz]
MOTION_SD = 0.002
"""Standard deviation of the noise that a filter leaves in a coordinate, where nothing is known of
it: that of markers with 2 mm of noise [rad or m].
"""
# Coordinates that move by less are locked or coupled to nothing: they get no noise [rad or m]
STILL = 1e-6


@read_only
class MotionNoise:
    """Squares that noise of the motion adds to rows [A, b] of base parameters.

    Attributes
    ----------
    share : of the standard deviations of the recordings' noise, at most 1, that is taken
    parts : that it was added to
    squares : (parts, 2, n + 1, n + 1) added on the mean, moments and forces apart [(N m)^2], [N^2]
    draws : (draws, 2, n + 1, n + 1) squares of all parts together, with noise added once more
    """

    share: float
    parts: Parts
    squares: Array
    draws: Array

    @property
    def corrected(self) -> Parts:
        """The parts, whose equations are to be corrected by what noise added."""
        return replace(self.parts, added=self.squares)

    def misfit(self, parameters: Array) -> Array:
        """Compute the misfit that the noise alone makes.

        Parameters
        ----------
        parameters : (bodies, 10)

        Returns
        -------
        (2,) root mean square of a moment's and a force's misfit [N m], [N]
        """
        x = self.parts.unknowns(parameters)
        mean = np.einsum("pkij,i,j->k", self.squares, x, x) / self.parts.frames.sum()
        return np.sqrt(np.maximum(mean, 0.0))

    def pulls(self, noise: Array, parameters: Array) -> Array:
        """Compute how each draw pulls at base parameters, about the mean of the draws.

        Parameters
        ----------
        noise : (2,) of moments and forces [N m], [N]
        parameters : (bodies, 10)

        Returns
        -------
        (draws, n) in units of the noise
        """
        x = self.parts.unknowns(parameters)
        g = self.parts.groups
        squares = np.einsum("dkij,k->dij", self.draws, np.square(self.parts.weights(noise)))
        pulls = -(squares @ x)[:, :-1]
        if g:
            pulls = pulls[:, g:] - pulls[:, :g] @ self.parts.carried(noise)
        return self.parts.weighed(pulls - pulls.mean(axis=0), noise)

    def scores(self, noise: Array, parameters: Array) -> Array:
        """Compute how each draw pulls at the parameters of all links.

        Parameters
        ----------
        noise : (2,) of moments and forces [N m], [N]
        parameters : (bodies, 10)

        Returns
        -------
        (draws, 10 bodies) in units of the noise
        """
        return self.pulls(noise, parameters) @ self.parts.base.combination

    def at_most(self, misfit: Array, parameters: Array) -> MotionNoise:
        """Return the same noise, or less where it alone would make more misfit than there is.

        Parameters
        ----------
        misfit : (2,) of moments and forces [N m], [N]
        parameters : (bodies, 10)

        Returns
        -------
        noise whose standard deviation is scaled by at most 1
        """
        noise_alone = self.misfit(parameters)
        ratios = misfit / np.maximum(noise_alone, 1e-300)
        share = float(np.min(np.where(noise_alone > 0.0, ratios, np.inf)))
        if share >= 1.0:
            return self
        factors = self.parts.factors
        whole = (factors.swapaxes(2, 3) @ factors).sum(axis=0)
        # Squares grow with the variance of the noise, what one draw does to them with its standard
        # deviation.
        mean = self.squares.sum(axis=0)
        draws = whole + share**2 * mean + share * (self.draws - whole - mean)
        return MotionNoise(
            share=share * self.share,
            parts=self.parts,
            squares=share**2 * self.squares,
            draws=draws,
        )


def coordinate_noise(motion: Motion, sd: float, cutoff: float | None = None) -> RecordingNoise:
    """Describe white noise, alike in all coordinates that move, as a low-pass filter leaves it.

    Parameters
    ----------
    motion : whose coordinates err
    sd : standard deviation after the filter [rad or m]
    cutoff : of the filter [Hz]; `CUTOFF` where None

    Returns
    -------
    the noise of a recording; white noise through an ideal low-pass has two samples a period of its
    cutoff

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> from myomorph.body.identify.motion_noise import coordinate_noise
    >>> time = np.arange(0.0, 1.0, 0.01)
    >>> motion = mm.Motion(time, ("knee", "toes"), np.column_stack([time, 0.0 * time]))
    >>> coordinate_noise(motion, 0.002, cutoff=10.0).sd.tolist()
    [0.002, 0.0]
    """
    known: np.ndarray = np.asarray(np.isfinite(motion.values))
    seen = np.where(known, motion.values, np.nanmean(motion.values, axis=0))
    moving = np.ptp(seen, axis=0) > STILL
    return RecordingNoise(
        names=motion.names,
        unit="rad or m",
        sd=sd * moving,
        correlation_time=np.full(len(motion.names), 0.5 / (cutoff or CUTOFF)),
        floor=sd * moving,
        gaps=1.0 - known.mean(axis=0),
    )


def with_noise(recording: Recording, sd: float) -> Recording:
    """Give a recording the noise that its filter leaves in its coordinates, unless it has one.

    Where the recording itself shows more, that is taken: what its spectra show is a bound from
    below, as movement of skin is not in it.

    Parameters
    ----------
    recording : with a motion
    sd : standard deviation after the filter [rad or m]
    """
    if recording.noise is not None:
        return recording
    cutoff = None if recording.finer is None else recording.finer.cutoff
    noise = coordinate_noise(recording.motion, sd, cutoff)
    seen = recording.seen_noise
    if seen is not None and sd > 0.0:
        larger = np.fmax(noise.sd, np.where(noise.sd > 0.0, seen.sd, 0.0))
        noise = replace(noise, sd=larger, floor=larger)
    return replace(recording, noise=noise)


def motion_noise(
    model: Model, recordings: Sequence[Recording], parts: Parts, draws: int = DRAWS
) -> MotionNoise:
    """Compute what noise of the motion adds to the parts made of these recordings.

    Parameters
    ----------
    model : of which the parts were made
    recordings : of which the parts were made, with the noise of their coordinates
    parts : of `parts_of` from the same model and recordings
    draws : times that noise is added

    Returns
    -------
    squares that noise added, always from the same random numbers

    Raises
    ------
    BadData : the noise of a recording is not known
    """
    random = np.random.default_rng(0)
    made = []
    mean = np.zeros_like(parts.factors)
    for _ in range(draws):
        noisy_ones = [once_more(recording, random) for recording in recordings]
        factors = parts_of(
            model, noisy_ones, parts.base, least=parts.least, tissue=parts.tissue
        ).factors
        squares = factors.swapaxes(2, 3) @ factors
        mean += squares / draws
        made.append(squares.sum(axis=0))
    before = parts.factors.swapaxes(2, 3) @ parts.factors
    return MotionNoise(share=1.0, parts=parts, squares=mean - before, draws=np.array(made))


def once_more(recording: Recording, random: np.random.Generator) -> Recording:
    """Add noise of the coordinates to a recording that has such noise already.

    Parameters
    ----------
    recording : with the noise of its coordinates
    random : generator, which advances

    Raises
    ------
    BadData : the noise of the coordinates is not known
    """
    if recording.noise is None:
        raise BadData("the noise of a recording's coordinates is not known: give `noise`")
    cutoff = CUTOFF if recording.finer is None else recording.finer.cutoff
    drawn = noise_of(recording.motion, recording.noise, random, cutoff)
    return recording.moved(partial(plus, noise=drawn))


def noise_of(
    motion: Motion,
    noise: RecordingNoise,
    random: np.random.Generator,
    cutoff: float = CUTOFF,
) -> Motion:
    """Draw noise for every coordinate of a motion, with derivatives.

    Its white part (`floor`) fills the frequencies below that of two samples in a correlation time
    t. The rest, or all where no white part is known, is alike over t:

        e_k = r e_(k-1) + sqrt(1 - r^2) n_k,    r = exp(-2 step / t)

    with white n, through the filter of the recording.

    Parameters
    ----------
    motion : at whose times and for whose coordinates
    noise : of the coordinates, as the filter leaves it
    random : generator, which advances
    cutoff : of the filter [Hz]

    Returns
    -------
    motion of the noise alone

    Raises
    ------
    BadData : the noise is of other coordinates
    """
    if noise.names != motion.names:
        raise BadData(
            f"noise of coordinates {noise.names[:3]}..., but the motion has {motion.names[:3]}..."
        )
    step = float(np.median(np.diff(motion.time)))
    floor = np.where(np.isfinite(noise.floor), noise.floor, 0.0)
    rest = np.sqrt(np.maximum(np.square(noise.sd) - np.square(floor), 0.0))
    drawn = random.normal(size=motion.values.shape)
    for time in np.unique(noise.correlation_time):
        chosen = noise.correlation_time == time
        drawn[:, chosen] = _lowpassed(drawn[:, chosen], step, 0.5 / time)
    values = drawn * (floor / drawn.std(axis=0))
    if rest.any():
        alike = _alike(random.normal(size=values.shape), step, noise.correlation_time)
        alike = _lowpassed(alike, step, cutoff)
        values = values + alike * (rest / alike.std(axis=0))
    # The noise is differentiated by itself: derivatives of the motion stay those of its own filter.
    return differentiate(Motion(motion.time, motion.names, values), None)


def _lowpassed(values: Array, step: float, cutoff: float) -> Array:
    """Pass signals (frames, coordinates) through a low-pass, where they are long enough for it.

    Parameters
    ----------
    step : between frames [s]
    cutoff : [Hz]
    """
    rate = 1.0 / step
    if 2.0 * cutoff >= 0.95 * rate or len(values) <= 30:
        return values
    sections = scipy.signal.butter(2, cutoff, fs=rate, output="sos")
    return np.asarray(scipy.signal.sosfiltfilt(sections, values, axis=0))


def _alike(white: Array, step: float, times: Array) -> Array:
    """Make noise that is alike over some time from white noise of variance 1.

    Parameters
    ----------
    white : (frames, coordinates)
    step : between frames [s]
    times : (coordinates,) over which noise is alike [s]

    Returns
    -------
    (frames, coordinates) of variance 1
    """
    alike = np.array(white)
    for time in np.unique(times):
        share = float(np.exp(-2.0 * step / time))
        new = np.sqrt(1.0 - share**2)
        chosen = times == time
        scaled = new * white[:, chosen]
        scaled[0] /= new
        alike[:, chosen] = scipy.signal.lfilter([1.0], [1.0, -share], scaled, axis=0)
    return alike


def plus(motion: Motion, noise: Motion) -> Motion:
    """Add noise to a motion and its derivatives.

    Parameters
    ----------
    motion : (frames, coordinates), with derivatives
    noise : at the same times and of the same coordinates

    Returns
    -------
    their sum

    Raises
    ------
    BadData : the motion has no derivatives
    """
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
