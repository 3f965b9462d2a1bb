"""Coordinates that follow others: values and rates of dependent coordinates."""

from __future__ import annotations

from myomorph.rigid.coordinates import evaluate
from myomorph.rigid.kernels import bare, in_place, kernel


@bare
def couple(T, c):
    """Set the dependent coordinates in c (coordinates,) from those they follow."""
    for index in range(T.coupler_coordinate.shape[0]):
        i, j = T.coupler_source[index, 0], T.coupler_source[index, 1]
        x1 = c[i] if i >= 0 else 0.0
        x2 = c[j] if j >= 0 else 0.0
        c[T.coupler_coordinate[index]] = evaluate(T.functions, T.coupler_function[index], x1, x2)[0]


@bare
def couple_rates(T, c, cdot, cddot):
    """Set the dependent velocities and accelerations by the chain rule; c is consistent already."""
    for index in range(T.coupler_coordinate.shape[0]):
        i, j = T.coupler_source[index, 0], T.coupler_source[index, 1]
        x1 = c[i] if i >= 0 else 0.0
        x2 = c[j] if j >= 0 else 0.0
        v1 = cdot[i] if i >= 0 else 0.0
        v2 = cdot[j] if j >= 0 else 0.0
        a1 = cddot[i] if i >= 0 else 0.0
        a2 = cddot[j] if j >= 0 else 0.0
        _, d1, d2, d11, d12, d22 = evaluate(T.functions, T.coupler_function[index], x1, x2)
        cdot[T.coupler_coordinate[index]] = d1 * v1 + d2 * v2
        cddot[T.coupler_coordinate[index]] = d1 * a1 + d2 * a2 + d11 * v1 * v1 + 2.0 * d12 * v1 * v2 + d22 * v2 * v2


@kernel
def gather_dependents(T, c, rows):
    """Turn derivatives in all coordinates into derivatives in the independent ones, in place.

    Each row of `rows` (n, coordinates) holds df/dc; afterwards the entry of an independent coordinate includes what
    reaches f through the coordinates that follow it, and the entries of dependent coordinates are left as they were.
    """
    for index in range(T.coupler_coordinate.shape[0] - 1, -1, -1):
        i, j = T.coupler_source[index, 0], T.coupler_source[index, 1]
        x1 = c[i] if i >= 0 else 0.0
        x2 = c[j] if j >= 0 else 0.0
        _, d1, d2, _, _, _ = evaluate(T.functions, T.coupler_function[index], x1, x2)
        for row in range(rows.shape[0]):
            if i >= 0:
                rows[row, i] += d1 * rows[row, T.coupler_coordinate[index]]
            if j >= 0:
                rows[row, j] += d2 * rows[row, T.coupler_coordinate[index]]


@in_place
def fold_dependents(T, c, H, g, D):
    """Carry what dependent coordinates feel over to those they follow, by the chain rule, in place."""
    for index in range(T.coupler_coordinate.shape[0] - 1, -1, -1):
        d, i, j = T.coupler_coordinate[index], T.coupler_source[index, 0], T.coupler_source[index, 1]
        _, d1, d2, d11, d12, d22 = evaluate(
            T.functions, T.coupler_function[index], c[i] if i >= 0 else 0.0, c[j] if j >= 0 else 0.0
        )
        for side in range(2):
            s = i if side == 0 else j
            slope = d1 if side == 0 else d2
            if s >= 0:
                g[s] += slope * g[d]
                D[s] += slope * slope * D[d]
                H[s, s] += g[d] * (d11 if side == 0 else d22)
                for t in range(c.shape[0]):
                    H[s, t] += slope * H[d, t]
                for t in range(c.shape[0]):
                    H[t, s] += slope * H[t, d]
        if i >= 0 and j >= 0:
            H[i, j] += g[d] * d12
            H[j, i] += g[d] * d12


@kernel
def couple_frames(T, values):
    """`couple` for every row of values (frames, coordinates)."""
    if T.coupler_coordinate.shape[0] == 0:
        return
    for frame in range(values.shape[0]):
        couple(T, values[frame])


@kernel
def couple_rates_frames(T, values, velocities, accelerations):
    """`couple_rates` for every row of three arrays (frames, coordinates)."""
    if T.coupler_coordinate.shape[0] == 0:
        return
    for frame in range(values.shape[0]):
        couple_rates(T, values[frame], velocities[frame], accelerations[frame])
