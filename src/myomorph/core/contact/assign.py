"""Assignment of plates to bodies: the body whose points are nearest to the center of pressure.

`OnlineFeet` does it sample by sample, without a future.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.causes import PLATES
from myomorph.core.model.errors import BadData
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.segments import feet_of
from myomorph.core.model.series import Wrenches
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

SHORTEST = 0.1
"""A body keeps a plate at least that long before another takes over [s]."""
CLEAR = 0.8
"""An episode goes to one body as a whole if it has this share of the force there."""
DOUBTFUL = 0.6
"""Distance over that of the second nearest body from which on a plate may carry two bodies."""


LOADED = 20.0
"""Force from which a plate counts as loaded [N]."""
SURE = 0.2
"""Force from which the center of pressure is trusted, as a share of body weight."""
NEAR = 0.35
"""Distance of the center of pressure to a foot beyond which it is nobody's [m]."""


def heel_and_ball(model: Model, foot: str) -> Array:
    """Heel and ball of a foot: its joint, and twice the way from there to its mass center.

    Parameters
    ----------
    model : of the body
    foot : name of its body

    Returns
    -------
    (2, 3) in the body's frame [m]
    """
    joint = next(joint for joint in model.joints if joint.child == foot)
    heel = joint.child_frame.translation
    return np.stack([heel, 2.0 * model.body(foot).mass_center - heel])


@dataclass(frozen=True)
class Contact:
    """One stretch of time in which a plate carried one body.

    Attributes
    ----------
    plate, body : names
    start, stop : first and last frame's time [s]
    distance : mean distance of the center of pressure to the body's nearest point, weighted by
        force [m]
    other_distance : the same for the body that is second nearest, inf if there is none [m]
    """

    plate: str
    body: str
    start: float
    stop: float
    distance: float
    other_distance: float


@dataclass(frozen=True, eq=False)
class Assignment:
    """Wrenches on bodies, the contacts found, and warnings about them."""

    wrenches: Wrenches
    contacts: tuple[Contact, ...]
    warnings: tuple[Message, ...] = ()


def assign_bodies(wrenches: Wrenches, positions: Mapping[str, Array]) -> Assignment:
    """Give each plate's force to the candidate body nearest to its center of pressure.

    Every stretch of time in which a plate is loaded goes to one body, or is cut where another body
    takes over. A plate that carried two bodies becomes two wrenches, named `plate_body`. Two feet
    on one plate at once cannot be separated by one plate: the force goes to the nearer one, with a
    warning.

    Parameters
    ----------
    wrenches : of plates, bodies unknown; zero force where unloaded
    positions : candidate body to points fixed to it, (frames, 3) or (frames, points, 3), on the
        clock of `wrenches`, NaN where unseen [m]

    Returns
    -------
    wrenches on bodies, with the contacts and warnings

    Raises
    ------
    BadData : no candidate, or positions of another shape
    """
    names = tuple(positions)
    if not names:
        raise BadData("no candidate body is specified to assign the plates to")
    of_bodies = [np.asarray(points, dtype=np.float64) for points in positions.values()]
    distances = np.stack(
        [_distances(wrenches, points, name) for name, points in zip(names, of_bodies, strict=True)],
        axis=-1,
    )
    step = float(np.median(np.diff(wrenches.time))) if len(wrenches) > 1 else 1.0
    min_frames = max(1, round(SHORTEST / step))
    contacts: list[Contact] = []
    warnings: list[Message] = []
    carried = np.full((len(wrenches), len(wrenches.names)), -1, dtype=np.int64)
    for plate, plate_name in enumerate(wrenches.names):
        size = np.linalg.norm(wrenches.forces[:, plate], axis=1)
        for start, stop in runs(size > 0):
            owners = _owners(distances[start:stop, plate], size[start:stop], min_frames, CLEAR)
            if owners is None:
                warnings.append(
                    PLATES.message(
                        f"no candidate body is seen while {plate_name} is loaded at"
                        f" {wrenches.time[start]:.2f} s",
                        place=plate_name,
                    )
                )
                continue
            carried[start:stop, plate] = owners
            for first, last in _runs(owners):
                here = slice(start + first, start + last)
                contact = _contact(wrenches, plate, here, distances[here, plate], size[here], names)
                contacts.append(contact)
                warnings += _doubts(contact)
    return Assignment(_split(wrenches, carried, names), tuple(contacts), tuple(warnings))


def _doubts(contact: Contact) -> list[Message]:
    """Warn of a contact in which the plate may carry two bodies."""
    if contact.distance <= DOUBTFUL * contact.other_distance:
        return []
    return [
        PLATES.message(
            f"{contact.plate} may carry two bodies from {contact.start:.2f} to"
            f" {contact.stop:.2f} s: its force went to '{contact.body}',"
            f" {contact.distance:.2f} m away (another: {contact.other_distance:.2f} m)",
            place=contact.plate,
            times=((contact.start, contact.stop),),
        )
    ]


def _distances(wrenches: Wrenches, points: Array, name: str) -> Array:
    """Distance of a body's nearest point to each plate's center of pressure.

    Parameters
    ----------
    points : (frames, 3) or (frames, points, 3) [m]

    Returns
    -------
    (frames, plates) [m]
    """
    points = points[:, None] if points.ndim == 2 else points
    if points.ndim != 3 or points.shape[0] != len(wrenches) or points.shape[2] != 3:
        raise BadData(
            f"expected positions of '{name}' of shape ({len(wrenches)}, points, 3), but got"
            f" {points.shape}: bring them to the clock of the wrenches first"
        )
    distances = np.linalg.norm(points[:, None] - wrenches.points[:, :, None], axis=3)
    return np.where(np.isfinite(distances), distances, np.inf).min(axis=2)


def _owners(
    distances: Array, size: Array, min_frames: int, clear: float
) -> NDArray[np.int64] | None:
    """Body that owns each frame of one episode, or None if none is ever seen.

    Parameters
    ----------
    distances : (frames, bodies) inf where unseen [m]
    size : (frames,) of the force [N]
    min_frames : that a body keeps the plate before another takes over
    clear : share of the force from which one body gets all of it

    Returns
    -------
    (frames,) numbers of bodies
    """
    seen = np.isfinite(distances.min(axis=1))
    if not seen.any():
        return None
    nearest = np.argmin(distances, axis=1)
    # A frame without a body in sight takes that of the last frame with one.
    index = np.maximum.accumulate(np.where(seen, np.arange(len(size)), -1))
    index[index < 0] = np.flatnonzero(seen)[0]
    nearest = nearest[index]
    shares = np.bincount(nearest, weights=size, minlength=distances.shape[1]) / size.sum()
    if shares.max() >= clear:
        return np.full(len(size), int(np.argmax(shares)), dtype=np.int64)
    spells = _runs(nearest)
    while len(spells) > 1:
        lengths = [stop - start for start, stop in spells]
        shortest = int(np.argmin(lengths))
        if lengths[shortest] >= min_frames:
            break
        start, stop = spells[shortest]
        neighbours = [i for i in (shortest - 1, shortest + 1) if 0 <= i < len(spells)]
        longer = max(neighbours, key=lambda i: lengths[i])
        nearest[start:stop] = nearest[spells[longer][0]]
        spells = _runs(nearest)
    return nearest.astype(np.int64)


def _runs(values: NDArray[np.int64]) -> list[tuple[int, int]]:
    """First frame of every run of one value, and the one after its last.

    Parameters
    ----------
    values : (frames,)
    """
    edges = np.flatnonzero(np.diff(values)) + 1
    bounds = [0, *edges.tolist(), len(values)]
    return list(pairwise(bounds))


def _contact(
    wrenches: Wrenches,
    plate: int,
    here: slice,
    distances: Array,
    size: Array,
    names: tuple[str, ...],
) -> Contact:
    """Contact of a plate with the body nearest to it in some frames.

    Parameters
    ----------
    plate : number
    here : frames
    distances : (frames, bodies) [m]
    size : (frames,) of the force [N]
    names : of the bodies
    """
    finite = np.isfinite(distances)
    weighted = np.where(finite, distances, 0.0) * size[:, None]
    total = np.where(finite, size[:, None], 0.0).sum(axis=0)
    means = np.where(total > 0, weighted.sum(axis=0) / np.where(total > 0, total, 1.0), np.inf)
    body = int(np.argmin(means))
    others = np.delete(means, body)
    time = wrenches.time[here]
    return Contact(
        plate=wrenches.names[plate],
        body=names[body],
        start=float(time[0]),
        stop=float(time[-1]),
        distance=float(means[body]),
        other_distance=float(others.min()) if len(others) else float("inf"),
    )


class Part(NamedTuple):
    """Part of a wrench.

    Attributes
    ----------
    number : of its wrench
    name, body : of the part
    acts : (frames,) when it acts
    """

    number: int
    name: str
    body: str
    acts: NDArray[np.bool_]


def _split(wrenches: Wrenches, carried: NDArray[np.int64], names: tuple[str, ...]) -> Wrenches:
    """Make one wrench for every plate and body that met.

    A plate that met none keeps its body unknown.

    Parameters
    ----------
    carried : (frames, plates) number of the body, -1 for none
    names : of the bodies
    """
    parts = []
    for plate, plate_name in enumerate(wrenches.names):
        met = sorted(set(carried[:, plate].tolist()) - {-1})
        for body in met or [-1]:
            parts.append(
                Part(
                    number=plate,
                    name=plate_name if len(met) < 2 else f"{plate_name}_{names[body]}",
                    body=names[body] if met else "",
                    acts=carried[:, plate] == body,
                )
            )
    return shared_out(wrenches, parts)


def shared_out(wrenches: Wrenches, parts: Sequence[Part]) -> Wrenches:
    """Make wrenches of parts of others.

    Parameters
    ----------
    wrenches : that are parted
    parts : of them
    """
    taken = wrenches.columns([part.number for part in parts])
    acts = np.stack([part.acts for part in parts], axis=1)[..., None]
    return replace(
        taken,
        names=tuple(part.name for part in parts),
        bodies=tuple(part.body for part in parts),
        forces=np.where(acts, taken.forces, 0.0),
        torques=np.where(acts, taken.torques, 0.0),
    )


class OnlineFeet:
    """Assignment of plates to bodies while samples arrive.

    A force acts on the body that is named, else on the foot that is nearest when the load begins.
    While the load is small, the center of pressure shows little: the foot is determined again until
    the load passes `SURE`, and then kept until it ends. A plate that is loaded near no foot acts on
    no body.

    Parameters
    ----------
    plates : names
    bodies : that the plates act on, "" where the nearest foot is to be found

    Attributes
    ----------
    bodies : on which forces may act, in the order of the wrenches
    nobody : (plates,) samples so far of load near no foot
    up : (3,) against gravity
    """

    def __init__(self, model: Model, plates: Sequence[str], bodies: Sequence[str]):
        self.plates = tuple(plates)
        named = [body for body in bodies if body]
        feet = feet_of(model) if len(named) < len(bodies) else ()
        if len(named) < len(bodies) and not feet:
            raise BadData(
                f"no body of model '{model.name}' is named as a foot: give an external loads file"
                " (.xml) that names the bodies on the plates"
            )
        self.bodies = tuple(dict.fromkeys([*named, *feet]))
        self._owner = np.array(
            [self.bodies.index(body) if body else -1 for body in bodies], np.int64
        )
        self._sure = np.zeros(len(bodies), np.bool_)
        self._sought = np.array([not body for body in bodies], np.bool_)
        self._tree = compile_tree(model)
        self._feet = [self.bodies.index(item) for item in feet]
        self._numbers = [self._tree.body_index[item] for item in feet]
        self._ends = np.array([heel_and_ball(model, item) for item in feet]).reshape(-1, 2, 3)
        self.up = model.up
        self._trusted = SURE * float(np.linalg.norm(model.gravity)) * model.mass
        self.nobody = np.zeros(len(plates), np.int64)

    def given(self, wrenches: Array, coordinates: Array | None) -> Array:
        """Give the wrenches of plates to bodies.

        Parameters
        ----------
        wrenches : (samples, plates, 6) moment about the ground's origin and force [N m], [N]
        coordinates : (coordinates,) of the newest pose, None where there is none yet

        Returns
        -------
        (samples, bodies, 6)
        """
        result = np.zeros((len(wrenches), len(self.bodies), 6))
        for plate in range(len(self.plates)):
            if not self._sought[plate]:
                result[:, self._owner[plate]] += wrenches[:, plate]
                continue
            force = np.linalg.norm(wrenches[:, plate, 3:], axis=1)
            loaded = force > LOADED
            for first, stop in _runs(loaded) if len(loaded) else ():
                if not loaded[first]:
                    self._owner[plate] = -1
                    self._sure[plate] = False
                    continue
                if not self._sure[plate] and coordinates is not None:
                    strongest = first + int(np.argmax(force[first:stop]))
                    self._seek(plate, wrenches[strongest, plate], force[strongest], coordinates)
                if self._owner[plate] < 0:
                    self.nobody[plate] += stop - first
                else:
                    result[first:stop, self._owner[plate]] += wrenches[first:stop, plate]
        unknown = np.isnan(wrenches).any(axis=(1, 2))
        result[unknown] = np.nan
        return result

    def _seek(self, plate: int, wrench: Array, size: float, coordinates: Array) -> None:
        """Find the foot that carries a wrench (6,) of a size [N], at a pose (coordinates,)."""
        nearest = self._nearest(wrench, coordinates)
        if nearest >= 0:
            self._owner[plate] = nearest
        self._sure[plate] = nearest >= 0 and bool(size > self._trusted)

    def _nearest(self, wrench: Array, coordinates: Array) -> int:
        """Find the body whose heel or ball is nearest to where a force meets the floor.

        Parameters
        ----------
        wrench : (6,) moment about the ground's origin and force [N m], [N]
        coordinates : (coordinates,)

        Returns
        -------
        -1 for none
        """
        if not np.isfinite(coordinates).all():
            return -1
        moment = wrench[:3]
        force = wrench[3:]
        lift = float(force @ self.up)
        if abs(lift) < 0.1 * LOADED:
            return -1
        poses = forward_kinematics(self._tree, np.array(coordinates, dtype=np.float64)[None])
        rotations = poses.rotations[0, self._numbers]
        ends = poses.origins[0, self._numbers][:, None] + self._ends @ rotations.swapaxes(1, 2)
        # Where the moment along the floor vanishes, in the plane through the origin.
        center = np.cross(self.up, moment) / lift
        away = ends - center
        away -= (away @ self.up)[..., None] * self.up
        distances = np.linalg.norm(away, axis=-1).min(axis=1)
        best = int(np.argmin(distances))
        return self._feet[best] if distances[best] <= NEAR else -1
