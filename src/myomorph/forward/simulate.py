"""Forward dynamics of a body from a state, under what drives it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from myomorph.core.model.arguments import check_argument
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, quoted
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.muscles.fiber_equations import FIBER_LENGTH
from myomorph.core.muscles.fiber_states import equilibrium, state_names
from myomorph.core.muscles.hill import muscle_model
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.loops import close_loops, project_rates, refuse_open
from myomorph.forward.arrays import WORKS, System
from myomorph.forward.body import SimulatedBody
from myomorph.forward.drives import NO_DRIVES, Drives
from myomorph.forward.integrator import (
    EVALUATIONS,
    OPEN_LOOP,
    OUTCOME,
    REJECTED,
    RUNNING,
    SINGULAR_MASS,
    STEP,
    STEPS,
    TIME,
    TOO_MANY_STEPS,
    Control,
    Observed,
    Progression,
    integrate,
)
from myomorph.forward.judgement import notes_on
from myomorph.forward.simulation import EnergyBalance, Simulation, StepCounts

FIRST_STEP = 1e-4  # [s]
FRAMES_AT_ONCE = 20  # Frames after which a run says how far it is
MAX_RATE = 100_000.0  # Of frames [Hz]
NO_CLOCK = 1e-9  # Time below which nothing moves [s]

Progress = Callable[[float], object]


@dataclass(frozen=True, kw_only=True)
class SimulationOptions:
    """How a body is simulated.

    Attributes
    ----------
    seconds : duration [s]; by default that of the inputs or of the motion that is followed, else 1
        s
    rate : output rate [Hz]
    tolerance : error tolerance of a step, for angles [rad], positions [m], their rates, activations
        and normalized fiber lengths; relative for states above 1
    max_step : maximum step [s]
    max_steps : maximum number of steps
    tendons : tendon model: "rigid" or "elastic"
    passive : include the muscles' passive elastic forces; by default as in the tensions whose
        activations are used, if their result is found, else yes
    certify : repeat the simulation with half the tolerance, and report how much the motion differs
    """

    seconds: float | None = None
    rate: float = 100.0
    tolerance: float = 1e-6
    max_step: float = 0.02
    max_steps: int = 1_000_000
    tendons: Literal["rigid", "elastic"] = "rigid"
    passive: bool | None = None
    certify: bool = False

    def __post_init__(self) -> None:
        if self.seconds is not None and not NO_CLOCK < self.seconds < 1e6:
            raise BadData(f"{self.seconds:g} s: expected a time above 0 and below 1,000,000 s")
        if not 1.0 <= self.rate <= MAX_RATE:
            raise BadData(f"rate {self.rate:g} Hz: expected 1 to {MAX_RATE:g} frames a second")
        if not 1e-12 <= self.tolerance <= 1e-2:
            raise BadData(f"tolerance {self.tolerance:g}: expected 1e-12 to 0.01")
        if not self.max_step > 0.0 or self.max_steps < 1:
            raise BadData(
                f"max_step {self.max_step:g} s, max_steps {self.max_steps}: both must be positive"
            )
        if self.tendons not in ("rigid", "elastic"):
            raise BadData(f"tendons '{self.tendons}': expected rigid or elastic")

    def times(self, start: Motion | None, drives: Drives) -> Array:
        """Choose the times at which the motion is kept.

        Parameters
        ----------
        start : where it begins, None for 0 s
        drives : which may end it

        Returns
        -------
        (frames,) [s]

        Raises
        ------
        BadData : nothing is left to simulate
        """
        first = 0.0 if start is None else float(start.time[0])
        seconds = self.seconds
        if seconds is None:
            last = drives.last_time
            seconds = 1.0 if last is None else last - first
        if not seconds > NO_CLOCK:
            raise BadData(
                f"the start is at {first:g} s and what drives the body ends at"
                f" {first + seconds:g} s: nothing is left to simulate; give --seconds"
            )
        frames = max(int(np.floor(seconds * self.rate + 1e-6)), 1)
        times = first + np.arange(frames + 1) / self.rate
        if first + seconds - times[-1] > NO_CLOCK:
            times = np.append(times, first + seconds)
        return times

    def frames_of(self, start: Motion | None, drives: Drives) -> int:
        """Count the frames of a run, those of its certificate included."""
        return len(self.times(start, drives)) * (2 if self.certify else 1)


USUAL = SimulationOptions()


def simulate(
    model: Model,
    start: Motion | None = None,
    drives: Drives = NO_DRIVES,
    options: SimulationOptions = USUAL,
    progress: Progress | None = None,
) -> Simulation:
    """Let a body move from a state under its muscles, torques, passive forces and contacts.

        M(c) cddot = tau - h(c, cdot)

    is integrated by an embedded Runge-Kutta pair whose steps keep to a tolerance (Dormand and
    Prince 1980), with activations, fiber lengths and the work of every force beside it. Loops stay
    closed.

    Parameters
    ----------
    model : the body
    start : its first frame is where it begins, with velocities; what it lacks, and all without it,
        are at the model's defaults
    drives : torques, activations or excitations, external forces, the ground, a motion to follow
    options : of the run
    progress : called with the number of frames just done

    Returns
    -------
    motion with its causes, and the energy's balance

    Raises
    ------
    BadData : drives exclude each other, or the run cannot go on; the error says at what time
    BadModel : nothing of the model is free to move
    UnknownName : a drive is for no part of the model

    Examples
    --------
    >>> import myomorph as mm
    >>> from myomorph.forward import simulate
    >>> fall = simulate.simulate(mm.read_model("arm.osim"))
    >>> fall.motion.values.shape, fall.energy.largest_share < 1e-4
    ((101, 2), True)
    """
    check_argument("model", model, Model)
    body = SimulatedBody(
        model=model,
        drives=drives,
        elastic=options.tendons == "elastic",
        passive=options.passive is not False,
    )
    run = Run(body=body, start=start, options=options)
    simulation = run.simulation(progress)
    if options.certify:
        halved = replace(options, tolerance=0.5 * options.tolerance)
        again = Run(body=body, start=start, options=halved).simulation(progress)
        apart = float(np.abs(again.motion.values - simulation.motion.values).max(initial=0.0))
        simulation = replace(simulation, halved=apart)
    return replace(simulation, notes=notes_on(simulation))


class Integrated(NamedTuple):
    """States and what they cause.

    Attributes
    ----------
    states : (frames, states)
    observed : over the same frames
    counts : (4,) of `integrate`
    clock : (2,) where it ended
    """

    states: Array
    observed: Observed
    counts: Ints
    clock: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Run:
    """A body with where it starts, ready to be integrated.

    Attributes
    ----------
    body : that moves
    start : None for the model's defaults
    options : of the run
    """

    body: SimulatedBody
    start: Motion | None
    options: SimulationOptions

    def simulation(self, progress: Progress | None = None) -> Simulation:
        """Integrate, and find what the states cause."""
        system = self.system
        done = self.integrated(system, progress)
        if done.counts[OUTCOME] != RUNNING:
            raise BadData(self._failure(int(done.counts[OUTCOME]), done.clock, done.counts))
        return self._named(system, done)

    @property
    def system(self) -> System:
        """Arrays of the kernels."""
        return self.body.system(self.first_coordinates[0])

    @cached_property
    def first_coordinates(self) -> tuple[Array, Array]:
        """Coordinates and velocities at the start, (coordinates,) each [rad or m, per s].

        Loops that the start leaves open are closed by the nearest coordinates.
        """
        tree = self.body.tree
        values, speeds = self._stated_coordinates()
        if not tree.model.loops:
            return values, speeds
        if self.start is not None and set(tree.model.coordinate_names) <= set(self.start.names):
            refuse_open(tree, values[None])
        closed = close_loops(tree, values[None])
        rates = project_rates(tree, closed, speeds[None], np.zeros_like(closed))
        return closed[0], rates.velocities[0]

    def _stated_coordinates(self) -> tuple[Array, Array]:
        """Coordinates and velocities at the start as the motion or the model states them."""
        tree = self.body.tree
        coordinates = tree.model.coordinates
        if self.start is None:
            default_speeds = np.array([coordinate.default_speed for coordinate in coordinates])
            return tree.defaults.copy(), default_speeds
        values = tree.coordinates_of(self.start)[0]
        if not np.isfinite(values).all():
            name = tree.model.coordinate_names[int(np.argmin(np.isfinite(values)))]
            raise BadData(
                f"the start has no value of '{name}' at {self.start.time[0]:g} s: begin where all"
                " coordinates are known (--time START END)"
            )
        return values, np.nan_to_num(tree.rates_of(self.start).velocities[0])

    @cached_property
    def times(self) -> Array:
        """(frames,) at which the motion is kept [s]."""
        return self.options.times(self.start, self.body.drives)

    def first_state(self, system: System) -> Array:
        """Find the state at the start.

        Parameters
        ----------
        system : arrays of the body

        Returns
        -------
        (states,)
        """
        values, speeds = self.first_coordinates
        state = np.zeros(system.size)
        n = len(system.free)
        state[:n] = values[system.free]
        state[n : 2 * n] = speeds[system.free]
        first_time = self.times[0]
        activations = self.body.drives.muscles_at(self.body.model, first_time)
        if system.activations:
            state[2 * n : 2 * n + system.activations] = activations
        if system.fibers:
            begin = 2 * n + system.activations
            state[begin : begin + system.fibers] = self._first_fibers(values, activations)
        return state

    def _first_fibers(self, values: Array, activations: Array) -> Array:
        """Fiber lengths in equilibrium at the start, (elastic muscles,) [m]."""
        model = self.body.model
        lengths = compile_paths(model).evaluate(values[None]).lengths[0]
        fibers = np.empty(len(self.body.elastic_muscles))
        for k, name in enumerate(self.body.elastic_muscles):
            m = model.muscle_names.index(name)
            muscle = model.muscles[m]
            length = lengths[m : m + 1]
            state = equilibrium(muscle, length, np.zeros(1), activations[m : m + 1])
            if FIBER_LENGTH not in state_names(muscle):
                kind = muscle_model(muscle)
                tendon = muscle.tendon_slack_length * kind.stretch(muscle)(state)
                height = kind.sizes(muscle).height
                state = np.hypot(length - tendon, height)
            if not np.isfinite(state[0]):
                raise BadData(
                    f"muscle '{name}' finds no equilibrium of fibers and tendon at the start: begin"
                    " in another pose, or use rigid tendons"
                )
            fibers[k] = state[0]
        return fibers

    def control(self, system: System) -> Control:
        """Control of the steps."""
        tolerance = self.options.tolerance
        absolute = np.full(system.size, tolerance)
        begin = 2 * len(system.free) + system.activations
        for k, name in enumerate(self.body.elastic_muscles):
            absolute[begin + k] = tolerance * self.body.model.muscle(name).optimal_fiber_length
        return Control(
            relative=tolerance,
            absolute=absolute,
            max_step=self.options.max_step,
            max_steps=self.options.max_steps,
        )

    def integrated(self, system: System, progress: Progress | None = None) -> Integrated:
        """Integrate as far as it goes.

        In parts, where somebody listens, so that Ctrl-C and the bar of progress get their turn.

        Parameters
        ----------
        system : arrays of the body
        progress : called with the number of frames just done

        Returns
        -------
        states and what they cause, with the outcome among the counts
        """
        times = self.times
        states = np.empty((len(times), system.size))
        observed = _observation_room(system, len(times))
        state = self.first_state(system)
        clock = np.array([times[0], FIRST_STEP])
        counts = np.zeros(4, np.int64)
        control = self.control(system)
        at_once = len(times) if progress is None else FRAMES_AT_ONCE
        for begin in range(0, len(times), at_once):
            stop = min(begin + at_once, len(times))
            part = Progression(
                times=times[begin:stop],
                y=state,
                clock=clock,
                counts=counts,
                states=states[begin:stop],
                observed=observed.part(begin, stop),
            )
            integrate(system, self.body.path_rules, control, part)
            if counts[OUTCOME] != RUNNING:
                break
            if progress is not None:
                progress(float(stop - begin))
        return Integrated(states=states, observed=observed, counts=counts, clock=clock)

    def balance(self, system: System, done: Integrated) -> EnergyBalance:
        """Hold the energy of what was integrated against its works.

        Parameters
        ----------
        system : arrays of the body
        done : by `integrated`
        """
        return EnergyBalance(
            time=self.times,
            kinetic=done.observed.energy[:, 0],
            potential=done.observed.energy[:, 1],
            work=done.states[:, system.size - len(WORKS) :],
        )

    def _failure(self, outcome: int, clock: Array, counts: Ints) -> str:
        """Sentence on a run that cannot go on."""
        at = f"the simulation stopped at {clock[TIME]:.4g} s"
        if outcome == TOO_MANY_STEPS:
            return (
                f"{at} after {counts[STEPS]} steps ({self.options.max_steps} at most): simulate"
                " less time, or allow a larger --tolerance or more --max-steps"
            )
        if outcome == SINGULAR_MASS:
            return (
                f"{at}: the mass matrix has no inverse there, as a body without mass moves freely"
                " or three rotations have lost one; lock the coordinate or give the body a mass"
            )
        if outcome == OPEN_LOOP:
            names = quoted([loop.name for loop in self.body.model.loops], 3)
            return (
                f"{at}: no state near it keeps the loops closed ({names}): look at the last frames"
                " with less time (--seconds); is enough of the loop free to move?"
            )
        return (
            f"{at}: steps shorter than {clock[STEP]:.1g} s would be needed; something is very stiff"
            " or has no limits: look at the last frames with less time (--seconds)"
        )

    def _named(self, system: System, done: Integrated) -> Simulation:
        """Give what was integrated its names."""
        body = self.body
        model = body.model
        times = self.times
        seen = done.observed
        states = done.states
        counts = done.counts
        first_work = system.size - len(WORKS)
        fibers = states[:, first_work - system.fibers : first_work]
        return Simulation(
            model=model,
            motion=Motion(
                time=times,
                names=model.coordinate_names,
                values=seen.coordinates,
                velocities=seen.velocities,
                accelerations=seen.accelerations,
            ),
            muscles=model.muscle_names if body.has_tissue else (),
            activation=seen.activation if body.has_tissue else np.zeros((len(times), 0)),
            muscle_force=seen.force if body.has_tissue else np.zeros((len(times), 0)),
            muscle_length=seen.length,
            muscle_velocity=seen.velocity,
            fiber_length=fibers,
            elastic=body.elastic_muscles,
            feedback=seen.feedback,
            free=tuple(model.coordinate_names[j] for j in system.free),
            contact_force=seen.contact[:, :, :3],
            contact_point=seen.contact[:, :, 3:],
            contact_bodies=tuple(sphere.body for sphere in body.drives.ground.spheres),
            energy=self.balance(system, done),
            counts=StepCounts(
                steps=int(counts[STEPS]),
                rejected=int(counts[REJECTED]),
                evaluations=int(counts[EVALUATIONS]),
            ),
            tolerance=self.options.tolerance,
        )


def _observation_room(system: System, frames: int) -> Observed:
    """Make the arrays that `integrate` fills with what states cause."""
    coordinates = len(system.held)
    muscles = len(system.muscles.viscosity)
    return Observed(
        coordinates=np.zeros((frames, coordinates)),
        velocities=np.zeros((frames, coordinates)),
        accelerations=np.zeros((frames, coordinates)),
        activation=np.zeros((frames, muscles)),
        force=np.zeros((frames, muscles)),
        length=np.zeros((frames, muscles)),
        velocity=np.zeros((frames, muscles)),
        fiber_velocity=np.zeros((frames, muscles)),
        feedback=np.zeros((frames, len(system.free))),
        contact=np.zeros((frames, len(system.contacts.body), 6)),
        energy=np.zeros((frames, 2)),
    )
