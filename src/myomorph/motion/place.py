"""Markers put on a model where a recording of a known pose shows them; a static trial as OpenSim's `MarkerPlacer`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from myomorph.model.errors import BadData, UnknownName
from myomorph.model.model import Marker, Model, index_of
from myomorph.model.series import Markers, Motion
from myomorph.motion.ik import InverseKinematicsOptions, KinematicsFit, inverse_kinematics
from myomorph.motion.measurements import INSTANT, frames_around
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree


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


def place_markers(model: Model, motion: Motion, markers: Markers, bodies: Mapping[str, str]) -> tuple[Marker, ...]:
    """Markers at the mean of where a recording shows them on their bodies.

    location = mean over frames of R_body^T (x_marker - p_body)

    Parameters
    ----------
    motion : pose of the model in each frame of `markers`
    markers : recorded in the model's ground; a frame that does not show a marker does not count for it
    bodies : the body of each marker to place

    Raises
    ------
    BadData : the motion has other frames than the markers, or a marker is never seen
    UnknownName : a marker that was not recorded, or a body that the model does not have
    """
    if len(motion) != len(markers):
        raise BadData(f"the motion has {len(motion)} frames, but the markers have {len(markers)}")
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    placed = []
    for name, body in bodies.items():
        if body not in tree.body_index:
            raise UnknownName("body", body, tuple(tree.body_index))
        column = markers.values[:, index_of("marker", name, markers.names, "the recording")]
        b = tree.body_index[body]
        local = np.einsum("fji,fj->fi", poses.rotations[:, b], column - poses.origins[:, b])
        seen = np.isfinite(local).all(axis=1)
        if not seen.any():
            raise BadData(f"marker '{name}' is not seen in any of the {len(markers)} frames")
        placed.append(Marker(name, body, local[seen].mean(axis=0)))
    return tuple(placed)
