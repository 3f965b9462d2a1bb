"""The muscle paths of a model, compiled, and what they are over a motion.

`compile_paths` makes the arrays once (`path_arrays`), `Paths.evaluate` runs the kernel of `path`
over frames.

Most coordinates cannot move most muscles, so moment arms are kept for the structural pattern only:
the pairs of a muscle and a coordinate that moves some of its bodies against others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.latest import Latest
from myomorph.core.model.model import Model
from myomorph.core.model.shapes import ArmPairs, Coordinates, Pulls
from myomorph.core.model.shown import shown
from myomorph.core.muscles import path_arrays as columns
from myomorph.core.muscles.path import (
    PathMotion,
    PathResults,
    PathRules,
    PathValues,
    path_frames,
)
from myomorph.core.muscles.path_arrays import PathArrays, moved_paths, path_arrays
from myomorph.core.muscles.path_functions import compile_path_functions, has_functions
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.frames import over_frames
from myomorph.core.rigid.tree import Flags, Tree, compile_tree


class PathPulls(NamedTuple):
    """Loads that unit tensions put on bodies.

    Attributes
    ----------
    pulls : (frames, pairs, 6) force [1] and its moment about the ground's origin [m], in ground, in
        the order of `Paths.pull_muscle` and `pull_body`
    work : (frames, arms) part of the moment arms that moving points have [m/rad or m/m]
    """

    pulls: Pulls
    work: ArmPairs


@shown
@dataclass(frozen=True, eq=False)
class Paths:
    """Muscle paths of a model, compiled.

    Attributes
    ----------
    tree : the compiled model
    arrays : of the paths
    """

    tree: Tree
    arrays: PathArrays = field(repr=False)

    @property
    def muscles(self) -> tuple[str, ...]:
        """Names of the muscles, in order."""
        return self.tree.model.muscle_names

    @cached_property
    def arm_muscle(self) -> Ints:
        """(moment arms,) the muscle of each pair of the pattern."""
        return np.repeat(np.arange(len(self.muscles)), np.diff(self.arrays.start[:, columns.ARMS]))

    @cached_property
    def rules(self) -> PathRules:
        """Rules by which the paths have their lengths."""
        by_mujoco = self.arrays.wrap[:, columns.AFTER] >= 0
        model = self.tree.model
        functions = None
        if has_functions(model):
            starts = self.arrays.start[1:-1, columns.ARMS]
            functions = compile_path_functions(model, np.split(self.arm_coordinate, starts))
        return PathRules(
            surfaces=1 if (~by_mujoco).any() else None,
            tendons=1 if by_mujoco.any() else None,
            functions=functions,
        )

    @property
    def arm_coordinate(self) -> Ints:
        """(moment arms,) the coordinate of each pair of the pattern."""
        return self.arrays.arm[:, 0]

    @property
    def arm_free(self) -> Flags:
        """(moment arms,) whether the pair's coordinate is independent."""
        return self.arrays.arm[:, 1] == 1

    def evaluate(
        self,
        coordinates: Array,
        speeds: Array | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> PathValues:
        """Lengths, velocities and moment arms of all muscles.

        A coordinate that others follow has what reaches the muscle through them included in its
        moment arm. A dependent one has its own share.

        Parameters
        ----------
        coordinates : (frames, coordinates) in the model's order; dependent ones are set here
            [rad or m]
        speeds : (frames, coordinates) of which dependent ones are not read; None for rest [per s]
        progress : called with the number of frames just done

        Returns
        -------
        values of as many frames

        Raises
        ------
        BadData : the shape of an array is wrong
        """
        coordinates = np.array(coordinates, dtype=np.float64)
        shape = (len(coordinates), len(self.tree.model.coordinates))
        if speeds is None:
            speeds = np.zeros(shape)
        speeds = np.ascontiguousarray(speeds, dtype=np.float64)
        for values in (coordinates, speeds):
            if values.shape != shape:
                raise BadData(
                    f"expected coordinates and speeds of shape {shape}, but got {values.shape}"
                )
        motion = PathMotion(coordinates=coordinates, speeds=speeds)
        return self._run(motion, progress).values

    def _run(
        self,
        motion: PathMotion,
        progress: Callable[[int], None] | None,
        pairs: int = 0,
        nodes: int = 0,
    ) -> PathResults:
        """Run the path kernel over frames.

        Parameters
        ----------
        motion : whose dependent coordinates are set
        progress : called with the number of frames just done
        pairs : of muscles and bodies whose pulls are computed, 0 for none
        nodes : of each muscle that are computed, 0 for none
        """
        frames = len(motion.coordinates)
        muscles = len(self.muscles)
        values = PathValues(
            lengths=np.empty((frames, muscles)),
            velocities=np.empty((frames, muscles)),
            arms=np.empty((frames, len(self.arm_coordinate))),
        )
        results = PathResults(
            values=values,
            pulls=np.zeros((frames, pairs, 6)),
            nodes=np.full((frames, muscles if nodes else 0, nodes, 4), np.nan),
        )
        tree = self.tree.arrays
        rules = self.rules

        def run(start: int, stop: int) -> None:
            part = motion.part(start, stop)
            path_frames(tree, self.arrays, rules, part, results.part(start, stop))

        over_frames(run, frames, progress)
        return results

    def _at_rest(self, coordinates: Coordinates) -> PathMotion:
        """Copy coordinates (frames, coordinates), with speeds of 0."""
        c = np.array(coordinates, dtype=np.float64)
        return PathMotion(coordinates=c, speeds=np.zeros_like(c))

    @cached_property
    def pull_muscle(self) -> Ints:
        """(pairs,) the muscle of each pair of a muscle and a body that its path touches."""
        return np.repeat(
            np.arange(len(self.muscles)), np.diff(self.arrays.start[:, columns.BODIES])
        )

    @cached_property
    def pull_body(self) -> Ints:
        """(pairs,) number in the tree of the body of each of those pairs."""
        arrays = self.arrays
        first = arrays.start[:, columns.BODIES]
        bodies = np.zeros(int(first[-1]), np.int64)
        muscles = np.arange(len(self.muscles))
        points = arrays.point
        of_point = np.repeat(muscles, np.diff(arrays.start[:, columns.POINTS]))
        bodies[first[of_point] + points[:, columns.LOCAL]] = points[:, columns.BODY]
        wraps = arrays.wrap
        of_wrap = np.repeat(muscles, np.diff(arrays.start[:, columns.WRAPS]))
        surface_bodies = arrays.object[wraps[:, columns.OBJECT], columns.OBJECT_BODY]
        bodies[first[of_wrap] + wraps[:, columns.OBJECT_LOCAL]] = surface_bodies
        return bodies

    def pulls(
        self, coordinates: Coordinates, progress: Callable[[int], None] | None = None
    ) -> PathPulls:
        """Compute what unit tension of each muscle does to the bodies its path touches.

        Forces act at the path's points and where it leaves surfaces, along its straight parts. What
        they do through points that move in their bodies acts on no body, but on the coordinates
        that move the points.

        Parameters
        ----------
        coordinates, progress : as of `evaluate`

        Returns
        -------
        pulls and work of as many frames
        """
        pairs = len(self.pull_body)
        results = self._run(self._at_rest(coordinates), progress, pairs=pairs)
        return PathPulls(pulls=results.pulls, work=results.values.arms)

    def nodes(self, coordinates: Coordinates) -> Array:
        """Points that each path runs through, where it meets and leaves surfaces included.

        Parameters
        ----------
        coordinates : as of `evaluate`

        Returns
        -------
        (frames, muscles, nodes, 4) positions in ground and the length of the arc that ends there, 0
        after a straight part; NaN beyond the path's last point [m]
        """
        nodes = int(self.arrays.sizes[0]) + 2
        return self._run(self._at_rest(coordinates), None, nodes=nodes).nodes


def compile_paths(model: Model) -> Paths:
    """Compile a model's muscle paths to flat arrays; the same model compiles once."""
    return _latest(model)


def compile_paths_as(model: Model, like: Model) -> Paths:
    """Compile a model that differs from another in places of path points and sizes of surfaces.

    It may also differ as of `compile_tree_as`. What was compiled of the other is used again.

    Parameters
    ----------
    model : to compile
    like : the other one, with the same parts in the same order
    """
    arrays = moved_paths(compile_paths(like).arrays, model)
    paths = Paths(compile_tree(model), arrays)
    _latest.put(model, paths)
    return paths


def _compile(model: Model) -> Paths:
    """Compile a model's muscle paths."""
    tree = compile_tree(model)
    return Paths(tree, path_arrays(model, tree))


_latest = Latest(_compile)
