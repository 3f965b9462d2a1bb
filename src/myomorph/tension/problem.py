"""The tension problem of all frames: what fills it, who solves it, and what comes out."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.contacts import ContactForces
from myomorph.model.errors import BadData, BadModel, UnknownName
from myomorph.model.model import Actuator, Model
from myomorph.model.series import Motion, Series
from myomorph.muscles.hill import fill_hill_forces, viscosities
from myomorph.muscles.hill_arrays import compile_hill
from myomorph.muscles.passive import joint_forces
from myomorph.muscles.path import compile_paths
from myomorph.rigid.closed_motion import loop_slopes, refuse_open
from myomorph.rigid.dynamics import rates_of
from myomorph.rigid.frames import CHUNK
from myomorph.rigid.loops import loop_basis
from myomorph.rigid.tree import Tree, compile_tree
from myomorph.tension.actuators import default_reserves, free_coordinates
from myomorph.tension.assembly import actuator_entries, assemble, fold, take_off
from myomorph.tension.contact_rows import ContactTerms, contact_terms
from myomorph.tension.contacts import ContactTask
from myomorph.tension.dual import solve_separable
from myomorph.tension.emg import EmgTarget
from myomorph.tension.emg_wells import emg_wells
from myomorph.tension.separable import Separable, no_links
from myomorph.tension.smoothing import Smoothing, smoothing
from myomorph.tension.tension import Tension, TensionOptions


def tension_problem(
    model: Model,
    motion: Motion,
    torques: Series,
    options: TensionOptions | None = None,
    actuators: Sequence[Actuator] | None = None,
    *,
    contacts: ContactTask | None = None,
    emg: EmgTarget | None = None,
    only: Collection[str] | None = None,
) -> tuple[TensionProblem, tuple[str, ...]]:
    """What `solve_tension` solves, set up but not solved, and the names of the actuators.

    Parameters
    ----------
    only : coordinates whose equations are kept, where not all are
    """
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
    if contacts is None and not any(muscle.enabled for muscle in model.muscles):
        raise BadModel(f"model '{model.name}' has no muscle that is switched on")
    refuse_open(tree, coordinates)
    tau = _torques_of(tree, motion, torques) - joint_forces(tree, coordinates, rates)
    time = np.array(motion.time)
    terms = contact_terms(tree, time, contacts) if contacts is not None else None
    return TensionProblem(tree, helpers, options, time, coordinates, rates, tau, terms, emg, only), names


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


STILL = 1e-6
"""Cost of u^2 that controls have besides |u|^p where p > 2: near 0 that power alone has no curvature to step by."""


class Balance(NamedTuple):
    """A x = b of some frames, and what the muscles can pull with.

    Attributes
    ----------
    values, right : (frames, entries) of A and (frames, rows) b, in the order of the pattern
    active, passive, viscous : (frames, muscles) force per unit activation, passive elastic and viscous force [N]
    torques : (frames, coordinates) of the rows, passive and viscous forces of muscles not taken off [N m or N]
    """

    values: Array
    right: Array
    active: Array
    passive: Array
    viscous: Array
    torques: Array


class TensionProblem:
    """The problem of all frames: shared data and results, set up and solved chunk by chunk.

    Attributes
    ----------
    assembly : pattern of A and what fills it
    separable : weights, exponents and bounds of the variables: activations, controls, amplitudes of contacts' edges,
        and the own variables of the rows that contacts add
    options : settings
    coordinates : (frames, coordinates) all values
    actuators : the model's and those added, in the order of their controls
    contacts : what contacts add, None for nothing
    emg : what is known of activations, None for nothing
    wells : what draws activations to EMG, as of `solve_separable`
    smooth : how frames are linked, None where they are not
    window : frames that are solved together
    amplitudes : (frames, edges) of contacts, filled by `solve`
    """

    def __init__(
        self,
        tree: Tree,
        actuators: tuple[Actuator, ...],
        options: TensionOptions,
        time: Array,
        coordinates: Array,
        rates: Array,
        torques: Array,
        contacts: ContactTerms | None = None,
        emg: EmgTarget | None = None,
        only: Collection[str] | None = None,
    ):
        muscles = tree.model.muscles
        self.options, self._time = options, time
        self.coordinates, self._rates, self._tau = coordinates, rates, torques
        self._hill = compile_hill(tree.model)
        self._paths = compile_paths(tree.model)
        basis = loop_basis(tree, coordinates) if tree.model.loops else None
        self._slopes = loop_slopes(basis, coordinates)
        self.actuators, self.contacts, self.emg = actuators, contacts, emg
        self.assembly = assemble(self._paths, actuators, basis, contacts, only)
        self._enabled = np.array([one.enabled for one in muscles], dtype=np.bool_)
        self._viscosity = viscosities(tree.model) * options.viscous
        self._strength = np.array([one.max_isometric_force for one in muscles], dtype=np.float64)
        # A muscle that is switched off has no force, so its activation must not be free.
        self._lower = np.where(self._enabled, [one.min_activation for one in muscles], 0.0)
        self._upper = np.where(self._enabled, [one.max_activation for one in muscles], 0.0)
        self.separable = self._variables(actuators)
        self.wells = emg_wells(emg, tree.model.muscle_names, len(self.separable.weight), len(coordinates))
        if options.exponent > 2.0:
            self.wells.base[2, len(muscles) : len(muscles) + len(actuators)] = STILL
        self.smooth: Smoothing | None = smoothing(contacts, time) if contacts is not None else None
        self.window = CHUNK if self.smooth is None else self.smooth.window
        frames, edges = len(coordinates), 0 if contacts is None else len(contacts.columns)
        self._activations = np.empty((frames, len(muscles)))
        self._forces = np.empty((frames, len(muscles)))
        self._viscous = np.empty((frames, len(muscles)))
        self._reserves = np.empty((frames, len(actuators)))
        self.amplitudes = np.empty((frames, edges))
        self._contact_forces = np.empty((3, frames, 0 if contacts is None else len(contacts.columns.sites), 3))
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
        if self.options.weights == "volume" and self._enabled.any():
            volume = self._strength * [one.optimal_fiber_length for one in muscles]
            weight[: len(muscles)] = volume / volume[self._enabled].mean()
        shape = self.assembly.pattern
        exponent = np.full(len(lower), self.options.exponent)
        if self.contacts is not None:
            edges, extra = self.contacts.columns, self.contacts.extra
            weight = np.concatenate([weight, self.contacts.cost, extra.weight])
            exponent = np.concatenate([exponent, np.full(len(edges) + len(extra), 2.0)])
            lower = np.concatenate([lower, edges.lower, extra.lower])
            upper = np.concatenate([upper, np.full(len(edges), np.inf), extra.upper])
        return Separable(shape.start, shape.row, shape.first, weight, exponent, lower, upper)

    def balance(self, start: int, stop: int) -> Balance:
        """What the frames start ... stop - 1 have to balance."""
        assembly, part, frames = self.assembly, slice(start, stop), stop - start
        muscles = len(self._lower)
        c = np.ascontiguousarray(self.coordinates[part])
        lengths, speeds, arms = self._paths.evaluate(c, self._rates[part])
        active, passive = np.empty((frames, muscles)), np.empty((frames, muscles))
        options = self.options
        fill_hill_forces(self._hill, lengths, speeds, options.convention, options.passive, active, passive)
        if self.options.curves == "constant":
            active[:] = np.where(np.isnan(active), np.nan, self._strength)
        active *= self._enabled
        passive *= self._enabled
        viscous = self._viscosity * speeds
        entries = [arms, actuator_entries(assembly, c)]
        forces = [active, np.broadcast_to(assembly.optimal_forces, (frames, len(assembly.optimal_forces)))]
        if self.contacts is not None:
            columns, places, pushes, turns = self.contacts.columns.evaluate(c)
            entries.append(columns)
            forces.append(self.contacts.amounts[part])
        values, right = np.empty((frames, len(self.separable.row))), np.zeros((frames, len(assembly.pattern.order)))
        slopes = self._slopes[part]
        arrays, links, together = assembly.tree.arrays, assembly.links, np.hstack(entries)
        fold(arrays, links, c, slopes, together, np.hstack(forces), self._tau[part], values, right)
        torques = right[:, assembly.coordinate_row]
        take_off(arrays, links, c, slopes, together, passive + viscous, right)
        if self.contacts is not None:
            shared, right[:, assembly.extra_row] = self.contacts.rows(part, places, pushes, turns)
            own = np.broadcast_to(-self.contacts.extra.unit, (frames, len(self.contacts.extra)))
            values[:, assembly.extra_place] = np.hstack([shared, own])
        return Balance(values, right, active, passive, viscous, torques)

    def solve(self, start: int, stop: int) -> None:
        """Solve the frames start ... stop - 1."""
        margin = 0 if self.smooth is None else self.smooth.margin
        begin, end = max(start - margin, 0), min(stop + margin, len(self._time))
        given = self.balance(begin, end)
        kept, part = slice(start - begin, stop - begin), slice(start, stop)
        x, _, imbalance, iterations, status = (one[kept] for one in self.solved(given, begin))
        self._imbalance[part], self._iterations[part], self._status[part] = imbalance, iterations, status
        self._store(part, x, Balance(*(one[kept] for one in given)))

    def renew(self, coordinates: Array, rates: Array, torques: Array) -> None:
        """Put other frames in the place of those that were given, as many.

        Parameters
        ----------
        coordinates, rates, torques : (frames, coordinates) consistent, torques of inverse dynamics [N m or N]
        """
        self.coordinates[:], self._rates[:] = coordinates, rates
        self._tau[:] = torques
        self._tau -= joint_forces(self.assembly.tree, coordinates, rates)

    def solved(
        self, given: Balance, begin: int = 0, warm: Array | None = None
    ) -> tuple[Array, Array, Array, np.ndarray, np.ndarray]:
        """Variables of some frames (frames, n), multipliers (frames, rows), imbalance, iterations and status.

        Parameters
        ----------
        given : what to balance in the frames from `begin` on
        warm : (rows,) multipliers to begin with, afterwards those of the last frame; None for none
        """
        frames, variables = len(given.right), len(self.separable.weight)
        x, y = np.empty((frames, variables)), np.empty(given.right.shape)
        imbalance, iterations, status = np.empty(frames), np.empty(frames, np.int64), np.empty(frames, np.int8)
        linked = len(self._lower) + len(self.actuators)
        solve_separable(
            self.separable,
            given.values,
            given.right,
            np.zeros((1, variables)),
            self.wells[begin : begin + frames],
            no_links() if self.smooth is None else self.smooth.links(begin, begin + frames, linked),
            np.zeros(given.right.shape[1]) if warm is None else warm,
            x,
            y,
            imbalance,
            iterations,
            status,
        )
        return x, y, imbalance, iterations, status

    def _store(self, part: slice, x: Array, given: Balance) -> None:
        """Keep what was found in some frames."""
        muscles = len(self._lower)
        controls = muscles + len(self.actuators)
        self._overstretched.append(np.flatnonzero((given.passive > self._strength).any(axis=0)))
        self._activations[part] = x[:, :muscles]
        self._forces[part] = given.active * x[:, :muscles] + given.passive + given.viscous
        self._viscous[part], self._balanced[part] = given.viscous, given.torques
        self._reserves[part] = x[:, muscles:controls] * self.assembly.optimal_forces
        if self.contacts is not None:
            self.amplitudes[part] = x[:, controls : controls + self.amplitudes.shape[1]]
            self._contact_forces[:, part] = self.contacts.forces_of(part, self.coordinates[part], self.amplitudes[part])

    def result(self, names: tuple[str, ...]) -> Tension:
        """What was found, as a value; `names` are those of the actuators."""
        stretched = np.unique(np.concatenate([*self._overstretched, np.zeros(0, np.int64)]))
        all_names = self.assembly.tree.model.muscle_names
        found = None
        if self.contacts is not None:
            forces, points, torques = self._contact_forces
            found = ContactForces(
                self._time, self.contacts.columns.sites, self.contacts.strengths, forces, points, torques
            )
        return Tension(
            time=self._time,
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
            options=self.options,
            viscous=self._viscous,
            contacts=found,
        )
