"""The report's input from what identification and calibration found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from myomorph.identify.subject import Identification
from myomorph.identify.validation import CrossValidation
from myomorph.model.segments import Segment
from myomorph.model.series import Motion
from myomorph.model.surface import Surface
from myomorph.motion.calibrate import Calibration
from myomorph.report.trial.identified import (
    CalibratedBody,
    IdentificationInput,
    IdentifiedBase,
    LengthFound,
    LinkCheck,
    TrialError,
    WrenchCheck,
)

NOTHING: Mapping[str, Surface] = MappingProxyType({})


def identification_input(
    found: Identification,
    *,
    validation: Mapping[str, CrossValidation] | None = None,
    calibration: CalibratedBody | None = None,
    segments: Mapping[str, Segment] | None = None,
    surfaces: Mapping[str, Surface] = NOTHING,
    pose: Motion | None = None,
) -> IdentificationInput:
    """What the report shows of an identified body.

    Parameters
    ----------
    validation : on motions that were not used, by their names
    calibration : of lengths and markers before, see `calibrated_body`
    segments : of the bodies, where names do not tell
    surfaces : meshes by `Mesh.file`
    pose : of the picture, one frame
    """
    fit = found.base
    return IdentificationInput(
        model=found.model,
        segments=segments or {},
        parameters=found.parameters,
        chosen=found.chosen,
        share=found.shares.mean(axis=1),
        base=IdentifiedBase(
            names=fit.base.names,
            estimate=fit.estimate,
            relative_sd=fit.relative_sd,
            shown=fit.identifiable,
            condition=fit.condition,
            frames=fit.frames,
            residual=fit.residual_rms,
        ),
        from_shape=found.from_shape,
        misfit=found.residuals,
        held_out=found.held_out if len(found.held_out) == 2 else None,
        never_shown=fit.base.never,
        not_shown=tuple(fit.base.names[i] for i in np.flatnonzero(~fit.identifiable)),
        checks=tuple(
            LinkCheck(one.name, one.mass, float(one.eigenvalues[0]), one.ok, ", ".join(one.faults))
            for one in found.consistency[found.chosen].links
        ),
        left_out=found.left_out,
        frames=sum(one.frames for one in found.recordings),
        validation=tuple(
            WrenchCheck(one.time, one.measured, one.predicted, one.weight, name)
            for name, one in (validation or {}).items()
        ),
        calibration=calibration,
        surfaces=surfaces,
        pose=pose,
        source=found.points.source,
        notes=found.notes,
    )


def calibrated_body(found: Calibration, names: Sequence[str], others: Sequence[TrialError] = ()) -> CalibratedBody:
    """What the report shows of a calibration.

    Parameters
    ----------
    names : of the recordings that were used, in their order, the static one last
    others : marker errors of recordings that were not used
    """

    def rms(distances: np.ndarray) -> float:
        seen = distances[np.isfinite(distances)]
        return float(np.sqrt(np.mean(seen**2))) if len(seen) else float("nan")

    used = tuple(
        TrialError(name, rms(before), rms(after), used=True)
        for name, before, after in zip(names, found.before, found.after, strict=True)
    )
    return CalibratedBody(
        lengths=tuple(
            LengthFound(one.length.name, one.generic, one.value, one.length.extent * one.sd) for one in found.lengths
        ),
        markers={one.name: float(np.linalg.norm(one.shift)) for one in found.markers},
        errors=used + tuple(others),
        frames=sum(len(one) for one in found.frames),
        notes=found.notes,
    )
