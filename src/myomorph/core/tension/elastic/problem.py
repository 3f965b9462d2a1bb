"""The tension problem with elastic tendons: overlapping windows of frames, and what comes out of
them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
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
from myomorph.core.tension.tension import Certificate, Fibers, Tension, Unreachable

WINDOW = 256  # Frames kept of each window of a long recording
MARGIN = 0.3  # Time before and after them that is solved too [s]
SHORTEST_BRIDGE = 0.1  # Gaps up to this long are bridged [s]
PASSES = 2
"""Passes over a window whose contact forces are smoothed: each frame is given those beside it of
the pass before, the first those of the solution with rigid tendons.
"""

TRANSIENT = 0.1  # Time from the beginning and before the end in which what lies beyond is felt [s]
LONGEST_FIBER = 1.8  # Normalized length beyond which fibers are said not to reach
MISSED = 1e-3  # Torque left over, relative to 1 + the greatest, above which a frame is infeasible


def solve_elastic(inputs: TensionInputs, progress: Callable[[int], None] | None = None) -> Tension:
    """`solve_tension` with elastic tendons; errors are those of it."""
    # Threads of the package share out windows and parts; those of BLAS would only wait for each
    # other.
    with threadpool_limits(1, "blas"):
        return ElasticProblem(inputs).solve_all(progress)


Solved = tuple[Point, Outcome]


class ElasticProblem(TensionProblem):
    """`TensionProblem` whose frames are linked by tendons.
    `muscles`: with the curves of tendons; `unreachable`: muscles whose fibers cannot reach, solved
    with rigid tendons; `parts`: what is solved apart; `lengths`, `speeds` (frames, muscles) of the
    paths [m], [m/s].
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
        # Activations at frames are no unknowns here; forces of tendons are.
        elastic = np.flatnonzero(self.muscles.elastic)
        for rows in self.rows:
            if not rows.on_forces and np.isin(rows.column, elastic).any():
                raise BadData(
                    f"term '{rows.names[0]}' has rows on activations, which elastic tendons do not"
                    " take yet"
                )
        if not len(elastic):
            raise BadData(
                "no muscle has an elastic tendon that its fibers can reach: take rigid tendons"
            )
        self.parts = windows.parts_of(self.separable, self.muscles.elastic)
        step = float(np.median(np.diff(time))) if frames > 1 else MARGIN
        self._margin = int(np.ceil(MARGIN / step))
        # Contact forces come and go within a frame and cannot push and pull as balance would have
        # it: all are solved.
        whole = self.contacts is not None or self.smooth is not None
        self._every = 1 if whole else windows.solved_every(time)
        window = WINDOW * self._every
        self.window = frames if frames <= window + 2 * self._margin else window
        self._tendon_forces = np.full((frames, muscles), np.nan)
        self._bridged = np.zeros(frames, np.bool_)
        self._transient = np.zeros(frames, np.bool_)
        self._outcomes: list[Outcome] = []

    def _measure(self, start: int, stop: int) -> None:
        c = np.ascontiguousarray(self.coordinates[start:stop])
        self.lengths[start:stop], self.speeds[start:stop] = self.muscles.paths_of(
            c, self._rates[start:stop]
        )

    def _take_off_unreachable(self) -> tuple[Unreachable, ...]:
        """Muscles on elastic tendons whose fibers cannot reach, which are given rigid ones."""
        H = self.muscles.arrays.hill
        result = []
        along = self.lengths - H.tendon
        fiber = np.where(along > 0.0, np.sqrt(along**2 + H.height**2), along) / H.fiber
        with np.errstate(invalid="ignore"):
            cannot = (fiber <= 0.0) | (fiber > LONGEST_FIBER)
        for m in np.flatnonzero(self.muscles.elastic & cannot.any(axis=0)):
            lengths = fiber[:, m]
            worst = np.nanargmax(np.abs(lengths - 1.0))
            name = self.assembly.tree.model.muscle_names[m]
            result.append(
                Unreachable(name, int(np.flatnonzero(cannot[:, m])[0]), float(lengths[worst]))
            )
            self.muscles.elastic[m] = False
        return tuple(result)

    def solve(self, start: int, stop: int) -> None:
        """Solve the frames start ... stop - 1, and frames before and after them that are felt."""
        begin = max(start - self._margin, 0)
        end = min(stop + self._margin, len(self._time))
        if self.window >= len(self._time):
            begin = start
            end = stop
        balance = self.balance(begin, end)
        good = np.asarray(np.isfinite(balance.values).all(axis=1))
        good &= np.isfinite(balance.right).all(axis=1)
        x = np.full((end - begin, len(self.separable.weight)), np.nan)
        residual = np.full(end - begin, np.nan)
        forces = np.full((end - begin, len(self.muscles.strength)), np.nan)
        iterations = np.zeros(end - begin, np.int64)
        status = np.full(end - begin, MISSING, np.int8)
        out = (x, forces, residual, iterations, status)
        for first, last in windows.runs(good, self._bridgeable(begin, good)):
            self._solve_run(balance, begin, slice(first, last), good[first:last], out)
        kept = slice(start - begin, stop - begin)
        part = slice(start, stop)
        self._residual[part], self._iterations[part] = residual[kept], iterations[kept]
        self._status[part] = status[kept]
        self._tendon_forces[part] = forces[kept]
        self._bridged[part] = (~good & np.isfinite(x[:, 0]))[kept]
        stored = Balance(*(array[kept] for array in balance))
        self._store(part, x[kept], stored)
        # Muscles on elastic tendons pull with the tendons' forces.
        pulls = forces[kept] * self.muscles.strength + stored.viscous
        elastic = self.muscles.elastic
        self._forces[part][:, elastic] = pulls[:, elastic]

    def _bridgeable(self, begin: int, good: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Frames of gaps short enough to be bridged."""
        result = np.zeros(len(good), np.bool_)
        known = np.flatnonzero(good)
        time = self._time[begin : begin + len(good)]
        for value, other in pairwise(known):
            if other > value + 1 and time[other] - time[value] <= SHORTEST_BRIDGE + 1e-9:
                result[value + 1 : other] = True
        return result

    def _solve_run(
        self,
        balance: Balance,
        begin: int,
        part: slice,
        good: NDArray[np.bool_],
        out: tuple[np.ndarray, ...],
    ) -> None:
        """Solve frames without a gap that is not bridged, into the arrays of the window."""
        frames, status = self._frames(balance, begin, part, good)
        x, forces, residual, iterations, steps_status = out
        results: list[Outcome] = []
        if len(frames.time) > 1:
            penalties_here = frames.penalties
            for _ in range(1 if self.smooth is None else PASSES):
                if self.smooth is not None:
                    links = self.smooth.links(begin + part.start, begin + part.stop)
                    frames.penalties = windows.drawn(
                        penalties_here, links, frames.x, self.separable
                    )
                results = self._pass_thinned(frames) if self._every > 1 else self._pass(frames)
            if not all(result.solved for result in results):
                status[:] = STALLED
        others = frames.x
        x[part] = others
        forces[part] = frames.forces
        residual[part], scale = self._missed(frames, others)
        iterations[part] = max((result.steps for result in results), default=0)
        status = np.where(
            (status == OPTIMAL) & (residual[part] > MISSED * scale), INFEASIBLE, status
        )
        steps_status[part] = np.where(good, status, MISSING)
        self._outcomes += results
        self._mark(begin + part.start, begin + part.stop)

    def _pass_thinned(self, frames: windows.Frames) -> list[Outcome]:
        """Solve some of the frames; those between follow them, their forces as near by as balances
        their torques.
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
        """Solve the parts of a run of frames from what `frames` has of x and y, and put there what
        was found.
        """
        dynamics = self.options.activation_dynamics
        again = self.options.second_start
        programs = [
            windows.program_of(part, frames, self.separable, self.muscles, dynamics)
            for part in self.parts
        ]
        tasks = [
            partial(windows.solve_part, program, *windows.start_of(one, frames, program), again)
            for one, program in zip(self.parts, programs, strict=True)
        ]
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
    ) -> tuple[windows.Frames, np.ndarray]:
        """What programs are made of in a run of frames, with the solution on rigid tendons."""
        place = slice(begin + part.start, begin + part.stop)
        time = self._time[place]
        term = self.muscles
        shared = self.separable
        values = windows.filled(time, balance.values[part], good)
        right = windows.filled(time, balance.right[part], good)
        lengths = windows.filled(time, self.lengths[place], good)
        speeds = windows.filled(time, self.speeds[place], good)
        active, passive = term.rigid_forces(lengths, speeds)
        ratio = np.where(term.elastic, active / term.strength, 0.0)
        offset = np.where(term.elastic, passive / term.strength, 0.0)
        muscles = len(term.strength)
        column = shared.column
        on_muscles = np.flatnonzero(column < muscles)
        stretched = on_muscles[term.elastic[column[on_muscles]]]
        rigid_values = values.copy()
        rigid_right = right.copy()
        rigid_values[:, stretched] *= ratio[:, column[stretched]]
        for entry in stretched:
            rigid_right[:, shared.row[entry]] -= values[:, entry] * offset[:, column[entry]]
        asked = balance._replace(values=rigid_values, right=rigid_right)
        x, y, _, _, status = self.solved(asked, place.start)
        x = np.nan_to_num(x, posinf=0.0, neginf=0.0)
        y = np.nan_to_num(y, posinf=0.0, neginf=0.0)
        forces = np.where(term.elastic, ratio * x[:, :muscles] + offset, np.nan)
        penalties = self.penalties[place]
        return windows.Frames(
            time, values, right, penalties, lengths, speeds, x, y, forces
        ), np.where(status == MISSING, MISSING, OPTIMAL)

    def _missed(self, frames: windows.Frames, x: Array) -> tuple[Array, Array]:
        """Greatest torque that is not balanced in each frame, and the scale it is judged by."""
        shared = self.separable
        held = x.copy()
        elastic = np.flatnonzero(self.muscles.elastic)
        held[:, elastic] = frames.forces[:, elastic]
        left = frames.right.copy()
        for entry, (row, unknown) in enumerate(zip(shared.row, shared.column, strict=True)):
            left[:, row] -= frames.values[:, entry] * held[:, unknown]
        return np.abs(left).max(axis=1), 1.0 + np.abs(frames.right).max(axis=1)

    def _mark(self, first: int, last: int) -> None:
        """Mark frames near a beginning or an end of what could be solved in one go, unless a window
        only ends there.
        """
        time = self._time
        known = np.asarray(np.isfinite(self.lengths).all(axis=1))
        if first == 0 or not known[first - 1] or np.isnan(self._torques[first - 1]).any():
            self._transient[first:last] |= time[first:last] < time[first] + TRANSIENT
        if last == len(time) or not known[last] or np.isnan(self._torques[last]).any():
            self._transient[first:last] |= time[first:last] > time[last - 1] - TRANSIENT

    def result(self) -> Tension:
        """What was found, as a value, with its fibers."""
        tension = super().result()
        paths = (self.lengths, self.speeds, self._tendon_forces, tension.forces)
        all_names = self.assembly.tree.model.muscle_names
        rigid = tuple(
            name for name, item in zip(all_names, self.muscles.elastic, strict=True) if not item
        )
        seconds = np.array([outcome.far for outcome in self._outcomes]).reshape(-1, 2)
        certificate = Certificate(
            max((outcome.residual for outcome in self._outcomes), default=0.0),
            max((outcome.equilibrium for outcome in self._outcomes), default=0.0),
            max((outcome.steps for outcome in self._outcomes), default=0),
            *(
                float(np.sqrt(np.mean(seconds[:, index] ** 2))) if len(seconds) else np.nan
                for index in range(2)
            ),
        )
        kept = (self._transient, self._bridged, rigid, self.unreachable, certificate)
        return replace(tension, fibers=Fibers(*fibers_at(self.muscles, self._time, *paths), *kept))


def _at_once(tasks: Sequence[Callable[[], Solved]], threads: bool) -> list[Solved]:
    """Results of tasks, in threads where no windows already are."""
    workers = min(thread_count(), len(tasks)) if threads else 1
    if workers <= 1:
        return [task() for task in tasks]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(lambda task: task(), tasks))
