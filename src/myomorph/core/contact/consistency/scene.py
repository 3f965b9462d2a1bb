"""A body and its plates on one clock: what is left of the balance of forces and moments.

Frame by frame, with everything filtered alike, about the body's center of mass c,

    r = [ sum_b m_b (a_b - g) - sum_p F_p,
          sum_b ((r_b - c) x m_b (a_b - g) + d(I_b w_b)/dt) - sum_p ((p_p - c) x F_p + T_p) ]

and of every stance the center of pressure against the sole, the height of the sole over the plate,
and the lean of the force towards the center of mass: forces of two legs against each other cancel
in the balance, but each points roughly to c.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.consistency.body_needs import CUTOFF, BodyNeeds
from myomorph.core.contact.consistency.channels import Channels, PlateForces, Sampled
from myomorph.core.contact.consistency.corrections import Correction, no_correction
from myomorph.core.model.arrays import Array, read_only, runs

NOISE = {"level": 0.03, "upward": 0.035, "moment": 0.016}
"""Standard deviations of one frame's balance, of forces over the weight, and of moments over the
weight times one metre.
"""
EFFORT = 0.5
"""Acceleration over gravity at which they have grown by the square root of two: tissue is soft."""
JITTER = 0.004
"""The same by the change of the force within this time [s]."""
TEMPER = 0.5
"""Share of the frames that count as independent."""
SOLE = {"across": 0.011, "outside": 0.012, "height": 0.015}
"""Standard deviations of the center of pressure against the sole: across it, outside of it, and of
its height [m].
"""
MARGIN = 0.01
"""Length by which a center of pressure may lie beyond heel and toes [m]."""
LEAN = (0.03, 0.08)
"""Standard deviation of a force's lean, and its growth with the lean itself."""
LEAN_SHARE = 0.8
"""Part of the direction towards the center of mass that forces lean by."""
ON_PLATE = 0.06
"""Share of a plate's largest force from which it carries something."""
FIRM = 0.3
"""The same from which its center of pressure shows a foot."""
STANDS = 0.15
"""Share of a plate's largest force that a stance reaches."""
BESIDE = 0.12
"""Share of the weight, and time [s], that something else than plates carries where it is said."""
AWAY = 0.15
"""Distance of such a force from the lines between loaded plates [m]."""
EDGE = 0.06
"""Time at both ends that is left out [s]."""


class Forward(NamedTuple):
    """Mean center of pressure before the middle of the sole, and its standard deviation [m]."""

    mean: float
    sd: float


WHOLE = Forward(0.003, 0.015)
FIRST_PART = Forward(-0.042, 0.02)
LAST_PART = Forward(0.014, 0.02)
MIDDLE_PART = Forward(-0.01, 0.045)
"""Of whole stances, and of those of which the frames show only a part: a step begins at the heel
and ends at the toes. Means of 22 recordings.
"""


class Stance(NamedTuple):
    """A foot on a plate.

    Attributes
    ----------
    plate : its number
    frames : of the stance
    weights : (frames,) of the means
    forward : where along the sole its center of pressure is expected
    """

    plate: int
    frames: slice
    weights: Array
    forward: Forward


class Sole(NamedTuple):
    """A sole over some frames.

    Attributes
    ----------
    middle : (frames, 3) half way from heel to toes [m]
    along, across : (frames, 3) level unit vectors
    half : (frames,) half its length, and a margin [m]
    lowest : (frames,) height of the lower of heel and ball [m]
    """

    middle: Array
    along: Array
    across: Array
    half: Array
    lowest: Array

    @staticmethod
    def of(heel: Array, ball: Array, toe: Array, up: int) -> Sole:
        """Lay a sole through three places.

        Parameters
        ----------
        heel, ball, toe : (frames, 3) [m]
        up : number of the vertical axis

        Returns
        -------
        the sole over these frames
        """
        along = ball - heel
        along[:, up] = 0.0
        along = along / np.linalg.norm(along, axis=1, keepdims=True).clip(1e-9)
        return Sole(
            middle=0.5 * (heel + toe),
            along=along,
            across=np.cross(along, np.eye(3)[up]),
            half=0.5 * np.linalg.norm(toe - heel, axis=1) + MARGIN,
            lowest=np.minimum(heel[:, up], ball[:, up]),
        )

    def places(self, point: Array, up: int, stance: Stance, ahead: float) -> Array:
        """Place a center of pressure on it.

        Parameters
        ----------
        point : (frames, 3) [m]
        up : number of the vertical axis
        stance : of these frames
        ahead : that the sole lies before the model's [m]

        Returns
        -------
        (4,) across, along, outside, height, over their standard deviations
        """
        weights = stance.weights
        offset = point - self.middle
        sideways = (offset * self.across).sum(axis=1)
        forward = (offset * self.along).sum(axis=1) - ahead
        outside = (np.abs(forward) - self.half)[weights > 0.0].max().clip(0.0)
        height = self.lowest - point[:, up]
        return np.array(
            [
                weights @ sideways / SOLE["across"],
                (weights @ forward - stance.forward.mean) / stance.forward.sd,
                outside / SOLE["outside"],
                weights @ height / SOLE["height"],
            ]
        )


class Bare(NamedTuple):
    """A stretch of time in which something else than the plates carries the body.

    Attributes
    ----------
    start, stop : [s]
    gaps : (feet,) distance of that force from each foot's middle, the median [m]
    """

    start: float
    stop: float
    gaps: tuple[float, ...]


@read_only
@dataclass(frozen=True, eq=False)
class Scene:
    """A body with its plates.

    Attributes
    ----------
    needs : of the body in all frames
    channels : of the plates
    usable : (frames,) poses that may be believed
    whole : whether frames count in which something else than plates carries the body
    one_foot_each : whether each stance is that of one foot
    """

    needs: BodyNeeds
    channels: Channels
    usable: NDArray[np.bool_]
    whole: bool = False
    one_foot_each: bool = True

    @property
    def up(self) -> int:
        """Number of the vertical axis."""
        return self.channels.up

    @property
    def flat(self) -> list[int]:
        """Numbers of the level axes."""
        return [axis for axis in range(3) if axis != self.up]

    @property
    def weight(self) -> float:
        """Weight of the body [N]."""
        return self.channels.weight

    @property
    def nothing(self) -> Correction:
        """The correction that changes nothing."""
        return no_correction(self.channels.forces.shape[1])

    @cached_property
    def rate(self) -> float:
        """Rate of the motion [Hz]."""
        return 1.0 / float(np.median(np.diff(self.needs.time)))

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """(frames,) away from the ends of motion and forces."""
        time = self.needs.time
        first = max(self.channels.time[0], time[0] + EDGE)
        last = min(self.channels.time[-1], time[-1] - EDGE)
        return np.asarray((time >= first) & (time <= last))

    @cached_property
    def sizes(self) -> Array:
        """Size of the plates' forces in all frames, (frames, plates) [N]."""
        forces = self.channels.at(self.needs.time, self.nothing)
        return np.asarray(np.linalg.norm(forces.forces, axis=2))

    @cached_property
    def bare(self) -> tuple[Bare, ...]:
        """Stretches of time in which something else than the plates carries the body."""
        lack, points = self._lack()
        forces = self.channels.at(self.needs.time, self.nothing)
        loaded = self.sizes > ON_PLATE * self.sizes.max(axis=0).clip(1e-9)
        gap = _gaps(points[:, self.flat], forces.points[..., self.flat], loaded)
        blurred = 2.0 * NOISE["moment"] * self.weight / np.abs(lack).clip(1.0)
        missing = (lack > BESIDE * self.weight) & (gap > AWAY + blurred) & self.inside
        middles = self.needs.feet.middles
        found = []
        for start, stop in runs(missing):
            if stop - start >= BESIDE * self.rate:
                away = (points[start:stop] - middles[:, start:stop])[..., self.flat]
                gaps = np.median(np.linalg.norm(away, axis=2), axis=1)
                found.append(
                    Bare(
                        start=float(self.needs.time[start]),
                        stop=float(self.needs.time[stop - 1]),
                        gaps=tuple(gaps.tolist()),
                    )
                )
        return tuple(found)

    def _lack(self) -> tuple[Array, Array]:
        """Upward force that plates do not measure, and where it acts on the ground.

        Returns
        -------
        (frames,) [N] and (frames, 3) [m]
        """
        needs = self.needs
        forces = self.channels.at(needs.time, self.nothing)
        total = forces.forces.sum(axis=1)
        force = needs.force - total
        moment = needs.moment - forces.moments.sum(axis=1) + np.cross(needs.center, total)
        lack = force[:, self.up]
        firm = np.where(np.abs(lack) > 1.0, lack, np.inf)[:, None]
        vertical = np.eye(3)[self.up]
        along = force / firm * needs.center[:, [self.up]]
        return lack, needs.center + np.cross(vertical, moment) / firm - along

    @cached_property
    def beside(self) -> float:
        """Share of the frames in which something else than the plates carries the body."""
        time = self.needs.time
        count = sum(int(((time >= bare.start) & (time <= bare.stop)).sum()) for bare in self.bare)
        return count / max(int(self.inside.sum()), 1)

    @cached_property
    def chosen(self) -> NDArray[np.int64]:
        """Numbers of the frames that are compared, twice a period of the filter's cutoff."""
        time = self.needs.time
        fits = self.inside & self.usable
        for bare in () if self.whole else self.bare:
            fits &= (time < bare.start - BESIDE) | (time > bare.stop + BESIDE)
        return np.flatnonzero(fits)[:: max(1, int(self.rate / (2.0 * CUTOFF)))]

    @cached_property
    def frames(self) -> BodyNeeds:
        """What the body needs in these frames."""
        return self.needs.frames(self.chosen)

    @cached_property
    def sampled(self) -> Sampled:
        """Signals of the plates in these frames, on their own clocks."""
        return self.channels.sampled(self.frames.time, self.nothing)

    @cached_property
    def sd(self) -> Array:
        """Standard deviations of the balance, (chosen frames, 6) [N], [N m]."""
        change = np.linalg.norm(np.gradient(self.needs.force, 1.0 / self.rate, axis=0), axis=1)
        jitter = JITTER * change[self.chosen] / self.weight / NOISE["upward"]
        effort = np.linalg.norm(self.frames.inertial, axis=1) / self.weight / EFFORT
        growth = self.weight * np.sqrt(1.0 + effort**2 + jitter**2)
        force = np.where(np.arange(3) == self.up, NOISE["upward"], NOISE["level"])
        return growth[:, None] * np.concatenate([force, np.full(3, NOISE["moment"])])

    @cached_property
    def stances(self) -> tuple[Stance, ...]:
        """Feet on plates, in the chosen frames."""
        size = self.sizes[self.chosen]
        found = []
        for plate, values in enumerate(size.T):
            most = float(self.sizes[:, plate].max(initial=0.0))
            if most <= 0.0:
                continue
            for start, stop in runs(values > ON_PLATE * most):
                part = values[start:stop]
                weights = np.where(part > FIRM * part.max(), part, 0.0)
                if stop - start >= 3 and part.max() > STANDS * most:
                    found.append(
                        Stance(
                            plate=plate,
                            frames=slice(start, stop),
                            weights=weights / weights.sum(),
                            forward=self._forward(start, stop),
                        )
                    )
        return tuple(found)

    def _forward(self, start: int, stop: int) -> Forward:
        """Expect a center of pressure by what the chosen frames show of a stance."""
        time = self.frames.time
        longest = 1.5 * float(np.median(np.diff(time)))
        begins = start > 0 and time[start] - time[start - 1] < longest
        ends = stop < len(time) and time[stop] - time[stop - 1] < longest
        if begins:
            return WHOLE if ends else FIRST_PART
        return LAST_PART if ends else MIDDLE_PART

    def residual(self, correction: Correction) -> Array:
        """Compute what is left, over its standard deviation.

        Parameters
        ----------
        correction : of the recording

        Returns
        -------
        (6 frames + 6 stances,) the balance of all frames, then stances [-]
        """
        sampled = self.sampled
        if not correction.keeps_clocks:
            sampled = self.channels.sampled(self.frames.time, correction)
        forces = self.channels.corrected(sampled, correction)
        cameras = tilt(correction.cameras, np.eye(3)[self.flat])
        center = self.frames.center @ cameras.T + correction.center
        gravity = tilt(correction.gravity, np.eye(3)[self.flat]) @ self.frames.gravity
        total = forces.forces.sum(axis=1)
        force = self.frames.inertial @ cameras.T - self.frames.mass * gravity - total
        moment = self.frames.moment @ cameras.T
        moment = moment - (forces.moments.sum(axis=1) - _cross(center, total))
        balance = (np.concatenate([force, moment], axis=1) / self.sd).ravel()
        return np.concatenate([balance, *self._of_stances(correction, forces, center)])

    def _of_stances(
        self, correction: Correction, forces: PlateForces, center: Array
    ) -> Iterator[Array]:
        """Compare every stance with the sole on its plate, and with the center of mass.

        Parameters
        ----------
        correction : of the recording
        forces : of the plates with it
        center : (chosen frames, 3) of mass [m]

        Yields
        ------
        (5,) of each stance, and (stances,) their heights, over their standard deviations
        """
        heights = []
        cameras = tilt(correction.cameras, np.eye(3)[self.flat])
        soles = self.soles(cameras) if correction.cameras.any() else self.upright_soles
        for seen, feet in zip(self.stances, soles, strict=True):
            stance = self._carried(seen, forces)
            point = forces.points[stance.frames, _whose(stance.plate, correction)]
            under = _nearer(
                [sole.places(point, self.up, stance, correction.ahead) for sole in feet]
            )
            lean = self._lean(stance, forces, center)
            if not self.one_foot_each:
                yield lean / np.sqrt(TEMPER)
                continue
            yield np.concatenate([under[:3], lean]).clip(-20.0, 20.0) / np.sqrt(TEMPER)
            heights.append(under[3])
        if heights:
            apart = np.array(heights) - np.median(heights)
            yield apart.clip(-8.0, 8.0) / np.sqrt(TEMPER)

    def _carried(self, stance: Stance, forces: PlateForces) -> Stance:
        """Weigh a stance by the frames in which corrected forces carry something, too."""
        load = np.abs(forces.forces[stance.frames, stance.plate, self.up])
        weights = stance.weights * (load > FIRM * load.max())
        if not weights.any():
            return stance
        return stance._replace(weights=weights / weights.sum())

    @cached_property
    def upright_soles(self) -> tuple[tuple[Sole, ...], ...]:
        """Soles of all stances with cameras that are not tilted."""
        return self.soles(np.eye(3))

    def soles(self, cameras: Array) -> tuple[tuple[Sole, ...], ...]:
        """Find both soles during each stance.

        Parameters
        ----------
        cameras : (3, 3) rotation of the markers against the plates

        Returns
        -------
        of each stance, of each foot
        """
        feet = self.frames.feet

        def sole(foot: int, frames: slice) -> Sole:
            heel = feet.heels[foot, frames] @ cameras.T
            ball = feet.balls[foot, frames] @ cameras.T
            toe = feet.toes[foot, frames] @ cameras.T
            return Sole.of(heel, ball, toe, self.up)

        return tuple(
            tuple(sole(foot, stance.frames) for foot in range(len(feet.sides)))
            for stance in self.stances
        )

    def _lean(self, stance: Stance, forces: PlateForces, center: Array) -> Array:
        """Compare the direction of a stance's force with that towards the center of mass, (2,)."""
        plate = stance.plate
        force = stance.weights @ forces.forces[stance.frames, plate]
        arm = center[stance.frames] - forces.points[stance.frames, plate]
        arm = stance.weights @ (arm / arm[:, [self.up]].clip(0.3))
        towards = arm[self.flat]
        upward = max(abs(float(force[self.up])), 0.05 * self.weight)
        lean = force[self.flat] / upward - LEAN_SHARE * towards
        return np.asarray(lean / (LEAN[0] + LEAN[1] * np.abs(towards)))


def _whose(plate: int, correction: Correction) -> int:
    """Find the plate whose points a stance has, where forces are exchanged."""
    if correction.exchanged is None or plate not in correction.exchanged:
        return plate
    first, second = correction.exchanged
    return second if plate == first else first


def _nearer(seen: list[Array]) -> Array:
    """Choose the sole (4,) that a center of pressure is nearer to."""
    return min(seen, key=lambda sole: float(np.hypot(sole[0], sole[1])))


def _cross(first: Array, second: Array) -> Array:
    """Cross products of vectors (frames, 3)."""
    return np.stack(
        [
            first[:, 1] * second[:, 2] - first[:, 2] * second[:, 1],
            first[:, 2] * second[:, 0] - first[:, 0] * second[:, 2],
            first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0],
        ],
        axis=1,
    )


def tilt(angles: Array, level: Array) -> Array:
    """Make the rotation by small angles about the two level axes.

    Parameters
    ----------
    angles : (2,) [rad]
    level : (2, 3) unit vectors of the axes

    Returns
    -------
    (3, 3)
    """
    vector = np.asarray(angles) @ level
    size = float(np.linalg.norm(vector))
    if size == 0.0:
        return np.eye(3)
    x, y, z = vector / size
    matrix = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(size) * matrix + (1.0 - np.cos(size)) * matrix @ matrix)


def _gaps(points: Array, places: Array, loaded: NDArray[np.bool_]) -> Array:
    """Distances (frames,) of points (frames, 2) from the lines between loaded plates' points.

    Parameters
    ----------
    points : (frames, 2) [m]
    places : (frames, plates, 2) [m]
    loaded : (frames, plates)
    """
    gap = np.full(len(points), np.inf)
    for first in range(places.shape[1]):
        for second in range(first + 1):
            along = places[:, second] - places[:, first]
            away = points - places[:, first]
            length = np.maximum((along * along).sum(axis=1), 1e-9)
            share = np.clip((along * away).sum(axis=1) / length, 0.0, 1.0)[:, None]
            distance = np.linalg.norm(away - share * along, axis=1)
            both = loaded[:, first] & loaded[:, second]
            gap = np.minimum(gap, np.where(both, distance, np.inf))
    return gap
