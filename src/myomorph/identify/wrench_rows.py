"""Recordings as rows of least squares: [Y_B, constants, measured wrench], block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from myomorph.identify.base_parameters import BaseParameters
from myomorph.identify.factors import absorb
from myomorph.identify.householder import fold_frames
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.series import Motion, Wrenches
from myomorph.rigid.frames import over_frames
from myomorph.rigid.regressor import regressor_blocks, sum_of_wrenches

CONSTANTS = 6
"""A constant moment about the ground's origin and a constant force, as a plate's tare leaves."""

UNWANTED, UNSEEN, UNMEASURED = "left out by the user", "motion missing", "force missing"


@dataclass(frozen=True, eq=False)
class Recording:
    """One motion and the forces measured with it, on the same clock.

    Attributes
    ----------
    motion : with velocities and accelerations, through the same filter as the forces
    wrenches : every external force; NaN where one is missing
    use : (frames,) which frames count, e.g. those with both feet on plates; all where None
    """

    motion: Motion
    wrenches: Wrenches
    use: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.use is not None and np.shape(self.use) != (len(self.motion),):
            raise BadData(f"`use` has shape {np.shape(self.use)}, but the motion has {len(self.motion)} frames")


@dataclass(frozen=True, eq=False)
class Rows:
    """What all frames say, condensed.

    Attributes
    ----------
    factors : (6, n + 7, n + 7) triangular factor of [Y_B, constants, wrench] for each row of the wrench
    frames : that were used
    left_out : number of frames left out, by reason
    """

    factors: Array
    frames: int
    left_out: dict[str, int]

    @cached_property
    def plain(self) -> Array:
        """(6, n + 1, n + 1) triangular factors without the columns of constants."""
        n = self.factors.shape[2] - CONSTANTS - 1
        parts = np.delete(self.factors, np.s_[n : n + CONSTANTS], axis=2)
        return np.stack([absorb(np.zeros((n + 1, n + 1)), part) for part in parts])

    @property
    def wrench_rms(self) -> Array:
        """(6,) of what was measured [N m], [N]."""
        rms: Array = np.sqrt(np.square(self.factors[:, :, -1]).sum(axis=1) / self.frames)
        return rms

    @property
    def mean_force(self) -> Array:
        """(3,) of what was measured [N]."""
        # The columns of constants hold a one in every row of their own force.
        mean: Array = np.array([self.factors[3 + i, :, -4 + i] @ self.factors[3 + i, :, -1] for i in range(3)])
        return mean / self.frames

    def rms(self, solution: Array) -> Array:
        """(6,) of what parameters (n,), or parameters and constants (n + 6,), leave [N m], [N]."""
        x = np.zeros(self.factors.shape[2])
        x[: len(solution)] = solution
        x[-1] = -1.0
        rms: Array = np.sqrt(np.square(self.factors @ x).sum(axis=1) / self.frames)
        return rms


def gather(
    model: Model,
    recordings: Sequence[Recording],
    base: BaseParameters,
    reference: tuple[float, float, float] | None,
    block: int,
) -> Rows:
    """Condense recordings by QR, so that memory does not grow with the frames.

    Raises
    ------
    BadData : no frame can be used, or the base parameters hold coordinates that move or rest elsewhere
    """
    n = len(base)
    factors = np.zeros((6, n + CONSTANTS + 1, n + CONSTANTS + 1))
    left_out = {UNWANTED: 0, UNSEEN: 0, UNMEASURED: 0}
    frames = 0
    for recording in recordings:
        total = _measured(model, recording)
        for part in regressor_blocks(model, recording.motion, reference, block):
            wanted = np.ones(len(part.rows), bool) if recording.use is None else np.asarray(recording.use)[part.frames]
            # A sum, because a missing coordinate shows in it and costs no copy.
            moving = np.isfinite(part.rows.sum(axis=(1, 2)))
            pushed = np.isfinite(total[part.frames]).all(axis=1)
            for reason, lacking in (
                (UNWANTED, ~wanted),
                (UNSEEN, wanted & ~moving),
                (UNMEASURED, wanted & moving & ~pushed),
            ):
                left_out[reason] += int(lacking.sum())
            used = np.flatnonzero(wanted & moving & pushed)
            if not len(used):
                continue
            if not frames:
                _check_base(part.rows[used[0]], base)
            frames += len(used)
            wrench, constants = _about(total[part.frames], part.reference), _constants(part.reference)
            _fold(factors, part.rows, base.columns, constants, wrench, used)
    if not frames:
        told = ", ".join(f"{reason}: {count}" for reason, count in left_out.items() if count)
        raise BadData(f"no frame can be used to identify ({told or 'there are none'})")
    return Rows(factors, frames, left_out)


def residuals(
    model: Model,
    recordings: Sequence[Recording],
    base: BaseParameters,
    estimate: Array,
    reference: tuple[float, float, float] | None,
    block: int,
) -> list[Array]:
    """(frames, 6) what base parameters leave of each recording's wrench, NaN where it is not used."""
    parameters = np.zeros(base.combination.shape[1])
    parameters[base.columns] = estimate
    left = []
    for recording in recordings:
        residual = _measured(model, recording)
        for part in regressor_blocks(model, recording.motion, reference, block):
            residual[part.frames] = _about(residual[part.frames], part.reference) - part.rows @ parameters
        if recording.use is not None:
            residual[~np.asarray(recording.use, bool)] = np.nan
        left.append(residual)
    return left


def correlation_times(left: Sequence[Array]) -> Array:
    """(6,) frames that make one independent sample: 1 + 2 sum of autocorrelations, by Geyer's rule.

    Pairs of successive lags are summed as long as they are positive (Geyer 1992, Statistical Science
    7(4):473). Frames that are left out count as zeros, which takes nothing from the lags' mean.
    """
    longest = max(len(one) for one in left)
    covariance = np.zeros((longest, 6))
    for one in left:
        values = np.where(np.isfinite(one), one, 0.0)
        spectrum = np.fft.rfft(values, 2 * len(values), axis=0)
        covariance[: len(values)] += np.fft.irfft(np.abs(spectrum) ** 2, 2 * len(values), axis=0)[: len(values)]
    pairs = longest // 2
    if not pairs:
        return np.ones(6)
    rho = covariance / np.maximum(covariance[0], 1e-300)
    sums = rho[: 2 * pairs].reshape(pairs, 2, 6).sum(axis=1)
    positive = np.cumprod(sums > 0.0, axis=0)
    times: Array = np.maximum(2.0 * (sums * positive).sum(axis=0) - 1.0, 1.0)
    return times


def _measured(model: Model, recording: Recording) -> Array:
    """(frames, 6) measured moment about the ground's origin and force."""
    return sum_of_wrenches(model, recording.motion, recording.wrenches, np.zeros((len(recording.motion), 3)))


def _about(total: Array, points: Array) -> Array:
    """A wrench (frames, 6) about the ground's origin, about points (frames, 3)."""
    return np.concatenate([total[:, :3] - np.cross(points, total[:, 3:]), total[:, 3:]], axis=1)


def _constants(points: Array) -> Array:
    """(frames, 6, 6) rows about points (frames, 3) of a constant wrench about the ground's origin."""
    rows = np.tile(np.eye(6), (len(points), 1, 1))
    for i, a, b in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        rows[:, i, 3 + b], rows[:, i, 3 + a] = -points[:, a], points[:, b]
    return rows


def _fold(factors: Array, Y: Array, columns: np.ndarray, constants: Array, wrench: Array, used: np.ndarray) -> None:
    """Fold frames into the factor of each row of the wrench, the rows shared among the cores."""
    # A copy, because a kernel is compiled anew for an array that is read-only.
    chosen = columns.copy()

    def some(start: int, stop: int) -> None:
        scratch = np.empty((6, factors.shape[2]))
        for i in range(start, stop):
            fold_frames(factors[i], i, Y, chosen, constants, wrench, used, scratch)

    over_frames(some, 6, chunk=1)


def _check_base(rows: Array, base: BaseParameters) -> None:
    difference = np.abs(rows - rows[:, base.columns] @ base.combination).max()
    if difference > 1e-6 * np.abs(rows).max():
        raise BadData(
            "these base parameters do not fit the motion: coordinates that they hold still move or rest at other "
            f"values ({', '.join(list(base.held)[:4]) or 'none held'}); let fit_base make them"
        )
