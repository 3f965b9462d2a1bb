"""The balance of torques over frames: A x = b of all terms, on the free coordinates.

Columns of A are the generalized forces of one unit of each unknown: a muscle's moment arms times
its force per unit activation, an actuator's direction times its optimal force. What falls on a
coordinate that a coupler drives is handed on to the coordinates it follows: tau_free = tau + C^T
tau_dependent with C = d(dependent)/d(free). Closed loops are taken alike: of the coordinates they
tie, some follow the others (`rigid.loops.loop_basis`), so that loads of the loop's own joint drop
out. Rows of locked and prescribed coordinates are left out, for whatever holds them there takes any
load. Rows that terms add stand behind those of the coordinates, each with an unknown of its own
behind all others.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import read_only
from myomorph.core.model.errors import BadModel
from myomorph.core.model.model import Model
from myomorph.core.rigid.coordinates import evaluate
from myomorph.core.rigid.kernels import inner, kernel
from myomorph.core.rigid.loops import LoopBasis
from myomorph.core.rigid.tree import Tree
from myomorph.core.tension.separable import Pattern, pattern
from myomorph.core.tension.terms.actuators import free_coordinates
from myomorph.core.tension.terms.term import Rows


class Links(NamedTuple):
    """How generalized forces on all coordinates become entries on the rows of A and b."""

    variable: NDArray[np.int64]  # (links,) the column that a link belongs to
    source: NDArray[np.int64]  # (links,) entry it reads
    # (links,) number, in `driven`, of the coordinate that hands it on, -1 for none
    dependent: NDArray[np.int64]
    follows: NDArray[np.int64]  # (links,) coordinate of the row it ends in
    target: NDArray[np.int64]  # (links,) entry of A it is added to
    # (coordinates,) row of each coordinate in the order of elimination, -1 for none
    row: NDArray[np.int64]
    # (dependents,) coordinates that follow others: by a coupler, then by a loop
    driven: NDArray[np.int64]


@read_only
class Assembly:
    """The pattern of A, and what fills it frame by frame."""

    tree: Tree
    rows: tuple[str, ...]  # names of the coordinates that are free and follow no other, one per row
    links: Links  # from entries to A; entries are those of the terms, one term after the other
    pattern: Pattern
    # (extra entries,) where in A the entries of the rows that terms add lie, then one for each such
    # row's own unknown
    extra_place: NDArray[np.int64]
    extra_row: NDArray[np.int64]  # (extra rows,) the rows of b that they are

    @property
    def coordinate_row(self) -> NDArray[np.int64]:
        """(rows,) place of every coordinate of `rows` in the order of elimination."""
        names = self.tree.model.coordinate_names
        return self.links.row[[names.index(row) for row in self.rows]]


def assemble(
    tree: Tree,
    entries: Sequence[tuple[int, int]],
    unknowns: int,
    extra: Sequence[Rows] = (),
    basis: LoopBasis | None = None,
    only: Collection[str] | None = None,
) -> Assembly:
    """The pattern of A from those of the terms.
    `entries` (unknown, coordinate) of every generalized force of unknowns, a coordinate of -1 for
    one that is not used; `unknowns`: how many the terms bring in; `extra`: rows that terms add;
    `basis`: which coordinates follow which, of a model that closes loops; `only`: the coordinates
    whose equations are kept, where not all are.
    """
    model = tree.model
    by_loops = np.zeros(0, np.int64) if basis is None else basis.dependent
    rows, row_of = _rows(model, by_loops, only)
    reach = _reach(tree, basis)
    table, places = _linked(
        [(unknown, reach[j] if j >= 0 else []) for unknown, j in entries], row_of
    )
    first = np.cumsum([0, *(len(row) for row in extra)]) + len(rows)
    own = np.arange(first[-1] - len(rows))
    shared = [np.array([first[number] + row.row, row.column]) for number, row in enumerate(extra)]
    row, column = np.hstack([places, *shared, [len(rows) + own, unknowns + own]]).astype(np.int64)
    shape = pattern(row, column, (int(first[-1]), unknowns + len(own)))
    table[:, 4] = shape.place[table[:, 4]]
    rank = np.argsort(shape.order)
    driven = np.concatenate([tree.arrays.coupler_coordinate, by_loops])
    columns = np.ascontiguousarray(table.T)
    row_rank = np.where(row_of >= 0, rank[row_of], -1)
    links = Links(
        variable=columns[0],
        source=columns[1],
        dependent=columns[2],
        follows=columns[3],
        target=columns[4],
        row=row_rank,
        driven=driven,
    )
    return Assembly(
        tree=tree,
        rows=rows,
        links=links,
        pattern=shape,
        extra_place=shape.place[places.shape[1] :],
        extra_row=rank[len(rows) :],
    )


def _rows(
    model: Model, by_loops: NDArray[np.int64], only: Collection[str] | None
) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Names of the coordinates whose equations are kept, and the row (coordinates,) of each, -1 for
    none.
    """
    names = model.coordinate_names
    rows = tuple(
        coordinate
        for coordinate in free_coordinates(model)
        if names.index(coordinate) not in by_loops and (only is None or coordinate in only)
    )
    if not rows:
        raise BadModel(
            f"model '{model.name}' has no free coordinate: all are locked, prescribed or driven"
        )
    row_of = np.full(len(names), -1, np.int64)
    row_of[[names.index(row) for row in rows]] = np.arange(len(rows))
    return rows, row_of


def _linked(
    sources: list[tuple[int, list[tuple[int, int]]]], row_of: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Columns variable ... target of `Links` (links, 5), and row and column (2, entries) of every
    entry of A.
    """
    places: dict[tuple[int, int], int] = {}
    links = []
    for source, (variable, ends) in enumerate(sources):
        for dependent, index in ends:
            if row_of[index] >= 0:
                target = places.setdefault((int(row_of[index]), variable), len(places))
                links.append((variable, source, dependent, index, target))
    return np.array(links, np.int64).reshape(-1, 5), np.array(list(places), np.int64).reshape(
        -1, 2
    ).T


def _reach(tree: Tree, basis: LoopBasis | None) -> list[list[tuple[int, int]]]:
    """(number of the dependent or -1, coordinate followed) pairs that each coordinate's torque is
    handed on along.
    """
    arrays = tree.arrays
    follows: dict[int, set[int]] = {}
    reach: list[list[tuple[int, int]]] = [[(-1, j)] for j in range(len(tree.model.coordinates))]
    if basis is not None:
        touched = np.nanmax(np.abs(basis.slopes), axis=0, initial=0.0) > 0.0
        for d, j in enumerate(basis.dependent):
            ends = {int(i) for i in basis.independent[touched[d]]}
            follows[int(j)] = ends
            reach[int(j)] = [(len(arrays.coupler_coordinate) + d, i) for i in sorted(ends)]
    for number, j in enumerate(arrays.coupler_coordinate):
        ends = set()
        for i in arrays.coupler_source[number]:
            if i >= 0:
                ends |= follows.get(int(i), {int(i)})
        follows[int(j)] = ends
        reach[int(j)] = [(number, i) for i in sorted(ends)]
    return reach


@inner
def _coupling(T, L, c, slopes, C):
    """C (dependents, coordinates): derivatives of each of `L.driven` in those it ends in, from
    slopes of loops.
    """
    couplers = T.coupler_coordinate.shape[0]
    for d in range(slopes.shape[0]):
        for m in range(C.shape[1]):
            C[couplers + d, m] = slopes[d, m]
    for index in range(couplers):
        i = T.coupler_source[index, 0]
        j = T.coupler_source[index, 1]
        x1 = c[i] if i >= 0 else 0.0
        x2 = c[j] if j >= 0 else 0.0
        _, d1, d2, _, _, _ = evaluate(T.functions, T.coupler_function[index], x1, x2)
        for m in range(C.shape[1]):
            C[index, m] = 0.0
        for s in range(2):
            source, slope = (i, d1) if s == 0 else (j, d2)
            if source < 0:
                continue
            earlier = -1
            for h in range(L.driven.shape[0]):
                if L.driven[h] == source:
                    earlier = h
            if earlier < 0:
                C[index, source] += slope
            else:
                for m in range(C.shape[1]):
                    C[index, m] += slope * C[earlier, m]


@kernel
def fold(T, L, coordinates, slopes, entries, forces, anyway, torques, values, right, left):
    """Fill A and b of every frame.
    `T`, `L`: arrays of the tree, `Links`; `coordinates` (frames, coordinates) all values; `slopes`
    (frames, dependents of loops, coordinates); `entries` (frames, entries) generalized forces of
    unit forces; `forces` (frames, variables) force of a unit of each variable; `anyway` (frames,
    leading variables) forces that act whatever the variables are; `torques` (frames, coordinates)
    of inverse dynamics; `values` (frames, entries of A), `right` (frames, rows) of all that has to
    be balanced, and `left`, the same without what acts anyway, filled.
    """
    C = np.zeros((L.driven.shape[0], coordinates.shape[1]))
    for frame in range(coordinates.shape[0]):
        _coupling(T, L, coordinates[frame], slopes[frame], C)
        for j in range(L.row.shape[0]):
            if L.row[j] >= 0:
                right[frame, L.row[j]] = torques[frame, j]
        for index in range(L.driven.shape[0]):
            dependent = torques[frame, L.driven[index]]
            for j in range(L.row.shape[0]):
                if L.row[j] >= 0 and C[index, j] != 0.0:
                    right[frame, L.row[j]] += C[index, j] * dependent
        for index in range(right.shape[1]):
            left[frame, index] = right[frame, index]
        for index in range(values.shape[1]):
            values[frame, index] = 0.0
        for index in range(L.variable.shape[0]):
            entry = entries[frame, L.source[index]]
            variable = L.variable[index]
            slope = 1.0
            if L.dependent[index] >= 0:
                slope = C[L.dependent[index], L.follows[index]]
            values[frame, L.target[index]] += entry * forces[frame, variable] * slope
            if variable < anyway.shape[1]:
                left[frame, L.row[L.follows[index]]] -= entry * anyway[frame, variable] * slope
