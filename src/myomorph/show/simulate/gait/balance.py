"""The way of a body's center of mass over its feet, and the forces on these.

The center of mass is at x, at the height y; the feet press at p on the ground. With the rate H' of
the angular momentum about the center of mass,

    m y x'' = m (g + y'') (x - p) + H'

which is linear in x where y is planned (Kajita et al. 2001).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_banded

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Wrenches
from myomorph.core.motion.splines import natural_spline
from myomorph.show.simulate.gait.plan import SIDES, Footfall, GaitPlan, smooth
from myomorph.show.simulate.total_wrench import TotalWrench

HEEL = 0.02  # Ahead of the heel's end the center of pressure begins [m].
MAX_ASIDE = 0.04
"""Distance of the center of pressure from where it is planned to be [m]: it stays under the feet.
"""


@read_only
class Support:
    """Which feet carry the body, and where they press.

    Attributes
    ----------
    pressure : (frames, 3) center of pressure on the ground [m]
    share : (frames, falls) of each footfall in the force
    places : (frames, falls, 3) where each would press alone [m]
    """

    pressure: Array
    share: Array
    places: Array


@read_only
class Heights:
    """Height of the center of mass above the ground.

    Attributes
    ----------
    height : (frames,) [m]
    acceleration : (frames,) [m/s^2]
    """

    height: Array
    acceleration: Array


def support_of(falls: Sequence[Footfall], length: float, time: Array) -> Support:
    """Roll the center of pressure over each foot, and on to the next.

    Parameters
    ----------
    falls : in the order of time
    length : from heel to ball [m]
    time : (frames,) [s]

    Returns
    -------
    shares and places at these times
    """
    begins = [max(after.strike, fall.lift) for fall, after in itertools.pairwise(falls)]
    ends = [min(fall.lift, after.strike) for fall, after in itertools.pairwise(falls)]
    alone = list(zip([falls[0].strike, *begins], [*ends, falls[-1].lift], strict=True))
    shares = []
    places = []
    knots: list[float] = []
    points: list[Array] = []
    for fall, (begin, end) in zip(falls, alone, strict=True):
        heel = fall.place + np.array([HEEL, 0.0, 0.0])
        ball = fall.place + np.array([length, 0.0, 0.0])
        rolled = smooth((time - begin) / (end - begin))[:, None]
        places.append(heel + rolled * (ball - heel))
        shares.append(_share(fall, (begin, end), time))
        knots += [begin, end]
        points += [heel, ball]
    share = np.stack(shares, axis=1)
    return Support(
        pressure=_through(np.array(knots), np.array(points), time),
        share=share,
        places=np.stack(places, axis=1),
    )


def _share(fall: Footfall, alone: tuple[float, float], time: Array) -> Array:
    """Share of a footfall in the force (frames,): it takes over, carries alone, hands on."""
    begin, end = alone
    share = np.ones(len(time))
    if begin > fall.strike:
        share *= smooth((time - fall.strike) / (begin - fall.strike))
    if fall.lift > end:
        share *= 1.0 - smooth((time - end) / (fall.lift - end))
    share[(time < fall.strike) | (time > fall.lift)] = 0.0
    return share


def _through(knots: Array, points: Array, time: Array) -> Array:
    """Go from point (knots, 3) to point without jumps of the velocity, (frames, 3)."""
    after = np.clip(np.searchsorted(knots, time), 1, len(knots) - 1)
    start = knots[after - 1]
    share = smooth((time - start) / (knots[after] - start))[:, None]
    return np.asarray(points[after - 1] + share * (points[after] - points[after - 1]))


def heights(plan: GaitPlan, falls: Sequence[Footfall], gravity: float, time: Array) -> Heights:
    """Raise and lower the center of mass, about a height of 0.

    Parameters
    ----------
    plan : of the gait
    falls : in the order of time
    gravity : [m/s^2]
    time : (frames,) [s]

    Returns
    -------
    height and acceleration at these times
    """
    if plan.flies:
        return _bounce(plan, gravity, time)
    # Lowest in the middle of double support, over the vault of the legs.
    lowest = [0.5 * (after.strike + fall.lift) for fall, after in itertools.pairwise(falls)]
    height = -plan.rise * np.cos(2.0 * np.pi * counted_phase(np.array(lowest), time))
    return Heights(height=height, acceleration=natural_spline(time, height)(time, 2))


def counted_phase(times: Array, at: Array) -> Array:
    """Count instants without jumps of the rate, 0 at the first.

    Parameters
    ----------
    times : (instants,) that increase [s]
    at : (frames,) [s]

    Returns
    -------
    (frames,)
    """
    step = float(np.median(np.diff(times)))
    # Beyond the ends the rate is the usual one.
    ends = step * np.arange(1, 9)
    longer = np.concatenate([times[0] - ends[::-1], times, times[-1] + ends])
    counts = np.arange(len(longer), dtype=np.float64) - 8.0
    return natural_spline(longer, counts, degree=3)(at)


def _bounce(plan: GaitPlan, gravity: float, time: Array) -> Heights:
    """Fall in flight, and be pushed up by half a sine over each contact.

    With contacts of c and flights of f seconds, a = pi g (c + f) / (2 c) gives a step's push

        y'' = a sin(pi t / c) - g

    that takes the velocity from -g f / 2 to g f / 2.
    """
    contact = 2.0 * plan.duty * plan.step_time
    flight = plan.step_time - contact
    push = np.pi * gravity * plan.step_time / (2.0 * contact)
    t = np.mod(time, plan.step_time)
    turn = np.pi * np.minimum(t, contact) / contact
    pushed = push * contact / np.pi * (np.minimum(t, contact) - contact / np.pi * np.sin(turn))
    after = np.maximum(t - contact, 0.0)
    pushed += 2.0 * push * contact / np.pi * after
    height = pushed - 0.5 * gravity * flight * t - 0.5 * gravity * t**2
    acceleration = np.where(t < contact, push * np.sin(turn), 0.0) - gravity
    return Heights(height=height - height.mean(), acceleration=acceleration)


def balanced_way(time: Array, pressure: Array, rate: Array, forcing: Array) -> Array:
    """Solve x'' = r (x - p) + f, with x = p at both ends.

    Parameters
    ----------
    time : (frames,) at an even rate [s]
    pressure : (frames,) p [m]
    rate : (frames,) r = (g + y'') / y [1/s^2]
    forcing : (frames,) f = H' / (m y) [m/s^2]

    Returns
    -------
    (frames,) x [m]
    """
    step = float(time[1] - time[0])
    count = len(time)
    rows = np.zeros((3, count))
    rows[0, 2:] = 1.0
    rows[1] = -2.0 - step**2 * rate
    rows[2, :-2] = 1.0
    right = step**2 * (forcing - rate * pressure)
    rows[1, [0, -1]] = 1.0
    right[[0, -1]] = pressure[[0, -1]]
    return np.asarray(solve_banded((1, 1), rows, right))


def wrenches_on_feet(
    falls: Sequence[Footfall], support: Support, total: TotalWrench, bodies: tuple[str, str]
) -> Wrenches:
    """Share the wrench that a motion takes among the feet on the ground.

    Each presses where it is planned to, moved by as much as the center of pressure of both is off.

    Parameters
    ----------
    falls : of both feet
    support : at the times of the wrench
    total : wrench on the whole body
    bodies : of the right and the left heel
    """
    pressed = total.center_of_pressure
    loaded = (total.force[:, 1] > 0.0)[:, None]
    aside = np.where(loaded, np.clip(pressed - support.pressure, -MAX_ASIDE, MAX_ASIDE), 0.0)
    center = support.pressure + aside
    free = (total.moment - np.cross(center, total.force)) * np.array([0.0, 1.0, 0.0])
    frames = len(total.time)
    forces = np.zeros((frames, 2, 3))
    torques = np.zeros((frames, 2, 3))
    points = np.full((frames, 2, 3), np.nan)
    for step, fall in enumerate(falls):
        foot = SIDES.index(fall.side)
        carries = support.share[:, step] > 0.0
        share = support.share[carries, step, None]
        forces[carries, foot] = share * total.force[carries]
        torques[carries, foot] = share * free[carries]
        points[carries, foot] = support.places[carries, step] + aside[carries]
    return Wrenches(
        time=total.time,
        names=("right foot", "left foot"),
        bodies=bodies,
        forces=forces,
        points=points,
        torques=torques,
    )
