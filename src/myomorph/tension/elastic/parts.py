"""Which muscles, rows and other unknowns belong together: parts of the problem that share nothing are solved apart."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from myomorph.tension.separable import Separable


class Part(NamedTuple):
    """Unknowns and rows of one part, in ascending order."""

    muscles: NDArray[np.int64]  # those on elastic tendons
    others: NDArray[np.int64]  # all other unknowns
    rows: NDArray[np.int64]  # of the balance, in the order of elimination


def parts_of(separable: Separable, elastic: NDArray[np.bool_]) -> list[Part]:
    """The parts that have a muscle on an elastic tendon, the largest first.
    `elastic` (muscles,) of the first unknowns, which have an elastic tendon.
    """
    unknowns, rows = len(separable.weight), len(separable.first)
    column = separable.column
    links = coo_array((np.ones(len(column)), (column, unknowns + separable.row)), shape=(unknowns + rows,) * 2)
    count, label = connected_components(links, directed=False)
    stretches = np.zeros(unknowns, np.bool_)
    stretches[: len(elastic)] = elastic
    result = [
        Part(
            np.flatnonzero(stretches & (label[:unknowns] == index)),
            np.flatnonzero(~stretches & (label[:unknowns] == index)),
            np.flatnonzero(label[unknowns:] == index),
        )
        for index in range(count)
    ]
    return sorted((one for one in result if len(one.muscles)), key=lambda one: -len(one.muscles))
