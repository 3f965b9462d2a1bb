"""Sources of error and how large each is taken to be."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np

from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.muscles.patella_spread import DISTANCE_SD, TRACK_SD

GROUPS: dict[str, tuple[str, ...]] = {
    "markers": (
        "marker_noise",
        "skin_thigh",
        "skin_shank",
        "skin_foot",
        "skin_trunk",
        "skin_arm",
        "angle",
    ),
    "placement": ("placement",),
    "sensors": ("sensor_noise", "sensor_mounting"),
    "untracked coordinates": ("untracked_coordinates",),
    "forces": ("plate_position", "plate_rotation", "plate_gain", "clock"),
    "contacts": ("contact_time", "contact_point"),
    "masses": ("body_mass", "segment_mass", "mass_center", "inertia"),
    "joints": ("joint_center", "joint_axis", "leg_alignment"),
    "filter": ("filter_cutoff",),
    "paths": ("attachment", "patella", "patella_distance", "wrap_radius"),
    "joint contacts": ("joint_contact_point",),
    "muscles": ("strength", "fiber_length", "slack_length"),
    "EMG": ("emg_gain",),
    "criterion": ("criterion",),
}
"""Groups of sources as the table of contributions names them, each with its sizes."""


@dataclass(frozen=True)
class Sources:
    """Standard deviations of the sources of error; 0 leaves one out.

    Attributes
    ----------
    marker_noise : noise of the camera system, of each marker, frame and axis independently [m]
    skin_thigh, skin_shank, skin_foot, skin_trunk, skin_arm : movement of the skin relative to the
        bone along each axis [m]; half of its variance is common to all markers of a segment, half
        independent; more where a marker's own residual is larger (Peters et al. 2010 and Leardini
        et al. 2005 collect measured values)
    skin_time : correlation time of the skin's movement: standard deviation of the Gaussian that
        correlates it [s]
    angle : error of joint angles that were given without markers, with the same correlation time
        [rad]
    placement : constant error of the position of the model's markers on their bodies, along each
        axis [m] (Della Croce et al. 2005)
    sensor_noise : error of an inertial sensor's orientation relative to the bone about each axis,
        with the correlation time of the skin [rad]
    sensor_mounting : error of the mounting and heading of inertial sensors, relative to the
        standard deviation that their calibration states
    untracked_coordinates : error of coordinates that no marker determines, relative to the standard
        deviation that inverse kinematics states of its assumption
    plate_position : error of a plate's position along both horizontal axes [m] (Collins et al.
        2009)
    plate_rotation : error of a plate's orientation about each axis, which rotates its forces [rad]:
        root mean square over the plates with surveyed corners in c3d.org's sample files
    plate_gain : relative error of the gain of each axis of a plate's force (Collins et al. 2009)
    clock : offset of the clock of the forces relative to the motion [s]; checks detect offsets from
        12 ms
    contact_time : error of the start and end of a contact whose force is estimated [s] (Zeni et al.
        2008)
    contact_point : error of the position of such a contact on its body, along each axis [m]
    body_mass : relative error of body mass; stated masses and plate measurements differ by 0 to 4 %
    segment_mass : relative error of each segment's mass, in addition to that of body mass (Rao et
        al. 2006)
    mass_center : error of each segment's center of mass along each axis, relative to its radius of
        gyration
    inertia : relative error of each segment's inertia
    joint_center : error of each joint center along each axis [m] (Kainz et al. 2015)
    joint_axis : error of the orientation of each joint's axes about each of the three [rad]
    leg_alignment : error of the frontal-plane angle between thigh and shank at each knee [rad]; a
        generic model's legs are scaled without it, and it differs among adults by standard
        deviations of 1.8 to 3.2 degrees (Nicolella et al. 2012)
    filter_cutoff : relative error of the cutoff frequency of the low-pass filter; recorded forces
        require cutoffs that differ by this much from the chosen one
    attachment : error of each point of a muscle path along each axis [m] (Carbone et al. 2012)
    patella : place on the thigh, each axis [m] (Krevolin et al. 2004)
    patella_distance : from the knee's axis, alike in both knees of a person [m]: with `patella` as
        far as arms of the patellar tendon differ between people and ways to measure them
        (`core.muscles.published_arms`)
    wrap_radius : relative error of the size of each wrapping surface
    joint_contact_point : error of each contact point of a joint along each axis [m]; the bones of
        other people, and legs with other axes, move the contact of the condyles by millimeters
        (Lerner et al. 2015)
    strength : relative error of each muscle's maximum isometric force
    fiber_length : relative error of each muscle's optimal fiber length
    slack_length : error of each tendon's slack length, relative to the optimal fiber length
    emg_gain : relative error of the gain of each EMG channel
    criterion : vary the criterion, which is a convention, if above 0: exponents of 1.5, 2 or 3
        (Crowninshield and Brand 1981), none, the usual or twice the weight of joint loads, equal
        weights or weights by volume; half of the draws with estimated contacts solve contact forces
        first
    """

    marker_noise: float = 0.0005
    skin_thigh: float = 0.008
    skin_shank: float = 0.005
    skin_foot: float = 0.003
    skin_trunk: float = 0.005
    skin_arm: float = 0.005
    skin_time: float = 0.1
    angle: float = 0.035
    placement: float = 0.005
    sensor_noise: float = 0.03
    sensor_mounting: float = 1.0
    untracked_coordinates: float = 1.0
    plate_position: float = 0.003
    plate_rotation: float = 0.0087
    plate_gain: float = 0.01
    clock: float = 0.005
    contact_time: float = 0.02
    contact_point: float = 0.01
    body_mass: float = 0.02
    segment_mass: float = 0.1
    mass_center: float = 0.1
    inertia: float = 0.15
    joint_center: float = 0.0045
    joint_axis: float = 0.035
    leg_alignment: float = 0.044
    filter_cutoff: float = 0.6
    attachment: float = 0.004
    patella: float = TRACK_SD
    patella_distance: float = DISTANCE_SD
    wrap_radius: float = 0.05
    joint_contact_point: float = 0.004
    strength: float = 0.2
    fiber_length: float = 0.1
    slack_length: float = 0.05
    emg_gain: float = 0.2
    criterion: float = 1.0

    def __post_init__(self) -> None:
        for source in fields(self):
            value = getattr(self, source.name)
            if not 0.0 <= value < math.inf:
                raise BadData(f"uncertainty '{source.name}' is {value:g}: expected 0 or more")
        if not self.skin_time > 0.0:
            raise BadData("uncertainty 'skin_time' is 0: expected a time [s] above 0")

    def of(self, group: str) -> dict[str, float]:
        """Sizes of one of `GROUPS`, by name."""
        return {name: getattr(self, name) for name in GROUPS[group]}


USUAL = "usual"
STATED = "stated"  # Where the size of a source comes from that no step found


class ItemSize(NamedTuple):
    """The size of a source for one item, in the source's own unit.

    Attributes
    ----------
    source, item : as in `Sources`, and what it is of: a body, a muscle, a point of a path
    size : standard deviation
    shared : items with the same name here err together; "" for each by itself
    """

    source: str
    item: str
    size: float
    shared: str = ""


class SourceSize(NamedTuple):
    """How large a source was taken to be.

    Attributes
    ----------
    size : of all items alike, of found sizes the median
    origin : `USUAL`, `STATED` or the step that found it
    items : of so many there are sizes of their own
    least, greatest : of these
    """

    group: str
    source: str
    size: float
    origin: str
    items: int
    least: float
    greatest: float


@dataclass(frozen=True)
class ErrorSizes:
    """Sizes that steps found, the latest step's where several found one.

    Attributes
    ----------
    items : by source and item
    origins : by source, the step
    """

    items: Mapping[str, Mapping[str, ItemSize]] = field(default_factory=lambda: FrozenMap({}))
    origins: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))

    def of(self, source: str, item: str) -> ItemSize | None:
        """Return what was found of an item, or None."""
        return self.items.get(source, {}).get(item)

    def with_step(self, step: str, sizes: Iterable[ItemSize]) -> ErrorSizes:
        """Add what a later step found.

        It replaces all that earlier ones say of its sources.
        """
        by_source: dict[str, dict[str, ItemSize]] = {}
        for size in sizes:
            by_source.setdefault(size.source, {})[size.item] = size
        items = {
            **self.items,
            **{source: FrozenMap(by_item) for source, by_item in by_source.items()},
        }
        return ErrorSizes(
            FrozenMap(items), FrozenMap({**self.origins, **dict.fromkeys(by_source, step)})
        )

    def beside(self, sources: Sources) -> ErrorSizes:
        """Without sources whose size a user stated: one that is not the usual."""
        kept = [name for name in self.items if _origin(sources, name) == USUAL]
        return ErrorSizes(
            FrozenMap({name: self.items[name] for name in kept}),
            FrozenMap({name: self.origins[name] for name in kept}),
        )


NOTHING = ErrorSizes()


def source_sizes(sources: Sources, error_sizes: ErrorSizes) -> tuple[SourceSize, ...]:
    """Every source with its size and where that comes from; one that is left out has size 0."""
    rows = []
    for group, names in GROUPS.items():
        for name in names:
            sizes = np.array([item.size for item in error_sizes.items.get(name, {}).values()])
            size = float(getattr(sources, name))
            origin = _origin(sources, name)
            if len(sizes) and origin == USUAL:
                least, middle, greatest = map(float, np.quantile(sizes, (0.0, 0.5, 1.0)))
                rows.append(
                    SourceSize(
                        group=group,
                        source=name,
                        size=middle,
                        origin=error_sizes.origins[name],
                        items=len(sizes),
                        least=least,
                        greatest=greatest,
                    )
                )
            else:
                rows.append(
                    SourceSize(
                        group=group,
                        source=name,
                        size=size,
                        origin=origin,
                        items=0,
                        least=size,
                        greatest=size,
                    )
                )
    return tuple(rows)


def _origin(sources: Sources, name: str) -> str:
    return USUAL if getattr(sources, name) == getattr(Sources(), name) else STATED
