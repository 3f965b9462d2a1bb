"""Contacts as a term: which sites may carry force, cones of force, and how smooth forces are.

With smoothness the cost gains sum_g beta c_g (s_j z_j - s_(j-1) z_(j-1))^2 between frames j in
which a site touches, beta = smoothness (10 ms / dt)^2, so that the rate of recording does not
matter. What a frame feels of another decays with their distance by the factor r < 1 of
r + 1/r = 2 + 1/beta or faster (that of an unconstrained force); a window is solved with so many
frames before and after it that what lies beyond is felt by less than `FELT`, and these are then
dropped. So windows need not know of each other: memory is that of a window, and threads change
nothing.

Forces measured for several sites together, and greatest forces of sites, are terms too:

    sum_g S_g z_g - sd e = measured,  cost e^2
    sum_g n_g z_g - max_force q = 0,  -1 <= q <= 1
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.contacts import Cone, SharedWrench, Site
from myomorph.core.model.errors import BadData, check_choices, check_name
from myomorph.core.model.model import GROUND
from myomorph.core.model.series import Series
from myomorph.core.motion.sync import refuse_other_times
from myomorph.core.rigid.tree import Tree
from myomorph.core.tension.terms.cones import ConeGenerators, GeneratorForces, compile_cones
from myomorph.core.tension.terms.term import (
    LIMIT_COST,
    Columns,
    Frames,
    Rows,
    Smoothing,
    Term,
    Unknowns,
    Variables,
)

FELT = 1e-3
"""Share of a change beyond a window's margins that may still be felt inside it."""
CLOSE = 5e-4
"""Passes over a window end when no force is further from where they lead [body weights]."""
REFERENCE = 0.01
"""Time between frames for which the smoothness is stated [s]."""
MAX_PREFERRED = 0.45
"""Share of the friction up to which forces may be preferred across the cone: at a half a generator
would be lost.
"""
MEASURED_COST = 1.0
"""Cost of missing a measured force by one standard deviation, in units of the effort a^2 of one
muscle.
"""
COMPONENTS = ("FX", "FY", "FZ", "MX", "MY", "MZ")


@dataclass(frozen=True)
class ContactOptions:
    """How forces of contacts are chosen where physics leaves them open.

    Attributes
    ----------
    formulation : order of solution; "simultaneous": contact forces and muscle tensions in one
        problem; "sequential": contact forces first, from the six equations of motion of each
        floating body, then muscle tensions
    compliance : cost of a contact force of one body weight at a fully activated contact (the sites
        of a group), relative to the effort a^2 of one muscle; at a site with activation s it is
        multiplied by the number of sites of the group / s^2
    contact_passive : with rigid tendons, include the muscles' passive elastic forces while contact
        forces are estimated; the tensions under these forces then follow `passive` (see
        docs/decisions/0019-tension-defaults.md)
    smoothness : weight of the squared change (f_j - f_(j-1))^2 of contact forces between frames, in
        units of `compliance`, for frames 10 ms apart
    window : number of frames that are solved together when contact forces are smoothed (more if
        smoothness extends further)
    sweeps : maximum number of sweeps over a window, each of which pulls every frame to its
        neighbors; fewer if nothing changes
    """

    formulation: Literal["simultaneous", "sequential"] = "simultaneous"
    compliance: float = 0.1
    contact_passive: bool = True
    smoothness: float = 1.0
    window: int = 64
    sweeps: int = 200

    def __post_init__(self) -> None:
        check_choices(self)
        if not (self.compliance > 0.0 and self.smoothness >= 0.0):
            raise BadData(
                f"compliance {self.compliance:g}, smoothness {self.smoothness:g} of contacts:"
                " expected above 0, and 0 or more"
            )
        if self.window < 1 or self.sweeps < 1:
            raise BadData(
                f"window {self.window}, sweeps {self.sweeps} of contacts: expected 1 or more"
            )


@read_only
class ContactTask:
    """Contacts whose forces are to be found.

    Attributes
    ----------
    sites : places that may carry force
    options : how forces are chosen
    activations : (frames, sites) in 0..1 at the motion's times: 0 for no contact, between for a
        contact that is only beginning, or not sure
    measured : forces known for some sites together
    preferred : (frames, sites, 3) in ground: force across a cone's direction, per force along it,
        that costs least; None for a force along the direction. Of cones whose direction is fixed in
        ground
    """

    sites: tuple[Site, ...]
    activations: Series
    measured: tuple[SharedWrench, ...] = ()
    options: ContactOptions = field(default_factory=ContactOptions)
    preferred: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "sites", tuple(self.sites))
        freeze(self, preferred=(len(self.activations), len(self.sites), 3))
        names = tuple(site.name for site in self.sites)
        if self.activations.names != names:
            raise BadData(
                f"activations are of the sites {self.activations.names}, but the contacts have"
                f" {names}"
            )
        for wrench in self.measured:
            for site in wrench.sites:
                check_name("contact site", site, names, f"the contacts, for '{wrench.name}',")

    def frames(self, which: slice) -> ContactTask:
        """Take some frames of activations, measured forces and preferred directions."""
        measured = tuple(
            replace(wrench, forces=wrench.forces[which], moments=wrench.moments[which])
            for wrench in self.measured
        )
        return replace(
            self,
            activations=self.activations.frames(which),
            preferred=None if self.preferred is None else self.preferred[which],
            measured=measured,
        )


class ContactTerm(Term):
    """gamma sum_g c_g z_g^2 of the amplitudes z of cone generators, with forces J^T G z.

    Source: docs/contact-forces.md; linearised cones by their generators as in [D] ch. 4.

    Attributes
    ----------
    task : the contacts whose forces are to be found
    generators : of the cones of all sites
    activations : (frames, sites)
    amounts : (frames, generators) force of one unit of a generator's amplitude: activation times
        weight, more of a generator that is preferred [N]
    cost : (generators,) of amplitude^2
    """

    def __init__(self, tree: Tree, time: Array, task: ContactTask):
        _refuse_unfit(time, task)
        self.task = task
        self.generators = compile_cones(tree, task.sites)
        self.activations = np.array(task.activations.values)
        site_of = self.generators.site
        self.amounts = (self.activations * self.generators.weight)[:, site_of] * np.sqrt(
            _preference(task, self.generators)
        )
        groups = [site.group for site in task.sites]
        sites = np.array([groups.count(group) for group in groups], dtype=np.float64)
        self.cost = task.options.compliance * sites[site_of] * self.generators.cost

    def variables(self) -> Variables:
        """Amplitudes; bounds are the cones."""
        count = len(self.generators)
        unbounded = np.full(count, np.inf)
        return Variables(
            names=self.generators.names,
            weight=self.cost,
            exponent=np.full(count, 2.0),
            lower=self.generators.lower,
            upper=unbounded,
        )

    def entries(self) -> Sequence[tuple[int, int]]:
        """Every generalized force by its generator and coordinate."""
        arrays = self.generators.arrays
        owner = np.repeat(np.arange(len(self.generators)), np.diff(arrays.first))
        return list(zip(owner.tolist(), arrays.coordinate.tolist(), strict=True))

    def columns(self, frames: Frames) -> Columns:
        """Generalized forces of unit forces, and the force of a unit amplitude."""
        return Columns(self.evaluated(frames).entries, self.amounts[frames.part])

    def evaluated(self, frames: Frames) -> GeneratorForces:
        """Do `ConeGenerators.evaluate`, once for all who ask for some frames."""
        return frames.once(self, lambda these: self.generators.evaluate(these.coordinates))

    def forces_of(self, part: slice, coordinates: Array, amplitudes: Array) -> Array:
        """Sum the generators of each site: force, center of pressure and free torque.

        Parameters
        ----------
        part : the frames
        coordinates : (frames, coordinates)
        amplitudes : (frames, generators)

        Returns
        -------
        (3, frames, sites, 3) force [N], center of pressure [m], free torque [N m]
        """
        generators = self.generators
        unit = generators.evaluate(coordinates)
        sizes = amplitudes * self.amounts[part]
        result = np.zeros((3, len(sizes), len(generators.sites), 3))
        for number in range(len(generators.sites)):
            result[:, :, number] = self._force_of_site(number, sizes, unit)
        return result

    def _force_of_site(self, number: int, sizes: Array, unit: GeneratorForces) -> Array:
        """Force, center of pressure and free torque of one site.

        The center is the mean of the site's points, weighted by their forces along the cone's
        direction (by their sizes without one).

        Parameters
        ----------
        sizes : (frames, generators) forces [N]
        unit : of one unit of force

        Returns
        -------
        (3, frames, 3)
        """
        generators = self.generators
        of_site = generators.site == number
        points = np.unique(generators.point[of_site])
        of_points = [of_site & (generators.point == point) for point in points]
        # (frames, points, 3)
        forces = np.stack(
            [np.einsum("fg,fgi->fi", sizes[:, own], unit.pushes[:, own]) for own in of_points],
            axis=1,
        )
        if generators.sites[number].cone.direction is None:
            press = np.linalg.norm(forces, axis=2)
        else:
            press = np.stack([sizes[:, own] @ generators.normal[own] for own in of_points], axis=1)
        share = np.where(press.sum(axis=1, keepdims=True) > 0.0, press, 1.0)
        places = unit.places[:, points]
        center = np.einsum("fp,fpi->fi", share / share.sum(axis=1, keepdims=True), places)
        torque = np.einsum("fg,fgi->fi", sizes[:, of_site], unit.turns[:, of_site])
        about_center = np.cross(places - center[:, None], forces).sum(axis=1)
        return np.stack([forces.sum(axis=1), center, torque + about_center])

    def torques_of(self, coordinates: Array, amplitudes: Array) -> Array:
        """Generalized forces of the contacts, each coordinate by itself.

        Parameters
        ----------
        coordinates : (frames, coordinates)
        amplitudes : (frames, generators)

        Returns
        -------
        (frames, coordinates) [N m or N]
        """
        arrays = self.generators.arrays
        entries = self.generators.evaluate(coordinates).entries
        shares = entries * np.repeat(amplitudes * self.amounts, np.diff(arrays.first), axis=1)
        return shares @ (arrays.coordinate[:, None] == np.arange(coordinates.shape[1]))

    def smoothing(self, unknowns: Unknowns) -> Smoothing | None:
        """Links between frames, None where nothing is smoothed.

        The factor of over-relaxation is Young's for the slowest direction of an unconstrained
        force, 2 / (1 + sqrt(1 - j^2)) with the factor j = 2 beta / (1 + 2 beta) of Jacobi's
        iteration.
        """
        options = self.task.options
        time = unknowns.time
        if options.smoothness == 0.0 or len(time) < 2 or not len(self.generators):
            return None
        stiffness = options.smoothness * (REFERENCE / np.diff(time)) ** 2
        beta = float(stiffness.max())
        # r + 1/r = 2 + 1/beta
        half = 1.0 + 0.5 / beta
        decay = half - np.sqrt(half**2 - 1.0)
        margin = int(np.ceil(np.log(FELT) / np.log(decay)))
        jacobi = 2.0 * beta / (1.0 + 2.0 * beta)
        over = 2.0 / (1.0 + np.sqrt(1.0 - jacobi**2))
        return Smoothing(
            window=max(options.window, 2 * margin),
            margin=margin,
            first=unknowns.of(self).start,
            scale=self.amounts / self.generators.weight[self.generators.site],
            stiffness=stiffness,
            over=float(over),
            sweeps=options.sweeps,
            # Changes shrink by over - 1 from pass to pass, so what is left to come is change /
            # (2 - over).
            tolerance=CLOSE * (2.0 - float(over)),
        )


def _refuse_unfit(time: Array, task: ContactTask) -> None:
    """Refuse contacts of other times than the motion, and activations outside 0 to 1.

    Parameters
    ----------
    time : (frames,) of the motion [s]

    Raises
    ------
    BadData : as said
    """
    activations = task.activations
    refuse_other_times("activations of contacts", activations.time, time)
    outside = np.argwhere(~((activations.values >= 0.0) & (activations.values <= 1.0)))
    if len(outside):
        frame, site = outside[0]
        raise BadData(
            f"activation of contact site '{activations.names[site]}' at frame {frame} is "
            f"{activations.values[frame, site]:g}: expected 0 to 1"
        )
    for measured in task.measured:
        if len(measured.forces) != len(time):
            raise BadData(
                f"'{measured.name}' has {len(measured.forces)} frames of forces, the motion"
                f" {len(time)}"
            )


def _preference(task: ContactTask, generators: ConeGenerators) -> Array:
    """By how much each generator is favoured, so that a preferred force costs least.

    Of a pyramid of generators d + mu t_g with costs 1 / w_g the cheapest force is
    sum_g w_g (d + mu t_g), which is d + p for

        w_g = 1 + 2 p . t_g / mu

    with p what is preferred, as sum_g t_g t_g^T = n / 2 of n generators. Where generators of
    torsion, which have no part in it, share the force, the others take more. The cone stays as it
    is.

    Returns
    -------
    (frames, generators) w
    """
    favour = np.ones((len(task.activations), len(generators)))
    if task.preferred is None:
        return favour
    for number, site in enumerate(task.sites):
        cone = site.cone
        if cone.direction is None or not _takes_preference(cone):
            continue
        pyramid = np.flatnonzero((generators.site == number) & (generators.normal != 0.0))
        tangents = (generators.arrays.push[pyramid] - cone.direction) / cone.friction
        with_tangent = np.any(np.abs(tangents) > 1e-12, axis=1).sum()
        preferred = np.nan_to_num(task.preferred[:, number]) * len(pyramid) / with_tangent
        size = np.linalg.norm(preferred, axis=1, keepdims=True)
        max_size = MAX_PREFERRED * cone.friction
        preferred = preferred * np.minimum(1.0, max_size / np.maximum(size, 1e-12))
        favour[:, pyramid] = 1.0 + 2.0 / cone.friction * preferred @ tangents.T
    return favour


def _takes_preference(cone: Cone) -> bool:
    """Tell whether a cone is a pyramid, fixed in ground, in which a force may be preferred."""
    return cone.takes_preference and cone.frame == GROUND and 0.0 < cone.friction < np.inf


class MeasuredTerm(Term):
    """sum ((S f - measured) / sd)^2 of wrenches measured for contacts together.

    Moments are about the ground's origin.
    """

    def __init__(self, contacts: ContactTerm):
        self._contacts = contacts
        names = [site.name for site in contacts.task.sites]
        self._members = []
        for wrench in contacts.task.measured:
            sites = [names.index(site) for site in wrench.sites]
            self._members.append(np.flatnonzero(np.isin(contacts.generators.site, sites)))

    def rows(self, unknowns: Unknowns) -> Rows:
        """Six rows per wrench: force and moment."""
        measured = self._contacts.task.measured
        first = unknowns.of(self._contacts).start
        sd: list[float] = []
        for wrench in measured:
            sd += 3 * [wrench.force_sd] + 3 * [wrench.moment_sd]
        return Rows.of_frames(
            names=tuple(f"{wrench.name} {label}" for wrench in measured for label in COMPONENTS),
            columns=[first + members for members in self._members for _ in COMPONENTS],
            unit=sd,
            weight=MEASURED_COST,
            measured=True,
        )

    def row_values(self, rows: Rows, frames: Frames) -> tuple[Array, Array]:
        """Force and moment of one unit of each amplitude, and what was measured.

        A component that was not measured has no values and asks for nothing.

        Parameters
        ----------
        rows : as `rows` returned them
        frames : a chunk of the motion

        Returns
        -------
        (frames, entries) and (frames, rows)
        """
        contacts = self._contacts
        unit = contacts.evaluated(frames)
        amounts = contacts.amounts[frames.part][..., None]
        forces = unit.pushes * amounts
        arms = unit.places[:, contacts.generators.point]
        moments = np.cross(arms, forces) + unit.turns * amounts
        values = [np.zeros((len(frames), 0))]
        targets = [np.zeros((len(frames), 0))]
        for wrench, members in zip(contacts.task.measured, self._members, strict=True):
            measured = np.hstack([wrench.forces[frames.part], wrench.moments[frames.part]])
            known = np.isfinite(measured)
            targets.append(np.where(known, measured, 0.0))
            for i in range(3):
                values.append(forces[:, members, i] * known[:, i, None])
            for i in range(3):
                values.append(moments[:, members, i] * known[:, 3 + i, None])
        return np.hstack(values), np.hstack(targets)


class ForceLimit(NamedTuple):
    """Limit of the force of a site.

    Attributes
    ----------
    name : of its row
    max_force : [N]
    axis : of ground, -1 for the direction of the site's cone
    generators : numbers of those that take part
    """

    name: str
    max_force: float
    axis: int
    generators: NDArray[np.int64]


class GreatestForceTerm(Term):
    """|n . f| <= greatest force of every site that has one.

    The direction n is that of its cone, or each axis of ground where the cone has none.
    """

    def __init__(self, contacts: ContactTerm):
        self._contacts = contacts
        self._limits: list[ForceLimit] = []
        for number, site in enumerate(contacts.task.sites):
            if np.isfinite(site.cone.most):
                self._limits += _limits(contacts.generators, number, site)

    def rows(self, unknowns: Unknowns) -> Rows:
        """One row per limit, whose unknown is the share of the greatest force that is used."""
        first = unknowns.of(self._contacts).start
        return Rows.of_frames(
            names=tuple(limit.name for limit in self._limits),
            columns=[first + limit.generators for limit in self._limits],
            unit=[limit.max_force for limit in self._limits],
            weight=LIMIT_COST,
            bound=1.0,
        )

    def row_values(self, rows: Rows, frames: Frames) -> tuple[Array, Array]:
        """Force of one unit of each amplitude along the direction that is limited, and 0.

        Parameters
        ----------
        rows : as `rows` returned them
        frames : a chunk of the motion

        Returns
        -------
        (frames, entries) and (frames, rows)
        """
        pushes = self._contacts.evaluated(frames).pushes
        amounts = self._contacts.amounts[frames.part]
        normal = self._contacts.generators.normal
        values = [np.zeros((len(frames), 0))]
        for limit in self._limits:
            members = limit.generators
            along = pushes[:, members, limit.axis] if limit.axis >= 0 else normal[members]
            values.append(along * amounts[:, members])
        return np.hstack(values), np.zeros((len(frames), len(rows)))


def _limits(generators: ConeGenerators, number: int, site: Site) -> list[ForceLimit]:
    """Limits of a site: along its cone, or each axis of ground where the cone has none."""
    members = generators.site == number
    directions = [(f"{site.name} most {axis}", i) for i, axis in enumerate("XYZ")]
    if site.cone.direction is not None:
        directions = [(f"{site.name} most", -1)]
        members = members & (generators.normal != 0.0)
    numbers = np.flatnonzero(members)
    return [
        ForceLimit(name=name, max_force=site.cone.most, axis=axis, generators=numbers)
        for name, axis in directions
    ]


def contact_terms(contacts: ContactTerm) -> tuple[Term, ...]:
    """Contacts, with what was measured of them and what limits them, where there is any."""
    result: tuple[Term, ...] = (contacts,)
    if contacts.task.measured:
        result += (MeasuredTerm(contacts),)
    if any(np.isfinite(site.cone.most) for site in contacts.task.sites):
        result += (GreatestForceTerm(contacts),)
    return result
