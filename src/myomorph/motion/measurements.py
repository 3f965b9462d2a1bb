"""Scale factors from distances between markers, as OpenSim's `ModelScaler` takes them from a static trial."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.landmarks import Measurement
from myomorph.model.model import Model
from myomorph.model.series import Markers, Motion
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

INSTANT = 1e-9
"""Times that differ by less are the same [s]."""


@dataclass(frozen=True)
class Measured:
    """What a measurement found.

    Attributes
    ----------
    factor : mean over the pairs of recorded / model, nan where the measurement cannot be used
    recorded, model : distance of each pair [m]; of the recording, the mean over its frames
    notes : why it cannot be used, or what is odd about it, one line each
    """

    measurement: Measurement
    factor: float
    recorded: tuple[float, ...] = ()
    model: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()


def measured_factors(
    model: Model,
    markers: Markers,
    measurements: Iterable[Measurement],
    factors: Mapping[str, Array] | None = None,
) -> dict[str, Array]:
    """Scale factors (3,) of the bodies that measurements stretch; `scale` takes them.

    A later measurement of the same body and axis counts; axes that none stretches stay as they were.

    Parameters
    ----------
    markers : of a static trial, the frames to be averaged; see `frames_around`
    factors : to begin with; by default 1
    """
    return with_measured([measure(model, markers, one) for one in measurements], factors)


def with_measured(measured: Iterable[Measured], factors: Mapping[str, Array] | None = None) -> dict[str, Array]:
    """Factors with those that measurements found put in; a measurement that cannot be used changes none."""
    result = {body: np.array(factor, dtype=np.float64) for body, factor in (factors or {}).items()}
    for one in measured:
        if not np.isfinite(one.factor):
            continue
        for body, axes in one.measurement.bodies.items():
            along = result.setdefault(body, np.ones(3))
            along[["xyz".index(axis) for axis in axes]] = one.factor
    return result


def measure(model: Model, markers: Markers, measurement: Measurement) -> Measured:
    """The scale factor of a measurement.

    factor = mean over pairs of (mean over frames of |y_1 - y_2|) / |x_1 - x_2|, with y of the recording
    and x of the model in its default pose.

    A frame that does not show both markers does not count. A measurement without pairs, with a marker
    that model or recording lack, or that no frame shows is not used, as in OpenSim.
    """
    notes = _missing(model, markers, measurement)
    if notes:
        return Measured(measurement, float("nan"), notes=tuple(notes))
    ends = default_markers(model, [name for pair in measurement.pairs for name in pair])
    own = np.linalg.norm(ends[0::2] - ends[1::2], axis=1)
    recorded = []
    for first, second in measurement.pairs:
        lengths = np.linalg.norm(markers[first] - markers[second], axis=1)
        seen = np.isfinite(lengths)
        recorded.append(float(lengths[seen].mean()) if seen.any() else float("nan"))
        if not seen.all():
            hidden = f"{int((~seen).sum())} of {len(seen)} frames do not show both '{first}' and '{second}'"
            notes.append(f"measurement '{measurement.name}': {hidden}")
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = float(np.mean(np.array(recorded) / own))
    if not np.isfinite(factor) or factor <= 0.0:
        notes.append(f"measurement '{measurement.name}' is not used: its factor would be {factor:g}")
        factor = float("nan")
    return Measured(measurement, factor, tuple(recorded), tuple(own.tolist()), tuple(notes))


def _missing(model: Model, markers: Markers, measurement: Measurement) -> list[str]:
    unused = f"measurement '{measurement.name}' is not used"
    if not measurement.pairs:
        return [f"{unused}: it has no marker pairs"]
    named = dict.fromkeys(name for pair in measurement.pairs for name in pair)
    found = [f"{unused}: the model has no marker '{name}'" for name in named if name not in model.marker_names]
    return found + [f"{unused}: marker '{name}' was not recorded" for name in named if name not in markers.names]


def default_markers(model: Model, names: Sequence[str]) -> Array:
    """(markers, 3) places of markers in ground in the model's default pose [m]."""
    tree = compile_tree(model)
    still = Motion(np.zeros(1), (), np.zeros((1, 0)))
    poses = forward_kinematics(tree, tree.coordinates_of(still))
    marked = [model.marker(name) for name in names]
    bodies = np.array([tree.body_index[marker.body] for marker in marked], np.int64)
    return poses.points(bodies, np.array([marker.location for marker in marked]).reshape(-1, 3))[0]


def frames_around(markers: Markers, start: float, end: float) -> Markers:
    """The frames that OpenSim averages: from the last one at or before `start` to the first at or after `end` [s].

    Raises
    ------
    BadData : the range ends before it starts, or there are no frames
    """
    if len(markers) == 0:
        raise BadData("the recording has no frames")
    if start > end:
        raise BadData(f"the time range {start:g} to {end:g} s ends before it starts")
    first = max(int(np.searchsorted(markers.time, start + INSTANT, side="right")) - 1, 0)
    last = min(int(np.searchsorted(markers.time, end - INSTANT, side="left")), len(markers) - 1)
    kept = slice(first, max(last, first) + 1)
    return replace(markers, time=markers.time[kept], values=markers.values[kept])
