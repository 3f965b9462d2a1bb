"""Force plates: from channels to force on the subject, center of pressure and free torque.

In the plate's axes (x from corner 2 to 1, y from corner 4 to 1, z = x cross y, by custom
downwards), with F and M the force and the moment about the center of the top surface,

    M = M_sensor + F x origin
    center of pressure = (-M_y / F_z, M_x / F_z, 0)
    T = M - center x F

Source: C3D user guide (Motion Lab Systems), FORCE_PLATFORM:TYPE, ORIGIN, CORNERS, CAL_MATRIX; type
3 after Kistler's formulae. The files hold the force of the plate on the subject. Who mounts a plate
the other way round and leaves its corners as they were gets forces of the right size whose center
of pressure runs across the walkway: the markers show it, for the center of pressure lies under the
body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.spells import steady
from myomorph.core.contact.unloaded import Zero, zero_of
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import PLATES
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message
from myomorph.core.model.series import ForcePlate, Markers, PlateRecording, Trial, Wrenches

CLEARLY = 0.25
"""Another first corner is better where it brings the center of pressure to this share of its
distance, or nearer, and to twice that share of what the next best one leaves: a plate that stands
as its file says is never turned for less.
"""

FIRM = 0.3
"""Samples with this share of the largest force count; below, centers are noise."""
MIN_COUNT = 20
"""Number of such samples that tell a plate's first corner."""
MAX_OUTSIDE = 0.1
"""Share of loaded samples whose center of pressure may lie outside the plate."""


MIN_IDLE = 10  # Samples without load that show what a plate reads then.
REFUSED = {
    5: "AMTI or Kistler with eight channels and a calibration matrix",
    6: "four three-axis sensors",
    7: "Kistler with an 8 by 8 calibration matrix",
    11: "Kistler split-belt treadmill",
    12: "Kistler split-belt treadmill",
    21: "AMTI stairs",
}
THRESHOLD = 0.03
"""A plate counts as loaded above this share of the largest normal force in the trial."""
SHORTEST = 0.02
"""Shorter loadings and gaps are taken for noise [s]."""


@dataclass(frozen=True)
class FirstCorner:
    """Distance of the center of pressure to the body, by the corner counted as a plate's first.

    Attributes
    ----------
    distances : median horizontal distance from the middle of the markers seen, corner 1 to 4 first
        [m]
    best : how many corners further the first one is, 0 to 3
    """

    distances: tuple[float, float, float, float]
    best: int

    @property
    def clear(self) -> bool:
        """Whether another corner than the file's is clearly the first."""
        nearest, second = sorted(self.distances)[:2]
        return (
            self.best != 0
            and nearest < CLEARLY * self.distances[0]
            and nearest < 2.0 * CLEARLY * second
        )


def counted_from(plate: ForcePlate, corner: int) -> ForcePlate:
    """Count the corners of a plate from another one, with its measurements turned along.

    Parameters
    ----------
    plate : as its file has it
    corner : number of the first corner, 0 for the file's
    """
    axes = plate_axes(plate.corners)
    corners = np.roll(plate.corners, -corner, axis=0)
    turn = plate_axes(corners) @ axes.T
    center = corners.mean(axis=0)
    return replace(
        plate,
        corners=corners,
        forces=plate.forces @ turn.T,
        points=(plate.points - center) @ turn.T + center,
        torques=plate.torques @ turn.T,
    )


def plate_axes(corners: Array) -> Array:
    """Axes of a plate in the laboratory, by its corners.

    Parameters
    ----------
    corners : (4, 3) [m]

    Returns
    -------
    (3, 3) columns x, y and z
    """
    x = corners[0] - corners[1]
    z = np.cross(x, corners[0] - corners[3])
    axes = np.stack([values / np.linalg.norm(values) for values in (x, np.cross(z, x), z)], axis=1)
    return np.asarray(axes, np.float64)


def first_corner(plate: ForcePlate, plate_time: Array, markers: Markers) -> FirstCorner | None:
    """Find which corner of a plate is probably its first; None where too little is known.

    Parameters
    ----------
    plate : forces as the file's corners give them, center of pressure NaN where unloaded
    plate_time : (samples,) [s]
    markers : of what stands on it, in the same laboratory

    Returns
    -------
    distances for each first corner, and the best one
    """
    axes = plate_axes(plate.corners)
    normal = axes[:, 2]
    size = np.abs(plate.forces @ normal)
    middle = _middle(markers, plate_time)
    firm = np.isfinite(plate.points).all(axis=1) & np.isfinite(middle).all(axis=1)
    if not firm.any():
        return None
    firm &= size > FIRM * np.nanmax(size[firm])
    if firm.sum() < MIN_COUNT:
        return None
    center = plate.corners.mean(axis=0)
    pressed = _across(plate.points[firm] - center, normal)
    target = _across(middle[firm] - center, normal)
    along = pressed @ axes
    distances = []
    for corner in range(4):
        place = along @ plate_axes(np.roll(plate.corners, -corner, axis=0)).T
        distances.append(float(np.median(np.linalg.norm(place - target, axis=1))))
    a, b, c, d = distances
    return FirstCorner(distances=(a, b, c, d), best=int(np.argmin(distances)))


def _across(vectors: Array, normal: Array) -> Array:
    """Parts of vectors (vectors, 3) across a normal (3,)."""
    return vectors - (vectors @ normal)[:, None] * normal


def _middle(markers: Markers, time: Array) -> Array:
    """Mean of the markers seen at other times.

    Parameters
    ----------
    time : (samples,) [s]

    Returns
    -------
    (samples, 3) [m], NaN where none was seen near
    """
    seen = np.asarray(np.isfinite(markers.values).all(axis=2))
    count = seen.sum(axis=1)
    total = np.where(seen[:, :, None], markers.values, 0.0).sum(axis=1)
    known = count > 0
    result = np.full((len(time), 3), np.nan)
    if known.sum() < 2:
        return result
    mean = total[known] / count[known, None]
    clock = markers.time[known]
    at = np.clip(np.searchsorted(clock, time), 1, len(clock) - 1)
    near = np.minimum(np.abs(clock[at] - time), np.abs(clock[at - 1] - time)) < 1.5 / markers.rate
    for axis in range(3):
        result[:, axis] = np.where(near, np.interp(time, clock, mean[:, axis]), np.nan)
    return result


def plate_wrench(plate: PlateRecording) -> tuple[Array, Array]:
    """Force and moment about the center of the top surface, in the plate's axes.

    Parameters
    ----------
    plate : its channels

    Returns
    -------
    (samples, 3) [N] and (samples, 3) [N m]

    Raises
    ------
    BadData : a type that is not built, or no calibration matrix
    """
    channels = plate.channels
    if plate.kind not in (1, 2, 3, 4):
        what = f" ({REFUSED[plate.kind]})" if plate.kind in REFUSED else ""
        raise BadData(
            f"force plate '{plate.name}' is of C3D type {plate.kind}{what}: types 1, 2, 3 and 4 are"
            " supported; export it as type 2 (forces and moments)"
        )
    if plate.kind == 3:
        return _sensor_wrench(plate, channels)
    if plate.kind == 4:
        if plate.calibration is None:
            raise BadData(
                f"force plate '{plate.name}' is of C3D type 4, but has no calibration matrix"
            )
        channels = channels @ plate.calibration.T
    force = channels[:, :3]
    if plate.kind == 1:
        center = np.column_stack((channels[:, 3:5], np.zeros(len(channels))))
        free = np.zeros_like(force)
        free[:, 2] = channels[:, 5]
        return force, free + np.cross(center, force)
    # The origin must lie below the surface; programs that wrote it the other way wrote all of it
    # so.
    origin = -plate.origin if plate.origin[2] > 0 else plate.origin
    return force, channels[:, 3:6] + np.cross(force, origin)


def _sensor_wrench(plate: PlateRecording, channels: Array) -> tuple[Array, Array]:
    """Wrench of a plate with a three-axis sensor near each corner.

    Parameters
    ----------
    channels : (samples, 8) Fx12, Fx34, Fy14, Fy23, Fz1..Fz4 [N]

    Returns
    -------
    (samples, 3) [N] and (samples, 3) [N m]
    """
    a, b, depth = np.abs(plate.origin)
    x12, x34, y14, y23, z1, z2, z3, z4 = channels.T
    force = np.column_stack((x12 + x34, y14 + y23, z1 + z2 + z3 + z4))
    moment = np.column_stack(
        (b * (z1 + z2 - z3 - z4), a * (-z1 + z2 + z3 - z4), b * (x34 - x12) + a * (y14 - y23))
    )
    return force, moment + np.cross(force, np.array([0.0, 0.0, -depth]))


def force_plate(plate: PlateRecording) -> ForcePlate:
    """Compute force on the subject, center of pressure and free torque of one plate.

    With force F and moment M about the plate's origin, in its axes,

        x = -M_y / F_z,   y = M_x / F_z,   T = M - (x, y, 0) * F

    Parameters
    ----------
    plate : channels and corners as recorded

    Returns
    -------
    (samples, 3) each, in the laboratory [N], [m], [N m]. The center of pressure is NaN only where
    the normal force is zero: see `force_plates` for loading
    """
    force, moment = plate_wrench(plate)
    with np.errstate(divide="ignore", invalid="ignore"):
        center = np.column_stack(
            (-moment[:, 1] / force[:, 2], moment[:, 0] / force[:, 2], np.zeros(len(force)))
        )
    center[~np.isfinite(center).all(axis=1)] = np.nan
    if plate.kind == 3 and not plate.origin[:2].any():
        center[:] = np.nan
    if plate.center_polynomial is not None:
        center = _corrected(center, plate.center_polynomial)
    torque = moment - np.cross(center, force)
    axes = plate_axes(plate.corners)
    return ForcePlate(
        name=plate.name,
        kind=plate.kind,
        corners=plate.corners,
        forces=force @ axes.T,
        points=center @ axes.T + plate.corners.mean(axis=0),
        torques=np.where(np.isfinite(torque), torque, np.nan) @ axes.T,
    )


def _corrected(center: Array, polynomial: Array) -> Array:
    """Correct the center of pressure (samples, 3) [m] by Kistler's polynomial of sixth order.

    Parameters
    ----------
    polynomial : (2, 6) coefficients for x and y, in mm
    """
    x = 1000.0 * center[:, 0]
    y = 1000.0 * center[:, 1]
    p, q = polynomial
    shift_x = (p[0] * y**4 + p[1] * y**2 + p[2]) * x**3 + (p[3] * y**4 + p[4] * y**2 + p[5]) * x
    shift_y = (q[0] * x**4 + q[1] * x**2 + q[2]) * y**3 + (q[3] * x**4 + q[4] * x**2 + q[5]) * y
    return np.column_stack(((x - shift_x) / 1000.0, (y - shift_y) / 1000.0, center[:, 2]))


def force_plates(trial: Trial) -> Trial:
    """Make `plates` of a trial's `plate_recordings`, with warnings about what looks wrong.

    Each plate's center of pressure and free torque are NaN where it is unloaded. A plate of a type
    that is not built is left out with a warning that names it. Which way is up is known from the
    markers: the force of a loaded plate must point from the plate to the subject, else force and
    moment are reversed, with a warning; and its center of pressure must lie under them, else its
    corners are counted from another one where that is clearly better (`first_corner`), with a
    warning.

    Parameters
    ----------
    trial : with channels of plates, and markers

    Returns
    -------
    the trial with `plates` and its warnings
    """
    warnings: list[Message] = []
    recordings: list[PlateRecording] = []
    for recording in trial.plate_recordings:
        try:
            plate_wrench(replace(recording, channels=recording.channels[:1]))
            recordings.append(recording)
        except BadData as error:
            warnings.append(PLATES.message(f"{error}; it was left out"))
    rate = (
        1.0 / float(np.median(np.diff(trial.plate_time))) if len(trial.plate_time) > 1 else 1000.0
    )
    plates = [force_plate(recording) for recording in recordings]
    states = loaded_samples(plates, rate)
    if _pulls_down(plates, states, trial):
        plates = [replace(plate, forces=-plate.forces, torques=-plate.torques) for plate in plates]
        warnings.append(
            PLATES.message(
                "the force plates pull the subject down as the file has it: force and moment were"
                " reversed"
            )
        )
    final = []
    for recording, plate, state in zip(recordings, plates, states, strict=True):
        plate = _turned(plate, state, trial, warnings)
        recording = replace(recording, corners=plate.corners)
        warnings += _warnings(recording, plate, state, rate)
        final.append(_while_loaded(plate, state))
    return replace(trial, plates=tuple(final), warnings=trial.warnings + tuple(warnings))


def _while_loaded(plate: ForcePlate, state: NDArray[np.bool_]) -> ForcePlate:
    """Keep center of pressure and free torque only where a plate is loaded (samples,)."""
    hidden = ~state[:, None]
    points = np.where(hidden, np.nan, plate.points)
    torques = np.where(hidden, np.nan, plate.torques)
    return replace(plate, points=points, torques=torques)


def _turned(
    plate: ForcePlate, state: NDArray[np.bool_], trial: Trial, warnings: list[Message]
) -> ForcePlate:
    """Turn a plate under the body where its corners are clearly counted from the wrong one."""
    if trial.markers is None:
        return plate
    corner = first_corner(_while_loaded(plate, state), trial.plate_time, trial.markers)
    if corner is None or not corner.clear:
        return plate
    warnings.append(
        PLATES.message(
            f"the corners of {plate.name} were counted from its corner {corner.best + 1}: so the"
            f" center of pressure lies {corner.distances[corner.best]:.2g} m from the markers'"
            f" middle, as the file has them {corner.distances[0]:.2g} m",
            place=plate.name,
        )
    )
    return counted_from(plate, corner.best)


def _pulls_down(
    plates: Sequence[ForcePlate], states: Sequence[NDArray[np.bool_]], trial: Trial
) -> bool:
    """Return whether the load of all plates points away from the side where the markers are."""
    if trial.markers is None or not np.isfinite(trial.markers.values).any():
        return False
    load = 0.0
    for plate, state in zip(plates, states, strict=True):
        above = trial.markers.values - plate.corners.mean(axis=0)
        side = np.sign(np.nanmedian(above @ plate_axes(plate.corners)[:, 2]))
        load += float(np.nansum(_pressing(plate)[state]) * side)
    return load < 0


def loaded_samples(plates: Sequence[ForcePlate], rate: float) -> list[NDArray[np.bool_]]:
    """Flag the samples of each plate carry a load.

    The threshold is a share of the largest normal force of all plates, so that a mouse and a jumper
    are judged alike, and counts from what the plate reads when idle (which may be tens of newtons).
    A plate whose largest force does not stand out of its own noise, or that never changes, is never
    loaded.

    Parameters
    ----------
    plates : of one trial
    rate : [Hz]

    Returns
    -------
    (samples,) for each plate
    """
    normals = [_pressing(plate) for plate in plates]
    peaks = [
        float(np.nanpercentile(np.abs(normal), 99.5)) if np.isfinite(normal).any() else 0.0
        for normal in normals
    ]
    largest = max(peaks, default=0.0)
    states = []
    for pressing, peak in zip(normals, peaks, strict=True):
        steps = np.abs(np.diff(pressing))
        noise = 1.05 * float(np.nanmedian(steps)) if np.isfinite(steps).any() else 0.0
        load = np.nan_to_num(np.abs(pressing - _idle(pressing, largest)))
        state = load > max(THRESHOLD * largest, 4.0 * noise)
        constant = np.nanmax(pressing) - np.nanmin(pressing) <= 1e-9 * peak if peak else True
        if peak <= 8.0 * noise or constant:
            state[:] = False
        states.append(steady(state, np.arange(len(state)) / rate, SHORTEST))
    return states


def _pressing(plate: ForcePlate) -> Array:
    """Force along the plate's normal (samples,), signed [N]."""
    return plate.forces @ plate_axes(plate.corners)[:, 2]


def _idle(pressing: Array, largest: float) -> float:
    """Find what an unloaded plate reads [N]: the median of small samples, if they stand apart.

    Parameters
    ----------
    pressing : (samples,) normal force [N]
    largest : of all plates [N]
    """
    size = np.abs(pressing[np.isfinite(pressing)])
    cut = 0.15 * largest
    small = pressing[np.abs(pressing) < cut]
    between = np.count_nonzero((size > 0.8 * cut) & (size < 1.2 * cut))
    alone = len(small) >= max(10, 0.05 * len(size)) and between < 0.2 * len(small)
    return float(np.median(small)) if alone and size.max() > 2.0 * cut else 0.0


def _warnings(
    recording: PlateRecording, plate: ForcePlate, state: NDArray[np.bool_], rate: float
) -> list[Message]:
    """Say what looks wrong with one plate.

    Parameters
    ----------
    recording : as the file has it
    plate : with forces
    state : (samples,) when it is loaded
    rate : [Hz]
    """
    result = []
    if recording.kind == 3 and not recording.origin[:2].any():
        result.append(
            PLATES.message(
                f"{plate.name} is of type 3, but its sensor distances are zero: no center of"
                " pressure",
                place=plate.name,
            )
        )
    if not state.any():
        return result
    axes = plate_axes(recording.corners)
    pressing = np.abs(plate.forces @ axes[:, 2])
    # Near the threshold the center of pressure is noise; only well loaded samples are judged.
    firm = state & (pressing > 0.3 * np.nanmax(pressing[state])) & np.isfinite(plate.points[:, 0])
    local = (plate.points[firm] - plate.corners.mean(axis=0)) @ axes
    half = 0.5 * np.array(
        [np.linalg.norm(plate.corners[0] - plate.corners[index]) for index in (1, 3)]
    )
    share = float(np.mean(np.any(np.abs(local[:, :2]) > 1.1 * half, axis=1))) if len(local) else 0.0
    if share > MAX_OUTSIDE:
        result.append(
            PLATES.message(
                f"the center of pressure of {plate.name} lies outside the plate in"
                f" {100 * share:.0f} % of loaded samples: its origin, corners or channels may be"
                " wrong",
                place=plate.name,
                share=share,
            )
        )
    normal = plate.forces @ axes[:, 2]
    peak = float(np.nanmax(np.abs(normal[state])))
    idle = normal[~state & np.isfinite(normal)]
    zero = zero_of(normal, rate, peak)
    if zero is None and len(idle) > MIN_IDLE:
        rest = float(np.median(idle))
        zero = Zero(first=rest, last=rest, largest=peak)
    # Nobody weighs more than the largest force.
    message = None if zero is None else replace(zero, weight=peak).message(plate.name)
    return result if message is None else [*result, message]


def wrenches_from_plates(
    plates: Sequence[ForcePlate], plate_time: Array, time: Array | None = None
) -> Wrenches:
    """Make wrenches of plates on another clock, bodies unknown ("").

    Force and moment about each plate's center are interpolated and the center of pressure is made
    of them anew, so an edge of loading carries no stray point. Where a plate is unloaded, or `time`
    lies outside the recording, force and torque are zero and the point is the plate's center.

    Parameters
    ----------
    plates : of one recording
    plate_time : (samples,) their clock [s]
    time : (frames,) the other clock [s]; their own by default

    Returns
    -------
    one wrench per plate

    Raises
    ------
    BadData : no plate, or plates of another clock
    """
    if not plates:
        raise BadData("there is no force plate to make wrenches of")
    own_clock = np.asarray(plate_time)
    clock = np.asarray(plate_time if time is None else time, dtype=np.float64)
    values = np.zeros((3, len(clock), len(plates), 3))
    for index, plate in enumerate(plates):
        if len(plate.forces) != len(plate_time):
            raise BadData(
                f"{plate.name} has {len(plate.forces)} samples, but its clock has {len(plate_time)}"
            )
        values[:, :, index] = _on_clock(plate, own_clock, clock)
    forces, points, torques = values
    return Wrenches(
        time=clock,
        names=tuple(plate.name for plate in plates),
        bodies=("",) * len(plates),
        forces=forces,
        points=points,
        torques=torques,
    )


def _on_clock(plate: ForcePlate, plate_time: Array, clock: Array) -> tuple[Array, Array, Array]:
    """Move one plate onto another clock.

    Parameters
    ----------
    plate_time, clock : (samples,) and (frames,) [s]

    Returns
    -------
    (frames, 3) force [N], point [m] and free torque [N m]
    """
    middle = plate.corners.mean(axis=0)
    loaded = np.isfinite(np.hstack((plate.points, plate.forces, plate.torques)).sum(axis=1))
    force = np.where(loaded[:, None], plate.forces, 0.0)
    arm = np.where(loaded[:, None], plate.points - middle, 0.0)
    moment = np.where(loaded[:, None], plate.torques, 0.0) + np.cross(arm, force)
    if clock is not plate_time:
        force = _interpolated(clock, plate_time, force)
        moment = _interpolated(clock, plate_time, moment)
    normal = plate_axes(plate.corners)[:, 2]
    pressing = force @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        arm = np.cross(normal, moment) / pressing[:, None]
    usable = np.isfinite(arm).all(axis=1) & (np.linalg.norm(force, axis=1) > 0)
    arm = np.where(usable[:, None], arm, 0.0)
    force = np.where(usable[:, None], force, 0.0)
    torque = np.where(usable[:, None], moment - np.cross(arm, force), 0.0)
    return force, arm + middle, torque


def _interpolated(clock: Array, time: Array, values: Array) -> Array:
    """Interpolate values (samples, 3) at times (samples,) on a clock (frames,), 0 outside."""
    inside = (clock >= time[0] - 1e-9) & (clock <= time[-1] + 1e-9)
    columns = [np.where(inside, np.interp(clock, time, column), 0.0) for column in values.T]
    return np.column_stack(columns)
