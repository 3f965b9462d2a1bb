"""Contacts as a term: which sites may carry force, cones of force, and how smooth forces are.

With smoothness the cost gains sum_g beta c_g (s_k z_k - s_(k-1) z_(k-1))^2 between frames in which
a site touches, beta = smoothness (10 ms / dt)^2, so that the rate of recording does not matter.
What a frame feels of another decays with their distance by the factor r < 1 of r + 1/r = 2 + 1/beta
or faster (that of an unconstrained force); a window is solved with so many frames before and after
it that what lies beyond is felt by less than `FELT`, and these are then dropped. So windows need
not know of each other: memory is that of a window, and threads change nothing.

Forces measured for several sites together, and greatest forces of sites, are terms too:

    sum_g S_g z_g - sd e = measured,  cost e^2        sum_g n_g z_g - most q = 0,  -1 <= q <= 1
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.contacts import SharedWrench, Site
from myomorph.core.model.errors import BadData, check_choices, check_name
from myomorph.core.model.model import GROUND
from myomorph.core.model.series import Series
from myomorph.core.motion.sync import refuse_other_times
from myomorph.core.rigid.tree import Tree
from myomorph.core.tension.terms.cones import ConeGenerators, compile_cones
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


@dataclass(frozen=True)
class ContactOptions:
    """How forces of contacts are chosen where physics leaves them open.

    Attributes
    ----------
    formulation : "simultaneous": contact forces and muscle tensions in one problem; "sequential":
        contact forces first, from the six equations of motion of each body that floats, muscles
        after
    compliance : cost of a contact force of one body weight at a contact (the sites of a group)
        fully activated, in units of the effort a^2 of one muscle; at a site of activation s it is
        sites of the group / s^2 times that
    contact_passive : with rigid tendons, whether the muscles' passive elastic forces take part
        while contact forces are found; tensions under these forces then follow `passive` (see
        docs/decisions/0019-tension-defaults.md)
    smoothness : weight of (f_k - f_(k-1))^2 between frames, in units of `compliance`, for frames 10
        ms apart
    window : frames that are solved together when forces are smoothed (more where smoothness reaches
        further)
    sweeps : most passes over a window, each frame given those beside it; they end earlier when
        nothing changes
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


FELT = 1e-3  # Share of a change beyond a window's margins that may still be felt inside it
# Passes over a window end when no force is further from where they lead [body weights]
CLOSE = 5e-4
REFERENCE = 0.01  # Time between frames for which the smoothness is stated [s]
MAX_PREFERRED = 0.45
"""Share of the friction up to which forces may be preferred across the cone: at a half a generator
would be lost.
"""


class ContactTerm(Term):
    """gamma sum_g c_g z_g^2 of the amplitudes z of the cones' generators, with generalized forces
    J^T G z. `task`: as it was given; `generators`: of the cones of all sites; `activations`
    (frames, sites); `amounts` (frames, generators) force of one unit of a generator's amplitude:
    activation times weight, more of a generator that is preferred [N]; `cost` (generators,) of
    amplitude^2.
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
        free = np.full(count, np.inf)
        return Variables(
            names=self.generators.names,
            weight=self.cost,
            exponent=np.full(count, 2.0),
            lower=self.generators.lower,
            upper=free,
        )

    def entries(self) -> Sequence[tuple[int, int]]:
        """Coordinates that each generator acts on."""
        arrays = self.generators.arrays
        owner = np.repeat(np.arange(len(self.generators)), np.diff(arrays.first))
        return list(zip(owner.tolist(), arrays.coordinate.tolist(), strict=True))

    def columns(self, frames: Frames) -> Columns:
        """Generalized forces of unit forces, and the force of a unit amplitude."""
        return Columns(self.evaluated(frames)[0], self.amounts[frames.part])

    def evaluated(self, frames: Frames) -> tuple[Array, Array, Array, Array]:
        """As of `ConeGenerators.evaluate`."""
        return frames.once(self, lambda these: self.generators.evaluate(these.coordinates))

    def forces_of(self, part: slice, coordinates: Array, amplitudes: Array) -> Array:
        """Forces, centers of pressure and free torques (3, frames, sites, 3) from amplitudes
        (frames, generators).
        """
        generators = self.generators
        _, places, pushes, turns = generators.evaluate(coordinates)
        size = amplitudes * self.amounts[part]
        result = np.zeros((3, len(size), len(generators.sites), 3))
        for number, site in enumerate(generators.sites):
            mine = generators.site == number
            numbers = np.unique(generators.point[mine])
            own = [mine & (generators.point == i) for i in numbers]
            each = np.stack(
                [np.einsum("fg,fgi->fi", size[:, item], pushes[:, item]) for item in own], axis=1
            )
            if site.cone.direction is None:
                press = np.linalg.norm(each, axis=2)
            else:
                press = np.stack([size[:, item] @ generators.normal[item] for item in own], axis=1)
            share = np.where(press.sum(axis=1, keepdims=True) > 0.0, press, 1.0)
            at = places[:, numbers]
            point = np.einsum("fp,fpi->fi", share / share.sum(axis=1, keepdims=True), at)
            turned = np.einsum("fg,fgi->fi", size[:, mine], turns[:, mine])
            result[:, :, number] = (
                each.sum(axis=1),
                point,
                turned + np.cross(at - point[:, None], each).sum(axis=1),
            )
        return result

    def torques_of(self, coordinates: Array, amplitudes: Array) -> Array:
        """Generalized forces (frames, coordinates) of the contacts, each coordinate by itself."""
        arrays = self.generators.arrays
        entries, _, _, _ = self.generators.evaluate(coordinates)
        shares = entries * np.repeat(amplitudes * self.amounts, np.diff(arrays.first), axis=1)
        return shares @ (arrays.coordinate[:, None] == np.arange(coordinates.shape[1]))

    def smoothing(self, unknowns: Unknowns) -> Smoothing | None:
        """Links between frames, None where nothing is smoothed.
        The factor of over-relaxation is Young's for the slowest direction of an unconstrained
        force.
        """
        options = self.task.options
        time = unknowns.time
        if options.smoothness == 0.0 or len(time) < 2 or not len(self.generators):
            return None
        stiffness = options.smoothness * (REFERENCE / np.diff(time)) ** 2
        greatest = float(stiffness.max())
        half = 1.0 + 0.5 / greatest
        decay = half - np.sqrt(half**2 - 1.0)
        margin = int(np.ceil(np.log(FELT) / np.log(decay)))
        jacobi = 2.0 * greatest / (1.0 + 2.0 * greatest)
        over = 2.0 / (1.0 + np.sqrt(1.0 - jacobi**2))
        scale = self.amounts / self.generators.weight[self.generators.site]
        # Changes shrink by over - 1 from pass to pass, so what is left to come is change / (2 -
        # over).
        tolerance = CLOSE * (2.0 - float(over))
        window = max(options.window, 2 * margin)
        first = unknowns.of(self).start
        return Smoothing(
            window=window,
            margin=margin,
            first=first,
            scale=scale,
            stiffness=stiffness,
            over=float(over),
            sweeps=options.sweeps,
            tolerance=tolerance,
        )


def _refuse_unfit(time: Array, task: ContactTask) -> None:
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
    """By how much each generator (frames, generators) is favoured, so that a force along what is
    preferred costs least. Of a pyramid of generators d + mu t_k with costs 1 / w_k the cheapest
    force is sum_k w_k (d + mu t_k), which is d + p for w_k = 1 + 2 p . t_k / mu, p what is
    preferred, as sum_k t_k t_k^T = n / 2 of n generators; where generators of torsion, which have
    no part in it, share the force, the others take more. The cone stays as it is.
    """
    shares = np.ones((len(task.activations), len(generators)))
    if task.preferred is None:
        return shares
    for index, site in enumerate(task.sites):
        cone = site.cone
        if (
            not cone.takes_preference
            or cone.direction is None
            or cone.frame != GROUND
            or not 0.0 < cone.friction < np.inf
        ):
            continue
        members = np.flatnonzero((generators.site == index) & (generators.normal != 0.0))
        across = (generators.arrays.push[members] - cone.direction) / cone.friction
        preferred = (
            np.nan_to_num(task.preferred[:, index])
            * len(members)
            / np.any(np.abs(across) > 1e-12, axis=1).sum()
        )
        size = np.linalg.norm(preferred, axis=1, keepdims=True)
        preferred = preferred * np.minimum(
            1.0, MAX_PREFERRED * cone.friction / np.maximum(size, 1e-12)
        )
        shares[:, members] = 1.0 + 2.0 / cone.friction * preferred @ across.T
    return shares


MEASURED_COST = 1.0
"""Cost of missing a measured force by one standard deviation, in units of the effort a^2 of one
muscle.
"""
COMPONENTS = ("FX", "FY", "FZ", "MX", "MY", "MZ")


class MeasuredTerm(Term):
    """sum ((S f - measured) / sd)^2 of the wrenches that were measured for contacts together, about
    the origin.
    """

    def __init__(self, contacts: ContactTerm):
        self._contacts = contacts
        names = [site.name for site in contacts.task.sites]
        self._members = [
            np.flatnonzero(
                np.isin(contacts.generators.site, [names.index(site) for site in one.sites])
            )
            for one in contacts.task.measured
        ]

    def rows(self, unknowns: Unknowns) -> Rows:
        """Six rows a wrench: force and moment."""
        measured = self._contacts.task.measured
        first = unknowns.of(self._contacts).start
        names = tuple(f"{wrench.name} {label}" for wrench in measured for label in COMPONENTS)
        sd = [
            s for wrench in measured for s in (*(3 * [wrench.force_sd]), *(3 * [wrench.moment_sd]))
        ]
        columns = [first + mine for mine in self._members for _ in COMPONENTS]
        return Rows.of_frames(names, columns, sd, MEASURED_COST, measured=True)

    def row_values(self, rows: Rows, frames: Frames) -> tuple[Array, Array]:
        """What one unit of each amplitude gives; a component that was not measured has none and
        asks for nothing.
        """
        contacts = self._contacts
        generators = self._contacts.generators
        _, places, pushes, turns = contacts.evaluated(frames)
        amounts = contacts.amounts[frames.part][..., None]
        forces = pushes * amounts
        moments = np.cross(places[:, generators.point], forces) + turns * amounts
        values = [np.zeros((len(frames), 0))]
        target = np.zeros((len(frames), len(rows)))
        for index, (measured, mine) in enumerate(
            zip(contacts.task.measured, self._members, strict=True)
        ):
            both = np.concatenate(
                [measured.forces[frames.part], measured.moments[frames.part]], axis=1
            )
            known = np.isfinite(both)
            target[:, 6 * index : 6 * index + 6] = np.where(known, both, 0.0)
            for i in range(6):
                values.append((moments if i >= 3 else forces)[:, mine, i % 3] * known[:, i, None])
        return np.hstack(values), target


class GreatestForceTerm(Term):
    """|n . f| <= most of every site that has a greatest force: along its cone, or along each axis
    of ground.
    """

    def __init__(self, contacts: ContactTerm):
        self._contacts = contacts
        generators = contacts.generators
        # Name, greatest force, axis in ground or -1 for the cone's, and generators that take part.
        self._limits = []
        for number, site in enumerate(contacts.task.sites):
            if not np.isfinite(site.cone.most):
                continue
            mine = generators.site == number
            if site.cone.direction is None:
                three = [(f"{site.name} most {axis}", i) for i, axis in enumerate("XYZ")]
            else:
                three = [(f"{site.name} most", -1)]
                mine = mine & (generators.normal != 0.0)
            self._limits += [
                (name, site.cone.most, axis, np.flatnonzero(mine)) for name, axis in three
            ]

    def rows(self, unknowns: Unknowns) -> Rows:
        """One row a limit, whose unknown is the share of the greatest force that is used."""
        first = unknowns.of(self._contacts).start
        names = tuple(name for name, *_ in self._limits)
        columns = [first + mine for *_, mine in self._limits]
        return Rows.of_frames(
            names, columns, [most for _, most, _, _ in self._limits], LIMIT_COST, 1.0
        )

    def row_values(self, rows: Rows, frames: Frames) -> tuple[Array, Array]:
        """Force of one unit of each amplitude along the direction that is limited."""
        _, _, pushes, _ = self._contacts.evaluated(frames)
        amounts = self._contacts.amounts[frames.part]
        normal = self._contacts.generators.normal
        values = [np.zeros((len(frames), 0))]
        for _, _, axis, mine in self._limits:
            along = pushes[:, mine, axis] if axis >= 0 else normal[mine]
            values.append(along * amounts[:, mine])
        return np.hstack(values), np.zeros((len(frames), len(rows)))


def contact_terms(contacts: ContactTerm) -> tuple[Term, ...]:
    """Contacts, with what was measured of them and what limits them, where there is any."""
    result: tuple[Term, ...] = (contacts,)
    if contacts.task.measured:
        result += (MeasuredTerm(contacts),)
    if any(np.isfinite(site.cone.most) for site in contacts.task.sites):
        result += (GreatestForceTerm(contacts),)
    return result
