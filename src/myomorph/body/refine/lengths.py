"""Lengths of segments as unknowns of `refine`: factors on those of the given model."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from myomorph.body.refine.kind import Here, Kind, KindSlopes, PriorRows, Setup
from myomorph.body.refine.options import LENGTHS
from myomorph.core.fit.unknowns import Block, Unknown
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.scale import scale
from myomorph.core.motion.lengths import Length, factors_of, lengths_of
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.tree import TreeArrays, compile_tree

LENGTH_STEP = 1e-5  # Of a factor, in differences
MIN_FACTOR = 0.3  # Of a length: below it nothing that was computed means anything


class TreeSlopes(NamedTuple):
    """Slopes of the tree's constants in a length.

    Attributes
    ----------
    pre, post : (axes, 3), (bodies, 3) of translations before axes and after them [m]
    coefficients : of the functions of coordinates, in their shape
    """

    pre: Array
    post: Array
    coefficients: Array


@read_only
class Lengths(Kind):
    """Factors of lengths.

    Attributes
    ----------
    model : skeleton with lengths of 1
    lengths : that may change
    marker_bodies : (markers,) numbers of the markers' bodies
    sd : standard deviation of a factor before anything is measured
    """

    model: Model
    lengths: tuple[Length, ...]
    marker_bodies: Ints
    sd: float

    name = LENGTHS
    moves_markers = True

    @classmethod
    def of(cls, setup: Setup) -> Lengths:
        """Take the lengths of the model."""
        return cls(
            model=setup.model,
            lengths=lengths_of(setup.model),
            marker_bodies=setup.marker_bodies,
            sd=setup.options.length_sd,
        )

    def start(self) -> Array:
        """Take the model's lengths.

        Returns
        -------
        (lengths,) factors of 1
        """
        return np.ones(len(self.lengths))

    def block(self, values: Array) -> Block:
        """List the factors.

        Parameters
        ----------
        values : (lengths,) where the search begins

        Returns
        -------
        an unknown for each length
        """
        unknowns = [
            Unknown(
                name=f"{length.name} length",
                where=f"model: length {length.name}",
                start=float(factor),
                low=MIN_FACTOR,
            )
            for length, factor in zip(self.lengths, values, strict=True)
        ]
        return Block(name=LENGTHS, unknowns=tuple(unknowns))

    def stretched(self, values: Array) -> Model:
        """Stretch the skeleton; masses as before.

        Parameters
        ----------
        values : (lengths,) factors

        Returns
        -------
        the skeleton with these lengths
        """
        if (values == 1.0).all():
            return self.model
        return scale(self.model, factors_of(self.lengths, values))

    def tree(self, tree: TreeArrays, values: Array) -> TreeArrays:
        """Compile the stretched skeleton.

        Parameters
        ----------
        tree : of the kinds before; not used
        values : (lengths,) factors

        Returns
        -------
        its arrays, with masses as before
        """
        return compile_tree(self.stretched(values)).arrays

    def locations(self, locations: Array, values: Array) -> Array:
        """Stretch positions of markers with their bodies.

        Parameters
        ----------
        locations : (markers, 3) [m]
        values : (lengths,) factors

        Returns
        -------
        (markers, 3) [m]
        """
        grown = np.ones((len(self.model.bodies) + 1, 3))
        numbers = {name: number + 1 for number, name in enumerate(self.model.body_names)}
        for body, factor in factors_of(self.lengths, values).items():
            grown[numbers[body]] = factor
        return locations * grown[self.marker_bodies]

    def slopes(self, here: Here) -> KindSlopes:
        """Differentiate markers and residual in each factor, by differences.

        Returns
        -------
        (frames, 3 markers, lengths) and (frames, 6, lengths)
        """
        problem = here.problem
        errors, residual = here.predicted
        frames = len(errors)
        markers = np.empty((frames, errors[0].size, len(self.lengths)))
        residuals = np.empty((frames, 6, len(self.lengths)))
        for index, slopes in enumerate(self.tree_slopes):
            factors = here.point[LENGTHS].copy()
            factors[index] += LENGTH_STEP
            tree = _longer(here.setting.tree, slopes)
            longer = problem.setting_of(tree, here.point.with_values({LENGTHS: factors}))
            # Dependent coordinates follow the functions of this tree.
            state = here.state.with_rates(here.state.rates.copy())
            other = problem.predict(longer, state)
            markers[:, :, index] = (other.errors - errors).reshape(frames, -1) / LENGTH_STEP
            residuals[:, :, index] = (other.residual - residual) / LENGTH_STEP
        return KindSlopes(markers=markers, residual=residuals)

    def prior_rows(self, values: Array) -> PriorRows:
        """Compare factors with 1.

        Parameters
        ----------
        values : (lengths,)

        Returns
        -------
        misses in standard deviations
        """
        return PriorRows(rows=np.eye(len(values)) / self.sd, misses=(values - 1.0) / self.sd)

    @cached_property
    def tree_slopes(self) -> tuple[TreeSlopes, ...]:
        """Slopes of the tree's constants in each length: nearly linear, so once is enough."""
        unstretched = compile_tree(self.model).arrays
        result = []
        for index in range(len(self.lengths)):
            factors = self.start()
            factors[index] += LENGTH_STEP
            longer = compile_tree(self.stretched(factors)).arrays
            more = longer.functions.coefficients - unstretched.functions.coefficients
            slopes = TreeSlopes(
                pre=(longer.pre_p - unstretched.pre_p) / LENGTH_STEP,
                post=(longer.post_p - unstretched.post_p) / LENGTH_STEP,
                coefficients=more / LENGTH_STEP,
            )
            result.append(slopes)
        return tuple(result)


def _longer(tree: TreeArrays, slopes: TreeSlopes) -> TreeArrays:
    """Make one length of a tree a step longer."""
    functions = tree.functions
    coefficients = functions.coefficients + LENGTH_STEP * slopes.coefficients
    return tree._replace(
        pre_p=tree.pre_p + LENGTH_STEP * slopes.pre,
        post_p=tree.post_p + LENGTH_STEP * slopes.post,
        functions=functions._replace(coefficients=coefficients),
    )
