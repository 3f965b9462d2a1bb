"""The tension problem with elastic tendons: overlapping windows of frames and results."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.rigid.frames import over_frames, thread_count
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.dual import INFEASIBLE, MISSING, OPTIMAL, STALLED
from myomorph.core.tension.elastic import windows
from myomorph.core.tension.elastic.interior import Outcome
from myomorph.core.tension.elastic.program import Point
from myomorph.core.tension.elastic.windows import ElasticMuscleTerm, along, fibers_at
from myomorph.core.tension.problem import Balance, TensionInputs, TensionProblem
from myomorph.core.tension.tension import (
    Certificate,
    Fibers,
    Tension,
    Unreachable,
    passive_peaks,
)

WINDOW = 256
"""Number of frames kept of each window of a long recording."""
MARGIN = 0.3
"""Time before and after them that is solved too [s]."""
MAX_BRIDGE = 0.1
"""Gaps up to this long are bridged [s]."""
PASSES = 2
"""Passes over a window whose contact forces are smoothed: each frame is drawn to those beside it of
the pass before, in the first pass of the solution with rigid tendons.
"""
TRANSIENT = 0.1
"""Time from the beginning and before the end in which what lies beyond is felt [s]."""
MAX_FIBER = 1.8
"""Normalized length beyond which fibers are said not to reach."""
MAX_MISS = 1e-3
"""Torque left over, relative to 1 + the greatest, above which a frame is infeasible."""

Solved = tuple[Point, Outcome]


def solve_elastic(inputs: TensionInputs, progress: Callable[[int], None] | None = None) -> Tension:
    """Do `solve_tension` with elastic tendons; errors are those of it."""
    # Threads of the package share out windows and parts; those of BLAS would only wait for each
    # other.
    with threadpool_limits(1, "blas"):
        return ElasticProblem(inputs).solve_all(progress)


@dataclass(frozen=True, eq=False)
class WindowResults:
    """Results of the frames of a window, filled run by run.

    Attributes
    ----------
    x : (frames, unknowns)
    forces : (frames, muscles) normalized tendon forces
    residual, iterations, status : (frames,)
    """

    x: Array
    forces: Array
    residual: Array
    iterations: NDArray[np.int64]
    status: NDArray[np.int8]

    @staticmethod
    def empty(frames: int, unknowns: int, muscles: int) -> WindowResults:
        """Results of frames that are not solved."""
        return WindowResults(
            x=np.full((frames, unknowns), np.nan),
            forces=np.full((frames, muscles), np.nan),
            residual=np.full(frames, np.nan),
            iterations=np.zeros(frames, np.int64),
            status=np.full(frames, MISSING, np.int8),
        )


class ElasticProblem(TensionProblem):
    """`TensionProblem` whose frames are linked by tendons.

    Attributes
    ----------
    muscles : with the curves of tendons
    unreachable : muscles whose fibers cannot reach, solved with rigid tendons
    parts : what is solved apart
    lengths, speeds : (frames, muscles) of the paths [m], [m/s]
    """

    muscles: ElasticMuscleTerm

    def __init__(self, inputs: TensionInputs):
        if inputs.options.curves == "constant":
            raise BadData(
                "curves 'constant' with elastic tendons: a tendon stretches fibers, which need"
                " curves"
            )
        super().__init__(inputs, ElasticMuscleTerm(compile_tree(inputs.model), inputs.options))
        time = self._time
        frames = len(time)
        muscles = len(self.muscles.strength)
        self.lengths = np.empty((frames, muscles))
        self.speeds = np.empty((frames, muscles))
        over_frames(self._measure, frames)
        self.unreachable = self._take_off_unreachable()
        self._refuse_unfit_terms()
        self.parts = windows.parts_of(self.separable, self.muscles.elastic)
        step = float(np.median(np.diff(time))) if frames > 1 else MARGIN
        self._margin = int(np.ceil(MARGIN / step))
        # Contact forces come and go within a frame and cannot push and pull as balance would have
        # it: all are solved.
        all_frames = self.contacts is not None or self.smooth is not None
        self._every = 1 if all_frames else windows.solved_every(time)
        window = WINDOW * self._every
        self.window = frames if frames <= window + 2 * self._margin else window
        self._tendon_forces = np.full((frames, muscles), np.nan)
        self._bridged = np.zeros(frames, np.bool_)
        self._transient = np.zeros(frames, np.bool_)
        self._outcomes: list[Outcome] = []

    def _refuse_unfit_terms(self) -> None:
        """Refuse rows on activations of elastic muscles, and a problem without such muscles.

        Activations at frames are no unknowns here; forces of tendons are.
        """
        elastic = np.flatnonzero(self.muscles.elastic)
        for rows in self.added_rows:
            if not rows.on_forces and np.isin(rows.column, elastic).any():
                raise BadData(
                    f"term '{rows.names[0]}' has rows on activations, which elastic tendons do not"
                    " support yet"
                )
        if not len(elastic):
            raise BadData(
                "no muscle has an elastic tendon that its fibers can reach: use rigid tendons"
            )

    def _measure(self, start: int, stop: int) -> None:
        """Fill lengths and speeds of the paths in some frames."""
        part = slice(start, stop)
        coordinates = np.ascontiguousarray(self.coordinates[part])
        lengths, speeds = self.muscles.paths_of(coordinates, self._rates[part])
        self.lengths[part] = lengths
        self.speeds[part] = speeds

    def _take_off_unreachable(self) -> tuple[Unreachable, ...]:
        """Give rigid tendons to muscles whose fibers cannot reach, and name them."""
        H = self.muscles.arrays.hill
        names = self.assembly.tree.model.muscle_names
        along = self.lengths - H.tendon
        fiber = np.where(along > 0.0, np.sqrt(along**2 + H.height**2), along) / H.fiber
        with np.errstate(invalid="ignore"):
            cannot = (fiber <= 0.0) | (fiber > MAX_FIBER)
        unreachable = []
        for m in np.flatnonzero(self.muscles.elastic & cannot.any(axis=0)):
            lengths = fiber[:, m]
            worst = np.nanargmax(np.abs(lengths - 1.0))
            unreachable.append(
                Unreachable(
                    muscle=names[m],
                    frame=int(np.flatnonzero(cannot[:, m])[0]),
                    worst=float(lengths[worst]),
                )
            )
            self.muscles.elastic[m] = False
        return tuple(unreachable)

    def solve(self, start: int, stop: int) -> None:
        """Solve the frames start ... stop - 1, and those before and after that are felt."""
        begin = max(start - self._margin, 0)
        end = min(stop + self._margin, len(self._time))
        if self.window >= len(self._time):
            begin = start
            end = stop
        balance = self.balance(begin, end)
        good = np.asarray(np.isfinite(balance.values).all(axis=1))
        good &= np.isfinite(balance.right).all(axis=1)
        results = WindowResults.empty(
            end - begin, len(self.separable.weight), len(self.muscles.strength)
        )
        for first, last in windows.runs(good, self._bridgeable(begin, good)):
            self._solve_run(balance, begin, slice(first, last), good[first:last], results)

        without_margin = slice(start - begin, stop - begin)
        part = slice(start, stop)
        bridged = ~good & np.isfinite(results.x[:, 0])
        self._residual[part] = results.residual[without_margin]
        self._iterations[part] = results.iterations[without_margin]
        self._status[part] = results.status[without_margin]
        self._tendon_forces[part] = results.forces[without_margin]
        self._bridged[part] = bridged[without_margin]
        stored = balance.of(without_margin)
        self._store(part, results.x[without_margin], stored)
        # Muscles on elastic tendons pull with the tendons' forces.
        pulls = results.forces[without_margin] * self.muscles.strength + stored.viscous
        elastic = self.muscles.elastic
        self._forces[part][:, elastic] = pulls[:, elastic]

    def _bridgeable(self, begin: int, good: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Frames of gaps short enough to be bridged.

        Parameters
        ----------
        begin : number of the first frame
        good : (frames,) whether a frame has all input

        Returns
        -------
        (frames,)
        """
        result = np.zeros(len(good), np.bool_)
        time = self._time[begin : begin + len(good)]
        for before, after in pairwise(np.flatnonzero(good)):
            if after > before + 1 and time[after] - time[before] <= MAX_BRIDGE + 1e-9:
                result[before + 1 : after] = True
        return result

    def _solve_run(
        self,
        balance: Balance,
        begin: int,
        part: slice,
        good: NDArray[np.bool_],
        results: WindowResults,
    ) -> None:
        """Solve frames without a gap that is not bridged, into the results of the window.

        Parameters
        ----------
        balance : of the window, whose first frame is `begin`
        part : the frames, counted in the window
        good : (frames of the part,) whether a frame has all input
        """
        frames, known = self._frames(balance, begin, part, good)
        place = slice(begin + part.start, begin + part.stop)
        outcomes = self._passes(frames, place) if len(frames.time) > 1 else []
        x = frames.x
        residual, scale = self._missed(frames, x)
        solved = all(outcome.solved for outcome in outcomes)
        status = np.where(known, OPTIMAL, MISSING) if solved else np.full(len(known), STALLED)
        status = np.where((status == OPTIMAL) & (residual > MAX_MISS * scale), INFEASIBLE, status)
        results.x[part] = x
        results.forces[part] = frames.forces
        results.residual[part] = residual
        results.iterations[part] = max((outcome.steps for outcome in outcomes), default=0)
        results.status[part] = np.where(good, status, MISSING)
        self._outcomes += outcomes
        self._mark(place.start, place.stop)

    def _passes(self, frames: windows.Frames, place: slice) -> list[Outcome]:
        """Solve a run of frames, twice where contact forces are smoothed."""
        solve = self._pass_thinned if self._every > 1 else self._pass
        if self.smooth is None:
            return solve(frames)
        outcomes: list[Outcome] = []
        penalties = frames.penalties
        links = self.smooth.links(place.start, place.stop)
        for _ in range(PASSES):
            frames.penalties = windows.drawn(penalties, links, frames.x, self.separable)
            outcomes = solve(frames)
        return outcomes

    def _pass_thinned(self, frames: windows.Frames) -> list[Outcome]:
        """Solve some of the frames, from which those between follow.

        Their forces are as near by as balances their torques.
        """
        keep = windows.picked(len(frames.time), self._every)
        elastic = np.flatnonzero(self.muscles.elastic)
        few = frames.at(keep)
        result = self._pass(few)
        frames.x = along(frames.time, keep, few.x)
        held = frames.x.copy()
        held[:, elastic] = along(frames.time, keep, few.forces[:, elastic])
        on_elastic = np.isin(np.arange(held.shape[1]), elastic)
        between = np.setdiff1d(np.arange(len(frames.time)), keep)
        for part in np.array_split(between, 1 + len(between) // WINDOW):
            values = frames.values[part]
            right = frames.right[part]
            held[part] = windows.balanced(self.separable, values, right, held[part], on_elastic)
        frames.forces[:, elastic] = held[:, elastic]
        frames.x = np.where(on_elastic, frames.x, held)
        return result

    def _pass(self, frames: windows.Frames) -> list[Outcome]:
        """Solve the parts of a run of frames from its x and y, and put there the solution."""
        dynamics = self.options.activation_dynamics
        tasks = []
        for part in self.parts:
            program = windows.program_of(part, frames, self.separable, self.muscles, dynamics)
            start, y = windows.start_of(part, frames, program)
            second_start = self.options.second_start
            tasks.append(partial(windows.solve_part, program, start, y, second_start))
        solved = _at_once(tasks, self.window >= len(self._time))
        for part, (point, _) in zip(self.parts, solved, strict=True):
            frames.forces[:, part.muscles] = point.f
            # Activations at the frames: the mean of those before and after, at the ends the
            # nearest.
            a = point.a
            frames.x[:, part.muscles] = np.concatenate([a[:1], 0.5 * (a[1:] + a[:-1]), a[-1:]])
            frames.x[:, part.others] = point.x
        return [outcome for _, outcome in solved]

    def _frames(
        self, balance: Balance, begin: int, part: slice, good: NDArray[np.bool_]
    ) -> tuple[windows.Frames, NDArray[np.bool_]]:
        """Run of frames without gaps, with the solution on rigid tendons.

        Parameters
        ----------
        balance, begin, part, good : as of `_solve_run`

        Returns
        -------
        the frames, and (frames,) whether a frame has all that a solution needs
        """
        place = slice(begin + part.start, begin + part.stop)
        time = self._time[place]
        values = windows.filled(time, balance.values[part], good)
        right = windows.filled(time, balance.right[part], good)
        lengths = windows.filled(time, self.lengths[place], good)
        speeds = windows.filled(time, self.speeds[place], good)

        term = self.muscles
        active, passive = term.rigid_forces(lengths, speeds)
        ratio = np.where(term.elastic, active / term.strength, 0.0)
        offset = np.where(term.elastic, passive / term.strength, 0.0)
        rigid = self._on_rigid_tendons(values, right, ratio, offset)
        solved = self.solved(balance._replace(values=rigid[0], right=rigid[1]), place.start)
        x = np.nan_to_num(solved.x, posinf=0.0, neginf=0.0)
        frames = windows.Frames(
            time=time,
            values=values,
            right=right,
            penalties=self.penalties[place],
            lengths=lengths,
            speeds=speeds,
            x=x,
            y=np.nan_to_num(solved.multipliers, posinf=0.0, neginf=0.0),
            forces=np.where(term.elastic, ratio * x[:, : len(term.strength)] + offset, np.nan),
        )
        return frames, solved.status != MISSING

    def _on_rigid_tendons(
        self, values: Array, right: Array, ratio: Array, offset: Array
    ) -> tuple[Array, Array]:
        """Balance in which elastic muscles are on rigid tendons.

        Parameters
        ----------
        values, right : (frames, entries) and (frames, rows), of one unit of normalized tendon force
        ratio, offset : (frames, muscles) normalized force of full activation, and passive force

        Returns
        -------
        (frames, entries) and (frames, rows)
        """
        shared = self.separable
        column = shared.column
        on_muscles = np.flatnonzero(column < len(self.muscles.strength))
        stretched = on_muscles[self.muscles.elastic[column[on_muscles]]]
        rigid_values = values.copy()
        rigid_right = right.copy()
        rigid_values[:, stretched] *= ratio[:, column[stretched]]
        for entry in stretched:
            rigid_right[:, shared.row[entry]] -= values[:, entry] * offset[:, column[entry]]
        return rigid_values, rigid_right

    def _missed(self, frames: windows.Frames, x: Array) -> tuple[Array, Array]:
        """Greatest torque that is not balanced in each frame, and the scale it is judged by.

        Parameters
        ----------
        x : (frames, unknowns)

        Returns
        -------
        (frames,) both [N m or N]
        """
        shared = self.separable
        held = x.copy()
        elastic = np.flatnonzero(self.muscles.elastic)
        held[:, elastic] = frames.forces[:, elastic]
        left = frames.right.copy()
        for entry, (row, unknown) in enumerate(zip(shared.row, shared.column, strict=True)):
            left[:, row] -= frames.values[:, entry] * held[:, unknown]
        return np.abs(left).max(axis=1), 1.0 + np.abs(frames.right).max(axis=1)

    def _mark(self, first: int, last: int) -> None:
        """Mark frames near a beginning or an end of what could be solved in one go.

        A window that only ends there is none.
        """
        time = self._time
        known = np.asarray(np.isfinite(self.lengths).all(axis=1))
        if first == 0 or not known[first - 1] or np.isnan(self._torques[first - 1]).any():
            self._transient[first:last] |= time[first:last] < time[first] + TRANSIENT
        if last == len(time) or not known[last] or np.isnan(self._torques[last]).any():
            self._transient[first:last] |= time[first:last] > time[last - 1] - TRANSIENT

    def result(self) -> Tension:
        """Tensions of all frames with their fibers, as a value."""
        tension = super().result()
        names = self.assembly.tree.model.muscle_names
        elastic = self.muscles.elastic
        paths = windows.Paths(
            lengths=self.lengths,
            speeds=self.speeds,
            normalized=self._tendon_forces,
            forces=tension.muscle_force,
        )
        motion = fibers_at(self.muscles, self._time, paths)
        tension = self._with_fiber_passive(tension, motion.lengths)
        fibers = Fibers(
            fiber_length=motion.lengths,
            fiber_velocity=motion.velocities,
            tendon_strain=motion.tendon_strains,
            fiber_power=motion.fiber_powers,
            tendon_power=motion.tendon_powers,
            transient=self._transient,
            bridged=self._bridged,
            rigid=tuple(
                name for name, stretches in zip(names, elastic, strict=True) if not stretches
            ),
            unreachable=self.unreachable,
            certificate=_certificate(self._outcomes),
        )
        return replace(tension, fibers=fibers)

    def _with_fiber_passive(self, tension: Tension, fibers: Array) -> Tension:
        """Put in the passive force of fibers that tendons leave at their own length.

        Parameters
        ----------
        tension : with that of muscles on rigid tendons
        fibers : (frames, muscles) lengths [m]
        """
        if not self.options.has_passive:
            return tension
        passive = np.array(self._passive)
        if self.options.passive_on_elastic:
            elastic = self.muscles.elastic
            passive[:, elastic] = self.muscles.fiber_passive(fibers)[:, elastic]
        peaks = passive_peaks(passive, self.muscles.strength, self._time)
        names = self.assembly.tree.model.muscle_names
        return replace(
            tension,
            overstretched=tuple(names[i] for i in np.flatnonzero(peaks.share > 1.0)),
            muscle_passive_share=peaks.share,
            muscle_passive_time=peaks.time,
        )


def _certificate(outcomes: Sequence[Outcome]) -> Certificate:
    """How the solver ended, over all windows and parts."""
    far = np.array([outcome.far for outcome in outcomes]).reshape(-1, 2)
    distance = np.full(2, np.nan)
    if len(far):
        distance = np.array([np.sqrt(np.mean(far[:, 0] ** 2)), np.sqrt(np.mean(far[:, 1] ** 2))])
    return Certificate(
        residual=max((outcome.residual for outcome in outcomes), default=0.0),
        equilibrium=max((outcome.equilibrium for outcome in outcomes), default=0.0),
        steps=max((outcome.steps for outcome in outcomes), default=0),
        second_activations=float(distance[0]),
        second_forces=float(distance[1]),
    )


def _at_once(tasks: Sequence[Callable[[], Solved]], threads: bool) -> list[Solved]:
    """Run tasks, in threads where no windows already are."""
    workers = min(thread_count(), len(tasks)) if threads else 1
    if workers <= 1:
        return [task() for task in tasks]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(lambda task: task(), tasks))
