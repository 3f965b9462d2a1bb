"""Forces of muscles on elastic tendons from known activations, and their slopes in the muscles' parameters.

With activation a and path length L over time, the normalized fiber length x follows from

    (a f_L(x) f_V(v) + f_PE(1 + (x - 1) / k) + damping v) cos(alpha) = f_SE((L - lo w(x)) / ls - 1),
    w = sqrt(x^2 - sin(alpha0)^2),  cos(alpha) = w / x,  v = (dx/dt) / v_max,

by the second backward differentiation formula, all muscles and windows at once (De Groote et al. 2016 and Millard et
al. 2013 for the equations). A muscle's force depends on its own parameters alone: the slopes are carried along by
implicit differentiation of each step. With a rigid tendon x and v are those of the path.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.model.arrays import Array
from myomorph.tension.personal.curves import MuscleShapes

NEWTON_STEPS = 40
TOLERANCE = 1e-9
"""Of the balance of a fiber, normalized."""


@dataclass(frozen=True, eq=False)
class MuscleSizes:
    """What personalization changes, each (muscles,).

    Attributes
    ----------
    fiber, slack : optimal fiber and tendon slack lengths [m]
    force : maximum isometric force [N]
    strain : factor on the fiber strain at which passive force reaches its values
    """

    fiber: Array
    slack: Array
    force: Array
    strain: Array


class Followed(NamedTuple):
    """Muscles over time, every array (windows, frames, muscles).

    Attributes
    ----------
    force : along the tendon [N]
    length : normalized fiber length
    by_fiber, by_slack : slopes of the force in optimal length and slack length [N/m]
    by_strain : slope in the strain factor [N]
    by_activation : slope in an activation changed alike over time [N]
    """

    force: Array
    length: Array
    by_fiber: Array
    by_slack: Array
    by_strain: Array
    by_activation: Array


def follow(
    shapes: MuscleShapes, sizes: MuscleSizes, lengths: Array, speeds: Array, activations: Array, step: float
) -> Followed:
    """Muscle forces along given paths under given activations.

    Parameters
    ----------
    lengths, speeds : (windows, frames, muscles) of the paths [m], [m/s]
    activations : (windows, frames, muscles)
    step : time between frames [s]; infinity holds every frame still, each in equilibrium of its own
    """
    rigid = shapes.rigid
    found = _rigid(shapes, sizes, lengths, speeds, activations)
    if rigid.all():
        return found
    elastic = _elastic(shapes, sizes, lengths, speeds, activations, step)
    return Followed(*(np.where(rigid, one, other) for one, other in zip(found, elastic, strict=True)))


def rigid_lengths(shapes: MuscleShapes, sizes: MuscleSizes, lengths: Array) -> Array:
    """Normalized fiber lengths on tendons at their slack length, not below the shortest."""
    along = np.maximum(lengths - sizes.slack, 0.0) / sizes.fiber
    return np.maximum(np.sqrt(along**2 + shapes.sine**2), shapes.shortest)


def _rigid(shapes: MuscleShapes, sizes: MuscleSizes, lengths: Array, speeds: Array, a: Array) -> Followed:
    """Rigid tendons; slopes by complex steps, exact to rounding."""

    def pull(fiber: Array, slack: Array, strain: Array, activation: Array) -> tuple[Array, Array]:
        along = (lengths - slack) / fiber
        least = np.sqrt(shapes.shortest**2 - shapes.sine**2)
        along = np.where(along.real > least, along, least)
        x = np.sqrt(along * along + shapes.sine**2)
        cosine = along / x
        v = speeds * cosine / (fiber * shapes.speed)
        f_v = shapes.velocity(v / np.where(shapes.slower, 0.25 + 0.75 * activation, 1.0))[0]
        f_v = np.where(f_v.real > 0.0, f_v, 0.0)
        total = activation * shapes.active(x)[0] * f_v + shapes.passive(1.0 + (x - 1.0) / strain)[0]
        total = total + shapes.damping * v
        return sizes.force * np.where(total.real > 0.0, total, 0.0) * cosine, x

    h = 1e-30
    plain = (sizes.fiber, sizes.slack, sizes.strain, a)
    force, x = pull(*plain)
    slopes = [pull(*(one + 1j * h if i == k else one for i, one in enumerate(plain)))[0].imag / h for k in range(4)]
    return Followed(force, x, *slopes)


class _Step(NamedTuple):
    """The balance of fibers at some lengths, and its slopes."""

    error: Array
    by_length: Array
    by_speed: Array
    tendon: Array
    tendon_slope: Array
    w: Array
    passive_slope: Array
    by_activation: Array
    cosine: Array


def _balance(
    shapes: MuscleShapes, sizes: MuscleSizes, x: Array, v: Array, v_x: Array | float, length: Array, a: Array
) -> _Step:
    w = np.sqrt(np.maximum(x * x - shapes.sine**2, 1e-12))
    cosine = w / x
    slower = np.where(shapes.slower, 0.25 + 0.75 * a, 1.0)
    f_l, f_l_x = shapes.active(x)
    f_p, f_p_x = shapes.passive(1.0 + (x - 1.0) / sizes.strain)
    f_v, f_v_u = shapes.velocity(v / slower)
    tendon, slope = shapes.tendon((length - sizes.fiber * w) / sizes.slack - 1.0)
    pull = a * f_l * f_v + f_p + shapes.damping * v
    by_speed = (a * f_l * f_v_u / slower + shapes.damping) * cosine
    by_length = (a * f_l_x * f_v + f_p_x / sizes.strain) * cosine + pull * shapes.sine**2 / (w * x * x)
    by_length = by_length + by_speed * v_x + slope * sizes.fiber / sizes.slack * x / w
    drag = np.where(shapes.slower, -0.75 * v / slower**2, 0.0)
    by_activation = (f_l * f_v + a * f_l * f_v_u * drag) * cosine
    return _Step(pull * cosine - tendon, by_length, by_speed, tendon, slope, w, f_p_x, by_activation, cosine)


def _elastic(
    shapes: MuscleShapes, sizes: MuscleSizes, lengths: Array, speeds: Array, a: Array, step: float
) -> Followed:
    windows, frames, muscles = lengths.shape
    still = not np.isfinite(step)
    found = np.empty((6, windows, frames, muscles))
    x = rigid_lengths(shapes, sizes, lengths[:, 0] - 0.01 * sizes.slack)
    past: list[Array] = []
    """Normalized lengths of the frames before, newest first, then their slopes (4, windows, muscles)."""
    slopes_past: list[Array] = []
    lo, ls, force = sizes.fiber, sizes.slack, sizes.force
    for t in range(frames):
        length, active = lengths[:, t], a[:, t]
        if still:
            lead, behind, fixed = 0.0, np.zeros_like(x), np.zeros_like(x)
        elif not past:
            # The first frame takes the path's velocity, as on a rigid tendon.
            fixed = speeds[:, t] / (lo * shapes.speed)
            lead, behind = 0.0, np.zeros_like(x)
        else:
            h = step * shapes.speed
            fixed = np.zeros_like(x)
            lead = (1.0 if len(past) == 1 else 1.5) / h
            behind = (past[0] if len(past) == 1 else 2.0 * past[0] - 0.5 * past[1]) / h
        x = _solved(shapes, sizes, x, length, active, lead, behind, fixed)
        v = lead * x - behind + fixed
        at = _balance(shapes, sizes, x, v, lead, length, active)
        # Slopes of the balance with the length held, in lo, ls, strain and activation.
        z_lo, z_ls, z_x = -at.w / ls, -(length - lo * at.w) / ls**2, -lo / ls * x / at.w
        by = np.empty((4, windows, muscles))
        by[0] = -at.tendon_slope * z_lo
        if not still and not past:
            by[0] -= at.by_speed * fixed / lo
        by[1] = -at.tendon_slope * z_ls
        by[2] = -at.passive_slope * (x - 1.0) / sizes.strain**2 * at.cosine
        by[3] = at.by_activation
        if past and not still:
            earlier = slopes_past[0] if len(past) == 1 else 2.0 * slopes_past[0] - 0.5 * slopes_past[1]
            by -= at.by_speed * earlier / (step * shapes.speed)
        moved = -by / at.by_length
        found[0, :, t], found[1, :, t] = force * at.tendon, x
        for k, z in enumerate((z_lo, z_ls, 0.0, 0.0)):
            found[2 + k, :, t] = force * at.tendon_slope * (z + z_x * moved[k])
        if not still:
            past, slopes_past = [x, *past[:1]], [moved, *slopes_past[:1]]
    return Followed(*found)


def _solved(
    shapes: MuscleShapes,
    sizes: MuscleSizes,
    x: Array,
    length: Array,
    a: Array,
    lead: Array | float,
    behind: Array,
    fixed: Array,
) -> Array:
    """Normalized fiber lengths in balance, by Newton steps kept within a bracket."""
    low = np.broadcast_to(shapes.shortest, x.shape).copy()
    # Where the tendon is just slack the fibers pull more than it does.
    longest = np.sqrt((np.maximum(length - 0.98 * sizes.slack, 0.0) / sizes.fiber) ** 2 + shapes.sine**2)
    high = np.maximum(longest, low + 0.01)
    x = np.clip(x, low, high)
    for _ in range(NEWTON_STEPS):
        at = _balance(shapes, sizes, x, lead * x - behind + fixed, lead, length, a)
        low, high = np.where(at.error < 0.0, x, low), np.where(at.error >= 0.0, x, high)
        new = x - at.error / at.by_length
        new = np.where((new > low) & (new < high) & (at.by_length > 0.0), new, 0.5 * (low + high))
        done = (np.abs(at.error) < TOLERANCE) | (high - low < 1e-12) | shapes.rigid
        x = np.where(done, x, new)
        if done.all():
            break
    return x
