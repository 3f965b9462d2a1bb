"""The equations of motion of one state, as a kernel.

    M(c) cddot = tau - h(c, cdot),    adot = (u - a) / tau(u, a),    ldot = v(a, l, path)

for the free coordinates c, activations a and fiber lengths l (Featherstone 2008; Thelen 2003). The
powers of all that does work on the body are states too, so that their sum can be held against its
energy.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.muscles import path_arrays as columns
from myomorph.core.muscles.hill import rigid_forces
from myomorph.core.muscles.path import (
    PathMotion,
    PathResults,
    PathRoom,
    PathRules,
    PathValues,
    frame_paths,
    path_room,
)
from myomorph.core.muscles.path_frame import place_frame
from myomorph.core.rigid.bushing_kernels import add_bushings
from myomorph.core.rigid.coordinates import State, couple_rates, evaluate, gather_dependents
from myomorph.core.rigid.dynamics import body_wrenches, project
from myomorph.core.rigid.kernels import bare, inner
from myomorph.core.rigid.kinematics import RateArrays, body_rates, rate_room
from myomorph.core.rigid.mass_matrix import CompositeArrays, composite_room, mass_matrix
from myomorph.core.rigid.vectors import cross, dot, matrix, minus, plus, put_vector, turned, vector
from myomorph.forward.arrays import (
    CONTACTS,
    DAMPING,
    FEEDBACK,
    LOADS,
    MUSCLE_VISCOSITY,
    MUSCLES,
    PRESCRIBED,
    RESERVES,
    SPRINGS,
    TORQUES,
    WORKS,
    System,
)
from myomorph.forward.contact_kernels import add_contacts
from myomorph.forward.loop_equations import (
    CLOSED,
    MAX_STEPS,
    NEARLY_CLOSED,
    LoopRoom,
    back_substitute,
    close_accelerations,
    close_positions,
    close_velocities,
    forward_substitute,
    loop_room,
)
from myomorph.forward.muscle_kernels import activation_rate, elastic_tendon

WORK_COUNT = len(WORKS)
SINGULAR = 1e-13  # Share of a diagonal entry that is left where the mass matrix has no inverse


class Room(NamedTuple):
    """Scratch arrays of one thread, and what the last state caused.

    Attributes
    ----------
    motion : (1, coordinates) coordinates and speeds
    base : (coordinates,) accelerations of coordinates that are not free
    rates : velocities of bodies
    path : of muscles, with the poses of bodies
    results : lengths, velocities and moment arms of muscles
    composite : bodies with all that hangs on them
    f, m : (bodies, 3) forces [N] and moments about the ground's origin [N m] that motion needs
    tau : (1, coordinates) generalized forces that are missing [N m or N]
    M : (coordinates, coordinates) mass matrix
    L : (free, free) its Cholesky factor
    acceleration, shift : (free,) and what closed loops change of it
    loop : closed loops
    pull, feedback : (free,) accelerations that feedback adds, and its forces [N m or N]
    power : (works,) [W]
    rate : (states,) of a state that is only looked at
    activation, force, fiber_velocity : (muscles,) [1], [N], [m/s]
    contact : (spheres, 6) force on each [N] and where it acts [m], in ground
    """

    motion: PathMotion
    base: Array
    rates: RateArrays
    path: PathRoom
    results: PathResults
    composite: CompositeArrays
    f: Array
    m: Array
    tau: Array
    M: Array
    L: Array
    acceleration: Array
    shift: Array
    loop: LoopRoom
    pull: Array
    feedback: Array
    power: Array
    rate: Array
    activation: Array
    force: Array
    fiber_velocity: Array
    contact: Array


class Machine(NamedTuple):
    """A body that moves, with the scratch arrays of one thread.

    Attributes
    ----------
    system : the body
    rules : of the lengths of paths
    room : scratch arrays
    """

    system: System
    rules: PathRules
    room: Room


@inner
def make_room(S):
    """Make the scratch arrays of a `System`."""
    T = S.tree
    coordinates = S.held.shape[0]
    bodies = T.parent.shape[0]
    free = S.free.shape[0]
    muscles = S.muscles.viscosity.shape[0]
    values = PathValues(
        lengths=np.zeros((1, muscles)),
        velocities=np.zeros((1, muscles)),
        arms=np.zeros((1, S.paths.arm.shape[0])),
    )
    return Room(
        motion=PathMotion(
            coordinates=np.zeros((1, coordinates)), speeds=np.zeros((1, coordinates))
        ),
        base=np.zeros(coordinates),
        rates=rate_room(T),
        path=path_room(T, S.paths),
        results=PathResults(values=values, pulls=np.zeros((1, 0, 6)), nodes=np.zeros((1, 0, 0, 4))),
        composite=composite_room(T),
        f=np.zeros((bodies, 3)),
        m=np.zeros((bodies, 3)),
        tau=np.zeros((1, coordinates)),
        M=np.zeros((coordinates, coordinates)),
        L=np.zeros((free, free)),
        acceleration=np.zeros(free),
        shift=np.zeros(free),
        loop=loop_room(S),
        pull=np.zeros(free),
        feedback=np.zeros(free),
        power=np.zeros(WORK_COUNT),
        rate=np.zeros(2 * free + S.activations + S.fibers + WORK_COUNT),
        activation=np.zeros(muscles),
        force=np.zeros(muscles),
        fiber_velocity=np.zeros(muscles),
        contact=np.zeros((S.contacts.body.shape[0], 6)),
    )


@bare
def derivative(machine, t, y, ydot):
    """Differentiate a state.

    Parameters
    ----------
    machine : `Machine`
    t : time [s]
    y : (states,)
    ydot : (states,) filled

    Returns
    -------
    whether the mass matrix has an inverse
    """
    S = machine.system
    room = machine.room
    for work in range(WORK_COUNT):
        room.power[work] = 0.0
    place_state(S, room, t, y)
    T = S.tree
    c = room.motion.coordinates[0]
    pose = room.path.frame.bodies
    body_rates(T, State(c=c, cdot=room.motion.speeds[0], cddot=room.base), pose, room.rates)
    body_wrenches(T, pose, room.rates, room.f, room.m)
    _apply_body_forces(S, room, t)
    project(T, pose, room.f, room.m, room.tau[0])
    _apply_coordinate_forces(S, room, t)
    gather_dependents(T, c, room.tau)
    _apply_muscles(machine, t, y, ydot)
    mass_matrix(T, c, pose, room.composite, room.M)
    solved = _factor(S, room)
    _accelerate(S, room)
    _follow(S, room, t)
    if S.loops.body_1.shape[0] > 0:
        close_accelerations(S, room)
    _prescribed_power(S, room)

    n = S.free.shape[0]
    for i in range(n):
        ydot[i] = room.motion.speeds[0, S.free[i]]
        ydot[n + i] = room.acceleration[i]
    first = y.shape[0] - WORK_COUNT
    for work in range(WORK_COUNT):
        ydot[first + work] = room.power[work]
    return solved


@bare
def place_state(S, room, t, y):
    """Put the coordinates of a state in place, with poses of bodies and paths.

    Free coordinates are the state's, prescribed ones follow time, others are held, dependent ones
    follow their couplers.
    """
    c = room.motion.coordinates[0]
    v = room.motion.speeds[0]
    n = S.free.shape[0]
    for j in range(c.shape[0]):
        c[j] = S.held[j]
        v[j] = 0.0
        room.base[j] = 0.0
    for p in range(S.prescribed.shape[0]):
        j = S.prescribed[p]
        c[j], v[j], _, room.base[j], _, _ = evaluate(S.prescribed_functions, p, t, 0.0)
    for i in range(n):
        c[S.free[i]] = y[i]
        v[S.free[i]] = y[n + i]
    place_frame(S.tree, S.paths, c, room.path.frame)
    couple_rates(S.tree, c, v, room.base)


@bare
def sample_at(time, t):
    """Find the sample before t, and how far t is from it to the next, held at both ends."""
    last = time.shape[0] - 1
    if last <= 0 or t <= time[0]:
        return 0, 0.0
    if t >= time[last]:
        return last - 1, 1.0
    low = 0
    high = last
    while high - low > 1:
        middle = (low + high) // 2
        if time[middle] <= t:
            low = middle
        else:
            high = middle
    return low, (t - time[low]) / (time[high] - time[low])


@bare
def _apply_body_forces(S, room, t):
    """Take bushings, contacts and external forces off the wrenches that bodies need."""
    f = room.f
    m = room.m
    for b in range(f.shape[0]):
        for i in range(3):
            f[b, i] = -f[b, i]
            m[b, i] = -m[b, i]
    pose = room.path.frame.bodies
    springs, dampers = add_bushings(S.bushings, pose, room.rates, f, m)
    room.power[SPRINGS] += springs
    room.power[DAMPING] += dampers
    room.power[CONTACTS] += add_contacts(S.contacts, pose, room.rates, (f, m), room.contact)
    D = S.drives
    if D.load_body.shape[0] > 0:
        k, share = sample_at(D.load_time, t)
        for load in range(D.load_body.shape[0]):
            b = D.load_body[load]
            now = D.loads[k, load]
            after = D.loads[min(k + 1, D.load_time.shape[0] - 1), load]
            force = _between(now, after, share, 0)
            moment = _between(now, after, share, 3)
            put_vector(f, b, plus(vector(f, b), force))
            put_vector(m, b, plus(vector(m, b), moment))
            W = vector(room.rates.omega, b)
            at_origin = minus(vector(room.rates.v, b), cross(W, vector(pose.p, b)))
            room.power[LOADS] += dot(force, at_origin) + dot(moment, W)


@bare
def _between(first, second, share, start):
    """Interpolate three entries of two rows."""
    return (
        first[start] + share * (second[start] - first[start]),
        first[start + 1] + share * (second[start + 1] - first[start + 1]),
        first[start + 2] + share * (second[start + 2] - first[start + 2]),
    )


@bare
def _apply_coordinate_forces(S, room, t):
    """Add passive torques, given ones and reserves to the generalized forces."""
    c = room.motion.coordinates[0]
    v = room.motion.speeds[0]
    tau = room.tau[0]
    springs = S.springs
    for s in range(springs.coordinate.shape[0]):
        j = springs.coordinate[s]
        torque = evaluate(springs.functions, springs.torque[s], c[j], 0.0)[0]
        drag = -evaluate(springs.functions, springs.damping[s], c[j], 0.0)[0] * v[j]
        tau[j] += torque + drag
        room.power[SPRINGS] += torque * v[j]
        room.power[DAMPING] += drag * v[j]
    D = S.drives
    samples = D.torque_time.shape[0]
    if samples > 0:
        k, share = sample_at(D.torque_time, t)
        for j in range(tau.shape[0]):
            torque = D.torques[k, j]
            torque += share * (D.torques[min(k + 1, samples - 1), j] - torque)
            tau[j] += torque
            room.power[TORQUES] += torque * v[j]
    samples = D.reserve_time.shape[0]
    if samples > 0:
        k, share = sample_at(D.reserve_time, t)
        for j in range(tau.shape[0]):
            torque = D.reserves[k, j]
            torque += share * (D.reserves[min(k + 1, samples - 1), j] - torque)
            tau[j] += torque
            room.power[RESERVES] += torque * v[j]


@bare
def _apply_muscles(machine, t, y, ydot):
    """Add the forces of muscles, and find the rates of activations and fibers.

    Moment arms of independent coordinates hold what reaches a muscle through dependent ones.
    """
    S = machine.system
    room = machine.room
    M = S.muscles
    if M.viscosity.shape[0] == 0:
        return
    frame_paths(S.paths, machine.rules, room.path, (room.motion, room.results), 0)
    pattern = S.paths.arm
    start = S.paths.start
    values = room.results.values
    for m in range(M.viscosity.shape[0]):
        if not M.enabled[m]:
            continue
        _pull(S, room, m, _drive(S.drives, m, t), y, ydot)
        velocity = values.velocities[0, m]
        drag = M.viscosity[m] * velocity
        force = room.force[m] + drag
        shortening = 0.0
        for arm in range(start[m, columns.ARMS], start[m + 1, columns.ARMS]):
            if pattern[arm, 1] == 1:
                j = pattern[arm, 0]
                room.tau[0, j] += values.arms[0, arm] * force
                shortening += values.arms[0, arm] * room.motion.speeds[0, j]
        # A path may have a function of its own for its velocity, which does no work.
        room.power[MUSCLES] += room.force[m] * shortening
        room.power[MUSCLE_VISCOSITY] += drag * shortening


@bare
def _drive(D, m, t):
    """Read activation or excitation of muscle m at a time, 0 where nothing drives it."""
    samples = D.muscle_time.shape[0]
    if samples == 0:
        return 0.0
    k, share = sample_at(D.muscle_time, t)
    drive = D.muscles[k, m]
    return drive + share * (D.muscles[min(k + 1, samples - 1), m] - drive)


@bare
def _pull(S, room, m, drive, y, ydot):
    """Find activation and force of muscle m, and the rates of its states."""
    M = S.muscles
    first = 2 * S.free.shape[0]
    if S.activations > 0:
        ydot[first + m] = activation_rate(M, m, y[first + m], drive)
        drive = y[first + m]
    a = min(max(drive, M.least[m]), 1.0)
    room.activation[m] = a
    length = room.results.values.lengths[0, m]
    if M.fiber[m] >= 0:
        at = first + S.activations + M.fiber[m]
        room.force[m], ydot[at] = elastic_tendon(M, m, length, a, y[at])
        room.fiber_velocity[m] = ydot[at]
        return
    velocity = room.results.values.velocities[0, m]
    active, passive = rigid_forces(M.hill, m, length, velocity, True)
    room.force[m] = a * active + passive


@bare
def _factor(S, room):
    """Fill Cholesky's factor of the free coordinates' mass matrix; whether there is one."""
    n = S.free.shape[0]
    L = room.L
    solved = True
    for i in range(n):
        for j in range(i + 1):
            value = room.M[S.free[i], S.free[j]]
            for k in range(j):
                value -= L[i, k] * L[j, k]
            if i > j:
                L[i, j] = value / L[j, j]
                continue
            diagonal = room.M[S.free[i], S.free[i]]
            if not value > SINGULAR * diagonal:
                solved = False
                value = max(diagonal, 1e-300)
            L[i, i] = math.sqrt(value)
    return solved


@bare
def _accelerate(S, room):
    """Solve M x = tau for the free coordinates by Cholesky's factor."""
    for i in range(S.free.shape[0]):
        room.acceleration[i] = room.tau[0, S.free[i]]
    forward_substitute(room.L, room.acceleration)
    back_substitute(room.L, room.acceleration)


@bare
def close_state(machine, t, y):
    """Put a state back onto the closed loops: its coordinates, then its velocities.

    Parameters
    ----------
    machine : `Machine`
    t : time [s]
    y : (states,) changed

    Returns
    -------
    whether all loops are closed
    """
    S = machine.system
    room = machine.room
    n = S.free.shape[0]
    largest = 0.0
    before = math.inf
    for _ in range(MAX_STEPS):
        if not _weigh(S, room, t, y):
            return False
        largest = close_positions(S, room)
        if largest <= CLOSED or not largest < before:
            break
        before = largest
        for i in range(n):
            y[i] += room.acceleration[i]
    c = room.motion.coordinates[0]
    pose = room.path.frame.bodies
    body_rates(S.tree, State(c=c, cdot=room.motion.speeds[0], cddot=room.base), pose, room.rates)
    close_velocities(S, room)
    for i in range(n):
        y[n + i] += room.acceleration[i]
    return largest <= NEARLY_CLOSED


@bare
def _weigh(S, room, t, y):
    """Put a state in place with the factor of its mass matrix; whether there is one."""
    place_state(S, room, t, y)
    pose = room.path.frame.bodies
    mass_matrix(S.tree, room.motion.coordinates[0], pose, room.composite, room.M)
    return _factor(S, room)


@bare
def _follow(S, room, t):
    """Add accelerations that pull the body to a motion, and find the forces that cause them.

        pull = w^2 (c_f - c) + 2 w (cdot_f - cdot),   feedback = M pull

    Between samples c_f is the cubic with the samples' values and rates.
    """
    D = S.drives
    w = D.frequency[0]
    if w == 0.0 or D.followed_time.shape[0] == 0:
        return
    n = S.free.shape[0]
    k, s = sample_at(D.followed_time, t)
    for i in range(n):
        value, rate = _followed(D, k, s, i)
        j = S.free[i]
        error = value - room.motion.coordinates[0, j]
        room.pull[i] = w * w * error + 2.0 * w * (rate - room.motion.speeds[0, j])
    for i in range(n):
        force = 0.0
        for other in range(n):
            force += room.M[S.free[i], S.free[other]] * room.pull[other]
        room.feedback[i] = force
        room.power[FEEDBACK] += force * room.motion.speeds[0, S.free[i]]
    for i in range(n):
        room.acceleration[i] += room.pull[i]


@bare
def _followed(D, k, s, i):
    """Find value and rate of a followed coordinate, a share s beyond sample k."""
    after = min(k + 1, D.followed_time.shape[0] - 1)
    h = D.followed_time[after] - D.followed_time[k]
    c0 = D.followed[k, i]
    c1 = D.followed[after, i]
    if not h > 0.0:
        return c0, D.followed_rates[k, i]
    v0 = h * D.followed_rates[k, i]
    v1 = h * D.followed_rates[after, i]
    bend = 3.0 * (c1 - c0) - 2.0 * v0 - v1
    twist = 2.0 * (c0 - c1) + v0 + v1
    value = c0 + s * (v0 + s * (bend + s * twist))
    return value, (v0 + s * (2.0 * bend + 3.0 * s * twist)) / h


@bare
def _prescribed_power(S, room):
    """Find the power of what moves the prescribed coordinates."""
    for p in range(S.prescribed.shape[0]):
        j = S.prescribed[p]
        force = -room.tau[0, j]
        for i in range(S.free.shape[0]):
            force += room.M[j, S.free[i]] * room.acceleration[i]
        for row in range(room.loop.G.shape[0]):
            force -= room.loop.G[row, j] * room.loop.multipliers[row]
        room.power[PRESCRIBED] += force * room.motion.speeds[0, j]


@bare
def energies(S, room):
    """Kinetic and potential energy of the state that `derivative` was called with last [J]."""
    T = S.tree
    pose = room.path.frame.bodies
    gravity = (T.gravity[0], T.gravity[1], T.gravity[2])
    kinetic = 0.0
    potential = 0.0
    for b in range(1, T.parent.shape[0]):
        r = matrix(pose.R, b)
        W = vector(room.rates.omega, b)
        arm = turned(r, vector(T.mass_center, b))
        v = plus(vector(room.rates.v, b), cross(W, arm))
        # The angular velocity in the body, where the inertia is constant.
        spin = (
            r[0] * W[0] + r[3] * W[1] + r[6] * W[2],
            r[1] * W[0] + r[4] * W[1] + r[7] * W[2],
            r[2] * W[0] + r[5] * W[1] + r[8] * W[2],
        )
        kinetic += 0.5 * T.mass[b] * dot(v, v)
        kinetic += 0.5 * dot(spin, turned(matrix(T.inertia, b), spin))
        potential -= T.mass[b] * dot(gravity, plus(vector(pose.p, b), arm))
    return kinetic, potential
