"""Muscles and ligaments in other bones, with the surfaces that they go around."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from myomorph.model.model import Coordinate, Model
from myomorph.model.paths import Ligament, Muscle, WrapObject
from myomorph.morph.carrier import Carriers
from myomorph.morph.carry_points import Setting, carried_paths
from myomorph.morph.carry_wraps import carried_wrap
from myomorph.morph.morphed import CarriedPoint
from myomorph.morph.wraps_and_points import points_left_outside


@dataclass(frozen=True, eq=False)
class CarriedStrings:
    """Paths of muscles and ligaments in the target's bones; forces and fibers are still the source's.

    Attributes
    ----------
    points : of all of them, in order, muscles first
    """

    muscles: tuple[Muscle, ...]
    ligaments: tuple[Ligament, ...]
    wrap_objects: tuple[WrapObject, ...]
    points: tuple[CarriedPoint, ...]
    notes: tuple[str, ...]


def carried_strings(
    source: Model,
    muscles: Iterable[Muscle],
    ligaments: Iterable[Ligament],
    carriers: Carriers,
    coordinates: Iterable[Coordinate],
    travel: Mapping[str, float],
    within: float,
) -> CarriedStrings:
    """Paths by the maps of the bodies that their points are fixed to, and the source's wrap objects on those bodies.

    Parameters
    ----------
    muscles, ligaments : all of whose bodies have a carrier
    coordinates : that their points may depend on
    travel : how much further a coordinate that slides goes in the target
    within : distance from the surface up to which a point belongs to it, as a share of the bone's length
    """
    muscles, ligaments = tuple(muscles), tuple(ligaments)
    wraps = {
        wrap.name: (wrap, carried_wrap(wrap, carriers[wrap.body]))
        for wrap in source.wrap_objects
        if wrap.body in carriers
    }
    setting = Setting({one.name: one for one in coordinates}, travel, wraps)
    owned = [(one.name, one.path) for one in muscles] + [(one.name, one.path) for one in ligaments]
    carried = carried_paths(owned, carriers, setting, within)
    wraps, smaller = points_left_outside(muscles, carried.points, wraps)
    paths = iter(carried.paths)
    return CarriedStrings(
        tuple(replace(one, path=next(paths)) for one in muscles),
        tuple(replace(one, path=next(paths)) for one in ligaments),
        tuple(after for _, after in wraps.values()),
        carried.points,
        (*carried.notes, *smaller),
    )
