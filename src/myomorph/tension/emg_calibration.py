"""Gains, delays and shape of EMG channels from joint torques, over all trials of a subject."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, check_name
from myomorph.model.model import Actuator, Model
from myomorph.model.series import Emg, Motion, Series
from myomorph.motion.emg_checks import envelope_faults, refuse_unfit, without_faults
from myomorph.motion.emg_delay import (
    DOUBT,
    USUAL,
    ChannelMap,
    EmgCalibration,
    SynergyWeights,
    shifted,
    uncalibrated,
)
from myomorph.motion.filters import lowpass
from myomorph.motion.synergies import find_synergies
from myomorph.tension.emg_frames import TrackedFrames, few_frames, tracked_frames
from myomorph.tension.emg_targets import EmgOptions, emg_targets, mapped_muscles
from myomorph.tension.emg_tracking import (
    Fit,
    Group,
    TorqueTracking,
    alike,
    gain_prior,
)
from myomorph.tension.solve import solve_tension
from myomorph.tension.tension import TensionOptions
from myomorph.tension.terms.contacts import ContactTask

__all__ = ["EmgOptions", "EmgTrial", "calibrate_emg", "emg_targets", "mapped_muscles"]


MOST_FRAMES = 300
"""About how many frames of all trials together the gains are fitted on, evenly spread."""
SHAPES = (-0.5, -1.0, -1.5, -2.0, -2.5, -3.0)
"""Shape factors that are tried beside a straight line; -3 is the limit of Lloyd and Besier (2003)."""
DELAY_SPREAD = 0.03
"""Standard deviation of delays about the usual one, before any torque is seen [s]."""
COARSE = 0.01
"""Between the delays that are tried first [s]."""
ROUNDS = 4
"""Searches of delay and shape in turn, at most."""
TOLD = 0.5
"""Torques tell a gain where they leave less than this share of the prior's standard deviation of its logarithm."""
CROWDED = 2
"""Synergies need as many channels."""


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
    maxima: Mapping[str, float] | None = None,
) -> EmgCalibration:
    """Delay, gain and shape of each channel with which the muscles under EMG bear the torques of all trials.

    Effort has no part in it: co-contraction costs nothing. Where torques say nothing of a gain it is the usual one,
    and a warning names the channel. See `myomorph.tension.emg_tracking` and docs/emg-and-sound.md.

    Source: Lloyd and Besier 2003; Pizzolato et al. 2015; Ao et al. 2020 for unmeasured muscles.

    Parameters
    ----------
    channels : channel to muscles of the model
    tension, actuators : as for `solve_tension`
    maxima : envelope of channels in a maximum voluntary contraction, which no activation above 1 may have made

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
    # Frames are looked at one by one here, whatever the tensions are then found with.
    tension = None if tension is None else replace(tension, tendons="rigid", recruitment="power")
    names = tuple(channels)
    for name in maxima or {}:
        check_name("EMG channel", name, names, "the calibration")
    if options.gains == "normalized":
        return uncalibrated(names, USUAL if options.delay is None else options.delay, options.shape or 0.0)
    cleaned = [without_faults(trial.emg, envelope_faults(trial.emg)) for trial in trials]
    told = [_smooth(Emg(emg.time, names, np.array([emg[one] for one in names]).T)) for emg in cleaned]
    every = max(sum(len(trial.motion) for trial in trials) // MOST_FRAMES, 1)
    tells = np.array([[muscle in channels[name] for name in names] for muscle in model.muscle_names], dtype=float)
    # The matrices are small: waking further threads of BLAS for them costs more than they save.
    with threadpool_limits(limits=1, user_api="blas"):
        frames = [
            tracked_frames(model, one.motion, one.torques, emg, tells, tension, actuators, one.contacts, every)
            for one, emg in zip(trials, told, strict=True)
        ]
        heights = [np.vstack([emg.values, np.zeros((1, len(names)))]) for emg in told]
        peaks = np.nanpercentile(np.vstack(heights), PEAK, axis=0)
        bounds = np.array([(maxima or {}).get(name, np.nan) for name in names])
        groups = _groups(frames, names, tells, peaks)
        prior = gain_prior(peaks, bounds)
        noise = _noise([Emg(emg.time, names, np.array([emg[one] for one in names]).T) for emg in cleaned], told)
        tracking = TorqueTracking(frames, tells, groups, prior, options.offsets, noise=noise)
        found = _Search(tracking, names, options).found(model.muscle_names)
    if options.mode == "driven" or options.weight is not None or any(one.contacts is not None for one in trials):
        return found
    held = _HeldOut(model, trials, channels, options, tension, actuators, tracking, found, peaks, bounds)
    return held.chosen(every)


SMOOTH = 8.0
"""Low-pass of envelopes while gains are fitted [Hz]: noise makes gains smaller, and muscles follow no faster."""
ROUGHNESS = 0.03
"""Share of an envelope that may be faster than that."""


def _smooth(emg: Emg) -> Emg:
    """Envelopes without what is too fast for a muscle, NaN where they were."""
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
    """(channels,) standard deviation of the noise that smoothing leaves, if it is white: what is too fast tells it."""
    squares, counts = np.zeros(len(smooth[0].names)), np.zeros(len(smooth[0].names))
    for rough, one in zip(envelopes, smooth, strict=True):
        fast = rough.values - one.values
        beyond = 0.5 * rough.rate - SMOOTH
        if beyond <= 0.0:
            continue
        known = np.isfinite(fast)
        squares += np.where(known, fast, 0.0).__pow__(2).sum(axis=0) * SMOOTH / beyond
        counts += known.sum(axis=0)
    found: Array = np.sqrt(squares / np.maximum(counts, 1.0))
    return found


PEAK = 99.0
"""Percentile of the envelopes over all trials that counts as a channel's largest: a spike is none."""


def _groups(frames: Sequence[TrackedFrames], names: tuple[str, ...], tells: Array, peaks: Array) -> tuple[Group, ...]:
    """Channels whose muscles share joints, their synergies, and the unmeasured muscles of these joints."""
    acts = np.asarray(np.array([np.abs(one.columns).max(axis=0) for one in frames]).max(axis=0) > 0.0)
    reach = (acts.astype(float) @ tells) > 0.0
    measured = np.asarray(tells.any(axis=1))
    groups, left = list[Group](), list(np.flatnonzero(reach.any(axis=0)))
    taken = np.zeros(len(measured), dtype=bool)
    while left:
        rows, before = reach[:, left[0]].copy(), -1
        while rows.sum() != before:
            before = int(rows.sum())
            here = [c for c in left if reach[rows, c].any()]
            rows |= reach[:, here].any(axis=1)
        left = [c for c in left if c not in here]
        # Synergies of one channel would be that channel.
        muscles = np.flatnonzero(acts[rows].any(axis=0) & ~measured & ~taken)
        alive = np.array([c for c in here if peaks[c] > 0.0], dtype=np.int64)
        if len(alive) < CROWDED or not len(muscles):
            continue
        taken[muscles] = True
        values = np.vstack([one.emg.values[:, alive] for one in frames])
        if not np.isfinite(values).all(axis=1).any():
            continue
        found = find_synergies(tuple(names[c] for c in alive), values, peaks[alive])
        groups.append(Group(found, alive, muscles, alike(frames, muscles, tells[:, alive])))
    return tuple(groups)


def _unusual(delays: Array | float) -> Array:
    """Squared distances of delays from the usual one, in standard deviations."""
    return ((np.asarray(delays) - USUAL) / DELAY_SPREAD) ** 2


class _Search:
    """Delays and shape by the profile of the posterior: at each of them the most probable gains."""

    def __init__(self, tracking: TorqueTracking, names: tuple[str, ...], options: EmgOptions):
        self.tracking, self.names, self.options = tracking, names, options
        self.delays = np.full(len(names), USUAL if options.delay is None else options.delay)
        self.shapes = np.full(len(names), options.shape or 0.0)
        self.warnings: list[str] = []

    def found(self, muscles: tuple[str, ...]) -> EmgCalibration:
        self.tracking.learn_errors(self.delays, self.shapes)
        for _ in range(ROUNDS):
            before = np.concatenate([self.delays, self.shapes])
            self._step()
            if np.abs(before - np.concatenate([self.delays, self.shapes])).max() < COARSE:
                break
            self.tracking.learn_errors(self.delays, self.shapes)
        fit = self.tracking.fit(self.delays, self.shapes)
        return self._calibration(fit, muscles)

    def _step(self) -> None:
        """The most probable delays, and shape for all channels, at the errors of torques known so far.

        The shape is not straight only where torques are more likely so.
        """
        free = self.options.shape is None
        tried = list[tuple[float, float, Array]]()
        for shape in (0.0, *SHAPES) if free else (float(self.shapes[0]),):
            shapes = np.full(len(self.names), shape)
            delays = self.delays if self.options.delay is not None else self._delays(shapes)
            cost = self.tracking.fit(delays, shapes).cost + 0.5 * float(np.sum(_unusual(np.unique(delays))))
            tried.append((cost, shape, delays))
        best = min(tried, key=lambda one: one[0])
        if free and best[0] > tried[0][0] - DOUBT:
            best = tried[0]
        self.shapes, self.delays = np.full(len(self.names), best[1]), best[2]

    def _delays(self, shapes: Array) -> Array:
        search, count = self.options.search, len(self.names)
        groups = [np.arange(count)] if search.by == "subject" else [np.array([c]) for c in range(count)]
        delays = self.delays.copy()
        for group in groups:

            def cost(delay: float, group: np.ndarray = group) -> float:
                tried = delays.copy()
                tried[group] = delay
                return self.tracking.fit(tried, shapes).cost + 0.5 * float(_unusual(delay))

            coarse = np.append(np.arange(search.least, search.most, COARSE), search.most)
            costs = np.array([cost(one) for one in coarse])
            best = int(np.argmin(costs))
            low, high = coarse[max(best - 1, 0)], coarse[min(best + 1, len(coarse) - 1)]
            fine = np.arange(low, high + 0.5 * search.step, search.step)
            delays[group] = fine[int(np.argmin([cost(one) for one in fine]))]
            self._doubt(group, coarse, costs, float(delays[group[0]]))
        return delays

    def _doubt(self, group: np.ndarray, coarse: Array, costs: Array, delay: float) -> None:
        """Warn where torques say nothing of a delay, or want one beyond the range."""
        search = self.options.search
        who = "all EMG channels" if search.by == "subject" else f"EMG channel '{self.names[group[0]]}'"
        likely = costs - 0.5 * _unusual(coarse)
        self.warnings = [text for text in self.warnings if f"delay of {who} " not in text]
        if float(np.ptp(likely)) < DOUBT:
            self.warnings.append(f"no delay of {who} shows in the torques: {delay:.3f} s taken")
        elif delay >= search.most - 0.5 * search.step:
            self.warnings.append(f"the delay of {who} is {delay:g} s or more: EMG and motion may not be on one clock")

    def _calibration(self, fit: Fit, muscles: tuple[str, ...]) -> EmgCalibration:
        found = calibration_of(self.tracking, fit, self.names, muscles, self.delays, self.shapes)
        silent = [name for name, one in zip(self.names, found.by_torque, strict=True) if not one]
        if silent:
            self.warnings.append(f"torques say little of the EMG gain of {_some(silent)}: a usual one is taken")
        return replace(found, warnings=tuple(self.warnings))


def calibration_of(
    tracking: TorqueTracking, fit: Fit, names: tuple[str, ...], muscles: tuple[str, ...], delays: Array, shapes: Array
) -> EmgCalibration:
    """A fit as a calibration of the channels."""
    prior = np.sqrt(np.diag(np.linalg.inv(tracking.prior.precision)))
    spread = np.exp(np.outer(fit.deviation, (-1.96, 1.96)))
    synergies = tuple(
        SynergyWeights(group.synergies, tuple(muscles[m] for m in group.muscles), weights)
        for group, weights in zip(tracking.groups, fit.weights, strict=True)
    )
    return EmgCalibration(
        names,
        delays,
        fit.gains,
        fit.offsets,
        (),
        shapes,
        fit.gains[:, None] * spread,
        fit.deviation < TOLD * prior,
        synergies,
    )


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (" ..." if len(names) > 6 else "")


WEIGHTS = ((10.0, 1.0), (3.0, 1.0), (1.0, 1.0), (0.3, 1.0), (0.1, 1.0), (0.1, 0.3), (0.1, 0.1))
"""Weights that are tried, the firmest first: of soft targets, and of what synergies say of muscles without EMG."""
ALONE_WEIGHT = 1.0
"""The weight where there is but one channel, so that none can be left out."""
WORSE = 0.05
"""Fall of a held-out channel's correlation that is too much."""
MARGIN = 0.5
"""Share of it that is allowed where a weight is chosen: muscles that no channel tells of may fare worse."""
HELD_FRAMES = 150
"""About how many frames of all trials together channels are left out on."""


class _HeldOut:
    """Channels left out in turn: what the EMG of the others does to the activation of the muscles under them.

    Delay, shape and errors of torques are those of all channels; gains and synergies are found anew.
    """

    def __init__(
        self,
        model: Model,
        trials: Sequence[EmgTrial],
        channels: ChannelMap,
        options: EmgOptions,
        tension: TensionOptions | None,
        actuators: Sequence[Actuator] | None,
        tracking: TorqueTracking,
        found: EmgCalibration,
        peaks: Array,
        maxima: Array,
    ):
        self.model, self.channels, self.options = model, channels, options
        self.told = (tension, actuators)
        self.trials, self.tracking, self.found, self.peaks, self.maxima = trials, tracking, found, peaks, maxima

    def chosen(self, every: int) -> EmgCalibration:
        """The calibration with the firmest weight at which channels come out as well as without EMG."""
        names = self.found.channels
        if len(names) < 2:
            return replace(self.found, weight=ALONE_WEIGHT)
        total = sum(len(one.motion) for one in self.trials)
        step = every * max(total // every // HELD_FRAMES, 1)
        few = [few_frames(one.motion, one.torques, step) for one in self.trials]
        alone = [solve_tension(self.model, *one, *self.told) for one in few]
        table = np.full((len(names), 1 + len(WEIGHTS)), np.nan)
        for c in range(len(names)):
            table[c] = self._without(c, few, [one.activations for one in alone])
        known = table[np.isfinite(table[:, 0])]
        if not len(known):
            return replace(self.found, weight=ALONE_WEIGHT)
        changes = np.nan_to_num(known[:, 1:]) - known[:, :1]
        good = (changes.mean(axis=0) >= 0.0) & (changes.min(axis=0) >= -MARGIN * WORSE)
        best = int(np.argmax(good)) if good.any() else int(np.argmax(changes.mean(axis=0)))
        held = table[:, [0, 1 + best]]
        weight, others = WEIGHTS[best]
        warnings = self._warnings(held, best)
        return replace(self.found, weight=weight, others_weight=others, held_out=held, warnings=warnings)

    def _without(self, c: int, few: Sequence[tuple[Motion, Series]], alone: Sequence[Array]) -> Array:
        """Correlations (1 + weights,) of a channel without EMG, and with the EMG of all others at each weight."""
        names = self.found.channels
        rest = np.flatnonzero(np.arange(len(names)) != c)
        left = {names[k]: self.channels[names[k]] for k in rest}
        calibration = self._calibrated(rest)
        emg = [one.emg for one in self.tracking.frames]
        columns = [self.model.muscle_names.index(name) for name in self.channels[names[c]]]
        measured = [
            shifted(one, motion.time, self.found.delays)[:, c] for one, (motion, _) in zip(emg, few, strict=True)
        ]
        ways: list[Sequence[Array]] = [alone]
        for weight, others in WEIGHTS:
            given = self.options.unmeasured_weight
            options = replace(self.options, weight=weight, unmeasured_weight=given or others)
            solved = []
            for one, (motion, torques) in zip(emg, few, strict=True):
                target = emg_targets(one, left, self.model, motion.time, options, calibration)
                solved.append(solve_tension(self.model, motion, torques, *self.told, emg=target).activations)
            ways.append(solved)
        envelope = np.concatenate(measured)
        found = [np.concatenate([one[:, columns].mean(axis=1) for one in way]) for way in ways]
        return np.array([_correlation(one, envelope) for one in found])

    def _calibrated(self, rest: np.ndarray) -> EmgCalibration:
        """Gains and synergies of some channels alone."""
        names = tuple(self.found.channels[k] for k in rest)
        frames = [replace(one, emg=Emg(one.emg.time, names, one.emg.values[:, rest])) for one in self.tracking.frames]
        tells, peaks = self.tracking.tells[:, rest], self.peaks[rest]
        groups, prior = _groups(frames, names, tells, peaks), gain_prior(peaks, self.maxima[rest])
        tracking = TorqueTracking(frames, tells, groups, prior, self.options.offsets, self.tracking.errors)
        delays, shapes = self.found.delays[rest], self.found.shapes[rest]
        with threadpool_limits(limits=1, user_api="blas"):
            tracking.whiten(delays)
            fit = tracking.fit(delays, shapes)
        return calibration_of(tracking, fit, names, self.model.muscle_names, delays, shapes)

    def _warnings(self, held: Array, best: int) -> tuple[str, ...]:
        names, lines = self.found.channels, list(self.found.warnings)
        fallen = [
            f"{name} ({before:.2f} to {after:.2f})"
            for name, (before, after) in zip(names, held, strict=True)
            if np.isfinite(before) and not after >= before - WORSE
        ]
        if fallen:
            lines.append(
                f"EMG of the other channels misleads the muscles of {_some(fallen)}: correlation with their own EMG "
                "when left out, without EMG to with it"
            )
        weight, others = WEIGHTS[best]
        if weight < 1.0:
            beside = f", synergies with {others:g}" if others < 1.0 else ""
            lines.append(
                f"EMG takes part with a weight of {weight:g} only{beside}: with more, channels that are left out come "
                "out worse than without EMG"
            )
        return tuple(lines)


def _correlation(one: Array, other: Array) -> float:
    use = np.isfinite(one) & np.isfinite(other)
    if use.sum() < 10 or np.std(other[use]) == 0.0:
        return float("nan")
    # A muscle that never works says nothing of the course of its EMG.
    return float(np.corrcoef(one[use], other[use])[0, 1]) if np.std(one[use]) > 1e-9 else 0.0
