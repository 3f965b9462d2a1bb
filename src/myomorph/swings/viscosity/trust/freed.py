"""Laws fitted with errors of the limb's inertia left free, and dry friction beside them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.fit.interval_rule import interval_of_draws
from myomorph.core.fit.verdict import Verdict
from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.interval import Interval
from myomorph.core.motion.filters import lowpass
from myomorph.swings.viscosity.identification.condition import LACKING, Influences
from myomorph.swings.viscosity.identification.excitation import NOT_SHOWN, Excitation
from myomorph.swings.viscosity.swings.recording import PARAMETERS, SwingRecording
from myomorph.swings.viscosity.swings.sums import SwingSums, predicted_torque_rows
from myomorph.swings.viscosity.trust import law as laws
from myomorph.swings.viscosity.trust.law import HINGES, LEVEL, PassiveProblem

FINER = 10  # Instants between two frames at which the sign of a rate is taken, before the filter.
ROUNDS = 8  # How often the axes are weighed anew.
NO_ERROR = 1e3  # With which errors of the inertia, of unit torques, are next to none at first
MIN_WEIGHT = 1e-3  # Of an axis
WIDTH = 0.03
"""Rate within which friction turns its sign, before the filter: about the noise of a rate, which
hides the sign of a slower one. Held-out swings of virtual limbs are predicted best with it [rad/s].
"""
FRICTIONS = ("against the motion", "about each axis")
"""A ball rubs against the direction of its angular velocity, or about each of its axes alike."""

FORMS = ("viscosity", "viscosity by axis", "hinges")
"""Of a joint's viscosity: one value, one an axis of the limb's first bone, one of three angles one
after another.
"""
PLAIN = FORMS[0]
# Share of the squares of held-out trials by which a law must lower them for each coefficient added.
WORTH = 0.05
# Laws whose held-out squares differ by a smaller share, beyond what coefficients are worth, predict
# alike: nothing says which of them acts.
ALIKE = 0.02
ROUNDING = 1e-6  # Share of the limb's torque: smaller misfits are all alike.
MIN_RUBBED = 0.03  # Share of the one viscosity that friction must take off to be named.
DRY = "dry friction"
INERTIA_ERROR = 0.01
"""Standard deviation of the torque that an error of the inertia makes, over the limb's: about what
step 1 leaves. An error of any size would take the torque of dampers and friction where the limb
swings nearly in a plane, and give one axis the viscosity of another.
"""


class ActingTerms(NamedTuple):
    """What may act in a joint.

    Attributes
    ----------
    form : of `FORMS`
    friction : of `FRICTIONS`, or "" without one
    spring : terms of a spring beside them
    """

    form: str
    friction: str = ""
    spring: tuple[str, ...] = ()

    @property
    def terms(self) -> tuple[str, ...]:
        """Of the passive law."""
        return (self.form, *self.spring)

    def count(self, axes: int) -> int:
        """Count the coefficients of a joint with so many free axes."""
        return (1 if self.form == PLAIN else axes) + bool(self.friction) + len(self.spring)


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
    alike : frictions of other laws that predict held-out trials as well ("" for none), whose one
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
        holds that beside friction which predicts alike
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


class FreedFit(NamedTuple):
    """A law fitted with free errors of the inertia.

    Attributes
    ----------
    law : (3 axes + 6,) coefficients
    friction : dry, beside it [N m]
    misfit : (columns,) what of the products' columns adds up to its misfit
    """

    law: Array
    friction: float
    misfit: Array

    @property
    def coefficients(self) -> Array:
        """(3 axes + 7,) of the law, then friction."""
        return np.append(self.law, self.friction)


class LawBasis(NamedTuple):
    """Which combinations of a problem's columns are unknown.

    Attributes
    ----------
    columns : (columns, 1 + errors + coefficients) the known torque, errors of inertia, coefficients
    errors : count of the errors of inertia
    mapping : (3 axes + 6, coefficients) of the law alone
    groups : of coefficients, see `laws.Groups`
    """

    columns: Array
    errors: int
    mapping: Array
    groups: laws.Groups


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


def acting_law(
    problem: PassiveProblem, phi: Array, spring: tuple[str, ...], bootstrap: Bootstrap
) -> ActingLaw | None:
    """Choose the form of the viscosity and the friction that predict held-out trials best.

    Parameters
    ----------
    problem : torques of one condition
    phi : (10,) of the limb
    spring : terms of a spring that may be beside them
    bootstrap : for the intervals

    Returns
    -------
    None where that is one viscosity, there is one trial, or no axis is excited
    """
    if len(np.unique(problem.sums.trial)) < 2:
        return None
    freed = FreedProblem.of(problem.recordings, problem.sums, phi)
    # Of an axis that is not excited the torque is of noise and of other axes: no law shows there.
    shown = Excitation.of(problem.recordings).shown
    if not shown.any():
        return None
    verdicts = freed.held_out(list(_candidates(problem, freed, spring)), shown)
    axes = len(problem.axes)
    scores = {
        acting: verdict.log_squares + WORTH * acting.count(axes)
        for acting, verdict in verdicts.items()
    }
    chosen = min(scores, key=scores.__getitem__)
    alike = _frictions_alike(scores, chosen)
    if (chosen.form, chosen.friction) == (PLAIN, "") and not alike:
        return None
    generator = np.random.default_rng(bootstrap.seed)
    single = _estimates(freed, chosen._replace(form=PLAIN), bootstrap.draws, generator)
    estimates = _estimates(freed, chosen, bootstrap.draws, generator)
    hidden = _hidden_places(chosen.form, problem.recordings[0], shown, len(estimates))
    used = [single[0] if place in hidden else each for place, each in enumerate(estimates)]
    named = [NOT_SHOWN if place in hidden else each for place, each in enumerate(estimates)]
    return ActingLaw(
        form=chosen.form,
        friction=chosen.friction,
        coefficients=_named(
            chosen, problem.axes, _joined(freed, single[0], alike, bootstrap), named
        ),
        values=_row_values(chosen, axes, used),
        alike=alike,
    )


def _frictions_alike(scores: Mapping[ActingTerms, float], chosen: ActingTerms) -> tuple[str, ...]:
    """List frictions of other laws that predict held-out trials as well as the chosen one."""
    near = [acting.friction for acting, score in scores.items() if score - scores[chosen] < ALIKE]
    return tuple(dict.fromkeys(friction for friction in near if friction != chosen.friction))


def _joined(
    freed: FreedProblem, single: Interval, alike: Sequence[str], bootstrap: Bootstrap
) -> Interval:
    """Let the interval of the one viscosity hold those beside frictions that predict alike.

    Parameters
    ----------
    freed : problem of the condition
    single : the one viscosity beside the chosen friction
    alike : other frictions
    bootstrap : for their intervals
    """
    others = [
        _estimates(
            freed,
            ActingTerms(form=PLAIN, friction=friction),
            bootstrap.draws,
            np.random.default_rng(bootstrap.seed),
        )[0]
        for friction in alike
    ]
    return Interval(
        value=single.value,
        low=min([single.low, *(each.low for each in others)]),
        high=max([single.high, *(each.high for each in others)]),
    )


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


def _candidates(
    problem: PassiveProblem, freed: FreedProblem, spring: tuple[str, ...]
) -> Iterator[ActingTerms]:
    """Yield what may act in a joint, the plainest first."""
    forms = [form for form in FORMS if len(problem.axes) == 3 or form == PLAIN]
    if not all(len(recording.hinges) for recording in problem.recordings):
        forms = [form for form in forms if form != "hinges"]
    alone = float(freed.fit(ActingTerms(PLAIN)).law[0])
    max_beside = (1.0 - MIN_RUBBED) * alone
    rubbing = [
        friction
        for friction in FRICTIONS
        if float(freed.fit(ActingTerms(PLAIN, friction)).law[0]) < max_beside
    ]
    springs = dict.fromkeys(((), spring))
    for form, friction, beside in product(forms, ("", *rubbing), springs):
        yield ActingTerms(form=form, friction=friction, spring=beside)


def _estimates(
    freed: FreedProblem, acting: ActingTerms, draws: int, generator: np.random.Generator
) -> list[Interval]:
    """Find the intervals of a law's 3 axes + 6 coefficients and of friction."""
    influences = freed.influences(acting)
    drawn = np.maximum(influences.draws(draws, generator), 0.0)
    return [
        interval_of_draws(value, column, LEVEL)
        for value, column in zip(influences.values, drawn.T, strict=True)
    ]


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


def _row_values(acting: ActingTerms, axes: int, estimates: Sequence[Interval]) -> Array:
    """Order coefficients (3 axes + 8,) as `law_rows` are."""
    values = np.zeros(3 * axes + 6 + len(FRICTIONS))
    values[: 3 * axes + 6] = [each.value for each in estimates[:-1]]
    values[axes : 3 * axes] = 0.0  # A spring is fitted by itself.
    if acting.friction:
        place = -len(FRICTIONS) + FRICTIONS.index(acting.friction)
        values[place] = estimates[-1].value
    return values


@read_only
class FreedProblem:
    """Torques of one condition whose inertia may be off.

        torque_rows phi + predicted_rows N delta = -law - c friction

    with errors delta of the inertia in all directions but phi itself, whose size torques do not
    show: what step 1 leaves of them is larger than friction, and than all torques about the limb's
    own length. They act on the acceleration that the state predicts (`predicted_rows`): on the
    measured one, whose noise is a good part of the torque about the limb's own length, least
    squares would choose the inertia that makes least of the noise, and with it too little
    viscosity about that axis. Each axis counts by what it leaves. Friction passes the low-pass of
    the motion. A law with a spring has no delta, which would take it. The size of delta is known
    to `INERTIA_ERROR`.

    Attributes
    ----------
    products : (blocks, axes, n, n) of the columns [torque_rows, resistances, FRICTIONS,
        predicted_rows]
    phi : (10,) of the limb
    trial : (blocks,) number of the trial of each
    frames : (blocks,) how many each has
    parted : see `SwingSums.parted`
    alike : frames that count as one, as the low-pass leaves two samples a period of its cutoff
    """

    products: Array
    phi: Array
    trial: NDArray[np.intp]
    frames: Array
    parted: float
    alike: float

    @classmethod
    def of(cls, recordings: Sequence[SwingRecording], sums: SwingSums, phi: Array) -> FreedProblem:
        """Condense recordings.

        Parameters
        ----------
        recordings : of one condition
        sums : their blocks
        phi : (10,) of the limb

        Returns
        -------
        the problem
        """
        predicted = predicted_torque_rows(recordings, sums.frames_of_trials)
        columns = [
            np.concatenate([each.torque_rows, law_rows(each), rows], axis=2).transpose(1, 0, 2)
            for each, rows in zip(recordings, predicted, strict=True)
        ]
        rows = [columns[trial][:, use] for trial, use in zip(sums.trial, sums.uses, strict=True)]
        products = np.stack([each.transpose(0, 2, 1) @ each for each in rows])
        frames = np.array([len(use) for use in sums.uses], np.float64)
        first = recordings[0]
        alike = 1.0
        if first.cutoff is not None:
            alike = max(0.5 / (first.cutoff * float(np.median(np.diff(first.time)))), 1.0)
        return cls(
            products=products,
            phi=phi,
            trial=sums.trial,
            frames=frames,
            parted=sums.parted,
            alike=alike,
        )

    def fit(self, acting: ActingTerms, counts: Array | None = None) -> FreedFit:
        """Fit a law to blocks, each axis weighed by what it leaves.

        Parameters
        ----------
        acting : terms of the law, and friction
        counts : (blocks,) how often each block counts; by default once

        Returns
        -------
        the law, friction and what they leave
        """
        axes = self.products.shape[1]
        counts = np.ones(len(self.trial)) if counts is None else counts
        products = np.tensordot(counts, self.products, axes=1)
        basis = self._basis(acting, products)
        by_axis = basis.columns.T @ products @ basis.columns
        weights = np.ones(axes)
        ridge = NO_ERROR
        # Columns of errors have unit torques, the first one that of the limb.
        largest = INERTIA_ERROR**2 * float(np.einsum("aij->ij", by_axis)[0, 0])
        for _ in range(ROUNDS):
            solution = _solved(np.tensordot(weights, by_axis, axes=1), basis, ridge)
            left = np.maximum(solution @ by_axis @ solution, 1e-300)
            weights = np.maximum(left.min() / left, MIN_WEIGHT)
            ridge = self.alike * float(left.min()) / float(counts @ self.frames) / largest
        x = solution[1 + basis.errors :]
        return FreedFit(
            law=basis.mapping @ x[: basis.mapping.shape[1]],
            friction=float(x[-1]) if acting.friction else 0.0,
            misfit=basis.columns @ solution,
        )

    def _basis(self, acting: ActingTerms, products: Array) -> LawBasis:
        """Choose the columns of a law's unknowns.

        Parameters
        ----------
        products : (axes, n, n) of all blocks that count
        """
        mapping, groups = laws.law_columns(acting.terms, self.products.shape[1])
        sprung = any("stiffness" in term for term in acting.terms)
        errors = np.zeros((0, PARAMETERS)) if sprung else self._errors(products)
        free = len(errors)
        law = mapping.shape[1]
        columns = np.zeros((products.shape[-1], 1 + free + law + bool(acting.friction)))
        columns[:PARAMETERS, 0] = self.phi
        columns[-PARAMETERS:, 1 : 1 + free] = errors.T
        frictions = len(columns) - PARAMETERS - len(FRICTIONS)
        columns[PARAMETERS:frictions, 1 + free : 1 + free + law] = mapping
        if acting.friction:
            columns[frictions + FRICTIONS.index(acting.friction), -1] = 1.0
            groups = [*groups, [law]]
        return LawBasis(columns=columns, errors=free, mapping=mapping, groups=groups)

    def held_out(
        self, candidates: Sequence[ActingTerms], shown: np.ndarray
    ) -> dict[ActingTerms, Verdict]:
        """Predict each trial by laws that were fitted to the others, and by one viscosity.

        Parameters
        ----------
        candidates : terms of the laws, and friction
        shown : (axes,) whose torques are predicted

        Returns
        -------
        verdict of each law
        """
        trials = np.unique(self.trial)
        generic = self._misfits(ActingTerms(PLAIN))[:, shown]
        weights = np.array([self.frames[self.trial == trial].sum() for trial in trials])
        return {
            acting: Verdict(
                kinds=tuple((f"torque {axis}", "N m") for axis in np.flatnonzero(shown)),
                parts=tuple(f"trial {trial}" for trial in trials),
                estimate=self._misfits(acting)[:, shown],
                generic=generic,
                weights=weights,
                what="trials held out in turn",
            )
            for acting in candidates
        }

    def _misfits(self, acting: ActingTerms) -> Array:
        """Find what each trial leaves of a law fitted to the others.

        Returns
        -------
        (trials, axes) root mean square torque [N m]
        """
        misfits = []
        for trial in np.unique(self.trial):
            out = self.trial == trial
            misfit = self.fit(acting, 1.0 - out).misfit
            products = self.products[out].sum(axis=0)
            squares = misfit @ products @ misfit
            of_limb = self.phi @ products[:, :PARAMETERS, :PARAMETERS] @ self.phi
            least = ROUNDING**2 * float(of_limb.sum())
            misfits.append(np.sqrt(np.maximum(squares, least) / self.frames[out].sum()))
        return np.array(misfits)

    def influences(self, acting: ActingTerms) -> Influences:
        """Find what each block adds to a law's coefficients, then friction.

        Parameters
        ----------
        acting : terms of the law, and friction
        """
        every = np.ones(len(self.trial))
        whole = self.fit(acting, every).coefficients
        lacking = [
            self.fit(acting, every - LACKING * block).coefficients for block in np.eye(len(every))
        ]
        return Influences(
            values=whole,
            blocks=(whole - np.array(lacking)) / LACKING,
            trial=self.trial,
            parted=self.parted,
        )

    def _errors(self, products: Array) -> Array:
        """Find possible errors of the inertia, perpendicular to `phi` in torque.

        Parameters
        ----------
        products : (axes, n, n) of all blocks that count

        Returns
        -------
        (directions, 10)
        """
        scale = np.sqrt(np.einsum("aii->i", products)[-PARAMETERS:])
        scale[0] = 0.0  # Mass makes no torque.
        seen = scale > 0.0
        across = np.linalg.svd((self.phi * scale)[seen][None])[2][1:]
        errors = np.zeros((len(across), PARAMETERS))
        errors[:, seen] = across / scale[seen]
        return errors


def _solved(products: Array, basis: LawBasis, ridge: float) -> Array:
    """Solve for a law's coefficients, with the errors of the inertia eliminated.

    Parameters
    ----------
    products : (n, n) of the basis' columns
    basis : with the groups of coefficients
    ridge : variance of the misfit over that of an error of the inertia

    Returns
    -------
    (n,) factors of the columns: 1, errors of the inertia, coefficients
    """
    inner = np.arange(1, 1 + basis.errors)
    outer = np.array([0, *range(1 + basis.errors, len(products))])
    beside = products[np.ix_(inner, outer)]
    known = products[np.ix_(inner, inner)] + ridge * np.eye(len(inner))
    inverse = np.linalg.pinv(known, rcond=1e-10, hermitian=True)
    back = inverse @ beside
    less = products[np.ix_(outer, outer)] - beside.T @ back
    x = laws.bounded_least_squares(less[1:, 1:], -less[0, 1:], basis.groups)[0]
    return np.concatenate([[1.0], -back @ np.array([1.0, *x]), x])


def law_rows(recording: SwingRecording) -> Array:
    """Find what each coefficient of a law resists in a recording, then `FRICTIONS` of 1 N m.

    Parameters
    ----------
    recording : of a swing

    Returns
    -------
    (frames, axes, 3 axes + 8)
    """
    slopes = laws.slopes_of(recording)
    law = laws.resistances(recording.angles, recording.rates, recording.lengthening, WIDTH, slopes)
    return np.concatenate([law, friction_rows(recording)], axis=2)


def friction_rows(recording: SwingRecording) -> Array:
    """Find the torque of `FRICTIONS` of 1 N m against the motion, through the motion's low-pass.

    Parameters
    ----------
    recording : of a swing

    Returns
    -------
    (frames, axes, 2) [N m]
    """
    result = np.zeros((*recording.rates.shape, len(FRICTIONS)))
    known = np.asarray(np.isfinite(recording.rates).all(axis=1))
    for start, stop in runs(known):
        rates = recording.rates[start:stop]
        frames = np.arange(len(rates))
        instants = np.arange((len(rates) - 1) * FINER + 1) / FINER
        fine = np.stack([np.interp(instants, frames, rate) for rate in rates.T], axis=1)
        speed = np.linalg.norm(fine, axis=1)[:, None]
        against_motion = fine / np.hypot(speed, WIDTH)
        about_axes = fine / np.hypot(fine, WIDTH)
        rubbing = np.concatenate([against_motion, about_axes], axis=1)
        if recording.cutoff and len(rates) > 1:
            rate = FINER / float(np.median(np.diff(recording.time[start:stop])))
            rubbing = lowpass(rubbing, rate, recording.cutoff)
        by_friction = rubbing[::FINER].reshape(len(rates), len(FRICTIONS), -1)
        result[start:stop] = by_friction.transpose(0, 2, 1)
    return result
