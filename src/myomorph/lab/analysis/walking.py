"""Strides of a model's motion: its limbs, their points, and whether it walks at all.

Foot strikes and foot offs of a run come from the vertical force that the center of mass shows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.segments import feet_of
from myomorph.core.model.series import Event, Motion, Series, Wrenches
from myomorph.core.model.sides import split_side
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.motion.smoothing import smooth_both_ways
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analysis.center_of_mass import centroid
from myomorph.lab.analysis.foot_events import Limb
from myomorph.lab.analysis.strides import Strides, find_strides

# Of the filter of the center of mass [Hz]; for a smaller body higher, as its strides are shorter
CUTOFF = 8.0
PADDING = 9  # Frames by which the filter's input is extended at either end
# A runner's force falls below this share of the weight between contacts; a walker's stays above 0.6
FLIGHT = 0.3
# Share of the weight at which the slope of the force is taken, along which it goes on to nothing
EDGE = 0.5
MIN_FRAMES = 24  # Frames that a second derivative takes


def vertical_force(model: Model, motion: Motion) -> Array:
    """Compute the vertical force on the whole body over its weight, 1 + a / g.

    a is the acceleration of the center of mass along the vertical.

    Parameters
    ----------
    model : with gravity and masses
    motion : coordinates (frames, coordinates) [rad or m]

    Returns
    -------
    (frames,) in body weights
    """
    g = float(np.linalg.norm(model.gravity))
    height = centroid(model, motion).values @ np.asarray(model.up)
    rate = 1.0 / float(np.median(np.diff(motion.time)))
    if rate > 2.0 * CUTOFF:
        height = smooth_both_ways(height, rate, CUTOFF, padding=PADDING)
    return 1.0 + np.gradient(np.gradient(height, motion.time), motion.time) / g


def running_contacts(
    model: Model, motion: Motion, feet: Sequence[str]
) -> Mapping[str, tuple[tuple[float, float], ...]]:
    """Find the contact intervals of each foot in a run [s].

    There are none for a walk, in which a foot is always on the ground. The events that show a
    walk's contacts, a foot farthest ahead of and behind the trunk, are far from a runner's: a foot
    goes on backward after it has left the ground. Between two flights one foot carries the body,
    the lower one. The force's slope where it passes half the weight leads to where it begins and
    ends.

    Parameters
    ----------
    model : with gravity and masses
    motion : coordinates (frames, coordinates) [rad or m]
    feet : bodies
    """
    known = np.isfinite(motion.values).all(axis=1)
    if (
        known.sum() < MIN_FRAMES
        or not known.all()
        or model.mass <= 0.0
        or not np.linalg.norm(model.gravity) > 0.0
    ):
        return {}
    force = vertical_force(model, motion)
    time = motion.time
    heights = _heights(model, motion, feet)
    stances: dict[str, list[tuple[float, float]]] = {name: [] for name in feet}
    for start, stop in _loaded(force):
        flies = (_dip(force[: start + 1][::-1]), _dip(force[stop + 1 :]))
        if max(flies) > FLIGHT:
            continue
        foot = feet[int(np.argmin(heights[start : stop + 1].mean(axis=0)))]
        stances[foot].append((_edge(time, force, start), _edge(time, force, stop)))
    return {name: tuple(intervals) for name, intervals in stances.items() if intervals}


def _loaded(force: Array) -> Iterator[tuple[int, int]]:
    """Yield the frames in which the force passes half the weight, upwards and downwards again."""
    up = np.flatnonzero((force[:-1] < EDGE) & (force[1:] >= EDGE))
    down = np.flatnonzero((force[:-1] >= EDGE) & (force[1:] < EDGE))
    for start in up:
        ends = down[down > start]
        if len(ends):
            yield int(start), int(ends[0])


def _heights(model: Model, motion: Motion, feet: Sequence[str]) -> Array:
    """Heights of the feet's origins (frames, feet) [m]."""
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    return np.stack(
        [poses.origins[:, tree.body_index[name]] @ np.asarray(model.up) for name in feet], axis=1
    )


def _dip(force: Array) -> float:
    """Find the least force until it is over half the weight again.

    That of a recording that ends there counts.
    """
    return float(force[: np.append(np.flatnonzero(force >= EDGE), len(force))[0]].min())


def _edge(time: Array, force: Array, at: int) -> float:
    """Where the line through two samples of the force reaches nothing [s]."""
    slope = (force[at + 1] - force[at]) / (time[at + 1] - time[at])
    return float(time[at] - force[at] / slope)


# The body goes over the ground, not in place on a belt, where it goes so many times as far as a
# foot.
TRAVELS = 3.0
# Feet stand, the body moves over them (up from a chair), where none goes so many times as far.
STANDS = 0.5
MIN_DUTY = 0.1  # The only stride of a recording has a stance and a swing of at least this share
# Strides of a walk differ in duration by less than this share of the usual one, as a median
STEADY = 0.35


def walking_limbs(model: Model) -> tuple[Limb, ...]:
    """Make a limb for every body that is a foot by its name and has a side.

    The result is () where there are none.
    """
    feet = [name for name in feet_of(model) if split_side(name)[1]]
    return tuple(Limb(name, (name,), bodies=(name,)) for name in feet)


def chains(model: Model, limbs: tuple[Limb, ...]) -> dict[str, frozenset[str]]:
    """Find the bodies of each limb, by limb.

    They go from the foot up to where the chains of all limbs meet; those beyond the foot belong to
    them too.
    """
    parents = {joint.child: joint.parent for joint in model.joints}
    ways: dict[str, list[str]] = {}
    for body in model.body_names:
        way = [body]
        at = parents.get(body, GROUND)
        while at != GROUND:
            way.append(at)
            at = parents.get(at, GROUND)
        ways[body] = way
    bodies_of = {limb.name: set(ways[limb.points[0]]) for limb in limbs}
    shared = set.intersection(*bodies_of.values()) if len(bodies_of) > 1 else {model.body_names[0]}
    parts = {name: bodies - shared for name, bodies in bodies_of.items()}
    names = model.body_names
    return {
        name: frozenset(body for body in names if bodies & set(ways[body]))
        for name, bodies in parts.items()
    }


def walking_points(model: Model, motion: Motion, fit: KinematicsFit | None = None) -> Series:
    """Compute the mass centers of the feet and the origin of the root (frames, points, 3) [m].

    With a fit, a foot is unseen (NaN) in frames that show no marker of it nor of the body it hangs
    on: there its pose is a guess.
    """
    tree = compile_tree(model)
    limbs = walking_limbs(model)
    names = [limb.name for limb in limbs]
    root = model.body_names[0]
    known = np.isfinite(motion.values).all(axis=1)
    values = tree.coordinates_of(motion)
    values[~known] = tree.defaults
    poses = forward_kinematics(tree, values)
    places = np.empty((len(motion), len(names) + 1, 3))
    for column, name in enumerate(names):
        b = tree.body_index[name]
        places[:, column] = (
            poses.origins[:, b] + poses.rotations[:, b] @ model.body(name).mass_center
        )
    places[:, -1] = poses.origins[:, tree.body_index[root]]
    places[~known] = np.nan
    if fit is not None and len(fit.motion) == len(motion):
        parents = {joint.child: joint.parent for joint in model.joints}
        for column, name in enumerate(names):
            bodies = (name, parents[name])
            near = [
                i
                for i, marker in enumerate(fit.marker_names)
                if model.marker(marker).body in bodies
            ]
            if near:
                places[~np.isfinite(fit.marker_error[:, near]).any(axis=1), column] = np.nan
    return Series(motion.time, (*names, root), places)


def walking_strides(
    model: Model,
    motion: Motion,
    fit: KinematicsFit | None = None,
    *,
    wrenches: Wrenches | None = None,
    events: Sequence[Event] = (),
) -> Strides | None:
    """Find the strides of a walk or a run: by plates, else by events, else by the motion.

    Parameters
    ----------
    model : of the body, whose feet are found by their names
    motion : coordinates (frames, coordinates) [rad or m]
    fit : that the motion is of: a foot without markers is then unseen
    wrenches : on the feet: strikes and lifts that they show go before all others
    events : of the recording, which go before those of the motion

    Returns
    -------
    strides with their times, lengths and widths; None where it is no walk: no feet, feet that
    stand, no stride, or none like another

    Raises
    ------
    UnknownName : the motion has a coordinate that the model has not

    Examples
    --------
    >>> import myomorph as mm
    >>> walk = mm.sample("walk")
    >>> motion = walk.truth["coordinate_value"]
    >>> strides = mm.walking_strides(walk.model, motion, wrenches=walk.loads)
    >>> [len(strides.of(foot)) for foot in ("calcn_r", "calcn_l")]
    [5, 5]
    """
    limbs = walking_limbs(model)
    if len(limbs) < 2 or not len(motion):
        return None
    points = walking_points(model, motion, fit)
    if not feet_move(points):
        return None
    feet = {body for limb in limbs for body in limb.bodies}
    plates = None
    if wrenches is not None and len(wrenches) > 1 and feet & set(wrenches.bodies):
        plates = wrenches
    try:
        strides = find_strides(
            points,
            limbs,
            model.body_names[:1],
            model.up,
            ground_speed=ground_speed(points),
            wrenches=plates,
            weight=None if plates is None else model.weight,
            events=events,
            running=running_events(model, motion, limbs),
            facing=facing_of(model, motion, limbs),
        )
    except BadData:
        return None
    return strides if _is_gait(strides) else None


def _is_gait(strides: Strides) -> bool:
    """Check that strides last alike; of an only one, that it has stance, swing and length."""
    lasting: Array = np.array([stride.duration for stride in strides.strides])
    if not len(lasting):
        return False
    if len(lasting) == 1:
        only = strides.strides[0]
        return MIN_DUTY < only.duty < 1.0 - MIN_DUTY and only.length > 0.0
    usual = float(np.median(lasting))
    unlike = float(np.median(np.abs(lasting - usual))) / usual
    return unlike < STEADY


def ground_speed(points: Series) -> float | None:
    """Return 0 where the root goes over the ground, and None where it stays in place.

    It stays in place on a belt, whose speed is not known.
    """
    # On a belt the root, the last of the points, only drifts.
    return (
        0.0
        if _way(points.values[:, -1]) > TRAVELS * max(_ways_beside(points), default=0.0)
        else None
    )


def running_events(model: Model, motion: Motion, limbs: Sequence[Limb]) -> tuple[Event, ...]:
    """Foot strikes and foot offs of a run, from its flights; () for a walk."""
    return tuple(
        Event(time, label, split_side(foot)[1].capitalize())
        for foot, intervals in running_contacts(
            model, motion, [limb.name for limb in limbs]
        ).items()
        for interval in intervals
        for time, label in zip(interval, ("Foot Strike", "Foot Off"), strict=True)
    )


def facing_of(model: Model, motion: Motion, limbs: Sequence[Limb]) -> Array | None:
    """Return where the feet point, as the root turns.

    Parameters
    ----------
    model : of the body
    motion : coordinates (frames, coordinates) [rad or m]
    limbs : whose feet they are

    Returns
    -------
    (frames, 3) mean direction from the feet's joints to their centers of mass, carried along with
    the root, NaN in unknown frames; None where feet have none
    """
    tree = compile_tree(model)
    known = np.isfinite(motion.values).all(axis=1)
    if not known.any():
        return None
    poses = forward_kinematics(tree, tree.coordinates_of(motion)[known])
    ways = [
        poses.rotations[:, tree.body_index[limb.name]] @ model.body(limb.name).mass_center
        for limb in limbs
    ]
    root = poses.rotations[:, tree.body_index[model.body_names[0]]]
    seen_from_root = np.einsum("fji,lfj->lfi", root, np.array(ways))
    mean: Array = seen_from_root.mean(axis=(0, 1))
    if not np.linalg.norm(mean) > 0.0:
        return None
    facing = np.full((len(motion), 3), np.nan)
    facing[known] = root @ mean
    return facing


def feet_move(points: Series) -> bool:
    """Whether a foot goes about as far over the ground or the belt as beside the root."""
    beside = _ways_beside(points)
    return any(_way(points.values[:, index]) > STANDS * way for index, way in enumerate(beside))


def _ways_beside(points: Series) -> list[float]:
    """How far every foot goes as the root sees it [m]."""
    return [
        _way(points.values[:, index] - points.values[:, -1])
        for index in range(len(points.names) - 1)
    ]


def _way(places: Array) -> float:
    """Extent of a path (frames, 3) without its farthest tenth [m]."""
    seen = places[np.isfinite(places).all(axis=1)]
    return (
        float(np.linalg.norm(np.ptp(np.percentile(seen, (5.0, 95.0), axis=0), axis=0)))
        if len(seen)
        else 0.0
    )
