"""Errors of instruments and of the joint's center, from the swings themselves.

Two laws hold whatever the limb weighs and however its soft tissue moves: a joint passes on no
moment but a passive one about its free axes, and force is mass times acceleration. A plate that
lies elsewhere, turned axes, wrong gains and a late clock break them, each in its own way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from itertools import chain

import numpy as np

from myomorph.core.fit.correlation import variance_samples
from myomorph.core.fit.elimination import eliminated
from myomorph.core.fit.posterior import Posterior
from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import Evaluation, Rows
from myomorph.core.fit.solver import Method, minimize
from myomorph.core.fit.unknowns import Block, Unknown, Unknowns, Values
from myomorph.core.model.arrays import Array, read_only
from myomorph.swings.viscosity.identification.budget import AXES, ErrorOptions, disturbed, thinned
from myomorph.swings.viscosity.swings.friction import FRICTIONS, friction_rows
from myomorph.swings.viscosity.swings.parameter_scale import shown_columns
from myomorph.swings.viscosity.swings.recording import SwingRecording
from myomorph.swings.viscosity.swings.sums import free_directions, predicted_rows

ROUNDS = 3  # How often the errors are found again from recordings that are rid of the last ones.
SHOWN_IN = {
    "plate_position": (1e3, "mm"),
    "plate_rotation": (1e3, "mrad"),
    "force_gain": (1e2, "%"),
    "moment_gain": (1e2, "%"),
    "plate_clock": (1e3, "ms"),
    "joint_center": (1e3, "mm"),
    "soft_tissue": (1e6, "ms^2"),
}
"""Of each source, in tables."""
# Not estimated: it changes the force by as little as filters and rounding do.
UNTOLD = "soft_tissue"
MASS_AND_MOMENT = 4  # Columns of the force's rows: mass and first moment.
ERRORS = "instruments"  # The block of unknowns
UNIT_OF = {
    "plate_position": "m",
    "plate_rotation": "rad",
    "force_gain": "1",
    "moment_gain": "1",
    "plate_clock": "s",
    "joint_center": "m",
    "soft_tissue": "s^2",
}
# Weights once by what no error leaves, once by what the first estimate does. Laws are linear, so
# that each step is whole.
METHOD = Method(iterations=2, tolerance=0.0, reweighted=True)
MIN_VARIANCE = 1e-18  # Of a law's residuals [N^2] or [(N m)^2], so that none has no noise


@read_only
class Instruments:
    """Errors of instruments from priors and swings.

    Attributes
    ----------
    sources : names and axes of `ErrorOptions`
    prior : (sources,) standard deviations assumed
    errors : (sources,) that were estimated
    covariance : (sources, sources) of what is left
    """

    sources: tuple[tuple[str, int], ...]
    prior: Array
    errors: Array
    covariance: Array

    @staticmethod
    def assumed(options: ErrorOptions) -> Instruments:
        """Return what is known before any swing."""
        prior = np.array([float(getattr(options, name)) for name, _ in options.sources])
        return Instruments(
            sources=options.sources,
            prior=prior,
            errors=np.zeros(len(prior)),
            covariance=np.diag(prior**2),
        )

    def corrected(self, recording: SwingRecording) -> SwingRecording:
        """Return the recording as it would be without these errors."""
        for (source, axis), size in zip(self.sources, self.errors, strict=True):
            recording = disturbed(recording, source, axis, -float(size))
        return recording

    @property
    def rows(self) -> tuple[tuple[str, str, float, float, float], ...]:
        """Source, axis in words, standard deviation assumed, error and standard deviation left."""
        left = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        named = ((source, _axis(source, axis)) for source, axis in self.sources)
        columns = (column.tolist() for column in (self.prior, self.errors, left))
        return tuple(
            (*name, *row) for name, row in zip(named, zip(*columns, strict=True), strict=True)
        )

    def known(self, source: str) -> Array:
        """Find the covariance of what is left where all axes of a source are known.

        Parameters
        ----------
        source : its name

        Returns
        -------
        (sources, sources)
        """
        is_source = np.array([name == source for name, _ in self.sources])
        inner = np.linalg.pinv(self.covariance[np.ix_(is_source, is_source)], hermitian=True)
        across = self.covariance[:, is_source]
        return self.covariance - across @ inner @ across.T


def _axis(source: str, axis: int) -> str:
    if source == UNTOLD:
        return ("muscles removed", "muscles intact")[axis]
    return "" if AXES.get(source) == 1 else "xyz"[axis]


def estimate_instruments(
    conditions: Mapping[str, Sequence[SwingRecording]],
    options: ErrorOptions,
    free_zero: Sequence[str] = (),
) -> Instruments:
    """Estimate errors theta that all swings share, by least squares with priors.

    With B_k what a unit of error k changes of the measured wrench, in every condition

        moment about the free axes = -d rates - k angles + s - c friction - d_M J_M^T J_M rates
                                     + B theta
        force                      = force rows (m, m c) + B theta

    d and s of each axis, k, both kinds of dry friction, d_M, m and c are free in each condition,
    theta is the same in all, with
    the standard deviations of its prior. Each equation is weighted by what it leaves and by how
    many independent samples that has.

    Parameters
    ----------
    conditions : recordings of one specimen
    options : the priors
    free_zero : conditions whose plate was not set to zero; a constant wrench of each trial is free
    """
    known = Instruments.assumed(options)
    thin = {
        name: [thinned(recording) for recording in condition]
        for name, condition in conditions.items()
        if condition
    }
    if not known.sources or not thin:
        return known
    result = known
    for _ in range(ROUNDS):
        now = {
            name: [result.corrected(recording) for recording in recordings]
            for name, recordings in thin.items()
        }
        parts = [
            _condition(recordings, result, name in free_zero) for name, recordings in now.items()
        ]
        result = _solved(parts, known, result)
    return result


_Equations = list[tuple[Array, Array, Array]]
"""Of each trial y (frames, rows) = own (frames, rows, unknowns) x + errors (frames, rows, sources)
theta.
"""


def _condition(
    recordings: Sequence[SwingRecording], instruments: Instruments, free_zero: bool
) -> list[_Equations]:
    """Make the equations of moment and of force of one condition."""
    used = [np.flatnonzero(recording.used) for recording in recordings]
    along = free_directions(recordings)
    predicted = predicted_rows(recordings, used)
    moment: _Equations = []
    force: _Equations = []
    for number, (recording, rows, use) in enumerate(zip(recordings, predicted, used, strict=True)):
        turn = along @ recording.rotations[use].transpose(0, 2, 1)
        constant = np.zeros((len(use), 3, 3 * len(recordings)))
        if free_zero:
            constant[:, np.arange(3), 3 * number + np.arange(3)] = 1.0
        torque = np.einsum("fai,fi->fa", turn, recording.wrench[use, :3])
        moment.append(
            (torque, np.concatenate([_passive(recording, use), turn @ constant], axis=2), turn)
        )
        inertial = np.concatenate([rows.instruments[use, 3:, :MASS_AND_MOMENT], constant], axis=2)
        force.append((recording.wrench[use, 3:], inertial, turn))
    lacking = [_left(part) for part in (moment, force)]
    for number, (recording, use) in enumerate(zip(recordings, used, strict=True)):
        # Errors of the wrench that the laws expect: those of the measured one would be regressed on
        # their own noise, and gains found that make everything small.
        expected = recording.wrench.copy()
        turn = moment[number][2]
        expected[use, :3] -= np.einsum("fai,fa->fi", turn, lacking[0][number])
        expected[use, 3:] -= lacking[1][number]
        smooth = replace(recording, wrench=expected)
        changes = np.stack(
            [
                (
                    disturbed(smooth, *source, 0.0 if source[0] == UNTOLD else size).wrench
                    - expected
                )[use]
                / size
                for source, size in zip(instruments.sources, instruments.prior, strict=True)
            ],
            axis=2,
        )
        moment[number] = (*moment[number][:2], turn @ changes[:, :3])
        force[number] = (*force[number][:2], changes[:, 3:])
    return [moment, force]


def _left(parts: _Equations) -> list[Array]:
    """Find what least squares leave, trial by trial.

    Parameters
    ----------
    parts : of each trial what is explained (frames, rows), by what (frames, rows, unknowns)

    Returns
    -------
    (frames, rows) of each trial
    """
    A = np.concatenate([inertial.reshape(-1, inertial.shape[2]) for _, inertial, _ in parts])
    size = np.linalg.norm(A, axis=0)
    size = np.where(shown_columns(size), size, np.inf)
    x = (
        np.linalg.lstsq(A / size, np.concatenate([y.ravel() for y, _, _ in parts]), rcond=1e-9)[0]
        / size
    )
    return [y - inertial @ x for y, inertial, _ in parts]


def _passive(swing_recording: SwingRecording, use: np.ndarray) -> Array:
    """Find what each coefficient of a passive law adds to the moment about the free axes.

    Parameters
    ----------
    use : frames

    Returns
    -------
    (frames, axes, 2 axes + 4)
    """
    rates = swing_recording.rates[use]
    J = swing_recording.lengthening[use]
    axes = rates.shape[1]
    columns = np.zeros((len(use), axes, 2 * axes + 2 + len(FRICTIONS)))
    each = np.arange(axes)
    columns[:, each, each] = -rates
    columns[:, each, axes + each] = 1.0
    columns[:, :, 2 * axes] = -swing_recording.angles[use]
    columns[:, :, 2 * axes + 1] = -np.einsum("fma,fm->fa", J, np.einsum("fma,fa->fm", J, rates))
    columns[:, :, 2 * axes + 2 :] = -friction_rows(swing_recording)[use]
    return columns


def _solved(
    parts: Sequence[Sequence[_Equations]], known: Instruments, last: Instruments
) -> Instruments:
    """Estimate the errors; the equations hold what is left of them beyond `last`."""
    sources = zip(known.sources, known.prior, last.errors, strict=True)
    unknowns = [
        Unknown(
            name=f"{source} {axis}",
            unit=UNIT_OF[source],
            where="error that all swings share",
            mean=-float(error),
            sd=float(sd),
            scale=float(sd),
        )
        for (source, axis), sd, error in sources
    ]
    laws = [
        SwingLaw.of(f"law {number}", equations, known.prior)
        for number, equations in enumerate(chain.from_iterable(parts))
    ]
    block = Block(name=ERRORS, unknowns=tuple(unknowns))
    solution = minimize(Problem(Unknowns((block,)), tuple(laws)), method=METHOD)
    return Instruments(
        sources=known.sources,
        prior=known.prior,
        errors=last.errors + solution.x,
        covariance=Posterior.of(solution).covariance,
    )


@read_only
class SwingLaw:
    """One law of a condition as residuals of the errors, its own unknowns eliminated.

    With the law y = A x + B theta, whose unknowns x are free, the residuals are P (B theta - y), P
    the projection that takes off what A explains (`core.fit.eliminated`). Their noise is what they
    leave at the errors where they are evaluated.

    Attributes
    ----------
    name : of the condition's law
    errors : (rows, sources) P B
    measured : (rows,) P y
    shapes : (frames, rows) of each trial, which together are all rows
    """

    name: str
    errors: Array
    measured: Array
    shapes: tuple[tuple[int, int], ...]
    blocks: tuple[str, ...] = field(default=(ERRORS,), init=False)
    prior: bool = field(default=False, init=False)

    @classmethod
    def of(cls, name: str, equations: _Equations, scale: Array) -> SwingLaw:
        """Eliminate the law's own unknowns.

        Parameters
        ----------
        name : of the law
        equations : of each trial
        scale : (sources,) of the errors, for the projection's rounding

        Returns
        -------
        the law by the errors alone
        """
        own = np.concatenate([part.reshape(-1, part.shape[2]) for _, part, _ in equations])
        shared = np.concatenate([part.reshape(-1, part.shape[2]) for _, _, part in equations])
        y = np.concatenate([part.ravel() for part, _, _ in equations])
        size = np.linalg.norm(own, axis=0)
        shown = shown_columns(size)
        own = own[:, shown] / size[shown]
        shared = shared * scale
        law = eliminated(own, shared, y)
        return cls(
            name=name,
            errors=(shared + own @ law.follows) / scale,
            measured=y + own @ law.moved,
            shapes=tuple(part.shape for part, _, _ in equations),
        )

    def at(self, values: Values, before: Evaluation | None = None) -> Rows:
        """Evaluate residuals in units of what they leave, as far as they are independent samples.

        Parameters
        ----------
        values : of the errors
        before : not used
        """
        misfit = self.errors @ values[ERRORS] - self.measured
        ends = np.cumsum([frames * rows for frames, rows in self.shapes])[:-1]
        runs = [
            part.reshape(shape)
            for part, shape in zip(np.split(misfit, ends), self.shapes, strict=True)
        ]
        variance = max(float(np.mean(misfit**2)), MIN_VARIANCE)
        weight = np.sqrt(min(variance_samples(runs) / misfit.size, 1.0) / variance)
        return Rows(residuals=weight * misfit, slopes=weight * self.errors)
