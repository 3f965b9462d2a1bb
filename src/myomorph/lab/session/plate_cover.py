"""What force plates carry of a body: whether all of it all the time, and what they weigh."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from myomorph.core.io.loads import read_load_entries
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, MyomorphError
from myomorph.core.motion.sync import clock_shift
from myomorph.lab.session.recordings import FOREFOOT, Recording, mean_place
from myomorph.lab.store.settings import ForceOptions
from myomorph.lab.study.inputs.external_forces import force_table

GRAVITY = 9.80665
LIGHT = 8.0
HEAVY = 300.0  # A person weighs between these [kg].
# Halves of what is weighed agree within this share, and somebody who stands still varies by no
# more.
STEADY = 0.02
# A gait weighs its body in the mean over so long at least, whatever the steps at its ends carry
# [s].
SECONDS = 1.5


def weighed(
    static: Recording | None, moving: Sequence[Recording], options: ForceOptions
) -> tuple[float, str]:
    """Weigh the subject by the plates of the static trial, else of a long gait on belts.

    Parameters
    ----------
    static : recording of standing still, None for none
    moving : the other recordings
    options : how a table of forces is laid out, and its clock

    Returns
    -------
    mass [kg], and a sentence on it

    Raises
    ------
    BadData : no recording weighs the subject
    """
    recordings = [*([static] if static is not None else []), *moving]
    for recording in sorted(recordings, key=lambda recording: not recording.still):
        mass = mass_on_plates(recording, options)
        if mass is not None:
            how = "standing still" if recording.still else "in the mean over the recording"
            return (
                mass,
                (
                    f"Mass {mass:.1f} kg, as the plates of {recording.path.name} weigh it {how}"
                    " (--mass)."
                ),
            )
    raise BadData(
        "no mass was given, and no plate weighs the subject: neither in quiet standing with both"
        " feet on plates, nor in {SECONDS:g} s of gait on belts that carry the whole body;"
        " give the mass (--mass KG)"
    )


def mass_on_plates(recording: Recording, options: ForceOptions) -> float | None:
    """Mass by the plates of a recording.

    Parameters
    ----------
    recording : with plates or a table of forces
    options : how a table is laid out, and its clock

    Returns
    -------
    [kg]; None where the plates do not carry all of the body, or not steadily
    """
    measured = total_force(recording, options)
    if measured is None or len(measured[0]) < 2:
        return None
    time, force, center = measured
    mean = float(np.mean(force))
    first_half, second_half = np.array_split(force, 2)
    first = float(np.mean(first_half))
    second = float(np.mean(second_half))
    mass = round(mean / GRAVITY, 1)
    if not LIGHT < mass < HEAVY or abs(first - second) > STEADY * mean:
        return None
    if recording.still:
        return (
            mass if np.std(force) < STEADY * mean and is_between_feet(recording, center) else None
        )
    covered = uncovered_share(recording, mean, options) < LASTS
    return mass if covered and time[-1] - time[0] > SECONDS else None


STANDS = 0.03
# A foot stands whose marker is so near its lowest height [m], and is slower than this [m/s].
NEAR = 0.35
CARRIES = 0.5  # Feet that stand on plates carry together at least this share of the weight.
SIDES = ("right", "left")
BETWEEN = 0.2  # Share of the way between the feet at whose ends a center of pressure is one foot's.
# Two feet that share a plate for so long are more than a step from one half of it to the other [s].
SHARED = 0.3
ANKLES = ("shank.lateral_malleolus", "shank.medial_malleolus", "foot.ankle")
"""What shows a foot that has no marker on a landmark."""
LASTS = 0.05  # Share of a recording in which feet stand without a force, from which on it counts.


def uncovered_share(
    recording: Recording, weight: float, options: ForceOptions | None = None
) -> float:
    """Share of the frames in which a foot stands and plates carry less than half the weight.

    Parameters
    ----------
    recording : with plates or a table of forces
    weight : of the body [N]
    options : layout and clock of a table of forces, where it does not say them

    Returns
    -------
    0 to 1; nan where there are no forces, or no marker of a foot
    """
    found = total_force(recording, options or ForceOptions())
    markers = recording.trial.markers
    if found is None or markers is None or len(markers) < 3:
        return float("nan")
    time, force, _ = found
    shift = (
        options.force_shift
        if options is not None and options.force_shift
        else clock_shift(markers.time, time)
    )
    time = time + (shift or 0.0)
    places = []
    for side in SIDES:
        ends = [mean_place(recording, *keys, side=side) for keys in (("foot.heel",), FOREFOOT)]
        places += (
            ends
            if any(end is not None for end in ends)
            else [mean_place(recording, *ANKLES, side=side)]
        )
    standing = [
        _stands(place @ recording.laboratory.rotation.T, markers.time)
        for place in places
        if place is not None
    ]
    if not standing:
        return float("nan")
    stands = np.any(standing, axis=0)
    carried = np.interp(markers.time, time, np.nan_to_num(force), left=0.0, right=0.0)
    return float(np.mean(stands & (carried < CARRIES * weight)))


def is_between_feet(recording: Recording, center: Array) -> bool:
    """Whether a center of pressure lies between the feet of somebody who stands on both.

    Parameters
    ----------
    recording : whose markers show the feet
    center : (samples, 3) y up [m]

    Returns
    -------
    False where a foot is not seen
    """
    feet = [_foot(recording, side) for side in SIDES]
    if feet[0] is None or feet[1] is None:
        return False
    right = np.nanmedian(feet[0], axis=0)[[0, 2]]
    left = np.nanmedian(feet[1], axis=0)[[0, 2]]
    along = left - right
    share = (np.nanmedian(center, axis=0)[[0, 2]] - right) @ along / (along @ along)
    return bool(BETWEEN < share < 1.0 - BETWEEN)


def _stands(place: Array, time: Array) -> np.ndarray:
    height = place[:, 1]
    if np.isfinite(height).sum() < 3:
        return np.zeros(len(time), bool)
    speed = np.linalg.norm(np.gradient(place, time, axis=0), axis=1)
    with np.errstate(invalid="ignore"):
        return (height < np.nanpercentile(height, 5.0) + STANDS) & (speed < NEAR)


def total_force(recording: Recording, options: ForceOptions) -> tuple[Array, Array, Array] | None:
    """Vertical force of all plates, or of the table of forces, together.

    Parameters
    ----------
    recording : with plates or a table of forces
    options : how a table is laid out

    Returns
    -------
    clock (samples,) [s], force (samples,) [N] and center of pressure (samples, 3), y up [m]; None
    where there are none
    """
    plates = _plate_forces(recording, options)
    if plates is None:
        return None
    time, vertical, points = plates
    total = vertical.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return time, total, (vertical[..., None] * points).sum(axis=1) / total[:, None]


def _plate_forces(recording: Recording, options: ForceOptions) -> tuple[Array, Array, Array] | None:
    """Read the forces of each plate.

    Returns
    -------
    clock (samples,) [s], vertical forces (samples, plates) [N], and centers of pressure
    (samples, plates, 3), y up [m]; None where there are none
    """
    upright = recording.laboratory.rotation
    loads = recording.near.get("loads")
    plates = recording.trial.plates
    if loads is None:
        if not plates:
            return None
        time = recording.trial.plate_time
        forces = np.stack([plate.forces for plate in plates], axis=1)
        points = np.stack([plate.points for plate in plates], axis=1)
    else:
        try:
            wrenches = [force_table(path, None, options) for path in _tables(loads)]
        except (MyomorphError, OSError):
            return None
        if not wrenches:
            return None
        time = wrenches[0].time
        forces = wrenches[0].forces
        points = wrenches[0].points
    return time, np.nan_to_num(forces) @ upright[1], np.nan_to_num(points) @ upright.T


def shared_time(recording: Recording, weight: float, options: ForceOptions) -> float:
    """Time for which two feet that stand share a plate [s].

    Its center of pressure then lies between them.
    """
    plates = _plate_forces(recording, options)
    markers = recording.trial.markers
    feet = [_foot(recording, side) for side in SIDES]
    if plates is None or markers is None or len(markers) < 3 or feet[0] is None or feet[1] is None:
        return 0.0
    time, vertical, points = plates
    at = np.searchsorted(time, markers.time).clip(0, len(time) - 1)
    right, left = [foot for foot in feet if foot is not None]
    stand = np.all(
        [foot[:, 1] < np.nanpercentile(foot[:, 1], 5.0) + STANDS for foot in (right, left)], axis=0
    )
    along = (left - right)[:, [0, 2]]
    shared = np.zeros(len(markers), bool)
    for plate in range(vertical.shape[1]):
        share = ((points[at, plate] - right)[:, [0, 2]] * along).sum(axis=1) / (along**2).sum(
            axis=1
        )
        loaded = vertical[at, plate] > CARRIES * weight
        shared |= stand & loaded & (share > BETWEEN) & (share < 1.0 - BETWEEN)
    return float(shared.sum() * np.median(np.diff(markers.time)))


def _foot(recording: Recording, side: str) -> Array | None:
    """(frames, 3) middle of a foot's markers, y up; None where there are none."""
    foot = mean_place(recording, "foot.heel", "shank.lateral_malleolus", *FOREFOOT, side=side)
    return None if foot is None else foot @ recording.laboratory.rotation.T


def _tables(loads: Path) -> list[Path]:
    if loads.suffix.lower() != ".xml":
        return [loads]
    return list(dict.fromkeys(entry.data for entry in read_load_entries(loads)))
