"""Motion and noise, told apart by spectra and by what was measured beside a motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from myomorph.core.fit.signal_and_noise import SignalAndNoise, signal_and_noise
from myomorph.core.fit.spectra import spectra_of
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion, Wrenches
from myomorph.core.motion.ik import InverseKinematicsOptions
from myomorph.core.motion.marker_noise import MarkerNoise, marker_noise
from myomorph.core.motion.plate_noise import PlateNoise, plate_noise

ShownBy = Literal["noise", "markers", "forces"]


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseEvidence:
    """What was measured together with a motion, and says more about its noise than its spectra.

    Attributes
    ----------
    markers : that inverse kinematics made the motion of, as recorded
    weights : of that inverse kinematics
    wrenches : all external forces, as measured
    """

    markers: Markers | None = None
    weights: InverseKinematicsOptions | None = None
    wrenches: Wrenches | None = None

    def same(self, other: NoiseEvidence) -> bool:
        """Whether another holds the same values."""
        return self.markers is other.markers and self.wrenches is other.wrenches


NO_EVIDENCE = NoiseEvidence()


class ToldApart(NamedTuple):
    """Motion and noise of columns.

    Attributes
    ----------
    spectra : of coordinates and, after them, of torques; None where nothing moves
    shown_by : what shows the noise: spectra, or else residuals of markers or forces
    sure : whether wobble of skin would be seen, which has no plateau in spectra
    """

    spectra: SignalAndNoise | None
    shown_by: ShownBy
    sure: bool


def told_apart(
    part: Motion, model: Model | None, rows: Array | None, evidence: NoiseEvidence
) -> ToldApart:
    """Tell motion from noise.

    Parameters
    ----------
    part : coordinates (frames, coordinates) without gaps [rad or m]
    model : None for none
    rows : (torques, coordinates) of the mass matrix, None without masses
    evidence : markers and forces that were measured

    Returns
    -------
    spectra of motion and noise
    """
    columns = part.values if rows is None else np.hstack([part.values, part.values @ rows.T])
    count = columns.shape[1]
    shown = _shown(part, model, evidence)
    residuals = None if shown.markers is None else shown.markers.residuals
    spectra = spectra_of(columns, part.rate, residuals)
    found = signal_and_noise(spectra.columns(slice(count)))
    if found is None or (shown.markers is None and shown.forces is None):
        return ToldApart(spectra=found, shown_by="noise", sure=False)

    seen = np.zeros_like(found.noise)
    if shown.markers is not None:
        power = shown.markers.power(spectra.columns(slice(count, None)).power, rows)
        # Bins below the recording's lowest come first.
        seen[-len(power) :] = power
    if shown.forces is not None:
        share = shown.forces.at(found.frequency)
        seen = np.maximum(seen, share[:, None] * found.recorded)
    by: ShownBy = "markers" if shown.forces is None else "forces"
    return ToldApart(
        spectra=found.with_noise(seen),
        shown_by=by if found.doubtful else "noise",
        sure=shown.forces is not None or not found.doubtful,
    )


class _Shown(NamedTuple):
    """What markers and forces show of noise, None where nothing."""

    markers: MarkerNoise | None
    forces: PlateNoise | None


def _shown(part: Motion, model: Model | None, evidence: NoiseEvidence) -> _Shown:
    """Ask markers and forces; see `told_apart`."""
    if model is None:
        return _Shown(markers=None, forces=None)
    markers = None
    if evidence.markers is not None:
        markers = marker_noise(model, part, evidence.markers, evidence.weights)
    forces = None
    if evidence.wrenches is not None:
        forces = plate_noise(model, part, evidence.wrenches)
    return _Shown(markers=markers, forces=forces)
