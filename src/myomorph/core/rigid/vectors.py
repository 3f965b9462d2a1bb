"""Vectors as tuples of 3 and matrices as tuples of 9 (row by row): they live in registers."""

from __future__ import annotations

import math

from myomorph.core.rigid.kernels import bare

EPSILON = 2.220446049250313e-16


@bare
def vector(array, index):
    """Read row `index` of an array (n, 3)."""
    return array[index, 0], array[index, 1], array[index, 2]


@bare
def matrix(array, index):
    """Read matrix `index` of an array (n, 3, 3)."""
    return (
        array[index, 0, 0],
        array[index, 0, 1],
        array[index, 0, 2],
        array[index, 1, 0],
        array[index, 1, 1],
        array[index, 1, 2],
        array[index, 2, 0],
        array[index, 2, 1],
        array[index, 2, 2],
    )


@bare
def put_vector(array, index, x):
    """Store a vector as row `index` of an array (n, 3)."""
    array[index, 0] = x[0]
    array[index, 1] = x[1]
    array[index, 2] = x[2]


@bare
def put_matrix(array, index, r):
    """Store a matrix as number `index` of an array (n, 3, 3)."""
    array[index, 0, 0] = r[0]
    array[index, 0, 1] = r[1]
    array[index, 0, 2] = r[2]
    array[index, 1, 0] = r[3]
    array[index, 1, 1] = r[4]
    array[index, 1, 2] = r[5]
    array[index, 2, 0] = r[6]
    array[index, 2, 1] = r[7]
    array[index, 2, 2] = r[8]


@bare
def plus(x, y):
    """Add two vectors."""
    return x[0] + y[0], x[1] + y[1], x[2] + y[2]


@bare
def minus(x, y):
    """Subtract: x - y."""
    return x[0] - y[0], x[1] - y[1], x[2] - y[2]


@bare
def times(s, x):
    """Multiply by a number: s x."""
    return s * x[0], s * x[1], s * x[2]


@bare
def along(x, s, y):
    """Go from x along y: x + s y."""
    return x[0] + s * y[0], x[1] + s * y[1], x[2] + s * y[2]


@bare
def cross(x, y):
    """Vector product."""
    return x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]


@bare
def dot(x, y):
    """Scalar product."""
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@bare
def norm(x):
    """Euclidean norm."""
    return math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])


@bare
def unit(x):
    """Scale a vector to norm 1, or to zeros where its norm is below the rounding error."""
    length = norm(x)
    if length >= EPSILON:
        return x[0] / length, x[1] / length, x[2] / length
    return 0.0, 0.0, 0.0


@bare
def sign(x):
    """1 for a number x >= 0, else -1 (also for NaN)."""
    return 1 if x >= 0.0 else -1


@bare
def replaced(x, i, value):
    """Replace component i of a vector."""
    return value if i == 0 else x[0], value if i == 1 else x[1], value if i == 2 else x[2]


@bare
def turned(r, x):
    """Rotate a vector: r x."""
    return (
        r[0] * x[0] + r[1] * x[1] + r[2] * x[2],
        r[3] * x[0] + r[4] * x[1] + r[5] * x[2],
        r[6] * x[0] + r[7] * x[1] + r[8] * x[2],
    )


@bare
def turned_back(r, x):
    """Rotate a vector back: r^T x."""
    return (
        r[0] * x[0] + r[3] * x[1] + r[6] * x[2],
        r[1] * x[0] + r[4] * x[1] + r[7] * x[2],
        r[2] * x[0] + r[5] * x[1] + r[8] * x[2],
    )


@bare
def product(a, b):
    """Multiply two matrices."""
    return (
        a[0] * b[0] + a[1] * b[3] + a[2] * b[6],
        a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
        a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
        a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
        a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
        a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
        a[6] * b[0] + a[7] * b[3] + a[8] * b[6],
        a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
        a[6] * b[2] + a[7] * b[5] + a[8] * b[8],
    )


@bare
def about(u, angle):
    """Rotation by `angle` [rad] about the unit vector u (Rodrigues).

    R = c 1 + s [u]x + (1 - c) u u^T,   c = cos(angle), s = sin(angle)
    """
    s = math.sin(angle)
    c = math.cos(angle)
    v = 1.0 - c
    return (
        c + u[0] * u[0] * v,
        u[0] * u[1] * v - u[2] * s,
        u[0] * u[2] * v + u[1] * s,
        u[0] * u[1] * v + u[2] * s,
        c + u[1] * u[1] * v,
        u[1] * u[2] * v - u[0] * s,
        u[0] * u[2] * v - u[1] * s,
        u[1] * u[2] * v + u[0] * s,
        c + u[2] * u[2] * v,
    )
