"""Scale factors from distances between markers in a static trial, then markers placed on the pose.

Both follow OpenSim's scale tool.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import HIDDEN, MARKERS, SIZES
from myomorph.core.model.errors import BadData
from myomorph.core.model.landmarks import Measurement
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Marker, Model, index_of
from myomorph.core.model.series import DEFAULT_POSE, Markers, Motion
from myomorph.core.motion.ik import InverseKinematicsOptions, KinematicsFit, inverse_kinematics
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

INSTANT = 1e-9  # Times that differ by less are the same [s]


@dataclass(frozen=True)
class Measured:
    """Result of a measurement.

    Attributes
    ----------
    measurement : which distances, and the bodies that take the factor
    factor : mean over the pairs of recorded / model [-]; nan where it cannot be used
    recorded : distance of each pair, mean over the frames that show it [m]
    model : distance of each pair in the default pose [m]
    notes : why it cannot be used, or what is odd
    """

    measurement: Measurement
    factor: float
    recorded: tuple[float, ...] = ()
    model: tuple[float, ...] = ()
    notes: tuple[Message, ...] = ()


def with_measured(
    measured: Iterable[Measured], factors: Mapping[str, Array] | None = None
) -> dict[str, Array]:
    """Put factors that measurements found into others; one that cannot be used changes none.

    Parameters
    ----------
    measured : results, of which later ones win
    factors : (3,) along x, y and z of each body [-]; None begins with 1

    Returns
    -------
    (3,) factors along x, y and z of each body that has any [-]
    """
    result = {body: np.array(factor, dtype=np.float64) for body, factor in (factors or {}).items()}
    for length in measured:
        if not np.isfinite(length.factor):
            continue
        for body, axes in length.measurement.bodies.items():
            along = result.setdefault(body, np.ones(3))
            along[["xyz".index(axis) for axis in axes]] = length.factor
    return result


def measure(model: Model, markers: Markers, measurement: Measurement) -> Measured:
    """Measure the scale factor of a model by distances between its markers.

        factor = mean over pairs of (mean over frames of |y_1 - y_2|) / |x_1 - x_2|

    with y of the recording and x of the model in its default pose. A frame that does not show both
    markers of a pair does not count.

    Source: OpenSim's `ModelScaler`. As there, a measurement without pairs, with a marker that model
    or recording lack, or that no frame shows is not used.

    Parameters
    ----------
    model : to be scaled
    markers : of a static trial (frames, markers, 3) [m], NaN where hidden
    measurement : pairs of markers, and the bodies that take the factor

    Returns
    -------
    the factor, or nan and notes that say why it cannot be used
    """
    notes = _missing(model, markers, measurement)
    if notes:
        return Measured(measurement, float("nan"), notes=tuple(notes))
    ends = default_markers(model, [name for pair in measurement.pairs for name in pair])
    modelled = np.linalg.norm(ends[0::2] - ends[1::2], axis=1)
    recorded = []
    for first, second in measurement.pairs:
        lengths = np.linalg.norm(markers[first] - markers[second], axis=1)
        seen = np.isfinite(lengths)
        recorded.append(float(lengths[seen].mean()) if seen.any() else float("nan"))
        if not seen.all():
            hidden = int((~seen).sum())
            notes.append(
                HIDDEN.message(
                    f"measurement '{measurement.name}': {hidden} of {len(seen)} frames do not show"
                    f" both '{first}' and '{second}'",
                    severity="good to know",
                )
            )
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = float(np.mean(np.array(recorded) / modelled))
    if not np.isfinite(factor) or factor <= 0.0:
        notes.append(
            SIZES.message(
                f"measurement '{measurement.name}' is not used: its factor would be {factor:g}"
            )
        )
        factor = float("nan")
    return Measured(
        measurement=measurement,
        factor=factor,
        recorded=tuple(recorded),
        model=tuple(modelled.tolist()),
        notes=tuple(notes),
    )


def _missing(model: Model, markers: Markers, measurement: Measurement) -> list[Message]:
    """Say why a measurement cannot be used: without pairs, or with markers that one side lacks."""
    unused = f"measurement '{measurement.name}' is not used"
    if not measurement.pairs:
        return [SIZES.message(f"{unused}: it has no marker pairs")]
    named = dict.fromkeys(name for pair in measurement.pairs for name in pair)
    problems = [
        SIZES.message(f"{unused}: the model has no marker '{name}'")
        for name in named
        if name not in model.marker_names
    ]
    return problems + [
        SIZES.message(f"{unused}: marker '{name}' was not recorded")
        for name in named
        if name not in markers.names
    ]


def default_markers(model: Model, names: Sequence[str]) -> Array:
    """Locate markers in ground in the model's default pose.

    Parameters
    ----------
    model : with these markers
    names : of the markers

    Returns
    -------
    (markers, 3) [m]

    Raises
    ------
    UnknownName : the model has no such marker
    """
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(DEFAULT_POSE))
    return poses.markers([model.marker(name) for name in names])[0]


def frames_around(markers: Markers, start: float, end: float) -> Markers:
    """Take the frames that OpenSim averages over a range of time.

    They run from the last one at or before `start` to the first at or after `end`.

    Parameters
    ----------
    markers : of a static trial (frames, markers, 3) [m]
    start, end : of the range [s]

    Returns
    -------
    at least one frame

    Raises
    ------
    BadData : without frames, or where the range ends before it starts
    """
    if len(markers) == 0:
        raise BadData("the recording has no frames")
    if start > end:
        raise BadData(f"the time range {start:g} to {end:g} s ends before it starts")
    first = max(int(np.searchsorted(markers.time, start + INSTANT, side="right")) - 1, 0)
    last = min(int(np.searchsorted(markers.time, end - INSTANT, side="left")), len(markers) - 1)
    return markers.frames(slice(first, max(last, first) + 1))


@dataclass(frozen=True, eq=False)
class Placement:
    """A model whose markers lie where a static trial shows them; markers not recorded are removed.

    Attributes
    ----------
    model : with the recorded markers moved, except for the fixed ones
    fit : of the pose, one frame, with the markers as they were before
    moved : how far each marker went [m]
    removed : markers that are missing from the recording
    notes : what looks odd
    """

    model: Model
    fit: KinematicsFit
    moved: dict[str, float]
    removed: tuple[str, ...]
    notes: tuple[Message, ...] = ()


def place_on_pose(  # page: what OpenSim's tool has as settings
    model: Model,
    markers: Markers,
    start: float = -np.inf,
    end: float = np.inf,
    options: InverseKinematicsOptions | None = None,
    most_movement: float = np.inf,
) -> Placement:
    """Pose a model by the mean markers of a static trial, then move its markers to their means.

    Parameters
    ----------
    model : scaled already
    markers : of a static trial (frames, markers, 3) [m], NaN where hidden
    start, end : of the frames to average [s]
    options : of the inverse kinematics
    most_movement : a marker with a coordinate that spreads wider is named in the notes [m]

    Returns
    -------
    the model with its markers moved

    Raises
    ------
    BadData : no frame lies between `start` and `end`
    """
    used = frames_around(markers, start, end)
    inside = (used.time >= start - INSTANT) & (used.time <= end + INSTANT)
    if not inside.any():
        raise BadData(
            f"no frames between {start:g} and {end:g} s: the recording runs from"
            f" {markers.time[0]:g} to {markers.time[-1]:g} s"
        )
    removed = tuple(name for name in model.marker_names if name not in markers.names)
    kept = replace(
        model, markers=tuple(marker for marker in model.markers if marker.name in markers.names)
    )
    fit = inverse_kinematics(kept, _mean(used.frames(inside)), options)
    mean = _mean(used)
    seen = {name for name in kept.marker_names if np.isfinite(mean[name]).all()}
    bodies = {
        marker.name: marker.body
        for marker in kept.markers
        if not marker.fixed and marker.name in seen
    }
    placed = {
        marker.name: marker
        for marker in place_markers(kept, replace(fit.motion, time=mean.time), mean, bodies)
    }
    moved = {
        marker.name: float(np.linalg.norm(placed[marker.name].location - marker.location))
        for marker in kept.markers
        if marker.name in placed
    }
    return Placement(
        model=replace(
            kept,
            markers=tuple(
                replace(marker, location=placed.get(marker.name, marker).location)
                for marker in kept.markers
            ),
        ),
        fit=fit,
        moved=moved,
        removed=removed,
        notes=tuple(_notes(kept, used, seen, most_movement)),
    )


def _mean(markers: Markers) -> Markers:
    """Average markers (frames, markers, 3) over the frames that show each, NaN where none does."""
    seen = np.isfinite(markers.values)
    count = seen.sum(axis=0)
    total = np.where(seen, markers.values, 0.0).sum(axis=0)
    mean = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
    return replace(markers, time=markers.time[:1], values=mean[None])


def _notes(model: Model, used: Markers, seen: set[str], most_movement: float) -> list[Message]:
    """Name markers that are hidden, or move more than `most_movement` [m], in the static frames."""
    notes = [
        MARKERS.message(
            f"marker '{name}' is not seen in the static frames: its position is kept",
            severity="good to know",
        )
        for name in model.marker_names
        if name not in seen
    ]
    for name in sorted(seen):
        values = used[name]
        gaps = int((~np.isfinite(values)).any(axis=1).sum())
        if gaps:
            notes.append(
                HIDDEN.message(
                    f"marker '{name}' is not seen in {gaps} of {len(values)} static frames",
                    severity="good to know",
                )
            )
        spread = float(np.max(np.nanmax(values, axis=0) - np.nanmin(values, axis=0)))
        if spread > most_movement:
            notes.append(
                MARKERS.message(
                    f"marker '{name}' moves {1000 * spread:.1f} mm in the static frames",
                    severity="good to know",
                )
            )
    return notes


def place_markers(
    model: Model, motion: Motion, markers: Markers, bodies: Mapping[str, str]
) -> tuple[Marker, ...]:
    """Place markers at the mean of where a recording shows them on their bodies.

        location = mean over frames of R_body^T (x_marker - p_body)

    Parameters
    ----------
    model : whose bodies these are
    motion : pose of the model in each frame (frames, coordinates) [rad or m]
    markers : recorded in the same frames (frames, markers, 3) [m], NaN where hidden
    bodies : body of each marker to place

    Returns
    -------
    a marker for each, located in the frame of its body [m]

    Raises
    ------
    BadData : motion and markers differ in length, or no frame shows a marker
    UnknownName : the recording has no such marker, or the model no such body
    """
    if len(motion) != len(markers):
        raise BadData(f"the motion has {len(motion)} frames, but the markers have {len(markers)}")
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    placed = []
    for name, body in bodies.items():
        b = tree.body_number(body)
        column = markers.values[:, index_of("marker", name, markers.names, "the recording")]
        local = np.einsum("fji,fj->fi", poses.rotations[:, b], column - poses.origins[:, b])
        seen = np.isfinite(local).all(axis=1)
        if not seen.any():
            raise BadData(f"marker '{name}' is not seen in any of the {len(markers)} frames")
        placed.append(Marker(name, body, local[seen].mean(axis=0)))
    return tuple(placed)
