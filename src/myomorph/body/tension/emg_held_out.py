"""EMG channels left out in turn, and channels whose names are exchanged.

What the others do to the activation of a left-out channel's muscles sets the weight of EMG. Of
exchanged channels each follows what the other's muscles have to do, and not its own.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.body.tension.emg_groups import (
    SAME,
    calibration_of,
    kept_level,
    settled_gains,
    some_names,
    synergy_groups,
)
from myomorph.core.fit.verdict import Verdict
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import EMG
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Actuator, Model
from myomorph.core.model.series import Emg, Motion, Series
from myomorph.core.motion.emg_activation import ChannelMap, EmgCalibration, channel_means, shifted
from myomorph.core.tension.emg_gains import gain_prior
from myomorph.core.tension.emg_targets import EmgOptions, emg_targets
from myomorph.core.tension.emg_tracking import TorqueTracking, action_cosines
from myomorph.core.tension.recruitment import EFFORT_ALONE
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.contacts import ContactTask
from myomorph.core.tension.terms.emg import EmgTarget

CLEARER = 0.2
"""By how much the correlation of both channels has to rise. In three walks without a fault no pair
rises at all.
"""
FOLLOWS = 0.3  # Correlation from which on a channel follows muscles
SHORTEST = 30  # Frames that are needed


class Swap(NamedTuple):
    """Two channels that look exchanged.

    Attributes
    ----------
    first, second : their columns
    own : mean correlation of both with their own muscles
    other : the same with the other's
    """

    first: int
    second: int
    own: float
    other: float


def swapped_channels(envelopes: Array, activations: Array) -> tuple[Swap, ...]:
    """Find pairs of channels that look exchanged, the clearest first.

    Both channels must follow the other's muscles better than their own. Muscles that work at the
    same time (gastrocnemius and soleus, vasti and gluteus medius in walking) cannot be
    distinguished so.

    Parameters
    ----------
    envelopes : (frames, channels) at the delay of EMG, NaN where unknown
    activations : (frames, channels) means of each channel's muscles, found without EMG from joint
        torques

    Returns
    -------
    pairs; no channel is in two
    """
    use = np.isfinite(envelopes).all(axis=1) & np.isfinite(activations).all(axis=1)
    count = envelopes.shape[1]
    if use.sum() < SHORTEST:
        return ()
    both = np.hstack([envelopes[use], activations[use]])
    both = both - both.mean(axis=0)
    size = np.linalg.norm(both, axis=0)
    both = both / np.where(size > 0.0, size, np.inf)
    result = both[:, :count].T @ both[:, count:]
    pairs = []
    for i, j in itertools.combinations(range(count), 2):
        rise = min(result[i, j] - result[i, i], result[j, i] - result[j, j])
        if rise > CLEARER and min(result[i, j], result[j, i]) > FOLLOWS:
            direct = 0.5 * (result[i, i] + result[j, j])
            other = 0.5 * (result[i, j] + result[j, i])
            pairs.append(
                (float(rise), Swap(first=i, second=j, own=float(direct), other=float(other)))
            )
    chosen: list[Swap] = []
    for _, pair in sorted(pairs, reverse=True):
        taken = {number for item in chosen for number in item[:2]}
        if not taken & set(pair[:2]):
            chosen.append(pair)
    return tuple(chosen)


def swap_lines(names: tuple[str, ...], swaps: tuple[Swap, ...]) -> tuple[Message, ...]:
    """Write one line for each pair."""
    return tuple(
        EMG.message(
            f"EMG channels '{names[swap.first]}' and '{names[swap.second]}' look exchanged: each"
            " follows the other's muscles (correlation with what joint torques ask of them"
            f" {swap.other:.2f}, with their own {swap.own:.2f}); they are used under their names"
        )
        for swap in swaps
    )


WEIGHTS = ((10.0, 1.0), (3.0, 1.0), (1.0, 1.0), (0.3, 1.0), (0.1, 1.0), (0.1, 0.3), (0.1, 0.1))
"""Weights that are tried, the firmest first: of soft targets, and of what synergies say of muscles
without EMG.
"""
WORSE = 0.05  # Fall of a held-out channel's correlation that is too much
# Share of it that is allowed where a weight is chosen: muscles that no channel measures may fare
# worse
MARGIN = 0.5
HELD_FRAMES = 150
HELD_WITH_CONTACTS = 60
"""About how many frames of all trials together channels are left out on; the second where forces of
contacts are found along with activations, which takes longer.
"""


@dataclass(frozen=True, eq=False)
class EmgTrial:
    """Inputs of the calibration of EMG from one trial.

    Attributes
    ----------
    motion : with velocities
    torques : at its times [N m or N]; where forces of contacts are unknown, those without them
    emg : envelopes on their clock
    contacts : where unknown contact forces act; None where all are measured
    """

    motion: Motion
    torques: Series
    emg: Emg
    contacts: ContactTask | None = None

    def thinned(self, every: int) -> EmgTrial:
        """Take every so many frames, with all of the EMG."""
        few = slice(None, None, every)
        return replace(
            self,
            motion=self.motion.frames(few),
            torques=self.torques.frames(few),
            contacts=None if self.contacts is None else self.contacts.frames(few),
        )


@dataclass(eq=False)
class HeldOut:
    """Channels left out in turn: what the EMG of the others does to the muscles under them.

    Delay, shape and errors of torques are those of all channels; gains and synergies are found
    anew.

    Attributes
    ----------
    model : of the body
    channels : to muscles of the model
    options : of EMG
    settings : options and actuators of `solve_tension`
    tracking : the regression over all trials
    calibration : of all channels
    peaks, maxima : (channels,) as of `gain_prior`
    few : some frames of each trial
    """

    model: Model
    channels: ChannelMap
    options: EmgOptions
    settings: tuple[TensionOptions | None, Sequence[Actuator] | None]
    tracking: TorqueTracking
    calibration: EmgCalibration
    peaks: Array
    maxima: Array
    few: Sequence[EmgTrial]

    def __post_init__(self) -> None:
        self.alone = [self._activation(trial) for trial in self.few]

    def _activation(self, trial: EmgTrial, target: EmgTarget | None = None) -> Array:
        """Solve for activations (frames, muscles), and forces of contacts where they are unknown.

        Parameters
        ----------
        trial : one of `few`
        target : of activations; None takes no EMG
        """
        return solve_tension(
            self.model,
            trial.motion,
            trial.torques,
            *self.settings,
            contacts=trial.contacts,
            emg=target,
            recruitment=EFFORT_ALONE,
        ).activation

    def swapped(self) -> tuple[Swap, ...]:
        """Find pairs of channels that look exchanged."""
        muscles = {name: self.channels[name] for name in self.calibration.channels}
        return swapped_channels(
            np.vstack([self._measured(index) for index in range(len(self.few))]),
            np.vstack(
                [
                    channel_means(muscles, self.model.muscle_names, activations)
                    for activations in self.alone
                ]
            ),
        )

    def _measured(self, index: int) -> Array:
        """Return envelopes (frames, channels) of a trial at the delay found."""
        return shifted(
            self.tracking.frames[index].emg, self.few[index].motion.time, self.calibration.delays
        )

    def chosen(self, emg_calibration: EmgCalibration) -> EmgCalibration:
        """Choose the firmest weight at which channels come out as well as without EMG.

        Parameters
        ----------
        emg_calibration : of all channels

        Returns
        -------
        the calibration with the weight, 0 where channels disagree or none can be left out
        """
        names = emg_calibration.channels
        if len(names) < 2:
            return _unchecked(emg_calibration, "there is one channel, which cannot be left out")
        table = np.array([self._without(c, [c]) for c in range(len(names))])
        # A muscle that acts as none under an electrode fares as channels do without those that act
        # as they do.
        unlike = [self._without(c, out) for c, out in self._with_twins() if len(out) < len(names)]
        known = np.array([row for row in (*table, *unlike) if np.isfinite(row[0])])
        if not len(known):
            return _unchecked(
                emg_calibration, "no channel that is left out is predicted by the others"
            )
        changes = np.nan_to_num(known[:, 1:]) - known[:, :1]
        good = (changes.mean(axis=0) >= 0.0) & (changes.min(axis=0) >= -MARGIN * WORSE)
        best = int(np.argmax(good)) if good.any() else int(np.argmax(changes.mean(axis=0)))
        held = table[:, [0, 1 + best]]
        weight, others = WEIGHTS[best]
        if np.nanmean(held[:, 1] - held[:, 0]) < 0.0:
            weight = 0.0
        warnings = (*emg_calibration.warnings, *self._warnings(held))
        estimate = emg_calibration.estimate
        if estimate is not None:
            estimate = replace(estimate, verdict=held_out_verdict(names, held))
        return replace(
            emg_calibration,
            weight=weight,
            others_weight=others,
            held_out=held,
            warnings=warnings,
            estimate=estimate,
        )

    def _with_twins(self) -> list[tuple[int, list[int]]]:
        """Find channels that have others whose muscles act alike, and these channels with them."""
        tells = self.tracking.tells
        shares = tells / np.maximum(tells.sum(axis=0), 1.0)
        same = shares.T @ action_cosines(self.tracking.frames) @ shares >= SAME
        result = [
            (c, np.flatnonzero(row | (np.arange(len(row)) == c)).tolist())
            for c, row in enumerate(same)
        ]
        return [(c, out) for c, out in result if len(out) > 1]

    def _without(self, c: int, out: Sequence[int]) -> Array:
        """Correlate a left-out channel with the activation of its muscles.

        Parameters
        ----------
        c : number of the channel
        out : channels that are left out

        Returns
        -------
        (1 + weights,) without EMG, and with that of the other channels at each weight
        """
        names = self.calibration.channels
        rest = np.setdiff1d(np.arange(len(names)), out)
        left = {names[number]: self.channels[names[number]] for number in rest}
        calibration = self._calibrated(rest)
        emg = [frame.emg for frame in self.tracking.frames]
        columns = [self.model.muscle_names.index(name) for name in self.channels[names[c]]]
        measured = [self._measured(index)[:, c] for index in range(len(self.few))]
        ways: list[Sequence[Array]] = [self.alone]
        for index, (weight, others) in enumerate(WEIGHTS):
            given = self.options.unmeasured_weight
            if not calibration.synergies and index and weight == WEIGHTS[index - 1][0]:
                # No muscle without EMG is drawn: how firmly makes no difference.
                ways.append(ways[-1])
                continue
            options = replace(self.options, weight=weight, unmeasured_weight=given or others)
            solved = []
            for item, trial in zip(emg, self.few, strict=True):
                time = trial.motion.time
                target = emg_targets(item, left, self.model, time, options, calibration)
                solved.append(self._activation(trial, target))
            ways.append(solved)
        envelope = np.concatenate(measured)
        result = [np.concatenate([part[:, columns].mean(axis=1) for part in way]) for way in ways]
        return np.array([_correlation(outcome, envelope) for outcome in result])

    def _calibrated(self, rest: np.ndarray) -> EmgCalibration:
        """Find gains and synergies of some channels alone.

        Parameters
        ----------
        rest : (channels left,) their numbers
        """
        names = tuple(self.calibration.channels[number] for number in rest)
        frames = [
            replace(frame, emg=Emg(frame.emg.time, names, frame.emg.values[:, rest]))
            for frame in self.tracking.frames
        ]
        tells = self.tracking.tells[:, rest]
        peaks = self.peaks[rest]
        groups = synergy_groups(frames, names, tells, peaks)
        wide = gain_prior(peaks, self.maxima[rest])
        noise = self.tracking.noise[rest]
        tracking = TorqueTracking(
            frames=frames,
            tells=tells,
            groups=groups,
            prior=wide,
            offsets=self.options.offsets,
            errors=self.tracking.errors,
            noise=noise,
        )
        delays = self.calibration.delays[rest]
        shapes = self.calibration.shapes[rest]
        with threadpool_limits(limits=1, user_api="blas"):
            tracking.whiten(delays)
            prior = kept_level(tracking, gain_prior(peaks, self.maxima[rest], 0.0), delays, shapes)
            settled = settled_gains(tracking, prior, delays, shapes)
        return calibration_of(tracking, settled, names, self.model.muscle_names)

    def _warnings(self, held: Array) -> tuple[Message, ...]:
        """Warn of channels whose muscles the others mislead.

        Parameters
        ----------
        held : (channels, 2) correlation without EMG and with that of the others
        """
        fallen = [
            f"{name} ({before:.2f} to {after:.2f})"
            for name, (before, after) in zip(self.calibration.channels, held, strict=True)
            if np.isfinite(before) and not after >= before - WORSE
        ]
        text = (
            f"EMG of the other channels contradicts the muscles of {some_names(fallen)}:"
            " correlation"
            " with their own "
        )
        return (EMG.message(f"{text}EMG when left out, without EMG to with it"),) if fallen else ()


def _unchecked(emg_calibration: EmgCalibration, why: str) -> EmgCalibration:
    """Give EMG the weight 0, as nothing can check it, and say so."""
    warning = EMG.message(f"EMG is not used, as nothing checks it: {why} (--emg-weight 1 uses it)")
    warnings = (*emg_calibration.warnings, warning)
    return replace(emg_calibration, weight=0.0, warnings=warnings)


def held_out_verdict(names: Sequence[str], held: Array) -> Verdict:
    """Judge whether EMG predicts left-out channels better than joint torques alone do.

    Courses of mean 0 and standard deviation 1 whose correlation is r lie sqrt(2 - 2 r) apart (root
    mean square), so that root mean squares over channels are compared as mean correlations are.

    Parameters
    ----------
    names : of the channels
    held : (channels, 2) correlation of a channel that is left out with the activation of its
        muscles, without EMG and with that of the others; NaN where not known

    Returns
    -------
    the verdict, in which "generic" is without EMG

    Examples
    --------
    >>> import numpy as np
    >>> from myomorph.body.tension.emg_held_out import held_out_verdict
    >>> held_out_verdict(["vasti", "soleus"], np.array([[0.5, 0.8], [0.6, 0.7]])).better
    True
    """
    known = np.asarray(np.isfinite(held).all(axis=1))
    apart = np.sqrt(2.0 - 2.0 * held[known])
    return Verdict(
        kinds=(("distance of normalized courses", "SD"),),
        parts=tuple(name for name, seen in zip(names, known, strict=True) if seen),
        estimate=apart[:, 1:],
        generic=apart[:, :1],
        weights=np.ones(len(apart)),
        what="EMG channels that are left out",
    )


def held_out_line(emg_calibration: EmgCalibration) -> tuple[Message, ...]:
    """Report what EMG gains in channels that were left out, as one line; () where none was."""
    held = emg_calibration.held_out[np.isfinite(emg_calibration.held_out).all(axis=1)]
    if not len(held):
        return ()
    before, after = held.mean(axis=0)
    weight = emg_calibration.weight
    part = (
        f"part with a weight of {weight:g}"
        if weight
        else "no part, as channels disagree (--emg-weight 1 uses it)"
    )
    way = "of channels that are left out, mean correlation with the activation of their muscles"
    return (
        EMG.message(
            f"EMG takes {part}: {way} {before:.2f} without EMG, {after:.2f} with the other"
            " channels",
            severity="good to know",
        ),
    )


def _correlation(one: Array, other: Array) -> float:
    """Correlate two courses (frames,), NaN left out."""
    use = np.isfinite(one) & np.isfinite(other)
    if use.sum() < 10 or np.std(other[use]) == 0.0:
        return float("nan")
    # A muscle that never works says nothing of the course of its EMG.
    return float(np.corrcoef(one[use], other[use])[0, 1]) if np.std(one[use]) > 1e-9 else 0.0
