"""A simulated person who moves as planned, with every contact force and activation known.

None of them comes from Myomorph's kernels. The body is that of `simulate.fighter`, alone, with
masses, muscles' points and strengths that the laboratory does not know. MuJoCo's inverse dynamics
gives what the planned motion needs. Contacts share it by weights drawn at random and a push of the
feet against each other; muscles by random weights, a random tone and cubes. Synthetic: nobody was
measured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import mujoco
import numpy as np

from myomorph.core.io.mjcf.read import coordinates_from_qpos, model_from_mujoco
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.motion.splines import natural_spline
from myomorph.show.simulate import fighter
from myomorph.show.simulate.bout import (
    Program,
    least,
    mass_matrix,
    moments,
    muscle_strength,
    pyramids,
)
from myomorph.show.simulate.flight import balanced_leans
from myomorph.show.simulate.plan import Aim, jacobian, posed, start_pose

KNOT_RATE = 20.0  # Poses of a plan a second.
STEP = 2.5e-4  # Of derivatives by differences [s].
MASS = 72.0
HEIGHT = 1.75  # Of the person [kg, m].
FRICTION = 0.6
ALONE = ("",)  # Of the soles; names of joints begin with nothing.
# Share of a newton, or newton meter, that a wrench or torque may be missed by for a cost of 1e4.
EXACT = 1e-4
ACCURACY = 1e-7  # Of the choices of forces and activations.


@read_only
class Contact:
    """Where the person touches.

    `on` is (frames,) how ready it is to carry, 0 to 1, from times. `share` is of the weight that
    each of its points would take, against others.
    """

    name: str
    body: str
    points: Array  # (points, 3) in the body's frame [m]
    on: Callable[[Array], Array] = np.ones_like
    share: float = 1.0


@read_only
class Blow:
    """An impact, as a drum gives it: a half-sine of force on a point along +y.

    It has the time when it begins [s], its impulse [N s] and its length [s].
    """

    body: str
    point: Array
    time: float
    impulse: float
    length: float = 0.005


@dataclass(frozen=True)
class Part:
    """What the person does.

    `aims` are of the pose at a time [s]. `squeeze` is that of the feet, outwards, over the weight;
    `fast` is when the plan has poses three times as often, `air` when nothing touches [s].
    """

    aims: Callable[[float], Sequence[Aim]]
    contacts: Sequence[Contact]
    duration: float
    rate: float = 100.0
    blows: Sequence[Blow] = ()
    squeeze: float = 0.05
    seed: int = 0
    fast: tuple[float, float] = (0.0, 0.0)
    air: tuple[float, float] = (0.0, 0.0)


@read_only
class Performance:
    """What truly happened.

    `body` is the person as the laboratory's model has it, markers where they are by it.
    """

    text: str
    body: Model
    motion: Motion
    forces: Series  # (frames, contacts, 3) in ground [N]
    # (frames, 6) of all contacts but blows: moment about the ground's origin, force [N m, N]
    wrench: Array
    # (frames, 6) of the same that no contact gives: what the plan asks for beyond physics, about
    # the mass center
    missing: Array
    torques: Series  # (frames, hinges) [N m]
    activations: Series


def performed(part: Part) -> Performance:
    """Simulate the performance of a part."""
    random = np.random.default_rng(part.seed)
    build = fighter.Build(MASS, HEIGHT)
    # Fibers have their optimal length in the pose that all poses start from.
    fitting = mujoco.MjModel.from_xml_string(fighter.fighter_text("tori", build))
    build = fighter.with_fibers({"": build}, fitting, start_pose(fitting, ALONE))[""]
    text = with_marker_tuple(fighter.fighter_text("tori", build))
    believed = mujoco.MjModel.from_xml_string(text)
    person = fighter.misjudged(build, 0.15, random)
    true = mujoco.MjModel.from_xml_string(fighter.fighter_text("tori", person))
    _disturb(true, random)
    time = np.arange(round(part.duration * part.rate) + 1) / part.rate
    part = _in_flight(true, part)
    states = _states(true, part, time)
    loads = _dynamics(true, part, time, states, random)
    model = model_from_mujoco(believed, marker_sites="marker_.*")
    values = np.unwrap(coordinates_from_qpos(model, states[0]), axis=0)
    hinges = tuple(true.joint(j).name for j in range(1, true.njnt))
    muscles = tuple(true.actuator(i).name for i in range(true.nu))
    return Performance(
        text=text,
        body=model,
        motion=Motion(time, model.coordinate_names, values),
        forces=Series(time, tuple(contact.name for contact in part.contacts), loads.forces),
        wrench=loads.wrench,
        missing=loads.missing,
        torques=Series(time, hinges, loads.torques),
        activations=Series(time, muscles, loads.activations),
    )


def with_marker_tuple(text: str) -> str:
    """MJCF whose sites named `marker_...` are markers for Myomorph."""
    names = [part.split('"')[0] for part in text.split('site name="')[1:]]
    inside = "".join(
        f'<element objtype="site" objname="{name}"/>'
        for name in names
        if name.startswith("marker_")
    )
    return text.replace(
        "</mujoco>", f'<custom><tuple name="markers">{inside}</tuple></custom></mujoco>'
    )


def worn(model: Model, random: np.random.Generator, shift: float = 0.005) -> Model:
    """Move the markers of the model to where they truly are.

    They are some millimeters off along each axis.
    """
    return model.with_markers(
        tuple(
            replace(one, location=one.location + shift * random.standard_normal(3))
            for one in model.markers
        )
    )


def sole(side: str, ends: str = "") -> Array:
    """Return the corners of a sole in the foot's frame.

    Parameters
    ----------
    side : "r" or "l"
    ends : "heel" or "toe"; "" for both

    Returns
    -------
    (points, 3) [m]
    """
    return np.array([at for name, at in fighter.sole_points(side).items() if name.startswith(ends)])


def _disturb(compiled: Any, random: np.random.Generator) -> None:
    """Put masses 5 % off, the whole as weighed.

    Mass centers are 5 mm and muscles' points 2 mm off (standard deviations).
    """
    bodies = slice(1, None)
    factors = np.exp(0.05 * random.standard_normal(compiled.nbody - 1))
    factors *= compiled.body_mass[bodies].sum() / (factors * compiled.body_mass[bodies]).sum()
    compiled.body_mass[bodies] *= factors
    compiled.body_inertia[bodies] *= factors[:, None]
    compiled.body_ipos[bodies] += 0.005 * random.standard_normal((len(factors), 3))
    for site in range(compiled.nsite):
        if "-" in compiled.site(site).name:
            compiled.site_pos[site] += 0.002 * random.standard_normal(3)
    compiled.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    mujoco.mj_setConst(compiled, mujoco.MjData(compiled))


def _knots(part: Part) -> Array:
    """Choose times of the plan's poses (knots,) [s]."""
    every = np.arange(round(part.duration * KNOT_RATE) + 3) / KNOT_RATE - 1.0 / KNOT_RATE
    return np.unique(np.concatenate([every, _dense(part)]).round(6))


def _dense(part: Part) -> Array:
    """Choose times of poses where they stand closely (knots,) [s]."""
    return np.arange(*part.fast, 1.0 / (3.0 * KNOT_RATE))


def _in_flight(compiled: Any, part: Part) -> Part:
    """Let the trunk lean as a body in the air has to."""
    grid = _dense(part)
    if not len(grid):
        return part
    air = (grid > part.air[0]) & (grid < part.air[1])

    data = mujoco.MjData(compiled)

    def moment_of(aims: Callable[[float], Sequence[Aim]]) -> Array:
        states = _states(compiled, replace(part, aims=aims), grid, grid)
        moments_z = np.zeros(len(grid))
        for frame in range(len(grid)):
            data.qpos[:] = states[0][frame]
            data.qvel[:] = states[1][frame]
            data.qacc[:] = states[2][frame]
            mujoco.mj_inverse(compiled, data)
            wrench = _root_wrench(data, np.array(data.qfrc_inverse))
            moments_z[frame] = (wrench[:3] - np.cross(data.subtree_com[0], wrench[3:]))[2]
        return moments_z

    return replace(part, aims=balanced_leans(moment_of, part.aims, grid, air))


def _root_wrench(data: Any, needed: Array) -> Array:
    """Moment about the ground's origin and force (6,) of what the root needs [N m], [N]."""
    turn = data.xmat[1].reshape(3, 3)
    origin = np.array(data.qpos[:3])
    return np.append(turn @ needed[3:6] + np.cross(origin, needed[:3]), needed[:3])


def _states(
    compiled: Any, part: Part, time: Array, knots: Array | None = None
) -> tuple[Array, Array, Array]:
    """Compute the plan and what impacts do to it.

    The results are qpos (frames, nq), rates and accelerations (frames, nv).
    """
    knots = _knots(part) if knots is None else knots
    first = posed(compiled, start_pose(compiled, ALONE), part.aims(0.0), 0.02)
    ways = np.zeros((len(knots), compiled.nv))
    for way, knot in zip(ways, knots, strict=True):
        mujoco.mj_differentiatePos(
            compiled, way, 1.0, first, posed(compiled, first, part.aims(float(knot)), 0.02)
        )
    spline = natural_spline(knots, ways)
    kicks: list[tuple[Blow, Array]] = []

    def at(times: Array) -> Array:
        values = spline(times)
        for blow, change in kicks:
            values = values + np.outer(_kick(times - blow.time, blow.length), change)
        poses = np.tile(first, (len(times), 1))
        for pose, value in zip(poses, values, strict=True):
            mujoco.mj_integratePos(compiled, pose, value, 1.0)
        return poses

    kicks += [
        (blow, _change(compiled, part, blow, at(np.array([blow.time]))[0])) for blow in part.blows
    ]
    before = at(time - STEP)
    now = at(time)
    after = at(time + STEP)
    rates, accelerations = np.empty((2, len(time), compiled.nv))
    one, other = np.empty((2, compiled.nv))
    for frame in range(len(time)):
        mujoco.mj_differentiatePos(compiled, one, STEP, before[frame], now[frame])
        mujoco.mj_differentiatePos(compiled, other, STEP, now[frame], after[frame])
        rates[frame] = 0.5 * (one + other)
        accelerations[frame] = (other - one) / STEP
    return now, rates, accelerations


def _change(compiled: Any, part: Part, blow: Blow, pose: Array) -> Array:
    """Change of rates (nv,) by a blow while the feet stand still and joints are loose."""
    data = mujoco.MjData(compiled)
    data.qpos[:] = pose
    mujoco.mj_fwdPosition(compiled, data)
    push = jacobian(compiled, data, compiled.body(blow.body).id, blow.point)[0][1] * blow.impulse
    still = np.vstack([_attitude(compiled, data, contact) for contact in part.contacts])
    rows = np.zeros((len(still), len(still)))
    system = np.block(
        [[mass_matrix(compiled, data), still.T], [still, rows - 1e-9 * np.eye(len(still))]]
    )
    return np.linalg.solve(system, np.append(push, np.zeros(len(still))))[: compiled.nv]


def _attitude(compiled: Any, data: Any, contact: Contact) -> Array:
    """Rates of place and attitude of a contact's body (6, nv)."""
    J, turning = np.zeros((2, 3, compiled.nv))
    mujoco.mj_jacBody(compiled, data, J, turning, compiled.body(contact.body).id)
    return np.vstack([J, turning])


def _kick(since: Array, length: float, recovery: float = 0.3) -> Array:
    """Compute the course (times,) of what a change of rates of 1 leaves.

    It is the impact's ramp, then back to the plan, smooth.
    """
    x = np.clip(since / length, 0.0, 1.0)
    during = 0.5 * length * (x - np.sin(np.pi * x) / np.pi)
    y = np.clip((since - length) / recovery, 0.0, 1.0)
    speed = recovery * (y - 6.0 * y**3 + 8.0 * y**4 - 3.0 * y**5)
    place = 0.5 * length * (1.0 - 10.0 * y**3 + 15.0 * y**4 - 6.0 * y**5)
    return np.where(since < length, during, speed + place)


def force_of(blow: Blow, time: Array) -> Array:
    """Compute the force of an impact.

    Parameters
    ----------
    blow : the impact
    time : (frames,) [s]

    Returns
    -------
    (frames,) [N]
    """
    x = (time - blow.time) / blow.length
    return np.where(
        (x > 0.0) & (x < 1.0), 0.5 * np.pi * blow.impulse / blow.length * np.sin(np.pi * x), 0.0
    )


class _Loads(NamedTuple):
    """What acts on the person and in it while it moves."""

    forces: Array  # (frames, contacts, 3) [N]
    wrench: Array  # (frames, 6) of all contacts, moment about the ground's origin [N m], force [N]
    missing: Array  # (frames, 6) of it that no contact gives, about the center of mass
    torques: Array  # (frames, hinges) [N m]
    activations: Array  # (frames, muscles)


def _dynamics(
    compiled: Any,
    part: Part,
    time: Array,
    states: tuple[Array, Array, Array],
    random: np.random.Generator,
) -> _Loads:
    """Compute what the planned motion needs of contacts, hinges and muscles."""
    data = mujoco.MjData(compiled)
    ready = np.stack([contact.on(time) for contact in part.contacts], axis=1)
    corners = [
        (k, compiled.body(c.body).id, point)
        for k, c in enumerate(part.contacts)
        for point in c.points
    ]
    weight = np.exp(0.5 * random.standard_normal(len(corners)))
    effort = np.exp(0.5 * random.standard_normal(compiled.nu))
    tone = random.uniform(0.01, 0.05, compiled.nu)
    loads = _Loads(
        forces=np.zeros((len(time), len(part.contacts), 3)),
        wrench=np.zeros((len(time), 6)),
        missing=np.zeros((len(time), 6)),
        torques=np.zeros((len(time), compiled.nv - 6)),
        activations=np.zeros((len(time), compiled.nu)),
    )
    before = tone
    for frame in range(len(time)):
        needed = _needed(compiled, data, part, time[frame : frame + 1], [x[frame] for x in states])
        loads.wrench[frame] = _root_wrench(data, needed)
        places = [jacobian(compiled, data, body, point) for _, body, point in corners]
        positions = [at for _, at in places]
        pushed = _shared(loads.wrench[frame], positions, corners, ready[frame], weight, part)
        middle = np.array(data.subtree_com[0])
        missing = loads.missing[frame]
        missing[:] = loads.wrench[frame]
        missing[:3] -= np.cross(middle, loads.wrench[frame, 3:])
        for (contact, _, _), (J, at), force in zip(corners, places, pushed, strict=True):
            loads.forces[frame, contact] += force
            needed -= J.T @ force
            missing -= np.append(np.cross(at - middle, force), force)
        loads.torques[frame] = needed[6:]
        before = _recruited(compiled, data, loads.torques[frame], effort, tone, before)
        loads.activations[frame] = before
    return loads


def _needed(compiled: Any, data: Any, part: Part, time: Array, state: Sequence[Array]) -> Array:
    """Find the generalized forces (nv,) that move the body at a time (1,), less those of blows."""
    values, velocities, accelerations = state
    data.qpos[:] = values
    data.qvel[:] = velocities
    data.qacc[:] = accelerations
    mujoco.mj_inverse(compiled, data)
    needed = np.array(data.qfrc_inverse)
    for blow in part.blows:
        push = float(force_of(blow, time)[0])
        if push:
            needed -= push * jacobian(compiled, data, compiled.body(blow.body).id, blow.point)[0][1]
    return needed


def _recruited(
    compiled: Any, data: Any, torques: Array, effort: Array, tone: Array, before: Array
) -> Array:
    """Choose activations (muscles,) that give the torques at the least effort of this person."""
    mujoco.mj_fwdPosition(compiled, data)
    mujoco.mj_fwdVelocity(compiled, data)
    arms = -moments(compiled, data)[:, 6:]
    active, passive, _ = muscle_strength(compiled, data)
    pull = (arms.T * active) / EXACT / 100.0
    miss = (torques - arms.T @ passive) / EXACT / 100.0
    cost = effort * (0.05 + np.abs(before - tone))
    H = pull.T @ pull + np.diag(cost)
    c = -pull.T @ miss - cost * tone
    program = Program(H=H, c=c, low=np.zeros(len(c)), high=np.ones(len(c)))
    return np.clip(least(program, ACCURACY), 0.0, 1.0)


def _shared(
    wrench: Array,
    places: Sequence[Array],
    corners: Sequence[tuple[int, int, Array]],
    ready: Array,
    weight: Array,
    part: Part,
) -> Array:
    """Share the wrench among the corners by the person's own weights, (corners, 3) forces [N].

    They stay inside friction pyramids about y.
    """
    count = len(places)
    moment = np.zeros((6, 3 * count))
    for k, (x, y, z) in enumerate(places):
        moment[:3, 3 * k : 3 * k + 3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
        moment[3:, 3 * k : 3 * k + 3] = np.eye(3)
    on = np.array([ready[contact] for contact, _, _ in corners])
    if not on.any():
        return np.zeros((count, 3))
    wish = on * np.array([part.contacts[contact].share for contact, _, _ in corners])
    cost = np.repeat(weight / np.maximum(on, 1e-3) ** 2, 3)
    middle = np.mean([z for (_, _, z), share in zip(places, on, strict=True) if share > 0.5])
    wanted = np.zeros((count, 3))
    wanted[:, 2] = (
        part.squeeze * MASS * 9.80665 * np.sign([z - middle for _, _, z in places]) * on / on.sum()
    )
    wanted[:, 1] = wish * MASS * 9.80665 / wish.sum()
    H = np.diag(cost) * 1e-3 + moment.T @ moment / EXACT
    c = -1e-3 * cost * wanted.ravel() - moment.T @ wrench / EXACT
    low = np.full(3 * count, -np.inf)
    high = np.full(3 * count, np.inf)
    low[1::3] = 0.0
    program = Program(H=H, c=c, low=low, high=high, G=pyramids(count, FRICTION))
    pushed = least(program, ACCURACY).reshape(count, 3)
    return np.where(on[:, None] > 0.0, pushed, 0.0)
