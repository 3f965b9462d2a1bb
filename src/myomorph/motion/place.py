"""Markers moved on a model to where a static trial shows them, as OpenSim's `MarkerPlacer` does it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from myomorph.model.errors import BadData
from myomorph.model.model import Marker, Model
from myomorph.model.series import Markers
from myomorph.motion.calibrate import place_markers
from myomorph.motion.ik import InverseKinematicsOptions, KinematicsFit, inverse_kinematics
from myomorph.motion.measurements import INSTANT, frames_around


@dataclass(frozen=True, eq=False)
class Placement:
    """A model whose markers lie where a static trial shows them.

    Attributes
    ----------
    model : only with the markers that were recorded, moved except for the fixed ones
    fit : the pose, one frame, with the markers as they were before
    moved : (markers,) by name, how far each went [m]
    removed : markers of the model that were not recorded
    notes : what is odd about the trial, one line each
    """

    model: Model
    fit: KinematicsFit
    moved: dict[str, float]
    removed: tuple[str, ...]
    notes: tuple[str, ...] = ()


def place_on_pose(
    model: Model,
    markers: Markers,
    start: float = -np.inf,
    end: float = np.inf,
    options: InverseKinematicsOptions | None = None,
    most_movement: float = np.inf,
) -> Placement:
    """Pose the model by the mean markers of a static trial, then move its markers to their means.

    Parameters
    ----------
    markers : in the model's ground
    start, end : of the frames that are averaged [s]
    options : of the inverse kinematics that finds the pose
    most_movement : a marker whose coordinates spread wider in these frames is named in the notes [m]

    Raises
    ------
    BadData : no frame lies in the range, or model and trial share no marker
    """
    used = frames_around(markers, start, end)
    inside = (used.time >= start - INSTANT) & (used.time <= end + INSTANT)
    if not inside.any():
        raise BadData(
            f"no frames between {start:g} and {end:g} s: the recording runs from {markers.time[0]:g} "
            f"to {markers.time[-1]:g} s"
        )
    removed = tuple(name for name in model.marker_names if name not in markers.names)
    kept = replace(model, markers=tuple(one for one in model.markers if one.name in markers.names))
    fit = inverse_kinematics(kept, _mean(replace(used, time=used.time[inside], values=used.values[inside])), options)
    mean = _mean(used)
    seen = {name for name in kept.marker_names if np.isfinite(mean[name]).all()}
    bodies = {one.name: one.body for one in kept.markers if not one.fixed and one.name in seen}
    placed = {one.name: one for one in place_markers(kept, replace(fit.motion, time=mean.time), mean, bodies)}
    moved = {
        one.name: float(np.linalg.norm(placed[one.name].location - one.location))
        for one in kept.markers
        if one.name in placed
    }
    return Placement(
        replace(kept, markers=tuple(_at(one, placed) for one in kept.markers)),
        fit,
        moved,
        removed,
        tuple(_notes(kept, used, seen, most_movement)),
    )


def _mean(markers: Markers) -> Markers:
    """One frame, each marker at its mean over the frames that show it; NaN where none does."""
    seen = np.isfinite(markers.values)
    count = seen.sum(axis=0)
    total = np.where(seen, markers.values, 0.0).sum(axis=0)
    mean = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
    return replace(markers, time=markers.time[:1], values=mean[None])


def _at(marker: Marker, placed: dict[str, Marker]) -> Marker:
    return replace(marker, location=placed[marker.name].location) if marker.name in placed else marker


def _notes(model: Model, used: Markers, seen: set[str], most_movement: float) -> list[str]:
    notes = [
        f"marker '{name}' is not seen in the static frames: it stays" for name in model.marker_names if name not in seen
    ]
    for name in sorted(seen):
        values = used[name]
        gaps = int((~np.isfinite(values)).any(axis=1).sum())
        if gaps:
            notes.append(f"marker '{name}' is not seen in {gaps} of {len(values)} static frames")
        spread = float(np.max(np.nanmax(values, axis=0) - np.nanmin(values, axis=0)))
        if spread > most_movement:
            notes.append(f"marker '{name}' moves {1000 * spread:.1f} mm in the static frames")
    return notes
