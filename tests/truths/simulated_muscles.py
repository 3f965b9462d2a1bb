"""People with muscles of their own, integrated independently.

Fiber dynamics are by SciPy, with known activations.

The person's model has other optimal fiber lengths, tendon slack lengths and strengths. Fibers start
in equilibrium and are integrated with `muscles.fiber_equations` (the equations that agree with
OpenSim's own muscles) by LSODA; nothing of `tension.personal` takes part.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

import myomorph as mm
from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.paths import Muscle
from myomorph.core.model.sides import split_side
from myomorph.core.muscles.fiber_equations import FIBER_LENGTH, Fibers
from myomorph.core.muscles.fiber_states import equilibrium, fibers_of, state_names
from myomorph.core.muscles.passive import joint_forces
from myomorph.core.rigid.dynamics import values_and_rates
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.terms.emg import EmgTarget

REACH = 0.15
"""Normalized fiber length by which a person's muscle may pass the range of the generic one."""


@dataclass(frozen=True)
class Errors:
    """What is measured wrongly.

    Attributes
    ----------
    torque : share of each torque's root mean square, slowly varying
    emg : share of an activation, slowly varying
    floor : of EMG
    gain : standard deviation of the logarithm of each muscle's gain
    """

    torque: float = 0.03
    emg: float = 0.15
    floor: float = 0.02
    gain: float = 0.2


@dataclass(frozen=True)
class Spread:
    """How people differ, as standard deviations.

    They are of log optimal length, normalized length in a pose, and log strength. By default they
    are those that `personalize` assumes, as intervals have their coverage for no other people.
    """

    fiber: float = 0.15
    point: float = 0.12
    strength: float = 0.25
    sides: float = 0.8


def person(
    model: mm.Model,
    motions: Sequence[mm.Motion],
    spread: Spread,
    rng: np.random.Generator,
    groups: Array,
) -> mm.Model:
    """Return a model with muscles of another person.

    They work in a physiological range in some motions.

    Parameters
    ----------
    model : the generic one
    motions : in which the muscles work
    spread : standard deviations of the muscles' parameters
    rng : generator of the draws
    groups : (muscles,) muscles of one number share their strength

    Returns
    -------
    Model with other optimal fiber lengths, tendon slack lengths and strengths
    """
    lengths = np.vstack(
        [
            mm.muscle_kinematics(model, one, velocities=False, moment_arms=False).muscle_length
            for one in motions
        ]
    )
    rise = np.exp(spread.strength * rng.standard_normal(int(groups.max()) + 1))
    shared = {
        name: rng.standard_normal((200, 2))
        for name in {split_side(one.name)[0]: 0 for one in model.muscles}
    }
    muscles = []
    for m, muscle in enumerate(model.muscles):
        optimal, slack = _drawn_lengths(muscle, lengths[:, m], spread, shared, rng)
        muscles.append(
            replace(
                muscle,
                optimal_fiber_length=optimal,
                tendon_slack_length=slack,
                max_isometric_force=muscle.max_isometric_force * float(rise[groups[m]]),
            )
        )
    return replace(model, muscles=tuple(muscles))


def _drawn_lengths(
    muscle: Muscle,
    lengths: Array,
    spread: Spread,
    shared: Mapping[str, Array],
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Draw optimal fiber length and tendon slack length [m].

    Parameters
    ----------
    muscle : the generic one
    lengths : (poses,) of its path [m]
    spread : standard deviations
    shared : (200, 2) draws of both sides by the name without side
    rng : generator of each side's own draws
    """
    lo = muscle.optimal_fiber_length
    ls = muscle.tendon_slack_length
    mean = float(lengths.mean())
    low = float(lengths.min())
    high = float(lengths.max())
    base, side = split_side(muscle.name)
    alike = spread.sides if side else 0.0
    # Not beyond what fibers reach, or the generic ones do: else a muscle that the generic paths
    # stretch too far would be drawn until it is that of nobody.
    ends = min(0.4, (low - 1.02 * ls) / lo - REACH), max(1.55, (high - ls) / lo + REACH)
    for k in range(200):
        draw = np.sqrt(alike) * shared[base][k] + np.sqrt(1.0 - alike) * rng.standard_normal(2)
        new = lo * np.exp(spread.fiber * draw[0])
        slack = mean - ((mean - ls) / lo + spread.point * draw[1]) * new
        if (
            slack > 0.3 * ls
            and ends[0] < (low - 1.02 * slack) / new
            and (high - slack) / new < ends[1]
        ):
            return new, slack
    return lo, ls


def some_gains(model: mm.Model, errors: Errors, rng: np.random.Generator) -> dict[str, float]:
    """Draw a gain of the EMG of every muscle."""
    return {name: float(np.exp(errors.gain * rng.standard_normal())) for name in model.muscle_names}


def smooth_activations(
    time: Array, muscles: int, rng: np.random.Generator, most: float = 0.7
) -> Array:
    """Make bursts of activation of about a third of a second.

    Parameters
    ----------
    time : (frames,) at equal steps [s]
    muscles : number
    rng : generator of the bursts
    most : above 0.02

    Returns
    -------
    (frames, muscles) activations from 0.02 to 0.02 + `most`
    """
    raw = rng.standard_normal((len(time), muscles))
    smooth = gaussian_filter1d(raw, 0.08 / (time[1] - time[0]), axis=0)
    smooth /= smooth.std(axis=0)
    return 0.02 + most / (1.0 + np.exp(-1.5 * (smooth - 0.7)))


def integrated_forces(model: mm.Model, motion: mm.Motion, activations: Array) -> Array:
    """Integrate muscles under known activations, each by itself.

    Parameters
    ----------
    model : whose muscles have the state of a fiber length
    motion : with velocities
    activations : (frames, muscles)

    Returns
    -------
    (frames, muscles) tendon forces [N]
    """
    moved = mm.muscle_kinematics(model, motion, moment_arms=False)
    time = np.array(motion.time)
    found = np.empty_like(activations)
    for m, muscle in enumerate(model.muscles):
        if FIBER_LENGTH not in state_names(muscle):
            raise ValueError(f"{muscle.kind}: integrated_degroote takes all its muscles at once")
        length = CubicSpline(time, moved.muscle_length[:, m])
        speed = CubicSpline(time, moved.muscle_velocity[:, m])
        a = CubicSpline(time, activations[:, m])

        def at(
            t: Array,
            state: Array,
            muscle: Muscle = muscle,
            given: tuple[CubicSpline, ...] = (length, speed, a),
        ) -> Fibers:
            t = np.atleast_1d(t)
            return fibers_of(muscle, *(one(t) for one in given), np.atleast_1d(state))

        first = equilibrium(muscle, length(time[:1]), speed(time[:1]), a(time[:1]))
        if not np.isfinite(first).all():
            first = np.array([muscle.optimal_fiber_length])
        done = solve_ivp(
            lambda t, state, at=at: at(t, state).fiber_velocity,
            (time[0], time[-1]),
            first,
            "LSODA",
            time,
            rtol=1e-6,
            atol=1e-8,
            max_step=0.02,
        )
        found[:, m] = at(time, done.y[0]).tendon_force
    return found


def as_degroote(model: mm.Model) -> mm.Model:
    """Return the model with muscles of De Groote's class.

    Their fiber velocity is explicit in tendon force and activation.
    """
    own = {
        "fiber_damping": 0.0,
        "tendon_strain_at_one_norm_force": 0.049,
        "active_force_width_scale": 1.0,
    }
    own |= {"passive_fiber_strain_at_one_norm_force": 0.6, "ignore_tendon_compliance": 0.0}
    changed = (
        replace(
            one, kind="DeGrooteFregly2016Muscle", parameters=FrozenMap(own), curves=FrozenMap({})
        )
        for one in model.muscles
    )
    return replace(model, muscles=tuple(changed))


def integrated_degroote(person: mm.Model, lengths: Array, time: Array, activations: Array) -> Array:
    """Integrate all muscles at once, in equations of our own (De Groote et al. 2016).

    The state is each muscle's normalized tendon force f; its rate follows from the path's speed
    less the fiber's.

    Parameters
    ----------
    person : with muscles of De Groote's class
    lengths : (frames, muscles) of the paths [m], or (frames, recordings * muscles) of several
        recordings side by side
    time : (frames,) [s]
    activations : of the shape of `lengths`

    Returns
    -------
    of the shape of `lengths`, tendon forces [N]
    """
    recordings = lengths.shape[1] // len(person.muscles)
    fibers = _DegrooteFibers.of(person, recordings)
    path = CubicSpline(time, lengths)
    a_of = CubicSpline(time, activations)
    path_speed = path.derivative()

    def rate(t: float, f: Array) -> Array:
        return fibers.force_rate(f, path(t), path_speed(t), a_of(t))

    first = np.full(lengths.shape[1], 0.1)
    # Fibers find their equilibrium before the recording begins.
    settled = solve_ivp(
        lambda t, f: (
            rate(time[0], f) - path_speed(time[0]) * fibers.steepness * (f + 0.2) / fibers.slack
        ),
        (0.0, 0.5),
        first,
        "LSODA",
        rtol=1e-5,
        atol=1e-7,
        lband=0,
        uband=0,
    ).y[:, -1]
    done = solve_ivp(
        rate, (time[0], time[-1]), settled, "LSODA", time, rtol=1e-6, atol=1e-8, lband=0, uband=0
    )
    found = done.y.T
    if found.shape != lengths.shape or not -0.3 < found.min() <= found.max() < 3.0:
        raise RuntimeError(
            f"fibers were not followed: normalized forces {found.min():.2g} to {found.max():.2g}"
        )
    return found * fibers.force


@dataclass(frozen=True, kw_only=True, eq=False)
class _DegrooteFibers:
    """Muscles of De Groote's class side by side, all (muscles,).

    Attributes
    ----------
    optimal, slack : lengths of fiber and tendon [m]
    force : maximum isometric [N]
    height : of the fibers across the line of action [m]
    fastest : contraction velocity [optimal lengths/s]
    strain : of a passive fiber at the maximum isometric force
    steepness : of the tendon's exponential, k
    """

    optimal: Array
    slack: Array
    force: Array
    height: Array
    fastest: Array
    strain: Array
    steepness: Array

    @classmethod
    def of(cls, person: mm.Model, recordings: int) -> _DegrooteFibers:
        """Repeat a person's muscles for several recordings."""

        def column(value: Callable[[Muscle], float]) -> Array:
            return np.tile([value(one) for one in person.muscles], recordings)

        optimal = column(lambda one: one.optimal_fiber_length)
        stretch = column(lambda one: one.parameters["tendon_strain_at_one_norm_force"])
        return cls(
            optimal=optimal,
            slack=column(lambda one: one.tendon_slack_length),
            force=column(lambda one: one.max_isometric_force),
            height=optimal * np.sin(column(lambda one: one.pennation_at_optimal)),
            fastest=column(lambda one: one.max_contraction_velocity),
            strain=column(lambda one: one.parameters["passive_fiber_strain_at_one_norm_force"]),
            steepness=np.log(6.0) / stretch,
        )

    def force_rate(self, f: Array, path: Array, speed: Array, activation: Array) -> Array:
        """Return the rate of normalized tendon forces f [1/s].

        Parameters
        ----------
        f : (muscles,)
        path, speed : (muscles,) of the paths [m, m/s]
        activation : (muscles,)
        """
        k = self.steepness
        tendon = self.slack * (np.log(5.0 * np.maximum(f + 0.2, 1e-6)) / k + 1.0)
        along = np.maximum(path - tendon, 0.05 * self.optimal)
        fiber = np.hypot(along, self.height)
        cosine = along / fiber
        x = fiber / self.optimal
        least = np.exp(-3.2 / self.strain)
        passive = (np.exp(4.0 * (x - 1.0) / self.strain) - least) / (np.exp(4.0) - least)
        active = np.maximum(activation * _active_curve(x), 1e-4)
        f_v = np.clip((f / cosine - np.maximum(passive, 0.0)) / active, -0.5, 2.2)
        v = (np.sinh((f_v - 0.8825327733249912) / -0.3211346127989808) + 0.374) / -8.149
        fiber_speed = v * self.fastest * self.optimal / cosine
        return (speed - fiber_speed) * k * (f + 0.2) / self.slack


def _active_curve(x: Array) -> Array:
    """Return the active force of normalized fiber lengths x, a sum of three bells."""
    return (
        0.8150671134243542
        * np.exp(
            -0.5 * ((x - 1.055033428970575) / (0.162384573599574 + 0.063303448465465 * x)) ** 2
        )
        + 0.433004984392647
        * np.exp(
            -0.5 * ((x - 0.716775413397760) / (0.200356847296188 * x - 0.029947116970696)) ** 2
        )
        + 0.1 * np.exp(-0.5 * ((x - 1.0) / 0.353553390593274) ** 2)
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Laboratory:
    """What measures a person.

    Attributes
    ----------
    errors : of torques and EMG
    gains : of the EMG of each muscle that has it
    rng : generator of the errors
    """

    errors: Errors
    gains: Mapping[str, float]
    rng: np.random.Generator


@dataclass(frozen=True, kw_only=True, eq=False)
class Performance:
    """A motion and the activations that a person does it with.

    Attributes
    ----------
    name : of the recording
    motion : with velocities
    activations : (frames, muscles)
    forces : (frames, muscles) of the person's tendons under these activations, None to integrate
        them [N]
    """

    name: str
    motion: mm.Motion
    activations: Array
    forces: Array | None = None


def recorded(
    model: mm.Model, person: mm.Model, performance: Performance, laboratory: Laboratory
) -> mm.PersonalTrial:
    """Return what is measured of a person: torques and EMG with errors.

    Parameters
    ----------
    model : the generic one, for joints' own torques
    person : with muscles of its own
    performance : of the person
    laboratory : with its errors
    """
    motion = performance.motion
    errors = laboratory.errors
    rng = laboratory.rng
    moved = mm.muscle_kinematics(person, motion)
    forces = performance.forces
    if forces is None and FIBER_LENGTH not in state_names(person.muscles[0]):
        forces = integrated_degroote(
            person, moved.muscle_length, np.array(motion.time), performance.activations
        )
    elif forces is None:
        forces = integrated_forces(person, motion, performance.activations)
    torques = muscle_torques(model, moved.moment_arm, forces)
    tree = compile_tree(model)
    torques = torques + joint_forces(tree, *values_and_rates(tree, motion))
    size = np.sqrt(np.mean(torques**2, axis=0))
    torques = torques + errors.torque * size * slow(motion.time, torques.shape, rng)
    emg = _measured_emg(model, performance, laboratory)
    target = EmgTarget(tuple(laboratory.gains), emg) if laboratory.gains else None
    return mm.PersonalTrial(
        performance.name, motion, mm.Series(motion.time, model.coordinate_names, torques), target
    )


def _measured_emg(model: mm.Model, performance: Performance, laboratory: Laboratory) -> Array:
    """Return envelopes (frames, muscles with a gain), with errors and in units of the gains."""
    errors = laboratory.errors
    time = performance.motion.time
    columns = [model.muscle_names.index(one) for one in laboratory.gains]
    shape = (len(time), len(columns))
    activations = performance.activations[:, columns]
    emg = activations * (1.0 + errors.emg * slow(time, shape, laboratory.rng))
    emg = np.maximum(emg + errors.floor * slow(time, emg.shape, laboratory.rng), 0.0)
    return emg / list(laboratory.gains.values())


def all_recorded(
    model: mm.Model,
    person: mm.Model,
    motions: Sequence[mm.Motion],
    activations: Sequence[Array],
    laboratory: Laboratory,
) -> list[mm.PersonalTrial]:
    """Return the same of several motions on one clock, of De Groote's class.

    They are integrated side by side.

    Parameters
    ----------
    model : the generic one, for joints' own torques
    person : with muscles of De Groote's class
    motions : of the person, with the same times
    activations : (frames, muscles) of each motion
    laboratory : with its errors

    Returns
    -------
    the recording of each motion
    """
    lengths = [
        mm.muscle_kinematics(person, one, velocities=False, moment_arms=False).muscle_length
        for one in motions
    ]
    together = integrated_degroote(
        person, np.hstack(lengths), np.array(motions[0].time), np.hstack(activations)
    )
    forces = np.split(together, len(motions), axis=1)
    performances = [
        Performance(name=f"recording {k}", motion=motion, activations=a, forces=forces[k])
        for k, (motion, a) in enumerate(zip(motions, activations, strict=True))
    ]
    return [recorded(model, person, one, laboratory) for one in performances]


def with_other_muscles(person: mm.Model, rng: np.random.Generator) -> mm.Model:
    """Return the person with other tendons, pennation, velocity and passive curves.

    These are estimated only by groups or not at all.
    """
    muscles = []
    for one in person.muscles:
        stretch, angle, most, strain = np.exp(rng.standard_normal(4) * [0.2, 0.15, 0.1, 0.1])
        parameters = dict(one.parameters)
        parameters["tendon_strain_at_one_norm_force"] *= float(stretch)
        parameters["passive_fiber_strain_at_one_norm_force"] *= float(strain)
        muscles.append(
            replace(
                one,
                pennation_at_optimal=min(one.pennation_at_optimal * float(angle), 0.6),
                max_contraction_velocity=one.max_contraction_velocity * float(most),
                parameters=FrozenMap(parameters),
            )
        )
    return replace(person, muscles=tuple(muscles))


def slow(time: Array, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Make errors of unit size that vary within a tenth of a second.

    Parameters
    ----------
    time : (frames,) at equal steps [s]
    shape : (frames, ...) of the errors
    rng : generator

    Returns
    -------
    of this shape, standard deviation 1
    """
    raw = gaussian_filter1d(rng.standard_normal(shape), 0.04 / (time[1] - time[0]), axis=0)
    return raw / max(float(raw.std()), 1e-12)


def swings(
    model: mm.Model, ranges: dict[str, tuple[float, float]], time: Array, rng: np.random.Generator
) -> mm.Motion:
    """Make coordinates that swing between bounds at periods of about a second.

    Each has a phase of its own.

    Parameters
    ----------
    model : with the coordinates
    ranges : lower and upper bound of coordinates by name [rad or m]; the others stay at their
        default
    time : (frames,) [s]
    rng : generator of periods and phases

    Returns
    -------
    Motion with velocities and accelerations of 0
    """
    values = np.tile([one.default for one in model.coordinates], (len(time), 1))
    speeds = np.tile([one.default for one in model.coordinates], (len(time), 1))
    speeds[:] = 0.0
    for name, (low, high) in ranges.items():
        j = model.coordinate_names.index(name)
        a = 0.5 * (high - low)
        w = 2.0 * np.pi / rng.uniform(0.8, 1.6)
        p = rng.uniform(0.0, 2.0 * np.pi)
        values[:, j] = 0.5 * (high + low) + a * np.sin(w * time + p)
        speeds[:, j] = a * w * np.cos(w * time + p)
    return mm.Motion(time, model.coordinate_names, values, speeds, np.zeros_like(values))


def muscle_torques(model: mm.Model, arms: Array, forces: Array) -> Array:
    """Return torques of tendon forces.

    Parameters
    ----------
    model : with the coordinates
    arms : (frames, muscles, coordinates) with couplers: those of a knee hold what goes through its
        patella [m]
    forces : (frames, muscles) [N]

    Returns
    -------
    (frames, coordinates), 0 for dependent coordinates [N m or N]
    """
    torques = np.einsum("fmc,fm->fc", arms, forces)
    torques[:, [model.coordinate_names.index(name) for name in model.dependent_coordinates]] = 0.0
    return torques


def resting_torques(model: mm.Model, motion: mm.Motion) -> Array:
    """Return torques of joints and of resting muscles in equilibrium.

    Parameters
    ----------
    model : with the muscles
    motion : its poses, with velocities

    Returns
    -------
    (poses, coordinates), NaN where a muscle has no equilibrium [N m or N]
    """
    moved = mm.muscle_kinematics(model, motion)
    rest = np.full(len(motion), 1e-4)
    zero = np.zeros(len(motion))
    forces = np.zeros(moved.muscle_length.shape)
    whole = np.ones(len(motion), bool)
    for m, muscle in enumerate(model.muscles):
        state = equilibrium(muscle, moved.muscle_length[:, m], zero, rest)
        known = np.isfinite(state)
        resting = fibers_of(
            muscle, moved.muscle_length[:, m], zero, rest, np.where(known, state, 0.01)
        )
        forces[:, m] = resting.tendon_force
        whole &= known
    tree = compile_tree(model)
    torques = muscle_torques(model, moved.moment_arm, forces) + joint_forces(
        tree, *values_and_rates(tree, motion)
    )
    torques[~whole] = np.nan
    return torques
