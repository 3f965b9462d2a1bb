"""Lengths, velocities and moment arms of muscle paths as tables report them: every pair that can have a moment arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadModel
from myomorph.model.functions import PiecewisePolynomial
from myomorph.model.model import Model
from myomorph.model.series import Motion
from myomorph.muscles.coupled_arms import LoopGroup, loop_couplings, loop_groups
from myomorph.muscles.path import Paths, compile_paths
from myomorph.rigid.coordinates import Ints


@read_only
class Crossings:
    """The pairs of a muscle and a coordinate that can have a moment arm, and how to fill them."""

    # muscle, coordinate: (pairs,) indices; the first pairs are those of `Paths.arm_muscle`
    muscle: Ints
    coordinate: Ints
    # of each coupler, the pairs of its dependent coordinate and, for each of its two sources, the pairs they follow; -1
    # for none
    followers: tuple[tuple[Ints, tuple[Ints, Ints]], ...]
    # groups of coordinates that closed loops tie together, each with (muscles, group) pairs of the muscles that cross
    # it
    loops: tuple[tuple[LoopGroup, Ints], ...]
    order: Ints  # (pairs,) by coordinate, then muscle


def crossings(paths: Paths) -> Crossings:
    """Pairs that the paths' pattern holds, and those of dependent coordinates with what their sources move."""
    pairs = {
        pair: i for i, pair in enumerate(zip(paths.arm_coordinate.tolist(), paths.arm_muscle.tolist(), strict=True))
    }
    by_coordinate: dict[int, list[int]] = {}
    for coordinate, muscle in pairs:
        by_coordinate.setdefault(coordinate, []).append(muscle)
    tree = paths.tree.arrays
    followers = []
    for dependent, sources in zip(tree.coupler_coordinate.tolist(), tree.coupler_source.tolist(), strict=True):
        muscles = sorted({muscle for source in sources for muscle in by_coordinate.get(source, ())})
        for muscle in muscles:
            if (dependent, muscle) not in pairs:
                pairs[dependent, muscle] = len(pairs)
                by_coordinate.setdefault(dependent, []).append(muscle)
        own = np.array([pairs[dependent, muscle] for muscle in muscles], np.int64)
        led = tuple(np.array([pairs.get((source, muscle), -1) for muscle in muscles], np.int64) for source in sources)
        followers.append((own, (led[0], led[1])))
    loops = []
    for group in loop_groups(paths.tree):
        members = group.coordinates.tolist()
        muscles = sorted({muscle for member in members for muscle in by_coordinate.get(member, ())})
        for muscle, coordinate in product(muscles, members):
            pairs.setdefault((coordinate, muscle), len(pairs))
        table = [[pairs[coordinate, muscle] for coordinate in members] for muscle in muscles]
        loops.append((group, np.array(table, np.int64).reshape(-1, len(members))))
    coordinates, crossed = np.array(list(pairs), np.int64).reshape(-1, 2).T
    order = np.lexsort((crossed, coordinates))
    return Crossings(crossed, coordinates, tuple(followers), tuple(loops), order)


def coupler_slopes(paths: Paths, coordinates: Array) -> Array:
    """(frames, couplers, 2) derivatives of dependent coordinates in what they follow; 0 where not a polynomial."""
    model, tree = paths.tree.model, paths.tree.arrays
    slopes = np.zeros((len(coordinates), len(tree.coupler_coordinate), 2))
    for index, (dependent, source) in enumerate(zip(tree.coupler_coordinate, tree.coupler_source[:, 0], strict=True)):
        function = model.dependent_coordinates[model.coordinate_names[dependent]].function
        if isinstance(function, PiecewisePolynomial) and source >= 0:
            slopes[:, index, 0] = function(coordinates[:, source], 1)
    return slopes


def arms_as_reported(paths: Paths, pattern: Crossings, coordinates: Array, arms: Array) -> Array:
    """Moment arms (frames, pairs in `order`) as OpenSim reports them; see `MuscleKinematics.dense`."""
    table = np.zeros((len(arms), len(pattern.muscle) + 1))
    table[:, : arms.shape[1]] = arms
    slopes = coupler_slopes(paths, coordinates)
    for index, (own, led) in enumerate(pattern.followers):
        square = (slopes[:, index] ** 2).sum(axis=1)
        moves = square > 0.0
        reached = sum(slopes[:, index, s, None] * table[:, led[s]] for s in range(2))
        table[np.ix_(moves, own)] = (reached / np.where(moves, square, 1.0)[:, None])[moves]
    for group, pairs in pattern.loops:
        couplings = loop_couplings(paths.tree, group, coordinates)
        table[:, pairs] = np.einsum("fml,flk->fmk", table[:, pairs[:, group.leading]], couplings)
    return table[:, pattern.order]


class ReportedPaths:
    """The muscle paths of a model, evaluated a part of a motion at a time.
    `model`: with muscles. `pairs`: muscle and coordinate of each column of moment arms, in order of coordinates.
    """

    def __init__(self, model: Model):
        if not model.muscles:
            raise BadModel(f"model '{model.name}' has no muscles")
        self.model, self.paths = model, compile_paths(model)
        self.pattern = crossings(self.paths)
        self.pairs = tuple(
            (model.muscle_names[self.pattern.muscle[i]], model.coordinate_names[self.pattern.coordinate[i]])
            for i in self.pattern.order
        )

    def evaluate(
        self, motion: Motion, part: slice, advance: Callable[[int], None] | None = None
    ) -> tuple[Array, Array, Array]:
        """Lengths [m] and velocities [m/s] (frames, muscles), moment arms (frames, pairs) of some frames of a motion.
        Frames without coordinates (NaN) stay NaN.
        `motion`: with velocities; `advance`: called with the number of frames just done.
        """
        if motion.velocities is None:
            raise ValueError("the motion has no velocities")
        tree = self.paths.tree
        values = tree.coordinates_of(
            replace(motion, time=motion.time[part], values=motion.values[part], velocities=None, accelerations=None)
        )
        rates = np.zeros_like(values)
        columns = {name: i for i, name in enumerate(motion.names)}
        for j, name in enumerate(self.model.coordinate_names):
            if name in columns:
                rates[:, j] = motion.velocities[part, columns[name]]
        unknown = ~(np.isfinite(values).all(axis=1) & np.isfinite(rates).all(axis=1))
        values[unknown], rates[unknown] = tree.defaults, 0.0
        lengths, velocities, arms = self.paths.evaluate(values, rates, advance)
        reported = arms_as_reported(self.paths, self.pattern, values, arms)
        for result in (lengths, velocities, reported):
            result[unknown] = np.nan
        return lengths, velocities, reported
