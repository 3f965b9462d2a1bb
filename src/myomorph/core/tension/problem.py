"""The tension problem of all frames: the sum of its terms, its solution and the result."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.contacts import ContactForces
from myomorph.core.model.errors import BadData, BadModel, check_name
from myomorph.core.model.model import Actuator, Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.motion.sync import refuse_other_times
from myomorph.core.muscles.joint_tissue import tissue_torques
from myomorph.core.muscles.passive import joint_forces
from myomorph.core.rigid.dynamics import values_and_rates
from myomorph.core.rigid.frames import CHUNK, over_frames
from myomorph.core.rigid.loops import loop_basis, loop_slopes, refuse_open
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.core.tension.assembly import assemble, fold
from myomorph.core.tension.dual import solve_separable
from myomorph.core.tension.separable import (
    FrameLinks,
    Separable,
    SeparableFrames,
    SolvedSeparable,
    no_links,
)
from myomorph.core.tension.tension import PassivePeaks, Tension, TensionOptions, passive_peaks
from myomorph.core.tension.terms.actuators import (
    ActuatorTerm,
    balanced_coordinates,
    default_reserves,
)
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
    """Arguments of `solve_tension`, which says what each is."""

    model: Model
    motion: Motion
    torques: Series
    options: TensionOptions = field(default_factory=TensionOptions)
    actuators: Sequence[Actuator] | None = None
    contacts: ContactTask | None = None
    emg: EmgTarget | None = None
    terms: Sequence[Term] = ()

    def enabled_actuators(self) -> tuple[Actuator, ...]:
        """Join the model's own actuators with those added, which replace those of the same name.

        Raises
        ------
        BadModel : two actuators have one name
        """
        model = self.model
        added = self.actuators
        if added is None:
            added = default_reserves(model, self.options.reserve, self.options.residual)
        replaced = {actuator.name for actuator in added}
        remaining = [actuator for actuator in model.actuators if actuator.name not in replaced]
        enabled = tuple(actuator for actuator in (*remaining, *added) if actuator.enabled)
        names = [actuator.name for actuator in enabled]
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise BadModel(
                f"two actuators are named '{twice}': leave one out or give it another name"
            )
        return enabled


def tension_problem(inputs: TensionInputs, only: Collection[str] | None = None) -> TensionProblem:
    """Set up what `solve_tension` solves with rigid tendons.

    With contacts it is the problem that finds their forces, with passive forces by
    `ContactOptions.contact_passive`, but never beside passive torques of joints. Further terms may
    speak of contacts and muscles alike: with any, one problem finds both by the options as they
    are.

    Parameters
    ----------
    inputs : errors are those of `solve_tension`
    only : coordinates whose equations are kept, where not all are
    """
    if inputs.contacts is not None and not inputs.terms and inputs.options.tendons == "rigid":
        # Passive torques of joints hold what muscles would give passively.
        passive = inputs.contacts.options.contact_passive and inputs.options.joint_tissue == "none"
        inputs = replace(inputs, options=replace(inputs.options, passive=passive))
    return TensionProblem(inputs, MuscleTerm(compile_tree(inputs.model), inputs.options), only)


def _torques_of(tree: Tree, motion: Motion, torques: Series) -> Array:
    """Torques in the order of the model's coordinates, 0 of those that need none.

    Returns
    -------
    (frames, coordinates) [N m or N]

    Raises
    ------
    BadData : torques are of other times than the motion
    UnknownName : a free coordinate has no torque
    """
    refuse_other_times("torques", torques.time, motion.time)
    needed = set(balanced_coordinates(tree.model))
    columns = {name: i for i, name in enumerate(torques.names)}
    result = np.zeros((len(motion), len(tree.model.coordinates)))
    for j, name in enumerate(tree.model.coordinate_names):
        if name in columns:
            result[:, j] = torques.values[:, columns[name]]
        elif name in needed:
            check_name("coordinate", name, torques.names, "the table of torques")
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

    def of(self, frames: slice) -> Balance:
        """Balance of some of the frames."""
        return Balance._make(array[frames] for array in self)


def solve_frames(  # page: what `solve_separable` takes, most of it optional
    shared: Separable,
    values: Array,
    right: Array,
    penalties: Array,
    *,
    targets: Array | None = None,
    links: FrameLinks | None = None,
    warm: Array | None = None,
) -> SolvedSeparable:
    """Solve the separable problem of some frames; see `solve_separable`.

    Parameters
    ----------
    shared : pattern and data that all frames share
    values : (frames, entries) of A
    right : (frames, rows) b
    penalties : (1 or frames, 3, unknowns) l, h and k
    targets : (1 or frames, unknowns) t, 0 by default
    links : between frames, none by default
    warm : (rows,) multipliers to begin with, afterwards those of the last frame

    Returns
    -------
    unknowns, multipliers, residual, iterations and status of each frame
    """
    frames = len(right)
    count = len(shared.weight)
    solved = SolvedSeparable(
        x=np.empty((frames, count)),
        multipliers=np.empty(right.shape),
        residual=np.empty(frames),
        iterations=np.empty(frames, np.int64),
        status=np.empty(frames, np.int8),
    )
    if targets is None:
        targets = np.zeros((1, count))
    if links is None:
        links = no_links()
    if warm is None:
        warm = np.zeros(right.shape[1])
    data = SeparableFrames(values=values, right=right, targets=targets, penalties=penalties)
    solve_separable(shared, data, links, warm, solved)
    return solved


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
    added_rows : that terms add to the equations of the coordinates; their unknowns come last
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
        self.coordinates, self._rates = values_and_rates(tree, inputs.motion)
        enabled_actuators = inputs.enabled_actuators()
        if inputs.contacts is None and not any(muscle.enabled for muscle in model.muscles):
            raise BadModel(f"model '{model.name}' has no muscle that is switched on")
        refuse_open(tree, self.coordinates)

        # Springs and bushings of joints act whatever the muscles do: the rest is to be balanced.
        required = _torques_of(tree, inputs.motion, inputs.torques)
        self._torques = required - self._of_tissue(tree, self.coordinates, self._rates)
        self._time = np.array(inputs.motion.time)

        self.contacts = None
        if inputs.contacts is not None:
            self.contacts = ContactTerm(tree, self._time, inputs.contacts)
        exponent = self.options.exponent if self.options.exponent <= HIGHEST_POWER else 2.0
        self.actuators = ActuatorTerm(tree, enabled_actuators, exponent)
        self.terms = self._all_terms(inputs)

        variables = [term.variables() for term in self.terms]
        self.unknowns = self._all_unknowns(variables)
        rows = [(term, term.rows(self.unknowns)) for term in self.terms]
        self._row_terms = [(term, added) for term, added in rows if added is not None]
        self.added_rows = [added for _, added in self._row_terms]

        basis = loop_basis(tree, self.coordinates) if model.loops else None
        self._slopes = loop_slopes(basis, self.coordinates)
        self.assembly = assemble(
            tree,
            self._entries(),
            len(self.unknowns),
            extra=self.added_rows,
            basis=basis,
            only=only,
        )
        self.separable = self._separable(joined(variables))
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

    def _all_unknowns(self, variables: Sequence[Variables]) -> Unknowns:
        """Unknowns of all terms, one term after the other."""
        return Unknowns(
            names=joined(variables).names,
            muscles=self.muscles.names,
            time=self._time,
            terms=self.terms,
            places=_adjoining_slices([len(part) for part in variables]),
        )

    def _entries(self) -> list[tuple[int, int]]:
        """Unknown and coordinate of every generalized force of unknowns."""
        return [
            (place.start + unknown, coordinate)
            for term, place in zip(self.terms, self.unknowns.places, strict=True)
            for unknown, coordinate in term.entries()
        ]

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
            for row in self.added_rows
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
        """Sum the interval penalties of all terms."""
        parts = [term.penalties(self.unknowns) for term in self.terms]
        penalties = [part for part in parts if part is not None]
        return added_up(penalties, self.unknowns, len(self.separable.weight))

    def _smoothing(self) -> Smoothing | None:
        """Find the links between frames of the only term that has any.

        Raises
        ------
        BadData : more than one term links frames
        """
        parts = [term.smoothing(self.unknowns) for term in self.terms]
        linking = [part for part in parts if part is not None]
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
        self._passive = np.empty((frames, muscles if self.options.has_passive else 0))
        sites = 0 if self.contacts is None else len(self.contacts.generators.sites)
        self._contact_forces = np.empty((3, frames, sites, 3))
        self._balanced = np.empty((frames, len(self.assembly.coordinates)))
        self._residual = np.empty(frames)
        self._iterations = np.empty(frames, np.int64)
        self._status = np.empty(frames, np.int8)

    @property
    def amplitudes(self) -> Array:
        """(frames, generators) of contacts, filled by `solve`."""
        if self.contacts is None:
            return self._others[:, :0]
        return self._others[:, self._place(self.contacts)]

    @property
    def x(self) -> Array:
        """(frames, unknowns and those of rows), filled by `solve`; a copy."""
        return self.x_of(slice(None))

    def x_of(self, frames: slice | np.ndarray) -> Array:
        """Copy the unknowns of some frames, and those of rows.

        Parameters
        ----------
        frames : a slice, or (chosen,) their numbers

        Returns
        -------
        (chosen, unknowns and those of rows)
        """
        return np.concatenate([self._activations[frames], self._others[frames]], axis=1)

    def _place(self, term: Term) -> slice:
        """Place of the unknowns of a term behind the activations."""
        muscles = self._activations.shape[1]
        place = self.unknowns.of(term)
        return slice(place.start - muscles, place.stop - muscles)

    def balance(self, start: int, stop: int) -> Balance:
        """Balance of the frames start ... stop - 1, and the forces of their muscles."""
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
            _acting_anyway(columns),
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
        units = np.concatenate([rows.unit for rows in self.added_rows])
        of_e = np.broadcast_to(-units, (len(frames), len(units)))
        values[:, self.assembly.extra_place] = np.hstack([*(S for S, _ in filled), of_e])
        right[:, self.assembly.extra_row] = np.hstack([target for _, target in filled])

    def solve(self, start: int, stop: int) -> None:
        """Solve the frames start ... stop - 1.

        Where frames are linked, a margin on both sides is solved too.
        """
        margin = 0 if self.smooth is None else self.smooth.margin
        begin = max(start - margin, 0)
        end = min(stop + margin, len(self._time))
        balance = self.balance(begin, end)
        solved = self.solved(balance, begin)

        part = slice(start, stop)
        without_margin = slice(start - begin, stop - begin)
        self._residual[part] = solved.residual[without_margin]
        self._iterations[part] = solved.iterations[without_margin]
        self._status[part] = solved.status[without_margin]
        self._store(part, solved.x[without_margin], balance.of(without_margin))

    def solve_all(self, progress: Callable[[int], None] | None = None) -> Tension:
        """Solve all frames; `progress` is called with the number of frames just done."""
        over_frames(self.solve, len(self._time), progress, self.window)
        return self.result()

    def renew(self, coordinates: Array, rates: Array, torques: Array) -> None:
        """Put other frames, as many, in the place of those of the inputs.

        Parameters
        ----------
        coordinates, rates : (frames, coordinates) consistent [rad or m], [rad/s or m/s]
        torques : (frames, coordinates) of inverse dynamics [N m or N]
        """
        self.coordinates[:] = coordinates
        self._rates[:] = rates
        self._torques[:] = torques
        self._torques -= self._of_tissue(self.assembly.tree, coordinates, rates)

    def _of_tissue(self, tree: Tree, coordinates: Array, rates: Array) -> Array:
        """Torques of springs, bushings and tissue that the options ask for.

        Parameters
        ----------
        coordinates, rates : (frames, coordinates) [rad or m], [rad/s or m/s]

        Returns
        -------
        (frames, coordinates) [N m or N]
        """
        tissue = tissue_torques(tree, coordinates, self.options.joint_tissue)
        return joint_forces(tree, coordinates, rates) + tissue

    def solved(
        self, balance: Balance, begin: int = 0, warm: Array | None = None
    ) -> SolvedSeparable:
        """Solve some frames without storing the result.

        Parameters
        ----------
        balance : of the frames from `begin` on
        begin : number of the first frame
        warm : (rows,) multipliers to begin with, afterwards those of the last frame; None for none

        Returns
        -------
        unknowns, multipliers, residual, iterations and status of each frame
        """
        end = begin + len(balance.right)
        return solve_frames(
            self.separable,
            balance.values,
            balance.right,
            self.penalties[begin:end],
            links=None if self.smooth is None else self.smooth.links(begin, end),
            warm=warm,
        )

    def _store(self, part: slice, x: Array, balance: Balance) -> None:
        """Keep the solution of some frames.

        Parameters
        ----------
        part : the frames
        x : (frames, unknowns)
        """
        muscles = self._forces.shape[1]
        activations = x[:, :muscles]
        self._activations[part] = activations
        self._others[part] = x[:, muscles:]
        self._forces[part] = balance.active * activations + balance.passive + balance.viscous
        self._balanced[part] = balance.torques
        if self.muscles.viscous:
            self._viscous[part] = balance.viscous
        if self.options.has_passive:
            self._passive[part] = balance.passive
        if self.contacts is not None:
            self._contact_forces[:, part] = self.contacts.forces_of(
                part, self.coordinates[part], self.amplitudes[part]
            )

    def result(self) -> Tension:
        """Tensions, reserves and contact forces of all frames, as a value."""
        muscles = self.assembly.tree.model.muscle_names
        peaks = PassivePeaks(share=np.zeros(len(muscles)), time=np.zeros(len(muscles)))
        if self.options.has_passive:
            peaks = passive_peaks(self._passive, self.muscles.strength, self._time)
        controls = self._others[:, self._place(self.actuators)]
        return Tension(
            time=self._time,
            muscles=muscles,
            activation=self._activations,
            muscle_force=self._forces,
            reserve_names=tuple(actuator.name for actuator in self.actuators.actuators),
            actuator_force=controls * self.actuators.optimal_forces,
            coordinates=self.assembly.coordinates,
            balanced_torque=self._balanced,
            equilibrium_residual=self._residual,
            status=self._status,
            iterations=self._iterations,
            activation_lower=self.muscles.lower,
            activation_upper=self.muscles.upper,
            overstretched=tuple(muscles[i] for i in np.flatnonzero(peaks.share > 1.0)),
            options=self.options,
            muscle_viscous_force=self._viscous,
            muscle_passive_share=peaks.share,
            muscle_passive_time=peaks.time,
            contacts=self._contacts_found(),
        )

    def _contacts_found(self) -> ContactForces | None:
        """Join the forces at contact sites of all frames; None without contacts."""
        if self.contacts is None:
            return None
        forces, points, torques = self._contact_forces
        return ContactForces(
            time=self._time,
            sites=self.contacts.generators.sites,
            contact_activation=self.contacts.activations,
            contact_force=forces,
            contact_point=points,
            contact_torque=torques,
        )


def _acting_anyway(columns: Sequence[Columns]) -> Array:
    """Join forces that act whatever the unknowns are.

    Parameters
    ----------
    columns : of all terms

    Returns
    -------
    (frames, unknowns up to the last term that has any) [N, N m]
    """
    with_forces = [index for index, column in enumerate(columns) if column.given is not None]
    last = max(with_forces, default=-1)
    parts = [
        np.zeros_like(column.forces) if column.given is None else column.given
        for column in columns[: last + 1]
    ]
    return np.hstack([np.zeros((len(columns[0].forces), 0)), *parts])
