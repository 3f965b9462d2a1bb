"""EMG envelopes to activations known to the tension problem; delays and gains of channels, from trials with torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np
from scipy.optimize import minimize

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import Actuator, Model, index_of
from myomorph.model.series import Emg, Motion, Series
from myomorph.motion.emg_checks import envelope_faults, refuse_unfit, without_faults
from myomorph.motion.emg_delay import (
    USUAL,
    ChannelMap,
    DelayOptions,
    Delays,
    EmgCalibration,
    channel_means,
    find_delays,
    fit_gains,
    shifted,
    uncalibrated,
)
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.tension.dual import OPTIMAL
from myomorph.tension.problem import tension_problem
from myomorph.tension.solve import solve_tension
from myomorph.tension.tension import Tension, TensionOptions
from myomorph.tension.terms.contacts import ContactTask
from myomorph.tension.terms.emg import EmgTarget
from myomorph.tension.terms.term import added_up


@dataclass(frozen=True)
class EmgOptions:
    """How EMG takes part in the tension problem.

    Attributes
    ----------
    mode : "soft": a cost keeps activations near EMG; "equality": they may differ by the slack only
    weight : of the soft cost, in units of the effort of one muscle
    slack : of an equality [activation]
    delay : electromechanical delay [s]; None finds it where EMG is calibrated, else takes the usual one
    gains : "fitted": one gain a channel, so that envelopes fit activations and torques; "given": envelopes are
        activations already, as with maxima of maximum voluntary contractions
    offsets : whether a channel may have an activation at rest too
    search : how the delay is looked for
    """

    SETTING_PREFIX: ClassVar[str] = "emg_"

    mode: Literal["soft", "equality"] = "soft"
    weight: float = 10.0
    slack: float = 0.02
    delay: float | None = None
    gains: Literal["fitted", "given"] = "fitted"
    offsets: bool = False
    search: DelayOptions = field(default_factory=DelayOptions)

    def __post_init__(self) -> None:
        # What the target would refuse is refused before anything is calibrated.
        EmgTarget((), np.zeros((0, 0)), self.mode, self.weight, self.slack)
        if self.gains not in ("fitted", "given"):
            raise BadData(f"unknown gains of EMG '{self.gains}': there are 'fitted', 'given'")
        if self.delay is not None and not 0.0 <= self.delay <= 0.5:
            raise BadData(f"electromechanical delay of {self.delay:g} s: expected 0 to 0.5 s")


def emg_targets(
    emg: Emg,
    channels: ChannelMap,
    model: Model,
    time: Array,
    options: EmgOptions | None = None,
    calibration: EmgCalibration | None = None,
) -> EmgTarget:
    """Activations that EMG tells, at the motion's times, with delay and gain applied.

    Each muscle takes the mean of the channels that tell of it and are known at that time. Dead stretches
    are unknown, negative values 0 (see `emg_checks.envelope_faults` for what to tell the user).

    Parameters
    ----------
    channels : channel of `emg` to muscles of the model; channels that are not named are not used
    time : (frames,) of the motion [s]
    calibration : delays and gains of at least these channels, by `calibrate_emg`; None takes envelopes as
        activations, `options.delay` late

    Raises
    ------
    UnknownName
        where a channel or a muscle does not exist
    BadData
        where no channel is named or known, or EMG and motion have no time in common
    """
    options = options or EmgOptions()
    muscles = mapped_muscles(emg, channels, model)
    refuse_unfit(emg, time, channels)
    clean = without_faults(emg, envelope_faults(emg))
    if calibration is None:
        calibration = uncalibrated(tuple(channels), USUAL if options.delay is None else options.delay)
    for channel in channels:
        index_of("EMG channel", channel, calibration.channels, "the calibration")
    told = calibration.applied(clean, time)
    values = np.full((len(time), len(muscles)), np.nan)
    for m, muscle in enumerate(muscles):
        columns = np.array([told[channel] for channel, names in channels.items() if muscle in names])
        known = np.isfinite(columns)
        count = known.sum(axis=0)
        values[:, m] = np.where(count > 0, np.where(known, columns, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)
    return EmgTarget(muscles, values, options.mode, options.weight, options.slack)


def mapped_muscles(emg: Emg, channels: ChannelMap, model: Model) -> tuple[str, ...]:
    """Muscles that the channels tell of, in the model's order.

    Raises
    ------
    UnknownName
        where a channel or a muscle does not exist
    BadData
        where no channel tells of a muscle
    """
    told: set[str] = set()
    for channel, names in channels.items():
        index_of("EMG channel", channel, emg.names, "the EMG")
        for name in names:
            index_of(f"muscle of EMG channel '{channel}'", name, model.muscle_names)
        told |= set(names)
    if not told:
        raise BadData("no EMG channel tells of a muscle: name them as emg_muscles = { channel = ['muscle'] }")
    return tuple(name for name in model.muscle_names if name in told)


MOST_FRAMES = 300
"""About how many frames of all trials together the gains are fitted on, evenly spread."""


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
    predicted, known = [], []
    for trial in trials:
        alone = solve_tension(model, trial.motion, trial.torques, tension, actuators, contacts=trial.contacts)
        means = channel_means(channels, alone.muscles, alone.activations)
        predicted.append(Series(trial.motion.time, names, means))
        known.append(_contacts_known(model, trial, alone))
    delays, warnings = _delays(list(zip(told, predicted, strict=True)), options)
    moved = [shifted(emg, one.time, delays) for emg, one in zip(told, predicted, strict=True)]
    gains, offsets = np.ones(len(names)), np.zeros(len(names))
    if options.gains == "fitted":
        start = fit_gains(np.vstack(moved), np.vstack([one.values for one in predicted]), options.offsets)
        every = max(sum(len(one) for one in predicted) // MOST_FRAMES, 1)
        pieces = [
            _Piece(model, trial, envelopes, channels, options, tension, actuators, every)
            for trial, envelopes in zip(known, moved, strict=True)
        ]
        gains, offsets = _least_cost(pieces, *start, options.offsets)
    return EmgCalibration(names, delays, gains, offsets, warnings)


def _contacts_known(model: Model, trial: EmgTrial, alone: Tension) -> EmgTrial:
    """The trial with the contact forces that were found without EMG taken as known."""
    if alone.contacts is None:
        return trial
    motion, torques = trial.motion, trial.torques
    assert motion.velocities is not None
    still = replace(motion, accelerations=np.zeros_like(motion.velocities))
    # What contacts carry does not depend on how the body accelerates.
    carried = inverse_dynamics(model, still, alone.contacts.wrenches()).values - inverse_dynamics(model, still).values
    columns = {name: k for k, name in enumerate(model.coordinate_names)}
    values = [
        column + (carried[:, columns[name]] if name in columns else 0.0)
        for name, column in zip(torques.names, torques.values.T, strict=True)
    ]
    return replace(trial, torques=Series(torques.time, torques.names, np.array(values).T), contacts=None)


class _Piece:
    """The tension problem of one trial, for envelopes whose gains are still open.

    The least cost J(g, o) of the whole problem, effort and distance to g e + o, is convex in gains and offsets, for
    the problem is so in activations, gains and offsets together; at its solution a the slope is that of the distance
    alone: dJ/dg_c = -2 W sum (a - t) dt/dg_c.
    """

    def __init__(
        self,
        model: Model,
        trial: EmgTrial,
        envelopes: Array,
        channels: ChannelMap,
        options: EmgOptions,
        tension: TensionOptions | None,
        actuators: Sequence[Actuator] | None,
        every: int,
    ):
        motion, chosen = trial.motion, slice(None, None, every)
        assert motion.velocities is not None
        few = replace(
            motion,
            time=motion.time[chosen],
            values=motion.values[chosen],
            velocities=motion.velocities[chosen],
            accelerations=None,
        )
        torques = Series(few.time, trial.torques.names, trial.torques.values[chosen])
        self._problem, _ = tension_problem(model, few, torques, tension, actuators)
        self._given = self._problem.balance(0, len(few))
        self._weight = options.weight
        self._muscles = tuple(name for name in model.muscle_names if any(name in told for told in channels.values()))
        tells = np.array([[name in told for told in channels.values()] for name in self._muscles], dtype=np.float64)
        known = np.isfinite(envelopes[chosen])
        counts = known.astype(np.float64) @ tells.T
        self._envelopes = np.where(known, envelopes[chosen], 0.0)
        # Share of each channel in what each muscle is told: (frames, muscles, channels).
        self._shares = known[:, None] * tells / np.maximum(counts, 1.0)[..., None]
        self._told = counts > 0.0
        self._columns = [model.muscle_names.index(name) for name in self._muscles]

    def cost(self, gains: Array, offsets: Array) -> tuple[float, Array, Array]:
        """J, dJ/dgains and dJ/doffsets."""
        target = np.einsum("fmc,fc->fm", self._shares, gains * self._envelopes + offsets)
        emg = EmgTarget(self._muscles, np.where(self._told, target, np.nan), "soft", self._weight)
        problem = self._problem
        variables = problem.separable
        problem.penalties = added_up([emg.penalties(problem.unknowns)], problem.unknowns, len(variables.weight))
        x, _, _, _, status = problem.solved(self._given)
        good = status == OPTIMAL
        x = x[good]
        apart = np.where(self._told[good], x[:, self._columns] - target[good], 0.0)
        effort = float(np.sum(variables.weight * np.abs(x) ** variables.exponent))
        slope = -2.0 * self._weight * np.einsum("fm,fmc->fc", apart, self._shares[good])
        value = effort + self._weight * float(np.sum(apart**2))
        return value, np.sum(slope * self._envelopes[good], axis=0), slope.sum(axis=0)


def _least_cost(pieces: Sequence[_Piece], gains: Array, offsets: Array, free_offsets: bool) -> tuple[Array, Array]:
    """Gains and offsets, 0 or more, at which the tension problems of all pieces together cost least."""
    count = len(gains)

    def cost(both: Array) -> tuple[float, Array]:
        parts = [one.cost(both[:count], both[count:]) for one in pieces]
        slopes = [
            np.sum([one for _, one, _ in parts], axis=0),
            np.sum([one for _, _, one in parts], axis=0),
        ]
        return float(sum(one for one, _, _ in parts)), np.concatenate(slopes)

    bounds = [(0.0, None)] * count + [(0.0, None if free_offsets else 0.0)] * count
    start = np.concatenate([gains, offsets])
    settings = {"maxiter": 60, "ftol": 1e-9}
    found = minimize(cost, start, jac=True, bounds=bounds, method="L-BFGS-B", options=settings).x
    return found[:count], found[count:]


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
