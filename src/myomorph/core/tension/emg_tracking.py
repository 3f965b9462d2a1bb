"""What joint torques say of EMG gains: a regression of measured torques on muscles driven by their
envelopes.

At frame k the free coordinates balance

    tau_k = sum_c g_c b_ck + sum_u w_u . h_k B_uk + eps_k,    b_ck = sum_m share_mc B_mk s(e_c(t_k - d))

with B_m the generalized force of one unit of activation of muscle m, e envelopes, s their shape, h
the courses of the synergies of the measured channels and w the weights, 0 or more, of unmeasured
muscles. eps has the covariance C_k = diag(sigma^2) + N_k N_k^T of an error of each torque and of
what else may act: how far unmeasured muscles leave their synergies, actuators, and forces of
unmeasured contacts. No effort is in it: co-contraction costs nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Emg, Motion, Series
from myomorph.core.motion.emg_activation import Synergies, independent_samples, shaped, shifted
from myomorph.core.tension.problem import TensionInputs, tension_problem
from myomorph.core.tension.terms.actuators import default_reserves
from myomorph.core.tension.terms.contacts import ContactTask

LOUD = 10.0  # How many times the RMS of the torques an unmeasured contact may make of them


@read_only
class TrackedFrames:
    """What the balance of some frames of a trial is made of."""

    time: Array  # (frames,) [s]
    columns: Array  # (frames, rows, muscles) generalized force of one unit of activation [N m or N]
    torques: Array  # (frames, rows) to be balanced [N m or N]
    # (frames, rows, others) what else may act, in units of its standard deviation [N m or N]
    others: Array
    emg: Emg  # envelopes, its channels those that are calibrated
    # (muscles, muscles) products of what muscles do at all joints, rows that are left out here
    # included
    gram: Array


def few_frames(motion: Motion, torques: Series, every: int) -> tuple[Motion, Series]:
    """Every so many frames of a motion with velocities and what else it has, and of its torques."""
    return motion.frames(slice(None, None, every)), torques.frames(slice(None, None, every))


def tracked_frames(inputs: TensionInputs, emg: Emg, tells: Array, every: int) -> TrackedFrames:
    """Every so many frames, on rows that tell of muscles under EMG; `tells` (muscles, channels)
    which tells which.
    """
    few, wanted = few_frames(inputs.motion, inputs.torques, every)
    touching = (
        None if inputs.contacts is None else _thinned(inputs.contacts, slice(None, None, every))
    )
    problem = tension_problem(replace(inputs, motion=few, torques=wanted, contacts=touching))
    balance = problem.balance(0, len(few))
    rows = problem.assembly.coordinate_row
    whole = problem.separable.dense(balance.values)[:, rows]
    right = balance.right[:, rows]
    count = len(problem.muscles.strength)
    # Frames that are not known (a body not in sight) say nothing of how large the others are.
    known = np.nan_to_num(whole)
    size = np.sqrt(np.mean(right[np.isfinite(right)] ** 2)) + 1e-12
    others = [np.zeros((len(few), len(rows), 0))]
    if problem.contacts is not None:
        amplitudes = whole[:, :, problem.unknowns.of(problem.contacts)]
        largest = np.abs(known[:, :, problem.unknowns.of(problem.contacts)]).max(
            axis=(0, 1), initial=0.0
        )
        others.append(amplitudes * (LOUD * size / np.maximum(largest, 1e-12)))
    added = default_reserves(inputs.model) if inputs.actuators is None else inputs.actuators
    names = {actuator.name for actuator in added}
    place = problem.unknowns.of(problem.actuators)
    own = [index for index, name in enumerate(problem.unknowns.names[place]) if name not in names]
    others.append(whole[:, :, place][:, :, own])
    reached = (
        np.abs(known[:, :, :count][:, :, tells.any(axis=1)]).max(axis=(0, 2), initial=0.0) > 0.0
    )
    # Unmeasured contacts act on all rows at once, so that one row says something of the others.
    kept = reached if touching is None else np.ones(len(rows), dtype=bool)
    acting = np.concatenate(others, axis=2)[:, kept]
    good = np.isfinite(whole[:, kept]).all(axis=(1, 2)) & np.isfinite(right[:, kept]).all(axis=1)
    muscles = known[:, :, :count].reshape(-1, count)
    gram = muscles.T @ muscles
    return TrackedFrames(
        time=few.time[good],
        columns=whole[good][:, kept, :count],
        torques=right[good][:, kept],
        others=acting[good],
        emg=emg,
        gram=gram,
    )


def _thinned(contacts: ContactTask, chosen: slice) -> ContactTask:
    """The same contacts at fewer instants."""
    preferred = None if contacts.preferred is None else contacts.preferred[chosen]
    measured = tuple(
        replace(wrench, forces=wrench.forces[chosen], moments=wrench.moments[chosen])
        for wrench in contacts.measured
    )
    return replace(
        contacts,
        activations=contacts.activations.frames(chosen),
        preferred=preferred,
        measured=measured,
    )


# How far an unmeasured muscle leaves what synergies say of it, standard deviation [activation]
UNMEASURED = 0.1
UNKNOWN = 0.3  # The same of a measured muscle while its channels are silent
NEAR = 0.5
WEIGHT = 0.03
"""How far the weights of an unmeasured muscle lie from those of muscles that act as it does: share,
and activation.
"""
# Power of the cosine between what two muscles do at the joints, by which one counts for the other
LIKE = 4.0
REST = 0.05  # Activation at rest: scale of a half-normal prior
LEVEL = 0.4
COMMON = 1.0
SHARED = 0.7
APART = 0.5
"""Prior of gains: median of the activation at a channel's largest envelope where every channel is
in units of its own; median of the gain where all are in common units, as of maximum contractions;
standard deviations of the logarithm of what all channels share, and of each about it. Torque
decides where it says anything; this decides where it does not.
"""
# Largest envelopes that differ by no more than this factor are taken to be each channel's unit
ALIKE = 1.5
AT_MAXIMUM = 0.9
NEAR_MAXIMUM = 0.2
"""Median of the activation in a maximum voluntary contraction, and standard deviation of its
logarithm.
"""
SURE = 0.01
ROUGH = 0.1  # Error of a torque in shares of its RMS: least that is believed, and first guess
KEPT = 0.01
MAX_NOISE = 0.5
"""Of a correction for noise: share of the normal matrix that it leaves, and of a channel that it
may take.
"""
ROUNDS = 5
CLOCK = 0.01
EARLIER = 0.6
"""Of the courses of synergies: step of their clock, and how far it begins before the motion [s]."""


class Prior(NamedTuple):
    """Normal prior of the logarithm of gains (channels,): mean, precision, and upper bound."""

    mean: Array
    precision: Array
    upper: Array


def gain_prior(peaks: Array, maxima: Array, shared: float = SHARED) -> Prior:
    """Prior of log gains (channels,).
    `peaks` (channels,) largest envelope over all trials; `maxima` (channels,) envelope in a maximum
    voluntary contraction, NaN where none was measured; `shared`: standard deviation of what all
    channels share.
    """
    known = np.isfinite(maxima)
    alive = peaks > 0.0
    largest = np.where(known, maxima, np.where(alive, peaks, 1.0))
    own = np.ptp(np.log(peaks[alive])) < np.log(ALIKE) if alive.any() else True
    usual = np.log(LEVEL) - np.log(largest) if own else np.full(len(peaks), np.log(COMMON))
    upper = -np.log(largest)
    mean = np.where(known, np.log(AT_MAXIMUM) + upper, np.minimum(usual, upper))
    level = np.where(known, 0.0, shared)
    spread = np.where(known, NEAR_MAXIMUM, APART)
    covariance = np.diag(spread**2) + np.outer(level, level)
    return Prior(mean, np.linalg.inv(covariance), upper)


class Fit(NamedTuple):
    """The most probable gains and what belongs to them."""

    cost: float  # minus the logarithm of the posterior, at the errors of torques that were assumed
    # gains, offsets: (channels,)
    gains: Array
    offsets: Array
    # gains, offsets where channels may have any, weights of the synergies in muscles without EMG
    parameters: Array
    deviation: Array  # (channels,) standard deviation of the gains' logarithms
    misfit: float  # the part of the cost that is of torques, without that of the priors


@read_only
class Group:
    """Unmeasured muscles that share joints with some channels, and these channels' synergies."""

    synergies: Synergies  # of the channels
    # channels, muscles: their columns among all channels, and all muscles
    channels: np.ndarray
    muscles: np.ndarray
    # (muscles, channels) how much of an unmeasured muscle's activation each channel's is, see
    # `alike`
    like: Array


def action_cosines(frames: Sequence[TrackedFrames]) -> Array:
    """(muscles, muscles) cosine between what muscles do at the joints over all frames."""
    product = np.asarray(sum(frame.gram for frame in frames))
    size = np.sqrt(np.maximum(np.diag(product), 1e-300))
    return np.asarray(product / np.outer(size, size))


def alike(frames: Sequence[TrackedFrames], muscles: np.ndarray, tells: Array) -> Array:
    """(muscles, channels) shares in which channels stand for unmeasured muscles: by what these do
    at the joints. `tells` (all muscles, channels) True where a channel measures a muscle.
    """
    cosine = np.maximum(action_cosines(frames)[muscles], 0.0)
    near = (cosine @ tells) / np.maximum(tells.sum(axis=0), 1.0)
    strong = near**LIKE
    return (
        strong
        / np.maximum(strong.sum(axis=1, keepdims=True), 1e-300)
        * near.max(axis=1, keepdims=True)
    )


class TorqueTracking:
    """The regression over all trials.
    `frames`: of all trials; `tells` (muscles, channels) True where a channel measures a muscle;
    `groups`: synergies for unmeasured muscles; `prior`: of the gains; `offsets`: whether channels
    may have an activation at rest; `errors`: of the torques, and what a frame is worth, where they
    are known from elsewhere; `noise` (channels,) standard deviation of noise in the envelopes; it
    makes gains smaller unless that is corrected.
    """

    def __init__(
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
        self._least = np.maximum(
            SURE * self._rms, 1e-6 * max(float(self._rms.max(initial=0.0)), 1e-6)
        )
        self.errors = errors or (np.maximum(ROUGH * self._rms, self._least), 0.1)
        self._white: list[tuple[Array, Array]] = []
        self.noise = np.zeros(tells.shape[1]) if noise is None else noise
        self._excess = np.zeros(tells.shape[1])
        self._courses = [[_courses(frame, group) for group in groups] for frame in frames]
        self._log_gains = np.minimum(prior.mean, prior.upper)

    def learn_errors(self, delays: Array, shapes: Array, prior: Prior | None = None) -> None:
        """Errors of the torques from what is left of them, by expectation maximization at a delay
        and shape.
        """
        for _ in range(ROUNDS):
            self.whiten(delays)
            fit = self.fit(delays, shapes, prior)
            sigma, share = self.errors
            squares = np.zeros_like(sigma)
            count = 0
            worth = []
            excess = np.zeros_like(self._excess)
            for index, frame in enumerate(self.frames):
                good, covariance = self._covariance(frame, delays)
                left = self._left(index, fit, delays, shapes)[good]
                inverse = np.linalg.inv(covariance)
                error = sigma**2 * np.einsum("kij,kj->ki", inverse, left)
                rest = sigma**2 - sigma**4 * np.einsum("kii->ki", inverse)
                squares = squares + np.sum(error**2 + rest, axis=0)
                count = count + len(left)
                mixed = self._mixed(frame, delays)[good]
                excess += np.sum(np.einsum("krc,kr->kc", mixed, error / sigma**2) ** 2, axis=0)
                worth += [
                    independent_samples(e, e) / len(e)
                    for e in error.T
                    if len(e) > 8 and np.std(e) > 0.0
                ]
            sigma = np.maximum(np.sqrt(np.maximum(squares, 0.0) / max(count, 1)), self._least)
            self.errors = (sigma, float(np.median(worth)) if worth else share)
            self._excess = excess * self.noise**2
        self.whiten(delays)

    def fit(self, delays: Array, shapes: Array, prior: Prior | None = None) -> Fit:
        """The most probable gains at delays (channels,) [s] and shape factors (channels,), by a
        prior.
        """
        designs = [
            self._rows(columns, index, delays, shapes)
            for index, (columns, _) in enumerate(self._white)
        ]
        size = designs[0].shape[2]
        matrix = np.zeros((size, size))
        slope = np.zeros(size)
        square = 0.0
        for rows, (_, torques) in zip(designs, self._white, strict=True):
            design = rows.reshape(-1, size)
            target = torques.reshape(-1)
            matrix += design.T @ design
            slope += design.T @ target
            square += float(target @ target)
        worth = self.errors[1]
        return self._most_probable(
            worth * matrix, worth * slope, worth * square, prior or self.prior
        )

    def _covariance(self, tracked_frames: TrackedFrames, delays: Array) -> tuple[np.ndarray, Array]:
        """Frames (frames,) in which some channel is known, and C of these (frames, rows, rows)."""
        known = np.isfinite(shifted(tracked_frames.emg, tracked_frames.time, delays))
        good: np.ndarray = np.asarray(known.any(axis=1))
        silent = (known[good].astype(float) @ self.tells[self.measured].T) == 0.0
        spread = np.full((int(good.sum()), tracked_frames.columns.shape[2]), UNMEASURED)
        spread[:, self.measured] = np.where(silent, UNKNOWN, 0.0)
        doubt = self._mixed(tracked_frames, delays)[good] * (np.exp(self._log_gains) * self.noise)
        acting = np.concatenate(
            [tracked_frames.columns[good] * spread[:, None], tracked_frames.others[good], doubt],
            axis=2,
        )
        return good, acting @ acting.transpose(0, 2, 1) + np.diag(self.errors[0] ** 2)

    def _mixed(self, tracked_frames: TrackedFrames, delays: Array) -> Array:
        """Generalized force of an envelope of 1 at a gain of 1, (frames, rows, channels)."""
        known = np.isfinite(shifted(tracked_frames.emg, tracked_frames.time, delays))
        return np.einsum(
            "krm,kmc->krc", tracked_frames.columns[..., self.measured], self._shares(known)
        )

    def _shares(self, known: Array) -> Array:
        """(frames, measured, channels) of the known channels (frames, channels) in each muscle's
        activation.
        """
        tells = self.tells[self.measured]
        return known[:, None] * tells / np.maximum(known.astype(float) @ tells.T, 1.0)[..., None]

    def whiten(self, delays: Array) -> None:
        """Columns and torques in units of what is unknown: L^-1 A, L^-1 tau with C = L L^T; 0 where
        no EMG is.
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
        """Generalized force of one unit of each parameter, (frames, rows, parameters)."""
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
        """Torques (frames, rows) that the fit leaves."""
        rows = self._rows(self.frames[index].columns, index, delays, shapes)
        return self.frames[index].torques - rows @ fit.parameters

    def _ridge(self, size: int, prior: Prior) -> Array:
        """Precision of the prior of offsets and weights (parameters, parameters), gains aside.
        The weights of an unmeasured muscle are near those of the measured muscles that act as it
        does.
        """
        count = self.tells.shape[1]
        rows = [np.eye(size)[count : 2 * count] / REST] if self.offsets else []
        start = count * (2 if self.offsets else 1)
        for group in self.groups:
            shape = (len(group.muscles), len(group.synergies))
            part = np.zeros((shape[0] * shape[1], size))
            part[:, start : start + len(part)] = np.eye(len(part))
            like = np.einsum(
                "uc,sc->usc", group.like, group.synergies.vectors * group.synergies.scale
            )
            like = like.reshape(-1, len(group.channels))
            part[:, group.channels] = -like
            usual = like @ np.exp(np.minimum(prior.mean, prior.upper)[group.channels])
            rows.append(part / (NEAR * usual + WEIGHT)[:, None])
            start += len(part)
        whole = np.vstack([np.zeros((0, size)), *rows])
        return whole.T @ whole

    def _corrected(self, matrix: Array, ridge: Array) -> Array:
        """Normal matrix (parameters, parameters) without what noise of the envelopes adds to it, as
        far as that goes. Where channels say little more than their noise, all of it cannot be taken
        off.
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

    def _most_probable(self, matrix: Array, slope: Array, square: float, prior: Prior) -> Fit:
        """Gauss-Newton steps on the prior of log gains; each is a non-negative least squares
        problem.
        """
        mean, precision, upper = prior
        count = len(mean)
        size = len(slope)
        ridge = self._ridge(size, prior)
        matrix = self._corrected(matrix, ridge)
        # From the gains of the last fit, which are near where delays differ little.
        log_gains = self._log_gains
        x = np.zeros(size)
        for _ in range(20):
            gains = np.exp(log_gains)
            whole = matrix + ridge
            right = slope.copy()
            whole[:count, :count] += precision / np.outer(gains, gains)
            right[:count] += (precision @ (1.0 - log_gains + mean)) / gains
            x = _bounded(
                whole, right, np.concatenate([np.exp(upper), np.full(size - count, np.inf)])
            )
            # The prior is straightened about the step before: steps are kept to a factor of 3.
            moved = np.log(np.clip(x[:count] / gains, 1.0 / 3.0, 3.0)) + log_gains
            done = float(np.abs(moved - log_gains).max(initial=0.0)) < 1e-5
            log_gains = np.minimum(moved, upper)
            if done:
                break
        gains = np.exp(log_gains)
        self._log_gains = log_gains
        x[:count] = gains
        apart = log_gains - mean
        misfit = 0.5 * float(square - 2.0 * slope @ x + x @ matrix @ x)
        cost = misfit + 0.5 * float(apart @ precision @ apart) + 0.5 * float(x @ ridge @ x)
        free = np.flatnonzero((x > 0.0) | (np.arange(size) < count))
        scale = np.concatenate([gains, np.ones(size - count)])[free]
        curved = (matrix + ridge)[np.ix_(free, free)] * np.outer(scale, scale)
        curved[:count, :count] += precision
        deviation = np.sqrt(np.diag(np.linalg.inv(curved))[:count])
        offsets = x[count : 2 * count] if self.offsets else np.zeros(count)
        weights = slice(count + self.offsets * count, None)
        x[weights] = np.minimum(x[weights], 1.0)
        return Fit(
            cost=cost,
            gains=gains,
            offsets=offsets,
            parameters=x,
            deviation=deviation,
            misfit=misfit,
        )


def _courses(tracked_frames: TrackedFrames, group: Group) -> Emg:
    """Courses of a group's synergies on a coarse clock of the EMG, as far as delays may reach."""
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


def _bounded(matrix: Array, right: Array, upper: Array) -> Array:
    """The least x^T M x / 2 - r^T x with 0 <= x <= upper; the bounds above are few, and met one
    after the other.
    """
    held = np.zeros(len(right), dtype=bool)
    while True:
        x = np.where(held, upper, 0.0)
        free = ~held
        part = matrix[np.ix_(free, free)]
        part = part + 1e-12 * np.trace(part) / max(len(part), 1) * np.eye(len(part))
        lower = np.linalg.cholesky(part)
        left = right[free] - matrix[np.ix_(free, held)] @ upper[held]
        target = scipy.linalg.solve_triangular(lower, left, lower=True)
        x[free] = scipy.optimize.nnls(lower.T, target, maxiter=30 * len(part))[0]
        over = free & (x > upper * (1.0 + 1e-9))
        if not over.any():
            return x
        held |= over
