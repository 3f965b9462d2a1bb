"""Plan of a gait, and the footfalls that follow from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from myomorph.core.model.arrays import Array, read_only

Side = Literal["right", "left"]
SIDES: tuple[Side, Side] = ("right", "left")


@dataclass(frozen=True, kw_only=True)
class GaitPlan:
    """How somebody walks or runs, along x with y up and z to the right.

    Attributes
    ----------
    speed : mean [m/s]
    step_time : from the strike of a foot to that of the other [s]
    duty : share of a stride that its foot is on the ground, below 0.5 in a run
    step_width : between the tracks of heels [m]
    steps : footfalls
    strike_pitch, lift_pitch : of a foot, toes up, at its strike and when it leaves the ground [rad]
    flat : shares of stance at which the foot comes to lie flat, and at which the heel leaves the
        ground
    swing_rise : of a foot above the way of its swing [m]
    carried : share of a foot's velocity as it leaves the ground that its swing begins with
    landing : velocity of a heel that meets the ground, over that of the body
    crouch : of the center of mass below its height in quiet standing [m]
    rise : amplitude of the center of mass in a walk [m]; a run's follows from its flights
    turn : amplitude of the pelvis' rotation [rad], which the trunk takes back
    spread : standard deviations of steps: time over its mean, length over its mean, width [m]
    """

    speed: float
    step_time: float
    duty: float
    step_width: float
    steps: int
    strike_pitch: float
    lift_pitch: float
    flat: tuple[float, float]
    swing_rise: float
    carried: float
    landing: float
    crouch: float
    rise: float
    turn: float
    spread: tuple[float, float, float]

    @property
    def flies(self) -> bool:
        """Whether both feet leave the ground between contacts."""
        return self.duty < 0.5


WALK = GaitPlan(
    speed=1.05,
    step_time=0.55,
    duty=0.62,
    step_width=0.11,
    steps=17,
    strike_pitch=np.radians(18.0),
    lift_pitch=np.radians(-45.0),
    flat=(0.14, 0.52),
    swing_rise=0.03,
    carried=0.5,
    landing=0.35,
    crouch=0.04,
    rise=0.018,
    turn=np.radians(4.0),
    spread=(0.015, 0.02, 0.006),
)
RUN = GaitPlan(
    speed=2.6,
    step_time=0.36,
    duty=0.37,
    step_width=0.05,
    steps=19,
    strike_pitch=np.radians(12.0),
    lift_pitch=np.radians(-45.0),
    flat=(0.16, 0.5),
    swing_rise=0.06,
    carried=0.9,
    landing=0.5,
    crouch=0.07,
    rise=0.0,
    turn=np.radians(4.0),
    spread=(0.0, 0.015, 0.006),
)


@read_only
class Footfall:
    """A contact of a foot with the ground.

    Attributes
    ----------
    side : of the foot
    strike, lift : when it begins and ends [s]
    place : (3,) of the heel on the ground [m]
    """

    side: Side
    strike: float
    lift: float
    place: Array


def footfalls(plan: GaitPlan, random: np.random.Generator) -> tuple[Footfall, ...]:
    """Place feet on the ground, right and left in turn, from 0 s and 0 m on.

    Parameters
    ----------
    plan : of the gait
    random : of the differences between steps
    """
    time_sd, length_sd, width_sd = plan.spread
    # The foot of the last but one step leaves the ground after two more steps.
    durations = plan.step_time * (1.0 + time_sd * random.standard_normal(plan.steps + 2))
    strikes = np.concatenate([[0.0], np.cumsum(durations)])
    lengths = plan.speed * plan.step_time * (1.0 + length_sd * random.standard_normal(plan.steps))
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    across = 0.5 * plan.step_width + width_sd * random.standard_normal(plan.steps)
    falls = []
    for step in range(plan.steps):
        side = SIDES[step % 2]
        aside = across[step] if side == "right" else -across[step]
        stride = strikes[step + 2] - strikes[step]
        falls.append(
            Footfall(
                side=side,
                strike=float(strikes[step]),
                lift=float(strikes[step] + plan.duty * stride),
                place=np.array([along[step], 0.0, aside]),
            )
        )
    return tuple(falls)


def smooth(share: Array) -> Array:
    """Go from 0 to 1 without a jump of the slope.

    Parameters
    ----------
    share : (...) of the way, clipped to 0..1

    Returns
    -------
    (...) 3 s^2 - 2 s^3
    """
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s * s * (3.0 - 2.0 * s))
