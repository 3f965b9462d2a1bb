"""Gains, delays and shape of EMG channels from joint torques, over all trials of a subject."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.body.tension.emg_groups import synergy_groups
from myomorph.body.tension.emg_held_out import (
    HELD_FRAMES,
    HELD_WITH_CONTACTS,
    EmgTrial,
    HeldOut,
    swap_lines,
)
from myomorph.body.tension.emg_profile import Profile
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.model import Actuator, Model
from myomorph.core.model.series import Emg
from myomorph.core.motion.emg_activation import USUAL, ChannelMap, EmgCalibration, uncalibrated
from myomorph.core.motion.emg_checks import envelope_faults, refuse_unfit, without_faults
from myomorph.core.motion.filters import lowpass
from myomorph.core.tension.emg_gains import gain_prior
from myomorph.core.tension.emg_targets import EmgOptions, mapped_muscles
from myomorph.core.tension.emg_tracking import TorqueTracking, tracked_frames
from myomorph.core.tension.problem import TensionInputs
from myomorph.core.tension.tension import TensionOptions

# About how many frames of all trials together the gains are fitted on, evenly spread
MAX_FRAMES = 300
SMOOTH = 8.0
"""Low-pass of envelopes while gains are fitted [Hz]: noise makes gains smaller, and muscles follow
no faster.
"""
ROUGHNESS = 0.03  # Share of an envelope that may be faster than that
# Percentile of the envelopes over all trials that counts as a channel's largest: a spike is none
PEAK = 99.0


class Envelopes(NamedTuple):
    """Envelopes of the channels in all trials.

    Attributes
    ----------
    measured : of each trial, without what is faulty
    smooth : the same without what is too fast for a muscle
    """

    measured: list[Emg]
    smooth: list[Emg]

    @property
    def peaks(self) -> Array:
        """(channels,) largest envelope over all trials, 0 where a channel has none."""
        values = [emg.values for emg in self.smooth]
        silence = np.zeros((1, values[0].shape[1]))
        heights = [np.vstack([part, silence]) for part in values]
        return np.asarray(np.nanpercentile(np.vstack(heights), PEAK, axis=0))


def calibrate_emg(  # page: the tension problem and the maxima are optional
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
    calibration of all channels, with intervals of the gains, the estimate and warnings

    Raises
    ------
    BadData : there is no trial, or EMG does not fit a motion
    UnknownName : a channel with a maximum is not calibrated
    """
    options = options or EmgOptions()
    maxima = maxima or {}
    _check(model, trials, channels, maxima)
    names = tuple(channels)
    if options.gains == "normalized":
        delay = USUAL if options.delay is None else options.delay
        return uncalibrated(names, delay, options.shape or 0.0)

    # Frames are looked at one by one here, whatever the tensions are then found with.
    tension = None if tension is None else replace(tension, tendons="rigid", recruitment="power")
    envelopes = _envelopes(trials, names)
    peaks = envelopes.peaks
    bounds = np.array([maxima.get(name, np.nan) for name in names])
    count = sum(len(trial.motion) for trial in trials)
    every = max(count // MAX_FRAMES, 1)
    # The matrices are small: waking further threads of BLAS for them costs more than they save.
    with threadpool_limits(limits=1, user_api="blas"):
        inputs = [_inputs(model, trial, tension, actuators) for trial in trials]
        tracking = _tracking(inputs, channels, envelopes, bounds, every, options.offsets)
        level = gain_prior(peaks, bounds, 0.0)
        profile = Profile(tracking=tracking, names=names, options=options, level=level)
        result = profile.calibration(model.muscle_names)
    estimated = any(trial.contacts is not None for trial in trials)
    held_frames = HELD_WITH_CONTACTS if estimated else HELD_FRAMES
    step = every * max(count // every // held_frames, 1)
    held = HeldOut(
        model=model,
        channels=channels,
        options=options,
        settings=(tension, actuators),
        tracking=tracking,
        calibration=result,
        peaks=peaks,
        maxima=bounds,
        few=[trial.thinned(step) for trial in trials],
    )
    result = replace(result, warnings=(*swap_lines(names, held.swapped()), *result.warnings))
    return result if options.mode == "driven" or options.weight is not None else held.chosen(result)


def _check(
    model: Model, trials: Sequence[EmgTrial], channels: ChannelMap, maxima: Mapping[str, float]
) -> None:
    """Refuse what cannot be calibrated; errors are those of `calibrate_emg`."""
    if not trials:
        raise BadData("EMG is calibrated on trials: give one or more")
    for trial in trials:
        mapped_muscles(trial.emg, channels, model)
        refuse_unfit(trial.emg, trial.motion.time, channels)
    for name in maxima:
        check_name("EMG channel", name, tuple(channels), "the calibration")


def _envelopes(trials: Sequence[EmgTrial], names: tuple[str, ...]) -> Envelopes:
    """Take the channels of all trials without their faults.

    Parameters
    ----------
    trials : of one subject
    names : of the channels that are calibrated
    """
    measured = []
    for trial in trials:
        cleaned = without_faults(trial.emg, envelope_faults(trial.emg))
        values = np.array([cleaned[name] for name in names]).T
        measured.append(Emg(cleaned.time, names, values))
    return Envelopes(measured=measured, smooth=[_smooth(emg) for emg in measured])


def _inputs(
    model: Model,
    trial: EmgTrial,
    tension: TensionOptions | None,
    actuators: Sequence[Actuator] | None,
) -> TensionInputs:
    """State the tension problem of a trial, without EMG."""
    return TensionInputs(
        model=model,
        motion=trial.motion,
        torques=trial.torques,
        options=tension or TensionOptions(),
        actuators=actuators,
        contacts=trial.contacts,
    )


def _tracking(
    inputs: Sequence[TensionInputs],
    channels: ChannelMap,
    envelopes: Envelopes,
    maxima: Array,
    every: int,
    offsets: bool,
) -> TorqueTracking:
    """Set up the regression of the torques of all trials on their envelopes.

    Parameters
    ----------
    inputs : of the tension problem of each trial
    channels : channel to muscles of the model
    envelopes : of all trials
    maxima : (channels,) envelope in a maximum voluntary contraction, NaN where there is none
    every : distance of the frames that are read
    offsets : whether channels may have an activation at rest
    """
    names = tuple(channels)
    muscles = inputs[0].model.muscle_names
    tells = np.array(
        [[muscle in channels[name] for name in names] for muscle in muscles], dtype=float
    )
    frames = [
        tracked_frames(trial, emg, tells, every)
        for trial, emg in zip(inputs, envelopes.smooth, strict=True)
    ]
    peaks = envelopes.peaks
    return TorqueTracking(
        frames=frames,
        tells=tells,
        groups=synergy_groups(frames, names, tells, peaks),
        prior=gain_prior(peaks, maxima),
        offsets=offsets,
        noise=_noise(envelopes.measured, envelopes.smooth),
    )


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
