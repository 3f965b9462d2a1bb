"""Vectors of three numbers as tuples, for kernels that must not allocate."""

from __future__ import annotations

import math

from numba import njit

EPSILON = 2.220446049250313e-16

inner = njit(cache=True, nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Decorator of kernels that only kernels call: half as long to compile, but Python would crash on a call."""


@inner
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def cross(a, b):
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inner
def minus(a, b):
    """The difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inner
def along(a, s, b):
    """The point a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@inner
def norm(a):
    """Euclidean length."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@inner
def unit(a):
    """The vector of length 1, or zeros where `a` is shorter than the rounding error."""
    length = norm(a)
    if length >= EPSILON:
        return a[0] / length, a[1] / length, a[2] / length
    return 0.0, 0.0, 0.0


@inner
def sign(x):
    """1 for x >= 0, else -1 (also for NaN)."""
    return 1 if x >= 0.0 else -1


@inner
def replaced(a, i, x):
    """The vector with `x` as component i."""
    return x if i == 0 else a[0], x if i == 1 else a[1], x if i == 2 else a[2]
