"""Recordings of markers, arranged by the markers that they share with the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.body.calibrate.calibration import CalibrationOptions
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, listing
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.series import Markers
from myomorph.core.motion.ik import InverseKinematicsOptions, tracked_markers


@read_only
class RecordedMarkers:
    """Recordings, and what of them the model explains.

    Attributes
    ----------
    recordings : of markers, a static trial last
    names : of markers that the model shares with any recording
    weights : (names,) of the markers
    static : whether the last recording is a static trial
    """

    recordings: tuple[Markers, ...]
    names: tuple[str, ...]
    weights: Array
    static: bool

    def positions(self, recording: Markers) -> Array:
        """Arrange a recording by the names.

        Parameters
        ----------
        recording : any of these

        Returns
        -------
        (frames, names, 3) positions [m], NaN for markers that the recording does not have
        """
        columns = {name: column for column, name in enumerate(recording.names)}
        positions = np.full((len(recording), len(self.names), 3), np.nan)
        for row, name in enumerate(self.names):
            if name in columns:
                positions[:, row] = recording.values[:, columns[name]]
        return positions

    @property
    def tracking(self) -> InverseKinematicsOptions:
        """Options of inverse kinematics with these markers alone."""
        return InverseKinematicsOptions(
            marker_weights=dict(zip(self.names, self.weights.tolist(), strict=True)),
            only_weighted=True,
        )


def recorded_markers(
    model: Model, trials: Sequence[Markers], options: CalibrationOptions
) -> RecordedMarkers:
    """Collect the recordings, and the markers that the model shares with any of them.

    Parameters
    ----------
    model : with markers
    trials : recordings of movement
    options : with a static trial, weights of markers, and which of them stay fixed

    Returns
    -------
    recordings by the names of their markers

    Raises
    ------
    UnknownName : a marker to keep fixed is not the model's
    BadData : there is no recording, or one shares no marker with the model, or shows none of them
        in any frame
    """
    recordings = tuple(trials)
    if options.static is not None:
        recordings = (*recordings, options.static)
    if not recordings:
        raise BadData("calibration needs at least one recording of markers")

    every = tuple(dict.fromkeys(name for markers in recordings for name in markers.names))
    joined = Markers(np.zeros(0), every, np.zeros((0, len(every), 3)))
    weighted = InverseKinematicsOptions(marker_weights=options.marker_weights)
    names, weights = tracked_markers(model, joined, weighted)
    for name in options.fixed_markers:
        index_of("marker", name, model.marker_names)

    recorded = RecordedMarkers(
        recordings=recordings, names=names, weights=weights, static=options.static is not None
    )
    for number, recording in enumerate(recordings, start=1):
        _check_recording(model, recorded, recording, f"recording {number} of {len(recordings)}")
    return recorded


def _check_recording(
    model: Model, recorded: RecordedMarkers, recording: Markers, title: str
) -> None:
    """Raise `BadData` where a recording shows no marker of the model."""
    names = recorded.names
    if not set(names) & set(recording.names):
        first = recording.names[0] if recording.names else ""
        raise BadData(
            f"{title} shares no marker with the model: the model has"
            f" {listing(first, model.marker_names)};"
            f" the recording has {listing(names[0], recording.names)}"
        )
    seen = np.isfinite(recorded.positions(recording)).all(axis=2)
    if not seen.any():
        raise BadData(f"{title} shows none of the model's markers in any frame")
