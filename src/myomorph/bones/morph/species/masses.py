"""A species table's data of the target's skeleton: shares of mass, and markers of recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np

from myomorph.core.model.causes import MODEL
from myomorph.core.model.errors import BadData, UnknownName, check_name, quoted
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, Body, Marker, Model
from myomorph.core.model.surface import Surface


@dataclass(frozen=True)
class SegmentShare:
    """A segment's share in the body's mass."""

    name: str  # of the segment
    # of the target that make it up; they share its mass as they do in the skeleton
    bodies: tuple[str, ...]
    share: float  # of the body's mass
    interval: tuple[float, float]  # in which it lies, by what else was published

    def __post_init__(self) -> None:
        low, high = self.interval
        if not 0.0 < low <= self.share <= high < 1.0:
            raise BadData(
                f"mass of '{self.name}': expected 0 < {low:g} <= {self.share:g} <= {high:g} < 1"
            )


def with_segment_shares(
    model: Model, shares: Sequence[SegmentShare], mass: float | None = None
) -> tuple[Model, tuple[str, ...]]:
    """Give the segments' masses these shares, with all other bodies in proportion.

    Returns the model and the shares, one line each. Centers of mass and radii of gyration stay; the
    total [kg] is the model's by default.
    """
    total = model.mass if mass is None else mass
    if not (np.isfinite(total) and total > 0.0):
        raise BadData(f"a mass of {total:g} kg: expected above 0")
    factors: dict[str, float] = {}
    for share in shares:
        factors |= dict.fromkeys(share.bodies, share.share * total / _segment_mass(model, share))
    others = sum(body.mass for body in model.bodies if body.name not in factors)
    left = 1.0 - sum(share.share for share in shares)
    if left <= 0.0 or (shares and others <= 0.0):
        raise BadData(
            f"segments have {100.0 * (1.0 - left):.3g} % of the mass, nothing is left for other"
            " bodies"
        )
    rest = left * total / others
    bodies = tuple(_times(body, factors.get(body.name, rest)) for body in model.bodies)
    return replace(model, bodies=bodies), tuple(share_notes(replace(model, bodies=bodies), shares))


def _segment_mass(model: Model, share: SegmentShare) -> float:
    """Return the mass of a segment's bodies [kg], which must be there and have one."""
    for name in share.bodies:
        if name not in model.body_names:
            raise UnknownName("body", name, model.body_names)
    mass = sum(model.body(name).mass for name in share.bodies)
    if mass <= 0.0:
        raise BadData(
            f"segment '{share.name}': its bodies {', '.join(share.bodies)} have no mass to share"
        )
    return mass


def _times(body: Body, factor: float) -> Body:
    """Scale mass and inertia of a body."""
    return replace(body, mass=body.mass * factor, inertia=body.inertia * factor)


def with_possible_inertias(
    model: Model, surfaces: Mapping[str, Surface]
) -> tuple[Model, tuple[Message, ...]]:
    """Replace inertias that stand in a file for want of better ones.

    Returns the model, and how many were replaced. A body whose radius of gyration is longer than
    its bone gets the inertia of a box around the bone, evenly filled with its mass; one without a
    bone, where it is longer than any bone, that of a cube as long as the longest.
    """
    extents = {
        name: np.ptp(surface.vertices, axis=0)
        for name, surface in surfaces.items()
        if len(surface.vertices)
    }
    if not extents:
        return model, ()
    longest = np.full(3, max(float(extent.max()) for extent in extents.values()))
    most = 0.0
    changed = []

    def possible(body: Body) -> Body:
        nonlocal most
        box = extents.get(body.name, longest)
        radius = (
            float(np.sqrt(np.linalg.eigvalsh(body.inertia)[-1] / body.mass))
            if body.mass > 0.0
            else 0.0
        )
        if radius <= box.max():
            return body
        most = max(most, radius)
        changed.append(body.name)
        return replace(body, inertia=body.mass / 12.0 * np.diag((box**2).sum() - box**2))

    bodies = tuple(possible(body) for body in model.bodies)
    if not changed:
        return model, ()
    note = MODEL.message(
        f"inertias of {len(changed)} bodies ({quoted(changed, 3)}) have radii of gyration longer"
        f" than their bones, up to {1e3 * most:.3g} mm: taken for those of boxes around the bones",
        severity="may change results",
    )
    return replace(model, bodies=bodies), (note,)


def share_notes(model: Model, shares: Sequence[SegmentShare]) -> list[str]:
    """One line on segments together, and one on each whose share is outside of its interval."""
    if not shares:
        return []
    in_model = {
        share.name: sum(model.body(name).mass for name in share.bodies) / model.mass
        for share in shares
    }
    low = sum(share.interval[0] for share in shares)
    high = sum(share.interval[1] for share in shares)
    notes = [
        f"{', '.join(in_model)} have {100.0 * sum(in_model.values()):.1f} % of"
        f" {1e3 * model.mass:.3g} g (published: {100.0 * low:.1f} to {100.0 * high:.1f} %)"
    ]
    notes += [
        f"{share.name} has {100.0 * in_model[share.name]:.1f} % of the mass: published are "
        f"{100.0 * share.interval[0]:.1f} to "
        f"{100.0 * share.interval[1]:.1f} %"
        for share in shares
        if not 0.999 * share.interval[0] <= in_model[share.name] <= 1.001 * share.interval[1]
    ]
    return notes


@dataclass(frozen=True, eq=False)
class MarkerTable:
    """Markers of one protocol."""

    # name, citation: of the protocol, and whose recordings these are
    name: str
    citation: str
    # by label the body of the target and the place in its frame [m]
    places: Mapping[str, tuple[str, tuple[float, float, float]]]
    # coordinates that the protocol shows, as patterns with *; all others are locked where the
    # recording is followed (the joint to ground always moves)
    moving: tuple[str, ...] = ("*",)
    # values of coordinates with which a search for the first pose begins
    start: Mapping[str, float] | None = None


def with_markers_of(
    model: Model, tables: tuple[MarkerTable, ...], name: str
) -> tuple[Model, tuple[str, ...]]:
    """Replace the model's markers by those of one protocol, and lock what these do not show.

    Returns the model, and what was locked, one line each.
    """
    table = next((candidate for candidate in tables if candidate.name == name), None)
    if table is None:
        raise UnknownName("marker table", name, tuple(candidate.name for candidate in tables))
    _check_markers(table, model)
    markers = tuple(
        Marker(label, body, np.array(place)) for label, (body, place) in table.places.items()
    )
    root = _root_coordinates(model)
    coordinates = []
    locked = 0
    for coordinate in model.coordinates:
        still = coordinate.name not in root and not any(
            fnmatchcase(coordinate.name, pattern) for pattern in table.moving
        )
        locked += still and not coordinate.locked
        default = (table.start or {}).get(coordinate.name, coordinate.default)
        coordinates.append(replace(coordinate, locked=coordinate.locked or still, default=default))
    made = replace(model.with_markers(markers), coordinates=tuple(coordinates))
    notes = [
        f"markers of '{name}' ({table.citation}): {len(markers)}, placed on bones, to be calibrated"
        " to an animal"
    ]
    if locked:
        notes.append(
            f"{locked} of {len(coordinates)} coordinates are locked, as these markers do not show"
            " them"
        )
    return made, tuple(notes)


def _root_coordinates(model: Model) -> set[str]:
    """Return the coordinates of joints to ground."""
    return {name for joint in model.joints if joint.parent == GROUND for name in joint.coordinates}


def _check_markers(table: MarkerTable, model: Model) -> None:
    """Refuse a table of markers that names bodies or coordinates which the model lacks."""
    for body, _ in table.places.values():
        check_name("body", body, model.body_names)
    for pattern in table.moving:
        if not any(fnmatchcase(coordinate, pattern) for coordinate in model.coordinate_names):
            raise BadData(f"marker table '{table.name}': no coordinate fits '{pattern}'")
    for angle in table.start or ():
        check_name("coordinate", angle, model.coordinate_names)
