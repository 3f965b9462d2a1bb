"""Certificates of the tension problem: what the data leave open of contact forces.

Physics gives many contact forces that would do. For each frame and group of sites,

    low, high = least and greatest S x   over   A x = b,  lower <= x <= upper

with S x the net force of the group: every force that equations of motion, cones, bounds of activations, what was
measured and reserves no greater than used (and a tolerance) allow. What effort and EMG prefer is asked for apart: the
same over those x whose cost is within a share of the one found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadData
from myomorph.rigid.frames import over_frames
from myomorph.tension.dual import OPTIMAL
from myomorph.tension.problem import TensionProblem
from myomorph.tension.simplex import least_values
from myomorph.tension.solved import SolvedFrames, near_extremes, solved_frames, subject_weight
from myomorph.tension.tension import RESIDUAL, Tension

PART = 0.35  # A group whose part of a unit combination is smaller is not named


def axis_words(vector: Array, up: Array) -> str:
    """The axis that a vector (3,) is most along: "vertically", or "along x" of the ground's axes across `up`."""
    height = up / (np.linalg.norm(up) or 1.0)
    along = float(vector @ height)
    across = vector - along * height
    if abs(along) >= np.linalg.norm(across):
        return "vertically"
    return f"along {'xyz'[int(np.abs(across).argmax())]}"


def direction_words(groups: Sequence[str], direction: Array, spread: float, share: float, up: Array) -> str:
    """One clause on a unit combination (groups, 3) of contact forces, "" where it is unknown.
    `spread`: how far forces may go along it [N] at `share` more of the cost; `up` (3,) away from gravity.
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

    # what residuals at a body that floats may give beyond what they gave, as a share of its subject's weight [1, times
    # 1 m for moments]
    residual: float = 0.01
    reserve: float = 1.0  # what reserves and actuators without bounds may give beyond what they gave [N m or N]
    # how far a measured force may be missed, in standard deviations, where it was not missed by more
    deviations: float = 2.0
    # share of the cost by which solutions may be worse that still count as near the optimum, 0 to leave out
    near: float = 0.05

    def __post_init__(self) -> None:
        for name in ("residual", "reserve", "deviations", "near"):
            if not getattr(self, name) >= 0.0:
                raise BadData(f"{name} of certificates is {getattr(self, name):g}: expected 0 or more")


@read_only
class ContactIntervals:
    """What the data leave open of contact forces, frame by frame."""

    # time, frames: (frames,) [s], numbers in the motion
    time: Array
    frames: np.ndarray
    groups: tuple[str, ...]  # names
    forces: Array  # (frames, groups, 3) net forces that were found, in ground [N]
    # low, high: (frames, groups, 3) least and greatest of each component that the data allow [N]; NaN where the frame
    # was not solved, infinite where nothing bounds them
    low: Array
    high: Array
    # normal, normal_low, normal_high: (frames, groups) the same of the force along the cones [N]
    normal: Array
    normal_low: Array
    normal_high: Array
    # near_low, near_high: (frames, groups, 3) the same among those of them near the optimum; NaN where not asked for
    near_low: Array
    near_high: Array
    direction: Array  # (frames, groups, 3) the unit combination of the forces that the data and effort determine least
    # (frames,) how far forces may move along it until the cost has grown by the share `near` [N]; like `direction` NaN
    # where not asked for
    spread: Array
    sentences: tuple[str, ...]  # one a frame: what that direction is, "" where not asked for

    def __len__(self) -> int:
        return len(self.time)


def contact_intervals(
    problem: TensionProblem,
    tension: Tension,
    frames: Sequence[int] | None = None,
    options: CertificateOptions | None = None,
) -> ContactIntervals:
    """What the data leave open of the contact forces of solved frames."""
    options = options or CertificateOptions()
    if problem.contacts is None:
        raise BadData("there are no contacts whose forces could be left open: give contacts to the tension problem")
    chosen = _chosen(tension, frames)
    groups, members = _groups(problem)
    parts = []
    for start in range(0, len(chosen), 64):
        with threadpool_limits(1, "blas"):
            parts.append(_part(problem, tension, chosen[start : start + 64], groups, members, options))
    forces, low, high, near_low, near_high, normal = (
        np.concatenate(item) for item in zip(*(p[:6] for p in parts), strict=True)
    )
    direction, spread = (np.concatenate(item) for item in zip(*(p[6:] for p in parts), strict=True))
    up = -problem.assembly.tree.arrays.gravity
    sentences = tuple(
        direction_words(groups, item, float(size), options.near, up)
        for item, size in zip(direction, spread, strict=True)
    )
    return ContactIntervals(
        tension.time[chosen], chosen, groups, forces, low[..., :3], high[..., :3], normal, low[..., 3], high[..., 3],
        near_low, near_high, direction, spread, sentences,
    )  # fmt: skip


def open_bounds(problem: TensionProblem, solved: SolvedFrames, options: CertificateOptions) -> tuple[Array, Array]:
    """Bounds (frames, variables) of what the data leave open: see `CertificateOptions`."""
    x, shared = solved.x, solved.shared
    lower, upper = (np.tile(values, (len(solved), 1)) for values in (shared.lower, shared.upper))
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
    told = (solved.penalties[:, 2] > 0.0) & (solved.penalties[:, 1] > solved.penalties[:, 0])
    lower = np.where(told, np.maximum(lower, np.minimum(solved.penalties[:, 0], x)), lower)
    upper = np.where(told, np.minimum(upper, np.maximum(solved.penalties[:, 1], x)), upper)
    assert problem.contacts is not None
    measured_rows = np.concatenate([np.full(len(row), row.measured) for row in problem.rows] or [np.zeros(0, np.bool_)])
    measured = len(problem.unknowns) + np.flatnonzero(measured_rows)
    reach = np.maximum(np.abs(x[:, measured]), options.deviations)
    lower[:, measured], upper[:, measured] = -reach, reach
    # A site that does not touch pushes nobody, whatever its amplitude.
    silent = np.zeros(lower.shape, np.bool_)
    silent[:, solved.controls : solved.amplitudes] = problem.contacts.amounts[solved.frames] == 0.0
    lower, upper = np.where(silent, x, lower), np.where(silent, x, upper)
    return np.minimum(lower, x), np.maximum(upper, x)


def group_functions(problem: TensionProblem, solved: SolvedFrames, members: Sequence[Array]) -> Array:
    """Net force and force along the cones of groups, linear in the variables: (frames, groups, 4, variables) [N]."""
    assert problem.contacts is not None
    generators = problem.contacts.generators
    _, _, pushes, _ = generators.evaluate(problem.coordinates[solved.frames])
    amounts = problem.contacts.amounts[solved.frames]
    result = np.zeros((len(solved), len(members), 4, solved.x.shape[1]))
    place = slice(solved.controls, solved.amplitudes)
    for g, mine in enumerate(members):
        result[:, g, :3, place] = np.where(mine[:, None], pushes, 0.0).swapaxes(1, 2) * amounts[:, None]
        result[:, g, 3, place] = np.where(mine, generators.normal, 0.0) * amounts
    return result


def _part(
    problem: TensionProblem,
    tension: Tension,
    frames: np.ndarray,
    groups: tuple[str, ...],
    members: Sequence[Array],
    options: CertificateOptions,
) -> tuple[Array, ...]:
    """Forces, low, high, near_low, near_high, normal, direction, spread of a few frames."""
    solved = solved_frames(problem, tension, frames)
    functions = group_functions(problem, solved, members)
    lower, upper = open_bounds(problem, solved, options)
    shape = (len(frames), len(groups))
    result = np.einsum("fgin,fn->fgi", functions, solved.x)
    least = np.full((*shape, 2, 4), np.nan)
    good = np.flatnonzero(tension.status[frames] == OPTIMAL)

    def extend(start: int, stop: int) -> None:
        for number in good[start:stop]:
            costs = np.stack([functions[number], -functions[number]], axis=1).reshape(-1, functions.shape[-1])
            values, points = np.empty(len(costs)), np.empty(costs.shape)
            least_values(solved.A[number], solved.x[number], lower[number], upper[number], costs, values, points)
            least[number] = values.reshape(len(groups), 2, 4)

    over_frames(extend, len(good), chunk=4)
    low, high = least[:, :, 0] + 0.0, 0.0 - least[:, :, 1]
    near = np.full((2, *shape, 3), np.nan)
    if options.near > 0.0 and len(good):
        bounds = lower[good], upper[good]
        near[:, good] = near_extremes(solved.of(good), bounds, functions[good, :, :3], options.near)
    direction, spread = _least_determined(solved, good, functions[..., :3, :], options.near)
    return result[..., :3], low, high, near[0], near[1], result[..., 3], direction, spread


def _least_determined(solved: SolvedFrames, good: np.ndarray, functions: Array, near: float) -> tuple[Array, Array]:
    """The direction in which forces give way most as the cost grows, and how far they go.
    With D the inverse curvature of the variables that are off their bounds, forces S x give way by
    C = S (D - D A^T (A D A^T)^-1 A D) S^T: the cost grows by a^2 / (2 v^T C v) along its first eigenvector v.
    """
    frames, groups = functions.shape[:2]
    direction, spread = np.full((frames, groups, 3), np.nan), np.full(frames, np.nan)
    if not len(good) or near == 0.0:
        return direction, spread
    x, A = solved.x[good], solved.A[good]
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


def _groups(problem: TensionProblem) -> tuple[tuple[str, ...], list[Array]]:
    """Names of groups in the order of their first site, and which generators belong to each."""
    assert problem.contacts is not None
    generators = problem.contacts.generators
    labels = [site.group for site in generators.sites]
    names = tuple(dict.fromkeys(labels))
    return names, [np.array([labels[number] == name for number in generators.site]) for name in names]


def _chosen(tension: Tension, frames: Sequence[int] | None) -> np.ndarray:
    chosen = np.arange(len(tension)) if frames is None else np.asarray(frames, np.int64)
    if not len(chosen):
        raise BadData("no frame is asked for")
    if not (chosen.min() >= 0 and chosen.max() < len(tension)):
        raise BadData(f"frame {chosen.max()} is asked for, but the tensions have {len(tension)}")
    return chosen
