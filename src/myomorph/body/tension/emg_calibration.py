"""Gains, delays and shape of EMG channels from joint torques, over all trials of a subject."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.body.tension.emg_groups import (
    calibration_of,
    kept_level,
    settled_fit,
    some_names,
    synergy_groups,
)
from myomorph.body.tension.emg_held_out import HELD_FRAMES, EmgTrial, HeldOut, swap_lines
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.model import Actuator, Model
from myomorph.core.model.series import Emg
from myomorph.core.motion.emg_activation import (
    LIKELIHOOD_95,
    USUAL,
    ChannelMap,
    EmgCalibration,
    uncalibrated,
)
from myomorph.core.motion.emg_checks import envelope_faults, refuse_unfit, without_faults
from myomorph.core.motion.filters import lowpass
from myomorph.core.tension.emg_targets import EmgOptions, mapped_muscles
from myomorph.core.tension.emg_tracking import (
    Prior,
    TorqueTracking,
    few_frames,
    gain_prior,
    tracked_frames,
)
from myomorph.core.tension.problem import TensionInputs
from myomorph.core.tension.tension import TensionOptions

# About how many frames of all trials together the gains are fitted on, evenly spread
MAX_FRAMES = 300
SHAPES = (-0.5, -1.0, -1.5, -2.0, -2.5, -3.0)
"""Shape factors that are tried beside a straight line; -3 is the limit of Lloyd and Besier (2003).
"""
# Standard deviation of delays about the usual one, before any torque is seen [s]
DELAY_SPREAD = 0.03
LONGEST = 0.150
COARSE = 0.01
FINE = 0.002  # Of the delays that are tried, and between them first and last [s]
ROUNDS = 4  # Searches of delay and shape in turn, at most


def calibrate_emg(
    model: Model,
    trials: Sequence[EmgTrial],
    channels: ChannelMap,
    options: EmgOptions | None = None,
    tension: TensionOptions | None = None,
    actuators: Sequence[Actuator] | None = None,
    maxima: Mapping[str, float] | None = None,
) -> EmgCalibration:
    """Find delay, gain and shape with which muscles under EMG bear the torques of all trials.

    Effort has no part in it: co-contraction costs nothing. Where torques say nothing of a gain it
    is the usual one, and a warning names the channel. See `myomorph.core.tension.emg_tracking` and
    docs/emg-and-sound.md.

    Source: Lloyd and Besier 2003; Pizzolato et al. 2015; Ao et al. 2020 for unmeasured muscles.

    Parameters
    ----------
    model : of the body
    trials : motions, torques and envelopes
    channels : channel to muscles of the model
    options : of EMG
    tension, actuators : as for `solve_tension`
    maxima : envelope of channels in a maximum voluntary contraction, which no activation above 1
        may have made

    Returns
    -------
    calibration of all channels, with intervals of the gains and warnings

    Raises
    ------
    BadData : there is no trial, or EMG does not fit a motion
    UnknownName : a channel with a maximum is not calibrated
    """
    options = options or EmgOptions()
    if not trials:
        raise BadData("EMG is calibrated on trials: none was given")
    for trial in trials:
        mapped_muscles(trial.emg, channels, model)
        refuse_unfit(trial.emg, trial.motion.time, channels)
    # Frames are looked at one by one here, whatever the tensions are then found with.
    tension = None if tension is None else replace(tension, tendons="rigid", recruitment="power")
    names = tuple(channels)
    for name in maxima or {}:
        check_name("EMG channel", name, names, "the calibration")
    if options.gains == "normalized":
        return uncalibrated(
            names, USUAL if options.delay is None else options.delay, options.shape or 0.0
        )
    cleaned = [without_faults(trial.emg, envelope_faults(trial.emg)) for trial in trials]
    cleaned = [Emg(emg.time, names, np.array([emg[name] for name in names]).T) for emg in cleaned]
    envelopes = [_smooth(emg) for emg in cleaned]
    every = max(sum(len(trial.motion) for trial in trials) // MAX_FRAMES, 1)
    tells = np.array(
        [[muscle in channels[name] for name in names] for muscle in model.muscle_names], dtype=float
    )
    # The matrices are small: waking further threads of BLAS for them costs more than they save.
    with threadpool_limits(limits=1, user_api="blas"):
        setting = (tension or TensionOptions(), actuators)
        frames = [
            tracked_frames(
                TensionInputs(model, one.motion, one.torques, *setting, one.contacts),
                emg,
                tells,
                every,
            )
            for one, emg in zip(trials, envelopes, strict=True)
        ]
        heights = [np.vstack([emg.values, np.zeros((1, len(names)))]) for emg in envelopes]
        peaks = np.nanpercentile(np.vstack(heights), PEAK, axis=0)
        bounds = np.array([(maxima or {}).get(name, np.nan) for name in names])
        groups = synergy_groups(frames, names, tells, peaks)
        prior = gain_prior(peaks, bounds)
        tracking = TorqueTracking(
            frames=frames,
            tells=tells,
            groups=groups,
            prior=prior,
            offsets=options.offsets,
            noise=_noise(cleaned, envelopes),
        )
        result = _Search(tracking, names, options, gain_prior(peaks, bounds, 0.0)).found(
            model.muscle_names
        )
    if any(trial.contacts is not None for trial in trials):
        # No channel is left out where forces of contacts are unknown: nothing shows that synergies
        # tell of others.
        return result if options.unmeasured_weight else replace(result, synergies=())
    step = every * max(sum(len(trial.motion) for trial in trials) // every // HELD_FRAMES, 1)
    few = [few_frames(trial.motion, trial.torques, step) for trial in trials]
    held = HeldOut(
        model=model,
        channels=channels,
        options=options,
        settings=(tension, actuators),
        tracking=tracking,
        calibration=result,
        peaks=peaks,
        maxima=bounds,
        few=few,
    )
    result = replace(result, warnings=(*swap_lines(names, held.swapped()), *result.warnings))
    return result if options.mode == "driven" or options.weight is not None else held.chosen(result)


SMOOTH = 8.0
"""Low-pass of envelopes while gains are fitted [Hz]: noise makes gains smaller, and muscles follow
no faster.
"""
ROUGHNESS = 0.03  # Share of an envelope that may be faster than that


def _smooth(emg: Emg) -> Emg:
    """Remove from envelopes what is too fast for a muscle, NaN where they were."""
    if len(emg) < 4 or not emg.rate > 2.5 * SMOOTH:
        return emg
    known = np.isfinite(emg.values)
    filled = [
        np.interp(emg.time, emg.time[use], column[use]) if use.any() else np.zeros(len(emg))
        for column, use in zip(emg.values.T, known.T, strict=True)
    ]
    whole = np.array(filled).T
    smooth = np.maximum(lowpass(whole, emg.rate, SMOOTH), 0.0)
    # A filter rounds the corners of clean envelopes: it is for those that need it.
    rough = np.std(whole - smooth, axis=0) > ROUGHNESS * np.sqrt(np.mean(smooth**2, axis=0))
    return Emg(emg.time, emg.names, np.where(known, np.where(rough, smooth, whole), np.nan))


def _noise(envelopes: Sequence[Emg], smooth: Sequence[Emg]) -> Array:
    """Estimate the noise that smoothing leaves, if it is white, from what is too fast.

    Returns
    -------
    (channels,) standard deviation
    """
    squares = np.zeros(len(smooth[0].names))
    counts = np.zeros(len(smooth[0].names))
    for rough, item in zip(envelopes, smooth, strict=True):
        fast = rough.values - item.values
        beyond = 0.5 * rough.rate - SMOOTH
        if beyond <= 0.0:
            continue
        known = np.isfinite(fast)
        squares += (np.where(known, fast, 0.0) ** 2).sum(axis=0) * SMOOTH / beyond
        counts += known.sum(axis=0)
    return np.sqrt(squares / np.maximum(counts, 1.0))


# Percentile of the envelopes over all trials that counts as a channel's largest: a spike is none
PEAK = 99.0


class _Search:
    """Search delay and shape of all channels by the profile of the posterior.

    At each of them the gains are the most probable ones.
    """

    def __init__(
        self, tracking: TorqueTracking, names: tuple[str, ...], options: EmgOptions, level: Prior
    ):
        self.tracking = tracking
        self.names = names
        self.options = options
        self.level = level
        self.prior = tracking.prior
        self.delay = USUAL if options.delay is None else options.delay
        self.shape = options.shape or 0.0
        self.warnings: list[str] = []

    def found(self, muscles: tuple[str, ...]) -> EmgCalibration:
        """Alternate the search with errors of the torques, and build the calibration."""
        tracking = self.tracking
        tracking.learn_errors(*self._each(self.delay, self.shape))
        self.prior = kept_level(tracking, self.level, *self._each(self.delay, self.shape))
        for _ in range(ROUNDS):
            before = np.array([self.delay, self.shape])
            self._step()
            if np.abs(before - [self.delay, self.shape]).max() < COARSE:
                break
            tracking.learn_errors(*self._each(self.delay, self.shape), self.prior)
        each = self._each(self.delay, self.shape)
        result = calibration_of(
            tracking, settled_fit(tracking, self.prior, *each), self.names, muscles, *each
        )
        silent = [name for name, item in zip(self.names, result.by_torque, strict=True) if not item]
        if silent:
            self.warnings.append(
                f"torques say little of the EMG gain of {some_names(silent)}: a usual one is taken"
            )
        return replace(result, warnings=tuple(self.warnings))

    def _each(self, delay: float, shape: float) -> tuple[Array, Array]:
        """Repeat a delay and a shape for all channels.

        Returns
        -------
        (channels,) delays [s], and (channels,) shape factors
        """
        return np.full(len(self.names), delay), np.full(len(self.names), shape)

    def _cost(self, delay: float, shape: float) -> float:
        """Compute minus the logarithm of the posterior of delay [s] and shape."""
        unusual = (delay - USUAL) / DELAY_SPREAD
        return self.tracking.fit(*self._each(delay, shape), self.prior).cost + 0.5 * float(
            unusual**2
        )

    def _step(self) -> None:
        """Move to the most probable delay and shape at the errors of torques known so far.

        The shape is not straight only where torques are more likely so.
        """
        free = self.options.shape is None
        tried = list[tuple[float, float, float]]()
        for shape in (0.0, *SHAPES) if free else (self.shape,):
            delay = self._delay(shape) if self.options.delay is None else self.delay
            tried.append((self._cost(delay, shape), shape, delay))
        best = min(tried, key=lambda candidate: candidate[0])
        if free and best[0] > tried[0][0] - LIKELIHOOD_95:
            best = tried[0]
        _, self.shape, self.delay = best

    def _delay(self, shape: float) -> float:
        """Find the most probable delay [s].

        Warn where torques say nothing of it, or want one beyond the range.
        """
        coarse = np.append(np.arange(0.0, LONGEST, COARSE), LONGEST)
        costs = np.array([self._cost(delay, shape) for delay in coarse])
        best = int(np.argmin(costs))
        low = coarse[max(best - 1, 0)]
        high = coarse[min(best + 1, len(coarse) - 1)]
        fine = np.arange(low, high + 0.5 * FINE, FINE)
        delay = float(fine[int(np.argmin([self._cost(delay, shape) for delay in fine]))])
        likely = costs - 0.5 * ((coarse - USUAL) / DELAY_SPREAD) ** 2
        self.warnings = [text for text in self.warnings if "delay of all EMG channels " not in text]
        if float(np.ptp(likely)) < LIKELIHOOD_95:
            self.warnings.append(
                f"no delay of all EMG channels shows in the torques: {delay:.3f} s taken"
            )
        elif delay >= LONGEST - 0.5 * FINE:
            text = (
                f"the delay of all EMG channels is {delay:g} s or more: EMG and motion may not be"
                " on one clock"
            )
            self.warnings.append(text)
        return delay
