"""What acts in a joint: the form of its viscosity, and dry friction beside it.

The law is chosen that predicts held-out trials best. Laws that the swings cannot exclude share one
interval of the viscosity. Of two laws of which one has friction c more, the likelier one follows
from how far c stands out of its error,

    weight with c / weight without = exp(((c / sd)^2 - 2) / 2),

Akaike's weights (Burnham and Anderson 2002, 2.9) with the error that blocks of swings show, for
frames depend on each other. The interval is that of draws of all these laws, by their weights.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from myomorph.core.fit.interval_rule import interval_of_draws
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.identification.excitation import NOT_SHOWN, Excitation
from myomorph.swings.viscosity.identification.inertia import LimbInertia
from myomorph.swings.viscosity.swings.friction import FRICTIONS
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.trust.freed import (
    FORMS,
    PLAIN,
    ActingTerms,
    FreedProblem,
    law_rows,
)
from myomorph.swings.viscosity.trust.law import HINGES, LEVEL, PassiveProblem

# Share of the squares of held-out trials by which a law must lower them for each coefficient added.
WORTH = 0.05
MIN_RUBBED = 0.03  # Share of the one viscosity by which laws must differ to be told apart.
MIN_WEIGHT = 0.05  # Of a law that the swings do not exclude
CHOSEN_WEIGHT = 0.5  # The least of the law that predicts best
MAX_EXPONENT = 50.0
CERTAIN = 4.5
"""Logarithm of the weight of friction from which it needs no more than to predict held-out trials
better: it stands out by 3.3 of its errors. Noise of differentiated markers, of which held-out
torques have much, hides what all swings together show.
"""
DRY = "dry friction"
MIN_BLOCKS = 4  # Of a single trial, whose halves are then held out in turn


@read_only
class ActingLaw:
    """What acts in a joint beside one viscosity over all axes.

    Attributes
    ----------
    form : of `FORMS`
    friction : of `FRICTIONS`, or "" without one
    coefficients : by name with intervals: that of friction is `DRY`, "viscosity" the one value over
        all axes beside it
    values : (3 axes + 8,) that multiply `law_rows`
    alike : frictions of other laws that the swings do not exclude ("" for none), whose one
        viscosities are in the interval of "viscosity" too
    """

    form: str
    friction: str
    coefficients: Mapping[str, Interval]
    values: Array
    alike: tuple[str, ...] = ()

    def viscosity_of(self, plain: Interval) -> Interval:
        """Find the one viscosity of a joint.

        Parameters
        ----------
        plain : as it is without friction

        Returns
        -------
        that beside the friction; where no friction acts for sure, the plain one, whose interval
        holds that beside friction which is not excluded
        """
        beside = self.coefficients["viscosity"]
        if self.friction:
            return beside
        if not self.alike:
            return plain
        return Interval(plain.value, min(plain.low, beside.low), max(plain.high, beside.high))

    def resisting(self, recording: SwingRecording) -> Array:
        """Find what resists in the place of the rates, of which `coefficients` have one viscosity.

        Parameters
        ----------
        recording : of a swing

        Returns
        -------
        (frames, axes) [rad/s]
        """
        viscosity = max(self.coefficients["viscosity"].value, 1e-12)
        return law_rows(recording) @ self.values / viscosity

    @property
    def name(self) -> str:
        """The law in words, and those that the swings do not exclude."""
        named = _with_friction(FORM_NAMES[self.form], self.friction)
        others = (_friction_name(friction) for friction in self.alike)
        return named if not self.alike else f"{named}, not excluded: {', '.join(others)}"


FORM_NAMES = {
    PLAIN: "one viscosity",
    "viscosity by axis": "a viscosity of each axis",
    "hinges": "viscosities of three angles one after another",
}
"""How forms are called in text."""


def _with_friction(form: str, friction: str) -> str:
    return f"{form} with {_friction_name(friction)}" if friction else form


def _friction_name(friction: str) -> str:
    return f"{DRY} {friction}" if friction else f"no {DRY}"


@dataclass(frozen=True)
class Bootstrap:
    """How intervals are drawn.

    Attributes
    ----------
    draws : how many
    seed : of the random numbers
    """

    draws: int
    seed: int


class LawDraws(NamedTuple):
    """A law's coefficients and draws of them.

    Attributes
    ----------
    values : (3 axes + 7,) of the law, then friction
    draws : (draws, 3 axes + 7)
    """

    values: Array
    draws: Array

    @property
    def intervals(self) -> list[Interval]:
        """The intervals of all coefficients."""
        return [
            interval_of_draws(value, column, LEVEL)
            for value, column in zip(self.values, self.draws.T, strict=True)
        ]

    @property
    def evidence(self) -> float:
        """Logarithm of the weight of the law over that of the same law without friction."""
        spread = float(self.draws[:, -1].std())
        size = float(self.values[-1]) / spread if spread > 0.0 else 0.0
        return min(0.5 * (size**2 - 2.0), MAX_EXPONENT)


def acting_law(
    problem: PassiveProblem, inertia: LimbInertia, spring: tuple[str, ...], bootstrap: Bootstrap
) -> ActingLaw | None:
    """Choose the form of the viscosity and the friction that predict held-out trials best.

    Parameters
    ----------
    problem : torques of one condition
    inertia : of the limb
    spring : terms of a spring that may be beside them
    bootstrap : for the intervals

    Returns
    -------
    None where that is one viscosity and no friction that matters remains possible, where a single
    trial has fewer than `MIN_BLOCKS` swings, or where no axis is excited
    """
    if len(np.unique(problem.sums.trial)) < 2 and len(problem.sums) < MIN_BLOCKS:
        return None
    # Of an axis that is not excited the torque is of noise and of other axes: no law shows there.
    shown = Excitation.of(problem.recordings).shown
    if not shown.any():
        return None
    freed = FreedProblem.of(problem.recordings, problem.sums, inertia)
    chosen = _predicting(freed, list(_candidates(problem, freed, spring)), shown, bootstrap)
    axes = len(problem.axes)
    singles = {
        friction: _drawn(freed, chosen._replace(form=PLAIN, friction=friction), bootstrap)
        for friction in ("", *_frictions(axes))
    }
    single = singles[chosen.friction].intervals[0]
    weights = _weights(singles, chosen.friction)
    alike = tuple(
        friction
        for friction, weight in weights.items()
        if weight > MIN_WEIGHT
        and abs(float(singles[friction].values[0]) - single.value) > MIN_RUBBED * single.value
    )
    if (chosen.form, chosen.friction) == (PLAIN, "") and not alike:
        return None
    law = _drawn(freed, chosen, bootstrap)
    hidden = _hidden_places(chosen.form, problem.recordings[0], shown, len(law.values))
    used = np.where(
        np.isin(np.arange(len(law.values)), list(hidden)),
        singles[chosen.friction].values[0],
        law.values,
    )
    named = [NOT_SHOWN if place in hidden else each for place, each in enumerate(law.intervals)]
    if alike:
        single = _shared(singles, weights, chosen.friction, bootstrap)
    return ActingLaw(
        form=chosen.form,
        friction=chosen.friction,
        coefficients=_named(chosen, problem.axes, single, named),
        values=_row_values(chosen, axes, used),
        alike=alike,
    )


def _predicting(
    freed: FreedProblem,
    candidates: Sequence[ActingTerms],
    shown: np.ndarray,
    bootstrap: Bootstrap,
) -> ActingTerms:
    """Choose the law that predicts best what it was not fitted to, for its coefficients.

    Parameters
    ----------
    freed : problem of the condition
    candidates : laws
    shown : (axes,) whose torques are predicted
    bootstrap : for how certain friction is
    """
    certain = {
        friction
        for friction in {acting.friction for acting in candidates} - {""}
        if _drawn(freed, ActingTerms(PLAIN, friction), bootstrap).evidence > CERTAIN
    }
    axes = freed.products.shape[1]
    scores = {
        acting: verdict.log_squares + WORTH * (acting.count(axes) - (acting.friction in certain))
        for acting, verdict in freed.held_out(candidates, shown).items()
    }
    return min(scores, key=scores.__getitem__)


def _frictions(axes: int) -> tuple[str, ...]:
    """List the frictions that a joint can have: about one axis both are the same."""
    return FRICTIONS if axes > 1 else FRICTIONS[:1]


def _candidates(
    problem: PassiveProblem, freed: FreedProblem, spring: tuple[str, ...]
) -> Iterator[ActingTerms]:
    """Yield what may act in a joint, the plainest first."""
    axes = len(problem.axes)
    forms = [form for form in FORMS if axes == 3 or form == PLAIN]
    if not all(len(recording.hinges) for recording in problem.recordings):
        forms = [form for form in forms if form != "hinges"]
    alone = float(freed.fit(ActingTerms(PLAIN)).law[0])
    max_beside = (1.0 - MIN_RUBBED) * alone
    rubbing = [
        friction
        for friction in _frictions(axes)
        if float(freed.fit(ActingTerms(PLAIN, friction)).law[0]) < max_beside
    ]
    springs = dict.fromkeys(((), spring))
    for form, friction, beside in product(forms, ("", *rubbing), springs):
        yield ActingTerms(form=form, friction=friction, spring=beside)


def _drawn(freed: FreedProblem, acting: ActingTerms, bootstrap: Bootstrap) -> LawDraws:
    """Draw a law's 3 axes + 6 coefficients and friction, by blocks and by errors of the inertia."""
    influences = freed.influences(acting)
    generator = np.random.default_rng(bootstrap.seed)
    drawn = influences.draws(bootstrap.draws, generator)
    unsure = freed.unsure(acting)
    drawn = drawn + generator.standard_normal((len(drawn), unsure.shape[1])) @ unsure.T
    return LawDraws(values=np.asarray(influences.values), draws=np.maximum(drawn, 0.0))


def _weights(laws: Mapping[str, LawDraws], chosen: str) -> dict[str, float]:
    """Weigh laws by their friction, the chosen one by no less than `CHOSEN_WEIGHT`.

    Parameters
    ----------
    laws : by friction, "" without one
    chosen : that predicts held-out trials best

    Returns
    -------
    weights by friction, of sum 1
    """
    logs = {friction: law.evidence if friction else 0.0 for friction, law in laws.items()}
    likely = {friction: float(np.exp(each - max(logs.values()))) for friction, each in logs.items()}
    others = sum(weight for friction, weight in likely.items() if friction != chosen)
    likely[chosen] = max(likely[chosen], CHOSEN_WEIGHT / (1.0 - CHOSEN_WEIGHT) * others)
    whole = sum(likely.values())
    return {friction: weight / whole for friction, weight in likely.items()}


def _shared(
    laws: Mapping[str, LawDraws], weights: Mapping[str, float], chosen: str, bootstrap: Bootstrap
) -> Interval:
    """Find the interval of the one viscosity that laws share.

    Parameters
    ----------
    laws : by friction
    weights : of these
    chosen : friction whose value stands in the interval
    bootstrap : for the choice of a law in each draw
    """
    generator = np.random.default_rng(bootstrap.seed)
    columns = np.stack([laws[friction].draws[:, 0] for friction in weights])
    law = generator.choice(len(columns), size=columns.shape[1], p=list(weights.values()))
    draws = columns[law, np.arange(columns.shape[1])]
    return interval_of_draws(float(laws[chosen].values[0]), draws, LEVEL)


def _hidden_places(form: str, recording: SwingRecording, shown: np.ndarray, count: int) -> set[int]:
    """Find viscosities that swings do not show among the coefficients of a law and friction.

    Parameters
    ----------
    form : of `FORMS`
    recording : one of the condition
    shown : (axes,) whether an axis is excited
    count : of the coefficients

    Returns
    -------
    places of axes of which each has its own, or of the last hinge where that lies along an axis
    that is not excited
    """
    hidden = set(np.flatnonzero(~shown).tolist())
    if form == "viscosity by axis":
        return hidden
    if form == "hinges" and int(np.argmax(np.abs(recording.hinges[1]))) in hidden:
        return {count - 2}
    return set()


def _named(
    acting: ActingTerms, axes: Sequence[str], single: Interval, estimates: Sequence[Interval]
) -> dict[str, Interval]:
    """Name the coefficients that act; `single` is the one viscosity over all axes."""
    known = {"viscosity": single}
    if acting.form == "viscosity by axis":
        known |= {f"viscosity {axis}": estimates[i] for i, axis in enumerate(axes)}
    if acting.form == "hinges":
        first = len(estimates) - 1 - len(HINGES)
        known |= {f"hinge {name}": estimates[first + i] for i, name in enumerate(HINGES)}
    if acting.friction:
        known[DRY] = estimates[-1]
    return known


def _row_values(acting: ActingTerms, axes: int, coefficients: Array) -> Array:
    """Order coefficients (3 axes + 7,) as `law_rows` are (3 axes + 8,)."""
    values = np.zeros(3 * axes + 6 + len(FRICTIONS))
    values[: 3 * axes + 6] = coefficients[:-1]
    values[axes : 3 * axes] = 0.0  # A spring is fitted by itself.
    if acting.friction:
        values[-len(FRICTIONS) + FRICTIONS.index(acting.friction)] = coefficients[-1]
    return values
