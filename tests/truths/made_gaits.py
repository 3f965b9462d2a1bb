"""Gaits that are made step by step on a course with turns and stops, with the truth about them.

Feet are put down beside the place where the trunk will be in the middle of the stance, stand there,
and swing to the next place: nothing is taken from the program that is tested.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Event, Series, Wrenches

FINE = 0.002  # Step of the course [s]
SMOOTH = 0.15  # Standard deviation by which speed changes [s]
WEIGHT = 500.0  # [N]
HEEL = -0.07  # Along the foot, of an adult [m]
TOE = 0.13
STEPPING = 0.15  # Share of the usual speed, or turn in rad/s, from which on feet step
SIDES = ("right", "left")


class Leg(NamedTuple):
    """A part of a course: straight on, a turn, or a stop.

    Attributes
    ----------
    seconds : it lasts [s]
    speed : share of the usual speed
    turn : to the left [rad]
    """

    seconds: float
    speed: float = 1.0
    turn: float = 0.0


@dataclass(frozen=True, kw_only=True)
class GaitPlan:
    """How somebody walks.

    Attributes
    ----------
    course : its parts, in order
    speed : usual [m/s]
    period : of a stride [s]
    duty : share of stance in the stride
    width : of steps [m]
    left : strike of the left foot after that of the right one, as a share of the stride
    drag : how far a foot that is dragged goes back on its way ahead, as a share of it
    surge : by how much the trunk is faster and slower within a step, as a share of the way
    size : of the feet, 1 of an adult
    noise : standard deviation of points [m]
    rate : of the recording [Hz]
    belt : the ground moves under somebody who stays in place
    heading : of the first part [rad]
    """

    course: tuple[Leg, ...]
    speed: float = 1.2
    period: float = 1.1
    duty: float = 0.62
    width: float = 0.12
    left: float = 0.5
    drag: float = 0.0
    surge: float = 0.015
    size: float = 1.0
    noise: float = 5e-4
    rate: float = 100.0
    belt: bool = False
    heading: float = 0.0


class TrueStride(NamedTuple):
    """A stride as it was made: start and end [s], length [m], and if the body goes straight on."""

    start: float
    stop: float
    length: float
    is_straight: bool


@read_only
class MadeGait:
    """Points of a gait, z up, and the truth.

    Attributes
    ----------
    points : "heel_r", "toe_r", "heel_l", "toe_l" and "trunk" (frames, 5, 3) [m]
    heading : (frames,) of the body [rad]
    strikes, lifts : of both sides (events,) [s]
    strides : of both sides
    """

    points: Series
    heading: Array
    strikes: Mapping[str, Array]
    lifts: Mapping[str, Array]
    strides: Mapping[str, tuple[TrueStride, ...]]

    @property
    def events(self) -> tuple[Event, ...]:
        """Strikes and lifts as a recording names them."""
        return tuple(
            Event(float(time), label, side.capitalize())
            for label, times in (("Foot Strike", self.strikes), ("Foot Off", self.lifts))
            for side in SIDES
            for time in times[side]
        )

    @property
    def facing(self) -> Array:
        """Where the body faces (frames, 3)."""
        flat = np.zeros_like(self.heading)
        return np.stack([np.cos(self.heading), np.sin(self.heading), flat], axis=1)

    @property
    def in_place(self) -> Series:
        """The points as inertial sensors show them, which know no place of the trunk."""
        trunk = self.points["trunk"]
        return Series(self.points.time, self.points.names, self.points.values - trunk[:, None])

    def plates(self) -> Wrenches:
        """Press with two humps under feet that stand, on bodies "foot_r" and "foot_l"."""
        time = np.arange(self.points.time[0], self.points.time[-1], 1e-3)
        forces = np.zeros((len(time), 2, 3))
        for column, side in enumerate(SIDES):
            for strike in self.strikes[side]:
                later = self.lifts[side][self.lifts[side] > strike]
                lift = later[0] if len(later) else np.inf
                stands = (time >= strike) & (time < lift)
                share = (time[stands] - strike) / (min(lift, time[-1]) - strike)
                forces[stands, column, 2] = WEIGHT * (0.9 + 0.3 * np.sin(2.0 * np.pi * share) ** 2)
        return Wrenches(
            time=time,
            names=("plate 1", "plate 2"),
            bodies=("foot_r", "foot_l"),
            forces=forces,
            points=np.zeros_like(forces),
            torques=np.zeros_like(forces),
        )


@read_only
class _Course:
    """The trunk's way at fine steps: time, speed (steps,), heading [rad] and place (steps, 2)."""

    time: Array
    speed: Array
    turning: Array
    heading: Array
    place: Array


def made_gait(plan: GaitPlan, seed: int = 0) -> MadeGait:
    """Make a gait.

    Parameters
    ----------
    plan : how somebody walks
    seed : of the noise

    Returns
    -------
    points and truth
    """
    course = _course(plan)
    phase = _phase(plan, course)
    feet = {side: _Foot.of(plan, course, phase, side) for side in SIDES}
    sway = 0.02 * plan.size * np.sin(2.0 * np.pi * phase)
    surge = plan.surge * plan.speed * plan.period * np.sin(4.0 * np.pi * phase)
    along = np.stack([np.cos(course.heading), np.sin(course.heading)], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    trunk = course.place + sway[:, None] * across + surge[:, None] * along
    raised = np.column_stack([trunk, np.full(len(trunk), 0.9 * plan.size)])
    fine = np.stack([*feet["right"].markers(plan), *feet["left"].markers(plan), raised], axis=1)
    if plan.belt:
        fine[:, :, :2] -= course.place[:, None]
    every = round(1.0 / plan.rate / FINE)
    values = fine[::every]
    values = values + np.random.default_rng(seed).normal(0.0, plan.noise, values.shape)
    names = ("heel_r", "toe_r", "heel_l", "toe_l", "trunk")
    return MadeGait(
        points=Series(course.time[::every], names, values),
        heading=course.heading[::every],
        strikes={side: foot.strikes for side, foot in feet.items()},
        lifts={side: foot.lifts for side, foot in feet.items()},
        strides={side: _true_strides(plan, course, foot.strikes) for side, foot in feet.items()},
    )


def _course(plan: GaitPlan) -> _Course:
    """Way of the trunk, with speeds that change smoothly."""
    counts = [round(leg.seconds / FINE) for leg in plan.course]
    speed = np.repeat([plan.speed * leg.speed for leg in plan.course], counts)
    turning = np.repeat([leg.turn / leg.seconds for leg in plan.course], counts)
    width = SMOOTH / FINE
    speed = scipy.ndimage.gaussian_filter1d(speed, width, mode="nearest")
    turning = scipy.ndimage.gaussian_filter1d(turning, width, mode="nearest")
    heading = plan.heading + np.cumsum(turning) * FINE
    velocity = speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return _Course(
        time=np.arange(len(speed)) * FINE,
        speed=speed,
        turning=turning,
        heading=heading,
        place=np.cumsum(velocity, axis=0) * FINE,
    )


def _phase(plan: GaitPlan, course: _Course) -> Array:
    """Phase (steps,) of the right foot in strides; feet finish a swing before they stop."""
    moves = (course.speed > STEPPING * plan.speed) | (np.abs(course.turning) > STEPPING)
    phase = np.empty(len(moves))
    now = 0.2
    for step, moving in enumerate(moves):
        both = now % 1.0 < plan.duty and (now - plan.left) % 1.0 < plan.duty
        if moving or not both:
            now += FINE / plan.period
        phase[step] = now
    return phase


@read_only
class _Foot:
    """A foot: place (steps, 2), heading [rad], share of heel rise, height, and its events [s]."""

    place: Array
    heading: Array
    rise: Array
    height: Array
    strikes: Array
    lifts: Array

    @classmethod
    def of(cls, plan: GaitPlan, course: _Course, phase: Array, side: str) -> _Foot:
        """Put a foot down where the trunk will be in the middle of its stance."""
        own = phase - (0.0 if side == "right" else plan.left)
        stride = np.floor(own).astype(int)
        share = own % 1.0
        spots = _spots(plan, stride)
        ways = course.heading[spots]
        across = np.stack([-np.sin(ways), np.cos(ways)], axis=1)
        aside = 0.5 * plan.width * (-1.0 if side == "right" else 1.0)
        places = course.place[spots] + aside * across
        swing = np.clip((share - plan.duty) / (1.0 - plan.duty), 0.0, 1.0)
        progress = _progress(swing, plan.drag)
        now = stride - stride[0]
        late = np.clip((share / plan.duty - 0.7) / 0.3, 0.0, 1.0)
        struck = np.flatnonzero(np.diff(stride) > 0) + 1
        lifted = np.flatnonzero((share[1:] >= plan.duty) & (share[:-1] < plan.duty)) + 1
        return cls(
            place=places[now] + progress[:, None] * (places[now + 1] - places[now]),
            heading=ways[now] + progress * (ways[now + 1] - ways[now]),
            rise=np.where(share < plan.duty, late, 1.0 - swing),
            height=0.05 * plan.size * np.sin(np.pi * swing),
            strikes=course.time[struck],
            lifts=course.time[lifted],
        )

    def markers(self, plan: GaitPlan) -> tuple[Array, Array]:
        """Heel and toe (steps, 3) [m]."""
        along = np.stack([np.cos(self.heading), np.sin(self.heading)], axis=1)
        heel = self.place + (plan.size * (HEEL + 0.05 * self.rise))[:, None] * along
        toe = self.place + plan.size * TOE * along
        high = self.height + 0.03
        return (
            np.column_stack([heel, high + 0.06 * plan.size * self.rise]),
            np.column_stack([toe, high]),
        )


def _spots(plan: GaitPlan, stride: Array) -> Array:
    """Find the steps (strides,) of the course in the middle of each stance of a foot.

    The stance that goes on at the start began before it.
    """
    middle = round(0.5 * plan.duty * plan.period / FINE)
    numbers = range(int(stride[0]), int(stride[-1]) + 1)
    starts = [int(np.argmax(stride >= number)) for number in numbers]
    return np.clip(np.array([*starts, len(stride) - 1]) + middle, 0, len(stride) - 1)


def _progress(swing: Array, drag: float) -> Array:
    """Share of the way over the share of the swing; one that drags goes back in between."""
    smooth = swing**3 * (10.0 - 15.0 * swing + 6.0 * swing**2)
    bump = np.exp(-0.5 * ((swing - 0.35) / 0.1) ** 2) - np.exp(-0.5 * ((swing - 0.6) / 0.1) ** 2)
    return np.asarray(smooth + drag * bump * (swing > 0.0) * (swing < 1.0))


def _true_strides(plan: GaitPlan, course: _Course, strikes: Array) -> tuple[TrueStride, ...]:
    """Strides of a foot: one that turns by over 30 degrees, or stops, is not straight."""
    found = []
    for start, stop in itertools.pairwise(strikes):
        inside = (course.time >= start) & (course.time <= stop)
        straight = np.ptp(course.heading[inside]) < np.radians(30.0)
        goes = course.speed[inside].min() > 0.5 * plan.speed
        length = float(np.trapezoid(course.speed[inside], course.time[inside]))
        found.append(
            TrueStride(
                start=float(start),
                stop=float(stop),
                length=length,
                is_straight=bool(straight and goes),
            )
        )
    return tuple(found)


HALF = np.pi
STRAIGHT = (Leg(10.0),)
CHILD = GaitPlan(
    course=STRAIGHT,
    speed=0.75,
    period=0.9,
    duty=0.66,
    left=0.42,
    drag=0.12,
    surge=0.05,
    size=0.7,
    noise=2e-3,
)
"""A child with CP: one foot after the other unevenly, both dragged, the trunk halting."""
OUT_AND_BACK = (Leg(6.0), Leg(1.4, speed=0.25, turn=HALF), Leg(6.0))
SHUTTLE = (
    Leg(5.0),
    Leg(1.4, speed=0.25, turn=HALF),
    Leg(5.0),
    Leg(1.4, speed=0.25, turn=-HALF),
    Leg(5.0),
)
ABRUPT = (Leg(5.0), Leg(0.8, speed=0.0), Leg(0.6, speed=0.0, turn=HALF), Leg(5.0))
SQUARE = tuple(leg for _ in range(4) for leg in (Leg(4.0), Leg(1.0, speed=0.7, turn=HALF / 2)))
STOPPED = (Leg(5.0), Leg(2.0, speed=0.0), Leg(5.0))
CIRCLE = (Leg(14.0, turn=2.0 * np.pi),)

CaseName = Literal[
    "straight",
    "out and back",
    "to and fro",
    "turn on the spot",
    "corners",
    "stop",
    "circle",
    "treadmill",
    "child with CP",
    "child with CP, out and back",
    "run, out and back",
]
PLANS: Mapping[CaseName, GaitPlan] = {
    "straight": GaitPlan(course=STRAIGHT),
    "out and back": GaitPlan(course=OUT_AND_BACK, speed=1.0),
    "to and fro": GaitPlan(course=SHUTTLE, heading=0.7),
    "turn on the spot": GaitPlan(course=ABRUPT, heading=-2.0),
    "corners": GaitPlan(course=SQUARE),
    "stop": GaitPlan(course=STOPPED),
    "circle": GaitPlan(course=CIRCLE),
    "treadmill": GaitPlan(course=STRAIGHT, belt=True, heading=1.0),
    "child with CP": CHILD,
    "child with CP, out and back": replace(CHILD, course=OUT_AND_BACK),
    "run, out and back": GaitPlan(
        course=(Leg(5.0), Leg(1.2, speed=0.2, turn=HALF), Leg(5.0)),
        speed=3.2,
        period=0.72,
        duty=0.38,
    ),
}
"""How somebody walks or runs, by name."""
