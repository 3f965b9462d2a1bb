"""Delay and gains of EMG channels, found from trials whose torques are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.model.errors import BadData
from myomorph.model.model import Actuator, Model
from myomorph.model.series import Emg, Motion, Series
from myomorph.model.spatial import Array
from myomorph.motion.emg_checks import envelope_faults, refuse_unfit, without_faults
from myomorph.motion.emg_delay import Delays, find_delays, shifted
from myomorph.motion.emg_gain import ChannelMap, EmgCalibration, channel_means, fit_gains
from myomorph.tension.contacts import ContactTask
from myomorph.tension.emg_targets import EmgOptions, mapped_muscles
from myomorph.tension.solve import TensionOptions, solve_tension


@dataclass(frozen=True, eq=False)
class EmgTrial:
    """What calibration takes of one trial: a motion with velocities, its torques, and envelopes on their clock.

    Where forces of contacts are unknown, `torques` are those without them, and `contacts` tells where they act.
    """

    motion: Motion
    torques: Series
    emg: Emg
    contacts: ContactTask | None = None


def calibrate_emg(
    model: Model,
    trials: Sequence[EmgTrial],
    channels: ChannelMap,
    options: EmgOptions | None = None,
    tension: TensionOptions | None = None,
    actuators: Sequence[Actuator] | None = None,
) -> EmgCalibration:
    """Delay and gain of each channel at which EMG and least effort agree best over the trials.

    Parameters
    ----------
    channels : channel to muscles of the model
    tension, actuators : as for `solve_tension`

    Raises
    ------
    UnknownName
        where a channel or a muscle does not exist
    BadData
        without a trial, or where EMG and motion of one have too little time in common
    """
    options = options or EmgOptions()
    if not trials:
        raise BadData("EMG is calibrated on trials: none was given")
    for trial in trials:
        mapped_muscles(trial.emg, channels, model)
        refuse_unfit(trial.emg, trial.motion.time, channels)
    names = tuple(channels)
    cleaned = [without_faults(trial.emg, envelope_faults(trial.emg)) for trial in trials]
    told = [Emg(emg.time, names, np.array([emg[one] for one in names]).T) for emg in cleaned]
    predicted = []
    for trial in trials:
        alone = solve_tension(model, trial.motion, trial.torques, tension, actuators, contacts=trial.contacts)
        means = channel_means(channels, alone.muscles, alone.activations)
        predicted.append(Series(trial.motion.time, names, means))
    delays, warnings = _delays(list(zip(told, predicted, strict=True)), options)
    moved = np.vstack([shifted(emg, one.time, delays) for emg, one in zip(told, predicted, strict=True)])
    gains, offsets = np.ones(len(names)), np.zeros(len(names))
    if options.gains == "fitted":
        gains, offsets = fit_gains(moved, np.vstack([one.values for one in predicted]), options.offsets)
    return EmgCalibration(names, delays, gains, offsets, warnings)


def _delays(recordings: Sequence[tuple[Emg, Series]], options: EmgOptions) -> tuple[Array, tuple[str, ...]]:
    """Delay of each channel [s], and what is unsure of it."""
    names = recordings[0][1].names
    if options.delay is not None:
        return np.full(len(names), options.delay), ()
    found = find_delays(recordings, options.search)
    return found.seconds.copy(), tuple(_doubts(found, options))


def _doubts(found: Delays, options: EmgOptions) -> list[str]:
    lines = []
    for c, name in enumerate(found.channels):
        if found.found[c]:
            continue
        who = "all EMG channels" if options.search.by == "subject" else f"EMG channel '{name}'"
        why = f"no delay of {who} was found from {options.search.least:g} to {options.search.most:g} s"
        lines.append(f"{why}: {found.seconds[c]:g} s taken, at a correlation of {found.correlation[c]:.2f}")
        if options.search.by == "subject":
            break
    return lines
