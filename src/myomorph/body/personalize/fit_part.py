"""One recording at the present parameters.

Fibers are followed, activations marginalized, misfits whitened; see `fit`.
"""

from __future__ import annotations

import numpy as np

from myomorph.body.personalize.fibers import Followed, MuscleShapes, follow
from myomorph.body.personalize.prior import Prior
from myomorph.body.personalize.recordings import Windows
from myomorph.core.model.arrays import Array, read_only

SHORTEST_ERROR = 10
LONGEST_ERROR = 50  # Frames over which errors are taken to be alike at least and at most
LEVEL = 0.1
UNKNOWN = 0.15
"""Of a muscle without EMG: mean activation expected, itself a parameter, and standard deviation
over time; walking has root mean squares of 0.1 to 0.25.
"""
EMG_LEAST = 0.03
EMG_SHARE = 0.15  # Standard deviation of an activation that EMG shows: this much, and a share of it
LEAST_OWN = 0.5  # Share of the variance of EMG over time that is activation's at least
REST = 0.003  # Standard deviation of an activation at rest
ACTIVE_SETS = 16  # Newton steps for the activations that stand at 0 or 1
MORE = 1e-3  # Of activation, for the slopes of what an activation gives


@read_only
class Noise:
    """Errors of torques and activations.

    Attributes
    ----------
    torque : (rows,) standard deviation [N m or N]
    rest : (rows,) of measured passive torques: none of the errors of inverse dynamics are theirs [N
        m or N]
    emg : factor on the variance of activations that EMG shows
    """

    torque: Array
    rest: Array
    emg: float = 1.0


def frame_products(matrices: Array, vectors: Array) -> Array:
    """Multiply each frame's matrix and vector.

    Parameters
    ----------
    matrices : (frames, m, n)
    vectors : (frames, n)

    Returns
    -------
    (frames, m)
    """
    return (matrices @ vectors[..., None])[..., 0]


class Part:
    """One recording at the present parameters and activations.

    Of the frames that count, with muscles in columns and torques in rows:

    Attributes
    ----------
    activations : (windows, frames, muscles) of all frames
    known : (frames, rows) whether a torque was measured
    arms : (frames, rows, muscles) moment arms [m/rad or m/m], 0 where no torque was measured
    plain : (frames, rows) torque left at the present activations [N m or N]
    columns : (frames, rows, muscles) G, torque of a unit of activation
    covariance : (frames, rows, rows) S of the misfit
    jacobian, misfit : (frames rows, parameters), (frames rows,) whitened
    slopes : (frames, rows, parameters) of the torques
    weight : what a frame counts
    """

    def __init__(self, prior: Prior, shapes: MuscleShapes, windows: Windows):
        self.prior = prior
        self.shapes = shapes
        self.windows = windows
        self.measured = np.isfinite(windows.emg)
        self.envelope = np.where(self.measured, windows.emg, LEVEL)
        self.activations = np.clip(np.where(self.measured, windows.emg, 0.05), 0.0, 1.0)
        self.torques = windows.torques[windows.counted]
        # Torques that were not measured are left out: their rows have no muscles, no misfit and an
        # error of 1.
        self.known = np.isfinite(self.torques)
        self.torques = np.where(self.known, self.torques, 0.0)
        self.arms = np.where(self.known[..., None], windows.arms[windows.counted], 0.0)
        self.rest = not np.isfinite(windows.step)
        self.weight = 0.2

    def _of(self, values: Array) -> Array:
        return values[self.windows.counted]

    def linearize(self, p: Array, noise: Noise, slopes: bool = True, widening: bool = True) -> None:
        """Follow the fibers, and whiten the misfit.

        Parameters
        ----------
        p : (parameters,)
        noise : errors of torques and EMG
        slopes : whether slopes of the misfit are computed as well
        widening : whether those of the covariance are computed anew, which changes little from step
            to step
        """
        w = self.windows
        prior = self.prior
        sizes = prior.sizes(p)
        followed = follow(self.shapes, sizes, w.lengths, w.speeds, self.activations, w.step)
        at = self._followed(followed)
        gains = prior.gains_of(p)
        measured = self._of(self.measured)
        now = self._of(self.activations)
        expected, variance = self._known_activations(gains, noise, measured)
        if self.rest:
            variance = np.full_like(variance, REST**2)
        self.plain = self.torques - frame_products(self.arms, at.force)
        self.columns = self.arms * at.by_activation[:, None]
        self.of_torque = np.where(self.known, noise.rest**2 if self.rest else noise.torque**2, 1.0)
        S = self._bounded(now, expected, variance)
        self.whiten = np.asarray(np.linalg.inv(np.linalg.cholesky(S)), dtype=np.float64)
        self.covariance = S
        self.white = frame_products(self.whiten, self.error)
        self.misfit = self.white.ravel()
        if not slopes:
            self.slopes = np.zeros((*self.torques.shape, 0))
            return
        jacobian = self._jacobian(at, sizes.fiber, sizes.strain, p, expected)
        if widening:
            more = follow(self.shapes, sizes, w.lengths, w.speeds, self.activations + MORE, w.step)
            self.widening = self._widening(at, self._followed(more), sizes.fiber, sizes.strain, p)
        self.jacobian = (self.whiten @ jacobian).reshape(-1, len(p))
        self.slopes = jacobian

    def _followed(self, every: Followed) -> Followed:
        """Select the frames that count."""
        return Followed(
            force=self._of(every.force),
            length=self._of(every.length),
            by_fiber=self._of(every.by_fiber),
            by_slack=self._of(every.by_slack),
            by_strain=self._of(every.by_strain),
            by_activation=self._of(every.by_activation),
        )

    def _known_activations(
        self, gains: Array, noise: Noise, measured: np.ndarray
    ) -> tuple[Array, Array]:
        """Compute what is known of activations before the torques.

        EMG has errors, so that its peaks are higher and its lows lower than those of activations:
        what is expected lies towards its mean (regression calibration, Carroll et al. 2006, ch. 4).

        Parameters
        ----------
        gains : (muscles,) of EMG
        measured : (frames, muscles) whether EMG is known

        Returns
        -------
        (frames, muscles) mean and (frames, muscles) variance
        """
        # Where EMG is missing for a while, its gain says nothing of the level.
        factors = np.where(
            np.logical_or(measured, self.prior.gain >= len(self.prior.gains)), gains, 1.0
        )
        level = np.clip(factors * self._of(self.envelope), 0.0, 1.0)
        scaled = np.where(measured, level, 0.0)
        variance = np.where(
            measured, noise.emg * (EMG_LEAST**2 + (EMG_SHARE * scaled) ** 2), UNKNOWN**2
        )
        counts = np.maximum(measured.sum(axis=0), 1)
        mean = scaled.sum(axis=0) / counts
        between = np.sum(np.where(measured, (scaled - mean) ** 2, 0.0), axis=0) / counts
        own = np.maximum(
            between - np.sum(np.where(measured, variance, 0.0), axis=0) / counts,
            LEAST_OWN * between,
        )
        share = np.where(measured, own / np.maximum(own + variance, 1e-12), 1.0)
        return np.where(measured, mean + share * (scaled - mean), level), share * variance

    def _bounded(self, now: Array, expected: Array, variance: Array) -> Array:
        """Compute the covariance S of the misfit of activations within 0 and 1.

        Those at a bound have no part in it. The least of |a - m|^2 / var(a) + |e_tau|^2 /
        var(e_tau), by Newton steps in the multipliers y of the balance: a = clip(m + var(a) G^T y),
        e_tau = var(e_tau) y.

        Parameters
        ----------
        now : (frames, muscles) present activations
        expected, variance : (frames, muscles) m and var(a)

        Returns
        -------
        (frames, rows, rows)
        """
        y = np.zeros_like(self.plain)
        fixed = np.zeros(now.shape, np.int8)
        for index in range(ACTIVE_SETS):
            held = fixed != 0
            self.variance = np.where(held, 0.0, variance)
            self.expected = np.where(held, (fixed > 0).astype(np.float64), expected)
            self.error = self.plain + frame_products(self.columns, now - self.expected)
            spread = self.columns * self.variance[:, None]
            S = spread @ self.columns.transpose(0, 2, 1) + self.of_torque[..., None] * np.eye(
                self.of_torque.shape[1]
            )
            new = np.linalg.solve(S, self.error[..., None])[..., 0]
            y = new if index < ACTIVE_SETS // 2 else 0.5 * (y + new)
            wanted = expected + variance * frame_products(self.columns.transpose(0, 2, 1), y)
            before = fixed
            fixed = np.where(wanted < 0.0, -1, np.where(wanted > 1.0, 1, 0)).astype(np.int8)
            if np.array_equal(before, fixed):
                break
            if index == ACTIVE_SETS - 2:
                # Where bounds are still taken in turns, nothing is held: that leaves more open, not
                # less.
                fixed = np.where(before == fixed, fixed, 0).astype(np.int8)
        self.gain = np.asarray(np.linalg.solve(S, spread), dtype=np.float64)  # S^-1 G var(a)
        return S

    def _widening(
        self, at: Followed, more: Followed, fiber: Array, strain: Array, p: Array
    ) -> Array:
        """Compute slopes of half the logarithm of det S.

        Activations that follow the torque make its slopes in the parameters follow its errors:
        without this term, whatever widens S would seem the more probable.

        Parameters
        ----------
        at, more : muscles at the present activations, and at `MORE` above
        fiber, strain : (muscles,) optimal lengths [m] and strain factors
        p : (parameters,)

        Returns
        -------
        (parameters,)
        """
        prior = self.prior
        by_fiber, by_point, by_force, by_strain, _ = prior.parts
        # tr(S^-1 G var(a) dG^T): a muscle's column depends on its own parameters alone.
        share = np.sum(self.gain * self.arms, axis=1)
        of_fiber = np.sum(share * (more.by_fiber - at.by_fiber), axis=0) / MORE
        of_slack = np.sum(share * (more.by_slack - at.by_slack), axis=0) / MORE
        of_strain = np.sum(share * (more.by_strain - at.by_strain), axis=0) / MORE
        result = np.zeros(len(p))
        result[by_fiber] = (of_fiber - of_slack * (prior.point + p[by_point])) * fiber
        result[by_point] = -of_slack * fiber
        of_force = np.sum(share * at.by_activation, axis=0)
        for part, values in ((by_force, of_force), (by_strain, of_strain * strain)):
            result[part] = np.bincount(prior.group, values, minlength=len(prior.groups))
        return result

    def _jacobian(
        self, at: Followed, fiber: Array, strain: Array, p: Array, expected: Array
    ) -> Array:
        """Compute slopes of the torques in the parameters.

        Parameters
        ----------
        fiber, strain : (muscles,) optimal lengths [m] and strain factors
        p : (parameters,)
        expected : (frames, muscles) activations

        Returns
        -------
        (frames, rows, parameters)
        """
        prior = self.prior
        by_fiber, by_point, by_force, by_strain, by_gain = prior.parts
        point = prior.point + p[by_point]
        jacobian = np.zeros((*self.torques.shape, len(p)))
        of_fiber = at.by_fiber * fiber - at.by_slack * point * fiber
        jacobian[..., by_fiber] = self.arms * of_fiber[:, None]
        jacobian[..., by_point] = -self.arms * (at.by_slack * fiber)[:, None]
        of_force = self.arms * at.force[:, None]
        of_strain = self.arms * (at.by_strain * strain)[:, None]
        follows = np.logical_or(self._of(self.measured), prior.gain >= len(prior.gains))
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
        """Set what a frame counts, by how alike the misfits of neighboring frames are.

        1 / (1 + 2 sum rho_k) with the correlation rho_k of the whitened misfit over k frames.
        """
        frames = np.full((*self.windows.counted.shape, self.white.shape[1]), np.nan)
        frames[self.windows.counted] = np.where(self.known, self.white, np.nan)
        square = np.nanmean(frames**2)
        length = 1.0
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
        """Move activations to their mean given the recording, after a step of the parameters.

        Parameters
        ----------
        step : (parameters,); empty where slopes were not computed
        """
        error = self.error - self.slopes @ step
        wanted = self.expected + frame_products(self.gain.transpose(0, 2, 1), error)
        new = self.activations.copy()
        now = new[self.windows.counted]
        new[self.windows.counted] = np.clip(
            now + np.clip(np.clip(wanted, 0.0, 1.0) - now, -0.2, 0.2), 0.0, 1.0
        )
        self.activations = new

    def score(self) -> float:
        """Sum half the whitened misfit and the logarithm of the spread over frames."""
        _, logarithm = np.linalg.slogdet(self.covariance)
        return float(0.5 * np.sum(self.misfit**2) + 0.5 * np.sum(logarithm))
