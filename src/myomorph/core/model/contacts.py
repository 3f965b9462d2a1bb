"""Contacts of bodies with the world or each other: sites, contact laws and forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, freeze, read_only, unit_vector
from myomorph.core.model.contact_quantities import FORCES
from myomorph.core.model.errors import BadData, UnknownName, check_name
from myomorph.core.model.extension import load
from myomorph.core.model.labelled import AXES, Labelled
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, index_of
from myomorph.core.model.registry import with_extensions
from myomorph.core.model.series import Series, Wrenches
from myomorph.core.model.shown import shown

CONTACT_LAWS: dict[str, str | type[Cone]] = with_extensions(
    {"pyramid": "myomorph.core.model.contacts:Cone"},
    "contact law",
    lambda extension: extension.contact_laws,
)
"""Contact laws by their names in files: a subclass of `Cone`, or its module and name."""
FOREVER = 1e9
"""End of a contact interval that goes on to the end of a recording [s]."""


class Generators(NamedTuple):
    """Forces and moments of which every force that a contact may carry is a sum, at one point.

    Attributes
    ----------
    push, turn : (generators, 3) force [1] and moment [m] of one unit, in the axes of the cone's
        frame
    lower : (generators,) least amplitude: 0, or -inf where the opposite is allowed too
    share : (generators,) cost of amplitude^2; such that the least cost of a force along the
        direction is its square
    """

    push: Array
    turn: Array
    lower: Array
    share: Array


@read_only
class Cone:
    """A contact law: the forces that may act on a body at a site.

    Another law is a subclass that replaces `generators`; contact files and results know it by the
    name that `register_law` gives it.

    Attributes
    ----------
    takes_preference : whether the cheapest force may have another direction
        (`ContactTask.preferred`), as of laws whose generators are d + friction t_k with t_k evenly
        around d
    direction : (3,) the middle of the cone, the way the body is pushed (made a unit vector), in the
        axes of `frame`; None where force may act any way, as on a hand that grips
    frame : the ground or a body, whose axes turn with it
    friction : greatest force across `direction`, as a share of that along it; 0 for a force along
        it only (a sleeve, a rope), inf for a half-space
    torsion : greatest moment about `direction` at each point, as a share of the force along it [m]
    grip : lever at which a moment costs what a force does; then the site passes moments about all
        axes [m]
    edges : how many edges the linearised cone has, an even number from 4
    most : greatest force along `direction` over the whole site (along each axis of ground without
        one) [N]
    """

    direction: Array | None = field(default_factory=lambda: np.array([0.0, 1.0, 0.0]))
    frame: str = GROUND
    friction: float = 0.8
    torsion: float = 0.0
    grip: float = 0.0
    edges: int = 6
    most: float = np.inf
    takes_preference: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.direction is not None:
            object.__setattr__(
                self, "direction", unit_vector(self.direction, "direction", "a contact")
            )
        for name in ("friction", "torsion", "grip"):
            if not getattr(self, name) >= 0.0:
                raise BadData(f"{name} of a contact is {getattr(self, name):g}: expected 0 or more")
        if self.edges < 4 or self.edges % 2:
            raise BadData(
                f"a linearised cone of {self.edges} edges: expected an even number from 4"
            )
        if not self.most > 0.0:
            raise BadData(f"greatest force of a contact is {self.most:g} N: expected above 0")

    def generators(self) -> Generators:
        """Make the generators of the cone at one point, without those of the grip.

        A friction pyramid has the generators d + mu t_k; what may slide any way besides, as in a
        half-space, has free tangents; a cone without a direction has three free axes. Torsional
        friction adds d with a moment of +-torsion about d: friction across and about the direction
        share what the normal force allows (Howe and Cutkosky 1996, whose ellipsoid this lies
        inside).
        """
        if self.direction is None:
            return Generators(
                push=np.eye(3), turn=np.zeros((3, 3)), lower=np.full(3, -np.inf), share=np.ones(3)
            )
        d = self.direction
        first, second = tangents(d)
        if self.friction == 0.0 or np.isinf(self.friction):
            push = [d]
        else:
            angles = 2.0 * np.pi * np.arange(self.edges) / self.edges
            push = [d + self.friction * (np.cos(a) * first + np.sin(a) * second) for a in angles]
        turn = [np.zeros(3)] * len(push)
        if self.torsion > 0.0:
            push += [d, d]
            turn += [self.torsion * d, -self.torsion * d]
        along_d = len(push)
        free = 2 if np.isinf(self.friction) else 0
        push += [first, second][:free]
        turn += [np.zeros(3)] * free
        lower = np.concatenate([np.zeros(along_d), np.full(free, -np.inf)])
        share = np.concatenate([np.full(along_d, float(along_d)), np.ones(free)])
        return Generators(push=np.array(push), turn=np.array(turn), lower=lower, share=share)

    def plain(self) -> dict[str, Any]:
        """Write the law's name and its parameters as numbers and texts, for files.

        Raises
        ------
        BadData : `CONTACT_LAWS` does not have the law
        """
        place = _place(type(self))
        name = next((name for name, law in CONTACT_LAWS.items() if _place(law) == place), None)
        if name is None:
            raise BadData(
                f"contact law {place} is unnamed: `register_law` names it beside"
                f" {', '.join(CONTACT_LAWS)}"
            )
        values = {part.name: getattr(self, part.name) for part in fields(self)}
        return {"law": name} | {
            key: value.tolist() if isinstance(value, np.ndarray) else value
            for key, value in values.items()
        }


def register_law(name: str, law: type[Cone]) -> None:
    """Let contact files and results of this process know a contact law by a name.

    Parameters
    ----------
    name : as `law = "..."` in a contact file
    law : a subclass of `Cone`

    Raises
    ------
    BadData : where another law has the name

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import myomorph as mm
    >>> @dataclass(frozen=True, eq=False)
    ... class Rope(mm.Cone):
    ...     "A pull along one direction."
    ...     def generators(self):
    ...         return mm.model.Generators([self.direction], [[0.0, 0.0, 0.0]], [0.0], [1.0])
    >>> mm.model.register_law("rope", Rope)
    >>> Rope(direction=[0.0, -1.0, 0.0]).plain()["law"]
    'rope'
    """
    known = CONTACT_LAWS.get(name)
    if known is not None and _place(known) != _place(law):
        raise BadData(
            f"contact law '{name}' is {_place(known)} already: give {_place(law)} another name"
        )
    CONTACT_LAWS[name] = law


def contact_law(name: str) -> type[Cone]:
    """Find the class of a contact law by its name in files."""
    check_name("contact law", name, tuple(CONTACT_LAWS), "Myomorph")
    law = CONTACT_LAWS[name]
    return load(law) if isinstance(law, str) else law


def _place(law: str | type[Cone]) -> str:
    """Write the module and name of a law."""
    return law if isinstance(law, str) else f"{law.__module__}:{law.__qualname__}"


def tangents(direction: Array) -> tuple[Array, Array]:
    """Find two unit vectors across a direction.

    The first is nearest to the axis that is least along the direction.

    Parameters
    ----------
    direction : (3,) unit vector

    Returns
    -------
    first, second : (3,) unit vectors
    """
    axis = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = axis - (axis @ direction) * direction
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)


@read_only
class Site:
    """A place of a body that can touch something.

    Attributes
    ----------
    name : as results call it
    body : name of the body that it is fixed to
    points : (points, 3) in the body's frame: one for a point, the corners of a patch for a patch
        [m]
    cone : directions of the forces that it can carry, with their friction
    against : what is touched and takes the opposite force at the same place: the ground or another
        body
    group : the contact that this site is a part of, as the sole of one foot; its own name where
        empty
    """

    name: str
    body: str
    points: Array
    cone: Cone = field(default_factory=Cone)
    against: str = GROUND
    group: str = ""

    def __post_init__(self) -> None:
        freeze(self, points=(-1, 3))
        if not len(self.points) or not np.isfinite(self.points).all():
            raise BadData(f"contact site '{self.name}' has no point, or one that is not finite")
        if self.body == self.against:
            raise BadData(f"contact site '{self.name}' lets body '{self.body}' touch itself")
        if not self.group:
            object.__setattr__(self, "group", self.name)


@dataclass(frozen=True)
class Touch:
    """One site that touches something for a while.

    Attributes
    ----------
    site : name
    surface : body that is touched
    start, stop : [s]
    confidence : how sure that is, 0 to 1
    source : where that is known from: "plates", "kinematics", "camera", "sound", ...
    """

    site: str
    start: float
    stop: float
    surface: str = GROUND
    confidence: float = 1.0
    source: str = ""

    def __post_init__(self) -> None:
        if not self.start <= self.stop:
            raise BadData(
                f"site '{self.site}' touches '{self.surface}' from {self.start:g} to"
                f" {self.stop:g} s"
            )
        if not 0.0 <= self.confidence <= 1.0:
            raise BadData(
                f"confidence {self.confidence:g} of a contact of '{self.site}': expected 0 to 1"
            )


@shown
@dataclass(frozen=True)
class Contacts:
    """Contact intervals of sites, with their confidence, the same whatever the source.

    Attributes
    ----------
    sites : names of all sites that were looked at, those included that never touch
    intervals : in which a site touches, in the order of their start
    warnings : one line each
    """

    sites: tuple[str, ...]
    intervals: tuple[Touch, ...]
    warnings: tuple[Message, ...] = ()

    def __post_init__(self) -> None:
        ordered = sorted(self.intervals, key=lambda interval: (interval.start, interval.site))
        object.__setattr__(self, "intervals", tuple(ordered))
        known = set(self.sites)
        for interval in self.intervals:
            if interval.site not in known:
                raise UnknownName("contact site", interval.site, self.sites, where="the contacts")

    def states(self, time: Array) -> Series:
        """Confidence that each site touches.

        Parameters
        ----------
        time : (frames,) [s]

        Returns
        -------
        Series of (frames, sites), 0 where nothing says so
        """
        values = np.zeros((len(time), len(self.sites)))
        columns = {site: column for column, site in enumerate(self.sites)}
        for interval in self.intervals:
            column = columns[interval.site]
            inside = (time >= interval.start - 1e-9) & (time <= interval.stop + 1e-9)
            values[inside, column] = np.maximum(values[inside, column], interval.confidence)
        return Series(time, self.sites, values)

    def of(self, site: str) -> tuple[Touch, ...]:
        """Intervals in which one site touches."""
        return tuple(interval for interval in self.intervals if interval.site == site)


@read_only
class SharedWrench:
    """A force that a plate or a load cell measured for several sites together.

    Attributes
    ----------
    name : of the plate
    sites : names of the sites that stand on it
    forces, moments : (frames, 3) on the bodies, moments about the ground's origin [N], [N m]; NaN
        where unknown
    force_sd, moment_sd : how well they are known, a standard deviation of each component [N], [N m]
    """

    name: str
    sites: tuple[str, ...]
    forces: Array
    moments: Array
    force_sd: float = 5.0
    moment_sd: float = 2.0

    def __post_init__(self) -> None:
        freeze(self, forces=(-1, 3), moments=(-1, 3))
        if self.forces.shape != self.moments.shape:
            raise BadData(
                f"'{self.name}' has {len(self.forces)} forces and {len(self.moments)} moments"
            )


@read_only
class ContactForces(Labelled):
    """Forces at contact sites over time, in ground.

    Attributes
    ----------
    sites : those that may carry force
    time : (frames,) [s]
    contact_activation : (frames, sites) how ready each site was to carry force, 0 for no contact
    contact_force : (frames, sites, 3) on the site's body (the reaction acts on `Site.against`), 0
        without contact [N]
    contact_point : (frames, sites, 3) center of pressure of each site; the site's middle without
        force [m]
    contact_torque : (frames, sites, 3) free torque about it [N m]
    """

    quantities = FORCES

    time: Array
    sites: tuple[Site, ...]
    contact_activation: Array
    contact_force: Array
    contact_point: Array
    contact_torque: Array

    def __post_init__(self) -> None:
        frames = len(self.time)
        sites = len(self.sites)
        vectors = (frames, sites, 3)
        freeze(
            self,
            time=(-1,),
            contact_activation=(frames, sites),
            contact_force=vectors,
            contact_point=vectors,
            contact_torque=vectors,
        )

    def __len__(self) -> int:
        return len(self.time)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sites."""
        return tuple(site.name for site in self.sites)

    def labels(self) -> dict[str, Sequence[str] | Array]:
        """Label each dimension: times [s], sites, axes.

        Returns
        -------
        by dimension
        """
        return {"time": self.time, "contact_site": self.names, "axis": AXES}

    def of(self, site: str) -> Array:
        """Force at one site.

        Parameters
        ----------
        site : its name

        Returns
        -------
        (frames, 3) [N]

        Raises
        ------
        UnknownName : there is no such site
        """
        return self.contact_force[:, index_of("contact site", site, self.names, "the contacts")]

    def wrenches(self, by: Literal["body", "group", "site"] = "body") -> Wrenches:
        """Turn forces into external loads, sites of one body or group taken together.

        The point of application is the mean of the sites' points by their force along the cone,
        which on a floor is the center of pressure; what moment is left about it is the free torque.
        A contact between two bodies gives two loads, the second on `Site.against` with the opposite
        force.
        """
        parts: dict[tuple[str, str], list[tuple[int, float]]] = {}
        for index, site in enumerate(self.sites):
            label = {"body": site.body, "group": site.group, "site": site.name}[by]
            parts.setdefault((label, site.body), []).append((index, 1.0))
            if site.against != GROUND:
                reaction = site.against if by == "body" else f"{label}_on_{site.against}"
                parts.setdefault((reaction, site.against), []).append((index, -1.0))
        frames = len(self.time)
        values = np.zeros((3, frames, len(parts), 3))
        for j, members in enumerate(parts.values()):
            values[:, :, j] = self._together(members)
        labels = [label for label, _ in parts]
        bodies = tuple(body for _, body in parts)
        names = tuple(
            label if labels.count(label) == 1 else f"{label}_{body}"
            for label, body in zip(labels, bodies, strict=True)
        )
        forces, points, torques = values
        return Wrenches(
            time=self.time,
            names=names,
            bodies=bodies,
            forces=forces,
            points=points,
            torques=torques,
        )

    def _pressed(self, index: int) -> Array:
        """Force along the cone of a site (frames,) [N].

        The norm of the whole force where the cone's direction is not fixed in ground.
        """
        cone = self.sites[index].cone
        if cone.direction is None or cone.frame != GROUND:
            return np.linalg.norm(self.contact_force[:, index], axis=1)
        return np.abs(self.contact_force[:, index] @ cone.direction)

    def _together(self, members: Sequence[tuple[int, float]]) -> tuple[Array, Array, Array]:
        """Sum the forces of some sites at their center of pressure.

        Parameters
        ----------
        members : number of each site, and the sign that its force acts with

        Returns
        -------
        force, point, free torque : (frames, 3) [N], [m], [N m]
        """
        chosen = [number for number, _ in members]
        sign = np.array([sign for _, sign in members])[:, None]
        forces = self.contact_force[:, chosen] * sign
        points = self.contact_point[:, chosen]
        torques = self.contact_torque[:, chosen] * sign
        pressed = np.stack([self._pressed(number) for number in chosen], axis=1)
        share = np.where(pressed.sum(axis=1, keepdims=True) > 0.0, pressed, 1.0)
        point = np.einsum("fk,fki->fi", share / share.sum(axis=1, keepdims=True), points)
        torque = (torques + np.cross(points - point[:, None], forces)).sum(axis=1)
        return forces.sum(axis=1), point, torque
