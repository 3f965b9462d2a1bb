"""One window of frames: gaps bridged, a start on rigid tendons, the programs of its parts, and what
they found.

Parts of the problem that share nothing are solved apart. Of fast recordings some of the frames are
solved, and those between follow them and balance their own torques: a step of 1 ms is far shorter
than a tendon takes to answer, so equilibrium hardly says anything about the force at its end, the
system is stiff and the solver does not end. What muscles do has no part that 200 frames a second
miss.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array
from myomorph.core.model.arrays import runs as unbroken
from myomorph.core.muscles.fiber_jets import tendon_jet
from myomorph.core.muscles.hill import (
    activation_times,
    compile_elastic,
    fill_hill_forces,
    has_elastic_tendon,
    muscle_models,
)
from myomorph.core.rigid.kernels import kernel
from myomorph.core.rigid.tree import Tree
from myomorph.core.tension.elastic.interior import Outcome, Solver
from myomorph.core.tension.elastic.program import (
    MAX_FORCE,
    MIN_FORCE,
    Costs,
    Point,
    Program,
    Rates,
    integrated,
    possible,
)
from myomorph.core.tension.separable import Links, Separable
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.muscles import MuscleForces, MuscleTerm
from myomorph.core.tension.terms.term import Frames as TermFrames


class ElasticMuscleTerm(MuscleTerm):
    """A muscle's column is that of its maximum isometric force, by which tendon forces are
    normalized. `arrays`: curves of fibers and tendons; `elastic` (muscles,) which muscles have an
    elastic tendon; a muscle whose fibers cannot reach is taken off.
    """

    def __init__(self, tree: Tree, options: TensionOptions):
        super().__init__(tree, options)
        muscles = tree.model.muscles
        self.arrays = compile_elastic(tree.model, options.passive)
        self.elastic = np.array([has_elastic_tendon(muscle) for muscle in muscles], np.bool_) & (
            self.upper > 0.0
        )
        rise, fall = activation_times(tree.model)
        self.rates = Rates(
            rise, fall, np.array([kind.smooth for kind in muscle_models(tree.model)], np.bool_)
        )

    def paths_of(self, coordinates: Array, rates: Array) -> tuple[Array, Array]:
        """Lengths and lengthening velocities (frames, muscles) of the paths [m], [m/s]."""
        lengths, speeds, _ = self._paths.evaluate(coordinates, rates)
        return lengths, speeds

    def rigid_forces(self, lengths: Array, speeds: Array) -> tuple[Array, Array]:
        """Active force per unit activation and passive force (frames, muscles) on rigid tendons
        [N].
        """
        active = np.empty_like(lengths)
        passive = np.empty_like(lengths)
        fill_hill_forces(self.arrays.hill, lengths, speeds, self._options.passive, active, passive)
        return active * self._enabled, passive * self._enabled

    def _forces(self, frames: TermFrames) -> MuscleForces:
        lengths, speeds, arms = self._paths.evaluate(frames.coordinates, frames.rates)
        active, passive = self.rigid_forces(lengths, speeds)
        active[:, self.elastic] = np.where(np.isnan(lengths), np.nan, self.strength)[
            :, self.elastic
        ]
        passive[:, self.elastic] = 0.0
        return MuscleForces(
            arms=arms, active=active, passive=passive, viscous=self._viscosity * speeds
        )


@kernel(counted=False)
def _stretches(E, elastic, f, out):
    """Tendon length over slack length (frames, muscles) at normalized forces f, 1 of a rigid
    tendon.
    """
    for m in range(f.shape[1]):
        for index in range(f.shape[0]):
            out[index, m] = 1.0
            if elastic[m]:
                out[index, m] = (
                    tendon_jet(E, m, f[index, m])[0] if f[index, m] == f[index, m] else np.nan
                )


def fibers_at(
    term: ElasticMuscleTerm, time: Array, lengths: Array, speeds: Array, f: Array, forces: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Lengths and velocities of fibers, strains of tendons, powers of fibers and of tendons: fields
    of `Fibers`. A tendon's speed at a frame is the mean of those before and after it. `lengths`,
    `speeds` (frames, muscles) of the paths [m], [m/s]; `f` (frames, muscles) normalized tendon
    forces, not read of rigid tendons; `forces` (frames, muscles) [N].
    """
    H = term.arrays.hill
    stretch = np.empty_like(f)
    _stretches(term.arrays, term.elastic, f, stretch)
    stretch = np.where(np.isnan(forces), np.nan, stretch)
    tendon = stretch * H.tendon
    speed = np.zeros_like(tendon)
    if len(time) > 1:
        each = np.diff(tendon, axis=0) / np.diff(time)[:, None]
        ends = np.full((1, each.shape[1]), np.nan)
        both = np.stack([np.concatenate([ends, each]), np.concatenate([each, ends])])
        known = np.isfinite(both)
        count = known.sum(axis=0)
        speed = np.where(
            count > 0, np.where(known, both, 0.0).sum(axis=0) / np.maximum(count, 1), 0.0
        )
    along = lengths - tendon
    fiber = np.sqrt(along**2 + H.height**2)
    velocity = (speeds - speed) * along / fiber
    of_path = -forces * speeds
    of_tendon = -forces * speed
    return fiber, velocity, stretch - 1.0, of_path - of_tendon, of_tendon


class Part(NamedTuple):
    """Unknowns and rows of one part, in ascending order."""

    muscles: NDArray[np.int64]  # those on elastic tendons
    others: NDArray[np.int64]  # all other unknowns
    rows: NDArray[np.int64]  # of the balance, in the order of elimination


def parts_of(separable: Separable, elastic: NDArray[np.bool_]) -> list[Part]:
    """The parts with a muscle on an elastic tendon, the largest first; `elastic` (muscles,) of
    first unknowns.
    """
    unknowns = len(separable.weight)
    rows = len(separable.first)
    column = separable.column
    places = column, unknowns + separable.row
    links = scipy.sparse.coo_array((np.ones(len(column)), places), shape=(unknowns + rows,) * 2)
    count, label = scipy.sparse.csgraph.connected_components(links, directed=False)
    stretches = np.zeros(unknowns, np.bool_)
    stretches[: len(elastic)] = elastic
    result = [
        Part(
            np.flatnonzero(stretches & (label[:unknowns] == index)),
            np.flatnonzero(~stretches & (label[:unknowns] == index)),
            np.flatnonzero(label[unknowns:] == index),
        )
        for index in range(count)
    ]
    return sorted((one for one in result if len(one.muscles)), key=lambda one: -len(one.muscles))


SECOND_START = 0.3  # Activation of all muscles at all times in a second start


@dataclass(eq=False)
class Frames:
    """What a window's programs are made of, without gaps."""

    time: Array  # (frames,) [s]
    # values, right: (frames, entries) of A with tendon forces' columns, (frames, rows)
    values: Array
    right: Array
    penalties: Array  # (1 or frames, 3, unknowns)
    lengths: Array  # (frames, muscles) of the paths [m]
    speeds: Array  # (frames, muscles) of the paths [m/s]
    x: Array  # (frames, unknowns) solution with rigid tendons
    y: Array  # (frames, rows) solution with rigid tendons
    forces: Array  # (frames, muscles) normalized tendon forces of that

    def at(self, keep: NDArray[np.int64]) -> Frames:
        """Some of the frames."""
        parts = {part.name: getattr(self, part.name) for part in fields(self)}
        return Frames(
            **{
                name: part[keep] if len(part) == len(self.time) else part
                for name, part in parts.items()
            }
        )


def runs(good: NDArray[np.bool_], bridge: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Ranges of frames that begin and end with a good one, the gaps inside them bridged."""
    results = []
    for start, stop in unbroken(good | bridge):
        known = start + np.flatnonzero(good[start:stop])
        if len(known):
            results.append((int(known[0]), int(known[-1]) + 1))
    return results


def filled(time: Array, values: Array, good: NDArray[np.bool_]) -> Array:
    """Rows of values (frames, ...) that are not good, by a straight line from those that are."""
    if good.all():
        return values
    known = np.flatnonzero(good)
    after = np.clip(np.searchsorted(known, np.arange(len(good))), 1, max(len(known) - 1, 1))
    one = known[after - 1]
    other = known[np.minimum(after, len(known) - 1)]
    share = np.where(
        other > one, (time - time[one]) / np.maximum(time[other] - time[one], 1e-12), 0.0
    )
    share = share.reshape(-1, *([1] * (values.ndim - 1)))
    return np.where(
        good.reshape(share.shape), values, (1.0 - share) * values[one] + share * values[other]
    )


def between(frames: Frames) -> tuple[Array, Array, Array]:
    """Times between frames [s], and lengths and velocities of the paths there, by cubics through
    both frames.
    """
    steps = np.diff(frames.time)
    dt = steps[:, None]
    L = frames.lengths
    V = frames.speeds
    lengths = 0.5 * (L[1:] + L[:-1]) + 0.125 * dt * (V[:-1] - V[1:])
    return steps, lengths, 1.5 * np.diff(L, axis=0) / dt - 0.25 * (V[1:] + V[:-1])


def _penalties_between(penalties: Array, frames: int) -> Array:
    """Interval penalties (3, frames - 1, unknowns) of activations between frames from those at the
    frames.
    """
    all_ = np.broadcast_to(penalties, (frames, *penalties.shape[1:]))
    low, high, pull = np.moveaxis(all_, 1, 0)
    share = np.stack([pull[:-1] > 0.0, pull[1:] > 0.0]).astype(np.float64)
    count = np.maximum(share.sum(axis=0), 1.0)
    ends = (np.where(pull > 0.0, values, 0.0) for values in (low, high, pull))
    mean = [(share[0] * end[:-1] + share[1] * end[1:]) / count for end in ends]
    # Where one frame alone knows of the activation, it counts half.
    return np.stack([*mean[:2], mean[2] * count / 2.0])


def drawn(penalties: Array, links: Links, x: Array, shared: Separable) -> Array:
    """Interval penalties (frames, 3, unknowns) with those that draw linked unknowns to the amounts
    of frames beside. `penalties` (1 or frames, 3, unknowns) without; `x` (frames, unknowns) whose
    amounts the frames beside have.
    """
    result = np.array(np.broadcast_to(penalties, (len(x), *penalties.shape[1:])))
    place = slice(links.first, links.first + links.scale.shape[1])
    pull = np.zeros_like(links.scale)
    total = np.zeros_like(links.scale)
    stiff = links.stiffness[:, None] * shared.weight[place]
    amount = links.scale * x[:, place]
    touches = links.scale > 0.0
    both = touches[1:] & touches[:-1]
    for here, beside in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
        pull[here] += stiff * both
        total[here] += stiff * both * amount[beside]
    linked = pull > 0.0
    middle = total / np.where(linked, pull * links.scale, 1.0)
    result[:, 0, place] = np.where(linked, middle, result[:, 0, place])
    result[:, 1, place] = np.where(linked, middle, result[:, 1, place])
    result[:, 2, place] = np.where(linked, pull * links.scale**2, result[:, 2, place])
    return result


def program_of(
    part: Part, frames: Frames, shared: Separable, term: ElasticMuscleTerm, dynamics: bool
) -> Program:
    """The program of one part over the frames."""
    count = len(frames.time)
    steps, lengths, speeds = between(frames)
    mean = float(steps.mean())
    share = steps[:, None] / mean
    share_x = 0.5 * (
        np.concatenate([share[:1] * 0.0, share]) + np.concatenate([share, share[:1] * 0.0])
    )
    column = shared.column
    rank = np.full(len(shared.first), -1)
    rank[part.rows] = np.arange(len(part.rows))

    def dense(unknowns: NDArray[np.int64]) -> Array:
        place = np.full(len(shared.weight), -1)
        place[unknowns] = np.arange(len(unknowns))
        mine = np.flatnonzero(place[column] >= 0)
        result = np.zeros((count, len(part.rows), len(unknowns)))
        result[:, rank[shared.row[mine]], place[column[mine]]] = frames.values[:, mine]
        return result

    def costs(unknowns: NDArray[np.int64], penalty: Array, weight: Array) -> Costs:
        lower = shared.lower[unknowns]
        upper = shared.upper[unknowns]
        held = np.ascontiguousarray(np.where(penalty[2] > 0.0, penalty, 0.0)[:, :, unknowns])
        return Costs(
            weight=shared.weight[unknowns],
            exponent=shared.exponent[unknowns],
            lower=lower,
            upper=upper,
            penalty=held,
            share=weight,
        )

    at_frames = np.moveaxis(
        np.broadcast_to(frames.penalties, (count, *frames.penalties.shape[1:])), 1, 0
    )
    m = part.muscles
    times = term.rates
    return Program(
        arrays=term.arrays,
        own=m,
        steps=steps,
        lengths=np.ascontiguousarray(lengths[:, m]),
        speeds=np.ascontiguousarray(speeds[:, m]),
        pulls=dense(m),
        columns=dense(part.others),
        right=np.ascontiguousarray(frames.right[:, part.rows]),
        activation=costs(m, _penalties_between(frames.penalties, count), share),
        other=costs(part.others, at_frames, share_x),
        rates=Rates(times.rise[m], times.fall[m], times.smooth[m]) if dynamics else None,
    )


def start_of(part: Part, frames: Frames, program: Program) -> tuple[Point, Array]:
    """A start near the solution with rigid tendons, and its multipliers.
    Its activations, as far as their rates are possible, and the forces that muscles on elastic
    tendons have with these: forces on rigid tendons may jump, and elastic tendons could then not be
    in equilibrium.
    """
    a = frames.x[:, part.muscles]
    a = possible(program, 0.5 * (a[1:] + a[:-1]))
    point = Point(integrated(program, a), a, frames.x[:, part.others])
    return point, frames.y[:, part.rows] * program.other.share


def solve_part(program: Program, start: Point, y: Array, again: bool) -> tuple[Point, Outcome]:
    """The solution, or that from another start where this alone is solved; `again`: whether there
    is another start.
    """
    point, outcome = Solver(program, start, y).solve()
    if not again:
        return point, outcome
    flat = np.full_like(start.a, SECOND_START)
    other, second = Solver(
        program, replace(start, f=integrated(program, flat), a=flat), np.zeros_like(y)
    ).solve()
    activations = float(np.sqrt(np.mean((other.a - point.a) ** 2)))
    forces = float(np.sqrt(np.mean((other.f - point.f) ** 2)))
    point, outcome = (other, second) if second.solved and not outcome.solved else (point, outcome)
    return point, outcome._replace(far=(activations, forces))


FASTEST = 200.0  # Frames a second that are solved at most
PROJECTIONS = 3  # Steps towards balance; more than one only where a force meets its bound


def solved_every(time: Array) -> int:
    """How many frames apart those are that are solved; 1 where frames come no faster than
    `FASTEST`.
    """
    if len(time) < 3:
        return 1
    return max(1, int(np.ceil(1.0 / (FASTEST * float(np.median(np.diff(time)))) - 1e-3)))


def picked(frames: int, every: int) -> NDArray[np.int64]:
    """Numbers of the frames that are solved: the first, the last, and evenly between them at most
    `every` apart.
    """
    count = int(np.ceil((frames - 1) / every)) + 1
    return np.unique(np.round(np.linspace(0, frames - 1, count)).astype(np.int64))


def along(time: Array, known: NDArray[np.int64], values: Array) -> Array:
    """Values (frames, ...) at all times from those at some, by cubics that leave their range
    nowhere.
    """
    if len(known) < 2:
        return np.repeat(values, len(time), axis=0)
    return np.asarray(scipy.interpolate.PchipInterpolator(time[known], values, axis=0)(time))


def balanced(
    shared: Separable, values: Array, right: Array, held: Array, muscles: NDArray[np.bool_]
) -> Array:
    """Unknowns near `held` that balance the torques.
    The change is the least relative to what a muscle pulls with and to what the cost lets other
    unknowns have. `values`, `right` (frames, entries) and (frames, rows) of the balance; `held`
    (frames, unknowns) with normalized forces in the columns of muscles on elastic tendons;
    `muscles` (unknowns,) which columns those are.
    """
    low = np.where(muscles, MIN_FORCE, shared.lower)
    high = np.where(muscles, MAX_FORCE, shared.upper)
    A = shared.dense(values)
    result = held.copy()
    for _ in range(PROJECTIONS):
        left = right - np.matmul(A, result[:, :, None])[..., 0]
        room = np.where(muscles, result - MIN_FORCE, 1.0 / np.maximum(shared.weight, 1e-3))
        room = np.where((result > low) & (result < high), room, 0.0)
        scaled = A * room[:, None]
        matrix = np.matmul(scaled, A.transpose(0, 2, 1))
        size = np.trace(matrix, axis1=1, axis2=2)[:, None, None] / max(right.shape[1], 1)
        matrix += (1e-9 * size + 1e-12) * np.eye(right.shape[1])
        change = np.matmul(np.linalg.solve(matrix, left[:, :, None])[:, None, :, 0], scaled)[:, 0]
        result = np.clip(result + change, low, high)
    return result
