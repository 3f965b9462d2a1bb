"""What all rules of wrapping share: a surface, the part that a path may touch, and the result.

Points of a segment are `a` and `b`, in the order of the path. The path meets the surface at `r` and
leaves it at `s`; both points touch where a straight line from `a`, or from `b`, is tangent.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from myomorph.core.rigid.kernels import bare, in_place
from myomorph.core.rigid.vectors import dot, minus, plus, sign, turned, turned_back

# Shapes, in the order of `path_arrays.KINDS`
CYLINDER = 0
SPHERE = 1
ELLIPSOID = 2
TORUS = 3
# OpenSim's results of a wrap: none; a point lies within the surface; wrapped; the segment runs
# through the surface
NO_WRAP = 0
INSIDE = 1
WRAPPED = 2
MANDATORY = 3

Vector = tuple[float, float, float]


class Half(NamedTuple):
    """Half of a surface that a path may touch: where sign(component `axis`) is `side`.

    Attributes
    ----------
    axis : 0, 1 or 2 in the frame of the surface
    side : 1 or -1; 0 for the whole surface
    """

    axis: int
    side: int


class Surface(NamedTuple):
    """A surface in one frame of time.

    Attributes
    ----------
    kind : `CYLINDER`, `SPHERE`, `ELLIPSOID` or `TORUS`
    size : see `WrapObject.size` [m]
    half : that a path may touch
    rotation : from its axes to ground, row by row
    center : in ground [m]
    """

    kind: int
    size: Vector
    half: Half
    rotation: tuple[float, ...]
    center: Vector


class Wrap(NamedTuple):
    """How a path goes around a surface between two points.

    Attributes
    ----------
    code : `NO_WRAP`, `INSIDE`, `WRAPPED` or `MANDATORY`
    arc : length on the surface [m]
    r, s : points where the path meets and leaves the surface [m]; the ends of the segment where it
        does not
    """

    code: int
    arc: float
    r: Vector
    s: Vector


# Numba gives a value made of a constant a type of its own; handed to a function it has none.


@in_place
def half_of(axis, side):
    """Make a `Half`."""
    return Half(axis=axis, side=side)


@bare
def wrapped(code, arc, r, s):
    """Make a `Wrap`."""
    return Wrap(code=code, arc=arc, r=r, s=s)


@bare
def missed(code, a, b):
    """Leave the segment from a to b straight, for the reason `NO_WRAP` or `INSIDE`."""
    return Wrap(code=code, arc=0.0, r=a, s=b)


@bare
def on_half(p, half):
    """Return whether a point lies on the side of a half; nothing does where both sides may be."""
    return sign(p[half.axis]) == half.side


@bare
def into_surface(surface, p):
    """Express a point in ground in the frame of a surface: R^T (p - center)."""
    return turned_back(surface.rotation, minus(p, surface.center))


@bare
def out_of_surface(surface, p):
    """Express a point in the frame of a surface in ground: center + R p."""
    return plus(turned(surface.rotation, p), surface.center)


@bare
def crossed_between(A, B, C):
    """Solve A t^2 + B t + C = 0 for the shares t of a segment at which it crosses a surface.

    Returns
    -------
    whether it crosses twice between its ends, 0 < t < 1, and both shares
    """
    discriminant = B * B - 4.0 * A * C
    if discriminant < 0.0 or A == 0.0:
        return False, 0.0, 0.0
    root = math.sqrt(discriminant)
    one = (-B + root) / (2.0 * A)
    other = (-B - root) / (2.0 * A)
    return 0.0 < one < 1.0 and 0.0 < other < 1.0, one, other


@bare
def nearest_pair(aa, ab, ba, bb):
    """Choose the nearest pair of two tangent points a, b at either end, by cosines of all pairs.

    Returns
    -------
    whether the pair has a at the first end, and at the second
    """
    if aa > ab and aa > ba and aa > bb:
        return True, True
    if ab > ba and ab > bb:
        return True, False
    return False, ba > bb


@in_place
def leads_away(a, b, r, s):
    """Return whether the straight parts a r and b s lead away from the middle of r and s.

    Then the path goes the long way around: (r - a + s - b) . (r + s) < 0.
    """
    parts = (
        r[0] - a[0] + s[0] - b[0],
        r[1] - a[1] + s[1] - b[1],
        r[2] - a[2] + s[2] - b[2],
    )
    return dot(parts, plus(r, s)) < 0.0
