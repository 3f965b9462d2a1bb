"""EMG gains by joint torques: a regression of torques on muscles driven by envelopes.

At frame j the free coordinates balance

    tau_j = sum_c g_c b_cj + sum_u w_u . h_j B_uj + eps_j
    b_cj = sum_m share_mc B_mj s(e_c(t_j - d))

with B_m the generalized force of one unit of activation of muscle m, e envelopes, s their shape, h
the courses of the synergies of the measured channels and w the weights, 0 or more, of unmeasured
muscles. eps has the covariance C_j = diag(sigma^2) + N_j N_j^T of an error of each torque and of
what else may act: how far unmeasured muscles leave their synergies, actuators, and forces of
unmeasured contacts. No effort is in it: co-contraction costs nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from myomorph.core.fit.solver import Solution, minimize
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Emg
from myomorph.core.motion.emg_activation import Synergies, independent_samples, shaped, shifted
from myomorph.core.tension.emg_gains import (
    GAINS,
    METHOD,
    Prior,
    Squares,
    gain_problem,
    gain_unknowns,
    parameters_of,
)
from myomorph.core.tension.problem import TensionInputs, TensionProblem, tension_problem
from myomorph.core.tension.terms.actuators import default_reserves

LOUD = 10.0
"""Torques that an unmeasured contact may make, as a multiple of the RMS of all torques."""


UNMEASURED = 0.1
"""Distance of an unmeasured muscle from its synergies, standard deviation [activation]."""
UNKNOWN = 0.3
"""The same of a measured muscle while its channels are silent."""
NEAR = 0.5
WEIGHT = 0.03
"""How far the weights of an unmeasured muscle lie from those of muscles that act as it does: share,
and activation.
"""
LIKE = 4.0
"""Power of the cosine between what two muscles do at the joints in the share of one for the other.
"""
REST = 0.05
"""Activation at rest: scale of a half-normal prior."""
SURE = 0.01
ROUGH = 0.1
"""Error of a torque in shares of its RMS: the least that is believed, and a first guess."""
KEPT = 0.01
MAX_NOISE = 0.5
"""Of a correction for noise: share of the normal matrix that it leaves, and of a channel that it
may take.
"""
ROUNDS = 5
CLOCK = 0.01
EARLIER = 0.6
"""Courses of synergies: step of their clock, and how far it begins before the motion [s]."""


@read_only
class TrackedFrames:
    """The balance of some frames of a trial.

    Attributes
    ----------
    time : (frames,) [s]
    columns : (frames, rows, muscles) generalized force of one unit of activation [N m or N]
    torques : (frames, rows) to be balanced [N m or N]
    others : (frames, rows, others) what else may act, in units of its standard deviation [N m or N]
    emg : envelopes, its channels those that are calibrated
    gram : (muscles, muscles) products of what muscles do at all joints, rows that are left out here
        included
    """

    time: Array
    columns: Array
    torques: Array
    others: Array
    emg: Emg
    gram: Array


def tracked_frames(inputs: TensionInputs, emg: Emg, tells: Array, every: int) -> TrackedFrames:
    """Balance of every so many frames, on rows that tell of muscles under EMG.

    Parameters
    ----------
    inputs : of the trial's tension problem
    emg : envelopes, its channels those that are calibrated
    tells : (muscles, channels) True where a channel measures a muscle
    every : distance of the frames that are read

    Returns
    -------
    frames whose balance is known
    """
    few = slice(None, None, every)
    motion = inputs.motion.frames(few)
    torques = inputs.torques.frames(few)
    contacts = None if inputs.contacts is None else inputs.contacts.frames(few)
    problem = tension_problem(replace(inputs, motion=motion, torques=torques, contacts=contacts))
    balance = problem.balance(0, len(motion))
    rows = problem.assembly.coordinate_row
    columns = problem.separable.dense(balance.values)[:, rows]
    right = balance.right[:, rows]
    others = _other_forces(problem, inputs, columns, right)

    # Frames that are not known (a body not in sight) say nothing of how large the others are.
    of_muscles = np.nan_to_num(columns)[:, :, : len(problem.muscles.strength)]
    gram = of_muscles.reshape(-1, of_muscles.shape[2])
    measured = of_muscles[:, :, tells.any(axis=1)]
    chosen = np.abs(measured).max(axis=(0, 2), initial=0.0) > 0.0
    if contacts is not None:
        # Unmeasured contacts act on all rows at once, so that one row says something of the others.
        chosen = np.ones(len(rows), dtype=bool)
    good = np.isfinite(columns[:, chosen]).all(axis=(1, 2))
    good &= np.isfinite(right[:, chosen]).all(axis=1)
    return TrackedFrames(
        time=motion.time[good],
        columns=columns[good][:, chosen, : of_muscles.shape[2]],
        torques=right[good][:, chosen],
        others=others[:, chosen][good],
        emg=emg,
        gram=gram.T @ gram,
    )


def _other_forces(
    problem: TensionProblem, inputs: TensionInputs, columns: Array, right: Array
) -> Array:
    """Generalized forces of what else may act, in units of its standard deviation.

    These are forces of unmeasured contacts, and actuators of the model's own.

    Parameters
    ----------
    columns : (frames, rows, unknowns) A
    right : (frames, rows) b

    Returns
    -------
    (frames, rows, others) [N m or N]
    """
    others = [np.zeros((*right.shape, 0))]
    if problem.contacts is not None:
        rms = np.sqrt(np.mean(right[np.isfinite(right)] ** 2)) + 1e-12
        amplitudes = columns[:, :, problem.unknowns.of(problem.contacts)]
        largest = np.abs(np.nan_to_num(amplitudes)).max(axis=(0, 1), initial=0.0)
        others.append(amplitudes * (LOUD * rms / np.maximum(largest, 1e-12)))
    added = default_reserves(inputs.model) if inputs.actuators is None else inputs.actuators
    added_names = {actuator.name for actuator in added}
    place = problem.unknowns.of(problem.actuators)
    names = problem.unknowns.names[place]
    of_model = [index for index, name in enumerate(names) if name not in added_names]
    others.append(columns[:, :, place][:, :, of_model])
    return np.concatenate(others, axis=2)


class Fit(NamedTuple):
    """The most probable gains.

    Attributes
    ----------
    cost : minus the logarithm of the posterior, at the errors of torques that were assumed
    gains, offsets : (channels,)
    parameters : (parameters,) gains, offsets where channels may have any, weights of the synergies
        in muscles without EMG
    misfit : the part of the cost that is of torques, without that of the priors
    solution : of the estimate's problem, see `emg_gains`
    """

    cost: float
    gains: Array
    offsets: Array
    parameters: Array
    misfit: float
    solution: Solution


@read_only
class Group:
    """Unmeasured muscles that share joints with some channels, and these channels' synergies.

    Attributes
    ----------
    synergies : of the channels
    channels : their columns among all channels
    muscles : numbers of the unmeasured muscles
    like : (muscles, channels) how much of an unmeasured muscle's activation each channel's is, see
        `alike`
    """

    synergies: Synergies
    channels: np.ndarray
    muscles: np.ndarray
    like: Array


def action_cosines(frames: Sequence[TrackedFrames]) -> Array:
    """Cosine between what muscles do at the joints over all frames.

    Parameters
    ----------
    frames : of all trials

    Returns
    -------
    (muscles, muscles)
    """
    product = np.asarray(sum(frame.gram for frame in frames))
    size = np.sqrt(np.maximum(np.diag(product), 1e-300))
    return np.asarray(product / np.outer(size, size))


def alike(frames: Sequence[TrackedFrames], muscles: np.ndarray, tells: Array) -> Array:
    """Shares in which channels stand for unmeasured muscles, by what these do at the joints.

    Parameters
    ----------
    frames : of all trials
    muscles : numbers of the unmeasured muscles
    tells : (all muscles, channels) True where a channel measures a muscle

    Returns
    -------
    (muscles, channels)
    """
    cosine = np.maximum(action_cosines(frames)[muscles], 0.0)
    near = (cosine @ tells) / np.maximum(tells.sum(axis=0), 1.0)
    strong = near**LIKE
    total = np.maximum(strong.sum(axis=1, keepdims=True), 1e-300)
    return strong / total * near.max(axis=1, keepdims=True)


class TorqueTracking:
    """The regression over all trials.

    Parameters
    ----------
    frames : of all trials
    tells : (muscles, channels) True where a channel measures a muscle
    groups : synergies for unmeasured muscles
    prior : of the gains
    offsets : whether channels may have an activation at rest
    errors : (rows,) of the torques [N m or N], and what a frame is worth, where they are known from
        elsewhere
    noise : (channels,) standard deviation of noise in the envelopes; it makes gains smaller unless
        that is corrected

    Attributes
    ----------
    unknowns : logarithms of gains, offsets, weights
    """

    def __init__(  # page: the data of the regression and its options
        self,
        frames: Sequence[TrackedFrames],
        tells: Array,
        groups: Sequence[Group],
        prior: Prior,
        offsets: bool,
        errors: tuple[Array, float] | None = None,
        noise: Array | None = None,
    ):
        self.frames = frames
        self.tells = tells
        self.groups = groups
        self.prior = prior
        self.offsets = offsets
        self.measured = np.flatnonzero(tells.any(axis=1))
        torques = np.vstack([frame.torques for frame in frames])
        self._rms = np.sqrt(np.mean(torques**2, axis=0))
        largest = max(float(self._rms.max(initial=0.0)), 1e-6)
        self._min_errors = np.maximum(SURE * self._rms, 1e-6 * largest)
        self.errors = errors or (np.maximum(ROUGH * self._rms, self._min_errors), 0.1)
        self._white: list[tuple[Array, Array]] = []
        self.noise = np.zeros(tells.shape[1]) if noise is None else noise
        self._excess = np.zeros(tells.shape[1])
        self._courses = [[_courses(frame, group) for group in groups] for frame in frames]
        channels = frames[0].emg.names
        self.unknowns = gain_unknowns(channels, prior, offsets, self._weight_names())
        self._last = self.unknowns.start

    @property
    def _gains(self) -> Array:
        """Gains (channels,) of the last fit, the usual ones before the first."""
        return parameters_of(self.unknowns, self._last)[self.unknowns.slices[GAINS]]

    def _weight_names(self) -> list[str]:
        """Names of the weights, in the order of the parameters."""
        return [
            f"weight of synergy {synergy + 1} of group {number + 1} in muscle {muscle + 1}"
            for number, group in enumerate(self.groups)
            for muscle in group.muscles
            for synergy in range(len(group.synergies))
        ]

    def learn_errors(self, delays: Array, shapes: Array, prior: Prior | None = None) -> None:
        """Estimate the errors of the torques from what is left of them.

        By expectation maximization, with the delays and shapes held.

        Parameters
        ----------
        delays : (channels,) [s]
        shapes : (channels,) shape factors
        prior : of the gains, that of the regression by default
        """
        for _ in range(ROUNDS):
            self.whiten(delays)
            fit = self.fit(delays, shapes, prior)
            sigma, worth = self.errors
            squares = np.zeros_like(sigma)
            count = 0
            worths: list[float] = []
            excess = np.zeros_like(self._excess)
            for index, frame in enumerate(self.frames):
                good, covariance = self._covariance(frame, delays)
                left = self._left(index, fit, delays, shapes)[good]
                inverse = np.linalg.inv(covariance)
                error = sigma**2 * np.einsum("kij,kj->ki", inverse, left)
                variance = sigma**2 - sigma**4 * np.einsum("kii->ki", inverse)
                squares = squares + np.sum(error**2 + variance, axis=0)
                count = count + len(left)
                mixed = self._mixed(frame, delays)[good]
                excess += np.sum(np.einsum("krc,kr->kc", mixed, error / sigma**2) ** 2, axis=0)
                worths += _worths(error)
            sigma = np.maximum(np.sqrt(np.maximum(squares, 0.0) / max(count, 1)), self._min_errors)
            self.errors = (sigma, float(np.median(worths)) if worths else worth)
            self._excess = excess * self.noise**2
        self.whiten(delays)

    def fit(self, delays: Array, shapes: Array, prior: Prior | None = None) -> Fit:
        """Most probable gains at some delays and shapes.

        Parameters
        ----------
        delays : (channels,) [s]
        shapes : (channels,) shape factors
        prior : of the gains, that of the regression by default

        Returns
        -------
        gains, offsets and weights, with their cost
        """
        designs = [
            self._rows(columns, index, delays, shapes)
            for index, (columns, _) in enumerate(self._white)
        ]
        size = designs[0].shape[2]
        matrix = np.zeros((size, size))
        slope = np.zeros(size)
        square = 0.0
        count = 0
        for rows, (_, torques) in zip(designs, self._white, strict=True):
            design = rows.reshape(-1, size)
            target = torques.reshape(-1)
            matrix += design.T @ design
            slope += design.T @ target
            square += float(target @ target)
            count += len(target)
        worth = self.errors[1]
        squares = Squares(
            matrix=worth * matrix,
            slope=worth * slope,
            square=worth * square,
            compared=round(worth * count),
        )
        return self._most_probable(squares, prior or self.prior)

    def _covariance(self, tracked_frames: TrackedFrames, delays: Array) -> tuple[np.ndarray, Array]:
        """Frames in which some channel is known, and the covariance C of their torques.

        Returns
        -------
        (frames,) which frames, and (chosen frames, rows, rows)
        """
        known = np.isfinite(shifted(tracked_frames.emg, tracked_frames.time, delays))
        good: np.ndarray = np.asarray(known.any(axis=1))
        silent = (known[good].astype(float) @ self.tells[self.measured].T) == 0.0
        spread = np.full((int(good.sum()), tracked_frames.columns.shape[2]), UNMEASURED)
        spread[:, self.measured] = np.where(silent, UNKNOWN, 0.0)
        noise = self._gains * self.noise
        of_noise = self._mixed(tracked_frames, delays)[good] * noise
        of_muscles = tracked_frames.columns[good] * spread[:, None]
        acting = np.concatenate([of_muscles, tracked_frames.others[good], of_noise], axis=2)
        return good, acting @ acting.transpose(0, 2, 1) + np.diag(self.errors[0] ** 2)

    def _mixed(self, tracked_frames: TrackedFrames, delays: Array) -> Array:
        """Generalized force of an envelope of 1 at a gain of 1, (frames, rows, channels)."""
        known = np.isfinite(shifted(tracked_frames.emg, tracked_frames.time, delays))
        return np.einsum(
            "krm,kmc->krc", tracked_frames.columns[..., self.measured], self._shares(known)
        )

    def _shares(self, known: Array) -> Array:
        """Shares of the known channels in each muscle's activation.

        Parameters
        ----------
        known : (frames, channels)

        Returns
        -------
        (frames, measured muscles, channels)
        """
        tells = self.tells[self.measured]
        return known[:, None] * tells / np.maximum(known.astype(float) @ tells.T, 1.0)[..., None]

    def whiten(self, delays: Array) -> None:
        """Fill L^-1 A and L^-1 tau with C = L L^T, 0 without EMG.

        Parameters
        ----------
        delays : (channels,) [s]
        """
        self._white = []
        for frame in self.frames:
            good, covariance = self._covariance(frame, delays)
            lower = np.linalg.cholesky(covariance)
            both = np.concatenate([frame.columns[good], frame.torques[good][..., None]], axis=2)
            white = np.zeros((*frame.columns.shape[:2], both.shape[2]))
            white[good] = np.linalg.solve(lower, both)
            self._white.append((white[..., :-1], white[..., -1]))

    def _rows(self, columns: Array, index: int, delays: Array, shapes: Array) -> Array:
        """Generalized force of one unit of each parameter.

        Parameters
        ----------
        columns : (frames, rows, muscles) of one unit of activation, whitened or not
        index : number of the trial

        Returns
        -------
        (frames, rows, parameters)
        """
        frames = self.frames[index]
        envelopes = shifted(frames.emg, frames.time, delays)
        known = np.isfinite(envelopes)
        mixed = np.einsum("krm,kmc->krc", columns[..., self.measured], self._shares(known))
        parts = [mixed * shaped(np.where(known, envelopes, 0.0), shapes)[:, None]]
        parts += [mixed] if self.offsets else []
        for group, courses in zip(self.groups, self._courses[index], strict=True):
            course = np.nan_to_num(
                shifted(courses, frames.time, np.full(1, delays[group.channels].mean()))
            )
            both = columns[..., group.muscles, None] * course[:, None, None]
            parts.append(both.reshape(*both.shape[:2], -1))
        return np.concatenate(parts, axis=2)

    def _left(self, index: int, fit: Fit, delays: Array, shapes: Array) -> Array:
        """Torques (frames, rows) that a fit leaves."""
        rows = self._rows(self.frames[index].columns, index, delays, shapes)
        return self.frames[index].torques - rows @ fit.parameters

    def _ridge(self, size: int, prior: Prior) -> Array:
        """Precision of the prior of offsets and weights, gains aside.

        The weights of an unmeasured muscle are near those of the measured muscles that act as it
        does.

        Parameters
        ----------
        size : number of parameters

        Returns
        -------
        (parameters, parameters)
        """
        count = self.tells.shape[1]
        rows = [np.eye(size)[count : 2 * count] / REST] if self.offsets else []
        start = count * (2 if self.offsets else 1)
        usual_gains = np.exp(np.minimum(prior.mean, prior.upper))
        for group in self.groups:
            weights = len(group.muscles) * len(group.synergies)
            part = np.zeros((weights, size))
            part[:, start : start + weights] = np.eye(weights)
            vectors = group.synergies.vectors * group.synergies.scale
            like = np.einsum("uc,sc->usc", group.like, vectors).reshape(-1, len(group.channels))
            part[:, group.channels] = -like
            usual = like @ usual_gains[group.channels]
            rows.append(part / (NEAR * usual + WEIGHT)[:, None])
            start += weights
        root = np.vstack([np.zeros((0, size)), *rows])
        return root.T @ root

    def _corrected(self, matrix: Array, ridge: Array) -> Array:
        """Subtract from the normal matrix what noise of the envelopes adds to it, as far as it can.

        Where channels say little more than their noise, all of it cannot be taken off.

        Parameters
        ----------
        matrix, ridge : (parameters, parameters) of the torques and of the prior

        Returns
        -------
        (parameters, parameters)
        """
        if not self._excess.any():
            return matrix
        count = len(self._excess)
        share = np.minimum(self.errors[1] * self._excess, MAX_NOISE * np.diag(matrix)[:count])
        for part in (1.0, 0.5, 0.25, 0.0):
            result = matrix.copy()
            result[np.arange(count), np.arange(count)] -= part * share
            if np.linalg.eigvalsh(result - KEPT * matrix + ridge)[0] > 0.0:
                break
        return result

    def _most_probable(self, squares: Squares, prior: Prior) -> Fit:
        """Find the most probable parameters, from those of the last fit on.

        These are near where delays differ little.

        Parameters
        ----------
        squares : of the torques, |A x - tau|^2
        prior : of the gains
        """
        ridge = self._ridge(len(squares.slope), prior)
        squares = squares._replace(matrix=self._corrected(squares.matrix, ridge))
        shift = self._shift(squares, ridge)
        problem = gain_problem(
            self.unknowns, squares._replace(square=squares.square + shift), ridge, prior
        )
        solution = minimize(problem, problem.at(self._last), method=METHOD)
        self._last = solution.x
        return self._fit_of(solution, shift)

    def _fit_of(self, solution: Solution, shift: float) -> Fit:
        """Take gains, offsets and weights out of a solution.

        Parameters
        ----------
        shift : that is in the cost of the torques
        """
        count = self.tells.shape[1]
        x = parameters_of(solution.problem.unknowns, solution.x)
        offsets = x[count : 2 * count].copy() if self.offsets else np.zeros(count)
        weights = slice(count + self.offsets * count, None)
        x[weights] = np.minimum(x[weights], 1.0)
        return Fit(
            cost=0.5 * (solution.at.cost - shift),
            gains=x[:count].copy(),
            offsets=offsets,
            parameters=x,
            misfit=0.5 * (solution.at.parts[0].cost - shift),
            solution=solution,
        )

    def _shift(self, squares: Squares, ridge: Array) -> float:
        """Constant that keeps the squares from falling below 0 where noise was taken off.

        Torques that envelopes explain better than their noise allows leave less than nothing.

        Parameters
        ----------
        squares : of the torques, without what noise adds
        ridge : (parameters, parameters) of the prior
        """
        if not self._excess.any():
            return 0.0
        best = np.linalg.solve(squares.matrix + ridge, squares.slope)
        return max(0.0, float(squares.slope @ best) - squares.square)


def _worths(error: Array) -> list[float]:
    """Share of independent frames in the errors of each row (frames, rows), where they tell."""
    return [
        independent_samples(values, values) / len(values)
        for values in error.T
        if len(values) > 8 and np.std(values) > 0.0
    ]


def _courses(tracked_frames: TrackedFrames, group: Group) -> Emg:
    """Courses of a group's synergies on a coarse clock, as far as delays may reach."""
    step = max(int(CLOCK / max(float(np.median(np.diff(tracked_frames.emg.time))), 1e-6)), 1)
    first, last = np.searchsorted(
        tracked_frames.emg.time, [tracked_frames.time[0] - EARLIER, tracked_frames.time[-1] + CLOCK]
    ).tolist()
    use = slice(first, last, step)
    courses = group.synergies.courses(tracked_frames.emg.values[use][:, group.channels])
    return Emg(
        tracked_frames.emg.time[use],
        tuple(str(index) for index in range(len(group.synergies))),
        courses,
    )
