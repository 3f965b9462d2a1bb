"""Muscles from recordings: torques that have to be borne, with activations known as well as EMG tells them.

    tau = R^T F(p, a) + e_tau,   a = g e + e_a   (or a = l + e_a where no EMG is),   p = prior + e_p

Of every frame the activations are marginalized to first order: with G = R^T dF/da the misfit r has the covariance
S = var(e_tau) + G var(a) G^T, so that least effort weighs no more than what is known of activations says. Gauss-Newton
steps in p use S^-1; activations follow as their mean given p, within 0 and 1. Errors of neighbouring frames are alike:
frames count by 1 / (1 + 2 sum rho_k), rho_k the correlation of the whitened misfit over k frames. Errors of
torques and activations are estimated beside p from the squared misfits (Rasmussen and Williams 2006 for the marginal).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.tension.personal.curves import MuscleShapes
from myomorph.tension.personal.fibers import Followed, follow, rigid_lengths
from myomorph.tension.personal.prior import OUTSIDE, PHYSIOLOGICAL, Prior
from myomorph.tension.personal.recordings import Windows

STEPS = 30
TRUSTING = (4, 16)
"""First steps, in which errors are what was assumed of them: at least and, while steps are still long, at most."""
SHORTEST_ERROR, LONGEST_ERROR = 10, 50
"""Frames over which errors are taken to be alike at least and at most."""
SETTLED = 0.05
"""Steps end where no parameter moves by more of its standard deviation."""
LONGEST = 1.0
"""Step of a parameter, in standard deviations before the recordings."""
LEVEL, UNKNOWN = 0.1, 0.15
"""Of a muscle without EMG: mean activation expected, itself a parameter, and standard deviation over time; walking has
root mean squares of 0.1 to 0.25."""
EMG_LEAST, EMG_SHARE = 0.03, 0.15
"""Standard deviation of an activation that EMG tells: this much, and a share of it."""
LEAST_OWN = 0.5
"""Share of the variance of EMG over time that is activation's at least."""
REST = 0.003
"""Standard deviation of an activation at rest."""
REST_ERROR, REST_FLOOR = 0.01, 0.1
"""Least standard deviation of a measured passive torque: a share of its root mean square, and in N m or N."""
SCALES = (0.1, 9.0)
"""Within which the variances of activations are adjusted to the misfits."""
ACTIVE_SETS = 16
"""Newton steps for the activations that stand at 0 or 1."""
FIRST_ERRORS = 5.0
"""Of the least errors of torques: with which the fit begins, so that it does not run after each of them at first."""
HASTE, CHANGES = 2.0, (0.6, 1.25)
"""Power of the steps by which errors change, and the least and largest factor of a step."""
MORE = 1e-3
"""Of activation, for the slopes of what an activation gives."""
MOST_ERROR = 0.5
"""Of the root mean square of a torque: more of it is not taken for an error."""


@read_only
@dataclass(frozen=True, eq=False)
class Noise:
    """How far off torques and activations are.

    Attributes
    ----------
    torque : (rows,) standard deviation [N m or N]
    rest : (rows,) of measured passive torques: none of the errors of inverse dynamics are theirs [N m or N]
    told : factor on the variance of activations that EMG tells
    """

    torque: Array
    rest: Array
    told: float = 1.0


@read_only
@dataclass(frozen=True, eq=False)
class Fitted:
    """Parameters, how sure they are, and what became of the recordings.

    Attributes
    ----------
    p : (parameters,) see `Prior`
    covariance : (parameters, parameters) after the recordings
    noise : errors of torques and activations that the misfits show
    activations : of each recording, (windows, frames, muscles)
    weights : of each recording: what a frame counts
    steps : done; `moved` the last one's largest, in standard deviations
    """

    p: Array
    covariance: Array
    noise: Noise
    activations: tuple[Array, ...]
    weights: tuple[float, ...]
    steps: int
    moved: float


def fit(
    prior: Prior,
    shapes: MuscleShapes,
    windows: Sequence[Windows],
    floors: Array,
    free: np.ndarray | None = None,
    advance: Callable[[int], None] | None = None,
    steps: int = STEPS,
) -> Fitted:
    """The most probable parameters given the recordings.

    Parameters
    ----------
    floors : (rows,) least standard deviation of the torques
    free : (parameters,) which ones are estimated; None for all that have a prior spread
    advance : called with the number of steps just done
    steps : at most
    """
    free = (prior.deviation > 0.0) if free is None else free & (prior.deviation > 0.0)
    parts = [_Part(prior, shapes, one) for one in windows]
    floors_at_rest = _floors_at_rest(parts, floors)
    p, noise = np.zeros(len(prior.deviation)), Noise(FIRST_ERRORS * floors, FIRST_ERRORS * floors_at_rest)
    covariance = np.asarray(np.linalg.inv(prior.precision), dtype=np.float64)
    moved, done, shrink, trusting = np.inf, 0, 1.0, True
    damping, settled, before = 1.0, 0, np.zeros(len(p))
    for done in range(1, steps + 1):
        normal, right = prior.precision.copy(), -prior.precision @ p
        for part in parts:
            part.linearize(p, noise)
            weight = shrink * part.weight
            normal += weight * part.jacobian.T @ part.jacobian
            right += weight * (part.jacobian.T @ part.misfit - part.widening)
        rows, misfit = _outside(prior, shapes, windows, p)
        normal += rows.T @ rows
        right += rows.T @ misfit
        covariance = np.zeros_like(normal)
        covariance[np.ix_(free, free)] = np.linalg.inv(normal[np.ix_(free, free)])
        step = covariance @ right
        longest = float((np.abs(step) / np.maximum(prior.deviation, 1e-12))[free].max(initial=0.0))
        # Activations that reach a bound and leave it in turns make steps go back and forth.
        damping = 0.5 * damping if step @ before < 0.0 else min(1.5 * damping, 1.0)
        step *= min(damping, LONGEST / max(longest, 1e-12))
        new = prior.kept(p + step)
        step, before, p = new - p, step, new
        for part in parts:
            part.settle(step)
        # Before the parameters have found their places, misfits are theirs and not errors of the recordings.
        trusting = trusting and (done < TRUSTING[0] or (longest > LONGEST and done < TRUSTING[1]))
        if not trusting:
            better = _noise_at_rest(parts, _noise(parts, noise, floors, covariance), floors_at_rest, covariance)
            noise = _hastened(noise, better, floors, floors_at_rest)
            for part in parts:
                part.weigh()
            shrink = _left_to_errors(parts, float(np.sum(free) - np.trace(covariance @ prior.precision)))
        spread = np.sqrt(np.maximum(np.diag(covariance), 1e-12))
        moved = float((np.abs(step) / spread)[free].max(initial=0.0))
        if advance is not None:
            advance(1)
        settled = 0 if trusting or moved >= SETTLED * damping else settled + 1
        if settled == 3:
            break
    told = tuple(part.activations for part in parts), tuple(shrink * part.weight for part in parts)
    return Fitted(p, covariance, noise, *told, done, moved)


@read_only
@dataclass(frozen=True, eq=False)
class Checked:
    """How well muscles explain recordings.

    Attributes
    ----------
    score : negative logarithm of the marginal probability, per frame
    left : (rows,) root mean square of the torque that activations within what is known of them leave [N m or N]
    """

    score: float
    left: Array


def check(prior: Prior, shapes: MuscleShapes, windows: Sequence[Windows], p: Array, noise: Noise) -> Checked:
    """How well parameters explain recordings that they need not have been fitted to."""
    score, frames = 0.0, 0
    left, known = np.zeros(len(noise.torque)), np.zeros(len(noise.torque))
    for one in windows:
        part = _Part(prior, shapes, one)
        scores = []
        for _ in range(6):
            part.linearize(p, noise)
            scores.append(part.score())
            part.settle(np.zeros(len(p)))
        part.linearize(p, noise)
        # Activations that change their bounds at once can spoil a single pass.
        score += min(*scores[3:], part.score())
        frames += int(one.counted.sum())
        left += np.sum(part.plain**2, axis=0)
        known += np.sum(part.known, axis=0)
    return Checked(score / frames, np.sqrt(left / np.maximum(known, 1)))


def _times(matrices: Array, vectors: Array) -> Array:
    """Products of each frame's matrix and vector."""
    return (matrices @ vectors[..., None])[..., 0]


class _Part:
    """One recording at the present parameters and activations.

    Attributes
    ----------
    jacobian, misfit : whitened, (frames rows, parameters) and (frames rows,)
    weight : what a frame counts
    plain : (frames, rows) torque left at the present activations
    """

    def __init__(self, prior: Prior, shapes: MuscleShapes, windows: Windows):
        self.prior, self.shapes, self.windows = prior, shapes, windows
        self.told = np.isfinite(windows.emg)
        self.envelope = np.where(self.told, windows.emg, LEVEL)
        self.activations = np.clip(np.where(self.told, windows.emg, 0.05), 0.0, 1.0)
        self.torques = windows.torques[windows.counted]
        # Torques that were not measured are left out: their rows have no muscles, no misfit and an error of 1.
        self.known = np.isfinite(self.torques)
        self.torques = np.where(self.known, self.torques, 0.0)
        self.arms = np.where(self.known[..., None], windows.arms[windows.counted], 0.0)
        self.rest = not np.isfinite(windows.step)
        self.weight = 0.2

    def _of(self, values: Array) -> Array:
        return values[self.windows.counted]

    def linearize(self, p: Array, noise: Noise) -> None:
        """Follow the fibers, and whiten the misfit and its slopes."""
        w, prior = self.windows, self.prior
        sizes = prior.sizes(p)
        followed = follow(self.shapes, sizes, w.lengths, w.speeds, self.activations, w.step)
        at = Followed(*(self._of(one) for one in followed))
        gains, told, now = prior.gains_of(p), self._of(self.told), self._of(self.activations)
        expected, variance = self._known_activations(gains, noise, told)
        if self.rest:
            variance = np.full_like(variance, REST**2)
        self.plain = self.torques - _times(self.arms, at.force)
        self.columns = self.arms * at.by_activation[:, None]
        self.of_torque = np.where(self.known, noise.rest**2 if self.rest else noise.torque**2, 1.0)
        S = self._bounded(now, expected, variance)
        self.whiten = np.linalg.inv(np.linalg.cholesky(S))
        self.covariance = S
        white = _times(self.whiten, self.error)
        jacobian = self._jacobian(at, sizes.fiber, sizes.strain, p, expected)
        more = follow(self.shapes, sizes, w.lengths, w.speeds, self.activations + MORE, w.step)
        self.widening = self._widening(at, Followed(*(self._of(one) for one in more)), sizes.fiber, sizes.strain, p)
        self.jacobian = (self.whiten @ jacobian).reshape(-1, len(p))
        self.slopes, self.misfit = jacobian, white.ravel()
        self.white = white

    def _known_activations(self, gains: Array, noise: Noise, told: np.ndarray) -> tuple[Array, Array]:
        """Mean and variance of activations (frames, muscles) before the torques are looked at.

        EMG has errors, so that its peaks are higher and its lows lower than those of activations: what is expected lies
        towards its mean (regression calibration, Carroll et al. 2006, ch. 4).
        """
        # Where EMG is missing for a while, its gain says nothing of the level.
        factors = np.where(told | (self.prior.gain >= len(self.prior.gains)), gains, 1.0)
        level = np.clip(factors * self._of(self.envelope), 0.0, 1.0)
        scaled = np.where(told, level, 0.0)
        variance = np.where(told, noise.told * (EMG_LEAST**2 + (EMG_SHARE * scaled) ** 2), UNKNOWN**2)
        counts = np.maximum(told.sum(axis=0), 1)
        mean = scaled.sum(axis=0) / counts
        between = np.sum(np.where(told, (scaled - mean) ** 2, 0.0), axis=0) / counts
        own = np.maximum(between - np.sum(np.where(told, variance, 0.0), axis=0) / counts, LEAST_OWN * between)
        share = np.where(told, own / np.maximum(own + variance, 1e-12), 1.0)
        return np.where(told, mean + share * (scaled - mean), level), share * variance

    def _bounded(self, now: Array, expected: Array, variance: Array) -> Array:
        """Covariance S of the misfit of activations within 0 and 1: those at a bound have no part in it.

        The least of |a - m|^2 / var(a) + |e_tau|^2 / var(e_tau), by Newton steps in the multipliers y of the balance:
        a = clip(m + var(a) G^T y), e_tau = var(e_tau) y.
        """
        y = np.zeros_like(self.plain)
        fixed = np.zeros(now.shape, np.int8)
        for k in range(ACTIVE_SETS):
            held = fixed != 0
            self.variance = np.where(held, 0.0, variance)
            self.expected = np.where(held, (fixed > 0).astype(np.float64), expected)
            self.error = self.plain + _times(self.columns, now - self.expected)
            spread = self.columns * self.variance[:, None]
            S = spread @ self.columns.transpose(0, 2, 1) + self.of_torque[..., None] * np.eye(self.of_torque.shape[1])
            new = np.linalg.solve(S, self.error[..., None])[..., 0]
            y = new if k < ACTIVE_SETS // 2 else 0.5 * (y + new)
            wanted = expected + variance * _times(self.columns.transpose(0, 2, 1), y)
            before, fixed = fixed, np.where(wanted < 0.0, -1, np.where(wanted > 1.0, 1, 0)).astype(np.int8)
            if np.array_equal(before, fixed):
                break
            if k == ACTIVE_SETS - 2:
                # Where bounds are still taken in turns, nothing is held: that leaves more open, not less.
                fixed = np.where(before == fixed, fixed, 0).astype(np.int8)
        self.gain = np.linalg.solve(S, spread)  # S^-1 G var(a)
        return S

    def _widening(self, at: Followed, more: Followed, fiber: Array, strain: Array, p: Array) -> Array:
        """(parameters,) slopes of half the logarithm of det S.

        Activations that follow the torque make its slopes in the parameters follow its errors: without this term,
        whatever widens S would seem the more probable.
        """
        prior = self.prior
        by_fiber, by_point, by_force, by_strain, _ = prior.parts
        # tr(S^-1 G var(a) dG^T): a muscle's column depends on its own parameters alone.
        share = np.sum(self.gain * self.arms, axis=1)
        of_fiber, of_slack, of_strain = (
            np.sum(share * (after - before), axis=0) / MORE
            for before, after in (
                (at.by_fiber, more.by_fiber),
                (at.by_slack, more.by_slack),
                (at.by_strain, more.by_strain),
            )
        )
        found = np.zeros(len(p))
        found[by_fiber] = (of_fiber - of_slack * (prior.point + p[by_point])) * fiber
        found[by_point] = -of_slack * fiber
        of_force = np.sum(share * at.by_activation, axis=0)
        for part, values in ((by_force, of_force), (by_strain, of_strain * strain)):
            found[part] = np.bincount(prior.group, values, minlength=len(prior.groups))
        return found

    def _jacobian(self, at: Followed, fiber: Array, strain: Array, p: Array, expected: Array) -> Array:
        """(frames, rows, parameters) slopes of the torque."""
        prior = self.prior
        by_fiber, by_point, by_force, by_strain, by_gain = prior.parts
        point = prior.point + p[by_point]
        jacobian = np.zeros((*self.torques.shape, len(p)))
        of_fiber = at.by_fiber * fiber - at.by_slack * point * fiber
        jacobian[..., by_fiber] = self.arms * of_fiber[:, None]
        jacobian[..., by_point] = -self.arms * (at.by_slack * fiber)[:, None]
        of_force, of_strain = self.arms * at.force[:, None], self.arms * (at.by_strain * strain)[:, None]
        follows = self._of(self.told) | (prior.gain >= len(prior.gains))
        of_gain = self.columns * np.where(follows, expected, 0.0)[:, None]
        for part, values, index, count in (
            (by_force, of_force, prior.group, len(prior.groups)),
            (by_strain, of_strain, prior.group, len(prior.groups)),
            (by_gain, of_gain, prior.gain, len(prior.gains) + prior.levels),
        ):
            members = index[:, None] == np.arange(count)
            jacobian[..., part] = values @ members.astype(np.float64)
        return jacobian

    def weigh(self) -> None:
        """What a frame counts, by how alike the misfits of neighbouring frames are."""
        frames = np.full((*self.windows.counted.shape, self.white.shape[1]), np.nan)
        frames[self.windows.counted] = np.where(self.known, self.white, np.nan)
        square, length = np.nanmean(frames**2), 1.0
        for lag in range(1, min(LONGEST_ERROR, frames.shape[1] // 2)):
            pairs = frames[:, :-lag] * frames[:, lag:]
            known = np.isfinite(pairs)
            rho = float(pairs[known].sum()) / max(int(known.sum()), 1) / max(square, 1e-12)
            if rho < 0.05:
                break
            length += 2.0 * rho
        # Poses held still may be in any order.
        self.weight = 0.5 * (self.weight + 1.0 / max(length, 1.0 if self.rest else SHORTEST_ERROR))

    def settle(self, step: Array) -> None:
        """Activations given the recording, after a step of the parameters."""
        error = self.error - self.slopes @ step
        wanted = self.expected + _times(self.gain.transpose(0, 2, 1), error)
        new = self.activations.copy()
        now = new[self.windows.counted]
        new[self.windows.counted] = np.clip(now + np.clip(np.clip(wanted, 0.0, 1.0) - now, -0.2, 0.2), 0.0, 1.0)
        self.activations = new

    def score(self) -> float:
        """Half the whitened misfit and the logarithm of the spread, summed over frames."""
        _, logarithm = np.linalg.slogdet(self.covariance)
        return float(0.5 * np.sum(self.misfit**2) + 0.5 * np.sum(logarithm))


def _left_to_errors(parts: Sequence[_Part], effective: float) -> float:
    """Share of the independent misfits that the parameters do not follow, twice: so much less is known than it looks.

    Once because the misfits are smaller for it, and once because what is followed is slow: left misfits are alike over
    a shorter time than errors are.
    """
    seen = sum(part.weight * part.known.sum() for part in parts)
    return float(np.clip(1.0 - effective / max(seen, 1e-12), 0.5, 1.0)) ** 2


def _noise(parts: Sequence[_Part], noise: Noise, floors: Array, covariance: Array) -> Noise:
    """Errors of torques and of EMG as their means given the misfits (a step of expectation and maximization)."""
    moving = [one for one in parts if not one.rest]
    if not moving:
        return noise
    squares, carried, frames = np.zeros(len(noise.torque)), np.zeros(len(noise.torque)), 0
    apart, known = 0.0, 0.0
    for part in moving:
        among, mean_squares = _torque_errors(part, covariance)
        squares += mean_squares
        carried += np.sum(part.torques**2, axis=0)
        frames += len(part.error)
        free = part.told[part.windows.counted] & (part.variance > 0.0)
        moved = _times(part.gain.transpose(0, 2, 1), part.error)
        after = part.variance - part.variance * np.einsum("frm,frm->fm", part.gain, part.columns)
        after = after + np.einsum("frm,frm->fm", part.gain, among @ part.gain)
        own = np.where(free, part.variance, 1.0) / noise.told
        apart += float(np.sum(np.where(free, (moved**2 + after) / own, 0.0)))
        known += float(free.sum())
    most = np.maximum(MOST_ERROR**2 * carried / frames, floors**2)
    torque = np.sqrt(np.clip(squares / frames, floors**2, most))
    told = float(np.clip(apart / known, *SCALES)) if known else 1.0
    return replace(noise, torque=torque, told=told)


def _hastened(old: Noise, new: Noise, floors: Array, floors_at_rest: Array) -> Noise:
    """A longer step of expectation and maximization, whose own steps are short where much of a misfit is errors'.

    Upwards it is a short one: a misfit that the parameters have yet to follow is no error.
    """
    torque, rest, told = (
        one * np.clip((other / one) ** HASTE, *CHANGES)
        for one, other in ((old.torque, new.torque), (old.rest, new.rest), (old.told, new.told))
    )
    return Noise(np.maximum(torque, floors), np.maximum(rest, floors_at_rest), float(np.clip(told, *SCALES)))


def _torque_errors(part: _Part, covariance: Array) -> tuple[Array, Array]:
    """What parameters leave open of each frame's torques (frames, rows, rows), and summed squares of errors (rows,)."""
    solved = np.linalg.inv(part.covariance)
    # What the parameters leave open is no part of the errors, but of what is known of them.
    among = part.slopes @ covariance @ part.slopes.transpose(0, 2, 1)
    by_torque = part.of_torque[..., None] * solved
    mean = _times(by_torque, part.error)
    left = part.of_torque - part.of_torque * np.einsum("frr->fr", by_torque)
    left += np.einsum("frs,fst,frt->fr", by_torque, among, by_torque)
    return among, np.sum(np.where(part.known, mean**2 + left, 0.0), axis=0)


def _floors_at_rest(parts: Sequence[_Part], floors: Array) -> Array:
    """(rows,) least error of measured passive torques [N m or N]."""
    still = [one for one in parts if one.rest]
    if not still:
        return np.full(len(floors), REST_FLOOR)
    counts = np.maximum(np.sum([one.known.sum(axis=0) for one in still], axis=0), 1)
    squares = np.sum([np.sum(one.torques**2, axis=0) for one in still], axis=0)
    return np.maximum(np.minimum(REST_FLOOR, floors), REST_ERROR * np.sqrt(squares / counts))


def _noise_at_rest(parts: Sequence[_Part], noise: Noise, floors: Array, covariance: Array) -> Noise:
    """Errors of measured passive torques, among them what is no muscle's: ligaments, capsules, the poses' errors."""
    still = [one for one in parts if one.rest]
    if not still:
        return noise
    counts = np.sum([one.known.sum(axis=0) for one in still], axis=0)
    squares = np.sum([_torque_errors(one, covariance)[1] for one in still], axis=0)
    rest = np.sqrt(squares / np.maximum(counts, 1))
    return replace(noise, rest=np.where(counts > 0, np.maximum(rest, floors), floors))


def _outside(prior: Prior, shapes: MuscleShapes, windows: Sequence[Windows], p: Array) -> tuple[Array, Array]:
    """Rows that pull muscles into physiological lengths, (2 muscles, parameters) and (2 muscles,)."""
    muscles = len(prior.names)
    every = np.concatenate([one.lengths[one.counted] for one in windows])
    ends = np.array([every.min(axis=0), every.max(axis=0)])
    sizes = prior.sizes(p)
    before, now = (rigid_lengths(shapes, one, ends) for one in (prior.start, sizes))
    low, high = np.minimum(PHYSIOLOGICAL[0], before[0]), np.maximum(PHYSIOLOGICAL[1], before[1])
    along = (ends - sizes.slack) / sizes.fiber
    slope = np.clip(along / np.maximum(now, 1e-6), 0.0, 1.0)
    rows, misfit = np.zeros((2 * muscles, len(p))), np.zeros(2 * muscles)
    index = np.arange(muscles)
    for k, beyond in enumerate((np.minimum(now[0] - low, 0.0), np.maximum(now[1] - high, 0.0))):
        out = (beyond != 0.0).astype(np.float64)
        rows[k * muscles + index, index] = -out * slope[k] * (ends[k] - prior.reference) / sizes.fiber / OUTSIDE
        rows[k * muscles + index, muscles + index] = out * slope[k] / OUTSIDE
        misfit[k * muscles : (k + 1) * muscles] = -beyond / OUTSIDE
    return rows, misfit
