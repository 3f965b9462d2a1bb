"""An order of the rows of a sparse matrix in which its normal matrix A A^T has a small envelope.

`scipy.sparse.csgraph` has it too, but takes longer to import than a second of tensions to solve.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def coupled_rows(
    rows: NDArray[np.int64], columns: NDArray[np.int64], count: int
) -> list[list[int]]:
    """Find the rows that share a column with each row.

    Parameters
    ----------
    rows, columns : (entries,) row and column of each entry that may differ from zero
    count : number of rows

    Returns
    -------
    for each row the rows that it shares a column with, itself among them, the last found first
    """
    columns_of: dict[int, list[int]] = defaultdict(list)
    rows_of: dict[int, list[int]] = defaultdict(list)
    for entry in np.lexsort((columns, rows)):
        columns_of[int(rows[entry])].append(int(columns[entry]))
        rows_of[int(columns[entry])].append(int(rows[entry]))
    return [
        list(dict.fromkeys(other for column in columns_of[row] for other in rows_of[column]))[::-1]
        for row in range(count)
    ]


def elimination_order(neighbors: Sequence[Sequence[int]]) -> NDArray[np.int64]:
    """Reverse Cuthill-McKee order of rows: breadth first from rows with few neighbors, reversed.

    Source: Cuthill and McKee 1969; George 1971, the reverse.

    Parameters
    ----------
    neighbors : rows that are coupled to each row, as `coupled_rows` gives them

    Returns
    -------
    (rows,) in the order of elimination
    """
    # A row that is coupled to itself counts itself twice, as in scipy.
    degrees = np.array([len(own) + (row in own) for row, own in enumerate(neighbors)], np.int32)
    order: list[int] = []
    waiting = set(range(len(neighbors)))
    for seed in np.argsort(degrees).tolist():
        if seed not in waiting:
            continue
        waiting.remove(seed)
        reached = len(order)
        order.append(seed)
        while reached < len(order):
            further = [row for row in neighbors[order[reached]] if row in waiting]
            waiting.difference_update(further)
            order += sorted(further, key=degrees.__getitem__)
            reached += 1
    return np.array(order[::-1], dtype=np.int64)
