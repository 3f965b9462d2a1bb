"""Paths whose length is a function of coordinates, beside those of the kernel.

    length      l = f(c)
    moment arm  r_i = -df/dc_i, or a function of its own
    velocity    ldot = -sum r_j cdot_j, or a function of its own

What reaches a coordinate through those that follow it is added, as the kernel does: r_i += g_i r_d.
"""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.functions import Function, PiecewisePolynomial
from myomorph.core.model.model import Model
from myomorph.core.model.paths import PathFunction
from myomorph.core.model.polynomial import Polynomial
from myomorph.core.muscles import path_arrays as columns
from myomorph.core.muscles.path import PathMotion, PathValues
from myomorph.core.muscles.path_arrays import PathArrays
from myomorph.core.muscles.path_frame import coupler_slopes
from myomorph.core.rigid.kernels import kernel

AT_ONCE = 512  # Frames whose terms stand in one table.


@kernel
def slopes_of_couplers(paths, c, slopes):
    """`coupler_slopes` of frames: c (frames, coordinates), slopes (frames, couplers, 2) filled."""
    for frame in range(c.shape[0]):
        coupler_slopes(paths, c[frame], slopes[frame])


def has_functions(model: Model) -> bool:
    """Return whether a function gives the length of a muscle's path."""
    return any(muscle.path.function is not None for muscle in model.muscles)


def put_path_functions(
    model: Model, arrays: PathArrays, motion: PathMotion, values: PathValues
) -> None:
    """Fill in lengths, velocities and moment arms of muscles with a function.

    Parameters
    ----------
    model : of the paths
    arrays : compiled of them
    motion : whose dependent coordinates are set
    values : of all muscles, changed in place
    """
    slopes = np.zeros((len(motion.coordinates), len(arrays.coupler), 2))
    if len(arrays.coupler):
        slopes_of_couplers(arrays, motion.coordinates, slopes)
    for start in range(0, len(motion.coordinates), AT_ONCE):
        frames = slice(start, start + AT_ONCE)
        part = motion.part(frames.start, frames.stop)
        here = PathValues(
            lengths=values.lengths[frames],
            velocities=values.velocities[frames],
            arms=values.arms[frames],
        )
        for muscle, item in enumerate(model.muscles):
            if item.path.function is not None:
                numbers = [model.coordinate_names.index(x) for x in item.path.function.coordinates]
                _put_muscle(item.path.function, numbers, muscle, arrays, part, here, slopes[frames])


def _put_muscle(
    function: PathFunction,
    numbers: list[int],
    muscle: int,
    arrays: PathArrays,
    motion: PathMotion,
    values: PathValues,
    slopes: Array,
) -> None:
    """Fill in the values of one muscle.

    Parameters
    ----------
    function : of its path
    numbers : of the function's coordinates
    muscle : its number
    slopes : (frames, couplers, 2) of dependent coordinates in those they follow
    """
    first = arrays.start[muscle, columns.ARMS]
    stop = arrays.start[muscle + 1, columns.ARMS]
    pattern = arrays.arm[first:stop]
    arms = values.arms[:, first:stop]
    arms[:] = 0.0
    c = motion.coordinates[:, numbers]
    values.lengths[:, muscle] = value_of(function.length, c)
    for index, number in enumerate(numbers):
        slot = int(np.flatnonzero(pattern[:, 0] == number)[0])
        arms[:, slot] = (
            value_of(function.moment_arms[index], c)
            if function.moment_arms
            else -slope_of(function.length, c, index)
        )
    for row in range(
        arrays.start[muscle, columns.FOLLOWS], arrays.start[muscle + 1, columns.FOLLOWS]
    ):
        coupler, dependent, *sources = arrays.follow[row]
        for i, slot in enumerate(sources):
            if slot >= 0:
                arms[:, slot] += slopes[:, coupler, i] * arms[:, dependent]
    if function.velocity is not None:
        both = np.hstack([c, motion.speeds[:, numbers]])
        values.velocities[:, muscle] = value_of(function.velocity, both)
        return
    free = pattern[:, 1] == 1
    speeds = motion.speeds[:, pattern[free, 0]]
    values.velocities[:, muscle] = -(arms[:, free] * speeds).sum(axis=1)


def value_of(function: Polynomial | Function, c: Array) -> Array:
    """Evaluate a function of coordinates.

    Parameters
    ----------
    function : of all columns
    c : (frames, coordinates) [rad or m]

    Returns
    -------
    (frames,)
    """
    return function(c) if isinstance(function, Polynomial) else function(*c.T)


def slope_of(function: Polynomial | Function, c: Array, index: int) -> Array:
    """Evaluate the derivative of a function of coordinates in one of them.

    Parameters
    ----------
    function : of all columns
    c : (frames, coordinates) [rad or m]
    index : of the coordinate

    Returns
    -------
    (frames,)
    """
    if isinstance(function, Polynomial):
        return function.slope(c, index)
    if isinstance(function, PiecewisePolynomial):
        return function(c[:, 0], order=1)
    return function.slope(*c.T, index=index)
