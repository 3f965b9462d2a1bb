"""The tension problem of all frames: the sum of its terms, who solves it, and what comes out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.contacts import ContactForces
from myomorph.model.errors import BadData, BadModel, UnknownName
from myomorph.model.model import Actuator, Model
from myomorph.model.series import Motion, Series
from myomorph.motion.sync import refuse_other_times
from myomorph.muscles.passive import joint_forces
from myomorph.rigid.dynamics import rates_of
from myomorph.rigid.frames import CHUNK, over_frames
from myomorph.rigid.loops import loop_basis, loop_slopes, refuse_open
from myomorph.rigid.tree import Tree, compile_tree
from myomorph.tension.assembly import assemble, fold
from myomorph.tension.dual import OPTIMAL, solve_separable
from myomorph.tension.separable import Links, Separable, no_links
from myomorph.tension.tension import PassivePeaks, Tension, TensionOptions, passive_peaks
from myomorph.tension.terms.actuators import ActuatorTerm, default_reserves, free_coordinates
from myomorph.tension.terms.contacts import ContactTask, ContactTerm, contact_terms
from myomorph.tension.terms.emg import EmgTarget
from myomorph.tension.terms.muscles import HIGHEST_POWER, MuscleTerm
from myomorph.tension.terms.term import Columns, Frames, Term, Unknowns, Variables, added_up, joined


@dataclass(frozen=True, eq=False)
class TensionInputs:
    """What `solve_tension` takes, which says what each is."""

    model: Model
    motion: Motion
    torques: Series
    options: TensionOptions = field(default_factory=TensionOptions)
    actuators: Sequence[Actuator] | None = None
    contacts: ContactTask | None = None
    emg: EmgTarget | None = None
    terms: Sequence[Term] = ()

    def enabled_actuators(self) -> tuple[Actuator, ...]:
        """The model's own and those that are added, which replace those of the same name."""
        model, added = self.model, self.actuators
        if added is None:
            added = default_reserves(model, self.options.reserve, self.options.residual)
        replaced = {actuator.name for actuator in added}
        kept = [actuator for actuator in model.actuators if actuator.name not in replaced]
        enabled = tuple(actuator for actuator in (*kept, *added) if actuator.enabled)
        names = [actuator.name for actuator in enabled]
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise BadModel(f"two actuators are named '{twice}': leave one out or give it another name")
        return enabled


def tension_problem(inputs: TensionInputs, only: Collection[str] | None = None) -> TensionProblem:
    """What `solve_tension` solves with rigid tendons, set up but not solved; errors are those of it.
    With contacts it is the problem that finds their forces, with passive forces by `ContactOptions.contact_passive`.
    Further terms may speak of contacts and muscles alike: with any, one problem finds both by the options as they are.
    `only`: coordinates whose equations are kept, where not all are.
    """
    if inputs.contacts is not None and not inputs.terms and inputs.options.tendons == "rigid":
        options = replace(inputs.options, passive=inputs.contacts.options.contact_passive)
        inputs = replace(inputs, options=options)
    return TensionProblem(inputs, MuscleTerm(compile_tree(inputs.model), inputs.options), only)


def _torques_of(tree: Tree, motion: Motion, torques: Series) -> Array:
    refuse_other_times("torques", torques.time, motion.time)
    needed = set(free_coordinates(tree.model))
    columns = {name: i for i, name in enumerate(torques.names)}
    result = np.zeros((len(motion), len(tree.model.coordinates)))
    for j, name in enumerate(tree.model.coordinate_names):
        if name in columns:
            result[:, j] = torques.values[:, columns[name]]
        elif name in needed:
            raise UnknownName("coordinate", name, torques.names, "the table of torques")
    return result


class Balance(NamedTuple):
    """A x = b of some frames, and what the muscles can pull with."""

    # values, right: (frames, entries) of A and (frames, rows) b, in the order of the pattern
    values: Array
    right: Array
    # active, passive, viscous: (frames, muscles) force per unit activation, passive elastic and viscous force [N]
    active: Array
    passive: Array
    viscous: Array
    torques: Array  # (frames, coordinates) of the rows, passive and viscous forces of muscles not taken off [N m or N]


SolvedSeparable = tuple[Array, Array, Array, np.ndarray, np.ndarray]


def solve_frames(
    shared: Separable,
    values: Array,
    right: Array,
    penalties: Array,
    *,
    targets: Array | None = None,
    links: Links | None = None,
    warm: Array | None = None,
) -> SolvedSeparable:
    """Unknowns (frames, n), multipliers (frames, rows), residual, iterations and status; see `solve_separable`."""
    frames, count = len(right), len(shared.weight)
    x, y = np.empty((frames, count)), np.empty(right.shape)
    residual, iterations, status = np.empty(frames), np.empty(frames, np.int64), np.empty(frames, np.int8)
    targets, links = np.zeros((1, count)) if targets is None else targets, links or no_links()
    warm = np.zeros(right.shape[1]) if warm is None else warm
    solve_separable(shared, values, right, targets, penalties, links, warm, x, y, residual, iterations, status)
    return x, y, residual, iterations, status


class TensionProblem:
    """The problem of all frames: the sum of its terms, set up and solved chunk by chunk.
    `terms`: all that the problem is made of; `muscles`, `actuators`, `contacts`: the terms of these; contacts are None
    for none; `unknowns`: of all terms: activations, controls, amplitudes of contacts, others; those of rows come behind
    them; `assembly`: pattern of A and what fills it; `rows`: what terms add to the rows of the coordinates;
    `separable`: weights, exponents and bounds of all unknowns; `options`: settings; `coordinates` (frames, coordinates)
    all values; `penalties`: interval penalties of all unknowns; `smooth`: how frames are linked, None where they are
    not; `window`: frames that are solved together.
    """

    def __init__(self, inputs: TensionInputs, muscles: MuscleTerm, only: Collection[str] | None = None):
        model, motion, options = inputs.model, inputs.motion, inputs.options
        tree, self.options, self.muscles = compile_tree(model), options, muscles
        coordinates, self._rates = rates_of(tree, motion)
        self.coordinates = coordinates
        enabled = inputs.enabled_actuators()
        if inputs.contacts is None and not any(muscle.enabled for muscle in model.muscles):
            raise BadModel(f"model '{model.name}' has no muscle that is switched on")
        refuse_open(tree, coordinates)
        self._tau = _torques_of(tree, motion, inputs.torques) - joint_forces(tree, coordinates, self._rates)
        time = self._time = np.array(motion.time)
        self.contacts = None if inputs.contacts is None else ContactTerm(tree, time, inputs.contacts)
        self.actuators = ActuatorTerm(tree, enabled, options.exponent if options.exponent <= HIGHEST_POWER else 2.0)
        measured = () if self.contacts is None else contact_terms(self.contacts)
        known = () if inputs.emg is None else (inputs.emg,)
        terms: tuple[Term, ...] = (muscles, self.actuators, *measured, *known, *inputs.terms)
        self.terms = terms
        parts = [term.variables() for term in terms]
        all_variables = joined(parts)
        first = np.cumsum([0, *(len(part) for part in parts)]).tolist()
        places = tuple(slice(*ends) for ends in pairwise(first))
        self.unknowns = Unknowns(all_variables.names, model.muscle_names, time, terms, places)
        basis = loop_basis(tree, coordinates) if model.loops else None
        self._slopes = loop_slopes(basis, coordinates)
        self._adding = [(term, rows) for term in terms if (rows := term.rows(self.unknowns)) is not None]
        self.rows = [rows for _, rows in self._adding]
        entries = [(first[number] + i, j) for number, term in enumerate(terms) for i, j in term.entries()]
        self.assembly = assemble(tree, entries, len(all_variables), self.rows, basis, only)
        self.separable = self._separable(all_variables)
        penalties = [drawn for term in terms if (drawn := term.penalties(self.unknowns)) is not None]
        self.penalties = added_up(penalties, self.unknowns, len(self.separable.weight))
        linked = [links for term in terms if (links := term.smoothing(self.unknowns)) is not None]
        if len(linked) > 1:
            raise BadData(f"{len(linked)} terms of the tension problem link frames: expected one")
        self.smooth = linked[0] if linked else None
        self.window = CHUNK if self.smooth is None else self.smooth.window
        frames, count = len(coordinates), len(model.muscles)
        # Activations lie apart from the other unknowns: they become a part of the result as they are.
        self._activations = np.empty((frames, count))
        self._others = np.empty((frames, len(self.separable.weight) - count))
        self._forces = np.empty((frames, count))
        self._viscous = np.empty((frames, count)) if muscles.viscous else np.zeros((1, 1))
        sites = 0 if self.contacts is None else len(self.contacts.generators.sites)
        self._contact_forces = np.empty((3, frames, sites, 3))
        self._balanced = np.empty((frames, len(self.assembly.rows)))
        self._residual = np.empty(frames)
        self._iterations = np.empty(frames, np.int64)
        self._status = np.empty(frames, np.int8)
        self._passive = np.empty((frames, count if options.passive else 0))

    def _separable(self, variables: Variables) -> Separable:
        """Weights, exponents and bounds of all unknowns, checked."""
        for name, low, high in zip(variables.names, variables.lower, variables.upper, strict=True):
            if not low <= high:
                raise BadModel(f"'{name}' has bounds {low:g} ... {high:g}: the first must not be greater")
        parts = [Variables(row.names, row.weight, np.full(len(row), 2.0), row.lower, row.upper) for row in self.rows]
        every, shape = joined([variables, *parts]), self.assembly.pattern
        costs = (every.weight, every.exponent, every.lower, every.upper)
        if self.options.recruitment == "minmax":
            # Muscles that work at the common bound tie all coordinates together: no envelope to keep to.
            return Separable(shape.start, shape.row, 0 * shape.first, *costs, len(self.muscles.strength), 1.0)
        return Separable(shape.start, shape.row, shape.first, *costs)

    @property
    def amplitudes(self) -> Array:
        """(frames, generators) of contacts, filled by `solve`."""
        return self._others[:, :0] if self.contacts is None else self._others[:, self._place(self.contacts)]

    @property
    def x(self) -> Array:
        """(frames, unknowns and those of rows), filled by `solve`; a copy."""
        return self.x_of(slice(None))

    def x_of(self, frames: slice | np.ndarray) -> Array:
        """The unknowns of some frames, and those of rows."""
        return np.concatenate([self._activations[frames], self._others[frames]], axis=1)

    def _place(self, term: Term) -> slice:
        """Where the unknowns of a term lie behind the activations."""
        place, muscles = self.unknowns.of(term), self._activations.shape[1]
        return slice(place.start - muscles, place.stop - muscles)

    def balance(self, start: int, stop: int) -> Balance:
        """What the frames start ... stop - 1 have to balance."""
        assembly, part, count = self.assembly, slice(start, stop), stop - start
        c = np.ascontiguousarray(self.coordinates[part])
        frames = Frames(part, c, self._rates[part])
        columns = [term.columns(frames) for term in self.terms]
        entries, forces = (np.hstack([getattr(column, name) for column in columns]) for name in ("entries", "forces"))
        values, whole = np.empty((count, len(self.separable.row))), np.zeros((count, len(assembly.pattern.order)))
        inputs, right = (c, self._slopes[part], entries, forces, _given(columns), self._tau[part]), np.empty_like(whole)
        fold(assembly.tree.arrays, assembly.links, *inputs, values, whole, right)
        if self._adding:
            filled = [item.row_values(rows, frames) for item, rows in self._adding]
            units = np.concatenate([row.unit for row in self.rows])
            own = np.broadcast_to(-units, (count, len(assembly.extra_row)))
            values[:, assembly.extra_place] = np.hstack([*(row for row, _ in filled), own])
            right[:, assembly.extra_row] = np.hstack([row for _, row in filled])
        muscles = self.muscles.forces(frames)
        torques = whole[:, assembly.coordinate_row]
        return Balance(values, right, muscles.active, muscles.passive, muscles.viscous, torques)

    def solve(self, start: int, stop: int) -> None:
        """Solve the frames start ... stop - 1."""
        margin = 0 if self.smooth is None else self.smooth.margin
        begin, end = max(start - margin, 0), min(stop + margin, len(self._time))
        balance = self.balance(begin, end)
        kept, part = slice(start - begin, stop - begin), slice(start, stop)
        x, _, residual, iterations, status = (array[kept] for array in self.solved(balance, begin))
        self._residual[part], self._iterations[part], self._status[part] = residual, iterations, status
        self._store(part, x, Balance(*(array[kept] for array in balance)))

    def solve_all(self, progress: Callable[[int], None] | None = None) -> Tension:
        """Solve all frames; `progress` is called with the number of frames just done."""
        over_frames(self.solve, len(self._time), progress, self.window)
        return self.result()

    def renew(self, coordinates: Array, rates: Array, torques: Array) -> None:
        """Put other frames in the place of those that were given, as many.
        `coordinates`, `rates`, `torques` (frames, coordinates) consistent, torques of inverse dynamics [N m or N].
        """
        self.coordinates[:], self._rates[:] = coordinates, rates
        self._tau[:] = torques
        self._tau -= joint_forces(self.assembly.tree, coordinates, rates)

    def solved(self, balance: Balance, begin: int = 0, warm: Array | None = None) -> SolvedSeparable:
        """Unknowns of some frames (frames, n), multipliers (frames, rows), residual, iterations and status.
        `balance`: what to balance in the frames from `begin` on; `warm` (rows,) multipliers to begin with, afterwards
        those of the last frame; None for none.
        """
        links = None if self.smooth is None else self.smooth.links(begin, begin + len(balance.right))
        penalties = self.penalties[begin : begin + len(balance.right)]
        return solve_frames(self.separable, balance.values, balance.right, penalties, links=links, warm=warm)

    def _store(self, part: slice, x: Array, balance: Balance) -> None:
        """Keep what was found in some frames."""
        muscles = self._forces.shape[1]
        self._activations[part], self._others[part] = x[:, :muscles], x[:, muscles:]
        self._forces[part] = balance.active * x[:, :muscles] + balance.passive + balance.viscous
        self._balanced[part] = balance.torques
        if self.muscles.viscous:
            self._viscous[part] = balance.viscous
        if self.options.passive:
            self._passive[part] = balance.passive
        if self.contacts is not None:
            place = (part, self.coordinates[part], self.amplitudes[part])
            self._contact_forces[:, part] = self.contacts.forces_of(*place)

    def result(self) -> Tension:
        """What was found, as a value."""
        peaks = PassivePeaks(*np.zeros((2, self._forces.shape[1])))
        if self.options.passive:
            peaks = passive_peaks(self._passive, self.muscles.strength, self._time)
        all_names = self.assembly.tree.model.muscle_names
        outcome = None
        if self.contacts is not None:
            sites, ready = self.contacts.generators.sites, self.contacts.activations
            outcome = ContactForces(self._time, sites, ready, *self._contact_forces)
        controls = self._others[:, self._place(self.actuators)]
        return Tension(
            time=self._time,
            muscles=all_names,
            activations=self._activations,
            forces=self._forces,
            reserve_names=tuple(actuator.name for actuator in self.actuators.actuators),
            reserves=controls * self.actuators.optimal_forces,
            coordinates=self.assembly.rows,
            torques=self._balanced,
            equilibrium_residual=self._residual,
            status=self._status,
            iterations=self._iterations,
            lower=self.muscles.lower,
            upper=self.muscles.upper,
            overstretched=tuple(all_names[i] for i in np.flatnonzero(peaks.share > 1.0)),
            options=self.options,
            viscous=self._viscous,
            passive_share=peaks.share,
            passive_time=peaks.time,
            contacts=outcome,
        )


def _given(columns: Sequence[Columns]) -> Array:
    """Forces that act whatever the unknowns are, (frames, unknowns up to the last that has any)."""
    last = max((index for index, column in enumerate(columns) if column.given is not None), default=-1)
    parts = [np.zeros_like(column.forces) if column.given is None else column.given for column in columns[: last + 1]]
    return np.hstack([np.zeros((len(columns[0].forces), 0)), *parts])


@read_only
class TensionFrame:
    """What one frame gives."""

    # activations, forces: (muscles,) NaN where the frame was not solved; along the tendons [N]
    activations: Array
    forces: Array
    reserves: Array  # (actuators,) their forces [N] and torques [N m]
    balanced: Array  # (rows,) what muscles and actuators had to give together, in the order of `OnlineTension.rows`
    status: int  # index into `STATUS_NAMES`
    equilibrium_residual: float  # greatest torque or force left unbalanced [N m or N]


class OnlineTension:
    """The problem of `solve_tension`, set up once.
    `actuators`: as of `solve_tension`. `muscles`, `actuators`: names; `rows`: names of the coordinates that are
    balanced; `lower`, `upper` (muscles,) bounds of the activations.
    """

    def __init__(
        self, model: Model, options: TensionOptions | None = None, actuators: Sequence[Actuator] | None = None
    ):
        if model.loops:
            raise BadModel(
                f"model '{model.name}' closes loops ('{model.loops[0].name}'), which muscle tensions frame by frame do "
                "not take: use 'myomorph tension' after the recording"
            )
        rest = np.array([[coordinate.default for coordinate in model.coordinates]])
        still = Motion(np.zeros(1), model.coordinate_names, rest, np.zeros_like(rest))
        none = Series(np.zeros(1), model.coordinate_names, np.zeros_like(rest))
        self._problem = tension_problem(TensionInputs(model, still, none, options or TensionOptions(), actuators))
        self.actuators = tuple(actuator.name for actuator in self._problem.actuators.actuators)
        self.muscles = model.muscle_names
        self.rows = self._problem.assembly.rows
        shared, muscles = self._problem.separable, len(self.muscles)
        self.lower, self.upper = shared.lower[:muscles], shared.upper[:muscles]
        self._optimal_forces = self._problem.actuators.optimal_forces
        self._warm = np.zeros(len(self._problem.assembly.pattern.order))

    def solve(self, coordinates: Array, rates: Array, torques: Array) -> TensionFrame:
        """Share torques of a frame among muscles; all (1, coordinates), consistent, of inverse dynamics [N m or N]."""
        self._problem.renew(coordinates, rates, torques)
        balance = self._problem.balance(0, 1)
        x, _, residual, _, status = self._problem.solved(balance, 0, self._warm)
        if status[0] != OPTIMAL:
            self._warm[:] = 0.0
        muscles = len(self.muscles)
        activations = x[0, :muscles]
        forces = balance.active[0] * activations + balance.passive[0] + balance.viscous[0]
        reserves = x[0, muscles:] * self._optimal_forces
        return TensionFrame(activations, forces, reserves, balance.torques[0], int(status[0]), float(residual[0]))
