"""Errors of single numbers, as the extremes of a curve are, under the draws of a trial, and of means of trials."""

from __future__ import annotations

from dataclasses import dataclass
from zlib import crc32

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.uncertainty.spread import LEVEL


@read_only
@dataclass(frozen=True, eq=False)
class ValueErrors:
    """Errors of the numbers of a trial under draws.

    Attributes
    ----------
    names : step and quantity, as tables of values name them
    errors : (draws, names) in the units of the tables, NaN in a draw that has no solution
    """

    names: tuple[tuple[str, str], ...]
    errors: Array

    def limits(self) -> tuple[Array, Array, Array]:
        """How far the limits of 90 % lie from the value, and the standard deviation, (names,) each."""
        known = self.errors[np.isfinite(self.errors).all(axis=1)]
        if len(known) < 2:
            none = np.full(len(self.names), np.nan)
            return none, none, none
        low, high = np.quantile(known, (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL), axis=0)
        return low, high, known.std(axis=0, ddof=1)


def widened_errors(errors: Array, factors: Array) -> Array:
    """Errors (draws, names) further from their middle by a factor of each, as limits are widened."""
    known = np.isfinite(errors).all(axis=1)
    if not known.any():
        return errors
    low, high = np.quantile(errors[known], (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL), axis=0)
    middle = 0.5 * (low + high)
    return np.asarray(middle + factors * (errors - middle))


def of_subject(errors: Array, subject: str) -> Array:
    """Errors (draws, names) in an order of the subject's own.

    Draws go by the names of sources and items: a marker is misplaced alike in all trials of a subject, which is true,
    and in those of another, which is not. In another order for each, subjects err independently.
    """
    order = np.random.default_rng(crc32(subject.encode())).permutation(len(errors))
    return np.asarray(errors[order])
