"""Damping, stiffness, rest angle and friction of a relaxed joint from how its limb swings, masses
known from a model.

Unknown are the law's coefficients, the same in all drops, and the state in which each stretch of
swings begins; they minimize the square of measured less swung angles. Noise of markers is in what
is compared and in no row, so nothing is differentiated but for the first guess.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.interval import Interval
from myomorph.lab.uncertainty.sources import Sources
from myomorph.swings.viscosity.relaxed.drops import Drop
from myomorph.swings.viscosity.relaxed.swing_equation import SwingEquation
from myomorph.swings.viscosity.relaxed.swing_fit import SwingFit, fit_swings, state_at
from myomorph.swings.viscosity.trust.law import PassiveLaw, law_columns

SPRUNG = ("viscosity", "stiffness")
LAWS: tuple[tuple[str, ...], ...] = (("viscosity",), SPRUNG, (*SPRUNG, "coulomb"))
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
AS_GOOD = 1.1  # A simpler law is taken whose held-out error is within this factor of the least.
MAX_FOLDS = 4
MISSED = np.deg2rad(2.0)
MISSED_SHARE = 0.05
"""By how much a half swing may end elsewhere than constant coefficients predict: an angle [rad] and
a share of it.
"""
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
    """What swings: its mass [kg], the distance of its center from the axis [m] and its inertia
    about that [kg m^2].
    """

    mass: float
    distance: float
    inertia: float

    @staticmethod
    def of(equation: SwingEquation, mass: float, gravity: float) -> LimbBody:
        """Of the mass that swings in a field [m/s^2], distance and inertia as an equation of motion
        has them.
        """
        angles = np.linspace(
            equation.middle - 0.8 * equation.half, equation.middle + 0.8 * equation.half, 30
        )
        still = np.zeros(len(equation.time))
        weights = [equation.torque(still + angle, still, still).mean() for angle in angles]
        moment = np.linalg.lstsq(np.array([np.cos(angles), np.sin(angles)]).T, weights, rcond=None)[
            0
        ]
        at = still + equation.middle
        inertia = float(
            (equation.torque(at, still, still + 1.0) - equation.torque(at, still, still)).mean()
        )
        return LimbBody(mass, float(np.linalg.norm(moment)) / (gravity * mass), inertia)

    def errors(self, options: LimbOptions) -> dict[str, tuple[float, float]]:
        """Factors of inertia and of mass times distance, by source, each one standard deviation
        off.
        """
        central = max(self.inertia - self.mass * self.distance**2, 0.0)
        moved = options.center_sd * np.sqrt(central / self.mass)
        return {
            "mass": (1.0 + options.mass_sd, 1.0 + options.mass_sd),
            "mass center": (
                1.0 + 2.0 * self.mass * self.distance * moved / self.inertia,
                1.0 + moved / self.distance,
            ),
            "inertia": (1.0 + options.inertia_sd * central / self.inertia, 1.0),
        }


@dataclass(frozen=True)
class Missed:
    """A half swing that ends elsewhere than constant coefficients predict [rad]: `short` of it
    where positive.
    """

    drop: str
    half: int
    time: tuple[float, float]
    short: float
    excursion: float


@dataclass(frozen=True, eq=False)
class LimbResult:
    """What the drops of a limb show: quantities by the names of `UNITS`, the chosen fit, held-out
    errors by law [rad], standard deviations by source and quantity, and what constant coefficients
    do not explain.
    """

    estimates: Mapping[str, Interval]
    fit: SwingFit
    drops: tuple[Drop, ...]
    held_out: Mapping[tuple[str, ...], float]
    shares: Mapping[str, Mapping[str, float]]
    missed: tuple[Missed, ...]


def identify_limb(
    drops: Sequence[Drop], body: LimbBody, options: LimbOptions | None = None
) -> LimbResult:
    """Coefficients of the joint's passive torque and their 95 % intervals, the law chosen on
    held-out drops (of one drop: on its halves).

    Intervals hold what the residuals leave open, by half swings; where there are three drops or
    more, by how much they differ, if that is more; and errors of the model's masses
    (`LimbOptions`). Raises `BadData` where too little is left.
    """
    options = options or LimbOptions()
    drops = tuple(drops)
    held_out = dict[tuple[str, ...], float]()
    missed: tuple[Missed, ...] = ()
    for _ in range(2):
        held_out = {terms: _held_out(drops, terms) for terms in LAWS}
        least = min(held_out.values())
        terms = next(terms for terms, error in held_out.items() if error <= AS_GOOD * least)
        fit, kept, missed = _explained(drops, terms if "stiffness" in terms else SPRUNG, missed)
        if not missed:
            break
        drops = kept
    fit = fit_swings(drops, terms)
    values = quantities(fit)
    variances = {"swings": _variances(fit, drops)}
    for source, factors in body.errors(options).items():
        other = [replace(drop, equation=drop.equation.scaled(*factors)) for drop in drops]
        changed = quantities(fit_swings(other, terms, fit))
        variances[source] = {
            name: (changed.get(name, value) - value) ** 2 for name, value in values.items()
        }
    estimates = {}
    for name, value in values.items():
        half = 1.96 * float(np.sqrt(sum(of[name] for of in variances.values())))
        low = value - half if name in ("rest_angle", "zero_torque") else max(value - half, 0.0)
        estimates[name] = Interval(value, low, value + half)
    if "stiffness" in estimates and estimates["stiffness"].low <= 0.0:
        # A spring that may be none is slack nowhere.
        estimates.pop("rest_angle", None)
    shares = {
        source: {name: float(np.sqrt(v)) for name, v in of.items()}
        for source, of in variances.items()
    }
    return LimbResult(
        estimates=estimates, fit=fit, drops=drops, held_out=held_out, shares=shares, missed=missed
    )


def swung(result: LimbResult) -> Iterator[Array]:
    """(frames,) angles of every drop as the chosen law swings, NaN where half swings are not used
    [rad].
    """
    states = iter(result.fit.states)
    for drop in result.drops:
        angles = np.full(len(drop.angles), np.nan)
        for part in drop.parts:
            angle, rate = next(states)
            angles[part] = drop.equation.swing(part.start, part.stop, angle, rate, result.fit.law)
        yield angles


def quantities(fit: SwingFit) -> dict[str, float]:
    """The fitted values by the names of `UNITS`; a spring without stiffness has no rest."""
    d, k, s, c = fit.law.coefficients[:4]
    known = {"viscosity": d, "stiffness": k, "zero_torque": s, "coulomb": c}
    if k > 0.0:
        known["rest_angle"] = s / k
    asked = {*fit.terms} | ({"zero_torque", "rest_angle"} if "stiffness" in fit.terms else set())
    return {name: float(known[name]) for name in UNITS if name in asked and name in known}


def _held_out(drops: Sequence[Drop], terms: Sequence[str]) -> float:
    """Root mean square error of angles whose coefficients are from other drops [rad]; states are
    their own.
    """
    folds = [
        fit_swings(test, terms, law=fit_swings(training, terms).law).left
        for training, test in _folds(drops)
    ]
    return float(np.sqrt(np.mean(np.square(np.concatenate(folds)))))


def _folds(drops: Sequence[Drop]) -> Iterator[tuple[Sequence[Drop], Sequence[Drop]]]:
    if len(drops) > 1:
        for i in range(min(len(drops), MAX_FOLDS)):
            yield [*drops[:i], *drops[i + 1 :]], [drops[i]]
        return
    halves = np.flatnonzero(drops[0].used)
    first_part, second_part = np.array_split(halves, 2)
    first = replace(drops[0], used=np.isin(np.arange(len(drops[0].used)), first_part))
    second = replace(drops[0], used=np.isin(np.arange(len(drops[0].used)), second_part))
    yield from (([first], [second]), ([second], [first]))


def _explained(
    drops: tuple[Drop, ...], terms: Sequence[str], missed: tuple[Missed, ...]
) -> tuple[SwingFit, tuple[Drop, ...], tuple[Missed, ...]]:
    """A fit to half swings that constant coefficients explain, the drops with these, and the
    others: the worst is left out until none is, as long as each drop keeps some.
    """
    while True:
        fit = fit_swings(drops, terms)
        worst = 1.0
        which = None
        for i, drop in enumerate(drops):
            for half in np.flatnonzero(drop.used) if drop.used.sum() > 3 else ():
                short, excursion = missing(drop, int(half), fit.law)
                excess = abs(short) / (MISSED + MISSED_SHARE * excursion)
                if excess > worst:
                    worst = excess
                    which = (
                        i,
                        Missed(
                            drop=drop.name,
                            half=int(half),
                            time=drop.time(int(half)),
                            short=short,
                            excursion=excursion,
                        ),
                    )
        if which is None:
            return fit, drops, missed
        i, found = which
        used = np.array(drops[i].used)
        used[found.half] = False
        drops = (*drops[:i], replace(drops[i], used=used), *drops[i + 1 :])
        missed = (*missed, found)


def missing(drop: Drop, half: int, law: PassiveLaw) -> tuple[float, float]:
    """By how much a half swing ends short of where a law takes it from its beginning, and its
    excursion [rad].
    """
    start, stop = map(int, drop.turns[half : half + 2])
    angle, rate = state_at(drop, start)
    end = state_at(drop, stop)[0]
    more = min(stop + max(3, (stop - start) // 2), len(drop.equation.time))
    swung = drop.equation.swing(start, more, angle, rate if half == 0 else 0.0, law)
    way = np.sign(end - angle)
    return float(np.max(way * (swung - angle)) - way * (end - angle)), float(abs(end - angle))


def _variances(fit: SwingFit, drops: Sequence[Drop]) -> dict[str, float]:
    """Of every quantity, from what the swings leave: the larger of that by frames, by half swings
    and by drops.
    """
    mapping = law_columns(fit.terms, 1)[0]
    free = mapping.shape[1]
    size = fit.slopes.shape[1]
    inverse = np.linalg.pinv(fit.slopes.T @ fit.slopes)
    scores = np.array(
        [fit.slopes[fit.block == b].T @ fit.left[fit.block == b] for b in np.unique(fit.block)]
    )
    plain = inverse * np.square(fit.left).sum() / max(len(fit.left) - size, 1)
    blocked = inverse @ (scores.T @ scores) @ inverse * len(scores) / max(len(scores) - free, 1)
    _, k, s, _ = fit.law.coefficients[:4]
    # Of d, k, s and c.
    gradients = {
        name: np.eye(4)[i]
        for i, name in enumerate(("viscosity", "stiffness", "zero_torque", "coulomb"))
    }
    gradients["rest_angle"] = np.array([0.0, -s / k**2, 1.0 / k, 0.0]) if k > 0.0 else np.zeros(4)
    own = {name: gradients[name] @ mapping[:4] for name in quantities(fit)}
    result = {
        name: max(float(g @ cov[:free, :free] @ g) for cov in (plain, blocked))
        for name, g in own.items()
    }
    if len(drops) >= 3:
        single = [quantities(fit_swings([drop], fit.terms)) for drop in drops]
        for name in result:
            known = [one[name] for one in single if name in one]
            if len(known) >= 3:
                scatter = np.std(known, ddof=1) / np.sqrt(len(known))
                result[name] = max(
                    result[name], float(scatter * student.ppf(0.975, len(known) - 1) / 1.96) ** 2
                )
    return result
