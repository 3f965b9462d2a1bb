"""Laws fitted with errors of the limb's inertia left free, and dry friction beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.interval import Interval
from myomorph.core.motion.filters import lowpass
from myomorph.swings.viscosity.identification.condition import LACKING, Influences
from myomorph.swings.viscosity.swings.recording import PARAMETERS, SwingRecording
from myomorph.swings.viscosity.swings.sums import SwingSums
from myomorph.swings.viscosity.trust import law as laws
from myomorph.swings.viscosity.trust.law import HINGES, PassiveProblem

FINER = 10  # Instants between two frames at which the sign of a rate is taken, before the filter.
ROUNDS = 4
LIGHTEST = 1e-3  # How often the axes are weighed anew, and the least weight of one.
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
# Share of the squares of held-out trials by which a law must lower them for each coefficient added.
WORTH = 0.05
MIN_RUBBED = 0.03  # Share of the one viscosity that friction must take off to be named.
DRY = "dry friction"


@read_only
class ActingLaw:
    """What acts in a joint beside one viscosity over all axes: `form` of `FORMS`, `friction` of
    `FRICTIONS` or "".

    `coefficients` by name with intervals: that of friction is `DRY`, "viscosity" the one value over
    all axes beside it; `values` (3 axes + 8,) multiply `law_rows`.
    """

    form: str
    friction: str
    coefficients: Mapping[str, Interval]
    values: Array

    def resisting(self, recording: SwingRecording) -> Array:
        """(frames, axes) what resists in the place of the rates, of which `coefficients` have the
        one viscosity.
        """
        return law_rows(recording) @ self.values / max(self.coefficients["viscosity"].value, 1e-12)


def acting_law(
    problem: PassiveProblem, phi: Array, spring: tuple[str, ...], draws: int, seed: int
) -> ActingLaw | None:
    """The form and the friction that predict held-out trials best, None where that is one viscosity
    or there is one trial; `spring`: terms of a spring that may be beside them.
    """
    sums = problem.sums
    axes = len(problem.axes)
    forms = [form for form in FORMS if axes == 3 or form == FORMS[0]]
    if not all(len(recording.hinges) for recording in problem.recordings):
        forms = [form for form in forms if form != "hinges"]
    if len(np.unique(sums.trial)) < 2:
        return None
    freed = FreedProblem.of(problem.recordings, sums, phi)
    alone = float(freed.fit(FORMS[:1], "").law[0])
    rubbed = [float(freed.fit(FORMS[:1], friction).law[0]) for friction in FRICTIONS]
    rubbing = [
        name
        for name, beside in zip(FRICTIONS, rubbed, strict=True)
        if beside < (1.0 - MIN_RUBBED) * alone
    ]
    left = {
        (form, friction, beside): (
            freed.held_out((form, *beside), friction)
            + WORTH * ((axes if form != FORMS[0] else 1) + bool(friction) + len(beside))
        )
        for form in forms
        for friction in ("", *rubbing)
        for beside in dict.fromkeys(((), spring))
    }
    form, friction, spring = min(left, key=lambda law: left[law])
    if (form, friction) == (FORMS[0], ""):
        return None
    generator = np.random.default_rng(seed)

    def estimates(terms: str) -> list[Interval]:
        influences = freed.influences((terms, *spring), friction)
        drawn = np.maximum(influences.draws(draws, generator), 0.0)
        return [
            Interval.of_draws(value, column)
            for value, column in zip(influences.values, drawn.T, strict=True)
        ]

    single = estimates(FORMS[0])
    chosen = estimates(form)
    known = {"viscosity": single[0]}
    if form == "viscosity by axis":
        known |= {f"viscosity {axis}": chosen[i] for i, axis in enumerate(problem.axes)}
    if form == "hinges":
        known |= {f"hinge {name}": chosen[i - len(HINGES) - 1] for i, name in enumerate(HINGES)}
    if friction:
        known[DRY] = chosen[-1]
    values = np.zeros(3 * axes + 6 + len(FRICTIONS))
    values[: 3 * axes + 6] = [each.value for each in chosen[:-1]]
    values[axes : 3 * axes] = 0.0  # A spring is fitted by itself.
    if friction:
        values[-len(FRICTIONS) + FRICTIONS.index(friction)] = chosen[-1].value
    return ActingLaw(form=form, friction=friction, coefficients=known, values=values)


class FreedFit(NamedTuple):
    """A law (3 axes + 6,), dry friction beside it [N m], and what of the products' columns adds up
    to its misfit.
    """

    law: Array
    friction: float
    misfit: Array


@read_only
class FreedProblem:
    """Torques of one condition whose inertia may be off.

        torque_rows (phi + N delta) = -law - c friction

    `delta` are errors of the inertia in all directions but `phi` (10,) itself, whose size torques
    do not show: what step 1 leaves of them is larger than friction, and than all torques about the
    limb's own length. Each axis counts by what it leaves. Friction passes the low-pass of the
    motion. A law with a spring has no `delta`, which would take it. `products` (blocks, axes, n, n)
    are those of [torque_rows, resistances, FRICTIONS].
    """

    products: Array
    phi: Array
    trial: np.ndarray
    parted: float

    @staticmethod
    def of(recordings: Sequence[SwingRecording], sums: SwingSums, phi: Array) -> FreedProblem:
        """The problem of recordings, their blocks and the limb's parameters."""
        columns = [
            np.concatenate([each.torque_rows, law_rows(each)], axis=2).transpose(1, 0, 2)
            for each in recordings
        ]
        rows = [columns[trial][:, use] for trial, use in zip(sums.trial, sums.uses, strict=True)]
        products = np.stack([each.transpose(0, 2, 1) @ each for each in rows])
        return FreedProblem(products=products, phi=phi, trial=sums.trial, parted=sums.parted)

    def fit(
        self, terms: Sequence[str], friction: str = "", counts: Array | None = None
    ) -> FreedFit:
        """The law of `terms`, with one of `FRICTIONS` or none, of blocks taken `counts` times."""
        axes = self.products.shape[1]
        products = np.tensordot(
            np.ones(len(self.trial)) if counts is None else counts, self.products, axes=1
        )
        mapping, groups = laws.law_columns(terms, axes)
        errors = (
            np.zeros((0, PARAMETERS))
            if any("stiffness" in term for term in terms)
            else self._errors(products)
        )
        free = len(errors)
        law = mapping.shape[1]
        rubs = int(bool(friction))
        basis = np.zeros((products.shape[-1], 1 + free + law + rubs))
        basis[:PARAMETERS, 0] = self.phi
        basis[:PARAMETERS, 1 : 1 + free] = errors.T
        basis[PARAMETERS : -len(FRICTIONS), 1 + free : 1 + free + law] = mapping
        if friction:
            basis[-len(FRICTIONS) + FRICTIONS.index(friction), -1] = 1.0
            groups = [*groups, [law]]
        by_axis = basis.T @ products @ basis
        weights = np.ones(axes)
        inner = np.arange(1, 1 + free)
        outer = np.array([0, *range(1 + free, basis.shape[1])])
        for _ in range(ROUNDS):
            whole = np.tensordot(weights, by_axis, axes=1)
            beside = whole[np.ix_(inner, outer)]
            back = np.linalg.pinv(whole[np.ix_(inner, inner)], rcond=1e-10, hermitian=True) @ beside
            less = whole[np.ix_(outer, outer)] - beside.T @ back
            x = laws.bounded_least_squares(less[1:, 1:], -less[0, 1:], groups)[0]
            solution = np.concatenate([[1.0], -back @ np.array([1.0, *x]), x])
            left = np.maximum(solution @ by_axis @ solution, 1e-300)
            weights = np.maximum(left.min() / left, LIGHTEST)
        return FreedFit(mapping @ x[:law], float(x[-1]) if friction else 0.0, basis @ solution)

    def held_out(self, terms: Sequence[str], friction: str = "") -> float:
        """Logarithm of the squares that trials leave, each of a law fitted to the others; sum over
        the axes.
        """
        left = np.zeros(self.products.shape[1])
        for trial in np.unique(self.trial):
            out = self.trial == trial
            misfit = self.fit(terms, friction, 1.0 - out).misfit
            left += misfit @ self.products[out].sum(axis=0) @ misfit
        return float(np.log(np.maximum(left, 1e-300)).sum())

    def influences(self, terms: Sequence[str], friction: str = "") -> Influences:
        """Of the blocks on the law's coefficients, then friction."""
        every = np.ones(len(self.trial))
        whole = np.append(*self.fit(terms, friction, every)[:2])
        lacking = [
            np.append(*self.fit(terms, friction, every - LACKING * block)[:2])
            for block in np.eye(len(every))
        ]
        return Influences(
            values=whole,
            blocks=(whole - np.array(lacking)) / LACKING,
            trial=self.trial,
            parted=self.parted,
        )

    def _errors(self, products: Array) -> Array:
        """(directions, 10) possible errors of the inertia, perpendicular to `phi` in torque."""
        scale = np.sqrt(np.einsum("aii->i", products)[:PARAMETERS])
        scale[0] = 0.0  # Mass makes no torque.
        seen = scale > 0.0
        across = np.linalg.svd((self.phi * scale)[seen][None])[2][1:]
        errors = np.zeros((len(across), PARAMETERS))
        errors[:, seen] = across / scale[seen]
        return errors


def law_rows(recording: SwingRecording) -> Array:
    """(frames, axes, 3 axes + 8) `resistances` in a recording, then `FRICTIONS` of 1 N m."""
    law = laws.resistances(
        recording.angles, recording.rates, recording.lengthening, WIDTH, laws.slopes_of(recording)
    )
    return np.concatenate([law, friction_rows(recording)], axis=2)


def friction_rows(recording: SwingRecording) -> Array:
    """(frames, axes, 2) torque of `FRICTIONS` of 1 N m against the motion, through the motion's
    low-pass.
    """
    result = np.zeros((*recording.rates.shape, len(FRICTIONS)))
    for start, stop in runs(np.asarray(np.isfinite(recording.rates).all(axis=1))):
        rates = recording.rates[start:stop]
        time = recording.time[start:stop]
        at = np.arange((len(rates) - 1) * FINER + 1) / FINER
        fine = np.stack([np.interp(at, np.arange(len(rates)), rate) for rate in rates.T], axis=1)
        speed = np.linalg.norm(fine, axis=1)[:, None]
        rubbing = np.concatenate(
            [fine / np.hypot(speed, WIDTH), fine / np.hypot(fine, WIDTH)], axis=1
        )
        if recording.cutoff and len(rates) > 1:
            rubbing = lowpass(rubbing, FINER / float(np.median(np.diff(time))), recording.cutoff)
        result[start:stop] = (
            rubbing[::FINER].reshape(len(rates), len(FRICTIONS), -1).transpose(0, 2, 1)
        )
    return result
