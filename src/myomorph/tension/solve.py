"""Muscle tensions: for every frame, the least effort that balances the joint torques."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from myomorph.model.errors import BadData, BadModel, UnknownName
from myomorph.model.model import Actuator, Model
from myomorph.model.series import Motion, Series
from myomorph.model.spatial import Array
from myomorph.muscles.hill import Convention, compile_hill, fill_hill_forces, viscosities
from myomorph.muscles.passive import joint_forces
from myomorph.muscles.path import compile_paths
from myomorph.rigid.closed_motion import loop_slopes, refuse_open
from myomorph.rigid.dynamics import rates_of
from myomorph.rigid.frames import over_frames
from myomorph.rigid.loops import loop_basis
from myomorph.rigid.tree import Tree, compile_tree
from myomorph.tension.actuators import RESIDUAL, default_reserves, free_coordinates
from myomorph.tension.assembly import actuator_entries, assemble, fold, take_off
from myomorph.tension.dual import OPTIMAL, STATUS_NAMES, Separable, no_links, no_wells, solve_separable


@dataclass(frozen=True)
class TensionOptions:
    """Settings of `solve_tension`.

    Attributes
    ----------
    exponent : p, 1.2 to 5, in sum_m w_m a_m^p + sum_r |u_r|^p of activations a and controls u
    weights : "equal": w = 1; "volume": w_m in proportion to F0 L0, with mean 1
    passive : whether the muscles' passive forces take part; OpenSim's static optimization leaves them out
        (passive torques and bushings of the model's joints always take part, as there)
    viscous : whether the muscles' viscosity takes part, a force that may push; 0 in models that have none. It
        does in OpenSim, where it is a force of its own beside the muscle's
    curves : "rigid-tendon" or "opensim" force-length-velocity curves (see `hill_forces`), "constant"
        for the maximum isometric force at any length and velocity, or "auto": "rigid-tendon" with
        passive forces and "opensim" without
    reserve : optimal force of the reserves that are added where no actuators are given [N m or N]
    residual : optimal force of what then holds a floating body [N], [N m]
    """

    exponent: float = 2.0
    weights: Literal["equal", "volume"] = "equal"
    passive: bool = True
    viscous: bool = True
    curves: Literal["auto", "rigid-tendon", "opensim", "constant"] = "auto"
    reserve: float = 1.0
    residual: float = 10.0

    def __post_init__(self) -> None:
        if not 1.2 <= self.exponent <= 5.0:
            raise BadData(f"the exponent of the effort is {self.exponent:g}: expected 1.2 to 5")
        for name in ("reserve", "residual"):
            if not getattr(self, name) > 0.0:
                raise BadData(f"the optimal force of a {name} is {getattr(self, name):g}: expected above 0")
        if self.weights not in ("equal", "volume"):
            raise BadData(f"unknown weights '{self.weights}': there are 'equal', 'volume'")
        if self.curves not in ("auto", "rigid-tendon", "opensim", "constant"):
            raise BadData(f"unknown curves '{self.curves}': there are 'auto', 'rigid-tendon', 'opensim', 'constant'")

    @property
    def convention(self) -> Convention:
        """The curves' convention once "auto" is resolved; "constant" has none of its own."""
        if self.curves == "auto":
            return "rigid-tendon" if self.passive else "opensim"
        return "opensim" if self.curves == "opensim" else "rigid-tendon"


@dataclass(frozen=True, eq=False)
class Tension:
    """Muscle tensions over time, what they could not do, and whether each frame is an optimum.

    Attributes
    ----------
    time : (frames,) [s]
    muscles : names
    activations : (frames, muscles) NaN where the frame was not solved
    forces : (frames, muscles) along the tendons, with passive and viscous force where they took part [N]
    reserve_names : names of reserves, residuals and the model's other actuators
    reserves : (frames, reserves) their forces [N] and torques [N m]
    coordinates : the free coordinates that were balanced
    torques : (frames, coordinates) what muscles and reserves had to give together: inverse dynamics,
        dependent coordinates handed on, passive torques of joints taken off [N m or N]
    imbalance : (frames,) greatest torque or force left unbalanced [N m or N]
    status : (frames,) index into `STATUS_NAMES`: optimal, infeasible, not converged, missing input
    iterations : (frames,)
    lower, upper : (muscles,) bounds of the activations
    overstretched : muscles whose passive force passes their maximum isometric force in some frame, where
        it takes part: the model's fiber and tendon lengths do not fit the pose, and forces mislead
    viscous : (frames, muscles) that part of `forces` that is the muscles' viscosity [N], 0 where none took part
    """

    time: Array
    muscles: tuple[str, ...]
    activations: Array
    forces: Array
    reserve_names: tuple[str, ...]
    reserves: Array
    coordinates: tuple[str, ...]
    torques: Array
    imbalance: Array
    status: np.ndarray
    iterations: np.ndarray
    lower: Array
    upper: Array
    overstretched: tuple[str, ...]
    options: TensionOptions
    viscous: Array = field(default_factory=lambda: np.zeros((1, 1)))

    def __post_init__(self) -> None:
        object.__setattr__(self, "viscous", np.broadcast_to(self.viscous, self.forces.shape))
        for name in ("time", "activations", "forces", "reserves", "torques", "imbalance", "lower", "upper"):
            getattr(self, name).setflags(write=False)
        for name in ("status", "iterations"):
            getattr(self, name).setflags(write=False)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def optimal(self) -> np.ndarray:
        """(frames,) whether the activations are the least effort in balance."""
        return self.status == OPTIMAL

    @property
    def saturated(self) -> np.ndarray:
        """(frames, muscles) whether a muscle works at its upper bound."""
        return self.activations >= self.upper - 1e-6

    @property
    def pushing(self) -> tuple[str, ...]:
        """Muscles whose force is below zero in some frame: shortening against their viscosity faster than they pull."""
        slack = np.nanmin(np.where(np.isnan(self.forces), 0.0, self.forces), axis=0, initial=0.0) < 0.0
        return tuple(name for name, one in zip(self.muscles, slack, strict=True) if one)

    @property
    def residual_names(self) -> tuple[str, ...]:
        """Those of `reserve_names` that hold a floating body, added by default."""
        return tuple(name for name in self.reserve_names if name.startswith(RESIDUAL))

    def summary(self) -> dict[str, int]:
        """Number of frames by status."""
        return {name: int(np.sum(self.status == k)) for k, name in enumerate(STATUS_NAMES)}


def solve_tension(
    model: Model,
    motion: Motion,
    torques: Series,
    options: TensionOptions | None = None,
    actuators: Sequence[Actuator] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Tension:
    """Share the joint torques among muscles with the least effort, frame by frame.

        minimise  sum_m w_m a_m^p + sum_r u_r^p
        subject to  R^T F a + D u = tau - R^T (F_passive + F_viscous),  bounds on a and u

    with moment arms R, forces per unit activation F (rigid tendon), directions D of actuators with
    controls u, and one row for every coordinate that is not locked, prescribed, driven by a coupler or taken as
    dependent by closed loops. Which of a loop's coordinates is taken so does not change the solution.
    The problem of a frame is convex and its solution unique, so frames do not depend on each other.

    Parameters
    ----------
    motion : with velocities; a coordinate it lacks rests at its default
    torques : generalized forces of inverse dynamics at the motion's times (frames, coordinates)
    actuators : added to the model's own, replacing those of the same name, as OpenSim's
        `force_set_files`; None adds `default_reserves`, () adds nothing
    progress : called with the number of frames just done

    Raises
    ------
    BadData
        where the motion has no velocities, torques are of other times, or loops stand open by more than `OPEN`
    UnknownName
        where torques lack a free coordinate, or an actuator names what does not exist
    BadModel
        where the model has nothing to solve for
    """
    problem, names = tension_problem(model, motion, torques, options, actuators)
    over_frames(problem.solve, len(motion), progress)
    return problem.result(np.array(motion.time), names)


def tension_problem(
    model: Model,
    motion: Motion,
    torques: Series,
    options: TensionOptions | None = None,
    actuators: Sequence[Actuator] | None = None,
) -> tuple[TensionProblem, tuple[str, ...]]:
    """What `solve_tension` solves, set up but not solved, and the names of the actuators."""
    options = options or TensionOptions()
    tree = compile_tree(model)
    coordinates, rates = rates_of(tree, motion)
    added = default_reserves(model, options.reserve, options.residual) if actuators is None else tuple(actuators)
    given = {one.name for one in added}
    own = [one for one in model.actuators if one.name not in given]
    helpers = tuple(one for one in (*own, *added) if one.enabled)
    names = tuple(one.name for one in helpers)
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise BadModel(f"two actuators are named '{twice}': leave one out or give it another name")
    if not any(muscle.enabled for muscle in model.muscles):
        raise BadModel(f"model '{model.name}' has no muscle that is switched on")
    refuse_open(tree, coordinates)
    tau = _torques_of(tree, motion, torques) - joint_forces(tree, coordinates, rates)
    return TensionProblem(tree, helpers, options, coordinates, rates, tau), names


def _torques_of(tree: Tree, motion: Motion, torques: Series) -> Array:
    if len(torques) != len(motion) or np.max(np.abs(torques.time - motion.time), initial=0.0) > 1e-6:
        raise BadData(
            f"torques have {len(torques)} frames from {torques.time[:1]} s, the motion {len(motion)} from "
            f"{motion.time[:1]} s: both must have the same times"
        )
    needed = set(free_coordinates(tree.model))
    columns = {name: i for i, name in enumerate(torques.names)}
    found = np.zeros((len(motion), len(tree.model.coordinates)))
    for j, name in enumerate(tree.model.coordinate_names):
        if name in columns:
            found[:, j] = torques.values[:, columns[name]]
        elif name in needed:
            raise UnknownName("coordinate", name, torques.names, "the table of torques")
    return found


class TensionProblem:
    """The problem of all frames: shared data and results, set up and solved chunk by chunk.

    Attributes
    ----------
    assembly : pattern of A and what fills it
    separable : weights, exponents and bounds of the variables: activations, then controls
    """

    def __init__(
        self,
        tree: Tree,
        actuators: tuple[Actuator, ...],
        options: TensionOptions,
        coordinates: Array,
        rates: Array,
        torques: Array,
    ):
        muscles = tree.model.muscles
        self._options = options
        self._coordinates, self._rates, self._tau = coordinates, rates, torques
        self._hill = compile_hill(tree.model)
        self._paths = compile_paths(tree.model)
        basis = loop_basis(tree, coordinates) if tree.model.loops else None
        self._slopes = loop_slopes(basis, coordinates)
        self.assembly = assemble(self._paths, actuators, basis)
        self._enabled = np.array([one.enabled for one in muscles])
        self._viscosity = viscosities(tree.model) * options.viscous
        self._strength = np.array([one.max_isometric_force for one in muscles])
        # A muscle that is switched off has no force, so its activation must not be free.
        self._lower = np.where(self._enabled, [one.min_activation for one in muscles], 0.0)
        self._upper = np.where(self._enabled, [one.max_activation for one in muscles], 0.0)
        self.separable = self._variables(actuators)
        frames = len(coordinates)
        self._activations = np.empty((frames, len(muscles)))
        self._forces = np.empty((frames, len(muscles)))
        self._viscous = np.empty((frames, len(muscles)))
        self._reserves = np.empty((frames, len(actuators)))
        self._balanced = np.empty((frames, len(self.assembly.rows)))
        self._imbalance = np.empty(frames)
        self._iterations = np.empty(frames, np.int64)
        self._status = np.empty(frames, np.int8)
        self._overstretched: list[np.ndarray] = []

    def _variables(self, actuators: tuple[Actuator, ...]) -> Separable:
        """Weights, exponents and bounds of all variables, checked."""
        muscles = self.assembly.tree.model.muscles
        lower = np.concatenate([self._lower, [one.min_control for one in actuators]])
        upper = np.concatenate([self._upper, [one.max_control for one in actuators]])
        names = [one.name for one in muscles] + [one.name for one in actuators]
        for name, least, most in zip(names, lower, upper, strict=True):
            if not least <= most:
                raise BadModel(f"'{name}' has bounds {least:g} ... {most:g}: the first must not be greater")
        weight = np.ones(len(lower))
        if self._options.weights == "volume":
            volume = self._strength * [one.optimal_fiber_length for one in muscles]
            weight[: len(muscles)] = volume / volume[self._enabled].mean()
        shape = self.assembly.pattern
        exponent = np.full(len(lower), self._options.exponent)
        return Separable(shape.start, shape.row, shape.first, weight, exponent, lower, upper)

    def balance(self, start: int, stop: int) -> tuple[Array, Array, Array, Array]:
        """A and b of the frames start ... stop - 1, and what the muscles can pull with.

        Returns
        -------
        values, right : (frames, entries) of A and (frames, rows) b, in the order of the pattern
        active, passive : (frames, muscles) force per unit activation and passive elastic force [N]
        """
        assembly, part, frames = self.assembly, slice(start, stop), stop - start
        muscles = len(self._lower)
        c = np.ascontiguousarray(self._coordinates[part])
        lengths, speeds, arms = self._paths.evaluate(c, self._rates[part])
        entries = np.hstack([arms, actuator_entries(assembly, c)])
        active, passive = np.empty((frames, muscles)), np.empty((frames, muscles))
        options = self._options
        fill_hill_forces(self._hill, lengths, speeds, options.convention, options.passive, active, passive)
        if self._options.curves == "constant":
            active[:] = np.where(np.isnan(active), np.nan, self._strength)
        active *= self._enabled
        passive *= self._enabled
        viscous = self._viscosity * speeds
        self._viscous[part] = viscous
        forces = np.hstack([active, np.broadcast_to(assembly.optimal_forces, (frames, len(assembly.optimal_forces)))])
        values, right = np.empty((frames, len(self.separable.row))), np.empty((frames, len(assembly.rows)))
        slopes = self._slopes[part]
        fold(assembly.tree.arrays, assembly.links, c, slopes, entries, forces, self._tau[part], values, right)
        self._balanced[part] = right[:, np.argsort(assembly.pattern.order)]
        take_off(assembly.tree.arrays, assembly.links, c, slopes, entries, passive + viscous, right)
        return values, right, active, passive

    def solve(self, start: int, stop: int) -> None:
        """Solve the frames start ... stop - 1."""
        part, muscles = slice(start, stop), len(self._lower)
        values, right, active, passive = self.balance(start, stop)
        x, y = np.empty((stop - start, len(self.separable.weight))), np.empty(right.shape)
        solve_separable(
            self.separable,
            values,
            right,
            np.zeros((1, x.shape[1])),
            no_wells(x.shape[1]),
            no_links(),
            np.zeros(right.shape[1]),
            x,
            y,
            self._imbalance[part],
            self._iterations[part],
            self._status[part],
        )
        self._overstretched.append(np.flatnonzero((passive > self._strength).any(axis=0)))
        self._activations[part] = x[:, :muscles]
        self._forces[part] = active * x[:, :muscles] + passive + self._viscous[part]
        self._reserves[part] = x[:, muscles:] * self.assembly.optimal_forces

    def result(self, time: Array, names: tuple[str, ...]) -> Tension:
        """What was found, as a value."""
        stretched = np.unique(np.concatenate([*self._overstretched, np.zeros(0, np.int64)]))
        all_names = self.assembly.tree.model.muscle_names
        return Tension(
            time=time,
            muscles=all_names,
            activations=self._activations,
            forces=self._forces,
            reserve_names=names,
            reserves=self._reserves,
            coordinates=self.assembly.rows,
            torques=self._balanced,
            imbalance=self._imbalance,
            status=self._status,
            iterations=self._iterations,
            lower=self._lower,
            upper=self._upper,
            overstretched=tuple(all_names[i] for i in stretched),
            options=self._options,
            viscous=self._viscous,
        )
