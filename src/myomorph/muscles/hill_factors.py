"""Kernels of the three curves of a Hill-type muscle, by its class: f_L, f_V and f_PE."""

from __future__ import annotations

import numpy as np

from myomorph.muscles.hill_classes import DEGROOTE, MUJOCO, RIGID, SCHUTTE, THELEN
from myomorph.muscles.hill_curves import curve_value
from myomorph.rigid.kernels import inner


@inner(forceinline=True)
def active_length_factor(H, m, x):
    """f_L of muscle m at the normalized fiber length x."""
    kind = H.kind[m]
    if H.curve[m, 0] >= 0:
        return curve_value(H.curves, H.curve[m, 0], x)
    if kind == DEGROOTE:
        x = (x - 1.0) / H.parameters[m, 0] + 1.0
        one = (x - 1.055033428970575) / (0.162384573599574 + 0.063303448465465 * x)
        two = (x - 0.716775413397760) / (-0.029947116970696 + 0.200356847296188 * x)
        three = (x - 1.0) / 0.353553390593274
        return (
            0.8150671134243542 * np.exp(-0.5 * one * one)
            + 0.433004984392647 * np.exp(-0.5 * two * two)
            + 0.1 * np.exp(-0.5 * three * three)
        )
    if kind == MUJOCO:
        low, high = H.parameters[m, 0], H.parameters[m, 1]
        if x < low or x > high:
            return 0.0
        if x <= 1.0:
            middle = 0.5 * (low + 1.0)
            if x <= middle:
                u = (x - low) / max(1e-15, middle - low)
                return 0.5 * u * u
            u = (1.0 - x) / max(1e-15, 1.0 - middle)
            return 1.0 - 0.5 * u * u
        middle = 0.5 * (1.0 + high)
        if x <= middle:
            u = (x - 1.0) / max(1e-15, middle - 1.0)
            return 1.0 - 0.5 * u * u
        u = (high - x) / max(1e-15, high - middle)
        return 0.5 * u * u
    return np.exp(-(x - 1.0) * (x - 1.0) / H.parameters[m, 0])


@inner(forceinline=True)
def velocity_factor(H, m, v):
    """f_V of muscle m, fully active, at the normalized fiber velocity v (negative: shortening); never below 0."""
    kind = H.kind[m]
    if H.curve[m, 1] >= 0 and kind != SCHUTTE:
        return max(curve_value(H.curves, H.curve[m, 1], v), 0.0)
    if kind == THELEN:
        shape, most = H.parameters[m, 3], H.parameters[m, 4]
        if v <= -1.0:
            return 0.0
        if v <= 0.0:
            return (1.0 + v) / (1.0 - v / shape)
        k = (2.0 + 2.0 / shape) / (most - 1.0)
        last = H.parameters[m, 5] * most
        f = (1.0 + v * k * most) / (1.0 + v * k)
        if f < last:
            return f
        b = k * (most - last)
        start = (last - 1.0) / b
        return last + (v - start) / (1.0 / b + (last - 1.0) * k / (b * b))
    if kind == DEGROOTE:
        return max(-0.3211346127989808 * np.arcsinh(-8.149 * v - 0.374) + 0.8825327733249912, 0.0)
    if kind == MUJOCO:
        most = H.parameters[m, 3]
        if v <= -1.0:
            return 0.0
        if v <= 0.0:
            return (v + 1.0) * (v + 1.0)
        if v <= most - 1.0:
            return most - (most - 1.0 - v) ** 2 / max(1e-15, most - 1.0)
        return most
    return 1.8 - 1.8 / (1.0 + np.exp((0.04 + v) / 0.18))


@inner(forceinline=True)
def passive_length_factor(H, m, x):
    """f_PE of muscle m at the normalized fiber length x; never below 0."""
    kind = H.kind[m]
    if H.curve[m, 2] >= 0:
        return min(max(curve_value(H.curves, H.curve[m, 2], x), 0.0), 10.0 if kind == RIGID else np.inf)
    if kind == THELEN:
        return (
            (np.exp(H.parameters[m, 2] * (x - 1.0) / H.parameters[m, 1]) - 1.0) / (np.exp(H.parameters[m, 2]) - 1.0)
            if x > 1.0
            else 0.0
        )
    if kind == DEGROOTE:
        least = np.exp(4.0 * (0.2 - 1.0) / H.parameters[m, 1])
        return H.parameters[m, 2] * max(
            (np.exp(4.0 * (x - 1.0) / H.parameters[m, 1]) - least) / (np.exp(4.0) - least), 0.0
        )
    if kind == MUJOCO:
        middle = 0.5 * (1.0 + H.parameters[m, 1])
        if x <= 1.0:
            return 0.0
        u = (x - 1.0) / max(1e-15, middle - 1.0)
        return H.parameters[m, 2] * (0.5 * u * u if x <= middle else u - 0.5)
    if kind == SCHUTTE:
        return np.exp(8.0 * (x - 1.0) - 4.0)
    if x > 1.0 + H.parameters[m, 1]:
        return 1.0 + H.parameters[m, 2] / H.parameters[m, 1] * (x - 1.0 - H.parameters[m, 1])
    return np.exp(H.parameters[m, 2] * (x - 1.0) / H.parameters[m, 1] - H.parameters[m, 2])
