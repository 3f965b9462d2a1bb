"""A marked weight or rod on a force plate: its wrench, and its line in the laboratory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from myomorph.core.contact.plates import plate_axes, plate_wrench
from myomorph.core.fit.trends import running_mean
from myomorph.core.model.arrays import Array, freeze, frozen_array, read_only, runs
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.model import STANDARD_GRAVITY
from myomorph.core.model.series import Markers, PlateRecording

STILL = 0.01
"""Speed below which a weight is at rest [m/s]."""
MIN_REST = 1.0
"""Rest that makes a placement [s]."""
SETTLE = 0.2
"""Time left out at both ends of a rest [s]."""
WINDOW = 0.25
"""Duration of pieces into which a push of a rod is cut [s]."""
MIN_LOAD = 0.1
"""Share of the largest normal force above which the plate is loaded."""


@dataclass(frozen=True)
class MarkedWeight:
    """A weight that stands on the plate, or a rod that is pushed onto it.

    Attributes
    ----------
    name : for messages; placements of one name are of one mass
    markers : on the weight
    shares : of each marker in the mass center, summing to 1, maybe negative; None for their mean (a
        dumbbell's two ends, a bar's)
    mass : [kg]; None if unknown, then only the direction of the force is used
    axis : two of the markers, the lower first, on the line of a rod; the force passes along it.
        None for a weight at rest, whose force is vertical and passes through its mass center
    tip : from the rod's lower marker down to its tip [m]; the tip then lies on the plate's surface
    """

    name: str
    markers: tuple[str, ...]
    shares: tuple[float, ...] | None = None
    mass: float | None = None
    axis: tuple[str, str] | None = None
    tip: float | None = None

    def __post_init__(self) -> None:
        if self.shares is not None and (
            len(self.shares) != len(self.markers) or abs(sum(self.shares) - 1.0) > 1e-6
        ):
            raise BadData(
                f"weight '{self.name}': {len(self.markers)} shares that sum to 1 are expected"
            )
        if self.mass is not None and not self.mass > 0:
            raise BadData(f"weight '{self.name}': a mass of {self.mass:g} kg is not above 0")
        if self.axis is not None and not set(self.axis) <= set(self.markers):
            raise BadData(
                f"weight '{self.name}': its axis {self.axis} is not among its markers"
                f" {self.markers}"
            )


@read_only
class Placement:
    """One rest of a weight, or one piece of a push with a rod.

    Attributes
    ----------
    name : for messages
    force, moment : (3,) mean, of the plate on the weight, about the center of the top surface, in
        the plate's axes [N], [N m]
    point : (3,) through which the force passes, in the laboratory [m]
    direction : (3,) unit, of the force on the weight, in the laboratory
    weight : name of the weight
    expected : size the force should have, NaN if unknown [N]
    contact : (3,) where the plate's surface is touched, in the laboratory [m], or None
    pushed : a rod's push, which need not be steady
    tared : whether what the unloaded plate reads was subtracted, or needed not to be
    moved : how far the weight moved while it should have rested [m]
    unsteady : standard deviation of the force, low-passed by averaging over a tenth of a second, as
        a share of it
    """

    name: str
    force: Array
    moment: Array
    point: Array
    direction: Array
    weight: str = ""
    expected: float = float("nan")
    contact: Array | None = None
    pushed: bool = False
    tared: bool = True
    moved: float = 0.0
    unsteady: float = 0.0

    def __post_init__(self) -> None:
        freeze(self, force=(3,), moment=(3,), point=(3,), direction=(3,), contact=(3,))
        for name in ("force", "moment", "point", "direction", "contact"):
            if getattr(self, name) is not None and not np.isfinite(getattr(self, name)).all():
                raise BadData(f"placement '{self.name}': its {name} is not known")
        size = float(np.linalg.norm(self.direction))
        object.__setattr__(self, "direction", frozen_array(self.direction / size))
        if not np.linalg.norm(self.force) > 0:
            raise BadData(f"placement '{self.name}': no force")

    @property
    def size(self) -> float:
        """Size of the force [N]."""
        return float(np.linalg.norm(self.force))

    @property
    def line(self) -> tuple[Array, Array]:
        """Line of action in the plate's axes: a point (3,) [m] and a unit direction (3,).

        The point is the nearest to the plate's center.
        """
        return np.cross(self.force, self.moment) / self.size**2, self.force / self.size


class PlateSamples(NamedTuple):
    """Wrench of a plate on what stands on it, in the plate's axes.

    Attributes
    ----------
    time : (samples,) [s]
    force, moment : (samples, 3) [N], [N m]
    """

    time: Array
    force: Array
    moment: Array

    def within(self, start: float, end: float) -> PlateSamples:
        """Choose samples between two times [s]."""
        chosen = (self.time >= start) & (self.time <= end)
        return PlateSamples(self.time[chosen], self.force[chosen], self.moment[chosen])


def find_placements(
    recording: PlateRecording,
    plate_time: Array,
    markers: Markers,
    weight: MarkedWeight,
    intervals: Sequence[tuple[float, float]] | None = None,
) -> tuple[Placement, ...]:
    """Find placements in one recording: each rest of a weight, each piece of a rod's push.

    A weight that never rests while the plate carries it becomes a placement that says how far it
    moved.

    Parameters
    ----------
    recording : channels of the plate
    plate_time : (samples,) on the markers' clock [s]
    markers : of the weight
    weight : with the names of its markers
    intervals : (start, end) of the placements [s]; None looks for them

    Returns
    -------
    in the order of time

    Raises
    ------
    UnknownName : a marker is not in the recording
    BadData : no placement, or nothing recorded during one
    """
    for name in weight.markers:
        check_name("marker", name, markers.names, "the recording")
    gravity = _gravity(recording, markers, weight)
    force, moment = _on_weight(recording, plate_time, gravity)
    normal = np.abs(force[:, 2])
    loaded = normal > MIN_LOAD * np.quantile(normal, 0.995)
    tared = int(np.count_nonzero(~loaded)) > 10
    if tared:
        force = force - np.median(force[~loaded], axis=0)
        moment = moment - np.median(moment[~loaded], axis=0)
    if intervals is None:
        intervals = _intervals(plate_time, loaded, markers, weight)
    if not intervals:
        raise BadData(
            f"no valid placement of '{weight.name}' on plate '{recording.name}': it is never loaded"
            " long"
            " enough"
        )
    recorded = PlateSamples(plate_time, force, moment)
    results = []
    for number, (start, end) in enumerate(intervals, 1):
        samples = recorded.within(start, end)
        frames = (markers.time >= start) & (markers.time <= end)
        if len(samples.time) < 2 or not frames.any():
            raise BadData(
                f"no samples of plate '{recording.name}' and markers between {start:g} and"
                f" {end:g} s"
            )
        name = f"{weight.name} {number} ({start:.2f} to {end:.2f} s)"
        placement = _placement(name, weight, samples, markers, frames, gravity)
        results.append(replace(placement, tared=tared))
    return tuple(results)


def _gravity(recording: PlateRecording, markers: Markers, weight: MarkedWeight) -> Array:
    """Gravity (3,) along the laboratory's axis nearest to the plate's normal [m/s^2]."""
    normal = plate_axes(recording.corners)[:, 2]
    seen = np.concatenate([markers[name] for name in weight.markers])
    places = seen - recording.corners.mean(axis=0)
    above = np.nanmedian(places @ normal) if np.isfinite(places).any() else -1.0
    axis = int(np.argmax(np.abs(normal)))
    gravity = np.zeros(3)
    gravity[axis] = -STANDARD_GRAVITY * np.sign(normal[axis]) * np.sign(above)
    return gravity


def _on_weight(recording: PlateRecording, plate_time: Array, gravity: Array) -> tuple[Array, Array]:
    """Wrench of the plate on what stands on it, in the plate's axes, whatever sign the file has.

    Parameters
    ----------
    plate_time : (samples,) [s]
    gravity : (3,) in the laboratory [m/s^2]

    Returns
    -------
    (samples, 3) [N] and (samples, 3) [N m]
    """
    if len(recording.channels) != len(plate_time):
        raise BadData(
            f"{recording.name} has {len(recording.channels)} samples, but its clock has"
            f" {len(plate_time)}"
        )
    force, moment = plate_wrench(recording)
    strongest = force[np.argmax(np.abs(force[:, 2]))]
    pulls_down = float(plate_axes(recording.corners) @ strongest @ gravity) > 0
    return (-force, -moment) if pulls_down else (force, moment)


def _intervals(
    plate_time: Array, loaded: np.ndarray, markers: Markers, weight: MarkedWeight
) -> list[tuple[float, float]]:
    """Start and end [s] of rests, or of the pieces of a push.

    Parameters
    ----------
    plate_time, loaded : (samples,) [s], and when the plate is loaded
    """
    result: list[tuple[float, float]] = []
    still = np.asarray(np.interp(plate_time, markers.time, _speed(markers, weight)) < STILL)
    for start, stop in runs(loaded):
        first = float(plate_time[start])
        last = float(plate_time[stop - 1])
        if weight.axis is not None:
            cuts = np.arange(first + SETTLE, last - SETTLE - WINDOW, WINDOW)
            result += [(float(cut), float(cut) + WINDOW) for cut in cuts]
            continue
        if last - first < MIN_REST:
            continue
        rests = [
            (float(plate_time[start + a]) + SETTLE, float(plate_time[start + b - 1]) - SETTLE)
            for a, b in runs(still[start:stop])
            if plate_time[start + b - 1] - plate_time[start + a] >= MIN_REST
        ]
        result += rests or [(first + SETTLE, last - SETTLE)]
    return result


def _speed(markers: Markers, weight: MarkedWeight) -> Array:
    """Speed (frames,) of a weight over a tenth of a second either way, inf where unseen."""
    values = np.stack([markers[name] for name in weight.markers], axis=1)
    reach = max(1, round(0.1 * markers.rate))
    frames = np.arange(len(markers))
    seen: Array = np.isfinite(values[:, :, :1]).astype(np.float64)
    width = 2 * (reach // 2) + 1
    shares = running_mean(seen, width)
    sums = running_mean(np.where(seen > 0, values, 0.0), width)
    smooth = sums / np.where(shares > 1e-9, shares, np.nan)
    before = np.maximum(frames - reach, 0)
    after = np.minimum(frames + reach, len(frames) - 1)
    moved = np.linalg.norm(smooth[after] - smooth[before], axis=2)
    fastest = np.where(np.isfinite(moved), moved, -np.inf).max(axis=1)
    elapsed = np.maximum(markers.time[after] - markers.time[before], 1e-9)
    return np.where(fastest >= 0, fastest / elapsed, np.inf)


def _placement(
    name: str,
    weight: MarkedWeight,
    samples: PlateSamples,
    markers: Markers,
    frames: np.ndarray,
    gravity: Array,
) -> Placement:
    """Means over one placement.

    Parameters
    ----------
    name : for messages
    frames : (frames,) of the markers that belong to it
    gravity : (3,) in the laboratory [m/s^2]

    Raises
    ------
    BadData : a marker is never seen in it
    """
    values = np.stack([markers[marker][frames] for marker in weight.markers], axis=1)
    seen = np.isfinite(values).all(axis=2)
    if not seen.any(axis=0).all():
        hidden = weight.markers[int(np.flatnonzero(~seen.any(axis=0))[0])]
        raise BadData(f"placement '{name}': marker '{hidden}' is never seen in it")
    means = np.nanmean(values, axis=0)
    shares = np.full(len(means), 1.0 / len(means))
    if weight.shares is not None:
        shares = np.array(weight.shares)
    direction = -gravity
    contact = None
    if weight.axis is not None:
        lower = means[weight.markers.index(weight.axis[0])]
        direction = means[weight.markers.index(weight.axis[1])] - lower
        if weight.tip is not None:
            contact = lower - weight.tip * direction / np.linalg.norm(direction)
    expected = float("nan")
    if weight.mass is not None and weight.axis is None:
        expected = weight.mass * float(np.linalg.norm(gravity))
    force = samples.force.mean(axis=0)
    return Placement(
        name=name,
        force=force,
        moment=samples.moment.mean(axis=0),
        point=shares @ means,
        direction=direction,
        weight=weight.name,
        expected=expected,
        contact=contact,
        pushed=weight.axis is not None,
        moved=_wander(markers.time[frames], values.mean(axis=1)),
        unsteady=_wander(samples.time, samples.force) / float(np.linalg.norm(force)),
    )


def _wander(time: Array, values: Array) -> float:
    """Root mean square distance from the mean of averages over tenths of a second.

    Parameters
    ----------
    time : (samples,) [s]
    values : (samples, 3)
    """
    number = np.floor((time - time[0]) / 0.1).astype(np.int64)
    finite = np.isfinite(values).all(axis=1)
    number = number[finite]
    values = values[finite]
    counts = np.bincount(number)
    sums = np.stack([np.bincount(number, weights=column) for column in values.T], axis=1)
    averages = sums[counts > 0] / counts[counts > 0, None]
    return float(np.sqrt(np.mean(np.sum((averages - averages.mean(axis=0)) ** 2, axis=1))))
