"""A recording drawn around the one that was made: markers, angles, external forces, EMG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from myomorph.core.fit.noise import RecordingNoise
from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.contacts import Site
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.model import Model
from myomorph.core.model.segments import segments_of
from myomorph.core.model.series import Emg, Markers, Motion, Series, Wrenches
from myomorph.core.model.spatial import rotation_from_vector
from myomorph.core.motion.ik import InverseKinematicsOptions
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.motion.unseen import SWAY_TIME, AssumedMode
from myomorph.lab.uncertainty.bodies import Draw
from myomorph.lab.uncertainty.normals import Course

SKIN = {"thigh": "skin_thigh", "shank": "skin_shank", "foot": "skin_foot"} | dict.fromkeys(
    ("upper_arm", "lower_arm", "hand"), "skin_arm"
)
"""Sources by segments of `model.segments`; all others are the trunk's."""
TOGETHER = 0.5
"""Share of the variance of skin movement that moves all markers of a segment alike; residuals show
the rest alone.
"""


def skin_sizes(
    model: Model, draw: Draw, residuals: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Find the standard deviations along each axis of the skin under every marker [m].

    They are that of its segment, and its own, at least as large as the marker's root mean square
    distance from the model in this recording leaves it.
    """
    try:
        segments = segments_of(model)
    except BadData:  # No human body: the trunk's size for all of it.
        segments = {}
    result = {}
    for marker in model.markers:
        part = segments.get(marker.body)
        size = getattr(draw.sources, SKIN.get(part.name if part else "", "skin_trunk"))
        separate = np.sqrt(1.0 - TOGETHER) * size
        # Residuals are distances in space; nothing is added where the source is left out.
        seen = residuals.get(marker.name, 0.0) / np.sqrt(3.0)
        result[marker.name] = (np.sqrt(TOGETHER) * size, max(separate, seen) if size else 0.0)
    return result


def drawn_markers(
    model: Model, markers: Markers, draw: Draw, residuals: Mapping[str, float]
) -> Markers:
    """Markers with noise, and moved by skin that moves on bone.

    Parameters
    ----------
    model : says which segment a marker is on
    markers : as recorded [m]
    draw : which errors
    residuals : see `skin_sizes` [m]; {} for the usual sizes

    Returns
    -------
    markers (frames, markers, 3) [m] of the same names and times

    Raises
    ------
    BadData : the recording has no frame

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> draw = mm.uncertainty.Draw(0, mm.uncertainty.Sources(), mm.uncertainty.Normals(10))
    >>> markers = mm.read_recording("reach.trc").markers
    >>> moved = mm.uncertainty.drawn_markers(model, markers, draw, {})
    >>> bool(0.0 < abs(moved.values - markers.values).max() < 0.05)
    True
    """
    frames = len(markers)
    width = _width(markers.time, draw.sources.skin_time)
    sizes = skin_sizes(model, draw, residuals)
    bodies = {marker.name: marker.body for marker in model.markers}
    values = np.array(markers.values)
    noise = draw.sources.marker_noise
    known = [index for index, name in enumerate(markers.names) if name in sizes]
    names = [markers.names[index] for index in known]
    if noise:
        values[:, known] += noise * draw.normals.processes(
            draw.number, "noise", names, Course(frames, 0.0)
        )
    if any(sizes[name][1] for name in names):
        together, separate = np.array([sizes[name] for name in names]).T[..., None]
        hold = list(dict.fromkeys(bodies[name] for name in names))
        shared = draw.normals.processes(draw.number, "skin", hold, Course(frames, width))
        values[:, known] += together * shared[:, [hold.index(bodies[name]) for name in names]]
        values[:, known] += separate * draw.normals.processes(
            draw.number, "skin of marker", names, Course(frames, width)
        )
    return replace(markers, values=values)


def drawn_rotations(rotations: Array, sensors: Sequence[str], time: Array, draw: Draw) -> Array:
    """Draw rotations of bodies as sensors report them, with noise of filter and skin.

    Parameters
    ----------
    rotations : (frames, sensors, 3, 3) without errors
    sensors : names
    time : (frames,) [s]
    draw : which errors

    Returns
    -------
    (frames, sensors, 3, 3)
    """
    if not draw.sources.sensor_noise:
        return rotations
    width = _width(time, draw.sources.skin_time)
    noise = draw.normals.processes(draw.number, "sensor", sensors, Course(len(time), width))
    return np.asarray(rotations @ rotation_from_vector(draw.sources.sensor_noise * noise))


def drawn_places(
    options: InverseKinematicsOptions, spreads: Mapping[str, float], draw: Draw
) -> InverseKinematicsOptions:
    """Draw options of inverse kinematics with other likely angles [rad].

    These angles take the place of lost sensors.
    """
    places = options.coordinates
    if places is None or not spreads or not draw.sources.sensor_noise:
        return options
    width = _width(places.time, draw.sources.skin_time)
    values = np.array(places.values)
    for name, spread in spreads.items():
        process = draw.normals.process(
            draw.number, "lost sensor", name, Course(len(values), width, 1)
        )[:, 0]
        values[:, places.names.index(name)] += spread * process
    return replace(options, coordinates=replace(places, values=values))


def drawn_unseen(modes: Sequence[AssumedMode], time: Array, draw: Draw) -> Array:
    """Errors of what inverse kinematics assumed of coordinates that no marker shows.

    Parameters
    ----------
    modes : ways in which it may differ, at all frames
    time : (frames,) [s]
    draw : which errors

    Returns
    -------
    (frames, coordinates) [rad or m]; (frames, 1) of zeros without any mode
    """
    width = _width(time, SWAY_TIME)
    total = np.zeros((len(time), len(modes[0].shape) if modes else 1))
    for mode in modes if draw.sources.untracked_coordinates else ():
        lasting = draw.normals.of(draw.number, "unseen", mode.name)[0]
        changing = draw.normals.process(
            draw.number, "unseen, changing", mode.name, Course(len(time), width, 1)
        )[:, 0]
        size = lasting * mode.lasting + changing * mode.changing
        total += draw.sources.untracked_coordinates * np.multiply.outer(size, mode.shape)
    return total


def drawn_angles(
    model: Model, motion: Motion, draw: Draw, noise: RecordingNoise | None = None
) -> Motion:
    """Draw a motion with errors in all angles that are free.

    Where a body floats, its position is kept.

    Parameters
    ----------
    model : says which coordinates are free
    motion : without errors [rad or m]
    draw : which errors
    noise : of the coordinates as recorded, which is drawn beside errors of angles; None for none

    Returns
    -------
    coordinates (frames, coordinates) [rad or m]

    Raises
    ------
    UnknownName : the motion has a coordinate that the model does not have

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> draw = mm.uncertainty.Draw(0, mm.uncertainty.Sources(), mm.uncertainty.Normals(10))
    >>> motion = mm.read_motion("reach.mot", model)
    >>> moved = mm.uncertainty.drawn_angles(model, motion, draw)
    >>> bool(0.0 < abs(moved.values - motion.values).max() < 0.2)
    True
    """
    frames = len(motion)
    width = _width(motion.time, draw.sources.skin_time)
    values = np.array(motion.values)
    size = draw.sources.angle
    free = free_angles(model)
    for index, name in enumerate(motion.names):
        check_name("coordinate", name, model.coordinate_names)
        if size and name in free:
            values[:, index] += (
                size
                * draw.normals.process(draw.number, "angle", name, Course(frames, width, 1))[:, 0]
            )
    if noise is not None and draw.sources.marker_noise:
        values += _drawn_noise(motion, noise, draw)
    return replace(motion, values=values)


def _drawn_noise(motion: Motion, noise: RecordingNoise, draw: Draw) -> Array:
    """Draw the noise of coordinates (frames, coordinates) [rad or m], none where it is not known.

    What a Gaussian of width s smooths is alike over 2 sqrt(pi) s.
    """
    drawn = np.zeros(motion.values.shape)
    known = np.flatnonzero(np.isfinite(noise.sd) & (noise.sd > 0.0))
    for column in known:
        alike = float(noise.correlation_time[column]) / (2.0 * np.sqrt(np.pi))
        name = noise.names[column]
        width = _width(motion.time, alike)
        drawn[:, column] = (
            noise.sd[column]
            * draw.normals.process(draw.number, "noise", name, Course(len(motion), width, 1))[:, 0]
        )
    return drawn


def free_angles(model: Model) -> tuple[str, ...]:
    """Find the coordinates that turn joints.

    Locked and dependent ones are left out, and those of a body that floats.
    """
    fixed = {coupler.dependent for coupler in model.couplers}.union(floating_coordinates(model))
    turning = (
        item for item in model.coordinates if item.motion == "rotational" and not item.locked
    )
    return tuple(coordinate.name for coordinate in turning if coordinate.name not in fixed)


def drawn_wrenches(wrenches: Wrenches, up: Array, draw: Draw) -> Wrenches:
    """External forces of plates that stand elsewhere, with other gains and another clock.

    A plate that is turned turns its forces and free torques; how far that moves where they act is
    part of the error of its position.

    Parameters
    ----------
    wrenches : as recorded
    up : (3,) unit vector of the vertical
    draw : which errors

    Returns
    -------
    forces [N], points [m] and torques [N m] at the same times

    Raises
    ------
    BadData : the wrenches have no frame

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> draw = mm.uncertainty.Draw(0, mm.uncertainty.Sources(), mm.uncertainty.Normals(10))
    >>> loads = mm.read_loads("reach_grf.xml", model, mm.read_motion("reach.mot", model))
    >>> moved = mm.uncertainty.drawn_wrenches(loads, model.up, draw)
    >>> bool(0.0 < abs(moved.points - loads.points).max() < 0.02)
    True
    """
    points = np.array(wrenches.points)
    forces = np.array(wrenches.forces)
    torques = np.array(wrenches.torques)
    for index, name in enumerate(wrenches.names):
        shift = draw.of("plate_position", name, 3)
        points[:, index] += shift - (shift @ up) * up
        forces[:, index] *= np.exp(draw.of("plate_gain", name, 3))
        rotation = rotation_from_vector(draw.of("plate_rotation", name, 3))
        forces[:, index] = forces[:, index] @ rotation.T
        torques[:, index] = torques[:, index] @ rotation.T
    moved = replace(wrenches, points=points, forces=forces, torques=torques)
    late = float(draw.of("clock", "forces")[0])
    return shifted(moved, late) if late else moved


def shifted(wrenches: Wrenches, late: float) -> Wrenches:
    """Shift forces by a clock that is `late` [s] behind.

    The first and last are held at the ends.
    """
    at = np.clip(wrenches.time - late, wrenches.time[0], wrenches.time[-1])
    low = np.clip(
        np.searchsorted(wrenches.time, at, side="right") - 1, 0, max(len(wrenches) - 2, 0)
    )
    high = np.minimum(low + 1, len(wrenches) - 1)
    step = np.where(high > low, wrenches.time[high] - wrenches.time[low], 1.0)
    share = ((at - wrenches.time[low]) / step)[:, None, None]

    def between(values: Array) -> Array:
        near = np.where(share < 0.5, values[low], values[high])
        mixed = (1.0 - share) * values[low] + share * values[high]
        # Beside a sample without a center of pressure the nearer one counts.
        return np.asarray(np.where(np.isfinite(mixed), mixed, near))

    forces = between(wrenches.forces)
    points = between(wrenches.points)
    torques = between(wrenches.torques)
    return replace(wrenches, forces=forces, points=points, torques=torques)


def drawn_emg(emg: Emg, draw: Draw) -> Emg:
    """EMG with other gains.

    Parameters
    ----------
    emg : envelopes, relative to maximum voluntary contraction
    draw : which errors

    Returns
    -------
    envelopes (frames, channels) of the same names and times

    Raises
    ------
    BadData : a gain is not finite

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> draw = mm.uncertainty.Draw(0, mm.uncertainty.Sources(), mm.uncertainty.Normals(10))
    >>> emg = mm.Emg(np.arange(3.0), ("flexor",), [[0.1], [0.2], [0.3]])
    >>> moved = mm.uncertainty.drawn_emg(emg, draw).values / emg.values
    >>> bool(np.allclose(moved, moved[0])), bool(moved[0, 0] != 1.0)
    (True, True)
    """
    factors = np.array([draw.factor("emg_gain", name) for name in emg.names])
    return replace(emg, values=emg.values * factors)


def _width(time: Array, duration: float) -> float:
    """Convert a duration [s] to frames."""
    return duration / float(np.median(np.diff(time))) if len(time) > 1 else 0.0


def drawn_sites(sites: Sequence[Site], draw: Draw) -> tuple[Site, ...]:
    """Sites elsewhere on their bodies, those of one contact on one body by the same."""
    if not draw.sources.contact_point:
        return tuple(sites)
    return tuple(
        replace(site, points=site.points + draw.of("contact_point", f"{site.group} {site.body}", 3))
        for site in sites
    )


def drawn_activations(ready: Series, sites: Sequence[Site], draw: Draw) -> Series:
    """Draw contacts (frames, sites) that begin and end at other times.

    All touches of one contact are late by the same.
    """
    if not draw.sources.contact_time or len(ready) < 2:
        return ready
    values = np.array(ready.values)
    for group, members in grouped((site.group, index) for index, site in enumerate(sites)).items():
        begin, end = draw.of("contact_time", group, 2)
        values[:, members] = _moved(ready.time, values[:, members], float(begin), float(end))
    return replace(ready, values=values)


def _moved(time: Array, values: Array, begin: float, end: float) -> Array:
    """Move the first half of every touch by `begin` [s], the second half by `end` [s].

    A touch that lasts to the end of the recording keeps that end: nothing was found there.
    """
    result = np.zeros_like(values)
    for start, stop in runs(np.asarray((values > 0.0).any(axis=1))):
        first = begin if start > 0 else 0.0
        last = end if stop < len(time) else 0.0
        alone = np.zeros_like(values)
        alone[start:stop] = values[start:stop]
        middle = 0.5 * (time[start] + time[stop - 1])
        # Times of the touch that was found, at which it is as it now is at `time`.
        length = max(time[stop - 1] - time[start] + last - first, 1e-9)
        late = first + (last - first) * np.clip((time - time[start] - first) / length, 0.0, 1.0)
        at = time - (late if stop - start > 2 else np.where(time < middle, first, last))
        for index in range(values.shape[1]):
            result[:, index] = np.maximum(result[:, index], np.interp(at, time, alone[:, index]))
    return result
