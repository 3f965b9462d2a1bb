"""Contacts that cannot carry the motion: which frames, and the smallest relaxation that would make
them able to.

What carries a subject as a whole is in the equations of motion of its root, where muscles have no
part. Where the contacts leave more there than residuals may give, a linear program asks for the
least that would have to be allowed,

    minimise  sum_k c_k |r_k|   subject to  E z + sum_k D_k r_k + R w = b,   z >= 0,  |w| <= limits

with relaxations r: force at a site that is said not to touch, force across a cone beyond its
friction, force beyond a site's greatest, a pull at a site that only pushes, and, dearest, a
residual. The sum of sizes (1-norm) makes few of them differ from 0, so that the answer has a name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import Cone, Site
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import GROUND
from myomorph.core.rigid.kinematics import center_of_mass, forward_kinematics
from myomorph.core.tension.dual import MISSING
from myomorph.core.tension.problem import TensionProblem
from myomorph.core.tension.simplex import extremes
from myomorph.core.tension.tension import Tension
from myomorph.core.tension.terms.actuators import (
    body_directions,
    compile_body_actuators,
    default_reserves,
    floating_joints,
)
from myomorph.core.tension.terms.cones import ConeGenerators, compile_cones, subject_weight
from myomorph.core.tension.terms.contacts import ContactTerm

Kind = Literal["contact", "friction", "most", "pull", "residual"]


@dataclass(frozen=True)
class Allowance:
    """One thing that would have to be allowed."""

    # "contact": sites that do not touch; "friction": more than the cones'; "most": more than the
    # sites' greatest force; "pull": force the other way; "residual": a force or moment from nowhere
    kind: Kind
    where: str  # the group of the sites, or the body that floats
    # its size, of a "friction" across the cone beyond what was allowed [N], 0 for a moment alone
    force: float
    moment: float = 0.0  # of a residual [N m]
    # of a "friction" the coefficient that would do, of a "contact" how far the nearest of its sites
    # is above where they touch at other times [m]
    needed: float = 0.0

    @property
    def size(self) -> float:
        """The greater of force [N] and moment [N m]."""
        return max(self.force, self.moment)


def what_lacks(touching: Sequence[str], force: Array, moment: Array, up: Array) -> str:
    """What is wrong, as a clause: who may touch, and what is left over.
    `force`, `moment` (3,) that contacts leave [N], [N m]; `up` (3,) unit vector against gravity.
    """
    upward = float(force @ up)
    size = float(np.linalg.norm(force))
    turn = float(np.linalg.norm(moment))
    way = "upward" if upward > 0.7 * size else "downward" if upward < -0.7 * size else "sideways"
    needed = (
        f"{size:.0f} N {way} are needed"
        if size >= turn
        else f"a moment of {turn:.0f} N m is needed"
    )
    if not touching:
        return f"no site may touch, but {needed}"
    return f"sites that touch cannot carry the motion, {needed} beside them"


def what_would_do(allowances: Sequence[Allowance]) -> str:
    """What would have to be allowed, as a clause."""
    return " and ".join(_words(allowance) for allowance in allowances) + " would do"


def _words(allowance: Allowance) -> str:
    if allowance.kind == "contact":
        return (
            f"contact of '{allowance.where}' ({1000.0 * allowance.needed:.0f} mm above its support)"
        )
    if allowance.kind == "friction" and np.isfinite(allowance.needed):
        return f"friction of {allowance.needed:.2f} at '{allowance.where}'"
    if allowance.kind == "friction":
        return f"{allowance.force:.0f} N across the cone of '{allowance.where}'"
    if allowance.kind == "most":
        return f"{allowance.force:.0f} N more at '{allowance.where}' than its greatest force"
    if allowance.kind == "pull":
        return f"a pull of {allowance.force:.0f} N at '{allowance.where}'"
    if allowance.force >= allowance.moment:
        return f"{allowance.force:.0f} N at '{allowance.where}' from nowhere"
    return f"{allowance.moment:.0f} N m at '{allowance.where}' from nowhere"


COSTS: dict[Kind, float] = {
    "contact": 1.0,
    "friction": 1.0,
    "most": 1.0,
    "pull": 2.0,
    "residual": 3.0,
}
"""Cost of one newton, of a residual's newton meter too."""
NEAR = 0.1
"""A contact costs twice as much where its site is by this share of the center of mass' height
farther from where it touches than the nearest site is, and more with the square of that.
"""

LEAST = 0.1
"""Share of the whole weight that a light object is taken to have, so that noise of what is held is
not blamed.
"""
STILL = np.zeros(3)


class Roots:
    """The equations of motion of all bodies that float, in all frames.
    `bodies`: that float; `weights` (bodies,) of the subject or object that each carries, of small
    ones `LEAST` of the whole `weight` [N]; generalized forces of unit forces, `residuals` (frames,
    rows, 6 bodies): and of moments at the bodies' mass centers, `pushes` (frames, rows,
    generators): along the generators of the sites' cones, `axes` (frames, rows, 3 sites): along the
    ground's axes at the middles of the sites; `heights` (frames, sites) of the middles above where
    the sites of their group touch, in the median, above where any do for a group that never touches
    [m]; `center`: median height of the center of mass above the lowest of these places [m]; `z`
    (frames, generators) forces of the solution [N]; `left` (frames, 6 bodies) forces and moments
    that contacts leave [N], [N m].
    """

    def __init__(self, problem: TensionProblem, contacts: ContactTerm, tension: Tension):
        self.problem = problem
        self.contacts = contacts
        tree = problem.assembly.tree
        generators = contacts.generators
        c = problem.coordinates
        roots = floating_joints(tree.model)
        self.bodies = tuple(joint.child for joint in roots)
        self._rows = [
            tree.model.coordinate_names.index(name) for joint in roots for name in joint.coordinates
        ]
        self.poses = forward_kinematics(tree, c)
        self.up = tree.model.up
        self.weight = tree.model.weight
        self.weights = np.maximum(
            [subject_weight(tree, body) for body in self.bodies], LEAST * self.weight
        )
        self.residuals = self._residuals()
        self.pushes = self._dense(generators)
        middles = [
            Site(
                name=s.name,
                body=s.body,
                points=s.points.mean(axis=0)[None],
                cone=Cone(None),
                against=s.against,
            )
            for s in generators.sites
        ]
        between = compile_cones(tree, middles)
        self.axes = self._dense(between)
        _, places, _, _ = between.evaluate(c)
        heights = places @ self.up
        levels = _levels(heights, contacts)
        self.heights = np.maximum(heights - levels, 0.0)
        center = np.nanmedian(center_of_mass(tree, self.poses) @ self.up) - float(levels.min())
        self.center = max(float(center), 1e-3)
        self.z = np.nan_to_num(problem.amplitudes * contacts.amounts)
        # What muscles and reserves give together is, at a root, what contacts and residuals do.
        names = tree.model.coordinate_names
        needed = tension.torques[:, [tension.coordinates.index(names[j]) for j in self._rows]]
        missing = needed - np.einsum("fre,fe->fr", self.pushes, self.z)
        self.left = np.linalg.solve(self.residuals, missing[..., None])[..., 0]

    def direction(self, frame: int, site: int) -> Array:
        """A cone's direction in ground (3,)."""
        cone = self.contacts.generators.sites[site].cone
        assert cone.direction is not None
        if cone.frame == GROUND:
            return np.array(cone.direction)
        return (
            self.poses.rotations[frame, self.problem.assembly.tree.body_index[cone.frame]]
            @ cone.direction
        )

    def _dense(self, generators: ConeGenerators) -> Array:
        entries, _, _, _ = generators.evaluate(self.problem.coordinates)
        return self._spread(entries, generators.arrays.coordinate, generators.arrays.first)

    def _residuals(self) -> Array:
        tree = self.problem.assembly.tree
        c = self.problem.coordinates
        added = [
            reserve
            for reserve in default_reserves(tree.model, 1.0, 1.0)
            if reserve.kind != "coordinate"
        ]
        P = compile_body_actuators(tree, added)
        entries = np.empty((len(c), len(P.coordinate)))
        body_directions(tree.arrays, P, np.array(c, order="C"), entries)
        return self._spread(entries, P.coordinate, P.start)

    def _spread(self, entries: Array, coordinate: np.ndarray, start: np.ndarray) -> Array:
        """Entries (frames, entries) as (frames, rows, columns); those of a column from its `start`
        (columns + 1,).
        """
        owner = np.repeat(np.arange(len(start) - 1), np.diff(start))
        result = np.zeros((len(entries), len(self._rows), len(start) - 1))
        for i, j in enumerate(self._rows):
            mine = coordinate == j
            result[:, i, owner[mine]] = entries[:, mine]
        return result


def _levels(heights: Array, contacts: ContactTerm) -> Array:
    """Height (sites,) at which each site's group touches."""
    groups = np.array([site.group for site in contacts.generators.sites])
    touching = contacts.activations > 0.0
    every = float(np.nanmedian(heights[touching] if touching.any() else heights.min(axis=1)))
    levels = np.full(len(groups), every)
    for group in set(groups.tolist()):
        mine = groups == group
        if touching[:, mine].any():
            levels[mine] = np.nanmedian(heights[:, mine][touching[:, mine]])
    return levels


@read_only
class _Column:
    """A variable of the program."""

    # kind, place: what it relaxes, and the number of the generator, site, or component of a
    # residual
    kind: Kind
    place: int
    given: bool  # whether it is allowed anyway
    push: Array  # (3,) force of one unit, for those at sites [1]
    column: Array  # (rows,) generalized forces of one unit
    price: float  # of one unit's size
    # low, high, at: bounds, and where the program begins
    low: float
    high: float
    at: float


def smallest_relaxation(roots: Roots, frame: int, limits: Array) -> tuple[Allowance, ...]:
    """The relaxation of least cost of a frame, greatest first; `limits` (bodies, 2) of residuals
    [N], [N m].
    """
    columns = [
        *_residuals(roots, frame, limits),
        *_generators(roots, frame),
        *_beyond_cones(roots, frame),
    ]
    matrix = np.array([column.column for column in columns]).T
    rows, count = matrix.shape
    sites = roots.contacts.generators.sites
    touching = roots.contacts.activations[frame] > 0.0
    bounded = [site.cone.direction is not None and np.isfinite(site.cone.most) for site in sites]
    limited = np.flatnonzero(touching & bounded).tolist()
    # Each greatest force: sum of normal forces = what is allowed + what is beyond.
    A = np.zeros((rows + len(limited), count + 2 * len(limited)))
    A[:rows, :count] = matrix
    start = np.array([column.at for column in columns])
    normals = [_normals(roots, columns, number) for number in limited]
    for r, index in enumerate(limited):
        most = sites[index].cone.most
        now = float(normals[r] @ start)
        A[rows + r, :count] = normals[r]
        A[rows + r, count + 2 * r : count + 2 * r + 2] = -1.0
        still = np.zeros(rows)
        columns.append(_Column("most", index, True, STILL, still, 0.0, -most, most, min(now, most)))
        columns.append(
            _Column(
                "most", index, False, STILL, still, COSTS["most"], 0.0, np.inf, max(now - most, 0.0)
            )
        )
    x = np.array([column.at for column in columns])
    low = np.array([column.low for column in columns])
    high = np.array([column.high for column in columns])
    price = np.array([column.price for column in columns])
    _, points = extremes(A, x, np.minimum(low, x), np.maximum(high, x), price[None])
    return _allowances(roots, frame, columns, points[0])


def _residuals(roots: Roots, frame: int, limits: Array) -> list[_Column]:
    """What residuals give within their limits, and what would go beyond."""
    result = []
    for i, amount in enumerate(roots.left[frame]):
        # A box inside the ball of the limit.
        most = float(limits.reshape(-1)[i // 3]) / np.sqrt(3.0)
        given = float(np.clip(amount, -most, most))
        column = roots.residuals[frame, :, i]
        result.append(_Column("residual", i, True, STILL, column, 0.0, -most, most, given))
        for sign in (1.0, -1.0):
            push = sign * np.eye(3)[i % 3]
            over = max(sign * (amount - given), 0.0)
            result.append(
                _Column(
                    "residual", i, False, push, sign * column, COSTS["residual"], 0.0, np.inf, over
                )
            )
    return result


def _generators(roots: Roots, frame: int) -> list[_Column]:
    """Forces inside the cones of sites that touch, and of those that do not."""
    generators = roots.contacts.generators
    _, _, pushes, _ = generators.evaluate(roots.problem.coordinates[frame : frame + 1])
    result = []
    for e in range(len(generators)):
        index = int(generators.site[e])
        touches = bool(roots.contacts.activations[frame, index] > 0.0)
        farther = float(roots.heights[frame, index] - roots.heights[frame].min()) / (
            NEAR * roots.center
        )
        price = (
            COSTS["contact"] * (1.0 + farther**2) * max(float(np.linalg.norm(pushes[0, e])), 1e-3)
        )
        price = 0.0 if touches else price
        ways = (1.0, -1.0) if generators.lower[e] < 0.0 else (1.0,)
        for sign in ways:
            at = max(sign * float(roots.z[frame, e]), 0.0) if touches else 0.0
            result.append(
                _Column(
                    "contact",
                    e,
                    touches,
                    sign * pushes[0, e],
                    sign * roots.pushes[frame, :, e],
                    price,
                    0.0,
                    np.inf,
                    at,
                )
            )
    return result


def _beyond_cones(roots: Roots, frame: int) -> list[_Column]:
    """Forces across cones beyond friction, and pulls, at the middles of sites that touch."""
    result = []
    for number in np.flatnonzero(roots.contacts.activations[frame] > 0.0).tolist():
        cone = roots.contacts.generators.sites[number].cone
        if cone.direction is None:
            continue
        direction = roots.direction(frame, number)
        middle = roots.axes[frame, :, 3 * number : 3 * number + 3]
        ways: list[tuple[Kind, Array]] = [("pull", -direction)]
        if np.isfinite(cone.friction):
            one = np.linalg.svd(direction[None])[2][1:]
            ways += [("friction", sign * across) for across in one for sign in (1.0, -1.0)]
        for kind, push in ways:
            result.append(
                _Column(kind, number, False, push, middle @ push, COSTS[kind], 0.0, np.inf, 0.0)
            )
    return result


def _normals(roots: Roots, columns: Sequence[_Column], site: int) -> Array:
    """Force along a site's cone of one unit of each variable."""
    owner = roots.contacts.generators.site
    normal = roots.contacts.generators.normal
    mine = [column.kind == "contact" and int(owner[column.place]) == site for column in columns]
    return np.array(
        [normal[column.place] if own else 0.0 for column, own in zip(columns, mine, strict=True)]
    )


def _allowances(
    roots: Roots, frame: int, columns: list[_Column], x: Array
) -> tuple[Allowance, ...]:
    """What of a solution goes beyond what is allowed anyway, added up by kind and group of sites."""
    sites = roots.contacts.generators.sites
    owner = roots.contacts.generators.site
    residual = np.zeros((len(roots.bodies), 2, 3))
    beyond = dict[tuple[Kind, str], Array]()
    carried = {site.group: STILL for site in sites}
    heights = dict[str, float]()
    for column, amount in zip(columns, x, strict=True):
        if column.kind == "residual":
            residual.reshape(-1, 3)[column.place // 3] += (
                0.0 if column.given else amount * column.push
            )
            continue
        place = int(owner[column.place]) if column.kind == "contact" else column.place
        group = sites[place].group
        carried[group] = carried[group] + amount * column.push
        if not column.given and amount > 1e-9 * roots.weight:
            push = amount * (np.array([1.0, 0.0, 0.0]) if column.kind == "most" else column.push)
            beyond[column.kind, group] = beyond.get((column.kind, group), STILL) + push
            heights[group] = min(float(roots.heights[frame, place]), heights.get(group, np.inf))
    results = []
    for (kind, group), force in beyond.items():
        needed = heights[group] if kind == "contact" else 0.0
        if kind == "friction":
            direction = roots.direction(
                frame, next(index for index, site in enumerate(sites) if site.group == group)
            )
            along = float(carried[group] @ direction)
            across = float(np.linalg.norm(carried[group] - along * direction))
            needed = across / along if along > 1e-6 * roots.weight else np.inf
        results.append(
            Allowance(
                kind=kind,
                where=group,
                force=float(np.linalg.norm(force)),
                moment=0.0,
                needed=needed,
            )
        )
    for body, (force, moment) in zip(roots.bodies, residual, strict=True):
        results.append(
            Allowance(
                kind="residual",
                where=body,
                force=float(np.linalg.norm(force)),
                moment=float(np.linalg.norm(moment)),
            )
        )
    kept = [result for result in results if result.size > 1e-6 * roots.weight]
    return tuple(sorted(kept, key=lambda item: -item.size))


RESIDUAL_SHARE = 0.05
"""Residual force at a root from which a frame is marked, as a share of its subject's weight (Hicks
et al. 2015 ask for less than that of the greatest external force).
"""
# Residual moment, as a share of the weight times the height of the center of mass above the floor
MOMENT_SHARE = 0.05
NAMED = 0.01  # Relaxations smaller than this share of the weight are not named beside greater ones


@read_only
class Relaxation:
    """A frame whose contacts cannot carry the motion."""

    frame: int
    time: float
    # (3,) what contacts leave at the roots together, in ground; moments about the bodies' mass
    # centers [N]
    force: Array
    # (3,) what contacts leave at the roots together, in ground; moments about the bodies' mass
    # centers [N m]
    moment: Array
    touching: tuple[str, ...]  # sites that may carry force
    allowances: tuple[Allowance, ...]  # what would do, greatest first
    size: float  # sum of all their sizes, over the weight of the model
    sentence: str  # all that in one line


def relaxations(
    problem: TensionProblem,
    tension: Tension,
    residual: float = RESIDUAL_SHARE,
    moment: float = MOMENT_SHARE,
) -> tuple[Relaxation, ...]:
    """Frames whose contacts cannot carry the motion, and the smallest relaxation of each.
    Frames that lack input are left out, and those in which residuals are large though contacts
    could do without them; a model that does not float has none. `problem`, `tension`: as
    `tension_problem` sets it up with contacts, solved, and what it found.
    """
    if problem.contacts is None:
        raise BadData(
            "there are no contacts that could carry the motion: give contacts to the tension"
            " problem"
        )
    held = {
        name for joint in floating_joints(problem.assembly.tree.model) for name in joint.coordinates
    }
    if not held or not held <= set(problem.assembly.rows):
        return ()
    roots = Roots(problem, problem.contacts, tension)
    limits = roots.weights[:, None] * [residual, moment * roots.center]
    left = roots.left.reshape(len(tension), -1, 2, 3)
    beyond = (np.linalg.norm(left, axis=3) > limits).any(axis=(1, 2))
    marked = np.flatnonzero((tension.status != MISSING) & beyond)
    results = []
    for frame in marked.tolist():
        allowed = smallest_relaxation(roots, frame, limits)
        if not allowed:
            # The contacts could carry it, at more effort than the residuals that were taken
            # instead.
            continue
        force, turn = left[frame].sum(axis=0)
        sites = problem.contacts.generators.sites
        touching = tuple(
            site.name
            for index, site in enumerate(sites)
            if problem.contacts.activations[frame, index] > 0.0
        )
        named = (
            tuple(allowance for allowance in allowed if allowance.size > NAMED * roots.weight)
            or allowed[:1]
        )
        time = float(tension.time[frame])
        lacking = what_lacks(touching, force, turn, roots.up)
        size = sum(allowance.size for allowance in allowed) / roots.weight
        results.append(
            Relaxation(
                frame=frame,
                time=time,
                force=force,
                moment=turn,
                touching=touching,
                allowances=named,
                size=size,
                sentence=f"{time:.2f} s: {lacking}: {what_would_do(named)}",
            )
        )
    return tuple(results)


def relaxation_lines(relaxations: Sequence[Relaxation]) -> tuple[str, ...]:
    """One line for each run of neighbouring frames that the same would help: that of the frame that
    lacks most.
    """
    runs: list[list[Relaxation]] = []
    for relaxation in relaxations:
        last = runs[-1][-1] if runs else None
        if (
            last is not None
            and relaxation.frame == last.frame + 1
            and _names(relaxation) == _names(last)
        ):
            runs[-1].append(relaxation)
        else:
            runs.append([relaxation])
    lines = []
    for run in runs:
        worst = max(run, key=lambda frame: frame.size)
        span = f"{run[0].time:.2f} to {run[-1].time:.2f} s, worst at " if len(run) > 1 else ""
        lines.append(span + worst.sentence)
    return tuple(lines)


def _names(relaxation: Relaxation) -> tuple[tuple[str, str], ...]:
    return tuple(sorted((part.kind, part.where) for part in relaxation.allowances))
