"""Contact intervals of sites: by force plates, by motion over the floor, or by several sources.

The activation of a site (how far it may carry force) follows from the same motion, and so does the
preferred direction of its force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.site_motion import Floor, SiteMotion, center_of, floor_under, site_motion
from myomorph.core.contact.spells import hysteresis, steady
from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.causes import CONTACTS
from myomorph.core.model.contacts import Contacts, Site, Touch
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.motion.sync import refuse_other_times
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

Bools = NDArray[np.bool_]

PLATES = "plates"
KINEMATICS = "kinematics"
"""Sources of contact intervals."""
LASTING = 0.4
"""A contact outside those of a more trusted source that lasts for so long is one of its own [s]."""
MIN_UNSUPPORTED = 0.1
"""Times without a site that could carry the body are named when they last longer [s]."""
GUESSED_CONFIDENCE = 0.5
"""Confidence of a contact of the nearest site, where none is near enough."""


PIVOT = 0.3
"""Height of the virtual pivot point above the center of mass, over the height of that above the
floor.
"""


@read_only
@dataclass(frozen=True)
class ContactStateOptions:
    """Thresholds of contact. Lengths count from `SiteMotion.height`, speeds from sqrt(g height).

    Attributes
    ----------
    low, high : a contact begins below the height `low` over the floor and ends above `high`
    slow, fast : it begins at less than the speed `slow` against the floor and ends at more than
        `fast`
    flight : share of the weight below which the body flies: nothing touches
    carried : share of the weight from which on something must touch
    loaded, unloaded : a plate carries from this share of the weight on, until less than that is
        left
    reach : a site within this distance of a plate's center of pressure may stand on it
    shortest : contacts and gaps that last less are taken for noise [s]
    floor : height of the floor [m], None to find it
    steps : (frames, sites) height above the floor of what sites stand on [m], None for the floor
        throughout
    """

    low: float = 0.035
    high: float = 0.05
    slow: float = 0.3
    fast: float = 0.5
    flight: float = 0.05
    carried: float = 0.2
    loaded: float = 0.03
    unloaded: float = 0.015
    reach: float = 0.2
    shortest: float = 0.03
    floor: float | None = None
    steps: Array | None = field(default=None, compare=False)


def find_contacts(
    model: Model,
    motion: Motion,
    sites: Sequence[Site],
    options: ContactStateOptions | None = None,
    plates: Wrenches | None = None,
) -> Contacts:
    """Find contact intervals of sites from how they move, and from plates where there are any.

    A site touches while it is low over the floor and slow against it, both with hysteresis. While
    the center of mass falls freely nothing touches; while it does not, and no site is near enough,
    the nearest one does, with a confidence of a half. The confidence of the others is the mean
    margin to the thresholds at which they leave. Where a plate's force is given, the group whose
    sites are nearest to its center of pressure touches while it is loaded, and does not while all
    plates that could carry it are unloaded.

    Source: ours, described and measured in docs/contacts.md.

    Parameters
    ----------
    model : the body, with the bodies that the sites are on
    motion : coordinates over time, filtered
    sites : places that can touch, see `model.contacts.Site` [m]
    options : heights [m], speeds [m/s] and times [s] that make a touch; see `ContactStateOptions`
    plates : forces on bodies (or of plates, bodies unknown), at the motion's times

    Returns
    -------
    contact intervals of each site with confidence, and what looks wrong in `warnings`

    Raises
    ------
    BadData : no frame of the motion is whole, or the plates' times are not the motion's

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> sites = [mm.Site("hand", "fore", [[0.0, -0.3, 0.0]])]
    >>> contacts = mm.find_contacts(model, mm.read_motion("reach.mot", model), sites)
    >>> [(item.site, round(item.start, 2), round(item.stop, 2)) for item in contacts.intervals]
    [('hand', 0.52, 0.6)]
    """
    options = options or ContactStateOptions()
    moving = site_motion(model, motion, sites).over(options.steps)
    floor = floor_under(moving, options.floor)
    result = by_kinematics(moving, floor, sites, options)
    if plates is None:
        return result
    return merge_contacts((by_plates(model, moving, sites, plates, options), result))


def by_kinematics(
    moving: SiteMotion,
    floor: Floor,
    sites: Sequence[Site],
    options: ContactStateOptions | None = None,
) -> Contacts:
    """Find contact intervals from how sites move over the floor, and what the center of mass needs.

    Source: ours, described and measured in docs/contacts.md.

    Parameters
    ----------
    moving : positions and speeds of the sites
    floor : height and velocity of the ground
    sites : of contact, in the order of `moving`
    options : thresholds

    Returns
    -------
    intervals of each site [s]
    """
    options = options or ContactStateOptions()
    height = (moving.lowest - floor.height) / moving.height
    speed = np.linalg.norm(moving.velocities - floor.velocity, axis=2) / moving.pace
    # (frames, sites) 1 at the threshold at which a contact ends
    margin = np.maximum(height / options.high, speed / options.fast)
    known = np.isfinite(margin)
    margin = np.where(known, margin, np.inf)
    begins = known & (height < options.low) & (speed < options.slow)
    touching = hysteresis(begins, ~known | (margin > 1.0))

    flies = np.nan_to_num(moving.carried, nan=1.0) < options.flight
    flies = steady(flies, moving.time, options.shortest)
    touching[flies] = False
    touching = np.stack(
        [steady(column, moving.time, options.shortest) for column in touching.T], axis=1
    )
    touching[flies] = False

    # Something carries the body: where no site is near enough, the nearest one does.
    held_up = (moving.carried > options.carried) & ~touching.any(axis=1)
    nearest = (margin <= 1.25 * margin.min(axis=1, keepdims=True)) & (margin < 2.0)
    guessed = held_up[:, None] & nearest
    confidence = np.clip(1.0 - 0.5 * margin, 0.5, 1.0)
    confidence = np.where(guessed, GUESSED_CONFIDENCE, confidence)
    return Contacts(
        tuple(site.name for site in sites),
        touches_of(sites, touching | guessed, confidence, moving.time, KINEMATICS),
        _unsupported(moving, held_up & ~guessed.any(axis=1)),
    )


def touches_of(
    sites: Sequence[Site], touching: Bools, confidence: Array, time: Array, source: str
) -> tuple[Touch, ...]:
    """Contact interval of every run of frames in which a site touches.

    Parameters
    ----------
    sites : one per column
    touching : (frames, sites)
    confidence : (frames, sites) 0 to 1, whose mean an interval has
    time : (frames,) [s]
    source : what the intervals were found by

    Returns
    -------
    intervals, site by site
    """
    touches = []
    for column, site in enumerate(sites):
        for start, stop in runs(touching[:, column]):
            touches.append(
                Touch(
                    site=site.name,
                    start=float(time[start]),
                    stop=float(time[stop - 1]),
                    surface=site.against,
                    confidence=float(confidence[start:stop, column].mean()),
                    source=source,
                )
            )
    return tuple(touches)


def _unsupported(moving: SiteMotion, missing: Bools) -> tuple[Message, ...]:
    """Warn of frames (frames,) in which no site can carry what the motion needs."""
    spans = [
        (float(moving.time[start]), float(moving.time[stop - 1]))
        for start, stop in runs(missing)
        if moving.time[stop - 1] - moving.time[start] > MIN_UNSUPPORTED
    ]
    if not spans:
        return ()
    first = ", ".join(f"{start:.2f} to {stop:.2f} s" for start, stop in spans[:4])
    few = first + (", ..." if len(spans) > 4 else "")
    return (
        CONTACTS.message(
            f"something carries the body at {few}, but no contact site is near the floor: is a site"
            " missing?",
            times=spans,
        ),
    )


def by_plates(
    model: Model,
    moving: SiteMotion,
    sites: Sequence[Site],
    plates: Wrenches,
    options: ContactStateOptions,
) -> Contacts:
    """Find contact intervals from loaded plates: of the group nearest to the center of pressure.

    A plate is loaded from `loaded` of the model's weight on, until less than `unloaded` is left. Of
    the group, the sites touch that are less than `high` above the lowest of them.

    Parameters
    ----------
    model : whose weight counts
    moving : positions and speeds of the sites
    sites : of contact, in the order of `moving`
    plates : their forces at the times of `moving`
    options : thresholds

    Returns
    -------
    intervals of each site [s]
    """
    refuse_other_times("forces of plates", plates.time, moving.time)
    groups = list(grouped((site.group, index) for index, site in enumerate(sites)).values())
    weight = model.weight
    pressing = plates.forces @ moving.up
    touching = np.zeros((len(moving.time), len(sites)), np.bool_)
    for plate in range(len(plates.names)):
        load = np.nan_to_num(pressing[:, plate])
        state = hysteresis(load > options.loaded * weight, load < options.unloaded * weight)
        state = steady(state, moving.time, options.shortest)
        distances = moving.distances_to(plates.points[:, plate])
        for start, stop in runs(state):
            part = slice(start, stop)
            mean = _mean_distances(distances[part], load[part])
            members = min(groups, key=lambda group: mean[group].min())
            if not mean[members].min() < options.reach * moving.height:
                continue
            level = moving.lowest[part][:, members]
            low = level < np.nanmin(level, axis=1, keepdims=True) + options.high * moving.height
            touching[part, members] |= low
    touches = touches_of(sites, touching, np.ones(touching.shape), moving.time, PLATES)
    return Contacts(tuple(site.name for site in sites), touches)


def _mean_distances(distances: Array, load: Array) -> Array:
    """Mean over frames of distances (frames, sites), weighted by a load (frames,); (sites,)."""
    share = load[:, None] * np.isfinite(distances)
    total = np.maximum(share.sum(axis=0), 1e-12)
    return (np.nan_to_num(distances) * share).sum(axis=0) / total


def merge_contacts(sources: Sequence[Contacts]) -> Contacts:
    """Join contacts of several sources, the most trusted first.

    An interval is cut where one of the same site from a source before it covers it, and left out
    where no more than half and no part of `LASTING` is left: so much the sources' times may differ.

    Parameters
    ----------
    sources : contacts of each

    Returns
    -------
    contacts of all sites, with all warnings
    """
    names = tuple(dict.fromkeys(name for source in sources for name in source.sites))
    joined: list[Touch] = []
    for source in sources:
        before = tuple(joined)
        for touch in source.intervals:
            rest = _outside(touch, [item for item in before if item.site == touch.site])
            if _lasts(touch, rest):
                joined += rest
    warnings = tuple(text for source in sources for text in source.warnings)
    return Contacts(names, tuple(joined), warnings)


def _lasts(touch: Touch, rest: Sequence[Touch]) -> bool:
    """Return whether enough of an interval is left to be a contact of its own."""
    durations = [piece.stop - piece.start for piece in rest]
    if sum(durations) > 0.5 * (touch.stop - touch.start):
        return True
    return max(durations, default=0.0) > LASTING or list(rest) == [touch]


def _outside(touch: Touch, others: Sequence[Touch]) -> list[Touch]:
    """Cut from an interval what others cover."""
    parts = [touch]
    for other in others:
        cut = []
        for part in parts:
            if other.stop < part.start or other.start > part.stop:
                cut.append(part)
                continue
            cut += [replace(part, stop=other.start)] if part.start < other.start else []
            cut += [replace(part, start=other.stop)] if other.stop < part.stop else []
        parts = cut
    return parts


@read_only
@dataclass(frozen=True)
class ActivationOptions:
    """Limits at which activations fade. Lengths count from the center of mass' height.

    Speeds count from sqrt(g height). The defaults are, for an adult, the 40 mm and 0.8 m/s that
    AnyBody's template for ground forces documents.

    Attributes
    ----------
    height, speed : at which a site is not ready any more
    high, fast : shares of those up to which it is fully ready
    least : activation of a site that touches, however it moves
    floor : height of the floor [m], None to find it
    steps : (frames, sites) height above the floor of what sites stand on [m], None for the floor
        throughout
    """

    height: float = 0.042
    speed: float = 0.26
    high: float = 0.8
    fast: float = 0.15
    least: float = 0.05
    floor: float | None = None
    steps: Array | None = field(default=None, compare=False)


def contact_activations(
    model: Model,
    motion: Motion,
    sites: Sequence[Site],
    contacts: Contacts | None = None,
    options: ActivationOptions | None = None,
) -> Series:
    """Activation of each contact: how ready a site is to carry force, 0 to 1.

        s = max(least, fade(z / z_limit, high) fade(v / v_limit, fast)) confidence
        fade(x, a) = 1 below a, (1 + cos(pi (x - a) / (1 - a))) / 2 up to 1, then 0

    of the height z of a site's lowest point over the floor and its speed v against it, times how
    sure it is that it touches: an activation that fades with height and speed, in the manner of
    Fluit et al. (2014) and Skals et al. (2017); the curve is ours. A site on anything but the
    ground is as ready as it is sure to touch.

    Parameters
    ----------
    model : the body, with the bodies that the sites are on
    motion : coordinates over time, filtered
    sites : places that can touch [m]
    contacts : when sites touch; all the time without
    options : heights and speeds at which readiness fades, see `ActivationOptions`

    Returns
    -------
    (frames, sites) from 0 to 1, at the motion's times

    Raises
    ------
    BadData : a site is missing in the contacts, or no frame of the motion is whole

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.differentiate(mm.read_motion("reach.mot", model), cutoff=6.0)
    >>> sites = [mm.Site("hand", "fore", [[0.0, -0.3, 0.0]], mm.Cone(direction=model.up))]
    >>> contacts = mm.find_contacts(model, motion, sites)
    >>> ready = mm.contact.contact_activations(model, motion, sites, contacts)
    >>> ready.names, ready.values.shape, bool((ready.values <= 1.0).all())
    (('hand',), (61, 1), True)
    """
    options = options or ActivationOptions()
    names = tuple(site.name for site in sites)
    values = np.ones((len(motion), len(sites)))
    if contacts is not None:
        values = _confidence(contacts, names, motion.time)
    on_ground = [index for index, site in enumerate(sites) if site.against == GROUND]
    if on_ground:
        moving = site_motion(model, motion, [sites[number] for number in on_ground])
        steps = options.steps
        moving = moving.over(None if steps is None else steps[:, on_ground])
        floor = floor_under(moving, options.floor)
        z = (moving.lowest - floor.height) / moving.height
        v = np.linalg.norm(moving.velocities - floor.velocity, axis=2) / moving.pace
        ready = fade(z / options.height, options.high) * fade(v / options.speed, options.fast)
        min_activation = options.least if contacts is not None else 0.0
        values[:, on_ground] *= np.nan_to_num(np.maximum(ready, min_activation))
    return Series(motion.time, names, values)


def _confidence(contacts: Contacts, names: Sequence[str], time: Array) -> Array:
    """Confidence (frames, sites) of contacts at times (frames,), 0 without contact."""
    missing = [name for name in names if name not in contacts.sites]
    if missing:
        raise BadData(
            f"contacts say nothing of site '{missing[0]}': they are of {', '.join(contacts.sites)}"
        )
    columns = [contacts.sites.index(name) for name in names]
    return np.array(contacts.states(time).values[:, columns])


def preferred_directions(
    model: Model, motion: Motion, sites: Sequence[Site], pivot: float = PIVOT
) -> Array:
    """Preferred directions of forces at sites on the ground: to a pivot above the mass center.

    What two feet push against each other moves nothing, so physics leaves it open. Walkers' ground
    forces meet near a point above the center of mass, the virtual pivot point (Maus et al. 2010): a
    force towards it costs least.

    Parameters
    ----------
    model : the body, with the bodies that the sites are on
    motion : coordinates over time
    sites : places that can touch [m]
    pivot : height of the point above the center of mass, over the height of that above the floor

    Returns
    -------
    (frames, sites, 3) in ground: force across the cone's direction per force along it, 0 of a site
    on anything but the ground, or whose cone has no direction fixed in ground

    Raises
    ------
    BadData : no frame of the motion is whole

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.differentiate(mm.read_motion("reach.mot", model), cutoff=6.0)
    >>> sites = [mm.Site("hand", "fore", [[0.0, -0.3, 0.0]], mm.Cone(direction=model.up))]
    >>> mm.contact.preferred_directions(model, motion, sites).shape
    (61, 1, 3)
    """
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    moving = site_motion(model, motion, sites)
    subjects = tree.roots
    result = np.zeros((len(motion), len(sites), 3))
    for subject in np.unique(subjects[1:]):
        center = center_of(tree, poses, subjects == subject)
        pivots = center + pivot * moving.height * moving.up
        for index, site in enumerate(sites):
            up = site.cone.direction
            if subjects[tree.body_index[site.body]] != subject or site.against != GROUND:
                continue
            if up is None or site.cone.frame != GROUND:
                continue
            way = pivots - moving.places[:, index]
            along = way @ up
            ahead = along > 0.1 * moving.height
            result[ahead, index] = way[ahead] / along[ahead, None] - up
    return result


def fade(x: Array, full: float) -> Array:
    """1 below `full`, half a cosine down to 0 at 1, 0 beyond; NaN stays.

    Parameters
    ----------
    x : of any shape
    full : up to where it is 1

    Returns
    -------
    as x
    """
    way = np.clip((x - full) / (1.0 - full), 0.0, 1.0)
    return 0.5 * (1.0 + np.cos(np.pi * way))
