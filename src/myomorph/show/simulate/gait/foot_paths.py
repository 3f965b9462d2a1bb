"""Paths of feet: they roll from heel to ball on the ground, and swing through the air."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from myomorph.core.contact.sites import foot_sites
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Marker, Model
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.show.simulate.gait.plan import Footfall, GaitPlan, Side, smooth

MOMENT = 1e-3  # Share of stance over which the velocity at its end is taken.
TOE_OUT = np.radians(6.0)


@read_only
class Sole:
    """Points under a foot, from the heel of the foot that lies flat.

    Attributes
    ----------
    body : of the heel
    points : (3, 3) heel, ball, and the ball's outer edge: forward, up and to the right [m]
    markers : the same as markers of the body
    """

    body: str
    points: Array
    markers: tuple[Marker, ...]

    @property
    def length(self) -> float:
        """From heel to ball [m]."""
        return float(self.points[1, 0])


def sole_of(model: Model, side: Side) -> Sole:
    """Find the points under a foot of a model whose y points up."""
    letter = side[0]
    sites = {site.name: site for site in foot_sites(model)}
    body = sites[f"heel_medial_{letter}"].body
    pose = standing_poses(model)[body]
    corner = {
        name: pose.apply(sites[f"{name}_{letter}"].points[0])
        for name in ("heel_medial", "heel_lateral", "ball_medial", "ball_lateral")
    }
    heel = 0.5 * (corner["heel_medial"] + corner["heel_lateral"])
    ball = 0.5 * (corner["ball_medial"] + corner["ball_lateral"])
    # Straight ahead of the heel, so that the foot rolls about one axis.
    ball = heel + np.array([ball[0] - heel[0], 0.0, 0.0])
    outer = ball + np.array([0.0, 0.0, corner["ball_lateral"][2] - heel[2]])
    places = np.array([heel, ball, outer])
    local = pose.inverse()
    names = ("heel", "ball", "outer")
    markers = tuple(
        Marker(f"{name}_{letter}", body, local.apply(place))
        for name, place in zip(names, places, strict=True)
    )
    return Sole(body=body, points=places - heel, markers=markers)


def foot_path(plan: GaitPlan, falls: Sequence[Footfall], sole: Sole, time: Array) -> Array:
    """Find the points of a sole over time.

    Parameters
    ----------
    plan : of the gait
    falls : of this foot, in the order of time
    sole : of it
    time : (frames,) [s]

    Returns
    -------
    (frames, 3, 3) heel, ball and outer edge in ground [m]
    """
    way = np.empty((len(time), 4))
    before = falls[0]
    way[time < before.strike] = _rolled(plan, before, sole, np.zeros(1))
    for fall in falls:
        stands = (time >= fall.strike) & (time <= fall.lift)
        share = (time[stands] - fall.strike) / (fall.lift - fall.strike)
        way[stands] = _rolled(plan, fall, sole, share)
    for fall, after in itertools.pairwise(falls):
        swings = (time > fall.lift) & (time < after.strike)
        way[swings] = _swung(plan, (fall, after), sole, time[swings])
    way[time > falls[-1].lift] = _rolled(plan, falls[-1], sole, np.ones(1))
    return _placed(way, sole, TOE_OUT if falls[0].side == "right" else -TOE_OUT)


def _rolled(plan: GaitPlan, fall: Footfall, sole: Sole, share: Array) -> Array:
    """Roll over heel and ball.

    Parameters
    ----------
    share : (frames,) of stance

    Returns
    -------
    (frames, 4) place of the heel [m], and pitch [rad]
    """
    lands, rises = plan.flat
    landing = 1.0 - smooth(share / lands)
    u = np.clip((share - rises) / (1.0 - rises), 0.0, 1.0)
    rising = 0.5 * u**2 * (3.0 - u)
    pitch = plan.strike_pitch * landing + plan.lift_pitch * rising
    # About the ball once the heel has left the ground, about the heel before.
    raised = np.minimum(pitch, 0.0)
    way = np.empty((len(share), 4))
    way[:, :3] = fall.place
    way[:, 0] += sole.length * (1.0 - np.cos(raised))
    way[:, 1] -= sole.length * np.sin(raised)
    way[:, 3] = pitch
    return way


def _swung(plan: GaitPlan, falls: tuple[Footfall, Footfall], sole: Sole, time: Array) -> Array:
    """Swing from where a foot leaves the ground to where it strikes, by cubic polynomials.

    Parameters
    ----------
    falls : before and after
    time : (frames,) [s]

    Returns
    -------
    (frames, 4) place of the heel [m], and pitch [rad]
    """
    before, after = falls
    last = _rolled(plan, before, sole, np.array([1.0 - MOMENT, 1.0]))
    first = _rolled(plan, after, sole, np.array([0.0, MOMENT]))
    duration = after.strike - before.lift
    leaving = (
        plan.carried * (last[1] - last[0]) / (MOMENT * (before.lift - before.strike)) * duration
    )
    meeting = (first[1] - first[0]) / (MOMENT * (after.lift - after.strike)) * duration
    meeting[0] += plan.landing * plan.speed * duration
    u = ((time - before.lift) / duration)[:, None]
    # Hermite's polynomials
    way = (
        (2.0 * u**3 - 3.0 * u**2 + 1.0) * last[1]
        + (u**3 - 2.0 * u**2 + u) * leaving
        + (3.0 * u**2 - 2.0 * u**3) * first[0]
        + (u**3 - u**2) * meeting
    )
    way[:, 1] += plan.swing_rise * 16.0 * (u * (1.0 - u))[:, 0] ** 2
    return way


def _placed(way: Array, sole: Sole, outward: float) -> Array:
    """Place the points of a sole whose heel goes a way.

    Parameters
    ----------
    way : (frames, 4) place of the heel [m], and pitch [rad]
    outward : rotation of the foot about the vertical, toes to the right [rad]

    Returns
    -------
    (frames, 3, 3) [m]
    """
    cosine = np.cos(way[:, 3, None])
    sine = np.sin(way[:, 3, None])
    along = cosine * sole.points[:, 0]
    upward = sine * sole.points[:, 0]
    aside = np.broadcast_to(sole.points[:, 2], along.shape)
    # The axis of the roll stays across the way: feet that turn out roll as wheels do that point so.
    turned = np.stack(
        [
            np.cos(outward) * along - np.sin(outward) * aside,
            upward,
            np.sin(outward) * along + np.cos(outward) * aside,
        ],
        axis=-1,
    )
    return np.asarray(way[:, None, :3] + turned)
