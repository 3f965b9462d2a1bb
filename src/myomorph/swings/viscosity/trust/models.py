"""Other passive laws than viscosity, fitted to the same torques and judged on held-out swings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.core.fit.correlation import variance_samples
from myomorph.core.fit.interval_rule import interval_of_draws
from myomorph.core.fit.verdict import Verdict
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.identification.condition import Influences
from myomorph.swings.viscosity.identification.inertia import InertiaOptions, LimbInertia, Tare
from myomorph.swings.viscosity.identification.torque import (
    counted_from,
    neutral_position,
    spring_misfit,
)
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.trust.acting import ActingLaw, Bootstrap, acting_law
from myomorph.swings.viscosity.trust.forward import (
    SwingMotion,
    Window,
    hinge_axis,
    swing_forward,
    windows,
)
from myomorph.swings.viscosity.trust.law import (
    LEVEL,
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
RUBBED = ("viscosity", "coulomb")
"""The law of dry friction, which acts where `acting_law` finds it."""
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


class HeldOut(NamedTuple):
    """A window that is predicted without itself.

    Attributes
    ----------
    window : swings that follow each other
    parameters : (10,) of the limb, from all other swings
    """

    window: Window
    parameters: Array


class Judges(NamedTuple):
    """What all laws of a problem are judged by.

    Attributes
    ----------
    slack : rotation from the given zero of angles to where they are counted from
    inertia : of the limb
    counts : (blocks, blocks) how often each block counts where one is left out
    parameters : (blocks, 10) of the limb, one block left out
    held_out : windows in turn
    """

    slack: Rotation
    inertia: LimbInertia
    counts: Array
    parameters: Array
    held_out: tuple[HeldOut, ...]


@read_only
class PassiveFit:
    """One law, as the torques and the swings judge it.

    Attributes
    ----------
    terms : of the law
    coefficients : by name, units in `UNITS`
    law : with these coefficients
    free : how many coefficients it has
    residual : root mean square of torque that it leaves [N m]
    aic, bic : criteria, above the lowest of all laws
    squares : (windows, 3) mean squares of what held-out windows differ by from their prediction:
        angle between measured and predicted limb [rad^2], moment [(N m)^2], force [N^2]
    """

    terms: tuple[str, ...]
    coefficients: Mapping[str, Interval]
    law: PassiveLaw
    free: int
    residual: float
    aic: float
    bic: float
    squares: Array

    @property
    def name(self) -> str:
        """The terms in words."""
        return " + ".join(self.terms)

    @property
    def errors(self) -> Array:
        """(3,) root mean square over the held-out windows [rad], [N m], [N]; NaN without any."""
        return np.sqrt(np.mean(self.squares, axis=0)) if len(self.squares) else np.full(3, np.nan)

    @property
    def angle_error(self) -> float:
        """Root mean square angle between measured and predicted limb [rad]."""
        return float(self.errors[0])

    @property
    def moment_error(self) -> float:
        """Root mean square moment, measured less predicted [N m]."""
        return float(self.errors[1])

    @property
    def force_error(self) -> float:
        """Root mean square force, measured less predicted [N]."""
        return float(self.errors[2])


@read_only
class Prediction:
    """A window that was left out, for a figure.

    Attributes
    ----------
    time : (frames,) [s]
    axes : names of the free axes
    measured : (frames, axes) angles from hanging at rest [rad]
    viscous, chosen : (frames, axes) as viscosity alone and the chosen law predict them from the
        first frame [rad]
    """

    time: Array
    axes: tuple[str, ...]
    measured: Array
    viscous: Array
    chosen: Array


@dataclass(frozen=True, eq=False)
class PassiveComparison:
    """Which passive law the swings ask for.

    Attributes
    ----------
    fits : in the order of `LAWS`
    chosen : `by_bic` where that is plain or predicts held-out windows far better than `PLAIN` laws,
        else the best of these
    by_bic : the simplest whose BIC is within `MAX_CRITERION_DIFFERENCE` of the lowest
    verdict : on `by_bic`, against the best of the plain laws
    prediction : of the first window, None where no two could be had
    acting : without muscles, what acts beside one viscosity
    """

    fits: tuple[PassiveFit, ...]
    chosen: PassiveFit
    by_bic: PassiveFit
    verdict: Verdict
    prediction: Prediction | None = field(repr=False)
    acting: ActingLaw | None = None

    @property
    def conflict(self) -> str:
        """Where the criteria disagree, in words; else ""."""
        dry = self.acting is not None and bool(self.acting.friction)
        if self.by_bic is self.chosen or (dry and self.by_bic.terms == RUBBED):
            return ""
        law = self.by_bic
        plain = self.chosen
        if not np.isfinite(plain.angle_error):
            return (
                f"BIC favors {law.name}, but no window could be held out to judge it:"
                f" {plain.name} is used"
            )
        other, plain_error = np.rad2deg([law.angle_error, plain.angle_error])
        predicts = (
            f"it predicts held-out swings to {other:.1f} degrees, {plain.name} to {plain_error:.1f}"
        )
        return f"BIC favors {law.name}, but {predicts}: {plain.name} is used"


def compare_passive_laws(
    recordings: Sequence[SwingRecording], options: PassiveOptions | None = None
) -> PassiveComparison:
    """Fit every law to the torques of one condition, and let it predict windows held out.

    All laws are least squares of the same torques, torque_rows phi, with coefficients of at least 0
    and a free rest angle. The criteria count independent samples, not frames, for a low-pass leaves
    about two a period of its cutoff:

        AIC = n ln(RSS / N) + 2 free,   BIC = n ln(RSS / N) + ln(n) free,   n = N / sum_k rho_k^2

    with rho the autocorrelation of what the richest law leaves (`variance_samples`). A prediction,
    and the inertia and law that make it, know nothing of the window but its first frame. The angles
    of a ball are counted from where its spring is slack (`neutral_position`), for only from there
    is the spring linear in them.

    Parameters
    ----------
    recordings : of one condition
    options : see `PassiveOptions`
    """
    options = options or PassiveOptions()
    inertial = InertiaOptions(options.tare, options.prior_sd)
    problem = PassiveProblem.of(recordings, options.width, inertial)
    slack = Rotation.identity()
    if len(problem.axes) == 3:
        problem, slack = _from_spring(problem)
    judges = _judges(problem, slack, options)
    fits = _fits(problem, judges, options)

    likely = [fit for fit in fits if fit.bic <= MAX_CRITERION_DIFFERENCE]
    by_bic = min(likely, key=lambda fit: (fit.free, fit.bic))
    plain = min((fit for fit in fits if fit.terms in PLAIN), key=lambda fit: fit.bic)
    verdict = _verdict(by_bic, plain)
    chosen = by_bic if by_bic.terms in PLAIN or verdict.better else plain

    shown = None
    if judges.held_out:
        shown = _shown(problem, chosen.terms, judges.held_out[0], slack)
    acting = None
    if not problem.sums.muscles:
        spring = tuple(term for term in chosen.terms if term.startswith("stiffness"))
        bootstrap = Bootstrap(draws=options.draws, seed=options.seed)
        acting = acting_law(problem, judges.inertia, spring, bootstrap)
    return PassiveComparison(
        fits=fits, chosen=chosen, by_bic=by_bic, verdict=verdict, prediction=shown, acting=acting
    )


def _judges(problem: PassiveProblem, slack: Rotation, options: PassiveOptions) -> Judges:
    """Leave out every block and every window in turn."""
    blocks = len(problem.sums)
    counts = 1.0 - np.eye(blocks)
    left_out = windows(problem.recordings, problem.sums, options.horizon, options.held_out)
    return Judges(
        slack=slack,
        inertia=problem.inertia(np.ones(blocks)),
        counts=counts,
        parameters=np.array([problem.parameters(block) for block in counts]),
        held_out=tuple(
            HeldOut(window=window, parameters=problem.parameters(window.training(blocks)))
            for window in left_out
        ),
    )


def _fits(
    problem: PassiveProblem, judges: Judges, options: PassiveOptions
) -> tuple[PassiveFit, ...]:
    """Fit all laws; criteria are above the lowest."""
    laws = _applicable(problem)
    every = np.ones(len(problem.sums))
    solutions = [problem.fit(terms, every, judges.inertia.parameters) for terms in laws]
    richest, _ = min(solutions, key=lambda solution: float(solution[1]))
    left = problem.left(judges.inertia.parameters, PassiveLaw.of(richest, options.width))
    effective = variance_samples(left)
    samples = problem.samples(every)
    fits = []
    for terms, (coefficients, rss) in zip(laws, solutions, strict=True):
        free = law_columns(terms, len(problem.axes))[0].shape[1]
        score = effective * np.log(max(float(rss), 1e-300) / samples)
        fit = PassiveFit(
            terms=terms,
            coefficients=_coefficients(problem, terms, coefficients, judges, options),
            law=PassiveLaw.of(coefficients, options.width),
            free=free,
            residual=float(np.sqrt(rss / samples)),
            aic=float(score + 2.0 * free),
            bic=float(score + np.log(effective) * free),
            squares=_squares(problem, terms, judges.held_out, options.tare != "known"),
        )
        fits.append(fit)
    min_aic = min(fit.aic for fit in fits)
    min_bic = min(fit.bic for fit in fits)
    return tuple(replace(fit, aic=fit.aic - min_aic, bic=fit.bic - min_bic) for fit in fits)


def _coefficients(
    problem: PassiveProblem,
    terms: tuple[str, ...],
    coefficients: Array,
    judges: Judges,
    options: PassiveOptions,
) -> dict[str, Interval]:
    """Draw intervals of a law's coefficients (3 axes + 6,) from what each block adds to them."""
    less = problem.fit(terms, judges.counts, judges.parameters)[0]
    influences = Influences(coefficients, coefficients - less, problem.sums.trial)
    draws = influences.draws(options.draws, np.random.default_rng(options.seed))
    return _estimates(terms, coefficients, draws, problem.axes, judges.slack)


def _squares(
    problem: PassiveProblem,
    terms: Sequence[str],
    held_out: Sequence[HeldOut],
    free_offset: bool,
) -> Array:
    """Predict all windows by a law: mean squares (windows, 3) of what they differ by."""
    errors = [held.window.errors(_predict(problem, terms, held), free_offset) for held in held_out]
    return np.array(errors).reshape(-1, 3)


def _verdict(law: PassiveFit, plain: PassiveFit) -> Verdict:
    """Compare the angles of held-out windows that a law and a plain one predict."""
    count = len(law.squares)
    return Verdict(
        kinds=(("angle", "rad"),),
        parts=tuple(f"window {number + 1}" for number in range(count)),
        estimate=np.sqrt(law.squares[:, :1]),
        generic=np.sqrt(plain.squares[:, :1]),
        weights=np.ones(count),
        what="windows held out in turn",
        limit=MIN_HELD_OUT_GAIN,
    )


def _applicable(problem: PassiveProblem) -> list[tuple[str, ...]]:
    """List laws for whose terms the recordings have muscles, hinges and axes, viscosity first."""
    missing = set()
    if not problem.sums.muscles:
        missing.add("muscles")
    if not all(len(recording.hinges) for recording in problem.recordings):
        missing.add("hinges")
    if len(problem.axes) == 1:
        missing.add("viscosity by axis")
    return [law for law in LAWS if not missing & {*law}]


def _from_spring(problem: PassiveProblem) -> tuple[PassiveProblem, Rotation]:
    """Count a ball's angles from where its spring is slack.

    Returns
    -------
    the problem with these angles, and the rotation from the given zero to theirs
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


def _predict(problem: PassiveProblem, terms: Sequence[str], held: HeldOut) -> SwingMotion:
    """Swing a window forward by a law that was fitted without it."""
    window = held.window
    law = problem.fit(terms, window.training(len(problem.sums)), held.parameters)[0]
    return swing_forward(
        window.recording, window.frames, held.parameters, PassiveLaw.of(law, problem.width)
    )


def _shown(
    problem: PassiveProblem, terms: Sequence[str], held: HeldOut, slack: Rotation
) -> Prediction:
    """Predict a window by viscosity alone and by the law of `terms`, in angles from rest."""
    window = held.window
    measured = window.measured
    viscous = _predict(problem, ALONE, held)
    chosen = _predict(problem, terms, held)
    axis = hinge_axis(window.recording)
    turn = axis[:, None] if axis.any() else np.eye(3)
    first = Rotation.from_matrix(measured.rotations[0])
    from_rest = Rotation.from_rotvec(turn @ window.recording.angles[window.frames][0])
    hanging = first * from_rest.inv() * slack.inv()
    return Prediction(
        time=measured.time,
        axes=window.recording.axes,
        measured=_angles(measured, hanging) @ turn,
        viscous=_angles(viscous, hanging) @ turn,
        chosen=_angles(chosen, hanging) @ turn,
    )


def _angles(motion: SwingMotion, hanging: Rotation) -> Array:
    """Find rotation vectors (frames, 3) of a limb from where it hangs [rad]."""
    return (hanging.inv() * Rotation.from_matrix(motion.rotations)).as_rotvec()


def _estimates(
    terms: Sequence[str], value: Array, draws: Array, axes: Sequence[str], slack: Rotation
) -> dict[str, Interval]:
    """Name coefficients, with the intervals of their draws.

    Parameters
    ----------
    value : (3 axes + 6,) of the law
    draws : (draws, 3 axes + 6)
    slack : where angles are counted from
    """
    n = len(axes)
    places = {name: places[0] for term in terms for name, places in term_places(term, axes).items()}
    result = {
        name: interval_of_draws(value[place], np.maximum(draws[:, place], 0.0), LEVEL)
        for name, place in places.items()
    }
    if not any(term.startswith("stiffness") for term in terms):
        return result
    rest = _rest_angles(value[..., 2 * n : 3 * n], value[..., n : 2 * n], slack)
    rests = _rest_angles(draws[..., 2 * n : 3 * n], draws[..., n : 2 * n], slack)
    for axis, angle, several in zip(axes, rest, rests.T, strict=True):
        if np.isfinite(angle) and np.isfinite(several).any():
            result[f"rest angle {axis}"] = interval_of_draws(float(angle), several, LEVEL)
    return result


def _rest_angles(moment: Array, stiffness: Array, slack: Rotation) -> Array:
    """Divide moments by stiffness: angles from the given zero, NaN where there is no spring.

    Parameters
    ----------
    moment, stiffness : (..., axes) [N m], [N m/rad]
    slack : where the moments' angles are counted from

    Returns
    -------
    (..., axes) [rad]
    """
    lies = np.divide(
        moment, stiffness, out=np.full(np.shape(moment), np.nan), where=np.asarray(stiffness) > 0.0
    )
    if lies.shape[-1] != 3:
        return lies
    sprung = np.isfinite(lies).all(axis=-1)
    lies[sprung] = (slack * Rotation.from_rotvec(lies[sprung])).as_rotvec()
    return lies
