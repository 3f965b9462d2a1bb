"""Certificates of the tension problem: what the data leave open of contact forces.

Physics gives many contact forces that would do. For each frame and group of sites,

    low, high = least and greatest S x   over   A x = b,  lower <= x <= upper

with S x the net force of the group: every force that equations of motion, cones, bounds of
activations, what was measured and reserves no greater than used (and a tolerance) allow. What
effort and EMG prefer is asked for apart: the same over those x whose cost is within a share of the
optimum, at

    x(s) = argmin cost(x) + s c^T x

for the s at which its cost reaches the level: one more problem of the same form, with targets moved
by -s c / (2 w), whose cost grows with s. Near the optimum it grows with s^2, which gives the next
s.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.rigid.frames import over_frames
from myomorph.core.tension.dual import OPTIMAL
from myomorph.core.tension.problem import Balance, TensionProblem, solve_frames
from myomorph.core.tension.separable import Separable
from myomorph.core.tension.simplex import Polytope, least_values
from myomorph.core.tension.tension import RESIDUAL, Tension
from myomorph.core.tension.terms.cones import ConeGenerators, subject_weight

CLOSE = 0.02
"""Share of the allowed increase of the cost that may be left."""
MAX_COUNT = 12
"""Number of values of s that are tried."""
PART = 0.35
"""A group whose part of a unit combination is smaller is not named."""
ON_BOUND = 1e-7
"""A variable nearer to a bound than this share of 1 + its size stands on it."""


@read_only
class SolvedFrames:
    """Some frames of a solved problem: minimise cost(x), A x = b, lower <= x <= upper.

    Unknowns are activations, controls, amplitudes of contacts, and others that terms bring in.

    Attributes
    ----------
    frames : (frames,) their numbers in the motion
    A : (frames, rows, variables)
    b : (frames, rows)
    x : (frames, variables) the solution, NaN where a frame was not solved
    shared : weights, exponents and bounds of all frames
    penalties : (frames, 3, variables) as of `solve_separable`
    values : (frames, entries) of A as `TensionProblem.balance` gives them
    muscles, controls, amplitudes : where activations, controls, and amplitudes end among the
        variables
    """

    frames: NDArray[np.int64]
    A: Array
    b: Array
    x: Array
    shared: Separable
    penalties: Array
    values: Array
    muscles: int
    controls: int
    amplitudes: int

    def __len__(self) -> int:
        return len(self.frames)

    def of(self, places: NDArray[np.int64]) -> SolvedFrames:
        """Choose some of these frames.

        Parameters
        ----------
        places : (chosen,) counted among these

        Returns
        -------
        the chosen ones
        """
        return replace(
            self,
            frames=self.frames[places],
            A=self.A[places],
            b=self.b[places],
            x=self.x[places],
            penalties=self.penalties[places],
            values=self.values[places],
        )

    def cost(self, x: Array) -> Array:
        """Cost of variables, smoothness between frames apart.

        Parameters
        ----------
        x : (frames, ..., variables)

        Returns
        -------
        (frames, ...)
        """
        penalties = self.penalties.reshape(len(self), 3, *(1,) * (x.ndim - 2), x.shape[-1])
        below = np.maximum(penalties[:, 0] - x, 0.0)
        above = np.maximum(x - penalties[:, 1], 0.0)
        pulled = np.where(penalties[:, 2] > 0.0, penalties[:, 2] * (below**2 + above**2), 0.0)
        return (self.shared.weight * np.abs(x) ** self.shared.exponent + pulled).sum(axis=-1)

    def curvature(self, x: Array) -> Array:
        """Second derivatives of the cost, above 0.

        Parameters
        ----------
        x : (frames, variables)

        Returns
        -------
        (frames, variables)
        """
        w = self.shared.weight
        p = self.shared.exponent
        outside = (x <= self.penalties[:, 0]) | (x >= self.penalties[:, 1])
        pulled = np.where((self.penalties[:, 2] > 0.0) & outside, 2.0 * self.penalties[:, 2], 0.0)
        # With p other than 2 the curvature at 0 is 0 or infinite: taken a little beside it.
        return p * (p - 1.0) * w * np.maximum(np.abs(x), 1e-6) ** (p - 2.0) + pulled


def solved_frames(
    problem: TensionProblem, tension: Tension, frames: NDArray[np.int64]
) -> SolvedFrames:
    """Frames of a problem that was solved.

    Parameters
    ----------
    problem, tension : solved, and its result
    frames : (frames,) their numbers in the motion

    Returns
    -------
    their balance, and the solution
    """
    balance = _balance(problem, frames)
    A = problem.separable.dense(balance.values)
    n = A.shape[2]
    muscles = len(tension.muscles)
    controls = muscles + tension.actuator_force.shape[1]
    # What the result says counts, and the unknowns of rows follow from the others.
    first = len(problem.unknowns)
    x = np.zeros((len(frames), n))
    x[:, :first] = problem.x_of(frames)[:, :first]
    x[:, :muscles] = tension.activation[frames]
    x[:, muscles:controls] = tension.actuator_force[frames] / problem.actuators.optimal_forces
    if problem.added_rows:
        missing = np.einsum("frn,fn->fr", A, x) - balance.right
        units = np.concatenate([row.unit for row in problem.added_rows])
        x[:, first:] = missing[:, problem.assembly.extra_row] / units
    return SolvedFrames(
        frames=frames,
        A=A,
        b=balance.right,
        x=x,
        shared=problem.separable,
        penalties=np.broadcast_to(problem.penalties[frames], (len(frames), 3, n)),
        values=balance.values,
        muscles=muscles,
        controls=controls,
        amplitudes=controls + problem.amplitudes.shape[1],
    )


def _balance(problem: TensionProblem, frames: NDArray[np.int64]) -> Balance:
    """Balance of some frames (frames,): a run of frames at once, others one by one."""
    spans = [(int(frame), int(frame) + 1) for frame in frames]
    if len(frames) and int(frames[-1] - frames[0]) == len(frames) - 1:
        spans = [(int(frames[0]), int(frames[-1]) + 1)]
    parts = [problem.balance(*span) for span in spans]
    return Balance._make(np.concatenate(arrays) for arrays in zip(*parts, strict=True))


class Bounds(NamedTuple):
    """Bounds of variables, (frames, variables) each."""

    lower: Array
    upper: Array


def near_extremes(solved: SolvedFrames, bounds: Bounds, functions: Array, share: float) -> Array:
    """Least and greatest values of linear functions of amplitudes, near the optimum.

    Parameters
    ----------
    solved : solved frames
    bounds : with the solution between them
    functions : (frames, groups, 3, variables) of variables whose exponent is 2 alone
    share : of the solution's cost, by which the cost may increase

    Returns
    -------
    (2, frames, groups, 3) least, greatest
    """
    frames, groups = functions.shape[:2]
    costs = np.stack([functions, -functions], axis=1).reshape(frames, -1, functions.shape[-1])
    solution_cost = solved.cost(solved.x)
    # The solution may be dearer than each frame alone has to be, for the sake of the frames beside
    # it.
    alone = _solve(solved, bounds, np.zeros((frames, 1, costs.shape[2])))
    min_cost = np.fmin(solved.cost(alone)[:, 0], solution_cost)
    allowed = ((1.0 + share) * solution_cost - min_cost)[:, None]
    best = np.fmin(
        np.einsum("fkn,fn->fk", costs, solved.x), np.einsum("fkn,fn->fk", costs, alone[:, 0])
    )
    search = _LevelSearch(costs, allowed, best)
    for _ in range(MAX_COUNT):
        x = _solve(solved, bounds, search.s[..., None] * costs)
        increase = solved.cost(x) - min_cost[:, None]
        search.take(increase, np.einsum("fkn,fkn->fk", costs, x))
        if search.done.all():
            break
    ends = search.best.reshape(frames, 2, groups, 3)
    return np.stack([ends[:, 0], -ends[:, 1]])


class _LevelSearch:
    """Search for the s at which the cost of x(s) has grown to what is allowed.

    Every array is (frames, functions).

    Attributes
    ----------
    s : the next to try
    best : least value of each function with an allowed cost
    done : whether the cost is near enough to what is allowed
    """

    def __init__(self, costs: Array, allowed: Array, best: Array):
        """Begin.

        Parameters
        ----------
        costs : (frames, functions, variables)
        allowed : (frames, 1) increase of the cost
        best : (frames, functions) values that are known to be allowed
        """
        # A first s from the size of each function: the cost of a body weight is of the size of the
        # effort.
        size = np.abs(costs).max(axis=2)
        self.s = np.where(size > 0.0, np.sqrt(allowed) / np.maximum(size, 1e-300), 0.0)
        self.best = best
        self.done = (size == 0.0) | ~(allowed > 0.0)
        self._allowed = allowed
        self._under = np.zeros(self.s.shape)
        self._over = np.full(self.s.shape, np.inf)

    def take(self, increase: Array, values: Array) -> None:
        """Learn from the x of s, and choose the next s.

        The cost grows with s^2 near the optimum; where that leads out of the bracket, it is
        bisected.

        Parameters
        ----------
        increase, values : (frames, functions) increase of the cost, and values of the functions
        """
        s = self.s
        inside = (increase <= self._allowed) & np.isfinite(increase)
        self.best = np.where(inside & ~self.done, np.minimum(self.best, values), self.best)
        self.done |= inside & (increase >= (1.0 - CLOSE) * self._allowed)
        self._under = np.where(inside, np.maximum(self._under, s), self._under)
        self._over = np.where(inside, self._over, np.minimum(self._over, s))
        wanted = (1.0 - 0.5 * CLOSE) * self._allowed
        factor = np.sqrt(wanted / np.maximum(increase, 1e-12 * self._allowed))
        guess = s * np.clip(np.nan_to_num(factor, nan=0.1), 0.1, 10.0)
        bracketed = np.isfinite(self._over)
        middle = np.where(bracketed, 0.5 * (self._under + self._over), guess)
        leaves = (guess <= self._under) | (guess >= self._over)
        self.s = np.where(self.done, s, np.where(leaves, middle, guess))


def _solve(solved: SolvedFrames, bounds: Bounds, tilt: Array) -> Array:
    """Find the x of least cost(x) + tilt^T x.

    Parameters
    ----------
    tilt : (frames, many, variables)

    Returns
    -------
    (frames, many, variables), NaN where there is none
    """
    frames, many, n = tilt.shape
    x = np.empty((frames, many, n))
    targets = -0.5 * tilt / solved.shared.weight

    def part(start: int, stop: int) -> None:
        for index in range(start, stop):
            values = np.repeat(solved.values[index][None], many, axis=0)
            right = np.repeat(solved.b[index][None], many, axis=0)
            shared = solved.shared._replace(
                lower=frozen_array(bounds.lower[index]), upper=frozen_array(bounds.upper[index])
            )
            penalties = np.array(solved.penalties[index])[None]
            tilted = solve_frames(shared, values, right, penalties, targets=targets[index])
            x[index] = tilted.x
            x[index, tilted.status != OPTIMAL] = np.nan

    over_frames(part, frames, chunk=4)
    return x


def axis_words(vector: Array, up: Array) -> str:
    """Axis that a vector is most along, in words.

    Parameters
    ----------
    vector, up : (3,) in ground, `up` away from gravity

    Returns
    -------
    "vertically", or "along x" of the ground's axes across `up`
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
    """Clause on a unit combination of contact forces, "" where it is unknown.

    Parameters
    ----------
    groups : names
    direction : (groups, 3)
    spread : how far forces may go along it [N] at `share` more of the cost
    share : of the cost, by which it may grow
    up : (3,) away from gravity

    Returns
    -------
    such as "shifting force between 'foot_r' and 'foot_l' along z, by 12 N for 5 % more cost"
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
        change = f"the force at {names[0]} {words}"
    elif first @ direction[order[1]] < 0.0:
        change = f"shifting force between {names[0]} and {names[1]} {words}"
    else:
        change = f"the forces at {names[0]} and {names[1]} together {words}"
    return f"{change}, by {spread:.3g} N for {100.0 * share:g} % more cost"


@dataclass(frozen=True)
class CertificateOptions:
    """What counts as left open.

    Attributes
    ----------
    residual : what residuals at a body that floats may give beyond what they gave, as a share of
        its subject's weight [1, times 1 m for moments]
    reserve : what reserves and actuators without bounds may give beyond what they gave [N m or N]
    deviations : how far a measured force may be missed, in standard deviations, where it was not
        missed by more
    near : share of the cost by which solutions may be worse that still count as near the optimum,
        0 to leave out
    """

    residual: float = 0.01
    reserve: float = 1.0
    deviations: float = 2.0
    near: float = 0.05

    def __post_init__(self) -> None:
        for name in ("residual", "reserve", "deviations", "near"):
            if not getattr(self, name) >= 0.0:
                raise BadData(
                    f"{name} of certificates is {getattr(self, name):g}: expected 0 or more"
                )


@read_only
class ContactIntervals:
    """What the data leave open of contact forces, frame by frame.

    Attributes
    ----------
    time : (frames,) [s]
    frames : (frames,) numbers in the motion
    groups : names
    forces : (frames, groups, 3) net forces of the solution, in ground [N]
    low, high : (frames, groups, 3) least and greatest of each component that the data allow [N];
        NaN where the frame was not solved, infinite where nothing bounds them
    normal, normal_low, normal_high : (frames, groups) the same of the force along the cones [N]
    near_low, near_high : (frames, groups, 3) the same among those of them near the optimum; NaN
        where not asked for
    direction : (frames, groups, 3) the unit combination of the forces that the data and effort
        determine least
    spread : (frames,) how far forces may move along it until the cost has grown by the share `near`
        [N]; like `direction` NaN where not asked for
    sentences : one per frame: what that direction is, "" where not asked for
    """

    time: Array
    frames: np.ndarray
    groups: tuple[str, ...]
    forces: Array
    low: Array
    high: Array
    normal: Array
    normal_low: Array
    normal_high: Array
    near_low: Array
    near_high: Array
    direction: Array
    spread: Array
    sentences: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time)


def contact_intervals(  # page: the frames, options and progress are optional
    problem: TensionProblem,
    tension: Tension,
    frames: Sequence[int] | None = None,
    options: CertificateOptions | None = None,
    advance: Callable[[int], None] = lambda done: None,
    at_once: int = 64,
) -> ContactIntervals:
    """Find what the data leave open of the contact forces of solved frames.

    Parameters
    ----------
    problem, tension : solved, and its result
    frames : numbers in the motion; all by default
    options : settings
    advance : called with the number of frames just done
    at_once : frames that are held in memory together

    Raises
    ------
    BadData : the problem has no contacts, or frames that the tensions do not have
    """
    options = options or CertificateOptions()
    if problem.contacts is None:
        raise BadData(
            "there are no contacts whose forces could be left open: give contacts to the tension"
            " problem"
        )
    chosen = _chosen_frames(tension, frames)
    groups = _Groups.of(problem.contacts.generators)
    parts = []
    for start in range(0, len(chosen), at_once):
        some = chosen[start : start + at_once]
        with threadpool_limits(1, "blas"):
            parts.append(_intervals(problem, tension, some, groups, options))
        advance(len(some))
    return _joined(parts)


def _chosen_frames(tension: Tension, frames: Sequence[int] | None) -> NDArray[np.int64]:
    """Numbers of the frames that are asked for, all by default; refuses none and others."""
    chosen = np.arange(len(tension)) if frames is None else np.asarray(frames, np.int64)
    if not len(chosen):
        raise BadData("no frame is requested")
    if not (chosen.min() >= 0 and chosen.max() < len(tension)):
        raise BadData(f"frame {chosen.max()} is requested, but the tensions have {len(tension)}")
    return chosen


@read_only
class _Groups:
    """Groups in the order of their first site, and the generators of each.

    Attributes
    ----------
    names : of the groups
    members : per group, (generators,) whether a generator belongs to it
    """

    names: tuple[str, ...]
    members: list[NDArray[np.bool_]]

    @staticmethod
    def of(generators: ConeGenerators) -> _Groups:
        """Find them from the sites."""
        names = tuple(dict.fromkeys(site.group for site in generators.sites))
        owners = [generators.sites[number].group for number in generators.site]
        members = [np.array([owner == name for owner in owners]) for name in names]
        return _Groups(names, members)


def _joined(parts: Sequence[ContactIntervals]) -> ContactIntervals:
    """Intervals of all frames, one part after the other."""
    sentences = tuple(sentence for part in parts for sentence in part.sentences)
    return ContactIntervals(
        time=np.concatenate([part.time for part in parts]),
        frames=np.concatenate([part.frames for part in parts]),
        groups=parts[0].groups,
        forces=np.concatenate([part.forces for part in parts]),
        low=np.concatenate([part.low for part in parts]),
        high=np.concatenate([part.high for part in parts]),
        normal=np.concatenate([part.normal for part in parts]),
        normal_low=np.concatenate([part.normal_low for part in parts]),
        normal_high=np.concatenate([part.normal_high for part in parts]),
        near_low=np.concatenate([part.near_low for part in parts]),
        near_high=np.concatenate([part.near_high for part in parts]),
        direction=np.concatenate([part.direction for part in parts]),
        spread=np.concatenate([part.spread for part in parts]),
        sentences=sentences,
    )


def open_bounds(
    problem: TensionProblem, solved: SolvedFrames, options: CertificateOptions
) -> Bounds:
    """Bounds of what the data leave open: see `CertificateOptions`."""
    assert problem.contacts is not None
    x = solved.x
    lower = np.tile(solved.shared.lower, (len(solved), 1))
    upper = np.tile(solved.shared.upper, (len(solved), 1))
    _bound_actuators(problem, solved, options, Bounds(lower, upper))

    # Of an interval penalty the whole interval is open, and what lies beyond it as far as x does.
    low, high, pull = np.moveaxis(solved.penalties, 1, 0)
    targeted = (pull > 0.0) & (high > low)
    lower = np.where(targeted, np.maximum(lower, np.minimum(low, x)), lower)
    upper = np.where(targeted, np.minimum(upper, np.maximum(high, x)), upper)

    are_measured = [np.full(len(row), row.measured) for row in problem.added_rows]
    are_measured = are_measured or [np.zeros(0, np.bool_)]
    measured = len(problem.unknowns) + np.flatnonzero(np.concatenate(are_measured))
    max_miss = np.maximum(np.abs(x[:, measured]), options.deviations)
    lower[:, measured] = -max_miss
    upper[:, measured] = max_miss

    # A site that does not touch pushes nobody, whatever its amplitude.
    silent = np.zeros(lower.shape, np.bool_)
    silent[:, solved.controls : solved.amplitudes] = problem.contacts.amounts[solved.frames] == 0.0
    lower = np.where(silent, x, lower)
    upper = np.where(silent, x, upper)
    return Bounds(lower=np.minimum(lower, x), upper=np.maximum(upper, x))


def _bound_actuators(
    problem: TensionProblem, solved: SolvedFrames, options: CertificateOptions, bounds: Bounds
) -> None:
    """Narrow the bounds of residuals, reserves and actuators without bounds, in place."""
    tree = problem.assembly.tree
    for number, actuator in enumerate(problem.actuators.actuators):
        i = solved.muscles + number
        is_residual = actuator.name.startswith(RESIDUAL)
        bounded = np.isfinite([actuator.min_control, actuator.max_control]).all()
        if bounded and not is_residual:
            continue
        more = options.reserve
        if is_residual:
            more = options.residual * subject_weight(tree, actuator.body)
        max_control = np.abs(solved.x[:, i]) + more / actuator.optimal_force
        bounds.lower[:, i] = np.maximum(bounds.lower[:, i], -max_control)
        bounds.upper[:, i] = np.minimum(bounds.upper[:, i], max_control)


def group_functions(
    problem: TensionProblem, solved: SolvedFrames, members: Sequence[NDArray[np.bool_]]
) -> Array:
    """Net force and force along the cones of groups, linear in the variables.

    Parameters
    ----------
    problem : solved, with contacts
    solved : solved frames
    members : per group, (generators,) whether a generator belongs to it

    Returns
    -------
    (frames, groups, 4, variables) [N]
    """
    assert problem.contacts is not None
    generators = problem.contacts.generators
    pushes = generators.evaluate(problem.coordinates[solved.frames]).pushes
    amounts = problem.contacts.amounts[solved.frames]
    result = np.zeros((len(solved), len(members), 4, solved.x.shape[1]))
    place = slice(solved.controls, solved.amplitudes)
    for g, belongs in enumerate(members):
        result[:, g, :3, place] = (
            np.where(belongs[:, None], pushes, 0.0).swapaxes(1, 2) * amounts[:, None]
        )
        result[:, g, 3, place] = np.where(belongs, generators.normal, 0.0) * amounts
    return result


def _intervals(
    problem: TensionProblem,
    tension: Tension,
    frames: NDArray[np.int64],
    groups: _Groups,
    options: CertificateOptions,
) -> ContactIntervals:
    """Intervals of a few frames (frames,), by their numbers in the motion."""
    solved = solved_frames(problem, tension, frames)
    functions = group_functions(problem, solved, groups.members)
    bounds = open_bounds(problem, solved, options)
    good = np.flatnonzero(tension.status[frames] == OPTIMAL)
    forces = np.einsum("fgin,fn->fgi", functions, solved.x)
    extremes = _extremes(solved, bounds, functions, good)
    low = extremes[:, :, 0] + 0.0
    high = 0.0 - extremes[:, :, 1]
    near = np.full((2, len(frames), len(groups.names), 3), np.nan)
    if options.near > 0.0 and len(good):
        of_good = Bounds(bounds.lower[good], bounds.upper[good])
        near[:, good] = near_extremes(
            solved.of(good), of_good, functions[good, :, :3], options.near
        )
    direction, spread = _least_determined(solved, good, functions[..., :3, :], options.near)
    up = -problem.assembly.tree.arrays.gravity
    return ContactIntervals(
        time=tension.time[frames],
        frames=frames,
        groups=groups.names,
        forces=forces[..., :3],
        low=low[..., :3],
        high=high[..., :3],
        normal=forces[..., 3],
        normal_low=low[..., 3],
        normal_high=high[..., 3],
        near_low=near[0],
        near_high=near[1],
        direction=direction,
        spread=spread,
        sentences=tuple(
            direction_words(groups.names, combination, float(size), options.near, up)
            for combination, size in zip(direction, spread, strict=True)
        ),
    )


def _extremes(
    solved: SolvedFrames, bounds: Bounds, functions: Array, good: NDArray[np.int64]
) -> Array:
    """Least values of functions and of their negatives over all that the bounds allow.

    Parameters
    ----------
    functions : (frames, groups, 4, variables)
    good : (solved,) frames that were solved

    Returns
    -------
    (frames, groups, 2, 4), NaN of frames that were not solved
    """
    frames, groups = functions.shape[:2]
    extremes = np.full((frames, groups, 2, 4), np.nan)

    def extend(start: int, stop: int) -> None:
        for number in good[start:stop]:
            both = np.stack([functions[number], -functions[number]], axis=1)
            costs = both.reshape(-1, functions.shape[-1])
            values = np.empty(len(costs))
            points = np.empty(costs.shape)
            polytope = Polytope(
                A=solved.A[number],
                x=solved.x[number],
                lower=bounds.lower[number],
                upper=bounds.upper[number],
            )
            least_values(polytope, costs, values, points)
            extremes[number] = values.reshape(groups, 2, 4)

    over_frames(extend, len(good), chunk=4)
    return extremes


def _least_determined(
    solved: SolvedFrames, good: NDArray[np.int64], functions: Array, near: float
) -> tuple[Array, Array]:
    """Direction in which forces give way most as the cost grows, and how far they go.

    With D the inverse curvature of the variables that are off their bounds, forces S x give way by

        C = S (D - D A^T (A D A^T)^-1 A D) S^T :

    the cost grows by a^2 / (2 v^T C v) along its first eigenvector v.

    Parameters
    ----------
    good : (solved,) frames that were solved
    functions : (frames, groups, 3, variables) S
    near : share of the cost by which it may grow; 0 leaves both out

    Returns
    -------
    (frames, groups, 3) and (frames,) [N], NaN where left out
    """
    frames, groups = functions.shape[:2]
    direction = np.full((frames, groups, 3), np.nan)
    spread = np.full(frames, np.nan)
    if not len(good) or near == 0.0:
        return direction, spread
    S = functions[good].reshape(len(good), -1, functions.shape[-1])
    size, vectors = np.linalg.eigh(_compliance(solved, good, S))
    first = vectors[:, :, -1]
    # The sign is free: the greatest part points along its axis.
    greatest = np.take_along_axis(first, np.abs(first).argmax(axis=1)[:, None], axis=1)
    direction[good] = (first * np.sign(greatest)).reshape(-1, groups, 3)
    cost = solved.cost(solved.x)[good]
    spread[good] = np.sqrt(2.0 * np.maximum(size[:, -1], 0.0) * near * cost)
    return direction, spread


def _compliance(solved: SolvedFrames, good: NDArray[np.int64], S: Array) -> Array:
    """C of `_least_determined`, symmetric (solved, rows of S, rows of S)."""
    x = solved.x[good]
    A = solved.A[good]
    margin = ON_BOUND * (1.0 + np.abs(x))
    inside = (x > solved.shared.lower + margin) & (x < solved.shared.upper - margin)
    D = np.where(inside, 1.0 / solved.curvature(solved.x)[good], 0.0)
    AD = A * D[:, None]
    inverse = np.linalg.pinv(AD @ A.swapaxes(1, 2), rcond=1e-13, hermitian=True)
    taken = AD @ S.swapaxes(1, 2)
    C = (S * D[:, None]) @ S.swapaxes(1, 2) - taken.swapaxes(1, 2) @ inverse @ taken
    return 0.5 * (C + C.swapaxes(1, 2))
