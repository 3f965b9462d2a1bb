"""Muscle paths of a transferred model along a carried motion, beside those of the model as given.

Detailed models have paths of their own that snap over surfaces in postures that nobody tried. What
jumps in the model as given too, at the same coordinates, is the model's; the rest comes of the
transfer. Where the carried motion itself hops, from one solution of its frames to another, every
path jumps: the motion is judged in parts between hops, and these are named.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.motion.filters import differentiate
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.muscles.path_jumps import path_jumps

MIN_FRAMES = 6  # That a spline of the motion needs.
HOP = 0.2
"""A rotation that changes between two frames by more hops [rad]."""
UNUSUAL = 10.0
"""And by so many times what is usual for it: coarse frames of fast motions are no hops."""


AT_BOUND = 0.01  # A coordinate that is nearer to its bound lies at it [rad]


class Hop(NamedTuple):
    """A coordinate that hops.

    Attributes
    ----------
    time : of the frame after it [s]
    coordinate : its name
    size : [rad]
    bounds : coordinates of its joint that lie at a bound of their range on one side of the hop:
        where a motion leads out of the ranges, the nearest pose inside them changes at once
    """

    time: float
    coordinate: str
    size: float
    bounds: tuple[str, ...] = ()


@read_only
class CarriedPaths:
    """The largest jump of each muscle's path along a motion.

    Attributes
    ----------
    muscles : their names
    given : (muscles,) in the model as given [m], 0 where it does not jump
    transferred : (muscles,) in the transferred model [m]
    hops : of the motion, the largest of each instant
    """

    muscles: tuple[str, ...]
    given: Array
    transferred: Array
    hops: tuple[Hop, ...] = ()

    @property
    def own(self) -> tuple[str, ...]:
        """Muscles that jump in both models."""
        return self._names((self.given > 0.0) & (self.transferred > 0.0))

    @property
    def new(self) -> tuple[str, ...]:
        """Muscles that jump in the transferred model alone."""
        return self._names((self.given == 0.0) & (self.transferred > 0.0))

    def _names(self, chosen: np.ndarray) -> tuple[str, ...]:
        return tuple(
            name for name, wanted in zip(self.muscles, chosen, strict=True) if bool(wanted)
        )


def carried_paths(given: Model, transferred: Model, motion: Motion) -> CarriedPaths | None:
    """Find which muscle paths jump along a motion, in both models.

    Parameters
    ----------
    given : with more joints, before the transfer
    transferred : after it, with the same coordinates and muscles
    motion : carried to it [rad or m]; parts of six frames and more are judged, between frames that
        are unknown and hops

    Returns
    -------
    the jumps, None without muscles or without such a part
    """
    hops = motion_hops(transferred, motion)
    known = np.asarray(np.isfinite(motion.values).all(axis=1))
    breaks = {int(np.searchsorted(motion.time, hop.time)) for hop in hops}
    parts = [
        part
        for start, stop in runs(known)
        for part in pairwise([start, *sorted(at for at in breaks if start < at < stop), stop])
        if part[1] - part[0] >= MIN_FRAMES
    ]
    if not parts or not transferred.muscles:
        return None
    moved = [
        differentiate(Motion(motion.time[begin:end], motion.names, motion.values[begin:end]))
        for begin, end in parts
    ]
    return CarriedPaths(
        muscles=transferred.muscle_names,
        given=np.max([_largest(given, part) for part in moved], axis=0),
        transferred=np.max([_largest(transferred, part) for part in moved], axis=0),
        hops=hops,
    )


def motion_hops(model: Model, motion: Motion) -> tuple[Hop, ...]:
    """Find where a motion hops from one solution of its frames to another.

    Parameters
    ----------
    model : whose motion it is
    motion : over time [rad or m]

    Returns
    -------
    the largest hop of each instant, in order
    """
    turns = [
        column
        for column, name in enumerate(motion.names)
        if model.coordinate(name).motion == "rotational"
    ]
    steps = np.nan_to_num(np.abs(np.diff(motion.values[:, turns], axis=0)))
    if not steps.size:
        return ()
    hopping = steps > np.maximum(HOP, UNUSUAL * np.median(steps, axis=0))
    sizes = np.where(hopping, steps, 0.0)
    found = []
    for frame in np.flatnonzero(hopping.any(axis=1)):
        column = int(np.argmax(sizes[frame]))
        found.append(
            Hop(
                time=float(motion.time[frame + 1]),
                coordinate=motion.names[turns[column]],
                size=float(sizes[frame, column]),
                bounds=_at_bounds(model, motion, int(frame), motion.names[turns[column]]),
            )
        )
    return tuple(found)


def _at_bounds(model: Model, motion: Motion, frame: int, name: str) -> tuple[str, ...]:
    """Find coordinates of a joint at a bound in a frame or in the next.

    Parameters
    ----------
    model : whose motion it is
    motion : over time [rad or m]
    frame : before the hop
    name : a coordinate of the joint

    Returns
    -------
    those that are kept in their range
    """
    joint = next((one for one in model.joints if name in one.coordinates), None)
    found = []
    for other in (name,) if joint is None else joint.coordinates:
        coordinate = model.coordinate(other)
        if other not in motion.names or not coordinate.clamped:
            continue
        values = motion.values[frame : frame + 2, motion.names.index(other)]
        away = np.abs(values[:, None] - np.array(coordinate.range))
        if float(away.min()) < AT_BOUND:
            found.append(other)
    return tuple(found)


def _largest(model: Model, motion: Motion) -> Array:
    """Compute the largest jump of each path (muscles,) [m]."""
    paths = muscle_kinematics(model, motion, moment_arms=False)
    assert paths.muscle_velocity is not None
    return path_jumps(motion.time, paths.muscle_length, paths.muscle_velocity).max(axis=0)
