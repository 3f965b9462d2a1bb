"""What a marked weight or rod on a force plate shows: a wrench in the plate's axes and its line in
the laboratory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from myomorph.core.contact.plates import plate_axes, plate_wrench
from myomorph.core.model.arrays import Array, freeze, frozen_array, read_only, runs
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.model import STANDARD_GRAVITY
from myomorph.core.model.series import Markers, PlateRecording


@dataclass(frozen=True)
class MarkedWeight:
    """A weight that stands on the plate, or a rod that is pushed onto it."""

    name: str  # for messages; placements of one name are of one mass
    markers: tuple[str, ...]  # on the weight
    # of each marker in the mass center, summing to 1; None for their mean (a dumbbell's two ends, a
    # bar's)
    shares: tuple[float, ...] | None = None
    mass: float | None = None  # [kg]; None if unknown, then only the direction of the force is used
    # two of the markers, the lower first, on the line of a rod; the force passes along it. None for
    # a weight at rest, whose force is vertical and passes through its mass center
    axis: tuple[str, str] | None = None
    # from the rod's lower marker down to its tip [m]; the tip then lies on the plate's surface
    tip: float | None = None

    def __post_init__(self) -> None:
        if self.shares is not None and (
            # a share may be negative
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


STILL = 0.01  # Speed below which a weight is at rest [m/s]
SHORTEST = 1.0  # Rest that makes a placement [s]
SETTLE = 0.2  # Time left out at both ends of a rest [s]
WINDOW = 0.25  # Pieces into which a push of a rod is cut [s]
LEAST = 0.1  # Share of the largest normal force above which the plate is loaded


@read_only
class Placement:
    """One rest of a weight, or one piece of a push with a rod."""

    name: str  # for messages
    # (3,) mean, of the plate on the weight, about the center of the top surface, in the plate's
    # axes [N]
    force: Array
    # (3,) mean, of the plate on the weight, about the center of the top surface, in the plate's
    # axes [N m]
    moment: Array
    point: Array  # (3,) through which the force passes, in the laboratory [m]
    direction: Array  # (3,) unit, of the force on the weight, in the laboratory
    weight: str = ""  # name of the weight
    expected: float = float("nan")  # size the force should have, NaN if unknown [N]
    # (3,) where the plate's surface is touched, in the laboratory [m], or None
    contact: Array | None = None
    pushed: bool = False  # a rod's push, which need not be steady
    tared: bool = True  # whether what the unloaded plate reads was subtracted, or needed not to be
    moved: float = 0.0  # how far the weight moved while it should have rested [m]
    # standard deviation of the force, low-passed by averaging over a tenth of a second, as a share
    # of it
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
        """Line of action in the plate's axes: the point nearest to the plate's center (3,) [m],
        unit direction (3,).
        """
        return np.cross(self.force, self.moment) / self.size**2, self.force / self.size


def find_placements(
    recording: PlateRecording,
    plate_time: Array,
    markers: Markers,
    weight: MarkedWeight,
    intervals: Sequence[tuple[float, float]] | None = None,
) -> tuple[Placement, ...]:
    """Placements in one recording: each rest of a weight while the plate is loaded, each piece of a
    rod's push. A weight that never rests while the plate carries it becomes a placement that says
    how far it moved. `plate_time` (samples,) on the markers' clock [s]; `intervals` (start, end) of
    the placements [s]; None looks for them.
    """
    lacking = [name for name in weight.markers if name not in markers.names]
    if lacking:
        raise UnknownName("marker", lacking[0], markers.names, "the recording")
    gravity = _gravity(recording, markers, weight)
    force, moment = _on_weight(recording, plate_time, gravity)
    normal = np.abs(force[:, 2])
    loaded = normal > LEAST * np.quantile(normal, 0.995)
    tared = int(np.count_nonzero(~loaded)) > 10
    if tared:
        force = force - np.median(force[~loaded], axis=0)
        moment = moment - np.median(moment[~loaded], axis=0)
    if intervals is None:
        intervals = _intervals(plate_time, loaded, markers, weight)
    if not intervals:
        raise BadData(
            f"no placement of '{weight.name}' on plate '{recording.name}': it is never loaded long"
            " enough"
        )
    results = []
    for number, (start, end) in enumerate(intervals, 1):
        samples = (plate_time >= start) & (plate_time <= end)
        frames = (markers.time >= start) & (markers.time <= end)
        if samples.sum() < 2 or not frames.any():
            raise BadData(
                f"no samples of plate '{recording.name}' and markers between {start:g} and"
                f" {end:g} s"
            )
        name = f"{weight.name} {number} ({start:.2f} to {end:.2f} s)"
        one = _placement(
            name,
            weight,
            force[samples],
            moment[samples],
            plate_time[samples],
            markers,
            frames,
            gravity,
        )
        results.append(replace(one, tared=tared))
    return tuple(results)


def _gravity(recording: PlateRecording, markers: Markers, weight: MarkedWeight) -> Array:
    """Gravity (3,) along the laboratory's axis nearest to the plate's normal [m/s^2]."""
    normal = plate_axes(recording.corners)[:, 2]
    places = np.concatenate([markers[name] for name in weight.markers]) - recording.corners.mean(
        axis=0
    )
    above = np.nanmedian(places @ normal) if np.isfinite(places).any() else -1.0
    axis = int(np.argmax(np.abs(normal)))
    gravity = np.zeros(3)
    gravity[axis] = -STANDARD_GRAVITY * np.sign(normal[axis]) * np.sign(above)
    return gravity


def _on_weight(recording: PlateRecording, plate_time: Array, gravity: Array) -> tuple[Array, Array]:
    """Wrench of the plate on what stands on it, in the plate's axes, whatever sign the file has."""
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
    """Start and end [s] of rests, or of the pieces of a push."""
    result: list[tuple[float, float]] = []
    still = np.asarray(np.interp(plate_time, markers.time, _speed(markers, weight)) < STILL)
    for start, stop in runs(loaded):
        first = float(plate_time[start])
        last = float(plate_time[stop - 1])
        if weight.axis is not None:
            cuts = np.arange(first + SETTLE, last - SETTLE - WINDOW, WINDOW)
            result += [(float(cut), float(cut) + WINDOW) for cut in cuts]
            continue
        if last - first < SHORTEST:
            continue
        rests = [
            (float(plate_time[start + a]) + SETTLE, float(plate_time[start + b - 1]) - SETTLE)
            for a, b in runs(still[start:stop])
            if plate_time[start + b - 1] - plate_time[start + a] >= SHORTEST
        ]
        result += rests or [(first + SETTLE, last - SETTLE)]
    return result


def _speed(markers: Markers, weight: MarkedWeight) -> Array:
    """Speed (frames,) of the weight's markers over a tenth of a second either way, inf where unseen
    [m/s].
    """
    values = np.stack([markers[name] for name in weight.markers], axis=1)
    reach = max(1, round(0.1 * markers.rate))
    frames = np.arange(len(markers))
    seen: Array = np.isfinite(values[:, :, :1]).astype(np.float64)
    width = 2 * (reach // 2) + 1
    shares = scipy.ndimage.uniform_filter1d(seen, width, axis=0)
    sums = scipy.ndimage.uniform_filter1d(np.where(seen > 0, values, 0.0), width, axis=0)
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
    force: Array,
    moment: Array,
    time: Array,
    markers: Markers,
    frames: np.ndarray,
    gravity: Array,
) -> Placement:
    values = np.stack([markers[marker][frames] for marker in weight.markers], axis=1)
    seen = np.isfinite(values).all(axis=2)
    if not seen.any(axis=0).all():
        hidden = weight.markers[int(np.flatnonzero(~seen.any(axis=0))[0])]
        raise BadData(f"placement '{name}': marker '{hidden}' is never seen in it")
    means = np.nanmean(values, axis=0)
    shares = (
        np.full(len(means), 1.0 / len(means)) if weight.shares is None else np.array(weight.shares)
    )
    direction = -gravity
    contact = None
    if weight.axis is not None:
        lower, upper = (means[weight.markers.index(marker)] for marker in weight.axis)
        direction = upper - lower
        if weight.tip is not None:
            contact = lower - weight.tip * direction / np.linalg.norm(direction)
    mean = force.mean(axis=0)
    expected = float("nan") if weight.mass is None else weight.mass * float(np.linalg.norm(gravity))
    return Placement(
        name=name,
        force=mean,
        moment=moment.mean(axis=0),
        point=shares @ means,
        direction=direction,
        weight=weight.name,
        expected=expected if weight.axis is None else float("nan"),
        contact=contact,
        pushed=weight.axis is not None,
        moved=_wander(markers.time[frames], values.mean(axis=1)),
        unsteady=_wander(time, force) / float(np.linalg.norm(mean)),
    )


def _wander(time: Array, values: Array) -> float:
    """Root mean square distance from the mean of averages over tenths of a second."""
    number = np.floor((time - time[0]) / 0.1).astype(np.int64)
    finite = np.isfinite(values).all(axis=1)
    number = number[finite]
    values = values[finite]
    counts = np.bincount(number)
    sums = np.stack([np.bincount(number, weights=column) for column in values.T], axis=1)
    averages = sums[counts > 0] / counts[counts > 0, None]
    return float(np.sqrt(np.mean(np.sum((averages - averages.mean(axis=0)) ** 2, axis=1))))
