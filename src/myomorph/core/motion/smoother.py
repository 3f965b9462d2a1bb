"""A motion with its derivatives, smoothed by the noise that the recording shows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.fit.noise import RecordingNoise
from myomorph.core.fit.signal_and_noise import SignalAndNoise
from myomorph.core.model.arguments import check_argument
from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.motion_errors import MotionErrors
from myomorph.core.model.movement import Movement
from myomorph.core.model.series import Markers, Motion, Wrenches
from myomorph.core.motion.cutoff_choice import CutoffChoice, choose_cutoff, is_even
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.kalman import smoothed_states
from myomorph.core.motion.noise_evidence import NoiseEvidence

MIN_FRAMES = 6  # That a motion with derivatives is made of
END = 1.5  # Standard deviation of an acceleration over that inside, from which a frame is an end
LONGEST = 0.5  # Gap that is bridged, in periods of the cutoff
MAX_DECAY = 0.2  # Larger ones change what the filter passes below its cutoff
LEAST = 1e-300


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class SmoothedMotion:
    """A motion with derivatives and what is known of their errors.

    Attributes
    ----------
    motion : with velocities and accelerations; NaN in gaps too long to bridge
    cutoff : of the filter [Hz], None for none
    value_sd, velocity_sd, acceleration_sd : (frames, coordinates) standard deviations, NaN where
        they are not known [rad or m, per s, per s^2]
    bridged : (frames,) gaps that were bridged
    blank : (frames,) gaps too long to bridge
    uncertain : (frames,) ends, and what stands beside a long gap: accelerations are worse there
    """

    motion: Motion
    cutoff: float | None
    value_sd: Array
    velocity_sd: Array
    acceleration_sd: Array
    bridged: np.ndarray
    blank: np.ndarray
    uncertain: np.ndarray

    @property
    def errors(self) -> MotionErrors | None:
        """Standard deviations and marks, None where errors are not known."""
        if not np.isfinite(self.acceleration_sd).any():
            return None
        return MotionErrors(
            time=self.motion.time,
            names=self.motion.names,
            value_sd=self.value_sd,
            velocity_sd=self.velocity_sd,
            acceleration_sd=self.acceleration_sd,
            uncertain=self.uncertain,
        )

    def noise(self, recorded: Motion) -> RecordingNoise | None:
        """Describe what the filter leaves of the noise, None where that is not known.

        Parameters
        ----------
        recorded : that was smoothed, (frames, coordinates), NaN in gaps

        Returns
        -------
        noise of coordinates as smoothed; a low-pass has two samples a period of its cutoff
        """
        if self.cutoff is None or not np.isfinite(self.value_sd).any():
            return None
        count = len(recorded.names)
        return RecordingNoise(
            names=recorded.names,
            unit="rad or m",
            sd=np.nanmedian(self.value_sd, axis=0),
            correlation_time=np.full(count, 0.5 / self.cutoff),
            floor=np.full(count, np.nan),
            gaps=1.0 - np.isfinite(recorded.values).mean(axis=0),
        )

    def filled(self, recorded: Motion) -> Motion:
        """Coordinates as recorded, and as smoothed in gaps that were bridged.

        Parameters
        ----------
        recorded : that was smoothed, (frames, coordinates), NaN in gaps

        Returns
        -------
        without derivatives, NaN in gaps too long to bridge
        """
        missing = self.bridged[:, None] & ~np.isfinite(recorded.values)
        values = np.where(missing, self.motion.values, recorded.values)
        return replace(recorded, values=values, velocities=None, accelerations=None)


def smooth_motion(
    motion: Motion,
    model: Model | None = None,
    movement: Movement | None = None,
    *,
    markers: Markers | None = None,
    wrenches: Wrenches | None = None,
) -> SmoothedMotion:
    """Smooth a motion and differentiate it twice, by the noise that the recording shows.

    Parameters
    ----------
    motion : coordinates as recorded (frames, coordinates) [rad or m], NaN in gaps
    model : whose torques are to be right; without one, the accelerations of all coordinates
    movement : that was recorded, None where it is not known
    markers : that inverse kinematics made the motion of; their residuals show its noise
    wrenches : all external forces as measured, which show the noise by Newton's law

    Returns
    -------
    the motion with derivatives, standard deviations and marks

    Raises
    ------
    BadData : fewer than six frames are known

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.read_motion("reach.mot", model)
    >>> smoothed = mm.smooth_motion(motion, model)
    >>> smoothed.motion.accelerations.shape
    (61, 2)
    """
    check_argument("motion", motion, Motion)
    evidence = NoiseEvidence(markers=markers, wrenches=wrenches)
    return smoothed_by(motion, choose_cutoff(motion, model, movement, evidence))


def smoothed_by(
    motion: Motion, choice: CutoffChoice, cutoff: float | None = None
) -> SmoothedMotion:
    """Smooth a motion by a choice that was made of it.

    Parameters
    ----------
    motion : as recorded
    choice : of `choose_cutoff`
    cutoff : in the place of the chosen one [Hz]

    Returns
    -------
    as of `smooth_motion`

    Raises
    ------
    BadData : fewer than six frames are known
    """
    cutoff = cutoff or choice.cutoff
    seen = np.all(np.isfinite(motion.values), axis=1)
    if cutoff is None or not is_even(motion.time):
        return differentiated_at(motion, cutoff)
    if seen.sum() < MIN_FRAMES:
        raise BadData(
            f"derivatives need {MIN_FRAMES} frames without gaps: the motion has {int(seen.sum())}"
            " in all"
        )
    pulse = 2.0 * np.pi * cutoff
    rate = (len(motion) - 1) / float(motion.time[-1] - motion.time[0])
    errors = _Errors.of(choice.spectra, len(motion.names), cutoff, rate)
    states = smoothed_states(motion.values, pulse / rate, errors.decay)

    ratio = np.sqrt(states.variance / np.median(states.variance, axis=0))
    sd = ratio * errors.sd.T
    marks = _marks(seen, 0.5 * rate / cutoff, np.median(ratio[:, :, 2], axis=1) > END)
    scaled = states.mean * pulse ** np.arange(3.0)
    scaled[marks.blank] = np.nan
    smoothed = replace(
        motion,
        values=np.ascontiguousarray(scaled[:, :, 0]),
        velocities=np.ascontiguousarray(scaled[:, :, 1]),
        accelerations=np.ascontiguousarray(scaled[:, :, 2]),
    )
    return SmoothedMotion(
        motion=smoothed,
        cutoff=cutoff,
        value_sd=sd[:, :, 0],
        velocity_sd=sd[:, :, 1],
        acceleration_sd=sd[:, :, 2],
        bridged=marks.bridged,
        blank=marks.blank,
        uncertain=marks.uncertain,
    )


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class _Errors:
    """How coordinates err after the filter, inside a recording.

    Attributes
    ----------
    decay : (coordinates,) all alike, with which accelerations are drawn to nothing, over
        2 pi cutoff [-]
    sd : (3, coordinates) standard deviations of values, velocities, accelerations
    """

    decay: Array
    sd: Array

    @staticmethod
    def of(spectra: SignalAndNoise | None, count: int, cutoff: float, rate: float) -> _Errors:
        """Derive both from the spectra of motion and noise; no decay and NaN where there are none.

        White jerk of the density w, and a decay d, give accelerations of the variance w / (2 d).
        With the density n of the noise at the cutoff (one-sided, so half of it), w is
        n (2 pi fc)^6 / 2. One decay for all, the median, so that all coordinates lose the same.
        """
        if spectra is None:
            return _Errors(decay=np.zeros(count), sd=np.full((3, count), np.nan))
        pulse = 2.0 * np.pi * cutoff
        above = int(np.searchsorted(spectra.frequency, cutoff).clip(1, len(spectra.frequency) - 1))
        low = spectra.frequency[above - 1]
        share = float((cutoff - low) / (spectra.frequency[above] - low))
        density = (1.0 - share) * spectra.noise[above - 1] + share * spectra.noise[above]
        accelerations = ((2.0 * np.pi * spectra.frequency) ** 4 * spectra.width) @ spectra.motion
        decays = 0.25 * density * pulse**5 / np.maximum(accelerations, LEAST)
        decay = np.full(count, min(float(np.median(decays[spectra.moves])), MAX_DECAY))
        squares = [spectra.expected_error(np.array([cutoff]), order)[0] for order in range(3)]
        return _Errors(decay=decay, sd=np.sqrt(np.array(squares)))


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class _Marks:
    """Frames (frames,) as `SmoothedMotion` has them."""

    bridged: np.ndarray
    blank: np.ndarray
    uncertain: np.ndarray


def _marks(seen: np.ndarray, longest: float, worse: np.ndarray) -> _Marks:
    """Mark gaps and what stands beside them.

    Parameters
    ----------
    seen : (frames,) that were recorded
    longest : gap that is bridged [frames]
    worse : (frames,) whose accelerations are less sure than inside
    """
    blank = np.zeros(len(seen), bool)
    beside = np.zeros(len(seen), bool)
    for start, stop in runs(~seen):
        if stop - start > longest or start == 0 or stop == len(seen):
            blank[start:stop] = True
            beside[max(0, start - int(longest)) : stop + int(longest)] = True
    return _Marks(bridged=~seen & ~blank, blank=blank, uncertain=(beside | worse) & ~blank)


def differentiated_at(motion: Motion, cutoff: float | None) -> SmoothedMotion:
    """Differentiate a smooth motion, or one at uneven times, by splines; errors are not known.

    Parameters
    ----------
    motion : as recorded
    cutoff : of OpenSim's filter [Hz]; None for none

    Returns
    -------
    as of `smooth_motion`, without standard deviations; no gap is bridged

    Raises
    ------
    BadData : fewer than six frames in a row are known
    """
    whole = differentiate(motion, cutoff)
    unknown = np.full(motion.values.shape, np.nan)
    blank = np.asarray(~np.all(np.isfinite(whole.values), axis=1))
    reach = 0 if cutoff is None else int(LONGEST * motion.rate / cutoff)
    beside = np.convolve(np.pad(blank, 1, constant_values=True), np.ones(2 * reach + 1), "same")
    return SmoothedMotion(
        motion=whole,
        cutoff=cutoff,
        value_sd=unknown,
        velocity_sd=unknown,
        acceleration_sd=unknown,
        bridged=np.zeros(len(motion), bool),
        blank=blank,
        uncertain=(beside[1:-1] > 0.0) & ~blank,
    )
