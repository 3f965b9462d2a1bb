"""Certificates of the tension problem: what the data leave open of contact forces.

Physics gives many contact forces that would do. For each frame and group of sites,

    low, high = least and greatest S x   over   A x = b,  lower <= x <= upper

with S x the net force of the group: every force that equations of motion, cones, bounds of
activations, what was measured and reserves no greater than used (and a tolerance) allow. What
effort and EMG prefer is asked for apart: the same over those x whose cost is within a share of the
one found: at x(s) = argmin cost(x) + s c^T x for the s at which its cost reaches the level, one
more problem of the same form, with targets moved by -s c / (2 w), whose cost grows with s. Near the
optimum it grows with s^2, which gives the next s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.rigid.frames import over_frames
from myomorph.core.tension.dual import OPTIMAL
from myomorph.core.tension.problem import TensionProblem, solve_frames
from myomorph.core.tension.separable import Separable
from myomorph.core.tension.simplex import least_values
from myomorph.core.tension.tension import RESIDUAL, Tension
from myomorph.core.tension.terms.cones import subject_weight


@read_only
class SolvedFrames:
    """Some frames: minimise cost(x) subject to A x = b, lower <= x <= upper, and the x that was
    found. Unknowns are activations, controls, amplitudes of contacts, and others that terms bring
    in.
    """

    frames: NDArray[np.int64]  # (frames,) their numbers in the motion
    A: Array  # (frames, rows, variables)
    b: Array  # (frames, rows)
    x: Array  # (frames, variables), NaN where a frame was not solved
    shared: Separable  # weights, exponents and bounds of all frames
    penalties: Array  # (frames, 3, variables) as of `solve_separable`
    values: Array  # entries of A as `TensionProblem.balance` gives them
    # muscles, controls, amplitudes: where activations, controls, and amplitudes end among the
    # variables
    muscles: int
    controls: int
    amplitudes: int

    def __len__(self) -> int:
        return len(self.frames)

    def of(self, places: NDArray[np.int64]) -> SolvedFrames:
        """Some of these frames."""
        parts = {
            name: getattr(self, name)[places]
            for name in ("frames", "A", "b", "x", "penalties", "values")
        }
        return replace(self, **parts)

    def cost(self, x: Array) -> Array:
        """Cost (frames, ...) of variables (frames, ..., n), smoothness between frames apart."""
        penalties = self.penalties.reshape(len(self), 3, *(1,) * (x.ndim - 2), x.shape[-1])
        below = np.maximum(penalties[:, 0] - x, 0.0)
        above = np.maximum(x - penalties[:, 1], 0.0)
        pulled = np.where(penalties[:, 2] > 0.0, penalties[:, 2] * (below**2 + above**2), 0.0)
        return (self.shared.weight * np.abs(x) ** self.shared.exponent + pulled).sum(axis=-1)

    def curvature(self, x: Array) -> Array:
        """Second derivatives of the cost, (frames, variables), above 0."""
        w = self.shared.weight
        p = self.shared.exponent
        outside = (x <= self.penalties[:, 0]) | (x >= self.penalties[:, 1])
        pulled = np.where((self.penalties[:, 2] > 0.0) & outside, 2.0 * self.penalties[:, 2], 0.0)
        # With p other than 2 the curvature at 0 is 0 or infinite: taken a little beside it.
        return p * (p - 1.0) * w * np.maximum(np.abs(x), 1e-6) ** (p - 2.0) + pulled


def solved_frames(
    problem: TensionProblem, tension: Tension, frames: NDArray[np.int64]
) -> SolvedFrames:
    """Frames of a problem that was solved."""
    shared = problem.separable
    n = len(shared.weight)
    # A run of frames at once, others one by one.
    together = len(frames) > 0 and int(frames[-1] - frames[0]) == len(frames) - 1
    spans = (
        [(int(frames[0]), int(frames[-1]) + 1)]
        if together
        else [(int(frame), int(frame) + 1) for frame in frames]
    )
    balance = [problem.balance(*span) for span in spans]
    values = np.concatenate([array.values for array in balance])
    b = np.concatenate([array.right for array in balance])
    A = shared.dense(values)
    muscles = len(tension.muscles)
    first = len(problem.unknowns)
    controls = muscles + tension.reserves.shape[1]
    # What the result says counts, and the unknowns of rows follow from the others.
    x = np.concatenate(
        [problem.x_of(frames)[:, :first], np.zeros((len(frames), n - first))], axis=1
    )
    x[:, :muscles] = tension.activations[frames]
    x[:, muscles:controls] = tension.reserves[frames] / problem.actuators.optimal_forces
    if problem.rows:
        left = np.einsum("frn,fn->fr", A, x) - b
        x[:, first:] = left[:, problem.assembly.extra_row] / np.concatenate(
            [row.unit for row in problem.rows]
        )
    penalties = np.broadcast_to(problem.penalties[frames], (len(frames), 3, n))
    amplitudes = controls + problem.amplitudes.shape[1]
    return SolvedFrames(
        frames=frames,
        A=A,
        b=b,
        x=x,
        shared=shared,
        penalties=penalties,
        values=values,
        muscles=muscles,
        controls=controls,
        amplitudes=amplitudes,
    )


CLOSE = 0.02  # Share of the allowed increase of the cost that may be left
MAX_COUNT = 12  # Values of s that are tried


def near_extremes(
    solved: SolvedFrames, bounds: tuple[Array, Array], functions: Array, share: float
) -> Array:
    """Least and greatest values of linear functions of contact amplitudes among solutions near the
    optimum. `solved`: frames that were solved; `bounds` (frames, variables) least and greatest,
    with what was found between them; `functions` (frames, groups, 3, variables), of variables whose
    exponent is 2 alone; `share`: increase of the cost that is allowed, of the cost of the solution
    that was found. Returns (2, frames, groups, 3) least, greatest.
    """
    frames, groups = functions.shape[:2]
    costs = np.stack([functions, -functions], axis=1).reshape(frames, -1, functions.shape[-1])
    result = solved.cost(solved.x)
    # What was found may be dearer than each frame alone has to be, for the sake of the frames
    # beside it.
    alone = _solve(solved, bounds, np.zeros((frames, 1, costs.shape[2])))
    least = np.fmin(solved.cost(alone)[:, 0], result)
    allowed = ((1.0 + share) * result - least)[:, None]
    best = np.fmin(
        np.einsum("fkn,fn->fk", costs, solved.x), np.einsum("fkn,fn->fk", costs, alone[:, 0])
    )
    # A first s from the size of each function: the cost of a body weight is of the size of the
    # effort.
    size = np.abs(costs).max(axis=2)
    s = np.where(size > 0.0, np.sqrt(allowed) / np.maximum(size, 1e-300), 0.0)
    under = np.zeros(s.shape)
    over = np.full(s.shape, np.inf)
    done = (size == 0.0) | ~(allowed > 0.0)
    for _ in range(MAX_COUNT):
        x = _solve(solved, bounds, s[..., None] * costs)
        more = solved.cost(x) - least[:, None]
        value = np.einsum("fkn,fkn->fk", costs, x)
        inside = (more <= allowed) & np.isfinite(more)
        best = np.where(inside & ~done, np.minimum(best, value), best)
        done |= inside & (more >= (1.0 - CLOSE) * allowed)
        under = np.where(inside, np.maximum(under, s), under)
        over = np.where(inside, over, np.minimum(over, s))
        if done.all():
            break
        factor = np.sqrt((1.0 - 0.5 * CLOSE) * allowed / np.maximum(more, 1e-12 * allowed))
        guess = s * np.clip(np.nan_to_num(factor, nan=0.1), 0.1, 10.0)
        middle = np.where(np.isfinite(over), 0.5 * (under + over), guess)
        s = np.where(done, s, np.where((guess <= under) | (guess >= over), middle, guess))
    ends = best.reshape(frames, 2, groups, 3)
    return np.stack([ends[:, 0], -ends[:, 1]])


def _solve(solved: SolvedFrames, bounds: tuple[Array, Array], tilt: Array) -> Array:
    """The x of least cost(x) + tilt^T x, (frames, many, variables) of tilts alike; NaN where there
    is none.
    """
    frames, many, n = tilt.shape
    x = np.empty((frames, many, n))
    targets = -0.5 * tilt / solved.shared.weight

    def part(start: int, stop: int) -> None:
        for index in range(start, stop):
            values = np.repeat(solved.values[index][None], many, axis=0)
            right = np.repeat(solved.b[index][None], many, axis=0)
            lower, upper = (frozen_array(bound[index]) for bound in bounds)
            shared = solved.shared._replace(lower=lower, upper=upper)
            penalties = np.array(solved.penalties[index])[None]
            x[index], *_, status = solve_frames(
                shared, values, right, penalties, targets=targets[index]
            )
            x[index, status != OPTIMAL] = np.nan

    over_frames(part, frames, chunk=4)
    return x


PART = 0.35  # A group whose part of a unit combination is smaller is not named


def axis_words(vector: Array, up: Array) -> str:
    """The axis that a vector (3,) is most along: "vertically", or "along x" of the ground's axes
    across `up`.
    """
    height = up / (np.linalg.norm(up) or 1.0)
    along = float(vector @ height)
    across = vector - along * height
    if abs(along) >= np.linalg.norm(across):
        return "vertically"
    return f"along {'xyz'[int(np.abs(across).argmax())]}"


def direction_words(
    groups: Sequence[str], direction: Array, spread: float, share: float, up: Array
) -> str:
    """One clause on a unit combination (groups, 3) of contact forces, "" where it is unknown.
    `spread`: how far forces may go along it [N] at `share` more of the cost; `up` (3,) away from
    gravity.
    """
    if not np.isfinite(direction).all() or not np.isfinite(spread):
        return ""
    if spread < 0.05:
        return "contact forces are determined"
    sizes = np.linalg.norm(direction, axis=1)
    order = [int(number) for number in np.argsort(-sizes) if sizes[number] >= PART][:2]
    first = direction[order[0]]
    words = axis_words(first, up)
    names = [f"'{groups[number]}'" for number in order]
    if len(order) == 1:
        what = f"the force at {names[0]} {words}"
    elif first @ direction[order[1]] < 0.0:
        what = f"shifting force between {names[0]} and {names[1]} {words}"
    else:
        what = f"the forces at {names[0]} and {names[1]} together {words}"
    return f"{what}, by {spread:.3g} N for {100.0 * share:g} % more cost"


ON_BOUND = 1e-7  # A variable nearer to a bound than this share of 1 + its size stands on it


@dataclass(frozen=True)
class CertificateOptions:
    """What counts as left open."""

    # what residuals at a body that floats may give beyond what they gave, as a share of its
    # subject's weight [1, times 1 m for moments]
    residual: float = 0.01
    # what reserves and actuators without bounds may give beyond what they gave [N m or N]
    reserve: float = 1.0
    # how far a measured force may be missed, in standard deviations, where it was not missed by
    # more
    deviations: float = 2.0
    # share of the cost by which solutions may be worse that still count as near the optimum, 0 to
    # leave out
    near: float = 0.05

    def __post_init__(self) -> None:
        for name in ("residual", "reserve", "deviations", "near"):
            if not getattr(self, name) >= 0.0:
                raise BadData(
                    f"{name} of certificates is {getattr(self, name):g}: expected 0 or more"
                )


@read_only
class ContactIntervals:
    """What the data leave open of contact forces, frame by frame."""

    # time, frames: (frames,) [s], numbers in the motion
    time: Array
    frames: np.ndarray
    groups: tuple[str, ...]  # names
    forces: Array  # (frames, groups, 3) net forces that were found, in ground [N]
    # low, high: (frames, groups, 3) least and greatest of each component that the data allow [N];
    # NaN where the frame was not solved, infinite where nothing bounds them
    low: Array
    high: Array
    # normal, normal_low, normal_high: (frames, groups) the same of the force along the cones [N]
    normal: Array
    normal_low: Array
    normal_high: Array
    # near_low, near_high: (frames, groups, 3) the same among those of them near the optimum; NaN
    # where not asked for
    near_low: Array
    near_high: Array
    # (frames, groups, 3) the unit combination of the forces that the data and effort determine
    # least
    direction: Array
    # (frames,) how far forces may move along it until the cost has grown by the share `near` [N];
    # like `direction` NaN where not asked for
    spread: Array
    sentences: tuple[str, ...]  # one a frame: what that direction is, "" where not asked for

    def __len__(self) -> int:
        return len(self.time)


def contact_intervals(
    problem: TensionProblem,
    tension: Tension,
    frames: Sequence[int] | None = None,
    options: CertificateOptions | None = None,
    advance: Callable[[int], None] = lambda done: None,
    at_once: int = 64,
) -> ContactIntervals:
    """What the data leave open of the contact forces of solved frames; `advance` hears of every
    `at_once` of them.
    """
    options = options or CertificateOptions()
    if problem.contacts is None:
        raise BadData(
            "there are no contacts whose forces could be left open: give contacts to the tension"
            " problem"
        )
    chosen = np.arange(len(tension)) if frames is None else np.asarray(frames, np.int64)
    if not len(chosen):
        raise BadData("no frame is asked for")
    if not (chosen.min() >= 0 and chosen.max() < len(tension)):
        raise BadData(f"frame {chosen.max()} is asked for, but the tensions have {len(tension)}")
    # Groups in the order of their first site, and which generators belong to each.
    labels = [
        problem.contacts.generators.sites[number].group
        for number in problem.contacts.generators.site
    ]
    groups = tuple(dict.fromkeys(site.group for site in problem.contacts.generators.sites))
    members = [np.array([label == group for label in labels]) for group in groups]
    parts = []
    for start in range(0, len(chosen), at_once):
        part = chosen[start : start + at_once]
        with threadpool_limits(1, "blas"):
            parts.append(_part(problem, tension, part, members, options))
        advance(len(part))
    values = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    up = -problem.assembly.tree.arrays.gravity
    sentences = tuple(
        direction_words(groups, direction, float(size), options.near, up)
        for direction, size in zip(values["direction"], values["spread"], strict=True)
    )
    return ContactIntervals(
        time=tension.time[chosen], frames=chosen, groups=groups, sentences=sentences, **values
    )


def open_bounds(
    problem: TensionProblem, solved: SolvedFrames, options: CertificateOptions
) -> tuple[Array, Array]:
    """Bounds (frames, variables) of what the data leave open: see `CertificateOptions`."""
    x = solved.x
    shared = solved.shared
    lower = np.tile(shared.lower, (len(solved), 1))
    upper = np.tile(shared.upper, (len(solved), 1))
    tree = problem.assembly.tree
    for number, actuator in enumerate(problem.actuators.actuators):
        i = solved.muscles + number
        bounded = np.isfinite([actuator.min_control, actuator.max_control]).all()
        if bounded and not actuator.name.startswith(RESIDUAL):
            continue
        more = options.reserve
        if actuator.name.startswith(RESIDUAL):
            more = options.residual * subject_weight(tree, actuator.body)
        reach = np.abs(x[:, i]) + more / actuator.optimal_force
        lower[:, i], upper[:, i] = np.maximum(lower[:, i], -reach), np.minimum(upper[:, i], reach)
    targeted = (solved.penalties[:, 2] > 0.0) & (solved.penalties[:, 1] > solved.penalties[:, 0])
    lower = np.where(targeted, np.maximum(lower, np.minimum(solved.penalties[:, 0], x)), lower)
    upper = np.where(targeted, np.minimum(upper, np.maximum(solved.penalties[:, 1], x)), upper)
    assert problem.contacts is not None
    measured_rows = np.concatenate(
        [np.full(len(row), row.measured) for row in problem.rows] or [np.zeros(0, np.bool_)]
    )
    measured = len(problem.unknowns) + np.flatnonzero(measured_rows)
    reach = np.maximum(np.abs(x[:, measured]), options.deviations)
    lower[:, measured] = -reach
    upper[:, measured] = reach
    # A site that does not touch pushes nobody, whatever its amplitude.
    silent = np.zeros(lower.shape, np.bool_)
    silent[:, solved.controls : solved.amplitudes] = problem.contacts.amounts[solved.frames] == 0.0
    lower = np.where(silent, x, lower)
    upper = np.where(silent, x, upper)
    return np.minimum(lower, x), np.maximum(upper, x)


def group_functions(
    problem: TensionProblem, solved: SolvedFrames, members: Sequence[Array]
) -> Array:
    """Net force and force along the cones of groups, linear in the variables: (frames, groups, 4,
    variables) [N].
    """
    assert problem.contacts is not None
    generators = problem.contacts.generators
    _, _, pushes, _ = generators.evaluate(problem.coordinates[solved.frames])
    amounts = problem.contacts.amounts[solved.frames]
    result = np.zeros((len(solved), len(members), 4, solved.x.shape[1]))
    place = slice(solved.controls, solved.amplitudes)
    for g, mine in enumerate(members):
        result[:, g, :3, place] = (
            np.where(mine[:, None], pushes, 0.0).swapaxes(1, 2) * amounts[:, None]
        )
        result[:, g, 3, place] = np.where(mine, generators.normal, 0.0) * amounts
    return result


def _part(
    problem: TensionProblem,
    tension: Tension,
    frames: np.ndarray,
    members: Sequence[Array],
    options: CertificateOptions,
) -> dict[str, Array]:
    """Fields of `ContactIntervals` of a few frames."""
    solved = solved_frames(problem, tension, frames)
    functions = group_functions(problem, solved, members)
    lower, upper = open_bounds(problem, solved, options)
    shape = (len(frames), len(members))
    result = np.einsum("fgin,fn->fgi", functions, solved.x)
    least = np.full((*shape, 2, 4), np.nan)
    good = np.flatnonzero(tension.status[frames] == OPTIMAL)

    def extend(start: int, stop: int) -> None:
        for number in good[start:stop]:
            costs = np.stack([functions[number], -functions[number]], axis=1).reshape(
                -1, functions.shape[-1]
            )
            values = np.empty(len(costs))
            points = np.empty(costs.shape)
            least_values(
                solved.A[number],
                solved.x[number],
                lower[number],
                upper[number],
                costs,
                values,
                points,
            )
            least[number] = values.reshape(len(members), 2, 4)

    over_frames(extend, len(good), chunk=4)
    low = least[:, :, 0] + 0.0
    high = 0.0 - least[:, :, 1]
    near = np.full((2, *shape, 3), np.nan)
    if options.near > 0.0 and len(good):
        bounds = lower[good], upper[good]
        near[:, good] = near_extremes(solved.of(good), bounds, functions[good, :, :3], options.near)
    direction, spread = _least_determined(solved, good, functions[..., :3, :], options.near)
    return {
        "forces": result[..., :3],
        "low": low[..., :3],
        "high": high[..., :3],
        "normal": result[..., 3],
        "normal_low": low[..., 3],
        "normal_high": high[..., 3],
        "near_low": near[0],
        "near_high": near[1],
        "direction": direction,
        "spread": spread,
    }


def _least_determined(
    solved: SolvedFrames, good: np.ndarray, functions: Array, near: float
) -> tuple[Array, Array]:
    """The direction in which forces give way most as the cost grows, and how far they go.
    With D the inverse curvature of the variables that are off their bounds, forces S x give way by
    C = S (D - D A^T (A D A^T)^-1 A D) S^T: the cost grows by a^2 / (2 v^T C v) along its first
    eigenvector v.
    """
    frames, groups = functions.shape[:2]
    direction = np.full((frames, groups, 3), np.nan)
    spread = np.full(frames, np.nan)
    if not len(good) or near == 0.0:
        return direction, spread
    x = solved.x[good]
    A = solved.A[good]
    margin = ON_BOUND * (1.0 + np.abs(x))
    inside = (x > solved.shared.lower + margin) & (x < solved.shared.upper - margin)
    D = np.where(inside, 1.0 / solved.curvature(solved.x)[good], 0.0)
    S = functions[good].reshape(len(good), -1, x.shape[1])
    AD = A * D[:, None]
    stiff = np.linalg.pinv(AD @ A.swapaxes(1, 2), rcond=1e-13, hermitian=True)
    taken = AD @ S.swapaxes(1, 2)
    C = (S * D[:, None]) @ S.swapaxes(1, 2) - taken.swapaxes(1, 2) @ stiff @ taken
    size, vectors = np.linalg.eigh(0.5 * (C + C.swapaxes(1, 2)))
    first = vectors[:, :, -1]
    # The sign is free: the greatest part points along its axis.
    greatest = np.take_along_axis(first, np.abs(first).argmax(axis=1)[:, None], axis=1)
    direction[good] = (first * np.sign(greatest)).reshape(-1, groups, 3)
    cost = solved.cost(solved.x)[good]
    spread[good] = np.sqrt(2.0 * np.maximum(size[:, -1], 0.0) * near * cost)
    return direction, spread
