"""Contacts that cannot carry the motion: the frames, and the smallest relaxation that would do.

What carries a subject as a whole is in the equations of motion of its root, where muscles have no
part. Where the contacts leave more there than residuals may give, a linear program asks for the
least that would have to be allowed,

    minimise    sum_i c_i |r_i|
    subject to  E z + sum_i D_i r_i + R w = b,   z >= 0,  |w| <= limits

with relaxations r: force at a site that does not touch, force across a cone beyond its friction,
force beyond a site's greatest, a pull at a site that only pushes, and, dearest, a residual. The sum
of sizes (1-norm) makes few of them differ from 0, so that the answer has a name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import CONTACTS
from myomorph.core.model.contacts import Cone, Site
from myomorph.core.model.errors import BadData, counted, whole
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND
from myomorph.core.model.severity import FORCE_ERROR, severity_of, severity_of_share
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
MIN_WEIGHT = 0.1
"""Share of the whole weight that a light object is taken to have, so that noise of what is held is
not blamed.
"""
MIN_FORCE = 1e-9
"""Forces below this share of the weight are rounding."""
MIN_SIZE = 1e-6
"""Relaxations below this share of the weight are none."""
RESIDUAL_SHARE = 0.05
"""Residual force at a root from which a frame is marked, as a share of its subject's weight (Hicks
et al. 2015 ask for less than that of the greatest external force).
"""
MOMENT_SHARE = 0.05
"""Residual moment, as a share of the weight times the height of the center of mass."""
NAMED = 0.01
"""Relaxations smaller than this share of the weight are not named beside greater ones."""


@dataclass(frozen=True)
class Allowance:
    """One thing that would have to be allowed.

    Attributes
    ----------
    kind : "contact": sites that do not touch; "friction": more than the cones'; "most": more than
        the sites' greatest force; "pull": force the other way; "residual": a force or moment from
        nowhere
    where : the group of the sites, or the body that floats
    force : its size, of a "friction" across the cone beyond what was allowed [N], 0 for a moment
        alone
    moment : of a residual [N m]
    needed : of a "friction" the coefficient that would do, of a "contact" how far the nearest of
        its sites is above where they touch at other times [m]
    """

    kind: Kind
    where: str
    force: float
    moment: float = 0.0
    needed: float = 0.0

    @property
    def size(self) -> float:
        """The greater of force [N] and moment [N m]."""
        return max(self.force, self.moment)


def missing_words(touching: Sequence[str], force: Array, moment: Array, up: Array) -> str:
    """Clause on what is wrong: who may touch, and what is left over.

    Parameters
    ----------
    touching : names of the sites that may carry force
    force, moment : (3,) that contacts leave [N], [N m]
    up : (3,) unit vector against gravity

    Returns
    -------
    such as "no site may touch, but 700 N upward are needed"
    """
    upward = float(force @ up)
    size = float(np.linalg.norm(force))
    torque = float(np.linalg.norm(moment))
    way = "sideways"
    if upward > 0.7 * size:
        way = "upward"
    elif upward < -0.7 * size:
        way = "downward"
    needed = f"a moment of {whole(torque)} N m is needed"
    if size >= torque:
        needed = f"{whole(size)} N {way} are needed"
    if not touching:
        return f"no site may touch, but {needed}"
    return f"sites that touch cannot carry the motion, {needed} beside them"


def what_would_do(allowances: Sequence[Allowance]) -> str:
    """Clause on what would have to be allowed."""
    return " and ".join(_words(allowance) for allowance in allowances) + " would do"


def _words(allowance: Allowance) -> str:
    """Name one thing that would have to be allowed."""
    if allowance.kind == "contact":
        return (
            f"contact of '{allowance.where}' ({1000.0 * allowance.needed:.0f} mm above its support)"
        )
    if allowance.kind == "friction" and np.isfinite(allowance.needed):
        return f"friction of {allowance.needed:.2f} at '{allowance.where}'"
    if allowance.kind == "friction":
        return f"{whole(allowance.force)} N across the cone of '{allowance.where}'"
    if allowance.kind == "most":
        return f"{whole(allowance.force)} N more at '{allowance.where}' than its greatest force"
    if allowance.kind == "pull":
        return f"a pull of {whole(allowance.force)} N at '{allowance.where}'"
    if allowance.force >= allowance.moment:
        return f"{whole(allowance.force)} N at '{allowance.where}' without a support"
    return f"{whole(allowance.moment)} N m at '{allowance.where}' without a support"


class Roots:
    """The equations of motion of all bodies that float, in all frames.

    Attributes
    ----------
    bodies : that float
    weights : (bodies,) of the subject or object that each carries, of small ones `MIN_WEIGHT` of
        the whole `weight` [N]
    residuals : (frames, rows, 6 bodies) generalized forces of unit forces and of unit moments at
        the bodies' mass centers
    pushes : (frames, rows, generators) the same along the generators of the sites' cones
    axes : (frames, rows, 3 sites) the same along the ground's axes at the middles of the sites
    heights : (frames, sites) of the middles above where the sites of their group touch, in the
        median, above where any do for a group that never touches [m]
    center : median height of the center of mass above the lowest of these levels [m]
    z : (frames, generators) forces of the solution [N]
    left : (frames, 6 bodies) forces and moments that contacts leave [N], [N m]
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
            [subject_weight(tree, body) for body in self.bodies], MIN_WEIGHT * self.weight
        )
        self.residuals = self._residual_columns()
        self.pushes = self._generator_columns(generators)
        middles = compile_cones(tree, [_middle(site) for site in generators.sites])
        self.axes = self._generator_columns(middles)

        heights = middles.evaluate(c).places @ self.up
        levels = _levels(heights, contacts)
        self.heights = np.maximum(heights - levels, 0.0)
        center = np.nanmedian(center_of_mass(tree, self.poses) @ self.up) - float(levels.min())
        self.center = max(float(center), 1e-3)

        self.z = np.nan_to_num(problem.amplitudes * contacts.amounts)
        # What muscles and reserves give together is, at a root, what contacts and residuals do.
        names = tree.model.coordinate_names
        needed = tension.balanced_torque[
            :, [tension.coordinates.index(names[j]) for j in self._rows]
        ]
        missing = needed - np.einsum("fre,fe->fr", self.pushes, self.z)
        self.left = np.linalg.solve(self.residuals, missing[..., None])[..., 0]

    def direction(self, frame: int, site: int) -> Array:
        """Direction of a cone.

        Parameters
        ----------
        frame, site : numbers

        Returns
        -------
        (3,) in ground
        """
        cone = self.contacts.generators.sites[site].cone
        assert cone.direction is not None
        if cone.frame == GROUND:
            return np.array(cone.direction)
        body = self.problem.assembly.tree.body_index[cone.frame]
        return self.poses.rotations[frame, body] @ cone.direction

    def _generator_columns(self, generators: ConeGenerators) -> Array:
        """Generalized forces (frames, rows, generators) of unit forces along generators."""
        entries = generators.evaluate(self.problem.coordinates).entries
        return self._spread(entries, generators.arrays.coordinate, generators.arrays.first)

    def _residual_columns(self) -> Array:
        """Generalized forces (frames, rows, 6 bodies) of unit residuals."""
        tree = self.problem.assembly.tree
        c = self.problem.coordinates
        reserves = default_reserves(tree.model, 1.0, 1.0)
        residuals = [reserve for reserve in reserves if reserve.kind != "coordinate"]
        P = compile_body_actuators(tree, residuals)
        entries = np.empty((len(c), len(P.coordinate)))
        body_directions(tree.arrays, P, np.array(c, order="C"), entries)
        return self._spread(entries, P.coordinate, P.start)

    def _spread(self, entries: Array, coordinate: np.ndarray, start: np.ndarray) -> Array:
        """Write entries out on the rows of the roots.

        Parameters
        ----------
        entries : (frames, entries)
        coordinate : (entries,) of each
        start : (columns + 1,) where the entries of a column begin

        Returns
        -------
        (frames, rows, columns)
        """
        column = np.repeat(np.arange(len(start) - 1), np.diff(start))
        result = np.zeros((len(entries), len(self._rows), len(start) - 1))
        for i, j in enumerate(self._rows):
            on_row = coordinate == j
            result[:, i, column[on_row]] = entries[:, on_row]
        return result


def _middle(site: Site) -> Site:
    """One point in the middle of a site, that may push any way."""
    return Site(
        name=site.name,
        body=site.body,
        points=site.points.mean(axis=0)[None],
        cone=Cone(None),
        against=site.against,
    )


def _levels(heights: Array, contacts: ContactTerm) -> Array:
    """Height at which each site's group touches, in the median.

    Parameters
    ----------
    heights : (frames, sites) of the sites' middles [m]

    Returns
    -------
    (sites,) [m]
    """
    groups = np.array([site.group for site in contacts.generators.sites])
    touching = contacts.activations > 0.0
    at_touch = heights[touching] if touching.any() else heights.min(axis=1)
    levels = np.full(len(groups), float(np.nanmedian(at_touch)))
    for group in set(groups.tolist()):
        members = groups == group
        if touching[:, members].any():
            levels[members] = np.nanmedian(heights[:, members][touching[:, members]])
    return levels


@read_only
class _Column:
    """A variable of the program.

    Attributes
    ----------
    kind, place : what it relaxes, and the number of the generator, site, or component of a residual
    allowed : whether it is allowed anyway
    push : (3,) force of one unit, for those at sites [1]
    column : (rows,) generalized forces of one unit
    price : of one unit's size
    low, high : bounds
    start : where the program begins
    """

    kind: Kind
    place: int
    allowed: bool
    push: Array
    column: Array
    start: float
    price: float = 0.0
    low: float = 0.0
    high: float = np.inf


def smallest_relaxation(roots: Roots, frame: int, limits: Array) -> tuple[Allowance, ...]:
    """Relaxation of least cost of a frame, greatest first.

    Parameters
    ----------
    roots : equations of motion of the bodies that float
    frame : number
    limits : (bodies, 2) of residuals [N], [N m]

    Returns
    -------
    what would have to be allowed, nothing where the contacts could carry the motion
    """
    columns = [
        *_residuals(roots, frame, limits),
        *_generators(roots, frame),
        *_beyond_cones(roots, frame),
    ]
    matrix = np.array([column.column for column in columns]).T
    rows, count = matrix.shape
    limited = _limited_sites(roots, frame)
    # Each greatest force: sum of normal forces = what is allowed + what is beyond.
    A = np.zeros((rows + len(limited), count + 2 * len(limited)))
    A[:rows, :count] = matrix
    start = np.array([column.start for column in columns])
    normals = [_normals(roots, columns, site) for site in limited]
    for r, (site, normal) in enumerate(zip(limited, normals, strict=True)):
        A[rows + r, :count] = normal
        A[rows + r, count + 2 * r : count + 2 * r + 2] = -1.0
        columns += _greatest_force(roots, site, float(normal @ start), rows)

    x = np.array([column.start for column in columns])
    low = np.array([column.low for column in columns])
    high = np.array([column.high for column in columns])
    price = np.array([column.price for column in columns])
    _, points = extremes(A, x, np.minimum(low, x), np.maximum(high, x), price[None])
    return _allowances(roots, frame, columns, points[0])


def _limited_sites(roots: Roots, frame: int) -> list[int]:
    """Numbers of the sites that touch and have a greatest force along their cones."""
    touching = roots.contacts.activations[frame] > 0.0
    cones = [site.cone for site in roots.contacts.generators.sites]
    bounded = [cone.direction is not None and np.isfinite(cone.most) for cone in cones]
    return [int(site) for site in np.flatnonzero(touching & bounded)]


def _greatest_force(roots: Roots, site: int, force: float, rows: int) -> list[_Column]:
    """Force of a site up to its greatest, and beyond; `force` that of the solution [N]."""
    max_force = roots.contacts.generators.sites[site].cone.most
    nothing = np.zeros(rows)
    within = _Column(
        kind="most",
        place=site,
        allowed=True,
        push=np.zeros(3),
        column=nothing,
        start=min(force, max_force),
        low=-max_force,
        high=max_force,
    )
    beyond = _Column(
        kind="most",
        place=site,
        allowed=False,
        push=np.zeros(3),
        column=nothing,
        start=max(force - max_force, 0.0),
        price=COSTS["most"],
    )
    return [within, beyond]


def _residuals(roots: Roots, frame: int, limits: Array) -> list[_Column]:
    """Residuals within their limits (bodies, 2) [N], [N m], and beyond."""
    result = []
    for i, amount in enumerate(roots.left[frame]):
        # A box inside the ball of the limit.
        max_size = float(limits.reshape(-1)[i // 3]) / np.sqrt(3.0)
        within = float(np.clip(amount, -max_size, max_size))
        column = roots.residuals[frame, :, i]
        result.append(
            _Column(
                kind="residual",
                place=i,
                allowed=True,
                push=np.zeros(3),
                column=column,
                start=within,
                low=-max_size,
                high=max_size,
            )
        )
        for sign in (1.0, -1.0):
            result.append(
                _Column(
                    kind="residual",
                    place=i,
                    allowed=False,
                    push=sign * np.eye(3)[i % 3],
                    column=sign * column,
                    start=max(sign * (amount - within), 0.0),
                    price=COSTS["residual"],
                )
            )
    return result


def _generators(roots: Roots, frame: int) -> list[_Column]:
    """List forces inside the cones of sites that touch, and of those that do not."""
    generators = roots.contacts.generators
    pushes = generators.evaluate(roots.problem.coordinates[frame : frame + 1]).pushes[0]
    result = []
    for e, push in enumerate(pushes):
        site = int(generators.site[e])
        touches = bool(roots.contacts.activations[frame, site] > 0.0)
        price = 0.0 if touches else _contact_price(roots, frame, site, push)
        for sign in (1.0, -1.0) if generators.lower[e] < 0.0 else (1.0,):
            result.append(
                _Column(
                    kind="contact",
                    place=e,
                    allowed=touches,
                    push=sign * push,
                    column=sign * roots.pushes[frame, :, e],
                    start=max(sign * float(roots.z[frame, e]), 0.0) if touches else 0.0,
                    price=price,
                )
            )
    return result


def _contact_price(roots: Roots, frame: int, site: int, push: Array) -> float:
    """Price of one unit of a generator of a site that does not touch; `push` (3,) its force."""
    heights = roots.heights[frame]
    farther = float(heights[site] - heights.min()) / (NEAR * roots.center)
    return COSTS["contact"] * (1.0 + farther**2) * max(float(np.linalg.norm(push)), 1e-3)


def _beyond_cones(roots: Roots, frame: int) -> list[_Column]:
    """List forces across cones beyond friction, and pulls, at the middles of touching sites."""
    result = []
    for site in np.flatnonzero(roots.contacts.activations[frame] > 0.0).tolist():
        cone = roots.contacts.generators.sites[site].cone
        if cone.direction is None:
            continue
        direction = roots.direction(frame, site)
        middle = roots.axes[frame, :, 3 * site : 3 * site + 3]
        ways: list[tuple[Kind, Array]] = [("pull", -direction)]
        if np.isfinite(cone.friction):
            tangents = np.linalg.svd(direction[None])[2][1:]
            ways += [("friction", sign * across) for across in tangents for sign in (1.0, -1.0)]
        for kind, push in ways:
            result.append(
                _Column(
                    kind=kind,
                    place=site,
                    allowed=False,
                    push=push,
                    column=middle @ push,
                    start=0.0,
                    price=COSTS[kind],
                )
            )
    return result


def _normals(roots: Roots, columns: Sequence[_Column], site: int) -> Array:
    """Force (columns,) along a site's cone of one unit of each variable."""
    owner = roots.contacts.generators.site
    normal = roots.contacts.generators.normal
    return np.array(
        [
            normal[column.place]
            if column.kind == "contact" and int(owner[column.place]) == site
            else 0.0
            for column in columns
        ]
    )


def _allowances(
    roots: Roots, frame: int, columns: Sequence[_Column], x: Array
) -> tuple[Allowance, ...]:
    """Sum what goes beyond what is allowed anyway, by kind and group of sites.

    Parameters
    ----------
    columns : variables of the program
    x : (columns,) their values
    """
    results = [*_beyond_at_sites(roots, frame, columns, x), *_beyond_at_roots(roots, columns, x)]
    sizeable = [result for result in results if result.size > MIN_SIZE * roots.weight]
    return tuple(sorted(sizeable, key=lambda item: -item.size))


def _beyond_at_roots(roots: Roots, columns: Sequence[_Column], x: Array) -> list[Allowance]:
    """Residuals of each body that floats beyond their limits; `x` (columns,)."""
    beyond = np.zeros((2 * len(roots.bodies), 3))
    for column, amount in zip(columns, x, strict=True):
        if column.kind == "residual" and not column.allowed:
            beyond[column.place // 3] += amount * column.push
    sizes = np.array([float(np.linalg.norm(vector)) for vector in beyond]).reshape(-1, 2)
    return [
        Allowance(kind="residual", where=body, force=float(force), moment=float(moment))
        for body, (force, moment) in zip(roots.bodies, sizes, strict=True)
    ]


def _beyond_at_sites(
    roots: Roots, frame: int, columns: Sequence[_Column], x: Array
) -> list[Allowance]:
    """Sum forces beyond what is allowed, by kind and group of sites; `x` (columns,)."""
    sites = roots.contacts.generators.sites
    owner = roots.contacts.generators.site
    beyond = dict[tuple[Kind, str], Array]()
    carried = {site.group: np.zeros(3) for site in sites}
    heights = dict[str, float]()
    for column, amount in zip(columns, x, strict=True):
        if column.kind == "residual":
            continue
        site = int(owner[column.place]) if column.kind == "contact" else column.place
        group = sites[site].group
        carried[group] = carried[group] + amount * column.push
        if column.allowed or amount <= MIN_FORCE * roots.weight:
            continue
        push = np.array([1.0, 0.0, 0.0]) if column.kind == "most" else column.push
        sum_before = beyond.get((column.kind, group), np.zeros(3))
        beyond[column.kind, group] = sum_before + amount * push
        heights[group] = min(float(roots.heights[frame, site]), heights.get(group, np.inf))

    results = []
    for (kind, group), force in beyond.items():
        needed = 0.0
        if kind == "contact":
            needed = heights[group]
        elif kind == "friction":
            needed = _needed_friction(roots, frame, group, carried[group])
        size = float(np.linalg.norm(force))
        results.append(Allowance(kind=kind, where=group, force=size, needed=needed))
    return results


def _needed_friction(roots: Roots, frame: int, group: str, force: Array) -> float:
    """Coefficient of friction with which a group carries a force (3,) [N]."""
    sites = roots.contacts.generators.sites
    first = next(number for number, site in enumerate(sites) if site.group == group)
    direction = roots.direction(frame, first)
    along = float(force @ direction)
    across = float(np.linalg.norm(force - along * direction))
    return across / along if along > MIN_SIZE * roots.weight else np.inf


@read_only
class Relaxation:
    """A frame whose contacts cannot carry the motion.

    Attributes
    ----------
    frame, time : number, and time [s]
    force, moment : (3,) what contacts leave at the roots together, in ground [N]; moments about the
        bodies' mass centers [N m]
    touching : sites that may carry force
    allowances : what would do, greatest first
    size : sum of all their sizes, over the weight of the model
    sentence : all that in one line
    """

    frame: int
    time: float
    force: Array
    moment: Array
    touching: tuple[str, ...]
    allowances: tuple[Allowance, ...]
    size: float
    sentence: str


def relaxations(
    problem: TensionProblem,
    tension: Tension,
    residual: float = RESIDUAL_SHARE,
    moment: float = MOMENT_SHARE,
) -> tuple[Relaxation, ...]:
    """Frames whose contacts cannot carry the motion, and the smallest relaxation of each.

    Frames that lack input are left out, and those in which residuals are large though contacts
    could do without them; a model that does not float has none.

    Parameters
    ----------
    problem, tension : with contacts, solved, and its result
    residual : residual force from which a frame is marked, as a share of its subject's weight
    moment : residual moment, as a share of the weight times the height of the center of mass

    Raises
    ------
    BadData : the problem has no contacts
    """
    if problem.contacts is None:
        raise BadData(
            "there are no contacts that could carry the motion: give contacts to the tension"
            " problem"
        )
    floating = floating_joints(problem.assembly.tree.model)
    held = {name for joint in floating for name in joint.coordinates}
    if not held or not held <= set(problem.assembly.coordinates):
        return ()
    roots = Roots(problem, problem.contacts, tension)
    limits = roots.weights[:, None] * [residual, moment * roots.center]
    left = roots.left.reshape(len(tension), -1, 2, 3)
    beyond = (np.linalg.norm(left, axis=3) > limits).any(axis=(1, 2))
    marked = np.flatnonzero((tension.status != MISSING) & beyond)
    results = [_relaxation(roots, tension, frame, limits) for frame in marked.tolist()]
    return tuple(relaxation for relaxation in results if relaxation is not None)


def _relaxation(roots: Roots, tension: Tension, frame: int, limits: Array) -> Relaxation | None:
    """Smallest relaxation of a frame, with its sentence; `limits` (bodies, 2) [N], [N m].

    There is none where the contacts could carry the motion, at more effort than the residuals that
    were taken instead.
    """
    allowances = smallest_relaxation(roots, frame, limits)
    if not allowances:
        return None
    force, moment = roots.left[frame].reshape(-1, 2, 3).sum(axis=0)
    activations = roots.contacts.activations[frame]
    touching = tuple(
        site.name
        for site, activation in zip(roots.contacts.generators.sites, activations, strict=True)
        if activation > 0.0
    )
    large = tuple(item for item in allowances if item.size > NAMED * roots.weight)
    named = large or allowances[:1]
    time = float(tension.time[frame])
    missing = missing_words(touching, force, moment, roots.up)
    return Relaxation(
        frame=frame,
        time=time,
        force=force,
        moment=moment,
        touching=touching,
        allowances=named,
        size=sum(item.size for item in allowances) / roots.weight,
        sentence=f"{time:.2f} s: {missing}: {what_would_do(named)}",
    )


def relaxation_messages(
    relaxations: Sequence[Relaxation], frames: int, weight: float
) -> tuple[Message, ...]:
    """Say in one message in which frames contacts cannot carry the motion, and what would help.

    It has the sentence of the frame that needs most. What needs no more in any frame than plates
    are off anyway, or concerns few frames, changes no number of a page.

    Parameters
    ----------
    relaxations : of single frames, in their order
    frames : of the motion
    weight : of the body [N]

    Returns
    -------
    one message, or none
    """
    if not relaxations:
        return ()
    worst = max(relaxations, key=lambda each: each.size)
    spans = [(run[0].time, run[-1].time) for run in _neighbors(relaxations)]
    share = len(relaxations) / max(frames, 1)
    size = max(float(np.linalg.norm(each.force)) for each in relaxations)
    severity = severity_of(size, FORCE_ERROR * weight)
    parts = counted(len(spans), "stretch")
    return (
        CONTACTS.message(
            f"contacts cannot carry the motion in {len(relaxations)} of {frames} frames ({parts}),"
            f" worst at {worst.sentence}",
            times=spans,
            size=size,
            share=share,
            severity=severity_of_share(share, severity),
        ),
    )


def _neighbors(relaxations: Sequence[Relaxation]) -> list[list[Relaxation]]:
    """Join neighboring frames to runs."""
    runs: list[list[Relaxation]] = []
    for relaxation in relaxations:
        if runs and relaxation.frame == runs[-1][-1].frame + 1:
            runs[-1].append(relaxation)
        else:
            runs.append([relaxation])
    return runs
