"""One window of frames: gaps bridged, a start on rigid tendons, programs of its parts, and fibers.

Parts of the problem that share nothing are solved apart. Of fast recordings some of the frames are
solved, and those between follow them and balance their own torques: a step of 1 ms is far shorter
than a tendon takes to answer, so equilibrium hardly says anything about the force at its end, the
system is stiff and the solver does not end. What muscles do has no part that 200 frames a second
miss.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
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
    has_elastic_tendon,
    muscle_models,
    rigid_tendon_forces,
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
from myomorph.core.tension.separable import FrameLinks, Separable
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.muscles import MuscleForces, MuscleTerm
from myomorph.core.tension.terms.term import Frames as TermFrames

SECOND_START = 0.3
"""Activation of all muscles at all times in a second start."""
MAX_RATE = 200.0
"""Frames per second that are solved at most [Hz]."""
MAX_PROJECTIONS = 3
"""Steps towards balance; more than one only where a force meets its bound."""


class ElasticMuscleTerm(MuscleTerm):
    """Muscles on elastic tendons as a term: a column is that of the maximum isometric force.

    By that force tendon forces are normalized.

    Attributes
    ----------
    arrays : curves of fibers and tendons
    elastic : (muscles,) which muscles have an elastic tendon; a muscle whose fibers cannot reach is
        taken off
    """

    def __init__(self, tree: Tree, options: TensionOptions):
        super().__init__(tree, options)
        muscles = tree.model.muscles
        self.arrays = compile_elastic(tree.model, options.passive_on_elastic)
        have_tendons = np.array([has_elastic_tendon(muscle) for muscle in muscles], np.bool_)
        self.elastic = have_tendons & (self.upper > 0.0)
        kinds = muscle_models(tree.model)
        self._passive_curves = [
            kind.smooth_curves(muscle).passive for kind, muscle in zip(kinds, muscles, strict=True)
        ]
        rise, fall = activation_times(tree.model)
        smooth = np.array([kind.smooth for kind in kinds], np.bool_)
        self.rates = Rates(rise=rise, fall=fall, smooth=smooth)

    def paths_of(self, coordinates: Array, rates: Array) -> tuple[Array, Array]:
        """Lengths and lengthening velocities of the paths.

        Parameters
        ----------
        coordinates, rates : (frames, coordinates) [rad or m], [rad/s or m/s]

        Returns
        -------
        (frames, muscles) [m] and [m/s]
        """
        lengths, speeds, _ = self._paths.evaluate(coordinates, rates)
        return lengths, speeds

    def rigid_forces(self, lengths: Array, speeds: Array) -> tuple[Array, Array]:
        """Active force per unit activation and passive force on rigid tendons.

        Parameters
        ----------
        lengths, speeds : (frames, muscles) of the paths [m], [m/s]

        Returns
        -------
        (frames, muscles) [N] both
        """
        active, passive = rigid_tendon_forces(
            self.arrays.hill, lengths, speeds, self._options.passive_on_rigid
        )
        return active * self._enabled, passive * self._enabled

    def fiber_passive(self, fibers: Array) -> Array:
        """Passive force of the fibers of muscles on elastic tendons, along the tendon.

        F_PE = F0 f_PE(l) cos(alpha) with the normalized fiber length l, as OpenSim's muscles count
        it; the curve is that of the fibers' equilibrium.

        Parameters
        ----------
        fibers : (frames, muscles) lengths [m]

        Returns
        -------
        (frames, muscles) [N], 0 of muscles on rigid tendons
        """
        H = self.arrays.hill
        result = np.zeros_like(fibers)
        for m in np.flatnonzero(self.elastic):
            length = fibers[:, m]
            cosine = np.sqrt(np.maximum(1.0 - (H.height[m] / length) ** 2, 0.0))
            f_pe = np.maximum(self._passive_curves[m](length / H.fiber[m]), 0.0)
            result[:, m] = H.force[m] * f_pe * cosine
        return result

    def _forces(self, frames: TermFrames) -> MuscleForces:
        """Moment arms and forces, of a unit of normalized tendon force where elastic."""
        lengths, speeds, arms = self._paths.evaluate(frames.coordinates, frames.rates)
        active, passive = self.rigid_forces(lengths, speeds)
        strength = np.where(np.isnan(lengths), np.nan, self.strength)
        active[:, self.elastic] = strength[:, self.elastic]
        passive[:, self.elastic] = 0.0
        return MuscleForces(
            arms=arms, active=active, passive=passive, viscous=self._viscosity * speeds
        )


@kernel(counted=False)
def _stretches(E, elastic, f, out):
    """Fill tendon lengths over slack lengths at normalized forces, 1 of a rigid tendon.

    Parameters
    ----------
    E : `ElasticArrays`
    elastic : (muscles,)
    f : (frames, muscles)
    out : (frames, muscles) filled
    """
    for m in range(f.shape[1]):
        for index in range(f.shape[0]):
            out[index, m] = 1.0
            if elastic[m]:
                out[index, m] = (
                    tendon_jet(E, m, f[index, m])[0] if f[index, m] == f[index, m] else np.nan
                )


@dataclass(frozen=True, eq=False)
class Paths:
    """Paths of muscles and forces in some frames, (frames, muscles) each.

    Attributes
    ----------
    lengths, speeds : of the paths [m], [m/s]
    normalized : tendon forces over maximum isometric forces, not read of rigid tendons
    forces : [N]
    """

    lengths: Array
    speeds: Array
    normalized: Array
    forces: Array


class FiberMotion(NamedTuple):
    """Fibers and tendons, (frames, muscles) each: fields of `Fibers`."""

    lengths: Array
    velocities: Array
    tendon_strains: Array
    fiber_powers: Array
    tendon_powers: Array


def fibers_at(term: ElasticMuscleTerm, time: Array, paths: Paths) -> FiberMotion:
    """Lengths and velocities of fibers, strains of tendons, powers of fibers and of tendons.

    A tendon's speed at a frame is the mean of those before and after it.

    Parameters
    ----------
    term : the muscles on elastic tendons
    time : (frames,) [s]
    paths : of the muscles, and their forces

    Returns
    -------
    (frames, muscles) each, NaN where forces are
    """
    H = term.arrays.hill
    stretch = np.empty_like(paths.normalized)
    _stretches(term.arrays, term.elastic, paths.normalized, stretch)
    stretch = np.where(np.isnan(paths.forces), np.nan, stretch)
    tendon = stretch * H.tendon
    tendon_speed = _speeds(time, tendon)
    along = paths.lengths - tendon
    fiber = np.sqrt(along**2 + H.height**2)
    of_path = -paths.forces * paths.speeds
    of_tendon = -paths.forces * tendon_speed
    return FiberMotion(
        lengths=fiber,
        velocities=(paths.speeds - tendon_speed) * along / fiber,
        tendon_strains=stretch - 1.0,
        fiber_powers=of_path - of_tendon,
        tendon_powers=of_tendon,
    )


def _speeds(time: Array, lengths: Array) -> Array:
    """Speeds at frames, the mean of those before and after them; 0 where neither is known.

    Parameters
    ----------
    time : (frames,) [s]
    lengths : (frames, muscles) [m]

    Returns
    -------
    (frames, muscles) [m/s]
    """
    if len(time) < 2:
        return np.zeros_like(lengths)
    between_frames = np.diff(lengths, axis=0) / np.diff(time)[:, None]
    none = np.full((1, lengths.shape[1]), np.nan)
    before = np.concatenate([none, between_frames])
    after = np.concatenate([between_frames, none])
    both = np.stack([before, after])
    known = np.isfinite(both)
    count = known.sum(axis=0)
    total = np.where(known, both, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), 0.0)


class Part(NamedTuple):
    """Unknowns and rows of one part, in ascending order.

    Attributes
    ----------
    muscles : those on elastic tendons
    others : all other unknowns
    rows : of the balance, in the order of elimination
    """

    muscles: NDArray[np.int64]
    others: NDArray[np.int64]
    rows: NDArray[np.int64]


def parts_of(separable: Separable, elastic: NDArray[np.bool_]) -> list[Part]:
    """Parts with a muscle on an elastic tendon, the largest first.

    Parameters
    ----------
    separable : pattern and data that all frames share
    elastic : (muscles,) of the first unknowns

    Returns
    -------
    parts that share neither an unknown nor a row
    """
    unknowns = len(separable.weight)
    rows = len(separable.first)
    column = separable.column
    places = (column, unknowns + separable.row)
    links = scipy.sparse.coo_array((np.ones(len(column)), places), shape=(unknowns + rows,) * 2)
    count, label = scipy.sparse.csgraph.connected_components(links, directed=False)
    stretches = np.zeros(unknowns, np.bool_)
    stretches[: len(elastic)] = elastic
    parts = []
    for index in range(count):
        of_part = label == index
        parts.append(
            Part(
                muscles=np.flatnonzero(stretches & of_part[:unknowns]),
                others=np.flatnonzero(~stretches & of_part[:unknowns]),
                rows=np.flatnonzero(of_part[unknowns:]),
            )
        )
    with_muscles = [part for part in parts if len(part.muscles)]
    return sorted(with_muscles, key=lambda part: -len(part.muscles))


@dataclass(eq=False)
class Frames:
    """What a window's programs are made of, without gaps.

    Attributes
    ----------
    time : (frames,) [s]
    values : (frames, entries) of A with tendon forces' columns
    right : (frames, rows)
    penalties : (1 or frames, 3, unknowns)
    lengths, speeds : (frames, muscles) of the paths [m], [m/s]
    x, y : (frames, unknowns) and (frames, rows) solution with rigid tendons
    forces : (frames, muscles) normalized tendon forces of that
    """

    time: Array
    values: Array
    right: Array
    penalties: Array
    lengths: Array
    speeds: Array
    x: Array
    y: Array
    forces: Array

    def at(self, keep: NDArray[np.int64]) -> Frames:
        """Choose some of the frames.

        Parameters
        ----------
        keep : (chosen,) their numbers

        Returns
        -------
        the chosen ones
        """
        of_frames = len(self.penalties) == len(self.time)
        return Frames(
            time=self.time[keep],
            values=self.values[keep],
            right=self.right[keep],
            penalties=self.penalties[keep] if of_frames else self.penalties,
            lengths=self.lengths[keep],
            speeds=self.speeds[keep],
            x=self.x[keep],
            y=self.y[keep],
            forces=self.forces[keep],
        )


def runs(good: NDArray[np.bool_], bridge: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Ranges of frames that begin and end with a good one, the gaps inside them bridged.

    Parameters
    ----------
    good, bridge : (frames,) which are known, and which lie in gaps that are bridged

    Returns
    -------
    first frame and the one after the last, of each range
    """
    results = []
    for start, stop in unbroken(good | bridge):
        known = start + np.flatnonzero(good[start:stop])
        if len(known):
            results.append((int(known[0]), int(known[-1]) + 1))
    return results


def filled(time: Array, values: Array, good: NDArray[np.bool_]) -> Array:
    """Fill rows that are not good by a straight line from those that are.

    Parameters
    ----------
    time : (frames,) [s]
    values : (frames, ...)
    good : (frames,)

    Returns
    -------
    (frames, ...)
    """
    if good.all():
        return values
    known = np.flatnonzero(good)
    place = np.clip(np.searchsorted(known, np.arange(len(good))), 1, max(len(known) - 1, 1))
    before = known[place - 1]
    after = known[np.minimum(place, len(known) - 1)]
    duration = np.maximum(time[after] - time[before], 1e-12)
    share = np.where(after > before, (time - time[before]) / duration, 0.0)
    share = share.reshape(-1, *([1] * (values.ndim - 1)))
    line = (1.0 - share) * values[before] + share * values[after]
    return np.where(good.reshape(share.shape), values, line)


class Between(NamedTuple):
    """Paths between frames.

    Attributes
    ----------
    steps : (frames - 1,) times between frames [s]
    lengths, speeds : (frames - 1, muscles) [m], [m/s]
    """

    steps: Array
    lengths: Array
    speeds: Array


def between(frames: Frames) -> Between:
    """Lengths and velocities of paths between frames, by cubics through both frames."""
    steps = np.diff(frames.time)
    dt = steps[:, None]
    L = frames.lengths
    V = frames.speeds
    return Between(
        steps=steps,
        lengths=0.5 * (L[1:] + L[:-1]) + 0.125 * dt * (V[:-1] - V[1:]),
        speeds=1.5 * np.diff(L, axis=0) / dt - 0.25 * (V[1:] + V[:-1]),
    )


def _penalties_between(penalties: Array, frames: int) -> Array:
    """Interval penalties of activations between frames from those at the frames.

    Parameters
    ----------
    penalties : (1 or frames, 3, unknowns) at the frames
    frames : number of frames

    Returns
    -------
    (3, frames - 1, unknowns)
    """
    of_frames = np.broadcast_to(penalties, (frames, *penalties.shape[1:]))
    low, high, pull = np.moveaxis(of_frames, 1, 0)
    acts = (pull > 0.0).astype(np.float64)
    count = np.maximum(np.stack([acts[:-1], acts[1:]]).sum(axis=0), 1.0)

    def mean(values: Array) -> Array:
        acting = np.where(pull > 0.0, values, 0.0)
        return (acts[:-1] * acting[:-1] + acts[1:] * acting[1:]) / count

    # Where one frame alone knows of the activation, it counts half.
    return np.stack([mean(low), mean(high), mean(pull) * count / 2.0])


def drawn(penalties: Array, links: FrameLinks, x: Array, shared: Separable) -> Array:
    """Interval penalties with those that draw linked unknowns to the amounts of other frames.

    Of an unknown with amounts a_n in the frames n beside it, these are as of `dual._drawn`.

    Parameters
    ----------
    penalties : (1 or frames, 3, unknowns) without
    links : between frames
    x : (frames, unknowns) whose amounts the frames beside have
    shared : pattern and data that all frames share

    Returns
    -------
    (frames, 3, unknowns)
    """
    result = np.array(np.broadcast_to(penalties, (len(x), *penalties.shape[1:])))
    place = slice(links.first, links.first + links.scale.shape[1])
    pull = np.zeros_like(links.scale)
    total = np.zeros_like(links.scale)
    stiffness = links.stiffness[:, None] * shared.weight[place]
    amount = links.scale * x[:, place]
    touches = links.scale > 0.0
    both = touches[1:] & touches[:-1]
    first = slice(None, -1)
    second = slice(1, None)
    for here, neighbour in ((second, first), (first, second)):
        pull[here] += stiffness * both
        total[here] += stiffness * both * amount[neighbour]
    linked = pull > 0.0
    middle = total / np.where(linked, pull * links.scale, 1.0)
    result[:, 0, place] = np.where(linked, middle, result[:, 0, place])
    result[:, 1, place] = np.where(linked, middle, result[:, 1, place])
    result[:, 2, place] = np.where(linked, pull * links.scale**2, result[:, 2, place])
    return result


def program_of(
    part: Part, frames: Frames, shared: Separable, term: ElasticMuscleTerm, dynamics: bool
) -> Program:
    """Make the program of one part over the frames.

    Parameters
    ----------
    part : its unknowns and rows
    frames : of a run, without gaps
    shared : pattern and data that all frames share
    term : the muscles on elastic tendons
    dynamics : whether activation changes no faster than excitations let it
    """
    count = len(frames.time)
    paths = between(frames)
    # Shares of time that intervals between frames stand for, and frames: half of both beside them.
    share = paths.steps[:, None] / float(paths.steps.mean())
    none = share[:1] * 0.0
    share_of_frames = 0.5 * (np.concatenate([none, share]) + np.concatenate([share, none]))
    penalties = np.broadcast_to(frames.penalties, (count, *frames.penalties.shape[1:]))
    m = part.muscles
    rates = None
    if dynamics:
        times = term.rates
        rates = Rates(rise=times.rise[m], fall=times.fall[m], smooth=times.smooth[m])
    return Program(
        arrays=term.arrays,
        own=m,
        steps=paths.steps,
        lengths=np.ascontiguousarray(paths.lengths[:, m]),
        speeds=np.ascontiguousarray(paths.speeds[:, m]),
        pulls=_columns(part, frames, shared, m),
        columns=_columns(part, frames, shared, part.others),
        right=np.ascontiguousarray(frames.right[:, part.rows]),
        activation=_costs(shared, m, _penalties_between(frames.penalties, count), share),
        other=_costs(shared, part.others, np.moveaxis(penalties, 1, 0), share_of_frames),
        rates=rates,
    )


def _columns(part: Part, frames: Frames, shared: Separable, unknowns: NDArray[np.int64]) -> Array:
    """Columns (frames, rows of the part, unknowns) of A."""
    rank = np.full(len(shared.first), -1)
    rank[part.rows] = np.arange(len(part.rows))
    place = np.full(len(shared.weight), -1)
    place[unknowns] = np.arange(len(unknowns))
    column = shared.column
    entries = np.flatnonzero(place[column] >= 0)
    result = np.zeros((len(frames.time), len(part.rows), len(unknowns)))
    result[:, rank[shared.row[entries]], place[column[entries]]] = frames.values[:, entries]
    return result


def _costs(shared: Separable, unknowns: NDArray[np.int64], penalties: Array, share: Array) -> Costs:
    """Costs and bounds of some unknowns.

    Parameters
    ----------
    penalties : (3, rows, all unknowns)
    share : (rows, 1) part of the time that a row stands for
    """
    acting = np.where(penalties[2] > 0.0, penalties, 0.0)
    return Costs(
        weight=shared.weight[unknowns],
        exponent=shared.exponent[unknowns],
        lower=shared.lower[unknowns],
        upper=shared.upper[unknowns],
        penalty=np.ascontiguousarray(acting[:, :, unknowns]),
        share=share,
    )


def start_of(part: Part, frames: Frames, program: Program) -> tuple[Point, Array]:
    """Make a start near the solution with rigid tendons, and its multipliers.

    It has the activations of that solution, as far as their rates are possible, and the forces that
    muscles on elastic tendons have with these: forces on rigid tendons may jump, and elastic
    tendons could then not be in equilibrium.

    Parameters
    ----------
    part : its unknowns and rows
    frames : with the solution on rigid tendons
    program : the problem of a part

    Returns
    -------
    the point, and (frames, rows) multipliers of the balance
    """
    at_frames = frames.x[:, part.muscles]
    a = possible(program, 0.5 * (at_frames[1:] + at_frames[:-1]))
    point = Point(f=integrated(program, a), a=a, x=frames.x[:, part.others])
    return point, frames.y[:, part.rows] * program.other.share


def solve_part(
    program: Program, start: Point, y: Array, second_start: bool
) -> tuple[Point, Outcome]:
    """Solve a program, and again from another start where that is asked for.

    The second solution is returned where it alone is solved.

    Parameters
    ----------
    program : the problem of a part
    start : where the solver begins
    y : (frames, rows) multipliers of the balance to begin with
    second_start : whether another start is tried too

    Returns
    -------
    the solution, and how far it is from an optimum and from the other solution
    """
    point, outcome = Solver(program, start, y).solve()
    if not second_start:
        return point, outcome
    flat = np.full_like(start.a, SECOND_START)
    again = replace(start, f=integrated(program, flat), a=flat)
    other, second = Solver(program, again, np.zeros_like(y)).solve()
    activations = float(np.sqrt(np.mean((other.a - point.a) ** 2)))
    forces = float(np.sqrt(np.mean((other.f - point.f) ** 2)))
    far = (activations, forces)
    if second.solved and not outcome.solved:
        return other, second._replace(far=far)
    return point, outcome._replace(far=far)


def solved_every(time: Array) -> int:
    """Distance of the frames that are solved; 1 where they come no faster than `MAX_RATE`.

    Parameters
    ----------
    time : (frames,) [s]

    Returns
    -------
    number of frames
    """
    if len(time) < 3:
        return 1
    return max(1, int(np.ceil(1.0 / (MAX_RATE * float(np.median(np.diff(time)))) - 1e-3)))


def picked(frames: int, every: int) -> NDArray[np.int64]:
    """Choose the frames that are solved: the first, the last, and evenly between them.

    Parameters
    ----------
    frames : number of frames
    every : distance of chosen frames, at most

    Returns
    -------
    (chosen,) their numbers
    """
    count = int(np.ceil((frames - 1) / every)) + 1
    return np.unique(np.round(np.linspace(0, frames - 1, count)).astype(np.int64))


def along(time: Array, known: NDArray[np.int64], values: Array) -> Array:
    """Interpolate values at all times by cubics that leave their range nowhere.

    Parameters
    ----------
    time : (frames,) [s]
    known : (chosen,) numbers of the frames whose values are known
    values : (chosen, ...)

    Returns
    -------
    (frames, ...)
    """
    if len(known) < 2:
        return np.repeat(values, len(time), axis=0)
    return np.asarray(scipy.interpolate.PchipInterpolator(time[known], values, axis=0)(time))


def balanced(
    shared: Separable, values: Array, right: Array, held: Array, muscles: NDArray[np.bool_]
) -> Array:
    """Move unknowns to where they balance the torques.

    The change is the least relative to what a muscle pulls with and to what the cost lets other
    unknowns have.

    Parameters
    ----------
    shared : pattern and data that all frames share
    values, right : (frames, entries) and (frames, rows) of the balance
    held : (frames, unknowns) with normalized forces in the columns of muscles on elastic tendons
    muscles : (unknowns,) which columns those are

    Returns
    -------
    (frames, unknowns)
    """
    low = np.where(muscles, MIN_FORCE, shared.lower)
    high = np.where(muscles, MAX_FORCE, shared.upper)
    A = shared.dense(values)
    result = held.copy()
    for _ in range(MAX_PROJECTIONS):
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
