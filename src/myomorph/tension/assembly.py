"""The balance of torques over frames: A x = b for muscles and actuators, on the free coordinates.

Columns of A are the generalized forces of one unit of each variable: a muscle's moment arms times
its force per unit activation, an actuator's direction times its optimal force. What falls on a
coordinate that a coupler drives is handed on to the coordinates it follows: tau_free = tau + C^T
tau_dependent with C = d(dependent)/d(free). Closed loops are taken alike: of the coordinates they tie, some
follow the others (`rigid.loops.loop_basis`), so that loads of the loop's own joint drop out. Rows of locked and
prescribed coordinates are left out, for whatever holds them there takes any load.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array
from myomorph.model.errors import BadModel
from myomorph.model.model import Actuator, Model, index_of
from myomorph.muscles.path import Paths
from myomorph.rigid.coordinates import evaluate
from myomorph.rigid.kernels import inner, kernel
from myomorph.rigid.loops import LoopBasis
from myomorph.rigid.tree import Tree
from myomorph.tension.actuators import BodyActuators, body_directions, compile_body_actuators, free_coordinates
from myomorph.tension.contact_columns import ContactColumns
from myomorph.tension.contact_rows import ContactTerms
from myomorph.tension.separable import Pattern, pattern


class Links(NamedTuple):
    """How generalized forces on all coordinates become entries on the rows of A and b.

    Attributes
    ----------
    variable : (links,) the column that a link belongs to
    source : (links,) entry it reads
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


@dataclass(frozen=True, eq=False)
class Assembly:
    """The pattern of A, and what fills it frame by frame.

    Attributes
    ----------
    rows : names of the coordinates that are free and follow no other, one per row
    links : from entries to A; entries are moment arms, then those of actuators on bodies, then one for
        each actuator on a coordinate, then those of the edges of contacts
    bodies : the actuators on bodies
    coordinate_actuators : how many act on a coordinate
    optimal_forces : (actuators,) [N or N m]
    extra_place : (extra entries,) where in A the entries of the rows behind those of the coordinates lie, first those
        of contacts' edges, then one for each row's own variable
    extra_row : (extra rows,) the rows of b that they are
    """

    tree: Tree
    rows: tuple[str, ...]
    links: Links
    pattern: Pattern
    bodies: BodyActuators
    coordinate_actuators: int
    optimal_forces: Array
    extra_place: NDArray[np.int64]
    extra_row: NDArray[np.int64]

    @property
    def coordinate_row(self) -> NDArray[np.int64]:
        """(rows,) place of every coordinate of `rows` in the order of elimination."""
        names = self.tree.model.coordinate_names
        return self.links.row[[names.index(one) for one in self.rows]]


def assemble(
    paths: Paths,
    actuators: Sequence[Actuator],
    basis: LoopBasis | None = None,
    contacts: ContactTerms | None = None,
    only: Collection[str] | None = None,
) -> Assembly:
    """The pattern of A from that of the moment arms.

    Parameters
    ----------
    actuators : whose controls follow the activations among the variables
    basis : which coordinates follow which, of a model that closes loops
    contacts : whose amplitudes follow the controls, and whose rows' own variables those
    only : the coordinates whose equations are kept, where not all are

    Raises
    ------
    UnknownName
        where an actuator names a coordinate or body that the model does not have
    BadModel
        where no coordinate is free
    """
    tree = paths.tree
    model = tree.model
    by_loops = np.zeros(0, np.int64) if basis is None else basis.dependent
    rows, row_of = _rows(model, by_loops, only)
    on_bodies = [one for one in actuators if one.kind != "coordinate"]
    bodies = compile_body_actuators(tree, on_bodies)
    reach = _reach(tree, basis)
    # Moment arms about a coordinate already hold what reaches the muscle through couplers.
    sources = [
        (int(m), int(j), reach[j] if free else [])
        for m, j, free in zip(paths.arm_muscle, paths.arm_coordinate, paths.arm_free, strict=True)
    ]
    touched = _touched_by_actuators(model, actuators, bodies)
    variables, extra_rows, extra = len(model.muscles) + len(actuators), 0, np.zeros((2, 0), np.int64)
    if contacts is not None:
        touched += _touched_by_edges(contacts.columns, variables)
        extra = _extra_entries(contacts, len(rows), variables)
        extra_rows = len(contacts.extra)
        variables += len(contacts.columns) + extra_rows
    sources += [(variable, j, reach[j]) for variable, j in touched]
    table, places = _linked(sources, row_of)
    row, column = np.hstack([places, extra])
    shape = pattern(row, column, (len(rows) + extra_rows, variables))
    table[:, 4] = shape.place[table[:, 4]]
    rank = np.argsort(shape.order)
    driven = np.concatenate([tree.arrays.coupler_coordinate, by_loops])
    columns = np.ascontiguousarray(table.T)
    return Assembly(
        tree=tree,
        rows=rows,
        links=Links(
            columns[0], columns[1], columns[2], columns[3], columns[4], np.where(row_of >= 0, rank[row_of], -1), driven
        ),
        pattern=shape,
        bodies=bodies,
        coordinate_actuators=len(actuators) - len(on_bodies),
        optimal_forces=np.array([one.optimal_force for one in actuators], dtype=np.float64),
        extra_place=shape.place[places.shape[1] :],
        extra_row=rank[len(rows) :],
    )


def _rows(
    model: Model, by_loops: NDArray[np.int64], only: Collection[str] | None
) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Names of the coordinates whose equations are kept, and the row (coordinates,) of each, -1 for none."""
    names = model.coordinate_names
    rows = tuple(
        one for one in free_coordinates(model) if names.index(one) not in by_loops and (only is None or one in only)
    )
    if not rows:
        raise BadModel(f"model '{model.name}' has no free coordinate: all are locked, prescribed or driven")
    row_of = np.full(len(names), -1, np.int64)
    row_of[[names.index(one) for one in rows]] = np.arange(len(rows))
    return rows, row_of


def _touched_by_actuators(model: Model, actuators: Sequence[Actuator], bodies: BodyActuators) -> list[tuple[int, int]]:
    """(variable, coordinate) of what actuators act on, first those on bodies."""
    first, names = len(model.muscles), model.coordinate_names
    on_bodies = [i for i, one in enumerate(actuators) if one.kind != "coordinate"]
    touched = [
        (first + i, int(j))
        for k, i in enumerate(on_bodies)
        for j in bodies.coordinate[bodies.start[k] : bodies.start[k + 1]]
    ]
    touched += [
        (first + i, index_of("coordinate", one.coordinate, names))
        for i, one in enumerate(actuators)
        if one.kind == "coordinate"
    ]
    return touched


def _touched_by_edges(edges: ContactColumns, first: int) -> list[tuple[int, int]]:
    """(variable, coordinate) of what the edges of contacts act on, the first of which is variable `first`."""
    numbers = np.repeat(np.arange(len(edges)), np.diff(edges.arrays.first))
    return [(first + int(g), int(j)) for g, j in zip(numbers, edges.arrays.coordinate, strict=True)]


def _extra_entries(contacts: ContactTerms, first_row: int, first_edge: int) -> NDArray[np.int64]:
    """Row and column (2, entries) of the rows that contacts add: their edges, then each row's own variable."""
    own = np.arange(len(contacts.extra))
    return np.hstack(
        [
            [first_row + contacts.extra.row, first_edge + contacts.extra.edge],
            [first_row + own, first_edge + len(contacts.columns) + own],
        ]
    )


def _linked(
    sources: list[tuple[int, int, list[tuple[int, int]]]], row_of: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Columns variable ... target of `Links` (links, 5), and row and column (2, entries) of every entry of A."""
    places: dict[tuple[int, int], int] = {}
    links = []
    for source, (variable, _, ends) in enumerate(sources):
        for dependent, k in ends:
            if row_of[k] >= 0:
                target = places.setdefault((int(row_of[k]), variable), len(places))
                links.append((variable, source, dependent, k, target))
    return np.array(links, np.int64).reshape(-1, 5), np.array(list(places), np.int64).reshape(-1, 2).T


def _reach(tree: Tree, basis: LoopBasis | None) -> list[list[tuple[int, int]]]:
    """(number of the dependent or -1, coordinate followed) pairs that each coordinate's torque is handed on along."""
    arrays = tree.arrays
    follows: dict[int, set[int]] = {}
    reach: list[list[tuple[int, int]]] = [[(-1, j)] for j in range(len(tree.model.coordinates))]
    if basis is not None:
        touched = np.nanmax(np.abs(basis.slopes), axis=0, initial=0.0) > 0.0
        for d, j in enumerate(basis.dependent):
            ends = {int(i) for i in basis.independent[touched[d]]}
            follows[int(j)] = ends
            reach[int(j)] = [(len(arrays.coupler_coordinate) + d, i) for i in sorted(ends)]
    for k, j in enumerate(arrays.coupler_coordinate):
        ends = set()
        for i in arrays.coupler_source[k]:
            if i >= 0:
                ends |= follows.get(int(i), {int(i)})
        follows[int(j)] = ends
        reach[int(j)] = [(k, i) for i in sorted(ends)]
    return reach


@inner
def _coupling(T, L, c, slopes, C):
    """C (dependents, coordinates): derivatives of each of `L.driven` in those it ends in.

    c (coordinates,); slopes (dependents of loops, coordinates).
    """
    couplers = T.coupler_coordinate.shape[0]
    for d in range(slopes.shape[0]):
        for m in range(C.shape[1]):
            C[couplers + d, m] = slopes[d, m]
    for k in range(couplers):
        i, j = T.coupler_source[k, 0], T.coupler_source[k, 1]
        x1 = c[i] if i >= 0 else 0.0
        x2 = c[j] if j >= 0 else 0.0
        _, d1, d2, _, _, _ = evaluate(T.functions, T.coupler_function[k], x1, x2)
        for m in range(C.shape[1]):
            C[k, m] = 0.0
        for s in range(2):
            source, slope = (i, d1) if s == 0 else (j, d2)
            if source < 0:
                continue
            earlier = -1
            for h in range(L.driven.shape[0]):
                if L.driven[h] == source:
                    earlier = h
            if earlier < 0:
                C[k, source] += slope
            else:
                for m in range(C.shape[1]):
                    C[k, m] += slope * C[earlier, m]


@kernel
def fold(T, L, coordinates, slopes, entries, forces, torques, values, right):
    """Fill A and b of every frame.

    Parameters
    ----------
    T, L : arrays of the tree, `Links`
    coordinates : (frames, coordinates) all values
    slopes : (frames, dependents of loops, coordinates)
    entries : (frames, entries) generalized forces of unit forces
    forces : (frames, variables) force of a unit of each variable
    torques : (frames, coordinates) of inverse dynamics
    values, right : (frames, entries of A), (frames, rows) filled
    """
    C = np.zeros((L.driven.shape[0], coordinates.shape[1]))
    for frame in range(coordinates.shape[0]):
        _coupling(T, L, coordinates[frame], slopes[frame], C)
        for k in range(values.shape[1]):
            values[frame, k] = 0.0
        for k in range(L.variable.shape[0]):
            share = entries[frame, L.source[k]] * forces[frame, L.variable[k]]
            if L.dependent[k] >= 0:
                share *= C[L.dependent[k], L.follows[k]]
            values[frame, L.target[k]] += share
        for j in range(L.row.shape[0]):
            if L.row[j] >= 0:
                right[frame, L.row[j]] = torques[frame, j]
        for k in range(L.driven.shape[0]):
            dependent = torques[frame, L.driven[k]]
            for j in range(L.row.shape[0]):
                if L.row[j] >= 0 and C[k, j] != 0.0:
                    right[frame, L.row[j]] += C[k, j] * dependent


@kernel
def take_off(T, L, coordinates, slopes, entries, passive, right):
    """Take the torques of passive forces (frames, muscles) off right (frames, rows)."""
    C = np.zeros((L.driven.shape[0], coordinates.shape[1]))
    for frame in range(right.shape[0]):
        _coupling(T, L, coordinates[frame], slopes[frame], C)
        for k in range(L.variable.shape[0]):
            if L.variable[k] < passive.shape[1]:
                share = entries[frame, L.source[k]] * passive[frame, L.variable[k]]
                if L.dependent[k] >= 0:
                    share *= C[L.dependent[k], L.follows[k]]
                right[frame, L.row[L.follows[k]]] -= share


def actuator_entries(assembly: Assembly, coordinates: Array) -> Array:
    """Generalized forces of the actuators' unit forces, (frames, entries behind the moment arms)."""
    filled = np.empty((len(coordinates), len(assembly.bodies.coordinate)))
    if filled.shape[1]:
        body_directions(assembly.tree.arrays, assembly.bodies, coordinates, filled)
    return np.hstack([filled, np.ones((len(coordinates), assembly.coordinate_actuators))])
