"""Forces of muscles on elastic tendons from known activations, and their slopes.

The slopes are in the muscles' parameters. With activation a and path length L over time, the
normalized fiber length x follows from

    (a f_L(x) f_V(v) + f_PE(1 + (x - 1) / k) + damping v) cos(alpha) = f_SE((L - lo w(x)) / ls - 1),
    w = sqrt(x^2 - sin(alpha0)^2),  cos(alpha) = w / x,  v = (dx/dt) / v_max,

by the second backward differentiation formula, all muscles and windows at once (De Groote et al.
2016 and Millard et al. 2013 for the equations). A muscle's force depends on its own parameters
alone: the slopes are carried along by implicit differentiation of each step. With a rigid tendon x
and v are those of the path. The curves of each muscle's class are tables, sampled finely and joined
by cubic Hermite pieces: lengths change thousands of times, shapes never.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.model import Model
from myomorph.core.muscles.curves import Curve
from myomorph.core.muscles.fiber_equations import FiberMuscle
from myomorph.core.muscles.hill import muscle_models
from myomorph.core.rigid.kernels import inner, kernel

STEP = 0.002
LENGTHS = np.arange(0.0, 2.5 + STEP / 2, STEP)
SPEEDS = np.arange(-2.0, 2.0 + STEP / 2, STEP)
STRAINS = np.arange(-0.2, 0.3, STEP / 4)


@read_only
class Lookup:
    """Functions on one even grid, several of them, and which of them each muscle has.

    Attributes
    ----------
    start, step : of the grid
    values, slopes : (functions, points), slopes times the step
    row : (muscles,) function of each muscle
    """

    start: float
    step: float
    values: Array
    slopes: Array
    row: NDArray[np.int64]

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Look up values and slopes, straight beyond the grid.

        Parameters
        ----------
        x : (..., muscles); may be complex, for complex steps

        Returns
        -------
        (..., muscles) values and (..., muscles) slopes
        """
        u = (x - self.start) / self.step
        index = np.clip(np.floor(u.real).astype(np.int64), 0, self.values.shape[1] - 2)
        flat = index + self.row * self.values.shape[1]
        y = self.values.ravel()
        d = self.slopes.ravel()
        y0 = y[flat]
        y1 = y[flat + 1]
        d0 = d[flat]
        d1 = d[flat + 1]
        s = u - index
        beyond = np.where(s.real < 0.0, s, np.where(s.real > 1.0, s - 1.0, 0.0))
        s = s - beyond
        rise = y1 - y0
        b = 3.0 * rise - 2.0 * d0 - d1
        c = d0 + d1 - 2.0 * rise
        slope = d0 + s * (2.0 * b + s * 3.0 * c)
        return y0 + s * (d0 + s * (b + s * c)) + beyond * slope, slope / self.step


@read_only
class MuscleShapes:
    """Properties of a model's muscles that personalization leaves as they are.

    Attributes
    ----------
    active, passive, velocity, tendon : f_L and f_PE over normalized fiber length, f_V over
        normalized velocity, f_SE over the tendon's strain
    sine : (muscles,) of the pennation at optimal length: fibers keep their height
    damping : (muscles,) normalized force at maximum contraction velocity
    speed : (muscles,) maximum contraction velocity [optimal lengths / s]
    shortest : (muscles,) least normalized fiber length
    slower : (muscles,) whether contraction velocity falls with activation (Thelen 2003)
    rigid : (muscles,) whether the tendon is
    """

    active: Lookup
    passive: Lookup
    velocity: Lookup
    tendon: Lookup
    sine: Array
    damping: Array
    speed: Array
    shortest: Array
    slower: np.ndarray
    rigid: np.ndarray


def muscle_shapes(model: Model, elastic: bool = True) -> MuscleShapes:
    """Tabulate the curves of all muscles.

    Parameters
    ----------
    model : whose muscles they are
    elastic : whether tendons stretch, where their class has a curve for it

    Returns
    -------
    tables, and what else stays of each muscle
    """
    models = muscle_models(model)
    muscles = model.muscles
    pairs = list(zip(models, muscles, strict=True))
    sizes = [kind.sizes(muscle) for kind, muscle in pairs]
    fiber = np.array([size.fiber for size in sizes])
    slack = np.array([size.tendon for size in sizes])
    sine = np.array([size.height for size in sizes]) / fiber
    curves = [kind.curves(muscle) for kind, muscle in pairs]
    shortest = np.array(
        [
            kind.shortest_fiber(muscle)
            if isinstance(kind, FiberMuscle)
            else kind.sizes(muscle).shortest
            for kind, muscle in pairs
        ]
    )
    stretches = np.array([kind.elastic for kind in models], bool) & (slack > 0.0)
    tendons = [
        kind.tendon(muscle) if stretched else None
        for (kind, muscle), stretched in zip(pairs, stretches, strict=True)
    ]
    return MuscleShapes(
        active=_table(LENGTHS, [curve.active for curve in curves]),
        passive=_table(LENGTHS, [curve.passive for curve in curves]),
        velocity=_table(SPEEDS, [curve.velocity for curve in curves]),
        tendon=_table(STRAINS, tendons, 1.0),
        sine=frozen_array(sine),
        damping=frozen_array([kind.fiber_damping(muscle) for kind, muscle in pairs]),
        speed=frozen_array(np.array([size.speed for size in sizes]) / fiber),
        shortest=frozen_array(np.maximum(np.maximum(shortest / fiber, 1.02 * sine), 0.1)),
        slower=np.array([kind.slowed > 0.0 for kind in models], bool),
        rigid=~stretches | (not elastic),
    )


def _table(grid: Array, curves: Sequence[Curve | None], shift: float = 0.0) -> Lookup:
    """Sample one function a muscle, those alike once, None as 0.

    Parameters
    ----------
    grid : (points,) even
    curves : of the muscles
    shift : from the grid to what the curves are over
    """
    rows: dict[bytes, int] = {}
    sampled: dict[Curve | None, Array] = {None: np.zeros_like(grid)}
    values: list[Array] = []
    index = []
    for curve in curves:
        if curve is not None and curve not in sampled:
            sampled[curve] = curve(grid + shift)
        key = sampled[curve].tobytes()
        if key not in rows:
            rows[key] = len(values)
            values.append(sampled[curve])
        index.append(rows[key])
    stacked = np.array(values)
    step = float(grid[1] - grid[0])
    return Lookup(
        start=float(grid[0]),
        step=step,
        values=stacked,
        slopes=np.gradient(stacked, axis=1),
        row=np.array(index, np.int64),
    )


NEWTON_STEPS = 60
TOLERANCE = 1e-10  # Of the balance of a fiber, normalized


@inner(counted=False)
def _looked_up(start, step, values, slopes, row, x):
    """Look up value and slope of a table at x, see `Lookup`."""
    u = (x - start) / step
    last = values.shape[1] - 2
    index = min(max(int(np.floor(u)), 0), last)
    s = u - index
    if s < 0.0:
        beyond = s
    elif s > 1.0:
        beyond = s - 1.0
    else:
        beyond = 0.0
    s -= beyond
    y0 = values[row, index]
    d0 = slopes[row, index]
    d1 = slopes[row, index + 1]
    rise = values[row, index + 1] - y0
    b = 3.0 * rise - 2.0 * d0 - d1
    c = d0 + d1 - 2.0 * rise
    slope = d0 + s * (2.0 * b + s * 3.0 * c)
    return y0 + s * (d0 + s * (b + s * c)) + beyond * slope, slope / step


@inner(counted=False)
def _balance(tables, muscle, x, v, lead, length, a, slower):
    """Compute the fibers' pull along the tendon less the tendon's, and what its slopes need.

    The equation at the head of this file, all forces normalized.

    Parameters
    ----------
    tables : of f_L, f_PE, f_V, f_SE, and their rows for this muscle
    muscle : lo [m], ls [m], strain factor k, sine of the pennation, damping
    x, v : normalized fiber length and velocity
    lead : dv/dx of the differentiation formula
    length : of the path [m]
    a : activation
    slower : whether contraction velocity falls with activation

    Returns
    -------
    balance; its slopes in x and v; the tendon's pull and its slope in strain; w; slope of f_PE;
        slope of the balance in activation; cos(alpha)
    """
    active, passive, velocity, tendon, rows = tables
    lo, ls, strain, sine, damping = muscle
    w = np.sqrt(max(x * x - sine * sine, 1e-12))
    cosine = w / x
    drag = 0.25 + 0.75 * a if slower else 1.0
    f_l, f_l_x = _looked_up(active[0], active[1], active[2], active[3], rows[0], x)
    f_p, f_p_x = _looked_up(
        passive[0], passive[1], passive[2], passive[3], rows[1], 1.0 + (x - 1.0) / strain
    )
    f_v, f_v_u = _looked_up(velocity[0], velocity[1], velocity[2], velocity[3], rows[2], v / drag)
    pulled, slope = _looked_up(
        tendon[0], tendon[1], tendon[2], tendon[3], rows[3], (length - lo * w) / ls - 1.0
    )
    pull = a * f_l * f_v + f_p + damping * v
    by_speed = (a * f_l * f_v_u / drag + damping) * cosine
    by_length = (a * f_l_x * f_v + f_p_x / strain) * cosine + pull * sine * sine / (w * x * x)
    by_length += by_speed * lead + slope * lo / ls * x / w
    slowing = -0.75 * v / (drag * drag) if slower else 0.0
    by_activation = (f_l * f_v + a * f_l * f_v_u * slowing) * cosine
    return (
        pull * cosine - pulled,
        by_length,
        by_speed,
        pulled,
        slope,
        w,
        f_p_x,
        by_activation,
        cosine,
    )


@kernel
def follow_elastic(
    tables, rows, sizes, shapes, slower, rigid, lengths, speeds, activations, step, found
):
    """Fill forces, lengths and slopes of muscles on elastic tendons.

    Parameters
    ----------
    tables : four of (start, step, values, slopes): f_L, f_PE, f_V, f_SE
    rows : (muscles, 4) row of each table
    sizes : (4, muscles) optimal fiber length [m], slack length [m], maximum isometric force [N],
        passive strain factor
    shapes : (4, muscles) sine of the pennation, damping, maximum speed, shortest normalized length
    slower, rigid : (muscles,); rigid ones are left out
    lengths, speeds, activations : (windows, frames, muscles) [m], [m/s]
    step : between frames [s]; infinite where every frame is held still
    found : (6, windows, frames, muscles) force [N], normalized length, slopes of the force in lo,
        ls [N/m], strain and activation [N]
    """
    windows, frames, muscles = lengths.shape
    still = not np.isfinite(step)
    moved = np.zeros(4)
    past = np.zeros(4)
    before = np.zeros(4)
    for m in range(muscles):
        if rigid[m]:
            continue
        lo = sizes[0, m]
        ls = sizes[1, m]
        force = sizes[2, m]
        strain = sizes[3, m]
        sine = shapes[0, m]
        speed = shapes[2, m]
        shortest = shapes[3, m]
        muscle = (lo, ls, strain, sine, shapes[1, m])
        muscle_tables = (tables[0], tables[1], tables[2], tables[3], rows[m])
        for window in range(windows):
            along = max(lengths[window, 0, m] - 1.01 * ls, 0.0) / lo
            x = max(np.sqrt(along * along + sine * sine), shortest)
            x1 = x2 = x
            for t in range(frames):
                length = lengths[window, t, m]
                a = activations[window, t, m]
                lead = behind = fixed = 0.0
                if not still:
                    if t == 0:
                        # The first frame takes the path's velocity, as on a rigid tendon.
                        fixed = speeds[window, t, m] / (lo * speed)
                    elif t == 1:
                        lead = 1.0 / (step * speed)
                        behind = x1 / (step * speed)
                    else:
                        lead = 1.5 / (step * speed)
                        behind = (2.0 * x1 - 0.5 * x2) / (step * speed)
                low = shortest
                # Where the tendon is just slack the fibers pull more than it does.
                along = max(length - 0.98 * ls, 0.0) / lo
                high = max(np.sqrt(along * along + sine * sine), low + 0.01)
                x = min(max(x, low), high)
                for _ in range(NEWTON_STEPS):
                    error, slope, _, _, _, _, _, _, _ = _balance(
                        muscle_tables,
                        muscle,
                        x,
                        lead * x - behind + fixed,
                        lead,
                        length,
                        a,
                        slower[m],
                    )
                    if error < 0.0:
                        low = x
                    else:
                        high = x
                    if abs(error) < TOLERANCE or high - low < 1e-13:
                        break
                    new = x - error / slope
                    x = new if slope > 0.0 and low < new < high else 0.5 * (low + high)
                _, by_length, by_speed, pulled, slope, w, f_p_x, by_a, cosine = _balance(
                    muscle_tables, muscle, x, lead * x - behind + fixed, lead, length, a, slower[m]
                )
                # A slack muscle may have no stiffness at all: its tendon does not pull whatever its
                # length.
                by_length = max(by_length, 1e-4)
                # Slopes of the balance with the length held, in lo, ls, strain and activation.
                z_lo = -w / ls
                z_ls = -(length - lo * w) / (ls * ls)
                z_x = -lo / ls * x / w
                moved[0] = -slope * z_lo - by_speed * fixed / lo
                moved[1] = -slope * z_ls
                moved[2] = -f_p_x * (x - 1.0) / (strain * strain) * cosine
                moved[3] = by_a
                if not still and t > 0:
                    for index in range(4):
                        earlier = past[index] if t == 1 else 2.0 * past[index] - 0.5 * before[index]
                        moved[index] -= by_speed * earlier / (step * speed)
                for index in range(4):
                    before[index] = past[index]
                    moved[index] = -moved[index] / by_length
                    past[index] = moved[index]
                    if index == 0:
                        z = z_lo
                    elif index == 1:
                        z = z_ls
                    else:
                        z = 0.0
                    found[2 + index, window, t, m] = force * slope * (z + z_x * moved[index])
                found[0, window, t, m] = force * pulled
                found[1, window, t, m] = x
                x2 = x1
                x1 = x


@read_only
class MuscleSizes:
    """Properties of a model's muscles that personalization changes.

    Attributes
    ----------
    fiber, slack : (muscles,) optimal fiber and tendon slack lengths [m]
    force : (muscles,) maximum isometric force [N]
    strain : (muscles,) factor on the fiber strain at which passive force reaches its values
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
    shapes: MuscleShapes,
    sizes: MuscleSizes,
    lengths: Array,
    speeds: Array,
    activations: Array,
    step: float,
) -> Followed:
    """Compute muscle forces along given paths under given activations.

    Parameters
    ----------
    shapes : curves of the muscles
    sizes : lengths and strengths of the muscles
    lengths, speeds : (windows, frames, muscles) of the paths [m], [m/s]
    activations : (windows, frames, muscles)
    step : time between frames [s]; infinity holds every frame still, each in equilibrium of its own

    Returns
    -------
    (windows, frames, muscles) forces, lengths and slopes
    """
    rigid = shapes.rigid
    if not rigid.any():
        return _elastic(shapes, sizes, lengths, speeds, activations, step)
    result = _rigid(shapes, sizes, lengths, speeds, activations)
    if rigid.all():
        return result
    elastic = _elastic(shapes, sizes, lengths, speeds, activations, step)
    return Followed(
        force=np.where(rigid, result.force, elastic.force),
        length=np.where(rigid, result.length, elastic.length),
        by_fiber=np.where(rigid, result.by_fiber, elastic.by_fiber),
        by_slack=np.where(rigid, result.by_slack, elastic.by_slack),
        by_strain=np.where(rigid, result.by_strain, elastic.by_strain),
        by_activation=np.where(rigid, result.by_activation, elastic.by_activation),
    )


def rigid_lengths(shapes: MuscleShapes, sizes: MuscleSizes, lengths: Array) -> Array:
    """Compute normalized fiber lengths on tendons at their slack length.

    Parameters
    ----------
    shapes : with the pennation and the shortest lengths
    sizes : optimal fiber and tendon slack lengths
    lengths : (..., muscles) of the paths [m]

    Returns
    -------
    (..., muscles) not below the shortest
    """
    along = np.maximum(lengths - sizes.slack, 0.0) / sizes.fiber
    return np.maximum(np.sqrt(along**2 + shapes.sine**2), shapes.shortest)


def _rigid(
    shapes: MuscleShapes, sizes: MuscleSizes, lengths: Array, speeds: Array, a: Array
) -> Followed:
    """Follow muscles on rigid tendons, slopes by complex steps, exact to rounding.

    Parameters
    ----------
    lengths, speeds, a : (windows, frames, muscles) [m], [m/s], activation
    """

    def pull(fiber, slack, strain, activation):
        """Force and normalized length; any of the parameters may be complex."""
        along = (lengths - slack) / fiber
        least = np.sqrt(shapes.shortest**2 - shapes.sine**2)
        reaches = along.real > least
        along = np.where(reaches, along, least)
        x = np.sqrt(along * along + shapes.sine**2)
        cosine = along / x
        v = speeds * cosine / (fiber * shapes.speed)
        # Linear in the activation, as `hill_forces`: velocity factors of full activation in
        # Thelen's class too.
        f_v = shapes.velocity(v)[0]
        f_v = np.where(f_v.real > 0.0, f_v, 0.0)
        total = activation * shapes.active(x)[0] * f_v + shapes.passive(1.0 + (x - 1.0) / strain)[0]
        total = total + shapes.damping * v
        return sizes.force * np.where(reaches & (total.real > 0.0), total, 0.0) * cosine, x

    # df/dx = Im f(x + ih) / h
    h = 1e-30
    fiber = sizes.fiber
    slack = sizes.slack
    strain = sizes.strain
    force, length = pull(fiber, slack, strain, a)
    return Followed(
        force=force,
        length=length,
        by_fiber=pull(fiber + 1j * h, slack, strain, a)[0].imag / h,
        by_slack=pull(fiber, slack + 1j * h, strain, a)[0].imag / h,
        by_strain=pull(fiber, slack, strain + 1j * h, a)[0].imag / h,
        by_activation=pull(fiber, slack, strain, a + 1j * h)[0].imag / h,
    )


def _elastic(
    shapes: MuscleShapes, sizes: MuscleSizes, lengths: Array, speeds: Array, a: Array, step: float
) -> Followed:
    """Follow muscles on elastic tendons by `follow_elastic`; rigid ones stay 0.

    Parameters
    ----------
    lengths, speeds, a : (windows, frames, muscles) [m], [m/s], activation
    step : between frames [s]
    """
    lookups = (shapes.active, shapes.passive, shapes.velocity, shapes.tendon)
    tables = tuple((lookup.start, lookup.step, lookup.values, lookup.slopes) for lookup in lookups)
    rows = np.column_stack([lookup.row for lookup in lookups])
    size_table = np.array([sizes.fiber, sizes.slack, sizes.force, sizes.strain])
    kept = np.array([shapes.sine, shapes.damping, shapes.speed, shapes.shortest])
    result = np.zeros((6, *lengths.shape))
    given = (np.ascontiguousarray(values, dtype=np.float64) for values in (lengths, speeds, a))
    follow_elastic(
        tables, rows, size_table, kept, shapes.slower, shapes.rigid, *given, float(step), result
    )
    force, length, by_fiber, by_slack, by_strain, by_activation = result
    return Followed(
        force=force,
        length=length,
        by_fiber=by_fiber,
        by_slack=by_slack,
        by_strain=by_strain,
        by_activation=by_activation,
    )
