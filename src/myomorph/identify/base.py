"""Base parameters of one body, by least squares on the measured base wrench of its motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from scipy.linalg import solve_triangular

from myomorph.identify.base_parameters import (
    BaseParameters,
    base_parameters,
    base_sizes,
    held_in,
    parameter_sizes,
)
from myomorph.identify.factors import absorb, rank_and_condition, with_prior
from myomorph.identify.null_space import tree_null_space
from myomorph.model.errors import BadData
from myomorph.model.inertia import inertial_parameters
from myomorph.model.model import Model
from myomorph.model.series import Motion, Wrenches
from myomorph.model.spatial import Array, frozen_array
from myomorph.rigid.regressor import regressor_blocks, sum_of_wrenches

__all__ = [
    "BaseFit",
    "BaseOptions",
    "BaseParameters",
    "Recording",
    "Tare",
    "base_parameters",
    "fit_base",
    "parameter_sizes",
    "tree_null_space",
]


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


@dataclass(frozen=True)
class BaseOptions:
    """Settings of `fit_base`.

    Attributes
    ----------
    reference : point in ground that moments are about, as of a plate [m]; None for the base's origin
    moment_noise, force_noise : standard deviation of the measured base wrench [N m], [N]; None estimates
        one for each of the six rows from the residuals
    correlated : count only as many independent frames as the residuals' autocorrelation leaves, because
        filtered frames repeat each other
    tare : estimate a constant wrench beside the parameters, as a plate tared with the body on it leaves;
        without it the constant is still estimated apart and reported
    prior : standard deviation of a weak prior about the model's own parameters, in multiples of their
        size; what the motion does not excite stays at the model's value
    shown : a base parameter counts as shown where its standard deviation is below this share of its size
    rank_tolerance : singular values below this share of the largest do not count for the rank, columns
        scaled to length 1
    block : frames that are taken at a time
    """

    reference: tuple[float, float, float] | None = None
    moment_noise: float | None = None
    force_noise: float | None = None
    correlated: bool = True
    tare: bool = False
    prior: float = 100.0
    shown: float = 0.2
    rank_tolerance: float = 1e-6
    block: int = 2048

    def __post_init__(self) -> None:
        for name in ("moment_noise", "force_noise", "prior", "shown", "rank_tolerance", "block"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise BadData(f"{name} is {value:g}: expected above 0")


@dataclass(frozen=True, eq=False)
class Tare:
    """A constant wrench that fits the data beside the parameters: a plate's offset or tare.

    Attributes
    ----------
    constant, sd : (6,) moment about the ground's origin [N m] and force [N], as recorded less as true
    rms_without, rms_with : (6,) residuals of both fits [N m], [N]
    """

    constant: Array
    sd: Array
    rms_without: Array
    rms_with: Array

    @property
    def significant(self) -> bool:
        """Whether the constant is more than 5 standard deviations, and helps a row by more than a tenth."""
        sure = bool((np.abs(self.constant) > 5.0 * self.sd).any())
        return sure and bool((self.rms_with < 0.9 * self.rms_without).any())


@dataclass(frozen=True, eq=False)
class BaseFit:
    """Base parameters of a body with what the data say of each.

    Attributes
    ----------
    base : what is estimated
    estimate, sd : (n,) base parameters and standard deviations, in units of each
    size : (n,) how large each would be in the model, for comparison
    information, z : (n, n) upper triangular R and (n,) with R phi_B = z in units of noise, data alone
    relative_sd : (n,) sd / |estimate|
    shown : (n,) whether this motion showed it (`BaseOptions.shown`)
    rank : of the information, columns scaled to length 1
    condition : largest over smallest singular value of the scaled information, inf where singular
    sigma : (6,) noise of a row [N m], [N]
    samples : (6,) independent samples of each row, at most `frames`
    frames : that were used
    left_out : number of frames left out, by reason
    residual_rms, wrench_rms : (6,) of what is left, and of what was measured [N m], [N]
    tare : the constant that would fit best beside the parameters
    options : as given
    """

    base: BaseParameters
    estimate: Array
    sd: Array
    size: Array
    information: Array
    z: Array
    rank: int
    condition: float
    shown: np.ndarray
    sigma: Array
    samples: Array
    frames: int
    left_out: Mapping[str, int]
    residual_rms: Array
    wrench_rms: Array
    tare: Tare
    options: BaseOptions = field(default_factory=BaseOptions)

    def __post_init__(self) -> None:
        for name in ("estimate", "sd", "size", "information", "z", "sigma", "samples", "residual_rms", "wrench_rms"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))
        object.__setattr__(self, "left_out", MappingProxyType(dict(self.left_out)))

    @property
    def relative_sd(self) -> Array:
        """(n,) standard deviation over the estimate's magnitude."""
        return self.sd / np.maximum(np.abs(self.estimate), 1e-300)

    def rows(self) -> tuple[Array, Array]:
        """(A (n, 10 bodies), b (n,)) in units of noise: |A phi - b|^2 is the data's misfit of phi, A = R Z."""
        return self.information @ self.base.combination, np.array(self.z)


def fit_base(
    model: Model,
    recordings: Sequence[Recording],
    base: BaseParameters | None = None,
    options: BaseOptions | None = None,
) -> BaseFit:
    """Base parameters that reproduce the measured base wrench best, [D] eq. 3.1.

        minimise  sum_rows |Y_B phi_B - f|^2 / sigma_row^2

    by QR factors that take block after block of frames, so that memory does not grow with them. Each of
    the six rows keeps a factor of its own: their noise is estimated from the residuals, and weighed,
    without going through the frames again. A second, cheap pass gives the residuals' autocorrelation.

    Parameters
    ----------
    base : by default those of the model with locked coordinates where the recordings have them

    Raises
    ------
    BadData : no frame can be used, or `base` is of another model or of other held values
    """
    options = options or BaseOptions()
    if base is None:
        base = base_parameters(model, held=held_in(model, [one.motion for one in recordings]))
    if base.bodies != model.body_names:
        raise BadData(
            f"the base parameters are of bodies {base.bodies[:3]}..., the model has {model.body_names[:3]}..."
        )
    totals = [_measured(model, one) for one in recordings]
    factors, left_out = _factors(model, recordings, totals, base, options)
    frames = sum(len(total) for total in totals) - sum(left_out.values())
    if not frames:
        told = ", ".join(f"{reason}: {count}" for reason, count in left_out.items() if count)
        raise BadData(f"no frame can be used to identify ({told or 'there are none'})")
    n = len(base)
    sizes = base_sizes(model, base)
    start = base.of(inertial_parameters(model))
    prior = _Prior(start, sizes * options.prior)
    sigma = _noise(factors, frames, prior, n, options)
    plain = _solve(factors[:, :, _without_tare(n)], sigma, prior)
    samples = np.full(6, float(frames))
    if options.correlated:
        residuals = _residuals(model, recordings, totals, base, plain.solution, options)
        samples = frames / _correlation_times(residuals)
    weight = sigma * np.sqrt(frames / samples)
    plain = _solve(factors[:, :, _without_tare(n)], weight, prior)
    tared = _solve(factors, weight, prior)
    chosen = tared if options.tare else plain
    rms = np.sqrt(_squares(factors, plain.solution, tare=False) / frames)
    rms_tared = np.sqrt(_squares(factors, tared.solution, tare=True) / frames)
    sd = chosen.sd[:n]
    estimate = chosen.solution[:n]
    rank, condition = rank_and_condition(chosen.R[:n, :n], options.rank_tolerance)
    return BaseFit(
        base=base,
        estimate=estimate,
        sd=sd,
        size=sizes,
        information=chosen.R[:n, :n],
        z=chosen.z[:n],
        rank=rank,
        condition=condition,
        shown=sd <= options.shown * np.maximum(np.abs(estimate), sizes),
        sigma=sigma,
        samples=samples,
        frames=frames,
        left_out=left_out,
        residual_rms=rms_tared if options.tare else rms,
        wrench_rms=np.sqrt(np.square(factors[:, :, -1]).sum(axis=1) / frames),
        tare=Tare(tared.solution[n:], tared.sd[n:], rms, rms_tared),
        options=options,
    )


@dataclass(frozen=True, eq=False)
class _Prior:
    """What is known without data: mean and standard deviation of each base parameter."""

    mean: Array
    sd: Array


@dataclass(frozen=True, eq=False)
class _Solution:
    """Data's triangular system R x = z, and the estimate with the prior."""

    R: Array
    z: Array
    solution: Array
    sd: Array


def _measured(model: Model, recording: Recording) -> Array:
    """(frames, 6) measured moment about the ground's origin and force."""
    return sum_of_wrenches(model, recording.motion, recording.wrenches, np.zeros((len(recording.motion), 3)))


def _about(total: Array, points: Array) -> Array:
    """A wrench (frames, 6) about the ground's origin, about points (frames, 3)."""
    return np.concatenate([total[:, :3] - np.cross(points, total[:, 3:]), total[:, 3:]], axis=1)


def _constants(points: Array) -> Array:
    """(frames, 6, 6) rows of a constant moment about the ground's origin and a constant force."""
    rows = np.tile(np.eye(6), (len(points), 1, 1))
    for i, a, b in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        rows[:, i, 3 + b], rows[:, i, 3 + a] = -points[:, a], points[:, b]
    return rows


def _factors(
    model: Model, recordings: Sequence[Recording], totals: Sequence[Array], base: BaseParameters, options: BaseOptions
) -> tuple[Array, dict[str, int]]:
    """(6, n + 7, n + 7) triangular factors of [Y_B, constants, wrench], one a row of the wrench."""
    n = len(base)
    width = n + 7
    factors = np.zeros((6, width, width))
    left_out = {"left out by the user": 0, "motion missing": 0, "force missing": 0}
    checked = False
    for recording, total in zip(recordings, totals, strict=True):
        for block in regressor_blocks(model, recording.motion, options.reference, options.block):
            wanted = (
                np.ones(len(block.rows), bool) if recording.use is None else np.asarray(recording.use)[block.frames]
            )
            moving = np.isfinite(block.rows[:, :, base.columns]).all(axis=(1, 2))
            pushed = np.isfinite(total[block.frames]).all(axis=1)
            left_out["left out by the user"] += int(np.sum(~wanted))
            left_out["motion missing"] += int(np.sum(wanted & ~moving))
            left_out["force missing"] += int(np.sum(wanted & moving & ~pushed))
            used = np.flatnonzero(wanted & moving & pushed)
            if not len(used):
                continue
            if not checked:
                _check_base(block.rows[used[0]], base)
                checked = True
            points = block.reference[used]
            wrench = _about(total[block.frames][used], points)
            constants = _constants(points)
            for i in range(6):
                part = np.empty((len(used), width), order="F")
                part[:, :n] = block.rows[used[:, None], i, base.columns]
                part[:, n:-1] = constants[:, i]
                part[:, -1] = wrench[:, i]
                factors[i] = absorb(factors[i], part)
    return factors, left_out


def _check_base(rows: Array, base: BaseParameters) -> None:
    difference = np.abs(rows - rows[:, base.columns] @ base.combination).max()
    if difference > 1e-6 * np.abs(rows).max():
        raise BadData(
            "these base parameters do not fit the motion: coordinates that they hold still move or rest at other "
            f"values ({', '.join(list(base.held)[:4]) or 'none held'}); let fit_base make them"
        )


def _without_tare(n: int) -> np.ndarray:
    return np.concatenate([np.arange(n), [n + 6]])


def _solve(factors: Array, sigma: Array, prior: _Prior) -> _Solution:
    """Weigh the rows' factors (6, n + 7, k + 1) together and solve with the prior."""
    k = factors.shape[2] - 1
    data = np.zeros((k + 1, k + 1))
    for factor, noise in zip(factors, sigma, strict=True):
        data = absorb(data, factor / noise)
    R, z = with_prior(data[:k], prior.mean, prior.sd)
    solution = solve_triangular(R, z)
    inverse = solve_triangular(R, np.eye(k))
    return _Solution(data[:k, :k], data[:k, k], solution, np.sqrt(np.square(inverse).sum(axis=1)))


def _squares(factors: Array, solution: Array, tare: bool) -> Array:
    """(6,) sums of squared residuals of each row."""
    n = factors.shape[2] - 7
    x = np.zeros(n + 7)
    x[: n + 6 if tare else n] = solution
    x[-1] = -1.0
    return np.square(factors @ x).sum(axis=1)


def _noise(factors: Array, frames: int, prior: _Prior, n: int, options: BaseOptions) -> Array:
    """(6,) noise of the rows: as given, or from the residuals of a fit weighed by it."""
    measured = np.sqrt(np.square(factors[:, :, -1]).sum(axis=1) / frames)
    floor = 1e-9 * np.maximum(measured, measured.max() * 1e-3) + 1e-12
    given = np.array([options.moment_noise] * 3 + [options.force_noise] * 3, dtype=np.float64)
    known = np.isfinite(given)
    sigma = np.where(known, given, np.maximum(0.05 * measured, floor))
    if known.all():
        return sigma
    freedom = max(1.0 - n / (6.0 * frames), 0.1)
    for _ in range(8):
        fit = _solve(factors[:, :, _without_tare(n)], sigma, prior)
        residual = np.sqrt(_squares(factors, fit.solution, tare=False) / (frames * freedom))
        new = np.where(known, given, np.maximum(residual, floor))
        done = np.all(np.abs(new - sigma) < 0.01 * sigma)
        sigma = new
        if done:
            break
    return sigma


def _residuals(
    model: Model,
    recordings: Sequence[Recording],
    totals: Sequence[Array],
    base: BaseParameters,
    estimate: Array,
    options: BaseOptions,
) -> list[Array]:
    """(frames, 6) what is left of each recording's wrench, NaN where it is not used."""
    left = []
    for recording, total in zip(recordings, totals, strict=True):
        residual = np.empty((len(total), 6))
        for block in regressor_blocks(model, recording.motion, options.reference, options.block):
            fitted = block.rows[:, :, base.columns] @ estimate
            residual[block.frames] = _about(total[block.frames], block.reference) - fitted
        if recording.use is not None:
            residual[~np.asarray(recording.use, bool)] = np.nan
        left.append(residual)
    return left


def _correlation_times(residuals: Sequence[Array]) -> Array:
    """(6,) frames that make one independent sample: 1 + 2 sum of autocorrelations, by Geyer's rule.

    Pairs of successive lags are summed as long as they are positive (Geyer 1992, Statistical Science
    7(4):473). Frames that are left out count as zeros, which takes nothing from the lags' mean.
    """
    longest = max(len(one) for one in residuals)
    covariance = np.zeros((longest, 6))
    for one in residuals:
        values = np.where(np.isfinite(one), one, 0.0)
        spectrum = np.fft.rfft(values, 2 * len(values), axis=0)
        covariance[: len(values)] += np.fft.irfft(np.abs(spectrum) ** 2, axis=0)[: len(values)]
    pairs = longest // 2
    rho = covariance / np.maximum(covariance[0], 1e-300)
    sums = rho[: 2 * pairs].reshape(pairs, 2, 6).sum(axis=1)
    positive = np.cumprod(sums > 0.0, axis=0)
    times: Array = np.maximum(2.0 * (sums * positive).sum(axis=0) - 1.0, 1.0) if pairs else np.ones(6)
    return times
