"""Integration in time with control of the error of every step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.rigid.coordinates import Ints, couple_rates
from myomorph.core.rigid.kernels import bare, kernel
from myomorph.forward.equations import (
    WORK_COUNT,
    Machine,
    close_state,
    derivative,
    energies,
    make_room,
)

# Outcome of a run
RUNNING, DONE, TOO_MANY_STEPS, STEP_TOO_SMALL, SINGULAR_MASS, OPEN_LOOP = range(6)
# Entries of the counts of a run
OUTCOME, STEPS, REJECTED, EVALUATIONS = range(4)
# Entries of the clock of a run
TIME, STEP = range(2)

STAGES = 7
ORDER = 5.0
SAFETY = 0.9
MAX_SHRINKING = 0.2
MAX_GROWTH = 5.0
MIN_STEP = 1e-11  # [s]

# Dormand and Prince 1980: times of the stages, their weights in later stages and in the error, and
# coefficients of the powers 1 to 4 of the share of a step between its ends (Shampine 1986).
NODES = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
WEIGHTS = np.zeros((7, 7))
WEIGHTS[1, :1] = [1 / 5]
WEIGHTS[2, :2] = [3 / 40, 9 / 40]
WEIGHTS[3, :3] = [44 / 45, -56 / 15, 32 / 9]
WEIGHTS[4, :4] = [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729]
WEIGHTS[5, :5] = [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656]
WEIGHTS[6, :6] = [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84]
ERRORS = np.array(
    [-71 / 57600, 0.0, 71 / 16695, -71 / 1920, 17253 / 339200, -22 / 525, 1 / 40],
)
POWERS = np.array(
    [
        [1.0, -8048581381 / 2820520608, 8663915743 / 2820520608, -12715105075 / 11282082432],
        [0.0, 0.0, 0.0, 0.0],
        [0.0, 131558114200 / 32700410799, -68118460800 / 10900136933, 87487479700 / 32700410799],
        [0.0, -1754552775 / 470086768, 14199869525 / 1410260304, -10690763975 / 1880347072],
        [
            0.0,
            127303824393 / 49829197408,
            -318862633887 / 49829197408,
            701980252875 / 199316789632,
        ],
        [0.0, -282668133 / 205662961, 2019193451 / 616988883, -1453857185 / 822651844],
        [0.0, 40617522 / 29380423, -110615467 / 29380423, 69997945 / 29380423],
    ]
)


class Control(NamedTuple):
    """Control of the steps.

    Attributes
    ----------
    relative : largest error of a step by the size of each state
    absolute : (states,) and where a state is small, in its unit
    max_step : [s]
    max_steps : of a run
    """

    relative: float
    absolute: Array
    max_step: float
    max_steps: int


class Observed(NamedTuple):
    """What states cause, over frames.

    Attributes
    ----------
    coordinates, velocities, accelerations : (frames, coordinates) dependent ones included
    activation, force, length, velocity : (frames, muscles) of the muscle-tendon path the last two
    fiber_velocity : (frames, muscles) where tendons are elastic [m/s]
    feedback : (frames, free) forces of the feedback [N m or N]
    contact : (frames, spheres, 6) force on each [N] and where it acts [m], in ground
    energy : (frames, 2) kinetic and potential [J]
    """

    coordinates: Array
    velocities: Array
    accelerations: Array
    activation: Array
    force: Array
    length: Array
    velocity: Array
    fiber_velocity: Array
    feedback: Array
    contact: Array
    energy: Array

    def part(self, start: int, stop: int) -> Observed:
        """Frames from `start` to before `stop`."""
        return Observed(
            coordinates=self.coordinates[start:stop],
            velocities=self.velocities[start:stop],
            accelerations=self.accelerations[start:stop],
            activation=self.activation[start:stop],
            force=self.force[start:stop],
            length=self.length[start:stop],
            velocity=self.velocity[start:stop],
            fiber_velocity=self.fiber_velocity[start:stop],
            feedback=self.feedback[start:stop],
            contact=self.contact[start:stop],
            energy=self.energy[start:stop],
        )


class Progression(NamedTuple):
    """A run, or a part of one.

    Attributes
    ----------
    times : (frames,) ascending, the first not before the clock's time [s]
    y : (states,) changed
    clock : (2,) `TIME` and next `STEP` [s], changed
    counts : (4,) `OUTCOME`, `STEPS`, `REJECTED`, `EVALUATIONS`, added to
    states : (frames, states) filled as far as the run comes
    observed : `Observed`, filled as far as the run comes
    """

    times: Array
    y: Array
    clock: Array
    counts: Ints
    states: Array
    observed: Observed


@kernel
def integrate(S, rules, control, run):
    """Integrate from the time of the clock to the last of some times.

    An embedded Runge-Kutta pair of orders 5 and 4. A step is taken where its error is below 1 in

        max_i |error_i| / (absolute_i + relative max(|y_i|, |y_i'|))

    over all states but the works. Between the ends of a step its own polynomial of order 4 holds.
    Steps end on closed loops, where there are some.

    Parameters
    ----------
    S : `System`
    rules : `PathRules`
    control : `Control`
    run : `Progression`, changed
    """
    machine = Machine(system=S, rules=rules, room=make_room(S))
    k = np.zeros((STAGES, run.y.shape[0]))
    trial = np.empty(run.y.shape[0])
    counts = run.counts
    clock = run.clock
    if not _closed(machine, clock[TIME], run.y):
        counts[OUTCOME] = OPEN_LOOP
        return
    derivative(machine, clock[TIME], run.y, k[0])
    counts[EVALUATIONS] += 1
    frame = _put_first(machine, run)
    while frame < run.times.shape[0]:
        if counts[STEPS] + counts[REJECTED] >= control.max_steps:
            counts[OUTCOME] = TOO_MANY_STEPS
            return
        # The last step ends at the end.
        left = run.times[run.times.shape[0] - 1] - clock[TIME]
        h = min(min(clock[STEP], control.max_step), left)
        solved = _try_step(machine, run, h, k, trial)
        error = _error_of(control, run.y, trial, k, h)
        growth = MAX_GROWTH
        if error > 0.0 and np.isfinite(error):
            growth = min(MAX_GROWTH, max(MAX_SHRINKING, SAFETY * error ** (-1.0 / ORDER)))
        if not (error <= 1.0 and solved and _closed(machine, clock[TIME] + h, trial)):
            counts[REJECTED] += 1
            clock[STEP] = h * (growth if error > 1.0 and solved else MAX_SHRINKING)
            if clock[STEP] < MIN_STEP:
                counts[OUTCOME] = _cause(solved, error)
                return
            continue
        counts[STEPS] += 1
        frame = _put_step(machine, run, h, k, frame)
        _go_on(machine, run, h, k, trial)
        if h < left or growth < 1.0:
            clock[STEP] = growth * h
    counts[OUTCOME] = RUNNING


@bare
def _closed(machine, t, y):
    """Put a state onto closed loops; whether they are closed, as without any."""
    if machine.system.loops.body_1.shape[0] == 0:
        return True
    return close_state(machine, t, y)


@bare
def _cause(solved, error):
    """Why the shortest step was given up: a mass matrix, an open loop, or its error."""
    if not solved:
        return SINGULAR_MASS
    return OPEN_LOOP if error <= 1.0 else STEP_TOO_SMALL


@bare
def _go_on(machine, run, h, k, trial):
    """Begin the next step where one ended, with the rates there."""
    for i in range(run.y.shape[0]):
        run.y[i] = trial[i]
        k[0, i] = k[STAGES - 1, i]
    run.clock[TIME] += h
    # The last stage was not on the closed loops yet.
    if machine.system.loops.body_1.shape[0] > 0:
        derivative(machine, run.clock[TIME], run.y, k[0])
        run.counts[EVALUATIONS] += 1


@bare
def _put_first(machine, run):
    """Keep the state that a run begins with where it is asked for; the number of the next frame."""
    if run.times[0] > run.clock[TIME]:
        return 0
    for i in range(run.y.shape[0]):
        run.states[0, i] = run.y[i]
    _observe(machine.system, machine.room, run.observed, 0)
    return 1


@bare
def _try_step(machine, run, h, k, trial):
    """Fill the stages k of a step and the state at its end; whether all could be solved."""
    solved = True
    for stage in range(1, STAGES):
        for i in range(trial.shape[0]):
            value = 0.0
            for before in range(stage):
                value += WEIGHTS[stage, before] * k[before, i]
            trial[i] = run.y[i] + h * value
        solved &= derivative(machine, run.clock[TIME] + NODES[stage] * h, trial, k[stage])
    run.counts[EVALUATIONS] += STAGES - 1
    return solved


@bare
def _error_of(control, y, trial, k, h):
    """Find the largest error of a step, by what is allowed; NaN where a state is none."""
    largest = 0.0
    for i in range(y.shape[0] - WORK_COUNT):
        error = 0.0
        for stage in range(STAGES):
            error += ERRORS[stage] * k[stage, i]
        size = max(abs(y[i]), abs(trial[i]))
        scaled = abs(h * error) / (control.absolute[i] + control.relative * size)
        # Of a state that is not a number, too.
        if not scaled <= largest:
            largest = scaled
    return largest


@bare
def _put_step(machine, run, h, k, frame):
    """Keep the frames within a step, and what they cause; the number of the next frame."""
    end = run.clock[TIME] + h
    last = run.times.shape[0] - 1
    while frame <= last and (run.times[frame] <= end or end >= run.times[last]):
        share = (run.times[frame] - run.clock[TIME]) / h if h > 0.0 else 1.0
        _put_between(run.y, k, h, share, run.states[frame])
        _closed(machine, run.times[frame], run.states[frame])
        derivative(machine, run.times[frame], run.states[frame], machine.room.rate)
        _observe(machine.system, machine.room, run.observed, frame)
        frame += 1
    return frame


@bare
def _put_between(y, k, h, share, out):
    """Fill a state (states,) at a share of a step."""
    for i in range(y.shape[0]):
        value = 0.0
        for stage in range(STAGES):
            of_stage = 0.0
            for power in range(3, -1, -1):
                of_stage = share * (of_stage + POWERS[stage, power])
            value += k[stage, i] * of_stage
        out[i] = y[i] + h * value


@bare
def _observe(S, room, observed, frame):
    """Keep what the state that `derivative` was called with last causes."""
    for i in range(S.free.shape[0]):
        room.base[S.free[i]] = room.acceleration[i]
        observed.feedback[frame, i] = room.feedback[i]
    couple_rates(S.tree, room.motion.coordinates[0], room.motion.speeds[0], room.base)
    for j in range(S.held.shape[0]):
        observed.coordinates[frame, j] = room.motion.coordinates[0, j]
        observed.velocities[frame, j] = room.motion.speeds[0, j]
        observed.accelerations[frame, j] = room.base[j]
    for m in range(room.force.shape[0]):
        observed.activation[frame, m] = room.activation[m]
        observed.force[frame, m] = room.force[m]
        observed.length[frame, m] = room.results.values.lengths[0, m]
        observed.velocity[frame, m] = room.results.values.velocities[0, m]
        observed.fiber_velocity[frame, m] = room.fiber_velocity[m]
    for s in range(room.contact.shape[0]):
        for i in range(6):
            observed.contact[frame, s, i] = room.contact[s, i]
    observed.energy[frame, 0], observed.energy[frame, 1] = energies(S, room)
