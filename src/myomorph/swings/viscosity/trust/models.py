"""Is it viscosity? Other passive laws fitted to the same torques, and asked to predict swings they
have not seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.core.fit.correlation import variance_samples
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.identification.condition import Influences
from myomorph.swings.viscosity.identification.inertia import InertiaOptions, Tare
from myomorph.swings.viscosity.identification.torque import (
    counted_from,
    neutral_position,
    spring_misfit,
)
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.trust.forward import (
    SwingMotion,
    Window,
    hinge_axis,
    swing_forward,
    windows,
)
from myomorph.swings.viscosity.trust.freed import ActingLaw, acting_law
from myomorph.swings.viscosity.trust.law import (
    WIDTH,
    PassiveLaw,
    PassiveProblem,
    law_columns,
    term_places,
)

UNITS: Mapping[str, str] = {
    "viscosity": "N m s/rad",
    "stiffness": "N m/rad",
    "rest angle": "rad",
    "coulomb": "N m",
    "quadratic": "N m s^2/rad^2",
    "muscles": "N s/m",
    "hinge": "N m s/rad",
}
"""Of the coefficients; those that differ by axis have the axis' name after theirs."""

LAWS: tuple[tuple[str, ...], ...] = (
    ("viscosity",),
    ("viscosity by axis",),
    ("coulomb",),
    ("quadratic",),
    ("viscosity", "stiffness"),
    ("viscosity", "coulomb"),
    ("viscosity", "quadratic"),
    ("viscosity", "stiffness", "coulomb"),
    ("viscosity", "stiffness", "quadratic"),
    ("viscosity", "stiffness", "coulomb", "quadratic"),
    ("viscosity", "muscles"),
    ("viscosity", "stiffness", "muscles"),
    ("hinges",),
    ("hinges", "stiffness"),
    ("hinges", "muscles"),
)
"""What is compared. "muscles": one viscosity of every muscle, left out where the recordings have no
moment arms; "hinges": of three angles one after another.
"""

ALONE = LAWS[0]
# How often the rest of a ball's spring is found again with angles counted from the last.
NEUTRAL_ROUNDS = 2
# Of an information criterion, that tells nothing (Burnham and Anderson 2002, 2.6).
MAX_CRITERION_DIFFERENCE = 2.0


PLAIN: tuple[tuple[str, ...], ...] = (ALONE, ("viscosity", "muscles"))
"""Equations 1 to 3 of [S], which are taken unless another law predicts better."""

MIN_HELD_OUT_GAIN = 0.5
"""Another law must predict held-out angles within this share of the error that the plain laws
leave. Springs, friction and drag that are there leave a seventh or less; errors of instruments that
look like them gain a tenth now and then.
"""


@dataclass(frozen=True)
class PassiveOptions:
    """Settings of `compare_passive_laws`.

    Attributes
    ----------
    width : angular velocity within which Coulomb friction turns its sign [rad/s]
    held_out : how many windows are left out in turn and predicted
    horizon : shortest window that is predicted; whole swings that follow each other are joined to
        reach it [s]
    draws, seed : of the bootstrap over swings and trials
    tare, prior_sd : of `InertiaOptions`
    """

    width: float = WIDTH
    held_out: int = 4
    horizon: float = 5.0
    draws: int = 500
    seed: int = 0
    tare: Tare = "loaded"
    prior_sd: float = 1.0

    def __post_init__(self) -> None:
        if not (self.width > 0.0 and self.horizon > 0.0 and self.held_out >= 1 and self.draws >= 2):
            raise BadData(
                f"passive laws need positive settings and at least 2 draws, but got {self}"
            )


@dataclass(frozen=True, eq=False)
class PassiveFit:
    """One law, as the torques and the swings judge it: coefficients by name, units in `UNITS`; root
    mean square of torque that it leaves [N m]; criteria above the lowest of all laws. Errors are
    root mean square over the held-out windows: angle between measured and predicted limb [rad],
    wrench [N m], [N].
    """

    terms: tuple[str, ...]
    coefficients: Mapping[str, Interval]
    law: PassiveLaw
    free: int
    residual: float
    aic: float
    bic: float
    angle_error: float
    moment_error: float
    force_error: float

    @property
    def name(self) -> str:
        """The terms in words."""
        return " + ".join(self.terms)


@read_only
class Prediction:
    """A window that was left out: angles (frames, axes) from hanging at rest [rad], measured and as
    viscosity alone and the chosen law predict them from the first frame; for a figure.
    """

    time: Array
    axes: tuple[str, ...]
    measured: Array
    viscous: Array
    chosen: Array


@dataclass(frozen=True, eq=False)
class PassiveComparison:
    """Which passive law the swings ask for, of `fits` in the order of `LAWS`.

    `by_bic` is the simplest whose BIC is within `MAX_CRITERION_DIFFERENCE` of the lowest; `chosen`
    is that where it is plain or predicts held-out windows far better than `PLAIN` laws, else the
    best of these. `prediction` is of the first window, None where no two could be had; `acting`:
    without muscles, what acts beside one viscosity.
    """

    fits: tuple[PassiveFit, ...]
    chosen: PassiveFit
    by_bic: PassiveFit
    prediction: Prediction | None = field(repr=False)
    acting: ActingLaw | None = None

    @property
    def conflict(self) -> str:
        """Where the criteria disagree, in words; else ""."""
        if self.by_bic is self.chosen:
            return ""
        law = self.by_bic
        plain = self.chosen
        if not np.isfinite(plain.angle_error):
            return (
                f"BIC asks for {law.name}, but no window could be held out to judge it:"
                f" {plain.name} is used"
            )
        other, plain_error = np.rad2deg([law.angle_error, plain.angle_error])
        predicts = (
            f"it predicts held-out swings to {other:.1f} degrees, {plain.name} to {plain_error:.1f}"
        )
        return f"BIC asks for {law.name}, but {predicts}: {plain.name} is used"


def compare_passive_laws(
    recordings: Sequence[SwingRecording], options: PassiveOptions | None = None
) -> PassiveComparison:
    """Fit every law to the torques of one condition, and let it predict windows that it has not
    seen.

    All laws are least squares of the same torques, torque_rows phi, with coefficients of at least 0
    and a free rest angle. The criteria count independent samples, not frames, for a low-pass leaves
    about two a period of its cutoff:

        AIC = n ln(RSS / N) + 2 free,   BIC = n ln(RSS / N) + ln(n) free,   n = N / sum_k rho_k^2

    with rho the autocorrelation of what the richest law leaves (`variance_samples`). A prediction,
    and the inertia and law that make it, know nothing of the window but its first frame. The angles
    of a ball are counted from where its spring is slack (`neutral_position`), for only from there
    is the spring linear in them.
    """
    options = options or PassiveOptions()
    inertial = InertiaOptions(options.tare, options.prior_sd)
    problem = PassiveProblem.of(recordings, options.width, inertial)
    slack = Rotation.identity()
    if len(problem.axes) == 3:
        problem, slack = _from_spring(problem)
        recordings = problem.recordings
    laws = _applicable(problem)
    blocks = len(problem.sums)
    every = np.ones(blocks)
    phi = problem.parameters(every)
    solutions = [problem.fit(terms, every, phi) for terms in laws]
    richest = min(solutions, key=lambda solution: float(solution[1]))[0]
    effective = variance_samples(problem.left(phi, PassiveLaw.of(richest, options.width)))
    lacking = 1.0 - np.eye(blocks)
    others = np.array([problem.parameters(block) for block in lacking])
    left_out = windows(recordings, problem.sums, options.horizon, options.held_out)
    trained = [problem.parameters(fold.training(blocks)) for fold in left_out]
    samples = problem.samples(every)
    fits = []
    for terms, (coefficients, rss) in zip(laws, solutions, strict=True):
        less = problem.fit(terms, lacking, others)[0]
        influences = Influences(coefficients, coefficients - less, problem.sums.trial)
        draws = influences.draws(options.draws, np.random.default_rng(options.seed))
        estimates = _estimates(terms, coefficients, draws, problem.axes, slack)
        errors = [
            fold.errors(_predict(problem, terms, fold, p), options.tare != "known")
            for fold, p in zip(left_out, trained, strict=True)
        ]
        means = np.sqrt(np.mean(errors, axis=0)) if errors else np.full(3, np.nan)
        free = law_columns(terms, len(problem.axes))[0].shape[1]
        score = effective * np.log(max(float(rss), 1e-300) / samples)
        angle_error, moment_error, force_error = means.tolist()
        fits.append(
            PassiveFit(
                terms=terms,
                coefficients=estimates,
                law=PassiveLaw.of(coefficients, options.width),
                free=free,
                residual=float(np.sqrt(rss / samples)),
                aic=float(score + 2.0 * free),
                bic=float(score + np.log(effective) * free),
                angle_error=angle_error,
                moment_error=moment_error,
                force_error=force_error,
            )
        )
    least_aic = min(fit.aic for fit in fits)
    least_bic = min(fit.bic for fit in fits)
    fits = [replace(fit, aic=fit.aic - least_aic, bic=fit.bic - least_bic) for fit in fits]
    by_bic = min(
        (fit for fit in fits if fit.bic <= MAX_CRITERION_DIFFERENCE),
        key=lambda fit: (fit.free, fit.bic),
    )
    plain = min((fit for fit in fits if fit.terms in PLAIN), key=lambda fit: fit.bic)
    # Without a window held out, errors are NaN: no other law gains on a plain one.
    better = by_bic.angle_error < MIN_HELD_OUT_GAIN * plain.angle_error
    chosen = by_bic if by_bic.terms in PLAIN or better else plain
    shown = _shown(problem, chosen.terms, left_out[0], trained[0], slack) if left_out else None
    acting = None
    if not problem.sums.muscles:
        spring = tuple(term for term in chosen.terms if term.startswith("stiffness"))
        acting = acting_law(problem, phi, spring, options.draws, options.seed)
    return PassiveComparison(
        fits=tuple(fits), chosen=chosen, by_bic=by_bic, prediction=shown, acting=acting
    )


def _applicable(problem: PassiveProblem) -> list[tuple[str, ...]]:
    """The laws of whose terms the recordings have muscles, hinges and axes; viscosity alone comes
    first.
    """
    lacking = set() if problem.sums.muscles else {"muscles"}
    lacking |= (
        set() if all(len(recording.hinges) for recording in problem.recordings) else {"hinges"}
    )
    lacking |= {"viscosity by axis"} if len(problem.axes) == 1 else set()
    return [law for law in LAWS if not lacking & {*law}]


def _from_spring(problem: PassiveProblem) -> tuple[PassiveProblem, Rotation]:
    """The problem with angles counted from where a ball's spring is slack, and that rotation from
    the given zero.
    """
    slack = Rotation.identity()
    for _ in range(NEUTRAL_ROUNDS):
        parameters = problem.parameters(np.ones(len(problem.sums)))
        shift = neutral_position(problem.sums, parameters)
        moved = PassiveProblem.of(
            counted_from(problem.recordings, shift), problem.width, problem.inertial
        )
        if spring_misfit(moved.sums, parameters) >= spring_misfit(problem.sums, parameters):
            break
        problem = moved
        slack = slack * Rotation.from_rotvec(-shift)
    return problem, slack


def _predict(
    problem: PassiveProblem, terms: Sequence[str], window: Window, parameters: Array
) -> SwingMotion:
    law = problem.fit(terms, window.training(len(problem.sums)), parameters)[0]
    return swing_forward(
        window.recording, window.frames, parameters, PassiveLaw.of(law, problem.width)
    )


def _shown(
    problem: PassiveProblem,
    terms: Sequence[str],
    window: Window,
    parameters: Array,
    slack: Rotation,
) -> Prediction:
    measured = window.measured
    viscous = _predict(problem, ALONE, window, parameters)
    chosen = _predict(problem, terms, window, parameters)
    axis = hinge_axis(window.recording)
    turn = axis[:, None] if axis.any() else np.eye(3)
    first = Rotation.from_matrix(measured.rotations[0])
    hanging = (
        first
        * Rotation.from_rotvec(turn @ window.recording.angles[window.frames][0]).inv()
        * slack.inv()
    )
    return Prediction(
        time=measured.time,
        axes=window.recording.axes,
        measured=_angles(measured, hanging) @ turn,
        viscous=_angles(viscous, hanging) @ turn,
        chosen=_angles(chosen, hanging) @ turn,
    )


def _angles(motion: SwingMotion, hanging: Rotation) -> Array:
    """Rotation vectors (frames, 3) of a limb from where it hangs [rad]."""
    return (hanging.inv() * Rotation.from_matrix(motion.rotations)).as_rotvec()


def _estimates(
    terms: Sequence[str], value: Array, draws: Array, axes: Sequence[str], slack: Rotation
) -> dict[str, Interval]:
    """Coefficients by name, with the intervals of draws (draws, 3 axes + 6); angles are counted
    from `slack`.
    """
    n = len(axes)
    places = {name: places[0] for term in terms for name, places in term_places(term, axes).items()}
    result = {
        name: Interval.of_draws(value[i], np.maximum(draws[:, i], 0.0))
        for name, i in places.items()
    }
    if any(term.startswith("stiffness") for term in terms):
        rest = _rest_angles(value[..., 2 * n : 3 * n], value[..., n : 2 * n], slack)
        rests = _rest_angles(draws[..., 2 * n : 3 * n], draws[..., n : 2 * n], slack)
        for axis, angle, several in zip(axes, rest, rests.T, strict=True):
            if np.isfinite(angle) and np.isfinite(several).any():
                result[f"rest angle {axis}"] = Interval.of_draws(float(angle), several)
    return result


def _rest_angles(moment: Array, stiffness: Array, slack: Rotation) -> Array:
    """Moment over stiffness (..., axes) as angles from the given zero; NaN where there is no
    spring.
    """
    lies = np.divide(
        moment, stiffness, out=np.full(np.shape(moment), np.nan), where=np.asarray(stiffness) > 0.0
    )
    if lies.shape[-1] != 3:
        return lies
    sprung = np.isfinite(lies).all(axis=-1)
    lies[sprung] = (slack * Rotation.from_rotvec(lies[sprung])).as_rotvec()
    return lies
