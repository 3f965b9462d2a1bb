"""Columns of a table of forces without a heading, found by their numbers: only where one reading is possible."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array

XYZ = "xyz"
PUSH = 50.0  # Largest force of a plate that somebody stands on, at least [N].
LOADED = 20.0  # Force from which on a point or a moment is looked at [N].
LEVEL = 0.002  # A center of pressure stays on its plate: its height changes by less [m].
UPRIGHT, ONE_WAY = 0.7, 0.95
"""Share of a plate's force along the vertical, and of its loaded samples in which that has one sign."""
NEAR, FAR = 10.0, 20.0
"""A center of pressure is nearer to the origin than the first [m]; numbers beyond the second are millimetres."""
TURNS = 0.05  # A moment about the vertical changes by more with the steps of a walk [N m].


def guessed_names(values: Array) -> list[str] | None:
    """Names of all columns of a table of forces (rows, columns), None where its numbers leave it open. The first column
    is time where it rises evenly. The rest are groups of a force and a center of pressure (6 columns each), a force and
    a moment (6), or a force, a center of pressure and a moment in one of both orders (9). One axis is vertical: the
    forces point along it, to one side each, and centers of pressure do not move along it, which moments do.
    """
    time, rest = _time_first(values)
    readings = [names for names in (_read(rest, kinds) for kinds in KINDS) if names is not None]
    return [*time, *readings[0]] if len(readings) == 1 else None


KINDS = (("F", "COP"), ("F", "M"), ("F", "COP", "M"), ("F", "M", "COP"))


def _time_first(values: Array) -> tuple[list[str], Array]:
    steps = np.diff(values[:, 0])
    even = len(steps) > 1 and np.isfinite(steps).all() and (steps > 0.0).all() and np.ptp(steps) < 0.1 * steps.mean()
    return (["time"], values[:, 1:]) if even else ([], values)


def _read(values: Array, kinds: tuple[str, ...]) -> list[str] | None:
    """Names of the columns (rows, columns) read as groups of these kinds, None where they cannot be."""
    width = 3 * len(kinds)
    if not values.shape[1] or values.shape[1] % width:
        return None
    groups = values.reshape(len(values), -1, len(kinds), 3)
    forces = groups[:, :, 0]
    size = np.linalg.norm(forces, axis=2)
    if not np.nanmax(size, initial=0.0) > PUSH:
        return None
    up = int(np.argmax(np.nansum(np.abs(forces), axis=(0, 1))))
    looked = 0
    for g in range(groups.shape[1]):
        loaded = size[:, g] > LOADED
        if any(_is_force(groups[:, g, part], up) for part in range(1, len(kinds))):
            return None
        if loaded.sum() < 3:
            continue
        if not _is_force(forces[:, g], up):
            return None
        looked += 1
        for index, kind in enumerate(kinds[1:], 1):
            part = groups[loaded, g, index]
            if not (_is_point(part, up) if kind == "COP" else _is_moment(part, size[loaded, g], up)):
                return None
    if not looked:
        return None
    return [f"{kind}{axis}{g + 1}" for g in range(groups.shape[1]) for kind in kinds for axis in XYZ]


def _is_force(part: Array, up: int) -> bool:
    """Whether vectors (samples, 3) push along the vertical, in one sense."""
    size = np.linalg.norm(part, axis=1)
    loaded = size > LOADED
    if loaded.sum() < 3:
        return False
    along = part[loaded, up]
    one_way = max(np.mean(along > 0.0), np.mean(along < 0.0)) > ONE_WAY
    return bool(one_way and np.median(np.abs(along) / size[loaded]) > UPRIGHT)


def _is_point(part: Array, up: int) -> bool:
    """Whether vectors (samples, 3) are centers of pressure: near, and at one height."""
    scale = 1e-3 if np.nanmedian(np.linalg.norm(part, axis=1)) > FAR else 1.0
    inside = np.nanmedian(np.linalg.norm(part, axis=1)) * scale < NEAR
    return bool(inside and np.nanpercentile(part[:, up], 95) - np.nanpercentile(part[:, up], 5) < LEVEL / scale)


def _is_moment(part: Array, force: Array, up: int) -> bool:
    """Whether vectors (samples, 3) are moments: they change about the vertical, and their lever is one of a room."""
    scale = 1e-3 if np.nanmedian(np.linalg.norm(part, axis=1) / force) > FAR else 1.0
    lever = np.nanmedian(np.linalg.norm(part, axis=1) / force) * scale
    about = part[np.isfinite(part[:, up]), up]
    return bool(lever < NEAR and len(about) and np.ptp(about) * scale > TURNS)
