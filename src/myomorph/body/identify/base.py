"""Base parameters of one body, by least squares on the measured base wrench of its motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.body.identify.base_errors import WeighedRows, motion_errors
from myomorph.body.identify.base_parameters import (
    BaseParameters,
    base_parameters,
    base_sizes,
    held_in,
    link_levels,
)
from myomorph.body.identify.least_squares import Blocks, Recording, Rows, gather, residuals
from myomorph.body.identify.motion_noise import MOTION_SD, MotionNoise, with_noise
from myomorph.body.identify.triangles import (
    Solution,
    levels,
    rank_and_condition,
    solve,
    with_prior,
)
from myomorph.core.fit.correlation import correlation_times
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import Model

MIN_FREEDOM = 0.1  # Share of the samples that the fit is taken not to follow, at least


@dataclass(frozen=True)
class BaseOptions:
    """Settings of `fit_base`.

    Attributes
    ----------
    reference : point in ground that moments are about, as of a plate [m]; None for the base's
        origin
    moment_noise, force_noise : standard deviation of the measured base wrench [N m], [N]; None
        estimates one for each of the six rows from the residuals
    correlated : count only as many independent frames as the residuals' autocorrelation leaves,
        because filtered frames repeat each other
    fixed : the base stands still, as on a plate that it is bolted to
    tare : estimate a constant wrench beside the parameters, as a plate tared with the body on it
        leaves; without it the constant is still estimated apart and reported
    prior : standard deviation of a weak prior about the model's own parameters, in multiples of
        their size; what the motion does not excite stays at the model's value
    identifiable : a base parameter counts as identifiable where its standard deviation is below
        this share of its size
    rank_tolerance : singular values below this share of the largest do not count for the rank,
        columns scaled to length 1
    block : frames that are taken at a time
    motion_sd : standard deviation of the noise that the filter leaves in a coordinate, of
        recordings that do not say it [rad or m]; 0 for a motion without noise
    """

    reference: tuple[float, float, float] | None = None
    moment_noise: float | None = None
    force_noise: float | None = None
    correlated: bool = True
    fixed: bool = False
    tare: bool = False
    prior: float = 100.0
    identifiable: float = 0.2
    rank_tolerance: float = 1e-6
    block: int = 512
    motion_sd: float = MOTION_SD

    @property
    def blocks(self) -> Blocks:
        """How recordings are taken apart."""
        return Blocks(reference=self.reference, frames=self.block)

    def __post_init__(self) -> None:
        for name in (
            "moment_noise",
            "force_noise",
            "prior",
            "identifiable",
            "rank_tolerance",
            "block",
        ):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise BadData(f"{name} is {value:g}: expected above 0")
        if not self.motion_sd >= 0.0:
            raise BadData(f"motion_sd is {self.motion_sd:g}: expected at least 0")


@read_only
class Tare:
    """A constant wrench that fits the data beside the parameters: a plate's offset or tare.

    Attributes
    ----------
    constant, sd : (6,) moment about the ground's origin [N m] and force [N], as recorded less as
        true
    rms_without, rms_with : (6,) residuals of both fits [N m], [N]
    """

    constant: Array
    sd: Array
    rms_without: Array
    rms_with: Array

    @property
    def significant(self) -> bool:
        """Whether the constant exceeds 5 standard deviations and improves a row by a tenth."""
        sure = bool((np.abs(self.constant) > 5.0 * self.sd).any())
        return sure and bool((self.rms_with < 0.9 * self.rms_without).any())


class WeakPrior(NamedTuple):
    """Base parameters before anything is measured, so weak that it only holds what nothing shows.

    Attributes
    ----------
    mean : (n,) those of the model
    sizes : (n,) how large each is in the model
    sd : (n,) standard deviations, multiples of the sizes
    """

    mean: Array
    sizes: Array
    sd: Array

    @classmethod
    def of(cls, model: Model, base: BaseParameters, multiple: float) -> WeakPrior:
        """Make the prior about a model's own masses.

        Parameters
        ----------
        model : with its masses
        base : of the same bodies
        multiple : standard deviation over the size
        """
        sizes = base_sizes(model, base)
        mean = base.of(inertial_parameters(model))
        return cls(mean=mean, sizes=sizes, sd=multiple * sizes)


@read_only
class BaseFit:
    """Base parameters of a body with what the data say of each.

    Attributes
    ----------
    base : what is estimated
    estimate, sd : (n,) base parameters and standard deviations, in units of each
    size : (n,) how large each would be in the model, for comparison
    information, z : (n, n) upper triangular R and (n,) with R phi_B = z in units of noise, data
        alone
    relative_sd : (n,) sd / |estimate|
    identifiable : (n,) whether this motion tells it (`BaseOptions.identifiable`)
    levels : (n,) share of what is known of each that comes from the motion rather than from the
        model, 0 to 1
    link_levels : of every body, the mean over the base parameters named after it
    rank : of the information, columns scaled to length 1
    condition : largest over smallest singular value of the scaled information, inf where singular
    sigma : (6,) noise of a row [N m], [N]
    samples : (6,) independent samples of each row, at most `frames`
    frames : that were used
    left_out : number of frames left out, by reason
    residual_rms, wrench_rms : (6,) of what is left, and of what was measured [N m], [N]
    carried_mass : what the mean force carries [kg]: far from the body's mass, a plate was tared
        with the body on it, or stood apart from a foot
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
    identifiable: np.ndarray
    levels: Array
    link_levels: Mapping[str, float]
    sigma: Array
    samples: Array
    frames: int
    left_out: Mapping[str, int]
    residual_rms: Array
    wrench_rms: Array
    carried_mass: float
    tare: Tare
    options: BaseOptions = field(default_factory=BaseOptions)

    def __post_init__(self) -> None:
        for name in ("left_out", "link_levels"):
            object.__setattr__(self, name, FrozenMap(dict(getattr(self, name))))

    @property
    def relative_sd(self) -> Array:
        """(n,) standard deviation over the estimate's magnitude."""
        return self.sd / np.maximum(np.abs(self.estimate), 1e-300)

    def rows(self) -> tuple[Array, Array]:
        """Return the data as rows in units of noise.

        |A phi - b|^2 is their misfit of inertial parameters phi, with A = R Z.

        Returns
        -------
        (n, 10 bodies) A and (n,) b
        """
        return self.information @ self.base.combination, np.array(self.z)


class RowNoise(NamedTuple):
    """Noise of the six rows of the wrench.

    Attributes
    ----------
    sigma : (6,) standard deviation [N m], [N]
    samples : (6,) independent samples of each row
    weight : (6,) what a residual of each frame is divided by: sigma, and the root of the frames
        that make one sample
    followed : factor of standard deviations, because residuals that independent samples leave are
        smaller than noise: the fit follows it with as many unknowns as it has
    """

    sigma: Array
    samples: Array
    weight: Array
    followed: float


def fit_base(
    model: Model,
    recordings: Sequence[Recording],
    base: BaseParameters | None = None,
    options: BaseOptions | None = None,
    motion: MotionNoise | None = None,
) -> BaseFit:
    """Estimate the base parameters that reproduce the measured base wrench best, [D] eq. 3.1.

        minimise  sum_rows |Y_B phi_B - f|^2 / sigma_row^2

    by QR factors that take block after block of frames, so that memory does not grow with them.
    Each of the six rows keeps a factor of its own: their noise is estimated from the residuals, and
    weighed, without going through the frames again. A second, cheap pass gives the residuals'
    autocorrelation. Rows and forces of recordings that have a finer motion pass the filter after
    they are made.

    Noise of the motion is in the rows too. It is drawn anew some times, and each draw moves the
    estimate. With the information H_i of each row of the wrench, and the share s_i of its misfit's
    variance that other noise made, the mean square of an error is

        H^-1 (sum_i s_i H_i) H^-1 + bias^2 + scatter of the draws

    (`motion_errors`). Noise that would make more misfit than there is is taken as less, so exact
    recordings have none.

    Parameters
    ----------
    model : whose inertial parameters the weak prior is about
    recordings : with derivatives of the motion, and its noise where that is known
    base : what is estimated; by default the base parameters of the model, with coordinates that are
        locked (and, on a base that is fixed, those of its joint to the ground) where the recordings
        have them
    options : noise, prior and tare; see `BaseOptions`
    motion : what noise of the motion adds to the rows, where that was computed already

    Returns
    -------
    estimates with standard deviations, in the units of each base parameter

    Raises
    ------
    BadData : the base parameters are of other bodies or do not fit the motion, or no frame can be
        used
    """
    options = options or BaseOptions()
    base = base or _base_of(model, recordings, options)
    _check_bodies(base, model)
    rows = gather(model, recordings, base, options.blocks)
    prior = WeakPrior.of(model, base, options.prior)
    noise = _row_noise(model, recordings, base, rows, prior, options)
    plain = solve(rows.plain, noise.weight, prior.mean, prior.sd)
    tared = solve(rows.factors, noise.weight, prior.mean, prior.sd)
    chosen = tared if options.tare else plain
    estimate = chosen.solution[: len(base)]
    data = chosen.without(len(base))

    misfit = rows.rms(chosen.solution)
    if motion is None:
        fitted = _fitted(chosen, rows, noise, prior, options)
        sd = _sd_by_rows(model, recordings, base, fitted, noise.followed, options)
    else:
        sd = _share_of_others(motion, misfit, estimate) * (noise.followed * chosen.sd[: len(base)])
        sd = np.hypot(sd, _motion_sd(data.R, prior, motion, noise, estimate))
    shown = rank_and_condition(data.R, options.rank_tolerance)
    by_parameter = levels(data.R, prior.mean, prior.sizes)
    return BaseFit(
        base=base,
        estimate=estimate,
        sd=sd,
        size=prior.sizes,
        information=data.R,
        z=data.z,
        rank=shown.rank,
        condition=shown.condition,
        identifiable=sd <= options.identifiable * np.maximum(np.abs(estimate), prior.sizes),
        levels=by_parameter,
        link_levels=link_levels(model, base, by_parameter),
        sigma=noise.sigma,
        samples=noise.samples,
        frames=rows.frames,
        left_out=rows.left_out,
        residual_rms=misfit,
        wrench_rms=rows.wrench_rms,
        carried_mass=_carried_mass(rows, model),
        tare=_tare(rows, plain, tared),
        options=options,
    )


def _base_of(model: Model, recordings: Sequence[Recording], options: BaseOptions) -> BaseParameters:
    """Find the base parameters of motions, with the coordinates that rest in them."""
    held = held_in(model, [recording.motion for recording in recordings], options.fixed)
    return base_parameters(model, options.fixed, held)


def _fitted(
    chosen: Solution, rows: Rows, noise: RowNoise, prior: WeakPrior, options: BaseOptions
) -> WeighedRows:
    """Collect the equations that were solved.

    Parameters
    ----------
    chosen : their solution, with the tare where that is estimated
    rows : of all frames
    noise : that they were weighed by
    prior : of the base parameters
    options : whether the tare is estimated
    """
    whole, _ = with_prior(np.column_stack([chosen.R, chosen.z]), prior.mean, prior.sd)
    return WeighedRows(
        factors=rows.factors if options.tare else rows.plain,
        weight=noise.weight,
        solution=chosen.solution,
        R=whole,
        prior_sd=prior.sd,
    )


def _sd_by_rows(
    model: Model,
    recordings: Sequence[Recording],
    base: BaseParameters,
    fitted: WeighedRows,
    followed: float,
    options: BaseOptions,
) -> Array:
    """Compute standard deviations with noise of the motion, where there is any.

    Parameters
    ----------
    model, recordings, base : of the rows
    fitted : the equations that were solved
    followed : see `RowNoise`
    options : noise of the motion where recordings do not say it

    Returns
    -------
    (n,)
    """
    exact = not options.motion_sd and all(one.noise is None for one in recordings)
    if exact:
        return followed * np.sqrt(fitted.variance(np.ones(6)))
    noisy = [with_noise(one, options.motion_sd) for one in recordings]
    errors = motion_errors(model, noisy, base, fitted, options.blocks)
    return np.hypot(followed * np.sqrt(fitted.variance(errors.shares)), errors.sd)


def _motion_sd(
    R: Array, prior: WeakPrior, motion: MotionNoise, noise: RowNoise, estimate: Array
) -> Array:
    """Compute the standard deviation that noise of the motion adds.

    Parameters
    ----------
    R : (n, n) upper triangular, of the data
    prior : of the base parameters
    motion : what noise of the motion adds to rows
    noise : of the rows
    estimate : (n,) base parameters

    Returns
    -------
    (n,)
    """
    # Moments have one weight in `motion`, and so have forces: the root mean square of their rows'.
    kinds = np.mean(np.reshape(noise.weight, (2, 3)) ** -2.0, axis=1) ** -0.5
    vectors = kinds * np.sqrt(3.0 / motion.parts.alike)
    pulls = motion.pulls(vectors, motion.parts.base.standard(estimate))
    whole, _ = with_prior(np.column_stack([R, np.zeros(len(R))]), prior.mean, prior.sd)
    half = scipy.linalg.solve_triangular(whole, pulls.T, trans="T")
    moved = scipy.linalg.solve_triangular(whole, half)
    # Known from few draws only: the variance of Student's t, not of a normal distribution.
    sd: Array = np.sqrt(np.square(moved).sum(axis=1) / (len(pulls) - 3))
    return sd


def _share_of_others(motion: MotionNoise, misfit: Array, estimate: Array) -> float:
    """Compute the share of the noise that is not the motion's, for variances add up.

        sqrt(1 - misfit by the motion's noise^2 / misfit^2)

    Parameters
    ----------
    motion : what noise of the motion adds to rows
    misfit : (6,) root mean square that the estimate leaves [N m], [N]
    estimate : (n,) base parameters

    Returns
    -------
    the larger one of moments and forces
    """
    by_motion = motion.misfit(motion.parts.base.standard(estimate))
    ratios = by_motion / np.maximum(_vectors(misfit), 1e-300)
    return float(np.sqrt(np.clip(1.0 - np.square(ratios), 0.0, 1.0).max()))


def _vectors(rows: Array) -> Array:
    """Join root mean squares of six rows (6,) to those of the moment and the force (2,)."""
    return np.sqrt(np.square(np.reshape(rows, (2, 3))).sum(axis=1))


def _check_bodies(base: BaseParameters, model: Model) -> None:
    """Refuse base parameters of other bodies than the model's."""
    if base.bodies != model.body_names:
        raise BadData(
            f"base parameters are of bodies {base.bodies[:3]}..., the model has"
            f" {model.body_names[:3]}..."
        )


def _tare(rows: Rows, plain: Solution, tared: Solution) -> Tare:
    """Compare the fit with a constant wrench and the one without.

    Parameters
    ----------
    rows : of all frames
    plain : base parameters alone
    tared : with the constant, which comes last
    """
    n = len(plain.solution)
    return Tare(
        constant=tared.solution[n:],
        sd=tared.sd[n:],
        rms_without=rows.rms(plain.solution),
        rms_with=rows.rms(tared.solution),
    )


def _carried_mass(rows: Rows, model: Model) -> float:
    """Compute what the mean force carries [kg]; NaN without gravity."""
    square = float(model.gravity @ model.gravity)
    if not square > 0.0:
        return float("nan")
    return -float(rows.mean_force @ model.gravity) / square


def _row_noise(
    model: Model,
    recordings: Sequence[Recording],
    base: BaseParameters,
    rows: Rows,
    prior: WeakPrior,
    options: BaseOptions,
) -> RowNoise:
    """Estimate the noise of the rows, and how many of them are independent.

    Residuals that n unknowns can follow are smaller than the noise:

        sigma^2 = rms^2 / (1 - n / samples)

    Parameters
    ----------
    model, recordings, base : of the rows
    rows : of all frames
    prior : of the base parameters
    options : noise, where it is known
    """
    sigma = _noise(rows, prior, options)
    samples = np.full(6, float(rows.frames))
    followed = 1.0
    if options.correlated:
        first = solve(rows.plain, sigma, prior.mean, prior.sd)
        left = residuals(model, recordings, base, first.solution, options.blocks)
        samples = rows.frames / correlation_times(left)
    if not np.isfinite(_known_noise(options)).any():
        n = len(prior.mean)
        every = _freedom(n, 6.0 * rows.frames)
        followed = np.sqrt(every / _freedom(n, float(samples.sum())))
    return RowNoise(
        sigma=sigma,
        samples=samples,
        weight=sigma * np.sqrt(rows.frames / samples),
        followed=float(followed),
    )


def _freedom(unknowns: int, samples: float) -> float:
    """Compute the share of the samples that unknowns cannot follow."""
    return max(1.0 - unknowns / samples, MIN_FREEDOM)


def _known_noise(options: BaseOptions) -> Array:
    """List the noise of the rows (6,) that is specified; NaN where none is [N m], [N]."""
    noise = [options.moment_noise] * 3 + [options.force_noise] * 3
    return np.array(noise, dtype=np.float64)


def _noise(rows: Rows, prior: WeakPrior, options: BaseOptions) -> Array:
    """Estimate the noise of the rows: as specified, or from the residuals of a fit.

    No row errs by more than the masses before anything was measured leave: a fit could else give
    up one row, whose weight falls with its residual, for all others.

    Parameters
    ----------
    rows : of all frames
    prior : of the base parameters

    Returns
    -------
    (6,) standard deviation [N m], [N]
    """
    measured = rows.wrench_rms
    floor = 1e-9 * np.maximum(measured, measured.max() * 1e-3) + 1e-12
    noise = _known_noise(options)
    known = np.isfinite(noise)
    sigma: Array = np.where(known, noise, np.maximum(0.05 * measured, floor))
    if known.all():
        return sigma
    freedom = _freedom(len(prior.mean), 6.0 * rows.frames)
    most = rows.rms(prior.mean) / np.sqrt(freedom)
    for _ in range(8):
        fitted = solve(rows.plain, sigma, prior.mean, prior.sd)
        left = np.minimum(rows.rms(fitted.solution) / np.sqrt(freedom), most)
        before = sigma
        sigma = np.where(known, noise, np.maximum(left, floor))
        if np.all(np.abs(sigma - before) < 0.01 * before):
            break
    return sigma
