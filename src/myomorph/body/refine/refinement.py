"""Inputs and results of refining: body, motion and masses.

They are compared with the model before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.body.refine.clock import ALL, clock_name
from myomorph.body.refine.options import CLOCK, LENGTHS, MASSES
from myomorph.core.fit.estimation import Estimate
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.interval import Interval
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.model.shown import shown
from myomorph.core.model.soft_tissue import SoftTissue


@dataclass(frozen=True)
class Errors:
    """Root mean squares of a motion on a model.

    Attributes
    ----------
    markers : distance of the markers [m]
    force, moment : of the root's residual vector [N], [N m]; the moment is about the base's origin
    """

    markers: float
    force: float
    moment: float


@shown
@dataclass(frozen=True, eq=False)
class RefinedTrial:
    """A motion before and after.

    Attributes
    ----------
    name : of the recording
    frames : of the recording
    motion : refined, with derivatives that belong to it
    before : of inverse kinematics, low-pass filtered, on the model as given at the subject's mass
    after : of the refined motion on the refined model, the same frames
    used : frames in which the plates carry all, of all
    """

    name: str
    motion: Motion
    before: Errors
    after: Errors
    used: int
    frames: int


@shown
@dataclass(frozen=True)
class Prediction:
    """A recording, or a part of one, predicted by what was refined on the others.

    Body and masses are those of the others, the motion is plain inverse kinematics.

    Attributes
    ----------
    name : of the recording or part
    given, refined : errors of the model as given, and of the refined one
    markers_alone : marker error of a body that was refined from the same recordings' markers
        without their forces [m]
    used : frames whose forces were predicted
    """

    name: str
    given: Errors
    refined: Errors
    markers_alone: float
    used: int = 1

    @property
    def ratios(self) -> tuple[float, float]:
        """Refined to given: force and moment."""
        return self.refined.force / self.given.force, self.refined.moment / self.given.moment

    @property
    def ratio(self) -> float:
        """Root mean square of the ratios of force and moment."""
        return float(np.sqrt(np.mean(np.square(self.ratios))))

    @property
    def markers_ratio(self) -> float:
        """Marker error of the refined body to that of a body made without forces.

        Both are made from the same markers.
        """
        return self.refined.markers / self.markers_alone


@dataclass(frozen=True)
class ClockOffset:
    """The clock of a recording's forces against that of its markers.

    Attributes
    ----------
    recording : name
    offset : to be added to the times of the forces, with its interval [s]
    shown : whether the recording halves the standard deviation known before
    at_bound : whether the offset is the largest that is looked for
    """

    recording: str
    offset: Interval
    shown: bool
    at_bound: bool


@read_only
class Refinement:
    """A subject's model and motions that agree with markers and plates.

    Attributes
    ----------
    model : stretched, markers placed, with its masses
    given : model it began with, at the subject's mass
    trials : by name
    lengths : names of the lengths
    factors : (lengths,) of the given model's
    parameters : (bodies, 10) inertial
    predictions : of what was left out, empty where not asked for
    fit : what was estimated in the end, beside motions
    soft_tissue : that was taken from the motions, which are those of the mass; None for none
    kept : whether parts of the given body were kept because they predict better
    estimate : the unknowns with their covariance, how the search ended, and the verdict
    notes : what looks wrong, one line each
    """

    model: Model
    given: Model
    trials: tuple[RefinedTrial, ...]
    lengths: tuple[str, ...]
    factors: Array
    parameters: Array
    predictions: tuple[Prediction, ...]
    fit: tuple[str, ...]
    soft_tissue: SoftTissue | None
    kept: bool
    estimate: Estimate
    notes: tuple[Message, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether the last step was small, or none lowers the cost."""
        return self.estimate.converged

    @property
    def factors_sd(self) -> Array:
        """(lengths,) standard deviations of the factors; 0 where lengths were held."""
        if LENGTHS not in self.fit:
            return np.zeros(len(self.factors))
        return self.estimate.posterior.sd[self.estimate.unknowns.slices[LENGTHS]]

    @property
    def parameters_sd(self) -> Array:
        """(bodies, 10) standard deviations of the parameters; 0 where they were held."""
        if MASSES not in self.fit:
            return np.zeros(self.parameters.shape)
        own = self.estimate.unknowns.slices[MASSES]
        return self.estimate.posterior.sd[own].reshape(self.parameters.shape)

    @property
    def mass_sd(self) -> Array:
        """(bodies,) standard deviations of the masses; 0 where they were held [kg]."""
        return self.parameters_sd[:, 0]

    @property
    def clocks(self) -> tuple[ClockOffset, ...]:
        """Of each recording, where clocks were estimated."""
        if CLOCK not in self.fit:
            return ()
        posterior = self.estimate.posterior
        unknowns = {unknown.name: unknown for unknown in self.estimate.unknowns}
        shown = dict(zip(unknowns, posterior.shown, strict=True))
        clocks = []
        for trial in self.trials:
            own = clock_name(trial.name)
            unknown = unknowns.get(own) or unknowns[clock_name(ALL)]
            offset = posterior.interval(unknown.name)
            clocks.append(
                ClockOffset(
                    recording=trial.name,
                    offset=offset,
                    shown=bool(shown[unknown.name]),
                    at_bound=not unknown.low < offset.value < unknown.high,
                )
            )
        return tuple(clocks)

    @property
    def before(self) -> Errors:
        """Of all trials together."""
        return _together(
            [trial.before for trial in self.trials],
            [trial.used for trial in self.trials],
            self._frames,
        )

    @property
    def after(self) -> Errors:
        """Of all trials together."""
        return _together(
            [trial.after for trial in self.trials],
            [trial.used for trial in self.trials],
            self._frames,
        )

    @property
    def _frames(self) -> list[int]:
        return [trial.frames for trial in self.trials]


def _together(errors: Sequence[Errors], used: Sequence[int], frames: Sequence[int]) -> Errors:
    def mean(values: Sequence[float], counts: Sequence[int]) -> float:
        return float(np.sqrt(np.average(np.square(values), weights=counts)))

    return Errors(
        mean([error.markers for error in errors], frames),
        mean([error.force for error in errors], used),
        mean([error.moment for error in errors], used),
    )
