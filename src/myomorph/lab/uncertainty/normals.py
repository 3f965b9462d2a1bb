"""Random numbers of the sources of error.

They are the same for the same source, item and draw, whatever else is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple
from zlib import crc32

import numpy as np
import scipy

from myomorph.core.model.arrays import Array

# Standard deviations of the smoothing Gaussian that a process is begun before its first frame
REACH = 4


class Course(NamedTuple):
    """Numbers over time, correlated by a Gaussian.

    Attributes
    ----------
    frames : how many
    width : of the Gaussian, in frames; 0 for white noise
    size : numbers of each frame
    """

    frames: int
    width: float
    size: int = 3


@dataclass(frozen=True)
class Normals:
    """Standard normal numbers of `draws` draws.

    Numbers depend on the seed, the source's name, the item's name and the draw alone: a marker is
    misplaced alike in every trial of a subject, and two conditions differ by what differs between
    them.

    Attributes
    ----------
    draws : how many there are
    seed : other numbers for another one
    """

    draws: int
    seed: int = 0

    def of(self, draw: int, source: str, name: str, size: int = 1) -> Array:
        """Draw numbers that hold for a whole recording, spread evenly over the draws.

        They form a Latin hypercube.

        Source: McKay, Beckman and Conover 1979.

        Parameters
        ----------
        draw : which of the draws
        source : of error
        name : of the item
        size : how many

        Returns
        -------
        (size,) of variance 1
        """
        return _hypercube(self.draws, self.seed, source, name, size)[draw]

    def uniform(self, draw: int, source: str, name: str) -> float:
        """Draw a number from 0 to 1, spread evenly over the draws."""
        return float(_evenly(self.draws, self.seed, source, name, 1)[draw, 0])

    def process(self, draw: int, source: str, name: str, course: Course) -> Array:
        """Draw numbers that are correlated over time by a Gaussian.

        Parameters
        ----------
        draw : which of the draws
        source : of error
        name : of the item
        course : frames, correlation and numbers of each frame

        Returns
        -------
        (frames, size) of variance 1
        """
        return self.processes(draw, source, (name,), course)[:, 0]

    def processes(self, draw: int, source: str, names: Sequence[str], course: Course) -> Array:
        """Draw correlated numbers of several items at once.

        Parameters
        ----------
        draw : which of the draws
        source : of error
        names : of the items
        course : frames, correlation and numbers of each frame and item

        Returns
        -------
        (frames, names, size) of variance 1
        """
        frames, width, size = course
        before = int(np.ceil(REACH * width)) if width > 0.0 else 0
        white = np.empty((frames + 2 * before, len(names), size))
        for index, name in enumerate(names):
            rng = np.random.default_rng(
                (self.seed, crc32(source.encode()), crc32(name.encode()), draw)
            )
            white[:, index] = rng.standard_normal((len(white), size))
        if not before:
            return white
        offsets = np.arange(-before, before + 1)
        weights = np.exp(-0.5 * (offsets / width) ** 2)
        weights = weights[:, None] / np.linalg.norm(weights)
        flat = scipy.signal.oaconvolve(white.reshape(len(white), -1), weights, "valid", axes=0)
        return np.asarray(flat.reshape(frames, len(names), size))


@lru_cache(maxsize=8192)
def _hypercube(draws: int, seed: int, source: str, name: str, size: int) -> Array:
    return np.asarray(scipy.special.ndtri(_evenly(draws, seed, source, name, size)))


def _evenly(draws: int, seed: int, source: str, name: str, size: int) -> Array:
    """Draw numbers from 0 to 1, spread evenly over the draws, (draws, size).

    Of each column, each of `draws` equal parts between 0 and 1 holds one.
    """
    rng = np.random.default_rng((seed, crc32(source.encode()), crc32(name.encode())))
    order = rng.permuted(np.tile(np.arange(draws), (size, 1)), axis=1).T
    return np.asarray((order + rng.random((draws, size))) / draws)
