"""Steps, rails and seats, found by what rests on them and by the force that nothing else gives.

A part of the body rests where it keeps still: heel and ball of a foot above the floor, a hand, the
pelvis of somebody who sits. It carries where known forces leave weight, and the line of what they
leave passes by it. A foot that is only held up is still as well, and a hand that hangs, but then
nothing is left, or the line passes elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from myomorph.core.contact.force_inspection import (
    LOADED,
    MOVES,
    FootPoses,
    foot_poses,
)
from myomorph.core.contact.missing_wrench import MissingWrench, missing_wrench
from myomorph.core.contact.seated import seated_frames
from myomorph.core.contact.sites import SEGMENT_SITES, body_sites
from myomorph.core.contact.spells import steady
from myomorph.core.contact.supports import Flags, Support, Supports
from myomorph.core.contact.undetermined import (
    MAX_OFFSET,
    MAX_STEP,
    MISSING,
    RESTS,
    STILL,
    centers_of_pressure,
)
from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.errors import MyomorphError
from myomorph.core.model.findings import Span
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.motion.filters import differentiate

LACKS = 0.1
"""Share of the weight from which on known forces leave something."""
TOUCHED = 0.02
"""Share of the weight from which on a known force acts on a foot, as that of somebody who sits."""
MIN_SHARE = 0.2
"""Share of what two places carry together from which on one of them carries."""
MOMENT_ERROR = 0.03
"""Of what motions need on the mean of a rest, over weight and height of the center of mass."""
GRASP = 0.12
"""Distance from the middle of a hand to what it holds on to, over a human foot's 0.19 m."""
HELD = 0.8
"""Share of the time that a hand keeps still for which it holds on to something."""
MIN_PART = 0.1
"""Share of what a hand and a foot carry together, of each at least."""
HALF = 0.5
"""Share of a time, and of what is needed from which on known forces say something of the mass."""
SEAT_DELAY = 0.3
"""Of leaving a seat after it carries less than `LACKS`, for a person [s]."""


class _Stance(NamedTuple):
    """Frames in which a foot keeps still above the floor.

    Attributes
    ----------
    foot : its number
    frames : in which it is still
    height : above the floor [m]
    beside : numbers of the forces whose centers of pressure lie beside all feet meanwhile
    """

    foot: int
    frames: slice
    height: float
    beside: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class _Scene:
    """Feet over a motion, with known forces.

    Attributes
    ----------
    model, motion : of the body
    feet : where they are
    known : external forces at the motion's times, None for none
    """

    model: Model
    motion: Motion
    feet: FootPoses
    known: Wrenches | None

    @cached_property
    def rest(self) -> float:
        """Duration for which a part keeps still at least [s]."""
        return RESTS * float(np.sqrt(self.feet.unit))

    @cached_property
    def heights(self) -> Array:
        """(frames, feet) of the lower ends of the soles [m]."""
        heels, tips = self.feet.soles
        return np.minimum(heels @ self.feet.up, tips @ self.feet.up)

    @cached_property
    def middles(self) -> Array:
        """(frames, feet, 3) middles of the soles [m]."""
        heels, tips = self.feet.soles
        return np.asarray(0.5 * (heels + tips))

    def middle(self, foot: int, frames: Flags) -> Array:
        """(1, 3) middle of a sole on the mean of some frames [m]."""
        return np.asarray(np.nanmean(self.middles[frames, foot], axis=0, keepdims=True))

    @cached_property
    def still(self) -> Flags:
        """(frames, feet) in which heel and tip keep still."""
        return self.slow(np.stack(self.feet.soles, axis=2))

    def slow(self, points: Array) -> Flags:
        """Flag where all of some points (frames, parts, points, 3) keep still; (frames, parts)."""
        speeds = np.linalg.norm(np.gradient(points, self.motion.time, axis=0), axis=3)
        limit = STILL * MOVES * np.sqrt(self.feet.unit)
        return np.asarray((np.nan_to_num(speeds, nan=np.inf) < limit).all(axis=2))

    @cached_property
    def loads(self) -> Array:
        """(frames, forces) sizes of known forces over the weight."""
        if self.known is None:
            return np.zeros((len(self.motion), 0))
        sizes = np.linalg.norm(np.nan_to_num(self.known.forces), axis=2)
        return np.asarray(sizes / self.model.weight)

    @cached_property
    def distances(self) -> Array:
        """(frames, forces, feet) of centers of pressure to the soles' middle lines [m]."""
        if self.known is None:
            return np.zeros((len(self.motion), 0, len(self.feet.feet)))
        centers = centers_of_pressure(self.known, 0.06 * float(np.sqrt(self.feet.unit)))
        return self.feet.distances(centers)

    @cached_property
    def carried(self) -> Flags:
        """(frames, feet) in which a known force acts on the foot, not beside all feet."""
        result = np.zeros(self.still.shape, bool)
        for column, body in enumerate(() if self.known is None else self.known.bodies):
            loaded = steady(self.loads[:, column] > TOUCHED, self.motion.time, self.rest)
            loaded &= ~self.is_beside[:, column]
            owner = self.feet.owners.get(body)
            if owner is not None:
                result[:, owner] |= loaded
            elif not body:
                nearest = self.distances[:, column].argmin(axis=1)
                numbers = np.arange(len(self.feet.feet))
                result |= loaded[:, None] & (numbers == nearest[:, None])
        return result

    @cached_property
    def is_beside(self) -> Flags:
        """(frames, forces) in which a center of pressure lies beside all feet."""
        lengths = np.array([foot.length for foot in self.feet.feet])
        far = (self.distances > MAX_OFFSET * lengths).all(axis=2)
        return np.asarray(far & (self.loads > LOADED))

    @cached_property
    def floor(self) -> float:
        """Height of soles that stand on plates, else of the lowest that keep still [m]."""
        on_plates = self.heights[self.carried & self.still]
        if len(on_plates):
            return float(np.nanpercentile(on_plates, 25.0))
        still = self.heights[self.still]
        return float(np.nanpercentile(still, 5.0)) if len(still) else float("nan")

    def lacking(self, unused: Sequence[tuple[slice, int]] = ()) -> MissingWrench:
        """Find what known forces leave; `unused` are frames in which a force counts for none."""
        known = self.known
        if known is not None and unused:
            forces = np.array(known.forces)
            torques = np.array(known.torques)
            for frames, column in unused:
                forces[frames, column] = 0.0
                torques[frames, column] = 0.0
            known = replace(known, forces=forces, torques=torques)
        return missing_wrench(self.model, self.motion, known, self.believed)

    @cached_property
    def believed(self) -> float:
        """Share of the model's mass that known forces carry throughout, 1 where they do not.

        A model of another mass lacks the same share of weight at all times.
        """
        if self.known is None:
            return 1.0
        needed = missing_wrench(self.model, self.motion).upward
        given = np.nan_to_num(self.known.forces).sum(axis=1) @ self.feet.up / self.model.weight
        on_plates = np.isfinite(needed) & (needed > HALF) & (given > HALF * needed)
        on_plates &= ~(self.still & ~self.carried).any(axis=1)
        if not on_plates.any():
            return 1.0
        shares = given[on_plates] / needed[on_plates]
        share = float(np.median(shares))
        alike = float(np.median(np.abs(shares - share))) < LACKS
        return share if alike else 1.0

    def tolerance(self, lacks: MissingWrench) -> float:
        """Find how far a mean line passes from what carries by errors of moments [m]."""
        force = max(float(np.linalg.norm(lacks.force[0])), 1e-3 * lacks.weight)
        high = float(np.nanmedian(self.feet.center @ self.feet.up - np.nanmin(self.heights)))
        return MOMENT_ERROR * lacks.weight * abs(high) / force

    def span(self, frames: slice) -> Span:
        """First and last time of frames [s]."""
        return float(self.motion.time[frames.start]), float(self.motion.time[frames.stop - 1])


def find_supports(model: Model, motion: Motion, known: Wrenches | None = None) -> Supports:
    """Find steps under feet, rails in hands and seats, and when the body rests on them.

    Of a foot on a step the known forces of plates must leave a fifth of the weight, and the line of
    what they leave pass by its sole; without plates, by more than a fifth of the way from the feet
    on the floor. A step that stands on a plate in part presses on it beside all feet: such a force
    is not used. A hand holds on to a rail where no foot and no seat explains what is left, and the
    line passes by the hand, or between both.

    Source: ours, measured in docs/decisions/0090-steps-rails-and-seats.md.

    Parameters
    ----------
    model : of one body
    motion : of the body, differentiated by splines where it has no derivatives
    known : external forces at the motion's times, None for none

    Returns
    -------
    none for a body without feet, and where several bodies move

    Raises
    ------
    UnknownName : the motion has a coordinate that the model does not have

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.inverse_kinematics(model, mm.read_recording("reach.trc").markers).motion
    >>> mm.contact.find_supports(model, motion).all
    ()
    """
    motion = _differentiated(motion)
    whole = np.isfinite(motion.values).all(axis=1)
    feet = foot_poses(model, motion) if whole.sum() > 3 else None
    roots = [joint for joint in model.joints if joint.parent == GROUND]
    if feet is None or len(roots) != 1 or not model.weight > 0.0 or np.ptp(motion.time) == 0.0:
        return Supports()
    scene = _Scene(model=model, motion=motion, feet=feet, known=known)
    stances = list(_raised_stances(scene))
    unused = [(stance.frames, force) for stance in stances for force in stance.beside]
    lacks = scene.lacking(unused)
    steps = [stance for stance in stances if _carries(scene, stance, stances, lacks)]
    found = [_step(scene, stance) for stance in steps]
    explained = _explained(scene, steps)
    found += _seats(scene, lacks, explained)
    for start, stop in runs(_lacking_frames(scene, lacks) & ~explained):
        found += _rails(scene, lacks, slice(start, stop), stances)
    return Supports(tuple(sorted(found, key=lambda support: support.rests)))


def _differentiated(motion: Motion) -> Motion:
    """Return a motion with derivatives."""
    known = motion.velocities is not None and motion.accelerations is not None
    return motion if known else differentiate(motion)


def _raised_stances(scene: _Scene) -> Iterator[_Stance]:
    """Find where feet keep still above the floor."""
    lengths = np.array([foot.length for foot in scene.feet.feet])
    raised = scene.still & (scene.heights > scene.floor + MAX_STEP * lengths)
    for foot in range(len(lengths)):
        for start, stop in runs(raised[:, foot]):
            frames = slice(start, stop)
            first, last = scene.span(frames)
            if last - first < scene.rest:
                continue
            beside = scene.is_beside[frames].mean(axis=0) > 0.5
            yield _Stance(
                foot=foot,
                frames=frames,
                height=float(np.median(scene.heights[frames, foot])) - scene.floor,
                beside=tuple(np.flatnonzero(beside).tolist()),
            )


def _carries(
    scene: _Scene, stance: _Stance, stances: Sequence[_Stance], lacks: MissingWrench
) -> bool:
    """Tell whether a foot that keeps still above the floor carries what known forces leave."""
    frames = stance.frames
    if scene.carried[frames, stance.foot].mean() > 0.5:
        return False  # Its step stands on a plate, which measures it.
    if lacks.upward[frames].mean() < MISSING:
        return False
    inside = np.zeros(len(scene.motion), bool)
    inside[frames] = lacks.upward[frames] > LACKS
    mean = lacks.mean(inside)
    near = MAX_OFFSET * scene.feet.feet[stance.foot].length + scene.tolerance(mean)
    own = scene.middle(stance.foot, inside)
    others = [
        scene.middle(foot, inside)
        for foot in range(len(scene.feet.feet))
        if foot != stance.foot and _stands_unmeasured(scene, foot, stances)[inside].mean() > HALF
    ]
    if not others:
        return bool(np.linalg.norm(mean.offsets(own)[0]) < near)
    share, distance = mean.between(np.mean(others, axis=0), own)
    return bool(distance[0] < near and share[0] > MIN_SHARE)


def _stands_unmeasured(scene: _Scene, foot: int, stances: Sequence[_Stance]) -> Flags:
    """Flag when a foot may carry without a known force; (frames,)."""
    length = scene.feet.feet[foot].length
    stands = scene.still[:, foot] & (scene.heights[:, foot] < scene.floor + MAX_STEP * length)
    for stance in stances:
        if stance.foot == foot:
            stands[stance.frames] = True
    return np.asarray(stands & ~scene.carried[:, foot])


def _step(scene: _Scene, stance: _Stance) -> Support:
    """Make a support of a foot that carries on a step."""
    foot = scene.feet.feet[stance.foot]
    heights = scene.heights[:, stance.foot]
    still = [
        (start, stop)
        for start, stop in runs(scene.still[:, stance.foot])
        if scene.motion.time[stop - 1] - scene.motion.time[start] >= scene.rest
    ]
    before = max((stop for _, stop in still if stop <= stance.frames.start), default=0)
    after = min((start for start, _ in still if start >= stance.frames.stop), default=len(heights))
    way_there = heights[before : stance.frames.start + 1]
    way_on = heights[stance.frames.stop - 1 : after]
    window = slice(
        before + int(np.nanargmax(way_there)) if len(way_there) > 1 else stance.frames.start,
        stance.frames.stop + int(np.nanargmax(way_on)) if len(way_on) > 1 else stance.frames.stop,
    )
    names = () if scene.known is None else scene.known.names
    return Support(
        contact=foot.name,
        body=foot.heel,
        kind="step",
        height=stance.height,
        rests=scene.span(stance.frames),
        window=scene.span(window),
        unused=tuple(names[force] for force in stance.beside),
    )


def _explained(scene: _Scene, steps: Sequence[_Stance]) -> Flags:
    """Flag frames in which feet without a known force carry; (frames,)."""
    result = np.zeros(len(scene.motion), bool)
    for foot in range(len(scene.feet.feet)):
        # Heel or tip alone may stand, as at the end of a step.
        moving = [
            np.linalg.norm(np.gradient(ends[:, foot], scene.motion.time, axis=0), axis=1)
            for ends in scene.feet.soles
        ]
        stands = np.minimum(*moving) < MOVES * np.sqrt(scene.feet.unit)
        length = scene.feet.feet[foot].length
        low = scene.heights[:, foot] < scene.floor + MAX_STEP * length
        result |= stands & low & ~scene.carried[:, foot]
    for stance in steps:
        first, last = scene.span(stance.frames)
        around = scene.rest
        result |= (scene.motion.time >= first - around) & (scene.motion.time <= last + around)
    return result


def _lacking_frames(scene: _Scene, lacks: MissingWrench) -> Flags:
    """Flag frames in which known forces leave weight for as long as something can rest."""
    left = np.nan_to_num(lacks.upward) > LACKS
    return steady(left, scene.motion.time, scene.rest)


def _seats(scene: _Scene, lacks: MissingWrench, explained: Flags) -> list[Support]:
    """Find when somebody sits on something; those frames become `explained`."""
    if scene.known is None:
        return []
    try:
        (site,) = body_sites(scene.model, ("seat",))
    except MyomorphError:
        return []
    found = []
    seated = seated_frames(scene.model, scene.motion)
    rotations, origins = scene.feet.pose_of(site.body)
    places = origins + rotations @ site.points.mean(axis=0)
    for start, stop in runs(_lacking_frames(scene, lacks) & seated):
        frames = slice(start, stop)
        first, last = scene.span(frames)
        if last - first < scene.rest or not _is_on_seat(scene, lacks, frames, places):
            continue
        explained[frames] = True
        delay = SEAT_DELAY * float(np.sqrt(scene.feet.unit))
        found.append(
            Support(
                contact="seat",
                body=site.body,
                kind="seat",
                height=0.0,
                rests=(first, last),
                window=(first - delay, last + delay),
            )
        )
    return found


def _is_on_seat(scene: _Scene, lacks: MissingWrench, frames: slice, places: Array) -> bool:
    """Tell whether a seat carries, where feet without a known force may carry as well.

    Parameters
    ----------
    places : (frames, 3) middle of the seat [m]
    """
    inside = np.zeros(len(scene.motion), bool)
    inside[frames] = True
    others = [
        scene.middle(foot, inside)
        for foot in range(len(scene.feet.feet))
        if _stands_unmeasured(scene, foot, ())[inside].mean() > HALF
    ]
    if not others:
        return True
    place = places[inside].mean(axis=0)[None]
    share, _ = lacks.mean(inside).between(np.mean(others, axis=0), place)
    return bool(share[0] > MIN_SHARE)


def _rails(
    scene: _Scene, lacks: MissingWrench, frames: slice, stances: Sequence[_Stance]
) -> list[Support]:
    """Find hands that hold on to something in frames in which known forces leave weight.

    Where a foot keeps still above the floor meanwhile, the line may pass between it and a hand.
    """
    first, last = scene.span(frames)
    if scene.known is None or last - first < scene.rest:
        return []
    inside = np.zeros(len(scene.motion), bool)
    inside[frames] = True
    mean = lacks.mean(inside)
    near = GRASP * scene.feet.unit + scene.tolerance(mean)
    held = {
        name: place for name, place in _hands(scene).items() if _held(scene, place, frames) > HELD
    }
    places = {name: np.nanmean(place[inside], axis=0)[None] for name, place in held.items()}
    carrying = _hands_alone(mean, places, near)
    if carrying:
        return [_rail(scene, name, held[name], frames) for name in carrying]
    meanwhile = [stance for stance in stances if inside[stance.frames].sum() > HALF * inside.sum()]
    for stance, name in product(meanwhile, places):
        share, distance = mean.between(places[name], scene.middle(stance.foot, inside))
        if distance[0] < near and MIN_PART < share[0] < 1.0 - MIN_PART:
            return [_rail(scene, name, held[name], frames), _step(scene, stance)]
    return []


def _hands_alone(mean: MissingWrench, places: Mapping[str, Array], near: float) -> tuple[str, ...]:
    """Find hands by which a mean line passes, or between which: their names, () for none.

    Parameters
    ----------
    mean : what known forces leave, of one frame
    places : (1, 3) of each hand that keeps still [m]
    near : distance of the line, at most [m]
    """
    misses = {name: float(np.linalg.norm(mean.offsets(place)[0])) for name, place in places.items()}
    if misses and min(misses.values()) < near:
        return (min(misses, key=lambda name: misses[name]),)
    both = tuple(places)
    if len(both) == 2 and mean.between(*places.values())[1][0] < near:
        return both
    return ()


def _hands(scene: _Scene) -> dict[str, Array]:
    """Find middles (frames, 3) of hands by their sites' names [m]."""
    found = {}
    for name in SEGMENT_SITES:
        if not name.startswith("hand"):
            continue
        try:
            (site,) = body_sites(scene.model, (name,))
        except MyomorphError:
            continue
        rotations, origins = scene.feet.pose_of(site.body)
        found[name] = origins + rotations @ site.points.mean(axis=0)
    return found


def _held(scene: _Scene, place: Array, frames: slice) -> float:
    """Find the share of frames in which a place (frames, 3) keeps still."""
    return float(scene.slow(place[:, None, None])[frames].mean())


def _rail(scene: _Scene, name: str, place: Array, frames: slice) -> Support:
    """Make a support of a hand that holds on to something, for as long as it keeps still."""
    still = steady(scene.slow(place[:, None, None])[:, 0], scene.motion.time, 0.5 * scene.rest)
    window = frames
    for start, stop in runs(still):
        if start < frames.stop and stop > frames.start:
            window = slice(min(window.start, start), max(window.stop, stop))
    (site,) = body_sites(scene.model, (name,))
    return Support(
        contact=name,
        body=site.body,
        kind="rail",
        height=0.0,
        rests=scene.span(frames),
        window=scene.span(window),
    )
