"""A kind of unknowns beside motions: where they act, and how residuals change with them.

A kind stands in a file of its own, and in the table `kinds.KINDS`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from myomorph.body.refine.frame_kernels import Setting
from myomorph.body.refine.opened import Opened
from myomorph.body.refine.options import RefineOptions
from myomorph.body.refine.point import Point
from myomorph.body.refine.trial import Predicted, TrialData, TrialState
from myomorph.core.fit.unknowns import Block
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.tree import TreeArrays


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class Setup:
    """What kinds of unknowns are made of.

    Attributes
    ----------
    model : skeleton with the masses before
    recorded : trials on it
    markers : names
    marker_bodies : (markers,) numbers of their bodies, the ground's is 0
    masses : (bodies, 10) inertial parameters that `identify` finds in the same frames
    unit : size of the body against a human's, see `length_unit`
    options : how much each part is believed
    """

    model: Model
    recorded: tuple[Opened, ...]
    markers: tuple[str, ...]
    marker_bodies: Ints
    masses: Array
    unit: float
    options: RefineOptions


class Predictor(Protocol):
    """The problem, as far as kinds ask it."""

    def predict(self, setting: Setting, state: TrialState) -> Predicted:
        """Compute errors of markers and residuals of the root."""
        ...

    def setting_of(self, tree: TreeArrays, point: Point) -> Setting:
        """Put the markers of a point on a tree."""
        ...

    def skeleton(self, point: Point) -> Model:
        """Stretch the skeleton by the lengths of a point; masses as before."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Here:
    """A recording as it is predicted at a point: where slopes are taken.

    Attributes
    ----------
    problem : that predicts other points too
    point : of the search
    setting : tree and markers there
    state : of the recording
    predicted : errors of its markers and residuals of the root
    """

    problem: Predictor
    point: Point
    setting: Setting
    state: TrialState
    predicted: Predicted


@read_only
class KindSlopes:
    """Slopes of a recording in the steps of one kind.

    Attributes
    ----------
    markers : (frames, 3 markers, steps) of the markers' errors; None where they do not change
    residual : (frames, 6, steps) of the root's residual; None likewise
    """

    markers: Array | None = None
    residual: Array | None = None

    def markers_in(self, frames: Ints) -> Array | None:
        """Return slopes of markers in some frames.

        Parameters
        ----------
        frames : (chosen,) numbers

        Returns
        -------
        (chosen, 3 markers, steps)
        """
        return None if self.markers is None else self.markers[frames]


class PriorRows(NamedTuple):
    """What is known of a kind before anything is measured, in standard deviations.

    Attributes
    ----------
    rows : (rows, steps) slopes of the misses
    misses : (rows,)
    """

    rows: Array
    misses: Array


class Kind:
    """A kind of unknowns that motions do not have: a name in `fit`.

    Attributes
    ----------
    name : in `fit`, and of its block of unknowns
    moves_markers : whether predicted markers depend on it, and not the root's residual alone
    """

    name: ClassVar[str]
    moves_markers: ClassVar[bool] = False

    def start(self) -> Array:
        """Take the values of the model as given.

        Returns
        -------
        in the shape in which the kind wants them
        """
        raise NotImplementedError

    def block(self, values: Array) -> Block:
        """List the unknowns, with the chart of steps.

        Parameters
        ----------
        values : of the kind, where the search begins

        Returns
        -------
        a block that has the kind's name
        """
        raise NotImplementedError

    def block_in_units(self, values: Array) -> Block:
        """List the unknowns with steps in their own units, see `units`.

        Parameters
        ----------
        values : of the kind

        Returns
        -------
        the block of `block`, with another chart where steps have other units
        """
        return self.block(values)

    @property
    def columns(self) -> Ints:
        """(steps,) places of the steps among the unknowns of the block; others never move."""
        return np.arange(self.start().size)

    def units(self, values: Array) -> Array | None:
        """Differentiate values in steps, where steps have other units than values.

        Parameters
        ----------
        values : of the kind

        Returns
        -------
        (steps, steps), None where steps are in the values' units
        """
        return None

    def tree(self, tree: TreeArrays, values: Array) -> TreeArrays:
        """Change the tree; by default not.

        Parameters
        ----------
        tree : of the kinds before
        values : of the kind

        Returns
        -------
        the tree with them
        """
        return tree

    def locations(self, locations: Array, values: Array) -> Array:
        """Change positions of the markers on their bodies; by default not.

        Parameters
        ----------
        locations : (markers, 3) of the kinds before [m]
        values : of the kind

        Returns
        -------
        (markers, 3) [m]
        """
        return locations

    def wrench(self, number: int, data: TrialData, values: Array, wrench: Array) -> Array:
        """Change the wrench that was measured; by default not.

        Parameters
        ----------
        number : of the recording
        data : the recording
        values : of the kind
        wrench : (frames, 6) of the kinds before

        Returns
        -------
        (frames, 6) moment about the ground's origin and force [N m], [N]
        """
        return wrench

    def slopes(self, here: Here) -> KindSlopes:
        """Differentiate markers and residual of a recording in the steps of the kind.

        Parameters
        ----------
        here : the recording at a point
        """
        raise NotImplementedError

    def prior_rows(self, values: Array) -> PriorRows:
        """Compute how far values are from what is known of them before.

        Parameters
        ----------
        values : of the kind

        Returns
        -------
        misses and their slopes
        """
        raise NotImplementedError
