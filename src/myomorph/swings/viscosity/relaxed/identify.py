"""Damping, stiffness, rest angle and friction of a relaxed joint from how its limb swings.

Masses are known from a model. Unknown are the law's coefficients, the same in all drops, and the
state in which each stretch of swings begins; they minimize the square of measured less swung
angles. Noise of markers is in what is compared and in no row, so nothing is differentiated but for
the first guess.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from myomorph.core.fit.interval_rule import half_width
from myomorph.core.fit.verdict import Verdict, simplest
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.interval import Interval
from myomorph.lab.uncertainty.sources import Sources
from myomorph.swings.viscosity.relaxed.drops import Drop
from myomorph.swings.viscosity.relaxed.swing_equation import SwingEquation
from myomorph.swings.viscosity.relaxed.swing_fit import SwingFit, fit_swings, state_at
from myomorph.swings.viscosity.trust.law import PassiveLaw, law_columns

Terms = tuple[str, ...]
"""Of a law."""
SPRUNG = ("viscosity", "stiffness")
LAWS: tuple[Terms, ...] = (
    ("viscosity",),
    ("viscosity", "coulomb"),
    SPRUNG,
    (*SPRUNG, "coulomb"),
)
"""What is compared, the simplest first; with stiffness goes the angle at which the spring is at
rest.
"""
UNITS: Mapping[str, str] = {
    "viscosity": "N m s/rad",
    "stiffness": "N m/rad",
    "zero_torque": "N m",
    "rest_angle": "rad",
    "coulomb": "N m",
}
"""Of the quantities, in the order of the tables; the spring is slack at its rest angle."""
PLACES = ("viscosity", "stiffness", "zero_torque", "coulomb")
"""The first coefficients of a law of one axis."""
SIGNED = ("rest_angle", "zero_torque")
"""Quantities that may be below 0."""
AS_GOOD = 1.1  # A simpler law is taken whose held-out error is within this factor of the least.
MAX_FOLDS = 4
MIN_HALVES = 3  # Half swings that every drop keeps
MIN_DROPS = 3  # From which the scatter between drops counts
MISSED = np.deg2rad(2.0)
MISSED_SHARE = 0.05
"""By how much a half swing may end elsewhere than constant coefficients predict: an angle [rad] and
a share of it.
"""
LEVEL = 0.95  # Of the intervals
USUAL = Sources()


@dataclass(frozen=True)
class LimbOptions:
    """Errors of the limb's model, as relative standard deviations: all coefficients depend on them.

    Attributes
    ----------
    cutoff : low-pass of the motion of all other coordinates, and of the first guess [Hz]
    mass_sd : of the mass of all that swings (Rao et al. 2006)
    center_sd : of its center's distance from the joint, as a share of the radius of gyration
    inertia_sd : of its inertia about that center
    """

    cutoff: float = 6.0
    mass_sd: float = USUAL.segment_mass
    center_sd: float = USUAL.mass_center
    inertia_sd: float = USUAL.inertia

    def __post_init__(self) -> None:
        if not (self.cutoff > 0.0 and min(self.mass_sd, self.center_sd, self.inertia_sd) >= 0.0):
            raise BadData(
                f"a relaxed limb needs a cutoff above 0 and errors of 0 or more, but got {self}"
            )


@dataclass(frozen=True)
class LimbBody:
    """What swings.

    Attributes
    ----------
    mass : [kg]
    distance : of its center from the axis [m]
    inertia : about the axis [kg m^2]
    """

    mass: float
    distance: float
    inertia: float

    @staticmethod
    def of(equation: SwingEquation, mass: float, gravity: float) -> LimbBody:
        """Find distance and inertia as an equation of motion has them.

        Parameters
        ----------
        equation : of motion
        mass : that swings [kg]
        gravity : [m/s^2]
        """
        span = 0.8 * equation.half
        angles = np.linspace(equation.middle - span, equation.middle + span, 30)
        still = np.zeros(len(equation.time))
        weights = [equation.torque(still + angle, still, still).mean() for angle in angles]
        waves = np.array([np.cos(angles), np.sin(angles)]).T
        moment = np.linalg.lstsq(waves, weights, rcond=None)[0]
        at = still + equation.middle
        accelerated = equation.torque(at, still, still + 1.0)
        inertia = float((accelerated - equation.torque(at, still, still)).mean())
        return LimbBody(mass, float(np.linalg.norm(moment)) / (gravity * mass), inertia)

    def errors(self, options: LimbOptions) -> dict[str, tuple[float, float]]:
        """Find what each source, one standard deviation off, does to inertia and first moment.

        Parameters
        ----------
        options : with the standard deviations

        Returns
        -------
        factors of inertia and of mass times distance, by source
        """
        central = max(self.inertia - self.mass * self.distance**2, 0.0)
        moved = options.center_sd * np.sqrt(central / self.mass)
        of_center = 1.0 + 2.0 * self.mass * self.distance * moved / self.inertia
        return {
            "mass": (1.0 + options.mass_sd, 1.0 + options.mass_sd),
            "mass center": (of_center, 1.0 + moved / self.distance),
            "inertia": (1.0 + options.inertia_sd * central / self.inertia, 1.0),
        }


@dataclass(frozen=True)
class Missed:
    """A half swing that ends elsewhere than constant coefficients predict.

    Attributes
    ----------
    drop : name
    half : number of the half swing
    time : when it begins and ends [s]
    short : by how much it falls short of the prediction, beyond it where negative [rad]
    excursion : of the half swing [rad]
    """

    drop: str
    half: int
    time: tuple[float, float]
    short: float
    excursion: float


@dataclass(frozen=True, eq=False)
class LimbResult:
    """What the drops of a limb show.

    Attributes
    ----------
    estimates : quantities by the names of `UNITS`; the interval of one that other laws have too
        holds what those give that are not excluded
    fit : of the chosen law
    drops : with the half swings that were used
    held_out : of each law, against viscosity alone
    alike : other laws whose held-out error is within `AS_GOOD` of the least
    shares : standard deviations by source and quantity
    missed : what constant coefficients do not explain
    """

    estimates: Mapping[str, Interval]
    fit: SwingFit
    drops: tuple[Drop, ...]
    held_out: Mapping[Terms, Verdict]
    alike: tuple[Terms, ...]
    shares: Mapping[str, Mapping[str, float]]
    missed: tuple[Missed, ...]


class ExplainedDrops(NamedTuple):
    """A law, and the half swings that constant coefficients explain.

    Attributes
    ----------
    fit : to these half swings
    drops : with these half swings
    missed : the others
    """

    fit: SwingFit
    drops: tuple[Drop, ...]
    missed: tuple[Missed, ...]


class Fold(NamedTuple):
    """Drops that a law is fitted to, and those that it predicts."""

    training: Sequence[Drop]
    test: Sequence[Drop]


def identify_limb(
    drops: Sequence[Drop], body: LimbBody, options: LimbOptions | None = None
) -> LimbResult:
    """Find the coefficients of the joint's passive torque and their 95 % intervals.

    The law is chosen on held-out drops (of one drop: on its halves). Intervals hold what the
    residuals leave open, by half swings; where there are three drops or more, by how much they
    differ, if that is more; and errors of the model's masses.

    Parameters
    ----------
    drops : of the limb
    body : what swings
    options : errors of the model's masses

    Returns
    -------
    the coefficients with everything that certifies them

    Raises
    ------
    BadData : too little is left
    """
    options = options or LimbOptions()
    drops = tuple(drops)
    missed: tuple[Missed, ...] = ()
    # What the law does not explain is left out, and the law chosen again without it.
    for _ in range(2):
        held_out = _held_out(drops)
        terms = simplest(held_out, AS_GOOD)
        explained = _explained(drops, terms if "stiffness" in terms else SPRUNG, missed)
        missed = explained.missed
        if not missed:
            break
        drops = explained.drops
    fit = fit_swings(drops, terms)
    variances = {"swings": _variances(fit, drops), **_model_variances(fit, drops, body, options)}
    shares = {
        source: {name: float(np.sqrt(variance)) for name, variance in of.items()}
        for source, of in variances.items()
    }
    estimates = _intervals(quantities(fit), variances)
    alike = _alike(held_out, terms)
    for other in alike:
        estimates = _joined(estimates, fit_swings(drops, other), drops, variances)
    return LimbResult(
        estimates=estimates,
        fit=fit,
        drops=drops,
        held_out=held_out,
        alike=alike,
        shares=shares,
        missed=missed,
    )


def _model_variances(
    fit: SwingFit, drops: Sequence[Drop], body: LimbBody, options: LimbOptions
) -> dict[str, dict[str, float]]:
    """Find variances by source and quantity: fits with the model off by one deviation."""
    values = quantities(fit)
    variances = {}
    for source, factors in body.errors(options).items():
        other = [replace(drop, equation=drop.equation.scaled(*factors)) for drop in drops]
        changed = quantities(fit_swings(other, fit.terms, fit))
        variances[source] = {
            name: (changed.get(name, value) - value) ** 2 for name, value in values.items()
        }
    return variances


def _alike(held_out: Mapping[Terms, Verdict], chosen: Terms) -> tuple[Terms, ...]:
    """List other laws that predict held-out drops about as well as the best one."""
    least = min(verdict.ratio for verdict in held_out.values())
    return tuple(
        terms
        for terms, verdict in held_out.items()
        if terms != chosen and verdict.ratio <= AS_GOOD * least
    )


def _joined(
    estimates: Mapping[str, Interval],
    other: SwingFit,
    drops: Sequence[Drop],
    variances: Mapping[str, Mapping[str, float]],
) -> dict[str, Interval]:
    """Let intervals hold what another law gives.

    Errors of the masses put all laws off alike.

    Parameters
    ----------
    estimates : of the chosen law
    other : fit of another law to the same drops
    drops : that both are fitted to
    variances : of the chosen law, by source and quantity
    """
    values = {name: value for name, value in quantities(other).items() if name in estimates}
    swings = _variances(other, drops)
    of_model = {source: of for source, of in variances.items() if source != "swings"}
    beside = _intervals(values, {"swings": swings, **of_model})
    return {
        name: Interval(
            value=estimate.value,
            low=min(estimate.low, beside[name].low) if name in beside else estimate.low,
            high=max(estimate.high, beside[name].high) if name in beside else estimate.high,
        )
        for name, estimate in estimates.items()
    }


def _intervals(
    values: Mapping[str, float], variances: Mapping[str, Mapping[str, float]]
) -> dict[str, Interval]:
    """Make intervals of values, whose variances by source and quantity add up."""
    estimates = {}
    for name, value in values.items():
        sd = np.sqrt(sum(of[name] for of in variances.values()))
        half = float(half_width(sd, LEVEL))
        low = value - half if name in SIGNED else max(value - half, 0.0)
        estimates[name] = Interval(value=value, low=low, high=value + half)
    if "stiffness" in estimates and estimates["stiffness"].low <= 0.0:
        # A spring that may be none is slack nowhere.
        estimates.pop("rest_angle", None)
    return estimates


def swung(result: LimbResult) -> Iterator[Array]:
    """Swing every drop as the chosen law does.

    Parameters
    ----------
    result : of the limb

    Yields
    ------
    (frames,) angles of a drop, NaN where half swings are not used [rad]
    """
    states = iter(result.fit.states)
    for drop in result.drops:
        angles = np.full(len(drop.angles), np.nan)
        for part in drop.parts:
            angle, rate = next(states)
            angles[part] = drop.equation.swing(part.start, part.stop, angle, rate, result.fit.law)
        yield angles


def quantities(fit: SwingFit) -> dict[str, float]:
    """Name the fitted values as `UNITS` do; a spring without stiffness has no rest.

    Parameters
    ----------
    fit : of a law
    """
    known = dict(zip(PLACES, fit.law.coefficients, strict=False))
    if known["stiffness"] > 0.0:
        known["rest_angle"] = known["zero_torque"] / known["stiffness"]
    asked = set(fit.terms)
    if "stiffness" in fit.terms:
        asked |= {"zero_torque", "rest_angle"}
    return {name: float(known[name]) for name in UNITS if name in asked and name in known}


def _held_out(drops: Sequence[Drop]) -> dict[Terms, Verdict]:
    """Predict each part of the drops by laws from the other parts; the states are its own."""
    folds = list(_folds(drops))
    errors = {terms: [_errors(fold, terms) for fold in folds] for terms in LAWS}
    misfits = {
        terms: np.array([[np.sqrt(np.mean(np.square(left)))] for left in parts])
        for terms, parts in errors.items()
    }
    return {
        terms: Verdict(
            kinds=(("angle", "rad"),),
            parts=tuple(f"part {number + 1}" for number in range(len(folds))),
            estimate=misfits[terms],
            generic=misfits[LAWS[0]],
            weights=np.array([len(left) for left in errors[terms]], np.float64),
            what="drops held out in turn",
        )
        for terms in LAWS
    }


def _errors(fold: Fold, terms: Terms) -> Array:
    """Predict the angles of a fold's test drops: measured less swung (frames,) [rad]."""
    law = fit_swings(fold.training, terms).law
    return fit_swings(fold.test, terms, law=law).left


def _folds(drops: Sequence[Drop]) -> Iterator[Fold]:
    """Yield drops without one of them; of one drop, its halves."""
    if len(drops) > 1:
        for i in range(min(len(drops), MAX_FOLDS)):
            yield Fold(training=[*drops[:i], *drops[i + 1 :]], test=[drops[i]])
        return
    (drop,) = drops
    numbers = np.arange(len(drop.used))
    first_part, second_part = np.array_split(np.flatnonzero(drop.used), 2)
    first = replace(drop, used=np.isin(numbers, first_part))
    second = replace(drop, used=np.isin(numbers, second_part))
    yield Fold(training=[first], test=[second])
    yield Fold(training=[second], test=[first])


def _explained(
    drops: tuple[Drop, ...], terms: Sequence[str], missed: tuple[Missed, ...]
) -> ExplainedDrops:
    """Fit half swings that constant coefficients explain.

    The worst half swing is left out until none is missed, as long as each drop keeps some.
    """
    while True:
        fit = fit_swings(drops, terms)
        found = _worst(drops, fit.law)
        if found is None:
            return ExplainedDrops(fit=fit, drops=drops, missed=missed)
        drops = tuple(_without(drop, found) if drop.name == found.drop else drop for drop in drops)
        missed = (*missed, found)


def _worst(drops: Sequence[Drop], law: PassiveLaw) -> Missed | None:
    """Find the half swing that a law explains worst; None where it explains all."""
    worst = 1.0
    found = None
    for drop in drops:
        if drop.used.sum() <= MIN_HALVES:
            continue
        for half in np.flatnonzero(drop.used).tolist():
            short, excursion = missing(drop, half, law)
            excess = abs(short) / (MISSED + MISSED_SHARE * excursion)
            if excess > worst:
                worst = excess
                found = Missed(
                    drop=drop.name,
                    half=half,
                    time=drop.time(half),
                    short=short,
                    excursion=excursion,
                )
    return found


def _without(drop: Drop, missed: Missed) -> Drop:
    """Leave a half swing of a drop out."""
    used = np.array(drop.used)
    used[missed.half] = False
    return replace(drop, used=used)


def missing(drop: Drop, half: int, law: PassiveLaw) -> tuple[float, float]:
    """Find how far a half swing ends short of where a law takes it from its beginning.

    Parameters
    ----------
    drop : with the half swing
    half : its number
    law : that swings it

    Returns
    -------
    that angle, and the half swing's excursion [rad]
    """
    start, stop = map(int, drop.turns[half : half + 2])
    angle, rate = state_at(drop, start)
    end, _ = state_at(drop, stop)
    more = min(stop + max(3, (stop - start) // 2), len(drop.equation.time))
    swung = drop.equation.swing(start, more, angle, rate if half == 0 else 0.0, law)
    way = np.sign(end - angle)
    return float(np.max(way * (swung - angle)) - way * (end - angle)), float(abs(end - angle))


def _variances(fit: SwingFit, drops: Sequence[Drop]) -> dict[str, float]:
    """Find the variance of every quantity from what the swings leave.

    It is the largest of that by frames, as if these were independent, that by half swings, which
    err together, and that by the drops.
    """
    own = _slopes_of_quantities(fit)
    covariances = _covariances(fit)
    result = {
        name: max(float(slope @ covariance @ slope) for covariance in covariances)
        for name, slope in own.items()
    }
    if len(drops) < MIN_DROPS:
        return result
    single = [quantities(fit_swings([drop], fit.terms)) for drop in drops]
    for name in result:
        known = [values[name] for values in single if name in values]
        if len(known) >= MIN_DROPS:
            # The standard deviation that has Student's interval of so few drops.
            scatter = np.std(known, ddof=1) / np.sqrt(len(known))
            wide = half_width(scatter, LEVEL, len(known) - 1) / half_width(1.0, LEVEL)
            result[name] = max(result[name], float(wide) ** 2)
    return result


def _slopes_of_quantities(fit: SwingFit) -> dict[str, Array]:
    """Find the slopes (coefficients,) of every quantity in the law's own coefficients."""
    mapping, _ = law_columns(fit.terms, 1)
    _, stiffness, torque, _ = fit.law.coefficients[:4]
    slopes = dict(zip(PLACES, np.eye(len(PLACES)), strict=True))
    slopes["rest_angle"] = np.zeros(len(PLACES))
    if stiffness > 0.0:
        slopes["rest_angle"] = np.array([0.0, -torque / stiffness**2, 1.0 / stiffness, 0.0])
    return {name: slopes[name] @ mapping[: len(PLACES)] for name in quantities(fit)}


def _covariances(fit: SwingFit) -> tuple[Array, Array]:
    """Find covariances of the law's own coefficients, by frames and by half swings.

    With slopes J of the residuals r, of N frames and n unknowns, and b half swings of B,

        (J^T J)^-1 r^T r / (N - n),    (J^T J)^-1 (sum_b s_b s_b^T) (J^T J)^-1 B / (B - free)

    with scores s_b = J_b^T r_b.

    Returns
    -------
    (coefficients, coefficients) each
    """
    free = law_columns(fit.terms, 1)[0].shape[1]
    count, size = fit.slopes.shape
    inverse = np.linalg.pinv(fit.slopes.T @ fit.slopes)
    halves = [fit.block == half for half in np.unique(fit.block)]
    scores = np.array([fit.slopes[half].T @ fit.left[half] for half in halves])
    by_frames = inverse * np.square(fit.left).sum() / max(count - size, 1)
    scatter = inverse @ (scores.T @ scores) @ inverse
    by_halves = scatter * len(scores) / max(len(scores) - free, 1)
    return by_frames[:free, :free], by_halves[:free, :free]
