"""Paths around surfaces in the way of MuJoCo: each surface between the two points around it."""

from __future__ import annotations

from myomorph.core.muscles import path_arrays as columns
from myomorph.core.muscles import path_chain as nodes
from myomorph.core.muscles.path_chain import ArcPlace, insert_arc
from myomorph.core.muscles.path_frame import surface_at
from myomorph.core.muscles.wrap.surface import NO_WRAP
from myomorph.core.muscles.wrap.tendon import NO_SIDE, Side, wrap_tendon
from myomorph.core.rigid.kernels import bare, in_place
from myomorph.core.rigid.vectors import along, vector


@bare
def wrap_tendons(paths, muscle, frame, chain):
    """Wrap a path around its surfaces.

    Parameters
    ----------
    paths : `PathArrays`
    muscle : its number
    frame : `PathFrame`
    chain : `Chain` of the muscle's points, changed in place
    """
    start = paths.start
    table = paths.wrap
    values = chain.values
    first_point = start[muscle, columns.POINTS]
    first_wrap = start[muscle, columns.WRAPS]
    for index in range(first_wrap, start[muscle + 1, columns.WRAPS]):
        at = _node_of(chain, first_point + table[index, columns.AFTER])
        before = vector(values, at)
        after = vector(values, at + 1)
        number = table[index, columns.OBJECT]
        surface = surface_at(paths, frame, number)
        wrap = wrap_tendon(before, after, surface, _side(paths, index, frame))
        if wrap.code == NO_WRAP:
            continue
        place = ArcPlace(
            at=at,
            local=table[index, columns.OBJECT_LOCAL],
            surface=number,
            wrap=index,
            end=2 * (index - first_wrap),
        )
        insert_arc(chain, place, wrap)


@in_place
def _node_of(chain, point):
    """Node of a path point, a row of `PathArrays.point`."""
    n = 0
    while chain.numbers[n, nodes.POINT] != point:
        n += 1
    return n


@in_place
def _side(paths, index, frame):
    """Rule and position in ground, p_b + R_b x, of the side point of a wrap."""
    table = paths.wrap
    b = table[index, columns.SIDE_BODY]
    point = (0.0, 0.0, 0.0)
    rule = NO_SIDE
    if b >= 0:
        rule = table[index, columns.METHOD]
        x = vector(paths.wrap_side, index)
        R = frame.bodies.R
        point = vector(frame.bodies.p, b)
        for j in range(3):
            point = along(point, x[j], (R[b, 0, j], R[b, 1, j], R[b, 2, j]))
    return Side(rule=rule, point=point)
