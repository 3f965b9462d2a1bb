"""The balance of torques over frames: A x = b of all terms, on the free coordinates.

Columns of A are the generalized forces of one unit of each unknown: a muscle's moment arms times
its force per unit activation, an actuator's direction times its optimal force. What falls on a
coordinate that a coupler drives is handed on to the coordinates it follows,

    tau_free = tau + C^T tau_dependent,   C = d(dependent)/d(free).

Closed loops are taken alike: of the coordinates they tie, some follow the others
(`rigid.loops.loop_basis`), so that loads of the loop's own joint drop out. Rows of locked and
prescribed coordinates are left out, for whatever holds them there takes any load. Rows that terms
add stand behind those of the coordinates, each with an unknown of its own behind all others.
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
from myomorph.core.tension.terms.actuators import balanced_coordinates
from myomorph.core.tension.terms.term import Rows


class TorqueLinks(NamedTuple):
    """How generalized forces on all coordinates become entries on the rows of A and b.

    Attributes
    ----------
    variable : (links,) the column that a link belongs to
    source : (links,) the entry of the terms that it reads
    dependent : (links,) number, in `driven`, of the coordinate that hands it on, -1 for none
    follows : (links,) coordinate of the row it ends in
    target : (links,) entry of A it is added to
    row : (coordinates,) row of each coordinate in the order of elimination, -1 for none
    driven : (dependents,) coordinates that follow others: by a coupler, then by a loop
    """

    variable: NDArray[np.int64]
    source: NDArray[np.int64]
    dependent: NDArray[np.int64]
    follows: NDArray[np.int64]
    target: NDArray[np.int64]
    row: NDArray[np.int64]
    driven: NDArray[np.int64]


class LinkedEntries(NamedTuple):
    """TorqueLinks before the rows have their order, and the entries of A that they end in.

    Attributes
    ----------
    links : (links, 5) columns `variable` ... `target` of `TorqueLinks`
    places : (2, entries) row and column of every entry of A
    """

    links: NDArray[np.int64]
    places: NDArray[np.int64]


class BalancedRows(NamedTuple):
    """Coordinates whose equations are kept.

    Attributes
    ----------
    names : of the coordinates, one per row
    of_coordinate : (coordinates,) row of each coordinate, -1 for none
    """

    names: tuple[str, ...]
    of_coordinate: NDArray[np.int64]


@read_only
class Assembly:
    """The pattern of A, and what fills it frame by frame.

    Attributes
    ----------
    coordinates : names of those that are free and follow no other, one per row
    links : from entries to A; entries are those of the terms, one term after the other
    pattern : of A
    extra_place : (extra entries,) where in A the entries of the rows that terms add lie, then one
        for the unknown of each such row
    extra_row : (extra rows,) the rows of b that they are
    """

    tree: Tree
    coordinates: tuple[str, ...]
    links: TorqueLinks
    pattern: Pattern
    extra_place: NDArray[np.int64]
    extra_row: NDArray[np.int64]

    @property
    def coordinate_row(self) -> NDArray[np.int64]:
        """(coordinates,) place of each of `coordinates` in the order of elimination."""
        names = self.tree.model.coordinate_names
        return self.links.row[[names.index(row) for row in self.coordinates]]


def assemble(  # page: each says another thing of the pattern
    tree: Tree,
    entries: Sequence[tuple[int, int]],
    unknowns: int,
    *,
    extra: Sequence[Rows] = (),
    basis: LoopBasis | None = None,
    only: Collection[str] | None = None,
) -> Assembly:
    """Pattern of A from those of the terms.

    Parameters
    ----------
    tree : of the model
    entries : (unknown, coordinate) of every generalized force of unknowns, a coordinate of -1 for
        one that is not used
    unknowns : number of unknowns that the terms bring in
    extra : rows that terms add
    basis : which coordinates follow which, of a model that closes loops
    only : coordinates whose equations are kept, where not all are

    Raises
    ------
    BadModel : no coordinate is free
    """
    by_loops = np.zeros(0, np.int64) if basis is None else basis.dependent
    rows = _balanced_rows(tree.model, by_loops, only)
    reach = _reach(tree, basis)
    ends = [(unknown, reach[j] if j >= 0 else []) for unknown, j in entries]
    linked = _linked(ends, rows.of_coordinate)

    added = sum(len(part) for part in extra)
    extra_places = _extra_places(extra, len(rows.names), unknowns)
    row, column = np.hstack([linked.places, extra_places]).astype(np.int64)
    shape = pattern(row, column, (len(rows.names) + added, unknowns + added))

    rank = np.argsort(shape.order)
    links = linked.links.copy()
    links[:, 4] = shape.place[links[:, 4]]
    variable, source, dependent, follows, target = np.ascontiguousarray(links.T)
    return Assembly(
        tree=tree,
        coordinates=rows.names,
        links=TorqueLinks(
            variable=variable,
            source=source,
            dependent=dependent,
            follows=follows,
            target=target,
            row=np.where(rows.of_coordinate >= 0, rank[rows.of_coordinate], -1),
            driven=np.concatenate([tree.arrays.coupler_coordinate, by_loops]),
        ),
        pattern=shape,
        extra_place=shape.place[linked.places.shape[1] :],
        extra_row=rank[len(rows.names) :],
    )


def _balanced_rows(
    model: Model, by_loops: NDArray[np.int64], only: Collection[str] | None
) -> BalancedRows:
    """Choose the coordinates whose equations are kept.

    Parameters
    ----------
    by_loops : (dependents,) coordinates that follow others because of closed loops
    only : coordinates whose equations are kept, where not all are

    Raises
    ------
    BadModel : no coordinate is free
    """
    names = model.coordinate_names
    rows = tuple(
        coordinate
        for coordinate in balanced_coordinates(model)
        if names.index(coordinate) not in by_loops and (only is None or coordinate in only)
    )
    if not rows:
        raise BadModel(
            f"model '{model.name}' has no free coordinate: all are locked, prescribed or driven"
        )
    row_of = np.full(len(names), -1, np.int64)
    row_of[[names.index(row) for row in rows]] = np.arange(len(rows))
    return BalancedRows(rows, row_of)


def _linked(
    sources: list[tuple[int, list[tuple[int, int]]]], row_of: NDArray[np.int64]
) -> LinkedEntries:
    """TorqueLinks from the entries of the terms to entries of A.

    Parameters
    ----------
    sources : of each entry of the terms, its unknown and the ends of `_reach` of its coordinate
    row_of : (coordinates,) row of each coordinate, -1 for none
    """
    places: dict[tuple[int, int], int] = {}
    links = []
    for source, (variable, ends) in enumerate(sources):
        for dependent, coordinate in ends:
            if row_of[coordinate] >= 0:
                place = (int(row_of[coordinate]), variable)
                target = places.setdefault(place, len(places))
                links.append((variable, source, dependent, coordinate, target))
    return LinkedEntries(
        links=np.array(links, np.int64).reshape(-1, 5),
        places=np.array(list(places), np.int64).reshape(-1, 2).T,
    )


def _extra_places(extra: Sequence[Rows], balanced: int, unknowns: int) -> NDArray[np.int64]:
    """Entries of the rows that terms add, behind the others, then those of their own unknowns.

    Parameters
    ----------
    extra : rows that terms add
    balanced : number of rows of coordinates
    unknowns : number of unknowns that the terms bring in

    Returns
    -------
    (2, entries) row and column in A
    """
    counts = [len(rows) for rows in extra]
    first = balanced + np.cumsum([0, *counts])
    entries = [
        np.array([start + rows.row, rows.column])
        for start, rows in zip(first[:-1], extra, strict=True)
    ]
    added = np.arange(sum(counts))
    return np.hstack([*entries, [balanced + added, unknowns + added]]).astype(np.int64)


def _reach(tree: Tree, basis: LoopBasis | None) -> list[list[tuple[int, int]]]:
    """Coordinates that the torque of each coordinate is handed on to.

    Returns
    -------
    of each coordinate, pairs of a number in `TorqueLinks.driven`, or -1, and the coordinate that it
    follows
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
def _coupling(T, links, c, slopes, C):
    """Slopes of the coordinates that follow others, over those they end in.

    Parameters
    ----------
    T, links : arrays of the tree, `TorqueLinks`
    c : (coordinates,) values
    slopes : (dependents of loops, coordinates)
    C : (dependents, coordinates) filled
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
            earlier = _number_of(links.driven, source)
            if earlier < 0:
                C[index, source] += slope
            else:
                for m in range(C.shape[1]):
                    C[index, m] += slope * C[earlier, m]


@inner
def _number_of(driven, coordinate):
    """Find the last place of a coordinate in `driven`, -1 where it follows no other."""
    number = -1
    for index in range(driven.shape[0]):
        if driven[index] == coordinate:
            number = index
    return number


@inner
def _put_required(links, C, torques, required):
    """Fill the torques that all forces together have to balance: tau + C^T tau_dependent.

    Parameters
    ----------
    links : `TorqueLinks`
    C : (dependents, coordinates) of `_coupling`
    torques : (coordinates,) [N m or N]
    required : (rows,) filled [N m or N]
    """
    for j in range(links.row.shape[0]):
        if links.row[j] >= 0:
            required[links.row[j]] = torques[j]
    for number in range(links.driven.shape[0]):
        dependent = torques[links.driven[number]]
        for j in range(links.row.shape[0]):
            if links.row[j] >= 0 and C[number, j] != 0.0:
                required[links.row[j]] += C[number, j] * dependent


@kernel
def fold(  # page: arrays over frames, of A and b and what they are made from
    T, links, coordinates, slopes, entries, forces, anyway, torques, values, required, b
):
    """Fill A and b of every frame.

        A[r, i] = sum over links of C entry force_i
        b = tau + C^T tau_dependent - what acts anyway

    Parameters
    ----------
    T, links : arrays of the tree, `TorqueLinks`
    coordinates : (frames, coordinates) values of all
    slopes : (frames, dependents of loops, coordinates)
    entries : (frames, entries) generalized forces of unit forces
    forces : (frames, variables) force of a unit of each variable
    anyway : (frames, leading variables) forces that act whatever the variables are
    torques : (frames, coordinates) of inverse dynamics, less those of springs of joints [N m or N]
    values : (frames, entries of A) filled
    required : (frames, rows) filled with the torques that all forces together have to balance
    b : (frames, rows) filled with the same less what acts anyway: the right side of A x = b
    """
    C = np.zeros((links.driven.shape[0], coordinates.shape[1]))
    for frame in range(coordinates.shape[0]):
        _coupling(T, links, coordinates[frame], slopes[frame], C)
        _put_required(links, C, torques[frame], required[frame])
        for index in range(required.shape[1]):
            b[frame, index] = required[frame, index]
        for index in range(values.shape[1]):
            values[frame, index] = 0.0
        for index in range(links.variable.shape[0]):
            entry = entries[frame, links.source[index]]
            variable = links.variable[index]
            slope = 1.0
            if links.dependent[index] >= 0:
                slope = C[links.dependent[index], links.follows[index]]
            values[frame, links.target[index]] += entry * forces[frame, variable] * slope
            if variable < anyway.shape[1]:
                b[frame, links.row[links.follows[index]]] -= entry * anyway[frame, variable] * slope
