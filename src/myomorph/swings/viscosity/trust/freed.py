"""Laws fitted with errors of the limb's inertia left free, and dry friction beside them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.body.identify.pseudo_inertia import tangents
from myomorph.core.fit.verdict import Verdict
from myomorph.core.model.arrays import Array, read_only
from myomorph.swings.viscosity.identification.condition import LACKING, Influences
from myomorph.swings.viscosity.identification.excitation import Excitation
from myomorph.swings.viscosity.identification.inertia import LimbInertia
from myomorph.swings.viscosity.swings.friction import FRICTIONS, WIDTH, friction_rows
from myomorph.swings.viscosity.swings.recording import PARAMETERS, SwingRecording
from myomorph.swings.viscosity.swings.sums import SwingSums, predicted_torque_rows
from myomorph.swings.viscosity.trust import law as laws

ROUNDS = 8  # How often the axes are weighed anew.
MIN_WEIGHT = 1e-3  # Of an axis
FORMS = ("viscosity", "viscosity by axis", "hinges")
"""Of a joint's viscosity: one value, one an axis of the limb's first bone, one of three angles one
after another.
"""
PLAIN = FORMS[0]
MOVES = 3.0
"""Rate about an axis over the noise in it, from which friction is taken to slide there: what sticks
holds any torque up to that friction, and of a slower rate not even the sign is known.
"""
ROUNDING = 1e-6  # Share of the limb's torque: smaller misfits are all alike.
INERTIA_ERROR = 0.02
"""Relative standard deviation of the limb's distribution of mass beside the noise of its wrench:
gains of instruments that differ by a percent put the first moment off by as much against the
inertia, which in a slender limb is 0.017 of its distribution.
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


class FreedFit(NamedTuple):
    """A law fitted with free errors of the inertia.

    Attributes
    ----------
    law : (3 axes + 6,) coefficients
    friction : dry, beside it [N m]
    misfit : (columns,) what of the products' columns adds up to its misfit
    unsure : (coefficients of the law's own unknowns, errors) by how much each is off where an error
        of the inertia is one standard deviation
    """

    law: Array
    friction: float
    misfit: Array
    unsure: Array

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


@read_only
class FreedProblem:
    """Torques of one condition whose inertia may be off.

        torque_rows phi + predicted_rows N delta = -law - c friction

    with errors delta of the inertia in all directions but phi itself, whose size torques do not
    show: what step 1 leaves of them makes torques as large as friction. How large each may be
    follows from the noise of the wrench and `INERTIA_ERROR`. They act on the acceleration that the
    state predicts (`predicted_rows`): on the measured one, whose noise is a good part of the torque
    about the limb's own length, least squares would choose the inertia that makes least of the
    noise, and with it too little viscosity about that axis. Each axis counts by what it leaves.
    Friction passes the low-pass of the motion. A law with a spring has no delta, which would take
    it.

    Attributes
    ----------
    products : (blocks, axes, n, n) of the columns [torque_rows, resistances, FRICTIONS,
        predicted_rows]
    phi : (10,) of the limb
    errors : (9, 10) of the inertia, one standard deviation each
    trial : (blocks,) number of the trial of each
    frames : (blocks, axes) in which each moves about an axis
    parted : see `SwingSums.parted`
    alike : frames that count as one, as the low-pass leaves two samples a period of its cutoff
    """

    products: Array
    phi: Array
    errors: Array
    trial: NDArray[np.intp]
    frames: Array
    parted: float
    alike: float

    @classmethod
    def of(
        cls, recordings: Sequence[SwingRecording], sums: SwingSums, inertia: LimbInertia
    ) -> FreedProblem:
        """Condense recordings.

        Parameters
        ----------
        recordings : of one condition
        sums : their blocks
        inertia : of the limb

        Returns
        -------
        the problem
        """
        predicted = predicted_torque_rows(recordings, sums.frames_of_trials)
        columns = [
            np.concatenate([each.torque_rows, law_rows(each), rows], axis=2).transpose(1, 0, 2)
            for each, rows in zip(recordings, predicted, strict=True)
        ]
        noise = Excitation.of(recordings).noise
        moves = [
            np.abs(each.rates.T) > np.maximum(WIDTH, MOVES * noise)[:, None] for each in recordings
        ]
        own = list(zip(sums.trial, sums.uses, strict=True))
        rows = [columns[trial][:, use] * moves[trial][:, use, None] for trial, use in own]
        products = np.stack([each.transpose(0, 2, 1) @ each for each in rows])
        frames = np.array([moves[trial][:, use].sum(axis=1) for trial, use in own], np.float64)
        sizes = np.einsum("baii->i", products)[-PARAMETERS:]
        first = recordings[0]
        alike = 1.0
        if first.cutoff is not None:
            alike = max(0.5 / (first.cutoff * float(np.median(np.diff(first.time)))), 1.0)
        return cls(
            products=products,
            phi=inertia.parameters,
            errors=inertia_errors(inertia, alike, sizes),
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
        counts = np.ones(len(self.trial)) if counts is None else counts
        products = np.tensordot(counts, self.products, axes=1)
        basis = self._basis(acting)
        by_axis = basis.columns.T @ products @ basis.columns
        frames = np.maximum(counts @ self.frames, 1.0)
        variance = np.maximum(by_axis[:, 0, 0], 1e-300) / frames
        for _ in range(ROUNDS):
            weights = np.maximum(variance.min() / variance, MIN_WEIGHT)
            ridge = self.alike * float(variance.min())
            solution = _solved(np.tensordot(weights, by_axis, axes=1), basis, ridge)
            variance = np.maximum(solution @ by_axis @ solution, 1e-300) / frames
        x = solution[1 + basis.errors :]
        return FreedFit(
            law=basis.mapping @ x[: basis.mapping.shape[1]],
            friction=float(x[-1]) if acting.friction else 0.0,
            misfit=basis.columns @ solution,
            unsure=_moved(np.tensordot(weights, by_axis, axes=1), basis, ridge),
        )

    def _basis(self, acting: ActingTerms) -> LawBasis:
        """Choose the columns of a law's unknowns."""
        mapping, groups = laws.law_columns(acting.terms, self.products.shape[1])
        sprung = any("stiffness" in term for term in acting.terms)
        errors = np.zeros((0, PARAMETERS)) if sprung else self.errors
        free = len(errors)
        law = mapping.shape[1]
        columns = np.zeros((self.products.shape[-1], 1 + free + law + bool(acting.friction)))
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
        """Predict each part by laws that were fitted to the others, and by one viscosity.

        Parts are the trials; of a single one its first and its second half, which swings wide and
        little.

        Parameters
        ----------
        candidates : terms of the laws, and friction
        shown : (axes,) whose torques are predicted

        Returns
        -------
        verdict of each law
        """
        parts = self.parts
        generic = self._misfits(ActingTerms(PLAIN))[:, shown]
        weights = np.array([self.frames[parts == part].sum() for part in np.unique(parts)])
        return {
            acting: Verdict(
                kinds=tuple((f"torque {axis}", "N m") for axis in np.flatnonzero(shown)),
                parts=tuple(f"part {part}" for part in np.unique(parts)),
                estimate=self._misfits(acting)[:, shown],
                generic=generic,
                weights=weights,
                what="trials held out in turn",
            )
            for acting in candidates
        }

    @property
    def parts(self) -> NDArray[np.intp]:
        """(blocks,) what is held out together: trials, or halves of the only one."""
        if len(np.unique(self.trial)) > 1:
            return self.trial
        return (np.arange(len(self.trial)) >= len(self.trial) // 2).astype(np.intp)

    def _misfits(self, acting: ActingTerms) -> Array:
        """Find what each part leaves of a law fitted to the others.

        Returns
        -------
        (parts, axes) root mean square torque [N m]
        """
        misfits = []
        parts = self.parts
        for part in np.unique(parts):
            out = parts == part
            misfit = self.fit(acting, 1.0 - out).misfit
            products = self.products[out].sum(axis=0)
            squares = misfit @ products @ misfit
            of_limb = self.phi @ products[:, :PARAMETERS, :PARAMETERS] @ self.phi
            least = ROUNDING**2 * float(of_limb.sum())
            frames = np.maximum(self.frames[out].sum(axis=0), 1.0)
            misfits.append(np.sqrt(np.maximum(squares, least) / frames))
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

    def unsure(self, acting: ActingTerms) -> Array:
        """Find by how much errors of the inertia put a law's coefficients off, then friction.

        All blocks share these errors, so blocks do not show them.

        Parameters
        ----------
        acting : terms of the law, and friction

        Returns
        -------
        (3 axes + 7, errors) for one standard deviation of each error
        """
        own = self.fit(acting).unsure
        mapping, _ = laws.law_columns(acting.terms, self.products.shape[1])
        size = mapping.shape[1]
        friction = own[size:] if acting.friction else np.zeros((1, own.shape[1]))
        return np.concatenate([mapping @ own[:size], friction])


def inertia_errors(inertia: LimbInertia, alike: float, sizes: Array) -> Array:
    """Find by how much the inertia may be off, but for its size.

    Parameters
    ----------
    inertia : of the limb
    alike : frames whose noise counts as that of one
    sizes : (10,) squares of the torque that each parameter makes

    Returns
    -------
    (9, 10) independent errors of one standard deviation
    """
    body = inertia.parameters
    changes = tangents(body[None])[0]
    by_noise = np.linalg.solve(changes, np.sqrt(alike) * inertia.spread)
    by_instruments = INERTIA_ERROR * np.eye(PARAMETERS)
    directions, values, _ = np.linalg.svd(np.hstack([by_noise, by_instruments]))
    root = changes @ directions * values
    across = np.linalg.svd(((sizes * body) @ root)[None])[2][1:]
    return np.asarray(across @ root.T)


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


def _moved(products: Array, basis: LawBasis, ridge: float) -> Array:
    """Find by how much a unit of each error of the inertia puts the coefficients off.

    Least squares with a ridge take an error only in part; with A the columns of the law, N those of
    the errors and the ridge r,

        (A^T W A)^-1 A^T N (N^T N + r)^-1 r,   W = 1 - N (N^T N + r)^-1 N^T

    Parameters
    ----------
    products : (n, n) of the basis' columns
    basis : with the count of errors
    ridge : variance of the misfit over that of an error of the inertia

    Returns
    -------
    (coefficients, errors)
    """
    inner = slice(1, 1 + basis.errors)
    outer = slice(1 + basis.errors, len(products))
    beside = products[outer, inner]
    known = products[inner, inner] + ridge * np.eye(basis.errors)
    taken = np.linalg.pinv(known, rcond=1e-10, hermitian=True)
    less = products[outer, outer] - beside @ taken @ beside.T
    size = np.sqrt(np.maximum(np.diagonal(less), 1e-300))
    inverse = np.linalg.pinv(less / size[:, None] / size, rcond=1e-9, hermitian=True)
    return np.asarray((inverse / size[:, None] / size) @ beside @ taken * ridge)


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
