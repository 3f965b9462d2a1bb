"""Misfit of identified masses on what they were not fitted to, and the prior with the least.

The figure to believe is nested: the strength of the prior and the noise are chosen without the part
that is predicted, so that the choice takes nothing from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.body.identify.base_parameters import BaseParameters, base_sizes
from myomorph.body.identify.determined import MeasuredRows, determined
from myomorph.body.identify.mass_points import MassPointFit, MassPointOptions, solve_mass_points
from myomorph.body.identify.parts import Parts, held_out, predicted
from myomorph.body.identify.pseudo_inertia import (
    PseudoInertiaOptions,
    possible_reference,
    solve_pseudo_inertia,
)
from myomorph.body.identify.shifts import MatterShifts
from myomorph.body.identify.shown_masses import HeldMasses, shown_masses
from myomorph.body.identify.sides import Sides
from myomorph.body.shape.points import MassPoints
from myomorph.core.fit.verdict import Verdict
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import Model
from myomorph.core.rigid.coordinates import Ints

STRENGTHS = (0.02, 0.05, 0.1, 0.2)
"""Relative standard deviations of a link's mass to choose from where none is given, up to how far
people differ.

Looser ones predict more of the same motion and give masses that nobody has: faults of kinematics
that come back every step are then blamed on hands and forearms.
"""

MAX_LOSS = 0.1
"""Share of the least mean square misfit that a tighter prior may lose where errors of the motion
could have gained it: a twentieth of the misfit itself.
"""
POINTS_PER_LINK = 60  # Points a link that stand for all of them while strengths are tried
ROUNDS = 5  # Times that the noise is taken anew from what the fit leaves of held-out parts
WHOLE = "recordings held out in turn"
PIECES = "parts of the recording held out in turn"
PAPER_SPREAD = 1.0
"""Standard deviation of a base parameter before anything is measured, over its size, with weights
as [D]'s.

[D] prints none: its motion of 180 s excites all joints, so that least squares give every base
parameter, and eq. 3.10 then weighs all of them alike. What another motion does not show has to be
given a value too. Held so weakly that noise gives it one of a hundred times its size, eq. 3.10
moves masses to meet noise.
"""
PAPER_SD = 0.2
"""Relative standard deviation of a link's mass that stands for [D]'s weights, which state none, in
intervals.
"""
KINDS = (("moment", "N m"), ("force", "N"))
"""What held-out parts are predicted of, in the order of arrays of misfits (parts, 2)."""


@dataclass(frozen=True, eq=False)
class Paper:
    """The problem of [D] eq. 3.10: mass points, weights, and base parameters by least squares.

    Attributes
    ----------
    model : that holds what no frame shows, by a prior of `PAPER_SPREAD`
    options : weights of both terms, and the least mass of a point
    mass : of all points, kept exactly [kg]; None leaves it free, as [D] does
    spread : standard deviation of base parameters in that prior, over their size
    """

    model: Model
    options: MassPointOptions
    mass: float | None
    spread: float = PAPER_SPREAD

    def solve(
        self, points: MassPoints, parts: Parts, noise: Array, others: np.ndarray | None = None
    ) -> MassPointFit:
        """Solve for masses of points, from all parts or from some.

        Parameters
        ----------
        points : with weights and reference masses
        parts : equations of the base parameters
        noise : (2,) of moments and forces [N m], [N]
        others : (chosen,) numbers of parts; all by default

        Returns
        -------
        masses of the points, and the certificate of the optimum
        """
        base: BaseParameters = parts.base
        mean = base.of(inertial_parameters(self.model))
        spread = self.spread * base_sizes(self.model, base)
        estimate = (parts if others is None else parts.only(others)).estimate(noise, mean, spread)
        return solve_mass_points(
            points, base.combination, estimate, mass=self.mass, options=self.options
        )


class ChosenPrior(NamedTuple):
    """Strength of the prior on masses, by the misfit on parts that were held out.

    Attributes
    ----------
    noise : (2,) of moments and forces [N m], [N]
    misfits : relative standard deviation of the prior to held-out misfit (2,)
    mass_sd : the standard deviation to use
    """

    noise: Array
    misfits: dict[float, Array]
    mass_sd: float


@read_only
class Strength:
    """The problem of choosing how far data may move masses.

    Attributes
    ----------
    points : few points that stand for all
    generic : (bodies, 10) parameters of the scaled model
    method : "points" or "pseudo-inertia"
    mass_sd : the strength to use; None chooses
    sides : left and right alike; None where nothing ties them
    paper : how base parameters are met with weights as [D]'s; None weighs by noise and prior
    only_shown : whether masses change no more than is shown
    """

    points: MassPoints
    generic: Array
    method: str
    mass_sd: float | None
    sides: Sides | None = None
    paper: Paper | None = None
    only_shown: bool = False

    def fit(self, parts: Parts, noise: Array, sd: float, others: np.ndarray | None = None) -> Array:
        """Identify parameters by a strength from some parts.

        Parameters
        ----------
        parts : equations of the base parameters
        noise : (2,) of moments and forces [N m], [N]
        sd : relative standard deviation of a link's mass
        others : (chosen,) numbers of parts; all by default

        Returns
        -------
        (bodies, 10)
        """
        if self.paper is not None:
            return self.paper.solve(self.points, parts, noise, others).parameters
        return self._solved(parts.rows(noise, others), sd)

    @cached_property
    def shifts(self) -> MatterShifts:
        """How the matter of bodies may lie beside their frames."""
        return MatterShifts.of(self.points.parameters(self.points.reference), self.sides)

    def fit_shown(self, parts: Parts, noise: Array, sd: float) -> Array:
        """Identify parameters whose masses change no more than all parts show.

        Parameters
        ----------
        parts : equations of the base parameters
        noise : (2,) of moments and forces [N m], [N]
        sd : relative standard deviation of a link's mass

        Returns
        -------
        (bodies, 10)
        """
        fitted = self.fit(parts, noise, sd)
        if not self.only_shown:
            return fitted
        rows = parts.rows(noise)
        mass = float(self.generic[:, 0].sum())
        measured = MeasuredRows(A=rows[0], sides=self.sides, shifts=self.shifts)
        known = determined(self.points, measured, mass, sd, fitted)
        before = self.points.parameters(self.points.reference)[:, 0]
        masses = shown_masses(before, fitted[:, 0], known.sd[:, 0])
        return self._solved(HeldMasses.of(masses).beside(rows), sd)

    def _solved(self, rows: tuple[Array, Array], sd: float) -> Array:
        """Identify parameters from rows A x = b of unit noise.

        Parameters
        ----------
        rows : (rows, 10 bodies) A and (rows,) b
        sd : relative standard deviation of a link's mass

        Returns
        -------
        (bodies, 10)
        """
        A, b = rows if self.sides is None else self.sides.beside(rows)
        mass = float(self.generic[:, 0].sum())
        if self.method == "points":
            return solve_mass_points(
                self.points, A, b, mass=mass, options=MassPointOptions(mass_sd=sd)
            ).parameters
        shape = possible_reference(self.points.parameters(self.points.reference))
        return solve_pseudo_inertia(
            A, b, shape, mass=mass, options=PseudoInertiaOptions(mass_sd=sd)
        ).parameters

    def choose(self, parts: Parts) -> ChosenPrior:
        """Choose the noise and the prior with which held-out parts are predicted best.

        Parameters
        ----------
        parts : with the folds to hold out in turn

        Returns
        -------
        noise, held-out misfit by strength, and the strength
        """
        noise = parts.rms(self.generic)
        tried, best = self._tried(parts, noise)
        for _ in range(ROUNDS):
            better = float(np.sqrt(np.mean(np.square(tried[best] / noise))))
            if better > 0.8:
                break
            noise = noise * better
            tried, best = self._tried(parts, noise)
        return ChosenPrior(noise=noise, misfits=tried, mass_sd=best)

    def _tried(self, parts: Parts, noise: Array) -> tuple[dict[float, Array], float]:
        """Compute the held-out misfit by strength of the prior.

        Parameters
        ----------
        noise : (2,) of moments and forces [N m], [N]

        Returns
        -------
        strength to (2,) misfit [N m], [N], and the strength with the least
        """
        before = held_out(parts, lambda _: self.generic, noise)
        errors: dict[float, Array] = {}
        # Rows are the same for every strength.
        rows = {
            fold: parts.rows(noise, parts.without(fold))
            for fold in (() if self.paper else parts.names)
        }

        def fitting(sd: float) -> Callable[[int], Array]:
            if self.paper is not None:
                return lambda fold: self.fit(parts, noise, sd, parts.without(fold))
            return lambda fold: self._solved(rows[fold], sd)

        def scores(sd: float) -> Array:
            if sd not in errors:
                errors[sd] = held_out(parts, fitting(sd), noise)
            # Every part counts alike, as its misfit relative to the scaled model's.
            return errors[sd] / before

        if self.mass_sd is not None or self.paper is not None:
            best = self.mass_sd or PAPER_SD
            scores(best)
        else:
            # What returns with the posture is in all folds: a gain up to its size says nothing.
            returning = (parts.explained_errors(noise) / before).mean(axis=0)
            best = _walk(scores, parts.several, returning)
        frames = np.array([parts.frames[parts.fold(fold)].sum() for fold in parts.names])
        weights = frames / frames.sum()
        return {sd: np.sqrt(weights @ errors[sd]) for sd in sorted(errors)}, best


def _walk(scores: Callable[[float], Array], several: bool, returning: Array) -> float:
    """Find the tightest strength whose held-out score is as good as the least.

    What predicts as well and moves masses less is taken, because faults of the motion that all
    parts share pass for masses in all of them. As good is what loses, in moment and in force, no
    more than the score of errors that return with the posture, and no more than `MAX_LOSS` of the
    least; or, of several recordings, no more than one standard error (Breiman et al. 1984). Parts
    of one recording are too much alike for their differences to tell how sure a score is.

    Parameters
    ----------
    scores : strength to scores (parts, 2) of moment and force
    several : whether the parts are whole recordings
    returning : (2,) score of what masses explain of errors that return with the posture

    Returns
    -------
    the strength
    """
    at = len(STRENGTHS) // 2

    def mean(i: int) -> float:
        return float(scores(STRENGTHS[i]).mean())

    # The misfit falls, then rises with the strength: walk down from the middle.
    step = 1 if mean(at + 1) < mean(at) else -1
    while 0 <= at + step < len(STRENGTHS) and mean(at + step) < mean(at):
        at += step
    least = scores(STRENGTHS[at])
    allowed = np.minimum(returning, MAX_LOSS * least.mean(axis=0))
    while at > 0:
        lost = scores(STRENGTHS[at - 1]) - least
        of_parts = lost.mean(axis=1)
        error = 0.0
        if several and len(lost) > 1:
            error = float(of_parts.std(ddof=1)) / np.sqrt(len(lost))
        if of_parts.mean() > error and (lost.mean(axis=0) > allowed).any():
            break
        at -= 1
    return STRENGTHS[at]


def unseen_parts(
    parts: Parts, strength: Strength, names: tuple[str, ...], markers: Parts
) -> Verdict:
    """Predict every fold by what was fitted, and chosen, without it.

    Parameters
    ----------
    parts : with the folds
    strength : problem of choosing how far data may move masses
    names : of the recordings
    markers : parts with the motion of the markers, for the generic masses

    Returns
    -------
    misfits of identified and generic masses; none where fewer than two folds are left to fit to
    """
    identified = []
    generic = []
    frames = []
    for fold in parts.names:
        rest = parts.only(parts.without(fold))
        left_out = parts.fold(fold)
        if len(rest.names) < 2:
            continue
        noise, _, sd = strength.choose(rest)
        identified.append(predicted(parts, fold, strength.fit_shown(rest, noise, sd), noise))
        generic.append(markers.rms(strength.generic, left_out))
        frames.append(int(parts.frames[left_out].sum()))
    several = len(names) > 1
    named = names if several and len(frames) == len(names) else _numbered(len(frames))
    return Verdict(
        kinds=KINDS,
        parts=named,
        estimate=np.reshape(identified, (-1, 2)),
        generic=np.reshape(generic, (-1, 2)),
        weights=np.array(frames, int),
        what=WHOLE if several else PIECES,
    )


def _numbered(count: int) -> tuple[str, ...]:
    """Name parts of a recording."""
    return tuple(f"part {number + 1} of {count}" for number in range(count))


def thinned(points: MassPoints, most: int = POINTS_PER_LINK) -> MassPoints:
    """Choose fewer points with the same mass in every link, spread evenly over the given ones.

    Parameters
    ----------
    points : with weights and reference masses
    most : about so many points a link are kept

    Returns
    -------
    the points themselves where there are no more
    """
    links = len(points.links.names)
    step = max(1, len(points.points) // (most * links))
    if step == 1:
        return points
    owner = _owners(points.weights)
    kept = []
    for link in range(links):
        rows = np.flatnonzero(owner == link)
        if len(rows):
            kept.append(rows[np.linspace(0, len(rows) - 1, min(len(rows), most)).astype(int)])
    index = np.sort(np.concatenate(kept))
    mass = np.bincount(owner, points.reference, links)
    left = np.bincount(owner[index], points.reference[index], links)
    reference = points.reference[index] * (mass / np.maximum(left, 1e-300))[owner[index]]
    weights = scipy.sparse.csr_array(points.weights[index])
    return replace(points, points=points.points[index], reference=reference, weights=weights)


def _owners(weights: scipy.sparse.csr_array) -> Ints:
    """Find the link that has most of each point.

    SciPy's own maximum of sparse rows goes through them one by one.

    Parameters
    ----------
    weights : (points, links) shares, none below 0

    Returns
    -------
    (points,) numbers of links, the first of several that have as much
    """
    entries = weights.tocoo()
    order = np.lexsort((entries.col, -entries.data, entries.row))
    points, first = np.unique(entries.row[order], return_index=True)
    owner = np.zeros(weights.shape[0], dtype=np.int64)
    owner[points] = entries.col[order][first]
    return owner
