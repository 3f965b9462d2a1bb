"""What the part of a report on an identified body is made of: masses, trust in them, lengths, cross-validation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from myomorph.identify.subject import GENERIC, Identification
from myomorph.identify.validation import CrossValidation, LinkConsistency
from myomorph.model.arrays import Array, frozen_array, read_only
from myomorph.model.errors import BadData
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import Model
from myomorph.model.surface import Surface
from myomorph.motion.calibrate import Calibration

COMPONENTS = ("Nx", "Ny", "Nz", "Fx", "Fy", "Fz")
"""Of a wrench, in the order of its arrays: moment [N m], then force [N]."""

UNITS = ("N·m",) * 3 + ("N",) * 3
"""Of the components."""


@read_only
@dataclass(frozen=True, eq=False)
class IdentifiedBase:
    """The base parameters of [D] eq. 3.2 as they were estimated.

    Attributes
    ----------
    names : of the base parameters
    estimate, relative_sd : (parameters,) value [kg, kg m, kg m^2] and standard deviation over its size
    shown : (parameters,) whether the motion shows it
    condition : of the scaled least-squares problem
    frames : that were used
    residual : (6,) root mean square misfit of the base wrench (moment [N m]; force [N])
    """

    names: tuple[str, ...]
    estimate: Array
    relative_sd: Array
    shown: np.ndarray
    condition: float = float("nan")
    frames: int = 0
    residual: Array = field(default_factory=lambda: np.full(6, np.nan))

    def __post_init__(self) -> None:
        for name in ("estimate", "relative_sd"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (len(self.names),)))
        object.__setattr__(self, "residual", frozen_array(self.residual, (6,)))


@read_only
@dataclass(frozen=True, eq=False)
class WrenchCheck(CrossValidation):
    """The base wrench on a motion that identification did not see, and the name of that trial."""

    trial: str = ""


@dataclass(frozen=True)
class LengthFound:
    """One link length: before and after calibration, and its standard deviation [m]; None where unknown."""

    name: str
    before: float
    after: float
    sd: float | None = None


@dataclass(frozen=True)
class TrialError:
    """Root mean square marker error of one trial before and after calibration [m]."""

    trial: str
    before: float
    after: float


@dataclass(frozen=True)
class ZeroFound:
    """The zero of one angle: against the generic model's, its 90 % interval [rad], and what fixes it."""

    coordinate: str
    offset: float
    lowest: float
    highest: float
    source: str


@dataclass(frozen=True, eq=False)
class CalibratedBody:
    """What kinematic identification changed, [D] 3.2.1 step 1.

    Attributes
    ----------
    lengths : links' lengths
    markers : marker to how far it moved on its body [m]
    errors : of markers, trial by trial
    frames : that were used
    notes : what it had to say
    zeros : of the angles
    ended : whether and how the search converged
    """

    lengths: tuple[LengthFound, ...] = ()
    markers: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))
    errors: tuple[TrialError, ...] = ()
    frames: int = 0
    notes: tuple[str, ...] = ()
    zeros: tuple[ZeroFound, ...] = ()
    ended: str = ""


@read_only
@dataclass(frozen=True, eq=False)
class IdentificationInput:
    """Everything the report shows of one identified body; a part appears where it is given.

    Attributes
    ----------
    model : with the identified parameters
    parameters : (bodies, 10) of each method, by the name to print, in the order of the columns; for
        example "identified, w_d", "identified, w_n", "shape only", "generic"
    chosen : the method whose parameters the model has
    share : (bodies,) how much of what is known of each link comes from the data rather than from the
        shape, 0..1; NaN where unknown; () for none at all
    sd : (bodies, 10) standard deviation of the error of the model's parameters; (0, 10) where unknown
    from_data : (bodies, 10) which of the model's parameters the data determine; (0, 10) where unknown
    rank : number of combinations of parameters that the data know better than the prior
    base : the base parameters
    from_shape : link to those of its ten parameters that come from the shape, because the data do not show them
    misfit : of each method in the frames used: root mean square of moment [N m] and force [N], (2,)
    identified : the method that was fitted, which is not the chosen one where it predicts unseen motion worse
    held_out : by method, the same on what was not used, with the strength of the prior chosen without it
    held_out_on : what that was, in words
    never_shown, not_shown : parameters that no motion can show, and that this motion did not, in words
    checks : physical consistency of each link
    left_out : reason to the number of frames left out for it
    frames : that were given
    validation : on other motions
    calibration : of lengths and markers before
    surfaces : meshes for the picture, by `Mesh.file`
    source : where the mass points came from, in words
    notes : what else identification had to say, one line each
    """

    model: Model
    parameters: Mapping[str, Array] = field(default_factory=lambda: FrozenMap({}))
    chosen: str = ""
    share: Array = field(default_factory=lambda: np.zeros(0))
    sd: Array = field(default_factory=lambda: np.zeros((0, 10)))
    from_data: np.ndarray = field(default_factory=lambda: np.zeros((0, 10), bool))
    rank: int | None = None
    base: IdentifiedBase | None = None
    from_shape: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: FrozenMap({}))
    misfit: Mapping[str, Array] = field(default_factory=lambda: FrozenMap({}))
    identified: str = ""
    held_out: Mapping[str, Array] = field(default_factory=lambda: FrozenMap({}))
    held_out_on: str = ""
    never_shown: tuple[str, ...] = ()
    not_shown: tuple[str, ...] = ()
    checks: tuple[LinkConsistency, ...] = ()
    left_out: Mapping[str, int] = field(default_factory=lambda: FrozenMap({}))
    frames: int = 0
    validation: tuple[WrenchCheck, ...] = ()
    calibration: CalibratedBody | None = None
    surfaces: Mapping[str, Surface] = field(default_factory=lambda: FrozenMap({}))
    source: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        bodies = len(self.model.bodies)
        parameters = {name: frozen_array(parameter, (bodies, 10)) for name, parameter in self.parameters.items()}
        object.__setattr__(self, "parameters", FrozenMap(parameters))
        if len(self.share) not in (0, bodies):
            raise BadData(f"expected the share of {bodies} links, but got {len(self.share)}")
        object.__setattr__(self, "share", frozen_array(self.share, (-1,)))

    @property
    def masses(self) -> Mapping[str, Array]:
        """(bodies,) masses by method [kg]."""
        return {name: parameter[:, 0] for name, parameter in self.parameters.items()}


def identification_input(
    identification: Identification, validation: Mapping[str, CrossValidation], surfaces: Mapping[str, Surface]
) -> IdentificationInput:
    """What the report shows of an identified body.

    Parameters
    ----------
    validation : on motions that were not used, by their names
    surfaces : meshes by `Mesh.file`
    """
    fit = identification.base
    return IdentificationInput(
        model=identification.model,
        parameters=identification.parameters,
        chosen=identification.chosen,
        share=identification.known.shares.mean(axis=1),
        sd=identification.sd,
        from_data=identification.known.data & (identification.chosen == identification.identified),
        rank=identification.known.rank,
        base=IdentifiedBase(
            names=fit.base.names,
            estimate=fit.estimate,
            relative_sd=fit.relative_sd,
            shown=fit.identifiable,
            condition=fit.condition,
            frames=fit.frames,
            residual=fit.residual_rms,
        ),
        from_shape=identification.from_shape,
        misfit=identification.residuals,
        identified=identification.identified,
        held_out=_unseen(identification),
        held_out_on=identification.unseen.what,
        never_shown=fit.base.never,
        not_shown=tuple(fit.base.names[i] for i in np.flatnonzero(~fit.identifiable)),
        checks=identification.consistency[identification.chosen].links,
        left_out=identification.left_out,
        frames=sum(recording.frames for recording in identification.recordings),
        validation=tuple(
            WrenchCheck(check.time, check.measured, check.predicted, check.weight, name)
            for name, check in validation.items()
        ),
        surfaces=surfaces,
        source=identification.points.source,
        notes=identification.notes,
    )


def _unseen(identification: Identification) -> Mapping[str, Array]:
    if not len(identification.unseen.frames):
        return {}
    rms = identification.unseen.rms
    return {
        identification.identified: rms(identification.unseen.identified),
        GENERIC: rms(identification.unseen.generic),
    }


def calibrated_body(calibration: Calibration, names: Sequence[str]) -> CalibratedBody:
    """What the report shows of a calibration.

    Parameters
    ----------
    names : of the recordings that were used, in their order, the static one last
    """

    def rms(distances: np.ndarray) -> float:
        seen = distances[np.isfinite(distances)]
        return float(np.sqrt(np.mean(seen**2))) if len(seen) else float("nan")

    errors = tuple(
        TrialError(name, rms(before), rms(after))
        for name, before, after in zip(names, calibration.before, calibration.after, strict=True)
    )
    return CalibratedBody(
        lengths=tuple(
            LengthFound(length.length.name, length.generic, length.value, length.length.extent * length.sd)
            for length in calibration.lengths
        ),
        markers={marker.name: float(np.linalg.norm(marker.shift)) for marker in calibration.markers},
        errors=errors,
        frames=sum(len(frame) for frame in calibration.frames),
        notes=calibration.notes,
        zeros=tuple(
            ZeroFound(angle.coordinate, angle.offset, *angle.interval, angle.source)
            for angle in calibration.zero_angles
        ),
        ended=f"{'Converged' if calibration.converged else 'NOT converged'} after {calibration.steps} steps, "
        f"last change {calibration.last_change:.1g} of a length or a meter.",
    )
