"""Paths around surfaces in the way of OpenSim: surface after surface, until the length settles.

The rules are those of OpenSim's `GeometryPath` (4.6). It keeps the last wrap from frame to frame
but loses it before it is used, so frames do not depend on history.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from myomorph.core.muscles import path_arrays as columns
from myomorph.core.muscles import path_chain as nodes
from myomorph.core.muscles.path_chain import (
    ArcPlace,
    between,
    chain_length,
    insert_arc,
    is_arc,
    look_at,
    remove_arc,
    seen_at,
)
from myomorph.core.muscles.path_frame import surface_at
from myomorph.core.muscles.wrap.cylinder import wrap_cylinder
from myomorph.core.muscles.wrap.ellipsoid import wrap_ellipsoid
from myomorph.core.muscles.wrap.sphere import wrap_sphere
from myomorph.core.muscles.wrap.surface import (
    CYLINDER,
    ELLIPSOID,
    INSIDE,
    MANDATORY,
    NO_WRAP,
    SPHERE,
    WRAPPED,
    Wrap,
    into_surface,
    missed,
    out_of_surface,
)
from myomorph.core.muscles.wrap.torus import wrap_torus
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.kernels import bare, in_place, inner
from myomorph.core.rigid.vectors import vector

# OpenSim's: passes over several surfaces, and change of length that ends them [m]
MAX_PASSES = 8
TOLERANCE = 0.0005


class Passes(NamedTuple):
    """How the latest pass over a path's surfaces went.

    Attributes
    ----------
    order : (wraps,) in which surfaces are wrapped, by number among the path's
    codes : (wraps,) result of each in that order, see `Wrap.code`
    """

    order: Ints
    codes: Ints


class _Choice(NamedTuple):
    """The segment of a path that is wrapped around a surface.

    Attributes
    ----------
    at : node before the segment, -1 for none
    wrap : of the segment in the frame of the surface
    code : of the last segment that was tried
    """

    at: int
    wrap: Wrap
    code: int


@inner
def pass_room(paths):
    """Make the `Passes` of any path of `PathArrays`."""
    wraps = paths.sizes[1]
    return Passes(order=np.zeros(wraps, np.int64), codes=np.zeros(wraps, np.int64))


@bare
def wrap_surfaces(paths, muscle, frame, chain, passes):
    """Wrap a path around its surfaces.

    One surface takes one pass. Several take passes until the length changes by less than
    `TOLERANCE`. Where in the first pass the path missed the first surface and began within the
    second, they change places.

    Parameters
    ----------
    paths : `PathArrays`
    muscle : its number
    frame : `PathFrame`
    chain : `Chain` of the muscle's points, changed in place
    passes : `Passes`, scratch
    """
    start = paths.start
    order = passes.order
    codes = passes.codes
    first_wrap = start[muscle, columns.WRAPS]
    wraps = start[muscle + 1, columns.WRAPS] - first_wrap
    for i in range(wraps):
        order[i] = i
    last_pass = MAX_PASSES - 1 if wraps > 1 else 0
    length = math.inf
    for turn in range(last_pass + 1):
        complete = _wrap_each(paths, muscle, frame, chain, passes)
        if not complete or turn == last_pass:
            return
        for n in range(chain.used[0]):
            look_at(chain, n)
        before = length
        length = chain_length(chain)
        if abs(length - before) < TOLERANCE:
            return
        if turn == 0 and codes[0] == NO_WRAP and codes[1] == INSIDE:
            order[0] = 1
            order[1] = 0
            remove_arc(chain, first_wrap)


@in_place
def _wrap_each(paths, muscle, frame, chain, passes):
    """Wrap the path once around each of its surfaces, those that it had before taken off first.

    Returns
    -------
    whether all were tried: where the path has no active point in a wrap's range, OpenSim leaves it
    as it is, with what later surfaces had before
    """
    start = paths.start
    table = paths.wrap
    surfaces = paths.object
    first_wrap = start[muscle, columns.WRAPS]
    wraps = start[muscle + 1, columns.WRAPS] - first_wrap
    for i in range(wraps):
        index = first_wrap + passes.order[i]
        number = table[index, columns.OBJECT]
        passes.codes[i] = NO_WRAP
        remove_arc(chain, index)
        if surfaces[number, columns.ACTIVE] != 1:
            continue
        first_point = start[muscle, columns.POINTS]
        low = first_point + table[index, columns.FIRST]
        high = first_point + table[index, columns.LAST]
        first, last = _nodes_between(chain, low, high)
        if first < 0:
            return False
        surface = surface_at(paths, frame, number)
        choice = _best_segment(
            chain, first, last, surface, table[index, columns.METHOD], wraps == 1
        )
        passes.codes[i] = choice.code
        if choice.at < 0:
            continue
        place = ArcPlace(
            at=choice.at,
            local=table[index, columns.OBJECT_LOCAL],
            surface=number,
            wrap=index,
            end=2 * (index - first_wrap),
        )
        insert_arc(chain, place, _in_ground(surface, choice.wrap))
    return True


@in_place
def _nodes_between(chain, low, high):
    """Nodes of the first and last active points in a range of rows of `PathArrays.point`.

    Returns
    -------
    both nodes, -1 where there is none
    """
    numbers = chain.numbers
    first = -1
    last = -1
    for n in range(chain.used[0]):
        if low <= numbers[n, nodes.POINT] <= high:
            if first < 0:
                first = n
            last = n
    return first, last


@bare
def _best_segment(chain, first, last, surface, method, single):
    """Find the segment on which a surface lengthens the path least, or the first through it.

    Parameters
    ----------
    first, last : nodes between which the path may touch the surface
    surface : `Surface`
    method : of an ellipsoid
    single : whether the path has no other surface
    """
    best = missed(NO_WRAP, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    least = math.inf
    at = -1
    code = best.code
    for n in range(first, last):
        if is_arc(chain, n):
            continue
        a = into_surface(surface, vector(chain.values, n))
        b = into_surface(surface, vector(chain.values, n + 1))
        wrap = _wrap_segment(a, b, surface, method, single)
        code = wrap.code
        if code == MANDATORY:
            return _Choice(at=n, wrap=wrap, code=code)
        if code == WRAPPED:
            longer = _lengthening(chain, n, surface, wrap)
            if longer < least:
                least = longer
                at = n
                best = wrap
    return _Choice(at=at, wrap=best, code=code)


@in_place
def _wrap_segment(a, b, surface, method, single):
    """Wrap one segment in the frame of a surface, by its shape."""
    size = surface.size
    half = surface.half
    if surface.kind == CYLINDER:
        return wrap_cylinder(a, b, (size[0], size[1]), half, single)
    if surface.kind == SPHERE:
        return wrap_sphere(a, b, size[0], half)
    if surface.kind == ELLIPSOID:
        return wrap_ellipsoid(a, b, size, method, half)
    return wrap_torus(a, b, (size[0], size[1]), half, single)


@in_place
def _lengthening(chain, n, surface, wrap):
    """Compute by how much a wrap lengthens the segment after node n: |a r| + arc + |s b| - |a b|.

    The ends are where OpenSim takes them to be.
    """
    look_at(chain, n)
    look_at(chain, n + 1)
    a = into_surface(surface, seen_at(chain, n))
    b = into_surface(surface, seen_at(chain, n + 1))
    return between(a, wrap.r) + wrap.arc + between(b, wrap.s) - between(a, b)


@in_place
def _in_ground(surface, wrap):
    """Express a wrap in the frame of a surface in ground."""
    return Wrap(
        code=wrap.code,
        arc=wrap.arc,
        r=out_of_surface(surface, wrap.r),
        s=out_of_surface(surface, wrap.s),
    )
