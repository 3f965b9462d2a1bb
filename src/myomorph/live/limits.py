"""Interval bounds of the results of `live`.

They come from its chain on inputs drawn with errors, computed while the next frame is awaited. As
in the step `uncertainty`, but frame by frame and to first order in the pose, errors of markers,
placement and joints move the pose by the derivatives of inverse kinematics, go through the filter
of the poses, and what follows is computed in full for every draw. How far bounds lie from the
result changes slowly: a few rounds of draws a second are enough.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.fit.interval_rule import drawn_limits
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.series_quantities import COORDINATE_VALUE
from myomorph.core.motion.causal import CausalFilter, CausalStream
from myomorph.core.rigid.dynamics import OnlineDynamics
from myomorph.core.rigid.quantities import GENERALIZED_FORCE
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.dual import OPTIMAL
from myomorph.core.tension.online import OnlineTension
from myomorph.core.tension.quantities import ACTIVATION, MUSCLE_FORCE
from myomorph.core.tension.recruitment import RecruitmentOptions
from myomorph.core.tension.tension import TensionOptions
from myomorph.lab.study.trial.steps.drawn_trials import (
    POSES,
    TENSIONS,
    drawn_costs,
    drawn_criterion,
)
from myomorph.lab.uncertainty.bodies import Draw, drawn_subject
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import Sources
from myomorph.lab.uncertainty.spread import FACTORS
from myomorph.live.online_errors import AngleErrors, MarkerErrors, OnlineInputs

TABLES: Mapping[str, Quantity] = FrozenMap(
    {
        "coordinates": COORDINATE_VALUE,
        "torques": GENERALIZED_FORCE,
        "activations": ACTIVATION,
        "forces": MUSCLE_FORCE,
    }
)
"""Quantities that have limits, by the fields of `FrameLimits`, in the order of a row."""
NEAR = 0.1  # Third derivatives of poses no further apart than this give the fourth [s].
STALE = 0.25  # Limits that were found longer ago are not given [s].


@dataclass(frozen=True)
class LimitOptions:
    """Limits of results while frames arrive.

    Attributes
    ----------
    draws : number of draws of all inputs with their errors, which give the bounds of 90 %
        intervals; 0 for no intervals. 40 draws fit into real time on two cores with 80 muscles at
        100 frames per second
    draw_seed : other random numbers for another one
    widened : widen intervals by factors found on simulated recordings whose errors differ from the
        assumed ones
    """

    draws: int = 0
    draw_seed: int = 0
    widened: bool = True

    def __post_init__(self) -> None:
        if self.draws < 0 or self.draws == 1:
            raise BadData(f"{self.draws} draws: expected 2 or more, or 0 for no limits")


@read_only
class FrameLimits:
    """Lower limits, upper limits and standard deviations of a frame's results."""

    # coordinates, torques: (3, coordinates) [rad or m], [N m or N]
    coordinates: Array
    torques: Array
    # activations, forces: (3, muscles), [N]
    activations: Array
    forces: Array


@read_only
class Instant:
    """What a frame gave without errors."""

    time: float
    pose: Array  # (coordinates,) not filtered
    row: Array  # markers of the frame (markers, 3) [m], or coordinates
    motion: Array  # (4, coordinates) filtered value and its derivatives up to the third
    loads: Array  # (3, bodies, 6) filtered wrenches and their first two derivatives
    result: Array  # (columns,) all `TABLES` beside each other


@read_only
@dataclass(frozen=True, kw_only=True)
class DrawnChain:
    """What of a chain its limits depend on besides the model.

    Attributes
    ----------
    names : of the markers that arrive; None where coordinates do
    bodies : that external forces act on
    filter : of poses and forces
    rate : of the frames [Hz]
    up : (3,) unit vector against gravity
    """

    names: Sequence[str] | None
    bodies: Sequence[str]
    filter: CausalFilter
    rate: float
    up: Array


class LiveLimits:
    """Draws of the chain beside the frames.

    Attributes
    ----------
    factors : by which bounds of each table are wider than those of the draws
    tried, failed : drawn frames, and how many of these had no solution
    missed : frames with results for which no bounds were known in time
    """

    def __init__(
        self,
        model: Model,
        chain: DrawnChain,
        options: LimitOptions,
        sources: Sources | None = None,
        tension: TensionOptions | None = None,
        recruitment: RecruitmentOptions | None = None,
    ):
        self._count = options.draws
        self.draws = options.draws
        self.factors = {
            quantity.name: FACTORS[quantity.name] if options.widened else 1.0
            for quantity in TABLES.values()
        }
        normals = Normals(options.draws, options.draw_seed)
        draws = [Draw(number, sources or Sources(), normals) for number in range(options.draws)]
        criterion = (tension or TensionOptions(), recruitment or RecruitmentOptions())
        self._drawn = [_Drawn(model, draw, chain.bodies, *criterion) for draw in draws]
        self._inputs = OnlineInputs(
            draws=draws, bodies=chain.bodies, delay=chain.filter.delay, up=chain.up
        )
        self._errors: MarkerErrors | AngleErrors
        if chain.names is not None or model.markers:
            self._errors = MarkerErrors(
                model=model,
                drawn=[draw.tree for draw in self._drawn],
                draws=draws,
                names=chain.names,
                rate=POSES,
                thinned=min(chain.rate, POSES) / chain.rate,
            )
        else:
            self._errors = AngleErrors(model, draws, POSES)
        self._n = len(model.coordinates)
        self._muscles = len(model.muscles)
        self._ends = np.cumsum([0, self._n, self._n, self._muscles, self._muscles])
        self._stream = CausalStream(chain.filter, options.draws * self._n)
        self._job: Iterator[None] | None = None
        self._posed = self._round = -np.inf
        self._found: tuple[float, Array] | None = None
        self._before = -np.inf, np.zeros(self._n)
        self.failed = self.tried = self.missed = 0

    @property
    def notes(self) -> tuple[str, ...]:
        """What is wrong with the limits, one line each."""
        notes = []
        if self.failed > 0.02 * self.tried:
            notes.append(
                f"limits: {self.failed} of {self.tried} drawn frames have no solution: limits are"
                " too narrow"
            )
        if self.missed:
            notes.append(
                f"limits: none were ready in time for {self.missed} frames: use fewer --draws"
            )
        return tuple(notes)

    def warm_up(self, instant: Instant) -> None:
        """Compute everything once without effect."""
        errors = np.zeros((self._count, self._n))
        for _ in self._errors.fill(instant.time, instant.pose, instant.row, errors):
            pass
        self._errors.forget()
        self._stream.push(instant.time + np.array([0.0, 0.01]), np.zeros((2, errors.size)))
        self._stream.at(instant.time + 10.0)
        self._stream.forget()
        self._drawn[0].fill(instant.motion[:3], instant.loads[0], np.empty(int(self._ends[-1])))

    def due(self, time: float) -> bool:
        """Whether a frame of that time is to be drawn around."""
        return self._job is None and time - self._posed >= 1.0 / POSES - 1e-6

    def offer(self, instant: Instant) -> None:
        """Draw around a frame that is due, from now on while there is time."""
        self._posed = instant.time
        self._job = self._work(instant)

    def idle(self) -> bool:
        """Go on for half a millisecond or so; whether anything is left to do."""
        if self._job is None:
            return False
        try:
            next(self._job)
        except StopIteration:
            self._job = None
        return self._job is not None

    def at(self, time: float, result: Array) -> FrameLimits | None:
        """Return the interval bounds of a frame with a result.

        Parameters
        ----------
        time : of the frame [s]
        result : (columns,) coordinates, torques, activations and forces

        Returns
        -------
        The bounds, None where none are known
        """
        if self._found is None:
            return None
        then, apart = self._found
        if time - then > STALE:
            self.missed += 1
            return None
        values = apart.copy()
        values[:2] += result
        parts = [values[:, a:b] for a, b in zip(self._ends, self._ends[1:], strict=False)]
        for start, quantity, part in zip(self._ends, TABLES.values(), parts, strict=False):
            lower, upper = quantity.bounds
            table = result[start:][: part.shape[1]]
            np.maximum(part[:2], np.minimum(table, lower), out=part[:2])
            np.minimum(part[:2], upper, out=part[:2])
        coordinates, torques, activations, forces = parts
        return FrameLimits(
            coordinates=coordinates, torques=torques, activations=activations, forces=forces
        )

    def _work(self, instant: Instant) -> Iterator[None]:
        """Compute errors of the pose, and where it is due, all that follows from them.

        It stops between parts of the work.
        """
        fourth = self._fourth(instant.time, instant.motion[3])
        limits = np.empty((self._count, self._n))
        yield from self._errors.fill(instant.time, instant.pose, instant.row, limits)
        self._stream.push(np.array([instant.time]), limits.reshape(1, -1))
        waits = instant.time - self._round < 1.0 / TENSIONS - 1e-6 or not self._stream.settled(
            instant.time
        )
        if waits or not np.isfinite(instant.result).all():
            return
        self._round = instant.time
        errors = self._stream.at(instant.time).reshape(3, self._count, self._n)
        motion = self._inputs.motion(np.concatenate([instant.motion, fourth[None]])) + np.swapaxes(
            errors, 0, 1
        )
        loads = self._inputs.loads(instant.loads)
        rows = np.empty((self._count, int(self._ends[-1])))
        for index, draw in enumerate(self._drawn):
            yield
            draw.fill(motion[index], loads[index], rows[index])
        yield
        known = np.isfinite(rows).all(axis=1)
        self.tried += self._count
        self.failed += int(self._count - known.sum())
        if known.sum() > 1:
            self._found = instant.time, self._limits(rows[known] - instant.result)

    def _fourth(self, time: float, third: Array) -> Array:
        """Estimate the fourth derivative (coordinates,) by the change of the third.

        The change is that since the pose before. The filter's own equation has it too, but passes
        on what lines between frames leave of the recorded motion.
        """
        then, before = self._before
        self._before = (time, third)
        gap = time - then
        return (third - before) / gap if 0.0 < gap < NEAR else np.zeros_like(third)

    def _limits(self, apart: Array) -> Array:
        """Find how far bounds lie from the result, and its standard deviation, (3, columns).

        They come from its errors (draws, columns).
        """
        low, high = drawn_limits(apart)
        for factor, a, b in zip(self.factors.values(), self._ends, self._ends[1:], strict=False):
            middle = 0.5 * (low[a:b] + high[a:b])
            half = 0.5 * factor * (high[a:b] - low[a:b])
            low[a:b] = middle - half
            high[a:b] = middle + half
        return np.stack([low, high, apart.std(axis=0, ddof=1)])


class _Drawn:
    """The chain behind the pose with the errors of one draw."""

    def __init__(
        self,
        model: Model,
        draw: Draw,
        bodies: Sequence[str],
        tension: TensionOptions,
        recruitment: RecruitmentOptions,
    ):
        drawn = drawn_subject(model, draw)
        if draw.sources.criterion:
            settled = recruitment.settled(drawn, tension, external=True)
            recruitment = drawn_costs(settled, draw)
            tension = drawn_criterion(tension, draw)
        self.tree = compile_tree(drawn)
        self._dynamics = OnlineDynamics(drawn, bodies)
        self._tension = OnlineTension(drawn, tension, recruitment=recruitment)

    def fill(self, motion: Array, loads: Array, row: Array) -> None:
        """Fill a row (columns,) with the results of a motion (3, coordinates).

        It is NaN without a solution.
        """
        solver = self._dynamics
        torques = solver.solve(motion[0], motion[1], motion[2], loads)
        shared = self._tension.solve_after(solver)
        if shared.status == OPTIMAL:
            row[:] = np.concatenate(
                [solver.coordinates[0], torques, shared.activations, shared.forces]
            )
        else:
            row[:] = np.nan
