"""Identification while motion and forces arrive.

It has filter, derivatives, regressor and one more frame of the estimate.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.body.identify.base_parameters import BaseParameters, base_parameters
from myomorph.body.identify.recordings import (
    MISSING_WEIGHT,
    NO_FORCE,
    NO_MOTION,
    UNLOADED,
    UNMEASURED,
    WINDOW,
)
from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.motion.online import MovingWindow, OnlineFilter
from myomorph.core.rigid.regressor import regressor_blocks
from myomorph.live.sequential import NOISE, Proposal, SequentialFit, SequentialState

PATIENCE = 2.0  # Time that a frame waits for its force before it is left out [s]


@dataclass(frozen=True)
class OnlineOptions:
    """Settings of identification while frames arrive."""

    cutoff: float = 6.0  # of the filter of motion and forces alike, half the power [Hz]
    # standard deviation of the base wrench's six rows, a number or moment and force [N m], [N]
    noise: tuple[float, float] = (NOISE[0], NOISE[3])
    forgetting: float = 1.0  # below 1, frames T ago weigh forgetting^T
    # share of body weight that may be missing before a frame counts as standing beside the plates
    missing: float = MISSING_WEIGHT


@read_only
class OnlineState:
    """What is known by now, for a display."""

    time: float  # of the newest frame that was folded in [s]
    fit: SequentialState  # the estimate
    levels: Array  # (bodies,) how well each link is identified, 0..1
    left_out: Mapping[str, int]  # reason to number of frames
    frames: int  # that arrived
    proposals: tuple[Proposal, ...]  # movements that would show more, the best first
    pose: Array  # (coordinates,) of the newest frame; the default before there is one

    @property
    def error(self) -> Array:
        """(6,) error of the predicted base wrench of late over what was measured, each row."""
        return self.fit.innovation_rms / np.maximum(self.fit.wrench_rms, 1e-9)


class OnlineIdentification:
    """Estimate from coordinates and total external wrenches as they come; see `OnlineOptions`.

    Parameters
    ----------
    rate : of the motion's frames [Hz]
    force_rate : of the forces' samples [Hz]
    mass : of the subject, to find contacts beside the plates; the model's by default [kg]
    held : coordinates that do not move, with their values; by default the locked ones
    """

    def __init__(
        self,
        model: Model,
        rate: float,
        force_rate: float,
        mass: float | None = None,
        options: OnlineOptions | None = None,
        held: Mapping[str, float] | None = None,
    ):
        self.options = options or OnlineOptions()
        self.model = model
        self.filter = OnlineFilter(rate, self.options.cutoff)
        self.force_filter = OnlineFilter(force_rate, self.options.cutoff)
        # Filtered frames repeat each other: each counts for less.
        self.sigma = np.repeat(self.options.noise, 3) * np.sqrt(self.filter.frames_per_sample)
        self.base: BaseParameters = base_parameters(model, held=held)
        self.fit = SequentialFit(
            model=model, base=self.base, sigma=self.sigma, forgetting=self.options.forgetting
        )
        self._motion = MovingWindow(self.filter, len(model.coordinates))
        self._force = MovingWindow(self.force_filter, 6)
        self._forces: deque[tuple[float, Array]] = deque(maxlen=int(2 * PATIENCE * force_rate) + 2)
        self._waiting: deque[tuple[float, Array]] = deque()
        self._parameters = inertial_parameters(model).ravel()
        if mass is not None and model.mass > 0.0:
            self._parameters = self._parameters * (mass / model.mass)
        gravity = np.asarray(model.gravity)
        self._up = -gravity / max(float(np.linalg.norm(gravity)), 1e-12)
        self._weight = float(self._parameters[::10].sum() * np.linalg.norm(gravity))
        self._missing: deque[float] = deque(maxlen=max(1, round(WINDOW * rate)))
        self.frames = 0
        self.left_out = {NO_MOTION: 0, NO_FORCE: 0, UNMEASURED: 0}
        self.used: list[float] = []
        self._pose = np.array([coordinate.default for coordinate in model.coordinates])
        self._time = float("nan")

    @property
    def delay(self) -> float:
        """How late a frame is folded in, computing apart [s]."""
        return max(self.filter.delay, self.force_filter.delay)

    def push_motion(self, time: float, coordinates: Array) -> None:
        """Add a frame of coordinates.

        Parameters
        ----------
        time : of the frame [s]
        coordinates : (coordinates,) [rad or m], NaN where they are not known
        """
        self.frames += 1
        self._motion.push(time, coordinates)
        if np.isfinite(coordinates).all():
            self._pose = np.array(coordinates)
        if self._motion.full:
            self._waiting.append((self._motion.time, self._motion.filtered))
        self._settle()

    def push_force(self, time: float, wrench: Array) -> None:
        """Add a sample of the total external wrench.

        Parameters
        ----------
        time : of the sample [s]
        wrench : (6,) moment about the ground's origin [N m], force [N]
        """
        self._force.push(time, wrench)
        if self._force.full:
            self._forces.append((self._force.time, self._force.filtered[0]))

    def restart(self) -> None:
        """Begin the filters anew with the next frame; what was identified stays."""
        self._motion = MovingWindow(self.filter, len(self._pose))
        self._force = MovingWindow(self.force_filter, 6)
        self._forces.clear()
        self._waiting.clear()

    def warm_up(self) -> None:
        """Do everything once without effect.

        So nothing is compiled when the first frame comes.
        """
        still = Motion(
            time=np.zeros(1),
            names=(),
            values=np.zeros((1, 0)),
            velocities=np.zeros((1, 0)),
            accelerations=np.zeros((1, 0)),
        )
        rows = next(regressor_blocks(self.model, still)).rows[0]
        scratch = SequentialFit(self.model, self.base, self.sigma)
        scratch.update(rows, rows @ self._parameters)
        scratch.state()
        self.fit.propose()

    def finish(self) -> None:
        """Fold in what is still waiting and has its force."""
        self._settle()
        self.left_out[NO_FORCE] += len(self._waiting)
        self._waiting.clear()

    def state(self, most: int = 1) -> OnlineState:
        """Return what is known by now, and `most` movements that would show more."""
        fit = self.fit.state()
        levels = np.array([fit.link_levels[name] for name in self.model.body_names])
        return OnlineState(
            time=self._time,
            fit=fit,
            levels=frozen_array(levels),
            left_out=FrozenMap({reason: count for reason, count in self.left_out.items() if count}),
            frames=self.frames,
            proposals=self.fit.propose(most=most),
            pose=frozen_array(self._pose),
        )

    def _settle(self) -> None:
        """Fold in every waiting frame whose force has arrived."""
        while self._waiting:
            time, filtered = self._waiting[0]
            wrench = self._force_at(time)
            newest = self._forces[-1][0] if self._forces else -np.inf
            if wrench is None and newest < time and self._waiting[-1][0] - time < PATIENCE:
                return
            self._waiting.popleft()
            self._fold(time, filtered, np.full(6, np.nan) if wrench is None else wrench)

    def _force_at(self, time: float) -> Array | None:
        """Interpolate the filtered wrench (6,) at a time.

        It is None where its neighbors are not there (yet).
        """
        forces = self._forces
        # Frames come in order: what lies before the last two samples up to this frame is done with.
        while len(forces) > 1 and forces[1][0] <= time:
            forces.popleft()
        if not forces or forces[0][0] > time + 1e-9:
            return None
        before, wrench = forces[0]
        if time - before < 1e-9:
            return wrench
        if len(forces) < 2:
            return None
        after, other = forces[1]
        share = (time - before) / (after - before)
        return (1.0 - share) * wrench + share * other

    def _fold(self, time: float, filtered: Array, wrench: Array) -> None:
        if not np.isfinite(filtered).all():
            self.left_out[NO_MOTION] += 1
            return
        if not np.isfinite(wrench).all():
            self.left_out[NO_FORCE] += 1
            return
        values, velocities, accelerations = filtered[:, None]
        motion = Motion(
            time=np.array([time]),
            names=self.model.coordinate_names,
            values=values,
            velocities=velocities,
            accelerations=accelerations,
        )
        block = next(regressor_blocks(self.model, motion))
        rows = block.rows[0]
        reference = block.reference[0]
        at_base = np.concatenate([wrench[:3] - np.cross(reference, wrench[3:]), wrench[3:]])
        self._missing.append(float((rows[3:] @ self._parameters - at_base[3:]) @ self._up))
        if abs(np.mean(self._missing)) > self.options.missing * self._weight:
            self.left_out[UNMEASURED] += 1
            return
        self.fit.update(rows, at_base)
        self.used.append(time)
        self._time = time


def total_wrench(forces: Array, points: Array, torques: Array) -> Array:
    """Sum wrenches to one about the ground's origin.

    A plate with less than `UNLOADED` may have no point of application; a loaded one without makes
    the total NaN.

    Parameters
    ----------
    forces : (..., wrenches, 3) [N]
    points : (..., wrenches, 3) of application [m]
    torques : (..., wrenches, 3) about the points [N m]

    Returns
    -------
    (..., 6) moment about the ground's origin [N m] and force [N]

    Raises
    ------
    BadData : shapes differ, or the last axis has not three components
    """
    forces = np.asarray(forces, dtype=np.float64)
    points = np.asarray(points, dtype=np.float64)
    torques = np.asarray(torques, dtype=np.float64)
    if not forces.shape == points.shape == torques.shape or forces.shape[-1] != 3:
        raise BadData(
            f"expected wrenches (..., 3), but got {forces.shape}, {points.shape} and"
            f" {torques.shape}"
        )
    idle = np.linalg.norm(forces, axis=-1, keepdims=True) < UNLOADED
    moments = np.cross(np.where(idle & np.isnan(points), 0.0, points), forces) + torques
    return np.concatenate([moments.sum(axis=-2), forces.sum(axis=-2)], axis=-1)
