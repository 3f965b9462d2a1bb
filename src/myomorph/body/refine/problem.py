"""The one problem of motion, body and masses: its data, its unknowns and what is known before.

Coordinates over time are quintic splines: few unknowns, and derivatives that belong to them. Masses
of links always are a body's: small changes of a pseudo-inertia and their prior.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from myomorph.body.identify.pseudo_inertia import (
    SMALLEST_SHARE,
    possible_reference,
    symmetric,
    tangents,
)
from myomorph.body.refine.frame_kernels import predict_frames
from myomorph.body.refine.options import RefineOptions
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.inertia import (
    inertia_matrices,
    inertial_parameters,
    parameters_of,
    pseudo_inertias,
)
from myomorph.core.model.model import Model
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Motion
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.core.motion.lengths import Length, factors_of
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.rigid.coordinates import Ints, couple_rates_frames
from myomorph.core.rigid.frames import over_frames
from myomorph.core.rigid.tree import TreeArrays, compile_tree

DEGREE = 5  # Accelerations are cubic splines then, smooth as those of a filtered motion
WIDTH = DEGREE + 1  # Knots that a frame depends on

Rates = tuple[Array, Array, Array, Array]
"""(frames, coordinates) values, rates and accelerations of the mass, and the values that markers
show.
"""


@read_only
class Basis:
    """Values and derivatives at frames of splines with even knots.

    Attributes
    ----------
    first : (frames,) number of the first coefficient that a frame depends on
    weights : (3, frames, WIDTH) of the following coefficients, for values, rates and accelerations
    count : coefficients of each coordinate
    """

    first: Ints
    weights: Array
    count: int

    @classmethod
    def of(cls, time: Array, spacing: float, span: tuple[float, float] | None = None) -> Basis:
        """Build a basis for frames.

        Parameters
        ----------
        time : (frames,) [s]
        spacing : about how far apart knots are [s]
        span : of the knots, by default that of the frames [s]

        Returns
        -------
        basis of `DEGREE`
        """
        start, end = (float(time[0]), float(time[-1])) if span is None else span
        pieces = max(1, round((end - start) / spacing))
        step = (end - start) / pieces
        knots = start + step * np.arange(-DEGREE, pieces + DEGREE + 1)
        first = np.clip(((time - start) / step).astype(np.int64), 0, pieces - 1)
        weights = np.empty((3, len(time), WIDTH))
        # All pieces are the same function: the piece of each coefficient, shifted into the first
        # interval.
        local = (time - start - first * step)[:, None] + start
        for index in range(WIDTH):
            bspline = scipy.interpolate.BSpline(
                knots[: 2 * WIDTH], np.eye(WIDTH)[index], DEGREE, extrapolate=True
            )
            for nu in range(3):
                weights[nu, :, index] = bspline(local, nu)[:, 0]
        return cls(first, weights, pieces + DEGREE)

    def at(self, coefficients: Array, derivative: int = 0) -> Array:
        """Evaluate splines at the frames.

        Parameters
        ----------
        coefficients : (count, columns)
        derivative : 0 for values, 1 for rates, 2 for accelerations

        Returns
        -------
        (frames, columns)
        """
        window = coefficients[self.first[:, None] + np.arange(WIDTH)]
        return np.einsum("fk,fkn->fn", self.weights[derivative], window)

    def fitted(self, values: Array) -> Array:
        """Fit splines to values at the frames, little bent in gaps.

        Parameters
        ----------
        values : (frames, columns); frames with NaN are left out

        Returns
        -------
        (count, columns) coefficients
        """
        known: np.ndarray = np.asarray(np.isfinite(values).all(axis=1))
        band = np.zeros((WIDTH, self.count))
        right = np.zeros((self.count, values.shape[1]))
        bent = self.weights[2] / np.abs(self.weights[2]).max()
        for f in range(len(values)):
            w = self.weights[0, f]
            at = self.first[f]
            for i in range(WIDTH):
                for j in range(i + 1):
                    band[i - j, at + j] += known[f] * w[i] * w[j] + 1e-6 * bent[f, i] * bent[f, j]
                if known[f]:
                    right[at + i] += w[i] * values[f]
        band[0] += 1e-12
        return scipy.linalg.cho_solve_banded(
            (scipy.linalg.cholesky_banded(band, lower=True), True), right
        )


@read_only
class MassPrior:
    """The masses before anything is measured.

    Each link's change E with P = L (I + E) L^T has the norm `sd`.

    Attributes
    ----------
    reference : (links, 10) parameters
    moved : numbers of the links that have a mass worth changing
    rows : (links moved, 10, 10) of the prior: |rows (phi - reference)|^2
    """

    reference: Array
    moved: Ints
    rows: Array

    @classmethod
    def of(cls, parameters: Array, sd: float) -> MassPrior:
        """Build the prior about parameters.

        Parameters
        ----------
        parameters : (links, 10)
        sd : relative standard deviation of a mass

        Returns
        -------
        prior about the nearest possible parameters
        """
        reference = possible_reference(parameters)
        moved = np.flatnonzero(reference[:, 0] > SMALLEST_SHARE * reference[:, 0].sum())
        rows: Array = np.asarray(np.linalg.inv(tangents(reference[moved])) / sd, dtype=np.float64)
        return cls(reference, moved, rows)

    def misses(self, parameters: Array) -> Array:
        """Compute how far parameters are from the prior.

        Parameters
        ----------
        parameters : (links, 10)

        Returns
        -------
        (links moved, 10) in standard deviations
        """
        return np.einsum("lij,lj->li", self.rows, (parameters - self.reference)[self.moved])


def changed(parameters: Array, entries: Array) -> Array:
    """Change parameters so that they stay some body's whatever the change.

        P = L (I + E / 2)^2 L^T

    Parameters
    ----------
    parameters : (links, 10) of bodies
    entries : (links, 10) scaled triangles of E

    Returns
    -------
    (links, 10)
    """
    L = np.linalg.cholesky(pseudo_inertias(parameters))
    half = L @ (np.eye(4) + 0.5 * symmetric(entries))
    return parameters_of(half @ np.swapaxes(half, 1, 2))


@read_only
class TrialData:
    """One recording on the markers' clock.

    Attributes
    ----------
    name : of the recording
    time : (frames,) [s]
    observed : (frames, markers, 3), NaN where unseen [m]
    measured : (frames, 6) moment about the ground's origin and force [N m], [N]; 0 where not used
    use : (frames,) whether the plates carry all that touches the ground, so that the residual
        counts
    trust : (frames,) weight of the residual, 1 unless nothing explains it
    start : (frames, coordinates) by inverse kinematics [rad or m]
    basis : splines of its coordinates
    gain : by which what was measured is multiplied, so that the plates weigh the body
    """

    name: str
    time: Array
    observed: Array
    measured: Array
    use: np.ndarray
    trust: Array
    start: Array
    basis: Basis
    gain: float = 1.0

    @property
    def wrench(self) -> Array:
        """(frames, 6) that the residual is against."""
        return self.gain * self.measured


@read_only
class Unknowns:
    """A point of the problem.

    Attributes
    ----------
    motions : of each trial (coefficients, free coordinates)
    factors : (lengths,) of the model's
    shifts : (markers, 3) from the model's positions, stretched [m]
    parameters : (bodies, 10) inertial
    """

    motions: tuple[Array, ...]
    factors: Array
    shifts: Array
    parameters: Array


@read_only
class Problem:
    """The problem, as far as it stays the same while it is solved.

    Attributes
    ----------
    model : skeleton with the masses before
    lengths : that may change
    names : of the markers
    pose : what is tracked, and the coordinates that are free
    locations : (markers, 3) on the model [m]
    trials : that count
    prior : of the masses
    weight : of the body [N]
    unit : size of the body against a human's, see `length_unit`
    options : how much each part is believed
    body, masses : whether lengths and marker positions, and masses are unknown
    tissue : by which markers move more than the mass; None where they do not
    """

    model: Model
    lengths: tuple[Length, ...]
    names: tuple[str, ...]
    pose: PoseProblem
    locations: Array
    trials: tuple[TrialData, ...]
    prior: MassPrior
    weight: float
    unit: float
    options: RefineOptions
    body: bool = True
    masses: bool = True
    tissue: SoftTissue | None = None

    @property
    def alphas(self) -> Array:
        """(free,) of soft tissue, of the free coordinates [s^2]."""
        free = self.pose.free
        return np.zeros(len(free)) if self.tissue is None else self.tissue.alpha[free]

    @property
    def marker_variance(self) -> float:
        """Of a marker along one axis [m^2]."""
        noise = self.options.marker_noise
        return float((0.01 * self.unit if noise is None else noise) ** 2)

    @property
    def marker_sd(self) -> float:
        """Of a marker's position on the model along one axis [m]."""
        sd = self.options.marker_sd
        return 0.015 * self.unit if sd is None else sd

    @property
    def residual_sd(self) -> Array:
        """(6,) of the root's residual [N m], [N]."""
        options = self.options
        return self.weight * np.repeat([options.moment_noise * self.unit, options.force_noise], 3)

    @property
    def count(self) -> int:
        """Shared unknowns: lengths, marker positions, changes of pseudo-inertias."""
        body = len(self.lengths) + self.locations.size if self.body else 0
        return body + (10 * len(self.prior.moved) if self.masses else 0)

    def columns(self) -> tuple[slice, slice, slice]:
        """Where lengths, marker positions and masses stand among the shared unknowns."""
        n = len(self.lengths) if self.body else 0
        m = self.locations.size if self.body else 0
        return slice(0, n), slice(n, n + m), slice(n + m, self.count)

    def begin(self) -> Unknowns:
        """Splines nearest to inverse kinematics, on the model as it is."""
        free = self.pose.free
        motions = tuple(trial.basis.fitted(trial.start[:, free]) for trial in self.trials)
        shifts = np.zeros_like(self.locations)
        return Unknowns(
            motions=motions,
            factors=np.ones(len(self.lengths)),
            shifts=shifts,
            parameters=self.prior.reference,
        )

    def stretched(self, factors: Array) -> Model:
        """Stretch the skeleton; masses as before.

        Parameters
        ----------
        factors : (lengths,)

        Returns
        -------
        the skeleton with these lengths
        """
        if (factors == 1.0).all():
            return self.model
        return scale(self.model, factors_of(self.lengths, factors))

    def placed(self, factors: Array, shifts: Array) -> Array:
        """Compute marker positions on the stretched bodies.

        Parameters
        ----------
        factors : (lengths,)
        shifts : (markers, 3) [m]

        Returns
        -------
        (markers, 3) [m]
        """
        grown = np.ones((len(self.model.bodies) + 1, 3))
        names = {name: b + 1 for b, name in enumerate(self.model.body_names)}
        for body, factor in factors_of(self.lengths, factors).items():
            grown[names[body]] = factor
        return self.locations * grown[self.pose.markers.body] + shifts

    def arrays(self, at: Unknowns) -> TreeArrays:
        """Build the arrays of the tree at a point."""
        return with_masses(compile_tree(self.stretched(at.factors)).arrays, at.parameters)

    def rates(self, trial: TrialData, coefficients: Array) -> Rates:
        """Evaluate a trial's splines.

        Parameters
        ----------
        trial : one of the problem's
        coefficients : (coefficients, free)

        Returns
        -------
        values, rates and accelerations of the mass, and the values q - alpha q'' that markers show
        """
        c = trial.start.copy()
        cdot = np.zeros_like(c)
        cddot = np.zeros_like(c)
        for nu, values in enumerate((c, cdot, cddot)):
            values[:, self.pose.free] = trial.basis.at(coefficients, nu)
        seen = c.copy()
        free = self.pose.free
        seen[:, free] -= self.alphas * cddot[:, free]
        return c, cdot, cddot, seen

    def predict(
        self, tree: TreeArrays, locations: Array, trial: TrialData, rates: Rates
    ) -> tuple[Array, Array]:
        """Compute errors of markers and residuals of the root.

        Dependent coordinates of `rates` are set in place.

        Parameters
        ----------
        tree : of the point
        locations : (markers, 3) on the stretched bodies [m]
        trial : one of the problem's
        rates : (frames, coordinates) each

        Returns
        -------
        (frames, markers, 3) predicted less observed [m], 0 where unseen, and (frames, 6) residuals
            [N m], [N], 0 where not used
        """
        places = np.empty(trial.observed.shape)
        residual = np.empty((len(trial.time), 6))
        wrench = trial.wrench

        def part(start: int, stop: int) -> None:
            s = slice(start, stop)
            predict_frames(
                tree,
                self.pose.markers.body,
                locations,
                *(rate[s] for rate in rates),
                wrench[s],
                places[s],
                residual[s],
            )

        over_frames(part, len(trial.time))
        residual[~trial.use] = 0.0
        return np.nan_to_num(places - trial.observed), residual


def with_masses(tree: TreeArrays, parameters: Array) -> TreeArrays:
    """Give a tree inertial parameters of its own.

    Parameters
    ----------
    tree : arrays of the tree
    parameters : (bodies, 10)

    Returns
    -------
    arrays with these masses
    """
    mass = parameters[:, 0]
    center = np.divide(
        parameters[:, 1:4], mass[:, None], out=np.zeros((len(mass), 3)), where=mass[:, None] > 0.0
    )
    square = np.einsum("bi,bi->b", center, center)[:, None, None] * np.eye(3) - np.einsum(
        "bi,bj->bij", center, center
    )
    inertia = inertia_matrices(parameters) - mass[:, None, None] * square
    return tree._replace(
        mass=np.concatenate([[0.0], mass]),
        mass_center=np.concatenate([np.zeros((1, 3)), center]),
        inertia=np.concatenate([np.zeros((1, 3, 3)), inertia]),
    )


def moved(problem: Problem, at: Unknowns, motions: tuple[Array, ...], shared: Array) -> Unknowns:
    """Move a point by a step of the coefficients and of the shared unknowns.

    The whole mass stays.

    Parameters
    ----------
    problem : with what is unknown
    at : point
    motions : (coefficients, free) of each trial
    shared : (shared,)

    Returns
    -------
    the point after the step
    """
    lengths, places, masses = problem.columns()
    at = replace(at, motions=tuple(a + b for a, b in zip(at.motions, motions, strict=True)))
    if problem.body:
        at = replace(
            at,
            factors=at.factors + shared[lengths],
            shifts=at.shifts + shared[places].reshape(at.shifts.shape),
        )
    if problem.masses:
        entries = shared[masses].reshape(-1, 10)
        at = replace(at, parameters=moved_masses(problem, at.parameters, entries))
    return at


def moved_masses(problem: Problem, parameters: Array, entries: Array) -> Array:
    """Change the masses of the links that move; the whole mass stays.

    Parameters
    ----------
    problem : with these links
    parameters : (bodies, 10)
    entries : (links moved, 10) scaled triangles of E, see `changed`

    Returns
    -------
    (bodies, 10)
    """
    links = problem.prior.moved
    parameters = parameters.copy()
    parameters[links] = changed(parameters[links], entries)
    # A step keeps the whole mass to first order only; what is left would outweigh all that it
    # gains.
    return np.asarray(parameters * (problem.prior.reference[:, 0].sum() / parameters[:, 0].sum()))


def motion_of(problem: Problem, at: Unknowns, number: int) -> Motion:
    """Evaluate a trial's motion with the derivatives that belong to it.

    Parameters
    ----------
    problem : with the trials
    at : point
    number : of the trial

    Returns
    -------
    (frames, coordinates) values, velocities and accelerations of the mass
    """
    trial = problem.trials[number]
    rates = problem.rates(trial, at.motions[number])
    tree = problem.arrays(at)
    from_values = rates[0]
    # Sets dependent values too.
    problem.predict(tree, problem.placed(at.factors, at.shifts), trial, rates)
    couple_rates_frames(tree, from_values, rates[1], rates[2])
    return Motion(
        time=trial.time,
        names=problem.model.coordinate_names,
        values=rates[0],
        velocities=rates[1],
        accelerations=rates[2],
    )


def generic_parameters(model: Model, mass: float) -> Array:
    """Scale the model's inertial parameters to a mass.

    Parameters
    ----------
    model : with masses
    mass : of the whole body [kg]

    Returns
    -------
    (bodies, 10)
    """
    return inertial_parameters(model) * (mass / model.mass)
