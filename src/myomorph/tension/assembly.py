"""The balance of torques over frames: A x = b for muscles and actuators, on the free coordinates.

Columns of A are the generalized forces of one unit of each variable: a muscle's moment arms times
its force per unit activation, an actuator's direction times its optimal force. What falls on a
coordinate that a coupler drives is handed on to the coordinates it follows: tau_free = tau + C^T
tau_dependent with C = d(dependent)/d(free). Rows of locked and prescribed coordinates are left out,
for whatever holds them there takes any load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from myomorph.model.errors import BadModel
from myomorph.model.model import Actuator, index_of
from myomorph.model.spatial import Array
from myomorph.rigid.coordinates import evaluate
from myomorph.rigid.tree import Tree
from myomorph.tension.actuators import BodyActuators, body_directions, compile_body_actuators, free_coordinates
from myomorph.tension.dual import Pattern, pattern


class Folding(NamedTuple):
    """How entries on all coordinates become entries on the rows of A.

    Attributes
    ----------
    variable : (links,) the column that a link belongs to
    source : (links,) entry it reads
    coupler : (links,) number of the coupler it passes, -1 for none
    follows : (links,) coordinate of the row it ends in
    target : (links,) entry of A it is added to
    """

    variable: NDArray[np.int64]
    source: NDArray[np.int64]
    coupler: NDArray[np.int64]
    follows: NDArray[np.int64]
    target: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Assembly:
    """What `fold` needs, and the pattern of A.

    Attributes
    ----------
    rows : names of the free coordinates, one per row
    row_of : (coordinates,) row of each coordinate, -1 for none
    links : of the muscles' and the actuators' entries, in this order of entries: muscles, actuators
        on bodies, actuators on coordinates
    on_bodies, on_coordinates : numbers of the actuators of either kind
    """

    tree: Tree
    rows: tuple[str, ...]
    row_of: NDArray[np.int64]
    links: Folding
    pattern: Pattern
    bodies: BodyActuators
    on_bodies: NDArray[np.int64]
    on_coordinates: NDArray[np.int64]
    muscle_entries: int
    entries: int
    optimal_forces: Array


def assemble(
    tree: Tree, start: NDArray[np.int64], coordinate: NDArray[np.int64], actuators: Sequence[Actuator]
) -> Assembly:
    """The pattern of A from that of the moment arms.

    Parameters
    ----------
    start, coordinate : (muscles + 1,), (entries,) the coordinates that each muscle may have a moment
        arm about are coordinate[start[m]:start[m + 1]]
    actuators : whose controls follow the activations among the variables

    Raises
    ------
    UnknownName
        where an actuator names a coordinate or body that the model does not have
    BadModel
        where no coordinate is free
    """
    model = tree.model
    rows = free_coordinates(model)
    if not rows:
        raise BadModel(f"model '{model.name}' has no free coordinate: all are locked, prescribed or driven")
    names = model.coordinate_names
    row_of = np.full(len(names), -1, np.int64)
    row_of[[names.index(one) for one in rows]] = np.arange(len(rows))
    on_bodies = [i for i, one in enumerate(actuators) if one.kind != "coordinate"]
    on_coordinates = [i for i, one in enumerate(actuators) if one.kind == "coordinate"]
    bodies = compile_body_actuators(tree, [actuators[i] for i in on_bodies])
    muscles = len(start) - 1
    sources = [(m, int(coordinate[e])) for m in range(muscles) for e in range(start[m], start[m + 1])]
    for k, i in enumerate(on_bodies):
        sources += [(muscles + i, int(bodies.coordinate[e])) for e in range(bodies.start[k], bodies.start[k + 1])]
    for i in on_coordinates:
        sources.append((muscles + i, index_of("coordinate", actuators[i].coordinate, names)))
    reach = _reach(tree)
    places: dict[tuple[int, int], int] = {}
    links = []
    for source, (variable, j) in enumerate(sources):
        for coupler, k in reach[j]:
            if row_of[k] >= 0:
                target = places.setdefault((int(row_of[k]), variable), len(places))
                links.append((variable, source, coupler, k, target))
    table = np.array(links, np.int64).reshape(-1, 5)
    place_rows, place_columns = np.array(list(places), np.int64).reshape(-1, 2).T
    shape = pattern(place_rows, place_columns, (len(rows), muscles + len(actuators)))
    table[:, 4] = shape.place[table[:, 4]]
    return Assembly(
        tree=tree,
        rows=rows,
        row_of=row_of,
        links=Folding(*(np.ascontiguousarray(column) for column in table.T)),
        pattern=shape,
        bodies=bodies,
        on_bodies=np.array(on_bodies, np.int64),
        on_coordinates=np.array(on_coordinates, np.int64),
        muscle_entries=int(start[-1]),
        entries=len(sources),
        optimal_forces=np.array([one.optimal_force for one in actuators], dtype=np.float64),
    )


def _reach(tree: Tree) -> list[list[tuple[int, int]]]:
    """(coupler or -1, coordinate followed) pairs that each coordinate's torque is handed on along."""
    arrays = tree.arrays
    follows: dict[int, set[int]] = {}
    reach: list[list[tuple[int, int]]] = [[(-1, j)] for j in range(len(tree.model.coordinates))]
    for k, j in enumerate(arrays.coupler_coordinate):
        ends: set[int] = set()
        for i in arrays.coupler_source[k]:
            if i >= 0:
                ends |= follows.get(int(i), {int(i)})
        follows[int(j)] = ends
        reach[int(j)] = [(k, i) for i in sorted(ends)]
    return reach


@njit(cache=True, nogil=True, error_model="numpy")
def _coupling(T, c, C):
    """C (couplers, coordinates): derivatives of each dependent coordinate in those it ends in."""
    for k in range(T.coupler_coordinate.shape[0]):
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
            for h in range(k):
                if T.coupler_coordinate[h] == source:
                    earlier = h
            if earlier < 0:
                C[k, source] += slope
            else:
                for m in range(C.shape[1]):
                    C[k, m] += slope * C[earlier, m]


@njit(cache=True, nogil=True, error_model="numpy")
def fold(T, links, row_of, rank, coordinates, entries, forces, passive, start, coordinate, torques, values, right):
    """Fill A and b of every frame.

    Parameters
    ----------
    coordinates : (frames, coordinates) all values
    entries : (frames, entries) generalized forces of unit forces
    forces : (frames, variables) force of a unit of each variable
    passive : (frames, muscles) passive forces, taken off the torques
    start, coordinate : of the muscles' entries
    torques : (frames, coordinates) of inverse dynamics
    rank : (rows,) place of each row in the order of elimination
    values, right : (frames, entries of A), (frames, rows) filled
    """
    couplers = T.coupler_coordinate.shape[0]
    C = np.zeros((couplers, coordinates.shape[1]))
    tau = np.empty(coordinates.shape[1])
    for frame in range(coordinates.shape[0]):
        _coupling(T, coordinates[frame], C)
        for k in range(values.shape[1]):
            values[frame, k] = 0.0
        for k in range(links.variable.shape[0]):
            share = entries[frame, links.source[k]] * forces[frame, links.variable[k]]
            if links.coupler[k] >= 0:
                share *= C[links.coupler[k], links.follows[k]]
            values[frame, links.target[k]] += share
        for j in range(tau.shape[0]):
            tau[j] = torques[frame, j]
        for m in range(passive.shape[1]):
            pull = passive[frame, m]
            if pull != 0.0:
                for e in range(start[m], start[m + 1]):
                    tau[coordinate[e]] -= entries[frame, e] * pull
        for k in range(couplers):
            dependent = tau[T.coupler_coordinate[k]]
            for j in range(tau.shape[0]):
                if C[k, j] != 0.0:
                    tau[j] += C[k, j] * dependent
        for j in range(tau.shape[0]):
            if row_of[j] >= 0:
                right[frame, rank[row_of[j]]] = tau[j]


def actuator_entries(assembly: Assembly, coordinates: Array, entries: Array) -> None:
    """Fill the actuators' entries (frames, entries) behind the muscles'."""
    first = assembly.muscle_entries
    count = len(assembly.bodies.coordinate)
    if count:
        filled = np.empty((len(entries), count))
        body_directions(assembly.tree.arrays, assembly.bodies, coordinates, filled)
        entries[:, first : first + count] = filled
    entries[:, first + count :] = 1.0
