"""Base parameters frame by frame, with what is known of each link so far and what to move next."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from myomorph.body.identify.base_parameters import (
    BaseParameters,
    base_parameters,
    base_sizes,
    link_levels,
    root_coordinates,
)
from myomorph.body.identify.triangles import fold, levels, rank_and_condition, with_prior
from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.rigid.regressor import base_regressor
from myomorph.core.rigid.tree import compile_tree

NOISE = (2.0, 2.0, 2.0, 5.0, 5.0, 5.0)
"""Noise of the base wrench where none is given: a force plate's, and that of accelerations [N m],
[N].
"""
# Half amplitude of a movement that is proposed, of angles [rad] and lengths [m]
_SWING = (0.5, 0.1)
# Standard deviation of a weak prior about the model, in multiples of the sizes (as in
# `BaseOptions`)
PRIOR = 100.0
MEMORY = 200  # Frames over which errors of prediction are averaged
_PHASES = 6
_SAMPLES = 20  # Independent samples that a proposed movement is counted as, about two seconds of it


@dataclass(frozen=True, eq=False)
class Proposal:
    """A movement that would show more."""

    coordinate: str  # to move, about half a radian up and down once a second
    body: str  # the body that it moves first
    gain: float  # information it would add, in nats: 0.35 halves the variance of one parameter


@read_only
class SequentialState:
    """What is known after some frames."""

    frames: int  # folded in so far; with forgetting, older ones count less
    left_out: int  # frames with something missing
    # estimate, sd, relative_sd: (n,) base parameters, standard deviations, and sd / |estimate|
    estimate: Array
    sd: Array
    relative_sd: Array
    # (n,) share of what is known of each base parameter that comes from the motion rather than from
    # the model, 1 - var / (var without data), 0 to 1
    levels: Array
    # rank, condition: of the data's information, columns scaled to length 1
    rank: int
    condition: float
    # level of every body, the mean over the base parameters named after it; a body without any has
    # its parent's
    link_levels: Mapping[str, float]
    # (6,) RMS of the last frames' errors of the predicted base wrench [N m], [N]
    innovation_rms: Array
    # (6,) what it should be by the noise and by what is not known yet, at the last frame; far below
    # `innovation_rms`, the noise was given too small or the kinematics are wrong [N m], [N]
    expected_rms: Array
    wrench_rms: Array  # (6,) RMS of what was measured over the same frames

    @property
    def progress(self) -> float:
        """Mean level of all base parameters, 0 to 1."""
        return float(self.levels.mean())

    @property
    def least(self) -> str:
        """The body that is known worst."""
        return min(self.link_levels, key=lambda body: self.link_levels[body])


class _Swings(NamedTuple):
    """Rows (coordinates, samples, n) that a movement of each coordinate would give, whitened."""

    coordinates: tuple[str, ...]
    bodies: tuple[str, ...]
    rows: Array


class SequentialFit:
    """Recursive least squares in square-root form: R phi_B = z, row by row of the base wrench.

    A frame's six rows are turned into the triangular factor by Householder reflections, which is
    the batch's QR decomposition continued: both end in the same numbers. `update` changes this
    object.

    Parameters
    ----------
    base : what is estimated; by default the model's base parameters, its locked coordinates at rest
    sigma : (6,) or one number, noise of the rows of the base wrench [N m], [N]. Where successive
        frames are not independent (filtered, sampled fast), times the root of the frames that make
        one sample
    forgetting : below 1, frames T ago weigh forgetting^T: for bodies or plates that change

    Attributes
    ----------
    sizes : (n,) how large each base parameter is in the model
    """

    def __init__(
        self,
        model: Model,
        base: BaseParameters | None = None,
        sigma: ArrayLike = NOISE,
        forgetting: float = 1.0,
    ):
        base = base or base_parameters(model)
        sigma = np.broadcast_to(np.asarray(sigma, dtype=np.float64), (6,))
        if not (np.isfinite(sigma).all() and (sigma > 0.0).all()):
            raise BadData(
                f"the noise of the base wrench is {sigma.tolist()}: expected six positive numbers"
            )
        if not 0.9 < forgetting <= 1.0:
            raise BadData(
                f"the forgetting factor is {forgetting:g}: expected above 0.9 and at most 1"
            )
        if base.bodies != model.body_names:
            raise BadData("the base parameters are of another model")
        self.model = model
        self.base = base
        self.sizes = base_sizes(model, base)
        self.sigma = frozen_array(sigma)
        self.forgetting = forgetting
        self._mean = base.of(inertial_parameters(model))
        n = len(base)
        self._factor = np.zeros((n, n + 1))
        self._rows = np.empty((6, n + 1))
        self._estimate = self._mean.copy()
        self._due = 0
        self.frames = self.left_out = 0
        self._weight = 0.0
        self._errors = np.zeros(6)
        self._measured = np.zeros(6)
        self._last = np.zeros((6, n))
        self._swings: _Swings | None = None

    def update(self, rows: Array, wrench: Array) -> Array:
        """Fold in one frame, and return the error of the wrench predicted before.

        The prediction uses an estimate that lags by at most a tenth of the frames, and 100 of them.
        A frame with anything missing is left out.

        Parameters
        ----------
        rows : (6, 10 bodies) of `base_regressor`
        wrench : (6,) of `base_wrench` [N m], [N]

        Returns
        -------
        (6,) [N m], [N]; NaN where the frame is left out
        """
        columns = rows[:, self.base.columns]
        if not (np.isfinite(wrench).all() and np.isfinite(columns).all()):
            self.left_out += 1
            return np.full(6, np.nan)
        # Not by BLAS, whose threads would cost more than so few numbers.
        error: Array = wrench - np.einsum("ij,j->i", columns, self._estimate)
        self._rows[:, :-1] = columns / self.sigma[:, None]
        self._rows[:, -1] = wrench / self.sigma
        if self.forgetting < 1.0:
            self._factor *= math.sqrt(self.forgetting)
        fold(self._factor, self._rows)
        self.frames += 1
        self._last = columns
        keep = min(1.0 - 1.0 / MEMORY, self.frames / (self.frames + 1.0))
        self._weight = keep * self._weight + 1.0
        self._errors = keep * self._errors + error**2
        self._measured = keep * self._measured + wrench**2
        if self.frames >= self._due:
            self._solve()
        return error

    def _solve(self) -> Array:
        """Refresh the estimate; returns the triangular factor with the prior."""
        R, z = with_prior(self._factor, self._mean, PRIOR * self.sizes)
        self._estimate = scipy.linalg.solve_triangular(R, z)
        self._due = self.frames + 1 + min(self.frames // 10, 100)
        return R

    def rows(self) -> tuple[Array, Array]:
        """Return rows as `BaseFit.rows`: |A phi - b|^2 is the data's misfit.

        Returns
        -------
        A (n, 10 bodies) and b (n,)
        """
        return self._factor[:, :-1] @ self.base.combination, self._factor[:, -1].copy()

    def state(self) -> SequentialState:
        """Everything known by now."""
        R = self._solve()
        inverse = scipy.linalg.solve_triangular(R, np.eye(len(R)))
        sd = np.linalg.norm(inverse, axis=1)
        basis = levels(self._factor[:, :-1], self._mean, self.sizes)
        rank, condition = rank_and_condition(self._factor[:, :-1])
        weight = max(self._weight, 1.0)
        return SequentialState(
            frames=self.frames,
            left_out=self.left_out,
            estimate=frozen_array(self._estimate),
            sd=frozen_array(sd),
            relative_sd=frozen_array(sd / np.maximum(np.abs(self._estimate), 1e-300)),
            levels=frozen_array(basis),
            rank=rank,
            condition=condition,
            link_levels=FrozenMap(link_levels(self.model, self.base, basis)),
            innovation_rms=frozen_array(np.sqrt(self._errors / weight)),
            expected_rms=frozen_array(
                np.hypot(self.sigma, np.linalg.norm(self._last @ inverse, axis=1))
            ),
            wrench_rms=frozen_array(np.sqrt(self._measured / weight)),
        )

    def propose(self, most: int = 3) -> tuple[Proposal, ...]:
        """Propose the coordinates whose movement would show most of what is not known yet.

        The best comes first. The information is that of a slow swing of each coordinate alone, log
        det(I + Y_B P Y_B^T / sigma^2) with the covariance P so far, had the model's parameters been
        right to within their sizes. The swings are about the model's default pose. The joints of
        the base to the ground are not proposed.
        """
        if self._swings is None:
            self._swings = self._prepare()
        swings = self._swings
        if not swings.coordinates:
            return ()
        R, _ = with_prior(self._factor, self._mean, self.sizes)
        spread = swings.rows @ scipy.linalg.solve_triangular(R, np.eye(len(R)))
        size = spread.shape[1]
        information = np.eye(size) + (_SAMPLES / _PHASES) * spread @ spread.transpose(0, 2, 1)
        gains = np.linalg.slogdet(information)[1] / 2.0
        best = np.argsort(-gains)[:most]
        return tuple(
            Proposal(swings.coordinates[i], swings.bodies[i], float(gains[i])) for i in best
        )

    def _prepare(self) -> _Swings:
        tree = compile_tree(self.model)
        names = self.model.coordinate_names
        bodies = {name: joint.child for joint in self.model.joints for name in joint.coordinates}
        roots = root_coordinates(self.model)
        moving = [
            j for j in tree.independent if names[j] not in roots and names[j] not in self.base.held
        ]
        rest = np.array(tree.defaults, dtype=np.float64)
        for name, value in self.base.held.items():
            rest[names.index(name)] = value
        rows = np.empty((len(moving), 6 * _PHASES, len(self.base)))
        for i, j in enumerate(moving):
            motion = self._swing(rest, j)
            Y = base_regressor(self.model, motion)[:, :, self.base.columns] / self.sigma[:, None]
            rows[i] = Y.reshape(6 * _PHASES, -1)
        coordinates = tuple(names[j] for j in moving)
        return _Swings(coordinates, tuple(bodies.get(name, "") for name in coordinates), rows)

    def _swing(self, rest: Array, j: int) -> Motion:
        """Swing coordinate j slowly about the pose `rest` (coordinates,), within its range."""
        phase = 2.0 * np.pi * np.arange(_PHASES) / _PHASES
        rate = 2.0 * np.pi
        coordinate = self.model.coordinates[j]
        low, high = coordinate.range
        swing = min(_SWING[coordinate.motion == "translational"], 0.5 * (high - low))
        middle = min(max(rest[j], low + swing), high - swing) if low < high else rest[j]
        values = np.tile(rest, (_PHASES, 1))
        velocities = np.zeros_like(values)
        accelerations = np.zeros_like(values)
        values[:, j] = middle + swing * np.sin(phase)
        velocities[:, j] = swing * rate * np.cos(phase)
        accelerations[:, j] = -swing * rate**2 * np.sin(phase)
        return Motion(
            time=phase,
            names=self.model.coordinate_names,
            values=values,
            velocities=velocities,
            accelerations=accelerations,
        )
