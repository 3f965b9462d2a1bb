"""A simulated subject and what a laboratory records.

Its lengths, marker positions and inertial parameters are known.

The generic model becomes a person: bodies scaled segment by segment, markers put a centimeter
off, every body's mass deformed by a random affine map, which no rigid body's physics can object to.
The person moves through a motion of closed form; `simulated_engines` gives the positions of the
markers and the wrench that the plate measures without any of Myomorph's kernels, and noise is added
to both. Synthetic: nobody was measured.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

import myomorph as mm
from myomorph.core.model.arrays import Array
from myomorph.core.model.inertia import (
    inertial_parameters,
    pseudo_inertias,
    with_inertial_parameters,
)
from myomorph.core.model.model import GROUND
from myomorph.core.model.scale import scale
from myomorph.core.model.segments import segments_of
from myomorph.core.motion.lengths import factors_of, lengths_of, mirrored_lengths
from truths.simulated_engines import MARGIN, Engine

EXTENTS = (1e-3, 0.2)
"""Least and greatest root mean square of a body's mass along an axis, from its mass center [m]."""

MOVE_PERIOD = 1.2
"""Between the moves from one random pose to the next [s]."""
MOVE_WIDTH = 0.2
"""Standard deviation of the normal distribution that a move follows [s]."""


@dataclass(frozen=True)
class SubjectOptions:
    """How far the person is from the generic model.

    Attributes
    ----------
    length : largest relative change of a length, along or across a segment, the same on both sides
    asymmetry : largest relative difference that the left side adds
    marker_shift : standard deviation of a marker's place, along each axis [m]
    mass, center, shape : largest relative change of a body's mass; shift of its mass center in
        parts of its radius of gyration; relative change of its extent along and across its axes
    seed : of all of them
    """

    length: float = 0.08
    asymmetry: float = 0.01
    marker_shift: float = 0.006
    mass: float = 0.2
    center: float = 0.15
    shape: float = 0.1
    seed: int = 3


@dataclass(frozen=True, eq=False)
class Subject:
    """A person, and the model that stands for the person before anything is measured.

    Attributes
    ----------
    generic : the model given to calibration and identification
    person : the truth: its lengths, markers and inertial parameters
    """

    generic: mm.Model
    person: mm.Model


@dataclass(frozen=True)
class Instruments:
    """How badly the laboratory measures.

    Attributes
    ----------
    rate : of markers and plate [Hz]
    marker : standard deviation of each marker coordinate's white noise [m]
    force : standard deviation of each force component's white noise [N]
    sensors : half distances of the plate's four sensors along x and y of its top [m]. A force noise
        of 0.5 N is 0.25 N in each sensor; the moments' noise about the plate's center follows by
        the lever arms, 0.5 N times (b, a) about the axes in the top and 0.5 N sqrt(a^2 + b^2) about
        the upright one
    seed : of the noise
    """

    rate: float = 200.0
    marker: float = 0.3e-3
    force: float = 0.5
    sensors: tuple[float, float] = (0.20, 0.12)
    seed: int = 5

    def sigma(self, up: Array) -> Array:
        """Return standard deviations of the wrench's noise.

        Parameters
        ----------
        up : (3,) unit vector of the vertical, of either sign

        Returns
        -------
        (6,) of moments about the plate's center [N m], then of forces [N]
        """
        across, along = self.sensors[::-1]
        lever = np.where(np.abs(up) > 0.5, np.hypot(along, across), 0.0)
        lever[np.flatnonzero(np.abs(up) < 0.5)] = across, along
        return np.concatenate([self.force * lever, np.full(3, self.force)])


@dataclass(frozen=True, eq=False)
class Recording:
    """One simulated trial.

    Attributes
    ----------
    motion : the true one, with derivatives of its closed form
    markers, exact_markers : with and without noise
    wrench, exact_wrench : (frames, 6) moment about `center` and force on the person, in ground [N
        m; N]
    center : (3,) of the plate's top, in ground [m]
    sigma : (6,) of the wrench's noise
    wrenches : the noisy wrench on one foot, as loads are given to the steps
    """

    motion: mm.Motion
    markers: mm.Markers
    exact_markers: Array
    wrench: Array
    exact_wrench: Array
    center: Array
    sigma: Array
    wrenches: mm.Wrenches


def random_subject(generic: mm.Model, options: SubjectOptions | None = None) -> Subject:
    """Make a person of other lengths, marker positions and inertial parameters than the generic's.

    Every length of `lengths_of` has a factor of its own: from joint to joint, and across.
    """
    options = options or SubjectOptions()
    random = np.random.default_rng(options.seed)
    lengths = lengths_of(generic)
    values = np.ones(len(lengths))
    sides = {j: i for i, j in mirrored_lengths(lengths)}
    for i in range(len(lengths)):
        own = 1.0 + options.length * random.uniform(-1.0, 1.0)
        values[i] = (
            values[sides[i]] * (1.0 + options.asymmetry * random.uniform(-1.0, 1.0))
            if i in sides
            else own
        )
    grown = scale(generic, factors_of(lengths, values), inertia="affine")
    markers = tuple(
        replace(one, location=one.location + options.marker_shift * random.standard_normal(3))
        for one in grown.markers
    )
    table = np.array([deformed(row, options, random) for row in inertial_parameters(grown)])
    return Subject(generic, with_inertial_parameters(grown.with_markers(markers), table))


def deformed(parameters: Array, options: SubjectOptions, random: np.random.Generator) -> Array:
    """Deform a body whose mass is moved by an affine map x -> A x + t, and scaled.

    Whatever positive masses the body was made of, they are so afterwards: J -> k T J T^T for the
    pseudo-inertia J.

    Parameters
    ----------
    parameters : (10,) inertial parameters of the body
    options : sizes of the deformations
    random : generator

    Returns
    -------
    (10,) after the deformation; a body without mass stays
    """
    J = pseudo_inertias(parameters)
    mass = J[3, 3]
    if mass == 0.0:
        return parameters
    center = J[:3, 3] / mass
    spread = J[:3, :3] - mass * np.outer(center, center)
    # Some models give bodies that only join two others inertias of no mass, or of one 20 m away.
    extent, axes = np.linalg.eigh(spread)
    spread = (axes * np.clip(extent, *mass * np.square(EXTENTS))) @ axes.T
    stretch = options.shape * random.uniform(-1.0, 1.0, (3, 3))
    A = np.eye(3) + 0.5 * (stretch + stretch.T)
    k = 1.0 + options.mass * random.uniform(-1.0, 1.0)
    size = np.sqrt(np.trace(spread) / mass / 2.0)
    center = center + options.center * size * random.uniform(-1.0, 1.0, 3)
    J[3, 3] = k * mass
    J[:3, 3] = k * mass * center
    J[3, :3] = k * mass * center
    J[:3, :3] = k * (A @ spread @ A.T + mass * np.outer(center, center))
    return parameters_of(J)


def parameters_of(J: Array) -> Array:
    """Return inertial parameters of pseudo-inertias.

    Parameters
    ----------
    J : (..., 4, 4)

    Returns
    -------
    (..., 10)
    """
    second = J[..., :3, :3]
    about = np.trace(second, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - second
    parts = [J[..., 3, 3], J[..., 0, 3], J[..., 1, 3], J[..., 2, 3]]
    parts += [about[..., i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))]
    return np.stack(parts, axis=-1)


@dataclass(frozen=True)
class Amplitudes:
    """How far coordinates go.

    Attributes
    ----------
    share : of a coordinate's range that is used
    most : furthest from the middle, whatever the range [rad, or m of a sliding joint]
    root : furthest of the base [m, rad]
    """

    share: float = 0.7
    most: tuple[float, float] = (0.7, 0.02)
    root: tuple[float, float] = (0.10, 0.35)


Curves = Callable[[Array], tuple[Array, Array, Array]]


def middles_and_reaches(
    model: mm.Model, amplitudes: Amplitudes | None = None
) -> tuple[tuple[str, ...], Array, Array]:
    """Return the coordinates that move: neither locked nor driven.

    Parameters
    ----------
    model : with ranges of its coordinates
    amplitudes : how far they go; usual by default

    Returns
    -------
    names, and middle and reach (moving,) of each [rad or m]
    """
    amplitudes = amplitudes or Amplitudes()
    base = next(joint for joint in model.joints if joint.parent == GROUND)
    names = []
    middles = []
    reaches = []
    for one in model.coordinates:
        if one.locked or one.name in model.dependent_coordinates:
            continue
        slides = one.motion == "translational"
        if one.name in base.coordinates:
            middle = one.default
            reach = amplitudes.root[0 if slides else 1]
        else:
            low, high = one.range
            most = amplitudes.most[1 if slides else 0]
            reach = min(amplitudes.share * (high - low) / 2.0, most)
            middle = float(np.clip(one.default, low + reach, high - reach))
        names.append(one.name)
        middles.append(middle)
        reaches.append(reach)
    return tuple(names), np.array(middles), np.array(reaches)


def exciting_curves(
    middles: Array,
    reaches: Array,
    seed: int = 1,
    sines: int = 5,
    band: tuple[float, float] = (0.08, 0.9),
) -> Curves:
    """Make sums of sines of random frequency and phase in every coordinate, growing from rest.

    Parameters
    ----------
    middles, reaches : (moving,) [rad or m]
    seed : of frequencies, phases and shares
    sines : number in each coordinate
    band : lowest and highest frequency [Hz]

    Returns
    -------
    function of times (frames,) that gives values, velocities and accelerations (frames, moving)
    """
    random = np.random.default_rng(seed)
    n = len(middles)
    omega = 2.0 * np.pi * random.uniform(*band, (sines, n))
    phase = random.uniform(0.0, 2.0 * np.pi, (sines, n))
    share = random.uniform(0.5, 1.0, (sines, n))
    # Five sines seldom meet: together they reach about half of their sum, and never more than the
    # reach.
    size = reaches * share / share.sum(axis=0)

    def curves(time: Array) -> tuple[Array, Array, Array]:
        t = time[:, None]
        swings = [np.zeros((len(time), n)) for _ in range(3)]
        for a, w, p in zip(size, omega, phase, strict=True):
            s = np.sin(w * t + p)
            c = np.cos(w * t + p)
            swings[0] += a * s
            swings[1] += a * w * c
            swings[2] -= a * w * w * s
        u = t**4
        rest = np.exp(-u)
        grow = 1.0 - rest
        rise = 4.0 * t**3 * rest
        bend = (12.0 * t**2 - 16.0 * t**6) * rest
        x, v, a = swings
        return middles + grow * x, grow * v + rise * x, grow * a + 2.0 * rise * v + bend * x

    return curves


def step_curves(
    middles: Array,
    reaches: Array,
    duration: float,
    seed: int = 2,
) -> Curves:
    """Make moves from one random pose to the next.

    x_0 + sum_k d_k Phi((t - t_k) / w), Phi the normal distribution; t_k are `MOVE_PERIOD` apart, w
    is `MOVE_WIDTH`.

    Parameters
    ----------
    middles, reaches : (moving,) [rad or m]
    duration : of the movement [s]
    seed : of the poses

    Returns
    -------
    function of times (frames,) that gives values, velocities and accelerations (frames, moving)
    """
    random = np.random.default_rng(seed)
    at = np.arange(MOVE_PERIOD, duration - MOVE_PERIOD, MOVE_PERIOD)
    poses = middles + 0.8 * reaches * random.uniform(-1.0, 1.0, (len(at) + 1, len(middles)))
    moves = np.diff(poses, axis=0)

    def curves(time: Array) -> tuple[Array, Array, Array]:
        z = (time[:, None] - at) / MOVE_WIDTH
        bell = np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
        first = bell @ moves / MOVE_WIDTH
        second = (-z * bell) @ moves / MOVE_WIDTH**2
        return poses[0] + ndtr(z) @ moves, first, second

    return curves


@dataclass(frozen=True, kw_only=True)
class Movement:
    """What a person does.

    Attributes
    ----------
    names : coordinates that move; the others stay at their default or follow
    curves : function of times (frames,) that gives values, velocities and accelerations (frames,
        names)
    duration : [s]
    """

    names: tuple[str, ...]
    curves: Curves
    duration: float

    def sampled(self, rate: float) -> mm.Motion:
        """Return the motion with `MARGIN` frames before and after, at a rate [Hz]."""
        frames = round(self.duration * rate) + 1
        time = np.arange(-MARGIN, frames + MARGIN) / rate
        values, velocities, accelerations = self.curves(time)
        return mm.Motion(
            time=time,
            names=self.names,
            values=values,
            velocities=velocities,
            accelerations=accelerations,
        )


def record(
    subject: Subject,
    engine: Engine,
    movement: Movement,
    instruments: Instruments | None = None,
) -> Recording:
    """Record the person as the laboratory does while its coordinates follow the curves."""
    instruments = instruments or Instruments()
    person = subject.person
    motion = movement.sampled(instruments.rate)
    whole = np.tile([one.default for one in person.coordinates], (len(motion), 1))
    columns = [person.coordinate_names.index(name) for name in movement.names]
    whole[:, columns] = motion.values
    follow(person, whole)
    center = plate_center(person)
    places, wrench = engine.measure(whole, instruments.rate, center)
    motion = _within_margins(motion)
    random = np.random.default_rng(instruments.seed)
    sigma = instruments.sigma(person.gravity / np.linalg.norm(person.gravity))
    noisy = wrench + sigma * random.standard_normal(wrench.shape)
    markers = places + instruments.marker * random.standard_normal(places.shape)
    return Recording(
        motion=motion,
        markers=mm.Markers(motion.time, person.marker_names, markers),
        exact_markers=places,
        wrench=noisy,
        exact_wrench=wrench,
        center=center,
        sigma=sigma,
        wrenches=on_one_foot(person, motion.time, noisy, center),
    )


def _within_margins(motion: mm.Motion) -> mm.Motion:
    """Return the motion without the `MARGIN` frames at either end."""
    span = slice(MARGIN, -MARGIN)
    assert motion.velocities is not None
    assert motion.accelerations is not None
    return mm.Motion(
        time=motion.time[span],
        names=motion.names,
        values=motion.values[span],
        velocities=motion.velocities[span],
        accelerations=motion.accelerations[span],
    )


def follow(model: mm.Model, values: Array) -> None:
    """Set the dependent columns of values from the others, in place.

    Parameters
    ----------
    model : with couplers
    values : (frames, coordinates) [rad or m]
    """
    waiting = list(model.couplers)
    while waiting:
        driven = {one.dependent for one in waiting}
        for one in [one for one in waiting if not driven & set(one.independents)]:
            sources = [values[:, model.coordinate_names.index(name)] for name in one.independents]
            values[:, model.coordinate_names.index(one.dependent)] = one.function(*sources)
            waiting.remove(one)


def plate_center(model: mm.Model) -> Array:
    """Return the point of the floor under the base in its default pose.

    The ground's height 0 is the floor.

    Parameters
    ----------
    model : with a base joint to the ground

    Returns
    -------
    (3,) in ground [m]
    """
    base = next(joint for joint in model.joints if joint.parent == GROUND)
    default = {one.name: one.default for one in model.coordinates}
    place = np.array(base.parent_frame.translation)
    for axis in base.axes:
        if axis.kind == "translation" and axis.coordinates:
            place = place + axis.vector * default[axis.coordinates[0]]
    up = -model.gravity / np.linalg.norm(model.gravity)
    return place - (place @ up) * up


def on_one_foot(model: mm.Model, time: Array, wrench: Array, center: Array) -> mm.Wrenches:
    """Return the wrench as a force at its center of pressure, on the right foot.

    It has an upright free torque.

    Parameters
    ----------
    model : with a right foot
    time : (frames,) [s]
    wrench : (frames, 6) moment about `center` and force, in ground [N m; N]
    center : (3,) on the floor [m]

    Returns
    -------
    Wrenches of one plate
    """
    foot = next(
        body
        for body, one in segments_of(model).items()
        if one.name == "foot" and one.side == "right"
    )
    up = -model.gravity / np.linalg.norm(model.gravity)
    moment = wrench[:, :3]
    force = wrench[:, 3:]
    arm = np.cross(up, moment) / (force @ up)[:, None]
    free = moment - np.cross(arm, force)
    one = [np.asarray(each)[:, None, :] for each in (force, center + arm, free)]
    return mm.Wrenches(time, ("plate",), (foot,), *one)
