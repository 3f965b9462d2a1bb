"""Columns of a table of forces without names, guessed from their numbers."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array

AXES = "xyz"
KINDS = (("F", "COP"), ("F", "M"), ("F", "COP", "M"), ("F", "M", "COP"))
"""What the groups of columns of a force may be, in order: force, center of pressure, moment."""

MIN_LARGEST_FORCE = 50.0  # Of a plate that somebody stands on [N].
MIN_LOAD = 20.0  # Force from which on a point or a moment is looked at [N].
MIN_LOADED_SAMPLES = 3
MIN_VERTICAL_SHARE = 0.7  # Of a plate's force.
MIN_ONE_SIGN = 0.95  # Share of loaded samples in which the vertical force has one sign.
MAX_HEIGHT_CHANGE = 0.002  # A center of pressure stays on its plate [m].
MAX_DISTANCE = 10.0  # Of a center of pressure from the origin, and of a moment's lever [m].
MIN_MILLIMETERS = 20.0  # Numbers beyond it are millimeters.
MIN_MOMENT_CHANGE = 0.05  # About the vertical, with the steps of a walk [N m].


def guessed_names(values: Array) -> list[str] | None:
    """Guess the names of all columns of a table of forces from its numbers.

    The first column is time where it rises evenly. The rest are groups of a force and a center of
    pressure (6 columns each), a force and a moment (6), or a force, a center of pressure and a
    moment in one of both orders (9). One axis is vertical: the forces point along it, to one side
    each, and centers of pressure do not move along it, which moments do.

    Parameters
    ----------
    values : (rows, columns)

    Returns
    -------
    as "time", "Fx1", "COPx1", "Mx1"; None where none of these readings is possible, or more than
    one
    """
    time_names: list[str] = []
    if _rises_evenly(values[:, 0]):
        time_names = ["time"]
        values = values[:, 1:]
    readings = []
    for kinds in KINDS:
        names = _names_of_groups(values, kinds)
        if names is not None:
            readings.append(names)
    if len(readings) != 1:
        return None
    return [*time_names, *readings[0]]


def _rises_evenly(column: Array) -> bool:
    """Return whether a column (rows,) rises by steps that differ by less than a tenth."""
    steps = np.diff(column)
    if len(steps) < 2 or not np.isfinite(steps).all() or not (steps > 0.0).all():
        return False
    return bool(np.ptp(steps) < 0.1 * steps.mean())


def _names_of_groups(values: Array, kinds: tuple[str, ...]) -> list[str] | None:
    """Name columns that are read as groups of these kinds.

    Parameters
    ----------
    values : (rows, columns) without the time
    kinds : "F", "COP" and "M" in the order in which each group has them

    Returns
    -------
    one name per column; None where the numbers do not allow this reading
    """
    width = 3 * len(kinds)
    columns = values.shape[1]
    if not columns or columns % width:
        return None
    groups = values.reshape(len(values), -1, len(kinds), 3)
    forces = groups[:, :, 0]
    norms = np.linalg.norm(forces, axis=2)
    if not np.nanmax(norms, initial=0.0) > MIN_LARGEST_FORCE:
        return None
    vertical = int(np.argmax(np.nansum(np.abs(forces), axis=(0, 1))))
    count = groups.shape[1]
    possible = [_is_possible(groups[:, number], kinds, vertical) for number in range(count)]
    if False in possible or True not in possible:
        return None
    return [
        f"{kind}{axis}{number + 1}" for number in range(count) for kind in kinds for axis in AXES
    ]


def _is_possible(group: Array, kinds: tuple[str, ...], vertical: int) -> bool | None:
    """Judge whether columns are a force and what belongs to it.

    Parameters
    ----------
    group : (rows, kinds, 3)
    kinds : "F" first
    vertical : index of the vertical axis

    Returns
    -------
    whether they may be; None where the force is too small in most rows to say so
    """
    if any(_is_force(group[:, index], vertical) for index in range(1, len(kinds))):
        return False
    norms = np.linalg.norm(group[:, 0], axis=1)
    loaded = norms > MIN_LOAD
    if loaded.sum() < MIN_LOADED_SAMPLES:
        return None
    if not _is_force(group[:, 0], vertical):
        return False
    for index, kind in enumerate(kinds[1:], 1):
        vectors = group[loaded, index]
        if kind == "COP" and not _is_point(vectors, vertical):
            return False
        if kind == "M" and not _is_moment(vectors, norms[loaded], vertical):
            return False
    return True


def _is_force(vectors: Array, vertical: int) -> bool:
    """Return whether vectors (samples, 3) [N] push along the vertical axis, in one sense."""
    norms = np.linalg.norm(vectors, axis=1)
    loaded = norms > MIN_LOAD
    if loaded.sum() < MIN_LOADED_SAMPLES:
        return False
    along = vectors[loaded, vertical]
    one_sign = max(np.mean(along > 0.0), np.mean(along < 0.0)) > MIN_ONE_SIGN
    share = np.median(np.abs(along) / norms[loaded])
    return bool(one_sign and share > MIN_VERTICAL_SHARE)


def _is_point(vectors: Array, vertical: int) -> bool:
    """Return whether vectors (samples, 3) [m or mm] are near and at one height."""
    distance = np.nanmedian(np.linalg.norm(vectors, axis=1))
    meters = 1e-3 if distance > MIN_MILLIMETERS else 1.0
    if not distance * meters < MAX_DISTANCE:
        return False
    heights = vectors[:, vertical]
    change = np.nanpercentile(heights, 95) - np.nanpercentile(heights, 5)
    return bool(change < MAX_HEIGHT_CHANGE / meters)


def _is_moment(vectors: Array, force: Array, vertical: int) -> bool:
    """Return whether vectors are moments: changing about the vertical, with a short lever.

    Parameters
    ----------
    vectors : (samples, 3) [N m or N mm]
    force : (samples,) norm of the force [N]
    vertical : index of the axis
    """
    lever = np.nanmedian(np.linalg.norm(vectors, axis=1) / force)
    meters = 1e-3 if lever > MIN_MILLIMETERS else 1.0
    about = vectors[:, vertical]
    about = about[np.isfinite(about)]
    if not lever * meters < MAX_DISTANCE or not len(about):
        return False
    return bool(np.ptp(about) * meters > MIN_MOMENT_CHANGE)
