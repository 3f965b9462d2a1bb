"""Fibers on elastic tendons over time: forces, and slopes in the muscles' own parameters.

With activation a and path length L over time, the normalized fiber length x follows from

    (a f_L(x) f_V(v) + f_PE(1 + (x - 1) / k) + damping v) cos(alpha) = f_SE((L - lo w(x)) / ls - 1),
    w = sqrt(x^2 - sin(alpha0)^2),  cos(alpha) = w / x,  v = (dx/dt) / v_max,

by the second backward differentiation formula (De Groote et al. 2016 and Millard et al. 2013 for
the equations),

    dx/dt = (1.5 x_t - 2 x_(t-1) + 0.5 x_(t-2)) / step.

A muscle's force depends on its own parameters alone: the slopes of x in lo, ls, k and a are carried
along by implicit differentiation of each step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array
from myomorph.core.rigid.kernels import inner, kernel

NEWTON_STEPS = 60
TOLERANCE = 1e-10  # Of the balance of a fiber, normalized
MIN_BRACKET = 1e-13  # Of normalized lengths
TAUT = 1.01
SLACK = 0.98
"""Tendon lengths over the slack length: with which a fiber begins, and at which a tendon is slack
for sure.
"""
MIN_STIFFNESS = 1e-4
"""Of a fiber with its tendon, normalized. A slack muscle may have none: its tendon does not pull
whatever its length.
"""


class Table(NamedTuple):
    """Functions on one even grid.

    Attributes
    ----------
    start, step : of the grid
    values, slopes : (functions, points), slopes times the step
    """

    start: float
    step: float
    values: Array
    slopes: Array


class CurveTables(NamedTuple):
    """Curves of all muscles: f_L, f_PE, f_V and f_SE."""

    active: Table
    passive: Table
    velocity: Table
    tendon: Table


class Looked(NamedTuple):
    """Value and slope of a function."""

    value: float
    slope: float


class MuscleArrays(NamedTuple):
    """Numbers of all muscles.

    Attributes
    ----------
    sizes : (4, muscles) optimal fiber length [m], slack length [m], maximum isometric force [N],
        passive strain factor
    shapes : (4, muscles) sine of the pennation, damping, maximum speed [optimal lengths / s],
        shortest normalized length
    rows : (muscles, 4) function of each muscle in the tables of `CurveTables`
    slower, rigid : (muscles,) whether velocity falls with activation; rigid ones are left out
    """

    sizes: Array
    shapes: Array
    rows: NDArray[np.int64]
    slower: np.ndarray
    rigid: np.ndarray


class Paths(NamedTuple):
    """Paths and activations over time.

    Attributes
    ----------
    lengths, speeds, activations : (windows, frames, muscles) [m], [m/s], [1]
    step : between frames [s]; infinite where every frame is held still
    """

    lengths: Array
    speeds: Array
    activations: Array
    step: float


class Fiber(NamedTuple):
    """One muscle.

    Attributes
    ----------
    lo, ls : optimal fiber length and slack length [m]
    force : maximum isometric force [N]
    strain, sine, damping, speed, shortest, slower : see `MuscleArrays`
    active, passive, velocity, tendon : rows of its curves
    """

    lo: float
    ls: float
    force: float
    strain: float
    sine: float
    damping: float
    speed: float
    shortest: float
    slower: bool
    active: int
    passive: int
    velocity: int
    tendon: int


class Instant(NamedTuple):
    """What a fiber meets in a frame, with v = lead x - behind + fixed.

    Attributes
    ----------
    length : of the path [m]
    activation : [1]
    lead, behind, fixed : slope dv/dx, what earlier frames give, and a velocity that is known
    recent, older : weights of the two frames before, in x as in the slopes that are carried
    unit : step times the maximum speed, by which differences of x are velocities
    """

    length: float
    activation: float
    lead: float
    behind: float
    fixed: float
    recent: float
    older: float
    unit: float


class Balance(NamedTuple):
    """The fiber's pull along the tendon less the tendon's, normalized, and what slopes need.

    Attributes
    ----------
    error : the balance, 0 in equilibrium
    by_length, by_speed, by_activation : its slopes in x, v and a
    pulled, stiffness : the tendon's pull and its slope in strain
    along : w, fiber length along the tendon
    passive_slope : of f_PE
    cosine : of the pennation
    """

    error: float
    by_length: float
    by_speed: float
    by_activation: float
    pulled: float
    stiffness: float
    along: float
    passive_slope: float
    cosine: float


@inner(counted=False)
def _looked_up(table, row, x):
    """Look up value and slope of a table at x, see `Lookup`."""
    u = (x - table.start) / table.step
    index = min(max(int(np.floor(u)), 0), table.values.shape[1] - 2)
    s = u - index
    if s < 0.0:
        beyond = s
    elif s > 1.0:
        beyond = s - 1.0
    else:
        beyond = 0.0
    s -= beyond
    y0 = table.values[row, index]
    d0 = table.slopes[row, index]
    d1 = table.slopes[row, index + 1]
    rise = table.values[row, index + 1] - y0
    b = 3.0 * rise - 2.0 * d0 - d1
    c = d0 + d1 - 2.0 * rise
    slope = d0 + s * (2.0 * b + s * 3.0 * c)
    value = y0 + s * (d0 + s * (b + s * c)) + beyond * slope
    return Looked(value=value, slope=slope / table.step)


@inner(counted=False)
def _balance(tables, fiber, instant, x):
    """Compute the balance of a fiber of normalized length x; the equation at the head of this file.

    Parameters
    ----------
    tables : `CurveTables`
    fiber : `Fiber`
    instant : `Instant`
    x : normalized fiber length

    Returns
    -------
    `Balance`
    """
    a = instant.activation
    v = instant.lead * x - instant.behind + instant.fixed
    w = np.sqrt(max(x * x - fiber.sine * fiber.sine, 1e-12))
    cosine = w / x
    drag = 0.25 + 0.75 * a if fiber.slower else 1.0
    f_l = _looked_up(tables.active, fiber.active, x)
    f_p = _looked_up(tables.passive, fiber.passive, 1.0 + (x - 1.0) / fiber.strain)
    f_v = _looked_up(tables.velocity, fiber.velocity, v / drag)
    strain = (instant.length - fiber.lo * w) / fiber.ls - 1.0
    f_se = _looked_up(tables.tendon, fiber.tendon, strain)

    pull = a * f_l.value * f_v.value + f_p.value + fiber.damping * v
    by_speed = (a * f_l.value * f_v.slope / drag + fiber.damping) * cosine
    by_length = (a * f_l.slope * f_v.value + f_p.slope / fiber.strain) * cosine
    by_length = by_length + pull * fiber.sine * fiber.sine / (w * x * x)
    by_length += by_speed * instant.lead + f_se.slope * fiber.lo / fiber.ls * x / w
    slowing = -0.75 * v / (drag * drag) if fiber.slower else 0.0
    by_activation = f_l.value * f_v.value + a * f_l.value * f_v.slope * slowing
    return Balance(
        error=pull * cosine - f_se.value,
        by_length=by_length,
        by_speed=by_speed,
        by_activation=by_activation * cosine,
        pulled=f_se.value,
        stiffness=f_se.slope,
        along=w,
        passive_slope=f_p.slope,
        cosine=cosine,
    )


@inner(counted=False)
def _fiber(arrays, m):
    """Take one muscle out of `MuscleArrays`."""
    return Fiber(
        lo=arrays.sizes[0, m],
        ls=arrays.sizes[1, m],
        force=arrays.sizes[2, m],
        strain=arrays.sizes[3, m],
        sine=arrays.shapes[0, m],
        damping=arrays.shapes[1, m],
        speed=arrays.shapes[2, m],
        shortest=arrays.shapes[3, m],
        slower=arrays.slower[m],
        active=arrays.rows[m, 0],
        passive=arrays.rows[m, 1],
        velocity=arrays.rows[m, 2],
        tendon=arrays.rows[m, 3],
    )


@inner(counted=False)
def _length_beside(fiber, length, tendon):
    """Compute the normalized fiber length beside a tendon of so many slack lengths."""
    along = max(length - tendon * fiber.ls, 0.0) / fiber.lo
    return np.sqrt(along * along + fiber.sine * fiber.sine)


@inner(counted=False)
def _instant(paths, fiber, place, x1, x2):
    """State what a fiber meets in a frame.

    Parameters
    ----------
    paths : `Paths`
    fiber : `Fiber`
    place : window, frame and muscle
    x1, x2 : normalized lengths one and two frames before
    """
    window, t, m = place
    lead = 0.0
    behind = 0.0
    fixed = 0.0
    recent = 0.0
    older = 0.0
    unit = paths.step * fiber.speed
    if np.isfinite(paths.step):
        if t == 0:
            # The first frame takes the path's velocity, as on a rigid tendon.
            fixed = paths.speeds[window, t, m] / (fiber.lo * fiber.speed)
        elif t == 1:
            recent = 1.0
            lead = 1.0 / unit
            behind = x1 / unit
        else:
            recent = 2.0
            older = 0.5
            lead = 1.5 / unit
            behind = (2.0 * x1 - 0.5 * x2) / unit
    return Instant(
        length=paths.lengths[window, t, m],
        activation=paths.activations[window, t, m],
        lead=lead,
        behind=behind,
        fixed=fixed,
        recent=recent,
        older=older,
        unit=unit,
    )


@inner(counted=False)
def _equilibrium(tables, fiber, instant, x):
    """Find the normalized length at which fiber and tendon balance, from a guess x.

    Newton steps within a bracket, which is halved where they leave it.
    """
    low = fiber.shortest
    # Where the tendon is just slack the fibers pull more than it does.
    high = max(_length_beside(fiber, instant.length, SLACK), low + 0.01)
    x = min(max(x, low), high)
    for _ in range(NEWTON_STEPS):
        balance = _balance(tables, fiber, instant, x)
        if balance.error < 0.0:
            low = x
        else:
            high = x
        if abs(balance.error) < TOLERANCE or high - low < MIN_BRACKET:
            break
        new = x - balance.error / balance.by_length
        x = new if balance.by_length > 0.0 and low < new < high else 0.5 * (low + high)
    return x


@inner(counted=False)
def _carry_slopes(fiber, instant, balance, x, carried):
    """Carry the slopes of x in lo, ls, strain and activation one frame on.

    Parameters
    ----------
    fiber, instant, balance : of the frame
    x : normalized fiber length there
    carried : (2, 4) slopes of x in the frame before and the one before that; shifted in place
    """
    ls = fiber.ls
    by_length = max(balance.by_length, MIN_STIFFNESS)
    stiffness = balance.stiffness
    z_lo = -balance.along / ls
    z_ls = -(instant.length - fiber.lo * balance.along) / (ls * ls)
    squared = fiber.strain * fiber.strain
    # Slopes of the balance while x is held
    held = (
        -stiffness * z_lo - balance.by_speed * instant.fixed / fiber.lo,
        -stiffness * z_ls,
        -balance.passive_slope * (x - 1.0) / squared * balance.cosine,
        balance.by_activation,
    )
    for index in range(4):
        earlier = instant.recent * carried[0, index] - instant.older * carried[1, index]
        moved = held[index] - balance.by_speed * earlier / instant.unit
        carried[1, index] = carried[0, index]
        carried[0, index] = -moved / by_length


@inner(counted=False)
def _write(fiber, instant, balance, x, carried, found):
    """Write force, length and slopes of the force of one frame.

    Parameters
    ----------
    fiber, instant, balance : of the frame
    x : normalized fiber length there
    carried : (2, 4) slopes of x, the first row those of this frame
    found : (6,) of `follow_elastic`
    """
    lo = fiber.lo
    ls = fiber.ls
    w = balance.along
    z_x = -lo / ls * x / w
    rise = fiber.force * balance.stiffness
    found[0] = fiber.force * balance.pulled
    found[1] = x
    found[2] = rise * (-w / ls + z_x * carried[0, 0])
    found[3] = rise * (-(instant.length - lo * w) / (ls * ls) + z_x * carried[0, 1])
    found[4] = rise * (z_x * carried[0, 2])
    found[5] = rise * (z_x * carried[0, 3])


@kernel
def follow_elastic(tables, muscles, paths, found):
    """Fill forces, lengths and slopes of muscles on elastic tendons.

    Parameters
    ----------
    tables : `CurveTables`
    muscles : `MuscleArrays`
    paths : `Paths`
    found : (6, windows, frames, muscles) force [N], normalized length, slopes of the force in lo,
        ls [N/m], strain and activation [N]
    """
    windows, frames, count = paths.lengths.shape
    carried = np.zeros((2, 4))
    for m in range(count):
        if muscles.rigid[m]:
            continue
        fiber = _fiber(muscles, m)
        for window in range(windows):
            x = max(_length_beside(fiber, paths.lengths[window, 0, m], TAUT), fiber.shortest)
            x1 = x
            x2 = x
            for t in range(frames):
                instant = _instant(paths, fiber, (window, t, m), x1, x2)
                x = _equilibrium(tables, fiber, instant, x)
                balance = _balance(tables, fiber, instant, x)
                _carry_slopes(fiber, instant, balance, x, carried)
                _write(fiber, instant, balance, x, carried, found[:, window, t, m])
                x2 = x1
                x1 = x
