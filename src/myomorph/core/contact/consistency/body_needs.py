"""What a moving body needs from outside: the rate of change of its momentum, segment by segment."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.sites import foot_sites
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import Site
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.motion.filters import differentiate, lowpass
from myomorph.core.rigid.dynamics import motion_arrays
from myomorph.core.rigid.kinematics import BodyMotion, body_motion
from myomorph.core.rigid.tree import compile_tree

CUTOFF = 8.0
"""Low-pass filter of motion and forces alike [Hz]."""
SHORTEST = 20
"""Frames of the shortest recording that is filtered."""


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class Feet:
    """Places under two feet, each the mean of its inner and outer side.

    Attributes
    ----------
    sides : "r" and "l" of each
    heels, balls, toes : (feet, frames, 3) [m]
    """

    sides: tuple[str, ...]
    heels: Array
    balls: Array
    toes: Array

    def frames(self, chosen: NDArray[np.int64]) -> Feet:
        """Take some frames.

        Parameters
        ----------
        chosen : (chosen,) their numbers

        Returns
        -------
        the same of these frames
        """
        return replace(
            self,
            heels=self.heels[:, chosen],
            balls=self.balls[:, chosen],
            toes=self.toes[:, chosen],
        )

    @property
    def middles(self) -> Array:
        """Half way from the heels to the toes, (feet, frames, 3) [m]."""
        return 0.5 * (self.heels + self.toes)


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class BodyNeeds:
    """External force and moment that each segment of a moving body needs.

    The moment is about the body's center of mass c, so that it does not depend on the ground's
    origin:

        f_b = m_b (a_b - g),    n_b = (r_b - c) x f_b + d(I_b w_b)/dt

    Attributes
    ----------
    time : (frames,) [s]
    mass : of the body [kg]
    gravity : (3,) [m/s^2]
    shares : (segments,) of the body's mass [-]
    center : (frames, 3) of mass [m]
    segments : (frames, segments, 6) force and moment [N], [N m]
    feet : places under the feet
    """

    time: Array
    mass: float
    gravity: Array
    shares: Array
    center: Array
    segments: Array
    feet: Feet

    @property
    def force(self) -> Array:
        """Force that the body needs, (frames, 3) [N]."""
        return np.asarray(self.segments[..., :3].sum(axis=1))

    @property
    def moment(self) -> Array:
        """Moment about the center of mass that it needs, (frames, 3) [N m]."""
        return np.asarray(self.segments[..., 3:].sum(axis=1))

    @property
    def inertial(self) -> Array:
        """Force that the body needs beside its weight, (frames, 3) [N]."""
        return np.asarray(self.force + self.mass * self.gravity)

    def frames(self, chosen: NDArray[np.int64]) -> BodyNeeds:
        """Take some frames.

        Parameters
        ----------
        chosen : (chosen,) their numbers

        Returns
        -------
        the same of these frames
        """
        return replace(
            self,
            time=self.time[chosen],
            center=self.center[chosen],
            segments=self.segments[chosen],
            feet=self.feet.frames(chosen),
        )


def body_needs(model: Model, motion: Motion) -> BodyNeeds:
    """Compute what every segment of a moving body needs from outside.

    Parameters
    ----------
    model : of a person with two feet
    motion : (frames, coordinates) at a steady rate, without gaps [rad or m]

    Returns
    -------
    forces and moments of all frames
    """
    rate = 1.0 / float(np.median(np.diff(motion.time)))
    values = smoothed(motion.values, rate)
    smooth = differentiate(replace(motion, values=values, velocities=None, accelerations=None))
    tree = compile_tree(model)
    bodies = body_motion(tree, *motion_arrays(tree, smooth))
    numbers = np.arange(1, len(model.bodies) + 1, dtype=np.int64)
    mass = np.array([body.mass for body in model.bodies])
    points = bodies.of_points(numbers, np.array([body.mass_center for body in model.bodies]))
    shares = mass / mass.sum()
    center = np.einsum("b,fbi->fi", shares, points.positions)
    force = mass[:, None] * (points.accelerations - np.array(model.gravity))
    lever = points.positions - center[:, None]
    moment = np.cross(lever, force) + _spin_rates(model, bodies, numbers)
    return BodyNeeds(
        time=smooth.time,
        mass=float(mass.sum()),
        gravity=np.array(model.gravity),
        shares=shares,
        center=center,
        segments=np.concatenate([force, moment], axis=2),
        feet=_feet(model, bodies),
    )


def _spin_rates(model: Model, bodies: BodyMotion, numbers: NDArray[np.int64]) -> Array:
    """Rates of change of the segments' own angular momentum, (frames, segments, 3) [N m]."""
    rotations = bodies.rotations[:, numbers]
    turning = bodies.angular_velocities[:, numbers]
    inertia = rotations @ np.array([body.inertia for body in model.bodies])
    inertia = inertia @ np.swapaxes(rotations, -1, -2)
    changing = np.einsum("fbij,fbj->fbi", inertia, bodies.angular_accelerations[:, numbers])
    return changing + np.cross(turning, np.einsum("fbij,fbj->fbi", inertia, turning))


def _feet(model: Model, bodies: BodyMotion) -> Feet:
    """Find the places under the feet in all frames."""
    sites = foot_sites(model)
    groups = sorted({site.group for site in sites})

    def places(part: str) -> Array:
        return np.array(
            [
                np.mean(
                    [
                        _place(model, bodies, site)
                        for site in sites
                        if site.group == group and site.name.startswith(part)
                    ],
                    axis=0,
                )
                for group in groups
            ]
        )

    return Feet(
        sides=tuple(group[-1] for group in groups),
        heels=places("heel"),
        balls=places("ball"),
        toes=places("toe"),
    )


def _place(model: Model, bodies: BodyMotion, site: Site) -> Array:
    """Place of a site in all frames, (frames, 3) [m]."""
    number = 1 + model.body_names.index(site.body)
    return bodies.of_points(np.array([number]), site.points[:1]).positions[:, 0]


def smoothed(values: Array, rate: float) -> Array:
    """Low-pass values as all that is compared here is.

    Parameters
    ----------
    values : (frames, ...) finite
    rate : of the frames [Hz]

    Returns
    -------
    filtered, or as they are where they are too few or too slow
    """
    if len(values) < SHORTEST or rate < 2.2 * CUTOFF:
        return values
    return lowpass(values, rate, CUTOFF)
