"""A muscle's path as a chain of nodes, from origin to insertion.

The chain has a node for each active point, and two more for each surface that the path touches:
where it meets the surface and where it leaves it. Between nodes the path is straight, between the
two of a surface it is an arc.

A quirk of OpenSim 4.6 is kept, since it changes lengths by millimeters where a path has two
surfaces or more: within a frame, the place in ground of a point on a surface is that of the pass in
which it was first asked for, though later passes move it (`look_at`). Lengths and directions use
the place first seen, the force acts at the last one. OpenSim's lengthening speed then has a part
that is no rate of length (it is not zero when the whole body turns); ours is -sum r qdot.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.kernels import bare, in_place, inner
from myomorph.core.rigid.vectors import minus, norm, put_vector, vector

# Columns of `Chain.values`, after the position: share in the length of what follows the node;
# length on the surface up to a node that leaves it [m]; position at which OpenSim takes the node to
# be in ground [m]
WEIGHT = 3
ARC = 4
SEEN = 5
VALUES = 8  # How many they are
# Columns of `Chain.numbers`, -1 for none: of the body, among the muscle's; of the surface; rows of
# `PathArrays.point`, of `PathArrays.wrap` and of `Chain.first_seen`
LOCAL = 0
SURFACE = 1
POINT = 2
WRAP = 3
END = 4
NUMBERS = 5


class Chain(NamedTuple):
    """Nodes of one path in one frame, in order, of which the first `used` rows count.

    Attributes
    ----------
    values : (nodes, VALUES) position in ground [m], then the columns WEIGHT, ARC, SEEN ...
    numbers : (nodes, NUMBERS) columns LOCAL ... END
    first_seen : (2 wraps, 4) positions first seen of the points on surfaces [m], and 1 once they
        are
    used : (1,) number of nodes
    """

    values: Array
    numbers: Ints
    first_seen: Array
    used: Ints


class ArcPlace(NamedTuple):
    """Where in a chain an arc belongs.

    Attributes
    ----------
    at : node before it
    local : its body among the muscle's
    surface : number of the surface
    wrap : row of `PathArrays.wrap`
    end : row of `Chain.first_seen` of its first node; the second has the next
    """

    at: int
    local: int
    surface: int
    wrap: int
    end: int


@inner
def chain_room(paths):
    """Make a chain for any path of `PathArrays`."""
    nodes = paths.sizes[0] + 2
    wraps = paths.sizes[1]
    return Chain(
        values=np.zeros((nodes, VALUES)),
        numbers=np.zeros((nodes, NUMBERS), np.int64),
        first_seen=np.zeros((2 * wraps, 4)),
        used=np.zeros(1, np.int64),
    )


@in_place
def add_point(chain, index, position, weight, local):
    """Add a path point after the chain's last node.

    Parameters
    ----------
    chain : `Chain`, changed in place
    index : row of `PathArrays.point`
    position : in ground [m]
    weight : share in the length of what follows
    local : number of its body among the muscle's
    """
    values = chain.values
    numbers = chain.numbers
    used = chain.used
    n = used[0]
    put_vector(values, n, position)
    for i in range(3):
        values[n, SEEN + i] = position[i]
    values[n, WEIGHT] = weight
    values[n, ARC] = 0.0
    numbers[n, LOCAL] = local
    numbers[n, SURFACE] = -1
    numbers[n, POINT] = index
    numbers[n, WRAP] = -1
    numbers[n, END] = -1
    used[0] = n + 1


@bare
def insert_arc(chain, place, wrap):
    """Put both ends of an arc into the chain.

    Parameters
    ----------
    chain : `Chain`, changed in place
    place : `ArcPlace`
    wrap : `Wrap` in ground
    """
    values = chain.values
    numbers = chain.numbers
    first_seen = chain.first_seen
    at = place.at
    _move_nodes(chain, at + 1, 2)
    put_vector(values, at + 1, wrap.r)
    put_vector(values, at + 2, wrap.s)
    for n in range(at + 1, at + 3):
        end = place.end + n - at - 1
        values[n, WEIGHT] = values[at, WEIGHT]
        numbers[n, LOCAL] = place.local
        numbers[n, SURFACE] = place.surface
        numbers[n, POINT] = -1
        numbers[n, WRAP] = place.wrap
        numbers[n, END] = end
        was_seen = first_seen[end, 3] == 1.0
        for i in range(3):
            values[n, SEEN + i] = first_seen[end, i] if was_seen else values[n, i]
    values[at + 1, ARC] = 0.0
    values[at + 2, ARC] = wrap.arc


@bare
def remove_arc(chain, wrap):
    """Take the nodes of a wrap, a row of `PathArrays.wrap`, out of the chain."""
    for n in range(chain.used[0] - 1):
        if chain.numbers[n, WRAP] == wrap:
            _move_nodes(chain, n + 2, -2)
            return


@bare
def _move_nodes(chain, first, shift):
    """Move the nodes from `first` on by a number of places, which makes or closes a gap."""
    values = chain.values
    numbers = chain.numbers
    used = chain.used
    count = used[0]
    for k in range(first, count):
        # Those that move on begin with the last node.
        n = k if shift < 0 else count - 1 - (k - first)
        for i in range(VALUES):
            values[n + shift, i] = values[n, i]
        for i in range(NUMBERS):
            numbers[n + shift, i] = numbers[n, i]
    used[0] = count + shift


@in_place
def forget_seen(chain, wraps):
    """Forget where the points on a number of surfaces were seen: a path begins."""
    for end in range(2 * wraps):
        chain.first_seen[end, 3] = 0.0


@bare
def look_at(chain, n):
    """Ask for node n's position: for the rest of the frame OpenSim takes it to stay there."""
    end = chain.numbers[n, END]
    first_seen = chain.first_seen
    if end >= 0 and first_seen[end, 3] == 0.0:
        put_vector(first_seen, end, vector(chain.values, n))
        first_seen[end, 3] = 1.0


@bare
def seen_at(chain, n):
    """Position at which OpenSim takes node n to be in ground [m]."""
    values = chain.values
    return values[n, SEEN], values[n, SEEN + 1], values[n, SEEN + 2]


@bare
def is_arc(chain, n):
    """Return whether the path runs on a surface from node n to the next."""
    numbers = chain.numbers
    return numbers[n, SURFACE] >= 0 and numbers[n, SURFACE] == numbers[n + 1, SURFACE]


@bare
def between(p, q):
    """Distance of two points [m]."""
    return norm(minus(q, p))


@bare
def chain_length(chain):
    """Length of the path [m]: the sum of its straight parts and arcs, each times its weight."""
    values = chain.values
    total = 0.0
    for n in range(chain.used[0] - 1):
        if is_arc(chain, n):
            part = values[n + 1, ARC]
        else:
            part = between(seen_at(chain, n), seen_at(chain, n + 1))
        total += values[n, WEIGHT] * part
    return total


@in_place
def put_nodes(chain, table):
    """Fill `table` (nodes, 4) with positions of a path's nodes and arcs that end there [m]."""
    values = chain.values
    for n in range(chain.used[0]):
        put_vector(table, n, vector(values, n))
        table[n, 3] = values[n, ARC] if n > 0 and is_arc(chain, n - 1) else 0.0
