"""The kind of movement that a recording shows: by paths of markers, events and plates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.errors import counted
from myomorph.core.model.known import Known
from myomorph.core.model.movement import Movement
from myomorph.lab.analysis.animal_gait import GAIT_MOVEMENTS, found_gait
from myomorph.lab.analysis.seen_body import (
    ARM,
    GRAVITY,
    KNEE,
    MIN_FRAMES,
    SIDES,
    SeenBody,
    extent,
)
from myomorph.lab.analysis.seen_contacts import SeenContacts

# Lengths are shares of the leg's, times of a pendulum's as long, sqrt(leg / g), so that a mouse is
# judged as a man is. docs/validation/raw-recordings.md names the recordings that set them.
MAX_STILL = 0.06  # Feet and pelvis of somebody who stands leave their places by less.
MIN_REACH = 0.2  # An arm moves that goes so far.
MIN_TURNS = 2  # Feet take turns in striking the ground so often where only events show them.
MIN_STEP = 0.12  # A foot is ahead of the other that is by so much, ...
MIN_STEPPED = 0.3  # ... and both go so far over the ground or a belt, ...
MIN_SPREAD = 0.5  # ... as far apart, from one behind to one ahead, where they pass only once.
MIN_DESCENT = 0.12  # A pelvis that goes down so far over feet that stay, squats or rises; ...
MAX_BEND = 2.2  # ... the trunk of somebody who stoops goes down so many times as far.
MIN_CLIMB = 0.12  # The lower foot of somebody on stairs ends so much higher or lower.
MAX_FLIGHT = 0.25  # Of the weight: force on the ground under somebody who flies.
MIN_LIFT = 0.02  # Both feet leave the ground in a flight by so much at least.
MAX_TOGETHER = 0.35  # Feet of a jump are less far apart along the way while they fly.
MAX_BALANCE = 0.12  # Center of mass behind the feet of somebody whom no seat carries.
LOW = 15.0  # Percentile of the pelvis' height below which it counts as low.
UPRIGHT = 0.5  # The thigh of somebody who stands rises by so much of its length.


@dataclass(frozen=True, eq=False)
class SeenMotion:
    """Motion of legs and pelvis, low-pass filtered, in shares of the leg's length.

    Attributes
    ----------
    body : as markers show it, with a root and both feet
    contacts : by events or plates, None for none
    """

    body: SeenBody
    contacts: SeenContacts | None = None

    @cached_property
    def root(self) -> Array:
        """(frames, 3) place of the pelvis."""
        assert self.body.root is not None
        return self.body.smooth(self.body.root) / self.body.leg

    @cached_property
    def feet(self) -> Array:
        """(frames, sides, 3) places of the feet."""
        feet = [self.body.smooth(self.body.feet[side]) for side in SIDES]
        return np.stack(feet, axis=1) / self.body.leg

    @cached_property
    def ahead(self) -> Array:
        """(frames,) by how much the right foot is ahead of the left one."""
        apart = self.feet[:, 0] - self.feet[:, 1]
        along: Array = (apart * self.body.forward).sum(axis=1)
        return along

    @cached_property
    def passes(self) -> int:
        """How often one foot passes the other."""
        far = self.ahead[np.abs(self.ahead) > MIN_STEP]
        return int(np.count_nonzero(np.diff(np.sign(far))))

    @cached_property
    def strides(self) -> float:
        """How far the foot goes that goes less far over the ground or the belt."""
        level = self.feet[..., [0, 2]]
        return min(extent(level[:, side]) for side in range(len(SIDES)))

    @property
    def steps(self) -> bool:
        """Whether feet pass each other, both going over the ground or a belt."""
        spread = float(np.ptp(self.ahead))
        passed = self.passes >= 2 or (self.passes == 1 and spread > MIN_SPREAD)
        return passed and self.strides > MIN_STEPPED

    @cached_property
    def flights(self) -> list[slice]:
        """Stretches of frames in which both feet are off the ground and nothing carries the body.

        Without contact the body falls freely: the force on the ground over the weight, 1 + a / g
        with the pelvis' vertical acceleration a, is about 0.
        """
        time = self.body.time
        height = self.root[:, 1] * self.body.leg
        force = 1.0 + np.gradient(np.gradient(height, time), time) / GRAVITY
        lowest = np.percentile(self.feet[..., 1], 5.0, axis=0)
        lifted = (self.feet[..., 1] > lowest + MIN_LIFT).all(axis=1)
        flying = (force < MAX_FLIGHT) & lifted
        # The ends of a filtered recording are not to be believed.
        flying[:2] = False
        flying[-2:] = False
        return [slice(start, stop) for start, stop in runs(flying)]

    @property
    def flights_by(self) -> SeenContacts | None:
        """Contacts that show better than markers whether the body flies."""
        contacts = self.contacts
        return contacts if contacts is not None and contacts.tells_flight else None

    @property
    def flight_count(self) -> int:
        """How often the body flies, by events or plates where they show it, else by markers."""
        if self.flights_by is None:
            return len(self.flights)
        return self.flights_by.flights if self.flights_by.flies else 0

    @property
    def jumps(self) -> bool:
        """Whether feet are side by side in the longest flight that markers show."""
        if not self.flights:
            return False
        longest = max(self.flights, key=lambda part: part.stop - part.start)
        return bool(np.median(np.abs(self.ahead[longest])) < MAX_TOGETHER)

    @cached_property
    def climb(self) -> float:
        """By how much the lower foot ends higher than it began."""
        lower = self.feet[..., 1].min(axis=1)
        share = max(1, len(lower) // 10)
        return float(np.median(lower[-share:]) - np.median(lower[:share]))

    @cached_property
    def descent(self) -> float:
        """How far the pelvis goes up and down."""
        return _range(self.root[:, 1])

    @cached_property
    def bend(self) -> float:
        """How far the trunk goes up and down over the way of the pelvis; nan where it is unseen."""
        trunk = self.body.mean("trunk")
        if trunk is None:
            return float("nan")
        return _range(self.body.smooth(trunk)[:, 1]) / self.body.leg / self.descent

    @cached_property
    def behind(self) -> float:
        """How far the center of mass is behind the feet while the pelvis is low; nan if unknown.

        Head, arms and trunk weigh 0.65 of the body, thighs 0.2, shanks and feet 0.15, with their
        centers about halfway between the landmarks at their ends.

        Source: Winter 2009, table 4.1, rounded.
        """
        shoulders = self.body.mean("trunk.acromion", "trunk.c7", "trunk.jugular_notch")
        knees = self.body.mean(*KNEE)
        hips = self.body.root
        if shoulders is None or knees is None or hips is None:
            return float("nan")
        feet = np.mean(list(self.body.feet.values()), axis=0)
        center = 0.65 * (hips + shoulders) / 2.0 + 0.2 * (hips + knees) / 2.0 + 0.15 * feet
        ahead = ((center - feet) * self.body.forward).sum(axis=1) / self.body.leg
        low = self.root[:, 1] <= np.percentile(self.root[:, 1], LOW)
        return -float(np.median(ahead[low]))

    @property
    def standing_share(self) -> float:
        """Rise of the thighs over their length, nan where no knee is seen."""
        knee = self.body.mean(*KNEE)
        hip = self.body.root
        if knee is None or hip is None:
            return float("nan")
        thigh = hip - knee
        return float(np.nanmedian(thigh[:, 1] / np.linalg.norm(thigh, axis=1)))


def _range(heights: Array) -> float:
    low, high = np.percentile(heights, (2.0, 98.0))
    return float(high - low)


def found_movement(
    body: SeenBody, arm_alone: bool = False, contacts: SeenContacts | None = None
) -> Known[Movement]:
    """Movement of a body by its markers, and by events and plates where these are surer.

    Whether somebody flies, events and plates that carry the body show better than the pelvis'
    acceleration. Where markers show no feet, they are all there is.

    Parameters
    ----------
    body : as markers show it
    arm_alone : its markers are those of an arm, whatever protocols know of them
    contacts : of the feet with the ground, by events or plates, None for none

    Returns
    -------
    the movement and what shows it; not known where nothing shows both feet
    """
    if arm_alone or (body.labels(*ARM) and not body.feet and body.root is not None):
        return _by_markers("upper limb", "markers are on an arm, and none on a foot")
    if body.root is None or len(body.feet) < len(SIDES) or not np.isfinite(body.leg):
        why = "markers do not show the pelvis, or a thigh, and both feet"
        return movement_of_contacts(contacts) or Known(sentence=why)
    if not body.leg > 0.0:
        return movement_of_contacts(contacts) or Known(sentence="the pelvis is not above the feet")
    if len(body.time) <= MIN_FRAMES:
        return _of_a_pose(SeenMotion(body))
    return _of_a_motion(SeenMotion(body, contacts))


def movement_of_contacts(contacts: SeenContacts | None) -> Known[Movement]:
    """Movement by contacts alone.

    Feet that take turns walk or run. Plates do not show feet, so they say nothing alone.

    Parameters
    ----------
    contacts : None for none
    """
    if contacts is None or contacts.steps < MIN_TURNS or not contacts.tells_flight:
        return Known()
    turns = f"feet take turns {contacts.steps} times"
    if contacts.flies:
        sentence = f"{turns}, {counted(contacts.flights, 'flight')}"
        return Known(value="running", origin=contacts.origin, sentence=sentence)
    sentence = f"{turns}, {contacts.supports} of them while both are on the ground"
    return Known(value="walking", origin=contacts.origin, sentence=sentence)


def _by_markers(movement: Movement, sentence: str) -> Known[Movement]:
    return Known(value=movement, origin="markers", sentence=sentence)


def _of_a_motion(motion: SeenMotion) -> Known[Movement]:
    """Movement where feet and pelvis are seen over time."""
    steps = motion.steps
    if motion.body.is_animal:
        return _of_an_animal(motion, steps)
    flights = motion.flight_count
    counted = _flights_in_words(motion)
    if flights and (motion.jumps or not steps):
        return _by_markers("jumping", f"both feet leave the ground side by side, {counted}")
    if steps and abs(motion.climb) > MIN_CLIMB:
        way = 100.0 * motion.climb * motion.body.leg
        end = "higher" if way > 0.0 else "lower"
        return _by_markers("stairs", f"feet pass each other and end {abs(way):.0f} cm {end}")
    if steps and flights:
        return _by_markers("running", f"feet pass each other {_times(motion)}, {counted}")
    if steps:
        return _by_markers("walking", f"feet pass each other {_times(motion)}, {counted}")
    return _in_place(motion)


def _flights_in_words(motion: SeenMotion) -> str:
    """Say how often the body flies, and what shows it where markers do not."""
    flights = motion.flight_count
    text = counted(flights, "flight") if flights else "without flight"
    return text if motion.flights_by is None else f"{text} by {motion.flights_by.origin}"


def _of_an_animal(motion: SeenMotion, steps: bool) -> Known[Movement]:
    """Find walking or running of an animal that steps, by its gait; walking if it is not shown."""
    if not steps:
        return Known(sentence="an animal that takes no steps")
    gait = found_gait(motion.body)
    movement = "walking" if gait.value is None else GAIT_MOVEMENTS[gait.value]
    how = f"{gait.value}: {gait.sentence}" if gait else f"gait not determined: {gait.sentence}"
    text = f"feet of an animal pass each other {_times(motion)}; {how}"
    return _by_markers(movement, text)


def _times(motion: SeenMotion) -> str:
    return "once" if motion.passes == 1 else f"{motion.passes} times"


def _in_place(motion: SeenMotion) -> Known[Movement]:
    """Movement of somebody who takes no steps."""
    body = motion.body
    moved = max(extent(motion.feet[:, side]) for side in range(len(SIDES)))
    if moved > MIN_STEP:
        return _by_markers("other", "a foot moves, without steps")
    if motion.descent > MIN_DESCENT:
        way = f"the pelvis moves by {100.0 * motion.descent * body.leg:.0f} cm over feet that stay"
        if motion.behind > MAX_BALANCE:
            apart = 100.0 * motion.behind * body.leg
            return _by_markers("rising", f"{way}, and its weight is {apart:.0f} cm behind them")
        if not motion.bend > MAX_BEND:
            return _by_markers("squatting", way)
    if max(extent(motion.root), moved) > MAX_STILL:
        return _by_markers("other", "the body moves over feet that stay")
    return _of_a_pose(motion)


def _of_a_pose(motion: SeenMotion) -> Known[Movement]:
    """Standing, sitting, or arms that move, where feet and pelvis stay."""
    body = motion.body
    reach = max((extent(body.places[label]) for label in body.labels(*ARM)), default=0.0)
    if reach > MIN_REACH * body.leg:
        return _by_markers("upper limb", f"legs stay, and a hand goes {100.0 * reach:.0f} cm")
    if motion.standing_share < UPRIGHT:
        return _by_markers("other", "no movement, with level thighs: sitting")
    return _by_markers("standing", "no movement, with upright thighs")
