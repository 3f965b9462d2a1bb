"""The tension problem of all frames: the sum of its terms, who solves it, and what comes out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import ContactForces
from myomorph.core.model.errors import BadData, BadModel, UnknownName
from myomorph.core.model.model import Actuator, Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.motion.sync import refuse_other_times
from myomorph.core.muscles.passive import joint_forces
from myomorph.core.rigid.dynamics import rates_of
from myomorph.core.rigid.frames import CHUNK, over_frames
from myomorph.core.rigid.loops import loop_basis, loop_slopes, refuse_open
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.core.tension.assembly import assemble, fold
from myomorph.core.tension.dual import OPTIMAL, solve_separable
from myomorph.core.tension.separable import Links, Separable, no_links
from myomorph.core.tension.tension import PassivePeaks, Tension, TensionOptions, passive_peaks
from myomorph.core.tension.terms.actuators import ActuatorTerm, default_reserves, free_coordinates
from myomorph.core.tension.terms.contacts import ContactTask, ContactTerm, contact_terms
from myomorph.core.tension.terms.emg import EmgTarget
from myomorph.core.tension.terms.muscles import HIGHEST_POWER, MuscleTerm
from myomorph.core.tension.terms.term import (
    Columns,
    Frames,
    IntervalPenalties,
    Smoothing,
    Term,
    Unknowns,
    Variables,
    added_up,
    joined,
)


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
        model = self.model
        added = self.actuators
        if added is None:
            added = default_reserves(model, self.options.reserve, self.options.residual)
        replaced = {actuator.name for actuator in added}
        kept = [actuator for actuator in model.actuators if actuator.name not in replaced]
        enabled = tuple(actuator for actuator in (*kept, *added) if actuator.enabled)
        names = [actuator.name for actuator in enabled]
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise BadModel(
                f"two actuators are named '{twice}': leave one out or give it another name"
            )
        return enabled


def tension_problem(inputs: TensionInputs, only: Collection[str] | None = None) -> TensionProblem:
    """What `solve_tension` solves with rigid tendons, set up but not solved; errors are those of
    it. With contacts it is the problem that finds their forces, with passive forces by
    `ContactOptions.contact_passive`. Further terms may speak of contacts and muscles alike: with
    any, one problem finds both by the options as they are. `only`: coordinates whose equations are
    kept, where not all are.
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
    """A x = b of some frames, and the forces that muscles can pull with.

    Attributes
    ----------
    values : (frames, entries) of A, in the order of the pattern
    right : (frames, rows) b
    active : (frames, muscles) force per unit activation [N]
    passive, viscous : (frames, muscles) passive elastic and viscous force [N]
    torques : (frames, coordinates) that all of them have to balance [N m or N]
    """

    values: Array
    right: Array
    active: Array
    passive: Array
    viscous: Array
    torques: Array


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
    """Unknowns (frames, n), multipliers (frames, rows), residual, iterations and status; see
    `solve_separable`.
    """
    frames = len(right)
    count = len(shared.weight)
    x = np.empty((frames, count))
    y = np.empty(right.shape)
    residual = np.empty(frames)
    iterations = np.empty(frames, np.int64)
    status = np.empty(frames, np.int8)
    if targets is None:
        targets = np.zeros((1, count))
    if links is None:
        links = no_links()
    if warm is None:
        warm = np.zeros(right.shape[1])
    solve_separable(
        shared, values, right, targets, penalties, links, warm, x, y, residual, iterations, status
    )
    return x, y, residual, iterations, status


def _adjoining_slices(counts: Sequence[int]) -> tuple[slice, ...]:
    """Slices of so many places each, one after the other."""
    ends = np.cumsum([0, *counts]).tolist()
    return tuple(slice(start, stop) for start, stop in pairwise(ends))


class TensionProblem:
    """The problem of all frames: the sum of its terms, set up and solved chunk by chunk.

    Attributes
    ----------
    options : settings
    coordinates : (frames, coordinates) of all coordinates, consistent [rad or m]
    terms : all that the problem is made of; `muscles`, `actuators` and `contacts` are among them
    contacts : None without contacts
    unknowns : of all terms: activations, controls, amplitudes of contacts, others
    rows : that terms add to the equations of the coordinates; their unknowns come last
    assembly : pattern of A and what fills it
    separable : weights, exponents and bounds of all unknowns, those of rows included
    penalties : interval penalties of all unknowns
    smooth : how frames are linked, None where they are not
    window : frames that are solved together
    """

    def __init__(
        self, inputs: TensionInputs, muscles: MuscleTerm, only: Collection[str] | None = None
    ):
        model = inputs.model
        tree = compile_tree(model)
        self.options = inputs.options
        self.muscles = muscles
        self.coordinates, self._rates = rates_of(tree, inputs.motion)
        enabled_actuators = inputs.enabled_actuators()
        if inputs.contacts is None and not any(muscle.enabled for muscle in model.muscles):
            raise BadModel(f"model '{model.name}' has no muscle that is switched on")
        refuse_open(tree, self.coordinates)

        # Springs and bushings of joints act whatever the muscles do: the rest is to be balanced.
        required = _torques_of(tree, inputs.motion, inputs.torques)
        self._torques = required - joint_forces(tree, self.coordinates, self._rates)
        self._time = np.array(inputs.motion.time)

        self.contacts = None
        if inputs.contacts is not None:
            self.contacts = ContactTerm(tree, self._time, inputs.contacts)
        exponent = self.options.exponent if self.options.exponent <= HIGHEST_POWER else 2.0
        self.actuators = ActuatorTerm(tree, enabled_actuators, exponent)
        self.terms = self._all_terms(inputs)

        parts = [term.variables() for term in self.terms]
        variables = joined(parts)
        places = _adjoining_slices([len(part) for part in parts])
        self.unknowns = Unknowns(
            names=variables.names,
            muscles=model.muscle_names,
            time=self._time,
            terms=self.terms,
            places=places,
        )
        asked_rows = [(term, term.rows(self.unknowns)) for term in self.terms]
        self._row_terms = [(term, rows) for term, rows in asked_rows if rows is not None]
        self.rows = [rows for _, rows in self._row_terms]

        basis = loop_basis(tree, self.coordinates) if model.loops else None
        self._slopes = loop_slopes(basis, self.coordinates)
        entries = [
            (place.start + unknown, coordinate)
            for term, place in zip(self.terms, places, strict=True)
            for unknown, coordinate in term.entries()
        ]
        self.assembly = assemble(tree, entries, len(variables), self.rows, basis, only)
        self.separable = self._separable(variables)
        self.penalties = self._all_penalties()
        self.smooth = self._smoothing()
        self.window = CHUNK if self.smooth is None else self.smooth.window
        self._allocate_results()

    def _all_terms(self, inputs: TensionInputs) -> tuple[Term, ...]:
        """Terms in the order of their unknowns; activations of muscles come first."""
        terms: list[Term] = [self.muscles, self.actuators]
        if self.contacts is not None:
            terms += contact_terms(self.contacts)
        if inputs.emg is not None:
            terms.append(inputs.emg)
        return (*terms, *inputs.terms)

    def _separable(self, variables: Variables) -> Separable:
        """Weights, exponents and bounds of all unknowns, checked.

        Parameters
        ----------
        variables : unknowns of all terms, without those of rows
        """
        for name, lower, upper in zip(
            variables.names, variables.lower, variables.upper, strict=True
        ):
            if not lower <= upper:
                raise BadModel(
                    f"'{name}' has bounds {lower:g} ... {upper:g}: the first must not be greater"
                )
        of_rows = [
            Variables(
                names=row.names,
                weight=row.weight,
                exponent=np.full(len(row), 2.0),
                lower=row.lower,
                upper=row.upper,
            )
            for row in self.rows
        ]
        all_variables = joined([variables, *of_rows])
        pattern = self.assembly.pattern
        separable = Separable(
            start=pattern.start,
            row=pattern.row,
            first=pattern.first,
            weight=all_variables.weight,
            exponent=all_variables.exponent,
            lower=all_variables.lower,
            upper=all_variables.upper,
        )
        if self.options.recruitment != "minmax":
            return separable
        # The common bound of all muscles ties all coordinates together: the envelope is full.
        full = 0 * pattern.first
        return separable._replace(first=full, capped=len(self.muscles.strength), peak=1.0)

    def _all_penalties(self) -> IntervalPenalties:
        asked = [term.penalties(self.unknowns) for term in self.terms]
        penalties = [penalty for penalty in asked if penalty is not None]
        return added_up(penalties, self.unknowns, len(self.separable.weight))

    def _smoothing(self) -> Smoothing | None:
        asked = [term.smoothing(self.unknowns) for term in self.terms]
        linking = [smoothing for smoothing in asked if smoothing is not None]
        if len(linking) > 1:
            raise BadData(f"{len(linking)} terms of the tension problem link frames: expected one")
        return linking[0] if linking else None

    def _allocate_results(self) -> None:
        """Arrays that `solve` fills, a row a frame."""
        frames = len(self.coordinates)
        muscles = len(self.unknowns.muscles)
        # Apart from the other unknowns: activations become a part of the result without a copy.
        self._activations = np.empty((frames, muscles))
        self._others = np.empty((frames, len(self.separable.weight) - muscles))
        self._forces = np.empty((frames, muscles))
        self._viscous = np.empty((frames, muscles)) if self.muscles.viscous else np.zeros((1, 1))
        self._passive = np.empty((frames, muscles if self.options.passive else 0))
        sites = 0 if self.contacts is None else len(self.contacts.generators.sites)
        self._contact_forces = np.empty((3, frames, sites, 3))
        self._balanced = np.empty((frames, len(self.assembly.rows)))
        self._residual = np.empty(frames)
        self._iterations = np.empty(frames, np.int64)
        self._status = np.empty(frames, np.int8)

    @property
    def amplitudes(self) -> Array:
        """(frames, generators) of contacts, filled by `solve`."""
        return (
            self._others[:, :0]
            if self.contacts is None
            else self._others[:, self._place(self.contacts)]
        )

    @property
    def x(self) -> Array:
        """(frames, unknowns and those of rows), filled by `solve`; a copy."""
        return self.x_of(slice(None))

    def x_of(self, frames: slice | np.ndarray) -> Array:
        """The unknowns of some frames, and those of rows."""
        return np.concatenate([self._activations[frames], self._others[frames]], axis=1)

    def _place(self, term: Term) -> slice:
        """Where the unknowns of a term lie behind the activations."""
        muscles = self._activations.shape[1]
        place = self.unknowns.of(term)
        return slice(place.start - muscles, place.stop - muscles)

    def balance(self, start: int, stop: int) -> Balance:
        """What the frames start ... stop - 1 have to balance."""
        part = slice(start, stop)
        frames = Frames(part, np.ascontiguousarray(self.coordinates[part]), self._rates[part])
        columns = [term.columns(frames) for term in self.terms]
        pattern = self.assembly.pattern
        values = np.empty((len(frames), len(self.separable.row)))
        right = np.empty((len(frames), len(pattern.order)))
        required = np.zeros((len(frames), len(pattern.order)))
        fold(
            self.assembly.tree.arrays,
            self.assembly.links,
            frames.coordinates,
            self._slopes[part],
            np.hstack([column.entries for column in columns]),
            np.hstack([column.forces for column in columns]),
            _given(columns),
            self._torques[part],
            values,
            required,
            right,
        )
        self._fill_rows(frames, values, right)
        muscles = self.muscles.forces(frames)
        return Balance(
            values=values,
            right=right,
            active=muscles.active,
            passive=muscles.passive,
            viscous=muscles.viscous,
            torques=required[:, self.assembly.coordinate_row],
        )

    def _fill_rows(self, frames: Frames, values: Array, right: Array) -> None:
        """Write rows that terms add, S x - unit e = target, behind those of the coordinates.

        Parameters
        ----------
        values : (frames, entries) of A
        right : (frames, rows) b
        """
        if not self._row_terms:
            return
        filled = [term.row_values(rows, frames) for term, rows in self._row_terms]
        units = np.concatenate([rows.unit for rows in self.rows])
        own = np.broadcast_to(-units, (len(frames), len(units)))
        values[:, self.assembly.extra_place] = np.hstack([*(S for S, _ in filled), own])
        right[:, self.assembly.extra_row] = np.hstack([target for _, target in filled])

    def solve(self, start: int, stop: int) -> None:
        """Solve the frames start ... stop - 1, with a margin on both sides where frames are
        linked.
        """
        margin = 0 if self.smooth is None else self.smooth.margin
        begin = max(start - margin, 0)
        end = min(stop + margin, len(self._time))
        balance = self.balance(begin, end)
        x, _, residual, iterations, status = self.solved(balance, begin)

        part = slice(start, stop)
        kept = slice(start - begin, stop - begin)
        self._residual[part] = residual[kept]
        self._iterations[part] = iterations[kept]
        self._status[part] = status[kept]
        self._store(part, x[kept], Balance(*(array[kept] for array in balance)))

    def solve_all(self, progress: Callable[[int], None] | None = None) -> Tension:
        """Solve all frames; `progress` is called with the number of frames just done."""
        over_frames(self.solve, len(self._time), progress, self.window)
        return self.result()

    def renew(self, coordinates: Array, rates: Array, torques: Array) -> None:
        """Put other frames in the place of those that were given, as many.
        `coordinates`, `rates`, `torques` (frames, coordinates) consistent, torques of inverse
        dynamics [N m or N].
        """
        self.coordinates[:] = coordinates
        self._rates[:] = rates
        self._torques[:] = torques
        self._torques -= joint_forces(self.assembly.tree, coordinates, rates)

    def solved(
        self, balance: Balance, begin: int = 0, warm: Array | None = None
    ) -> SolvedSeparable:
        """Unknowns of some frames (frames, n), multipliers (frames, rows), residual, iterations and
        status. `balance`: what to balance in the frames from `begin` on; `warm` (rows,) multipliers
        to begin with, afterwards those of the last frame; None for none.
        """
        links = (
            None if self.smooth is None else self.smooth.links(begin, begin + len(balance.right))
        )
        penalties = self.penalties[begin : begin + len(balance.right)]
        return solve_frames(
            self.separable, balance.values, balance.right, penalties, links=links, warm=warm
        )

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
            sites = self.contacts.generators.sites
            ready = self.contacts.activations
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
    last = max(
        (index for index, column in enumerate(columns) if column.given is not None), default=-1
    )
    parts = [
        np.zeros_like(column.forces) if column.given is None else column.given
        for column in columns[: last + 1]
    ]
    return np.hstack([np.zeros((len(columns[0].forces), 0)), *parts])


@read_only
class TensionFrame:
    """What one frame gives."""

    # activations, forces: (muscles,) NaN where the frame was not solved; along the tendons [N]
    activations: Array
    forces: Array
    reserves: Array  # (actuators,) their forces [N] and torques [N m]
    # (rows,) what muscles and actuators had to give together, in the order of `OnlineTension.rows`
    balanced: Array
    status: int  # index into `STATUS_NAMES`
    equilibrium_residual: float  # greatest torque or force left unbalanced [N m or N]


class OnlineTension:
    """The problem of `solve_tension`, set up once.
    `actuators`: as of `solve_tension`. `muscles`, `actuators`: names; `rows`: names of the
    coordinates that are balanced; `lower`, `upper` (muscles,) bounds of the activations.
    """

    def __init__(
        self,
        model: Model,
        options: TensionOptions | None = None,
        actuators: Sequence[Actuator] | None = None,
    ):
        if model.loops:
            raise BadModel(
                f"model '{model.name}' closes loops ('{model.loops[0].name}'), which muscle"
                " tensions frame by frame do not take: use 'myomorph tension' after the recording"
            )
        rest = np.array([[coordinate.default for coordinate in model.coordinates]])
        still = Motion(
            time=np.zeros(1),
            names=model.coordinate_names,
            values=rest,
            velocities=np.zeros_like(rest),
        )
        none = Series(np.zeros(1), model.coordinate_names, np.zeros_like(rest))
        self._problem = tension_problem(
            TensionInputs(
                model=model,
                motion=still,
                torques=none,
                options=options or TensionOptions(),
                actuators=actuators,
            )
        )
        self.actuators = tuple(actuator.name for actuator in self._problem.actuators.actuators)
        self.muscles = model.muscle_names
        self.rows = self._problem.assembly.rows
        shared = self._problem.separable
        muscles = len(self.muscles)
        self.lower = shared.lower[:muscles]
        self.upper = shared.upper[:muscles]
        self._optimal_forces = self._problem.actuators.optimal_forces
        self._warm = np.zeros(len(self._problem.assembly.pattern.order))

    def solve(self, coordinates: Array, rates: Array, torques: Array) -> TensionFrame:
        """Share torques of a frame among muscles; all (1, coordinates), consistent, of inverse
        dynamics [N m or N].
        """
        self._problem.renew(coordinates, rates, torques)
        balance = self._problem.balance(0, 1)
        x, _, residual, _, status = self._problem.solved(balance, 0, self._warm)
        if status[0] != OPTIMAL:
            self._warm[:] = 0.0
        muscles = len(self.muscles)
        activations = x[0, :muscles]
        forces = balance.active[0] * activations + balance.passive[0] + balance.viscous[0]
        reserves = x[0, muscles:] * self._optimal_forces
        return TensionFrame(
            activations=activations,
            forces=forces,
            reserves=reserves,
            balanced=balance.torques[0],
            status=int(status[0]),
            equilibrium_residual=float(residual[0]),
        )
