"""The one problem of motion, body and masses: its data, its unknowns and what is known before.

Coordinates over time are quintic splines: few unknowns, and derivatives that belong to them. All
other unknowns are kinds with files of their own, see `kind.Kind`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from myomorph.body.refine.frame_kernels import (
    PlacedMarkers,
    Rates,
    Setting,
    predict_frames,
)
from myomorph.body.refine.kind import Kind
from myomorph.body.refine.lengths import Lengths
from myomorph.body.refine.masses import Masses
from myomorph.body.refine.options import RefineOptions
from myomorph.body.refine.point import Point
from myomorph.body.refine.trial import Predicted, TrialData, TrialState
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.core.motion.pose_problem import PoseProblem
from myomorph.core.rigid.coordinates import couple_rates_frames
from myomorph.core.rigid.frames import over_frames
from myomorph.core.rigid.tree import TreeArrays, compile_tree

MARKER_NOISE = 0.01  # By default, along one axis on a body of human size [m]


@read_only
class Problem:
    """The problem, as far as it stays the same while it is solved.

    Attributes
    ----------
    model : skeleton with the masses before
    names : of the markers
    pose : what is tracked, and the coordinates that are free
    locations : (markers, 3) on the model [m]
    trials : that count
    kinds : of unknowns beside motions, estimated or held, in the order in which they act
    fit : names of the kinds that are estimated
    weight : of the body [N]
    unit : size of the body against a human's, see `length_unit`
    options : how much each part is believed
    tissue : by which markers move more than the mass; None where they do not
    """

    model: Model
    names: tuple[str, ...]
    pose: PoseProblem
    locations: Array
    trials: tuple[TrialData, ...]
    kinds: tuple[Kind, ...]
    fit: tuple[str, ...]
    weight: float
    unit: float
    options: RefineOptions
    tissue: SoftTissue | None = None

    def kind(self, name: str) -> Kind:
        """Find a kind of unknowns by its name."""
        return next(kind for kind in self.kinds if kind.name == name)

    @property
    def lengths(self) -> Lengths:
        """The kind of lengths."""
        return next(kind for kind in self.kinds if isinstance(kind, Lengths))

    @property
    def masses(self) -> Masses:
        """The kind of masses."""
        return next(kind for kind in self.kinds if isinstance(kind, Masses))

    def with_kind(self, changed: Kind) -> Problem:
        """Replace the kind of this name."""
        kinds = [changed if kind.name == changed.name else kind for kind in self.kinds]
        return replace(self, kinds=tuple(kinds))

    @cached_property
    def fitted(self) -> tuple[Kind, ...]:
        """Kinds that are estimated; those that move markers come first."""
        fitted = [kind for kind in self.kinds if kind.name in self.fit]
        return tuple(sorted(fitted, key=lambda kind: not kind.moves_markers))

    @cached_property
    def columns(self) -> FrozenMap[str, slice]:
        """Where the steps of each fitted kind stand among the shared ones."""
        ends = np.cumsum([0, *(len(kind.columns) for kind in self.fitted)]).tolist()
        pairs = zip(self.fitted, ends[:-1], ends[1:], strict=True)
        return FrozenMap({kind.name: slice(first, last) for kind, first, last in pairs})

    @property
    def count(self) -> int:
        """Shared unknowns: steps of all fitted kinds."""
        return sum(len(kind.columns) for kind in self.fitted)

    @property
    def marker_count(self) -> int:
        """How many of the shared unknowns, the first ones, move markers."""
        return sum(len(kind.columns) for kind in self.fitted if kind.moves_markers)

    @property
    def alphas(self) -> Array:
        """(free,) of soft tissue, of the free coordinates [s^2]."""
        free = self.pose.free
        return np.zeros(len(free)) if self.tissue is None else self.tissue.alpha[free]

    @property
    def marker_variance(self) -> float:
        """Of a marker along one axis [m^2]."""
        noise = self.options.marker_noise
        return float((MARKER_NOISE * self.unit if noise is None else noise) ** 2)

    @property
    def residual_sd(self) -> Array:
        """(6,) of the root's residual [N m], [N]."""
        options = self.options
        return self.weight * np.repeat([options.moment_noise * self.unit, options.force_noise], 3)

    def begin(self) -> Point:
        """Splines nearest to inverse kinematics, on the model as it is."""
        free = self.pose.free
        return Point(
            motions=tuple(trial.start_coefficients[:, free] for trial in self.trials),
            values=FrozenMap({kind.name: kind.start() for kind in self.kinds}),
        )

    def skeleton(self, point: Point) -> Model:
        """Stretch the skeleton by the lengths of a point; masses as before."""
        return self.lengths.stretched(point[self.lengths.name])

    def setting(self, point: Point) -> Setting:
        """Build tree and markers at a point."""
        tree = compile_tree(self.model).arrays
        for kind in self.kinds:
            tree = kind.tree(tree, point[kind.name])
        return self.setting_of(tree, point)

    def setting_of(self, tree: TreeArrays, point: Point) -> Setting:
        """Put the markers of a point on a tree."""
        placed = PlacedMarkers(body=self.pose.markers.body, location=self.placed(point))
        return Setting(tree=tree, markers=placed)

    def placed(self, point: Point) -> Array:
        """Compute marker positions on the stretched bodies.

        Parameters
        ----------
        point : with lengths and shifts

        Returns
        -------
        (markers, 3) [m]
        """
        locations = self.locations
        for kind in self.kinds:
            locations = kind.locations(locations, point[kind.name])
        return locations

    def state(self, point: Point, number: int) -> TrialState:
        """Evaluate the motion of a recording at a point, and the wrench that it is held against.

        Parameters
        ----------
        point : with the motion
        number : of the recording
        """
        data = self.trials[number]
        wrench = data.wrench
        for kind in self.kinds:
            wrench = kind.wrench(number, data, point[kind.name], wrench)
        rates = self.rates(data, point.motions[number])
        return TrialState(number=number, data=data, rates=rates, wrench=wrench)

    def rates(self, trial: TrialData, coefficients: Array) -> Rates:
        """Evaluate a recording's splines.

        Markers that move more than the mass are seen at q - alpha q''.

        Parameters
        ----------
        trial : one of the problem's
        coefficients : (coefficients, free)

        Returns
        -------
        (frames, coordinates) of the mass and of the markers
        """
        free = self.pose.free
        values = trial.start.copy()
        velocities = np.zeros_like(values)
        accelerations = np.zeros_like(values)
        for order, of_time in enumerate((values, velocities, accelerations)):
            of_time[:, free] = trial.basis.at(coefficients, order)
        shown = values.copy()
        shown[:, free] -= self.alphas * accelerations[:, free]
        return Rates(c=values, cdot=velocities, cddot=accelerations, shown=shown)

    def predict(self, setting: Setting, state: TrialState) -> Predicted:
        """Compute errors of markers and residuals of the root.

        Dependent coordinates of the state's rates are set in place.

        Parameters
        ----------
        setting : tree and markers
        state : of a recording
        """
        data = state.data
        places = np.empty(data.observed.shape)
        residual = np.empty((len(data.time), 6))

        def part(start: int, stop: int) -> None:
            chosen = slice(start, stop)
            predict_frames(
                setting,
                state.rates.frames(chosen),
                state.wrench[chosen],
                places[chosen],
                residual[chosen],
            )

        over_frames(part, len(data.time))
        residual[~data.use] = 0.0
        return Predicted(errors=np.nan_to_num(places - data.observed), residual=residual)

    def motion(self, point: Point, number: int) -> Motion:
        """Evaluate the motion of a recording's mass with the derivatives that belong to it.

        Parameters
        ----------
        point : with the motion
        number : of the recording
        """
        state = self.state(point, number)
        setting = self.setting(point)
        # Sets dependent values too.
        self.predict(setting, state)
        rates = state.rates
        couple_rates_frames(setting.tree, rates.c, rates.cdot, rates.cddot)
        return Motion(
            time=state.data.time,
            names=self.model.coordinate_names,
            values=rates.c,
            velocities=rates.cdot,
            accelerations=rates.cddot,
        )


def generic_parameters(model: Model, mass: float) -> Array:
    """Scale the model's inertial parameters to a mass.

    Parameters
    ----------
    model : with masses
    mass : of the whole body [kg]

    Returns
    -------
    (bodies, 10)
    """
    return inertial_parameters(model) * (mass / model.mass)
