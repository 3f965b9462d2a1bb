"""Faults of markers, plates and models, of sizes that are drawn.

Each knows what it does to a recording, and how a finding has to name it.
They are put into values and not into files, so that all of them take about a minute a recording.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

import myomorph as mm
from myomorph.core.model.arrays import Array

UP = 1
"""Axis of the recordings that points up."""
LEVEL_AXES = ((0, "x"), (2, "z"))
"""The others, with their names."""
LOADED = 30.0
"""Vertical force from which a plate takes part [N]."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """What a fault may change.

    Attributes
    ----------
    model : of the person
    markers : as recorded, y up [m]
    wrenches : of the plates, with the bodies they act on
    """

    model: mm.Model
    markers: mm.Markers
    wrenches: mm.Wrenches

    @property
    def plates(self) -> list[int]:
        """Numbers of the plates that carry something, the most loaded first."""
        load = np.abs(np.nan_to_num(self.wrenches.forces[..., UP])).max(axis=0)
        return [int(number) for number in np.argsort(-load) if load[number] > LOADED]

    def with_markers(self, values: Array, time: Array | None = None) -> Case:
        """Replace the markers' positions and times.

        Parameters
        ----------
        values : (frames, markers, 3) [m]
        time : (frames,) [s], None for those of before

        Returns
        -------
        the case with them
        """
        time = self.markers.time if time is None else time
        return replace(self, markers=mm.Markers(time, self.markers.names, values))

    def with_wrenches(self, **parts: object) -> Case:
        """Replace arrays of the wrenches."""
        return replace(self, wrenches=replace(self.wrenches, **parts))

    def on_plates(self, plates: list[int], part: str, change: Callable[[Array], Array]) -> Case:
        """Change one part of some plates.

        Parameters
        ----------
        plates : their numbers
        part : "forces", "points" or "torques"
        change : of the values (samples, 3) of one plate

        Returns
        -------
        the case with them
        """
        values = np.array(getattr(self.wrenches, part))
        for plate in plates:
            values[:, plate] = change(values[:, plate])
        return self.with_wrenches(**{part: values})


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault.

    Attributes
    ----------
    name : what is wrong, with its size
    accepted : parts of kinds of findings that name it
    put : into a recording; None where the recording cannot have it
    """

    name: str
    accepted: tuple[str, ...]
    put: Callable[[Case], Case | None]


def faults(rng: np.random.Generator) -> Iterator[Fault]:
    """Draw the sizes of all faults.

    Parameters
    ----------
    rng : of the sizes
    """
    yield from _faults_of_markers(rng)
    yield from _faults_of_bodies(rng)
    yield from _faults_of_signals(rng)
    yield from _faults_of_axes()
    yield from _faults_of_places(rng)
    yield from _faults_of_sizes(rng)
    yield from _faults_of_clocks(rng)
    yield from _faults_of_wires(rng)


def turn(axis: int, degrees: float) -> Array:
    """Make the rotation about an axis of the ground.

    Parameters
    ----------
    axis : its number
    degrees : by which it turns

    Returns
    -------
    (3, 3)
    """
    cosine = np.cos(np.radians(degrees))
    sine = np.sin(np.radians(degrees))
    after = (axis + 1) % 3
    last = (axis + 2) % 3
    result = np.eye(3)
    result[after, after] = result[last, last] = cosine
    result[after, last] = -sine
    result[last, after] = sine
    return result


def _faults_of_markers(rng: np.random.Generator) -> Iterator[Fault]:
    def of(name: str, accepted: tuple[str, ...], change: Callable[[Array], Array]) -> Fault:
        return Fault(
            name=name,
            accepted=accepted,
            put=lambda case: case.with_markers(change(case.markers.values)),
        )

    mirror = ("mirrored axis", "left and right", "swapped labels", "vertical axis")
    yield of("markers: z mirrored", mirror, lambda values: values * [1.0, 1.0, -1.0])
    yield of("markers: x mirrored", mirror, lambda values: values * [-1.0, 1.0, 1.0])
    yield of("markers: upside down", ("vertical axis",), lambda values: values * [1.0, -1.0, -1.0])
    yield of("markers: vertical mirrored", mirror, lambda values: values * [1.0, -1.0, 1.0])
    yield of("markers: z up", ("vertical axis",), lambda values: values @ turn(0, 90.0).T)
    for frames in (int(rng.integers(4, 8)), int(rng.integers(12, 20))):
        at = rng.uniform(0.3, 0.7)
        yield Fault(
            name=f"markers: all frozen for {frames} frames",
            accepted=("frozen markers", "lost frames"),
            put=lambda case, frames=frames, at=at: _frozen(case, frames, at),
        )
    for frames in (int(rng.integers(2, 5)), int(rng.integers(8, 14))):
        at = rng.uniform(0.3, 0.7)
        yield Fault(
            name=f"markers: {frames} frames lost and times renumbered",
            accepted=("lost frames",),
            put=lambda case, frames=frames, at=at: _frames_lost(case, frames, at),
        )


def _frozen(case: Case, frames: int, at: float) -> Case:
    """Repeat a frame of all markers."""
    values = np.array(case.markers.values)
    start = int(at * len(values))
    values[start : start + frames] = values[start]
    return case.with_markers(values)


def _frames_lost(case: Case, frames: int, at: float) -> Case:
    """Take frames out and number the others anew."""
    start = int(at * len(case.markers.time))
    values = np.delete(case.markers.values, slice(start, start + frames), axis=0)
    return case.with_markers(values, case.markers.time[: len(values)])


def _faults_of_bodies(rng: np.random.Generator) -> Iterator[Fault]:
    for low, high in ((0.05, 0.07), (0.09, 0.12)):
        size = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(low, high)
        yield Fault(
            name=f"person {size:.2f} times the model's size",
            accepted=("size of the model",),
            put=lambda case, size=size: case.with_markers(size * case.markers.values).with_wrenches(
                points=size * case.wrenches.points
            ),
        )
    for low, high in ((0.08, 0.12), (0.18, 0.25)):
        share = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(low, high)
        yield Fault(
            name=f"model {share:.2f} times as heavy",
            accepted=("mass", "gain of all"),
            put=lambda case, share=share: replace(case, model=heavier(case.model, share)),
        )
    for degrees in (rng.uniform(3.0, 4.0), rng.uniform(5.0, 6.0)):
        for axis, letter in LEVEL_AXES:
            rotation = turn(axis, rng.choice([-1.0, 1.0]) * degrees)
            yield Fault(
                name=f"laboratory tilted by {degrees:.1f} degrees about {letter}",
                accepted=("tilted",),
                put=lambda case, rotation=rotation: _all_turned(case, rotation),
            )
    for axis, letter in LEVEL_AXES:
        degrees = rng.choice([-1.0, 1.0]) * rng.uniform(4.0, 6.0)
        rotation = turn(axis, degrees)
        yield Fault(
            name=f"cameras tilted by {degrees:.1f} degrees about {letter}",
            accepted=("tilted",),
            put=lambda case, rotation=rotation: case.with_markers(case.markers.values @ rotation.T),
        )


def heavier(model: mm.Model, share: float) -> mm.Model:
    """Scale all masses and moments of inertia.

    Parameters
    ----------
    model : of a body
    share : by which its mass grows

    Returns
    -------
    the heavier body
    """
    return replace(
        model,
        bodies=tuple(
            replace(body, mass=share * body.mass, inertia=share * body.inertia)
            for body in model.bodies
        ),
    )


def _all_turned(case: Case, rotation: Array) -> Case:
    """Turn markers and plates alike against gravity."""
    wrenches = case.wrenches
    return case.with_markers(case.markers.values @ rotation.T).with_wrenches(
        forces=wrenches.forces @ rotation.T,
        points=wrenches.points @ rotation.T,
        torques=wrenches.torques @ rotation.T,
    )


def _faults_of_signals(rng: np.random.Generator) -> Iterator[Fault]:
    for axis, word in ((UP, "vertical"), (0, "fore-aft")):
        yield _one(
            f"plate: {word} channel dead",
            ("dead channel",),
            "forces",
            lambda force, axis=axis: np.where(np.arange(3) == axis, 0.0, force),
        )
    for share in (rng.uniform(0.7, 0.8), rng.uniform(0.86, 0.92)):
        yield _one(
            f"plate: clipped at {100 * share:.0f} %",
            ("clipped",),
            "forces",
            lambda force, share=share: _clipped(force, share),
        )
    share = rng.uniform(0.6, 0.8)
    yield _one(
        f"plate: wraps around at {100 * share:.0f} %",
        ("wrapped",),
        "forces",
        lambda force: _wrapped(force, share),
    )
    yield Fault(
        name="plate: missing",
        accepted=("foot beside the plates", "load not determined"),
        put=_missing,
    )
    yield Fault(name="plates: the same signal twice", accepted=("same signal",), put=_same_signal)
    newtons = rng.choice([-1.0, 1.0]) * rng.uniform(30.0, 60.0)
    yield _one(
        f"plate: offset of {newtons:.0f} N",
        ("plate zero", "offset"),
        "forces",
        lambda force: force + newtons * (np.arange(3) == UP),
    )
    drift = rng.uniform(60.0, 120.0)
    yield _one(
        f"plate: drift of {drift:.0f} N",
        ("plate zero", "offset", "drift"),
        "forces",
        lambda force: (
            force + drift * np.linspace(0.0, 1.0, len(force))[:, None] * (np.arange(3) == UP)
        ),
    )
    seconds = rng.uniform(0.06, 0.12)
    yield Fault(
        name=f"plates: {1000 * seconds:.0f} ms lost and times renumbered",
        accepted=("lost samples",),
        put=lambda case: _samples_lost(case, seconds),
    )


def _one(
    name: str, accepted: tuple[str, ...], part: str, change: Callable[[Array], Array]
) -> Fault:
    """Make a fault of the most loaded plate."""
    return Fault(
        name=name,
        accepted=accepted,
        put=lambda case: case.on_plates(case.plates[:1], part, change),
    )


def _all(
    name: str, accepted: tuple[str, ...], part: str, change: Callable[[Array], Array]
) -> Fault:
    """Make a fault of all plates."""
    return Fault(
        name=name, accepted=accepted, put=lambda case: case.on_plates(case.plates, part, change)
    )


def _clipped(force: Array, share: float) -> Array:
    """Hold the vertical force below a share of its peak."""
    result = np.array(force)
    result[:, UP] = np.minimum(force[:, UP], share * np.nanmax(force[:, UP]))
    return result


def _wrapped(force: Array, share: float) -> Array:
    """Let the vertical force overflow to the other end of its range."""
    most = share * np.nanmax(force[:, UP])
    result = np.array(force)
    result[:, UP] = (force[:, UP] + most) % (2.0 * most) - most
    return result


def _missing(case: Case) -> Case | None:
    """Leave nothing of the most loaded plate."""
    wrenches = case.wrenches
    kept = [number for number in range(len(wrenches.names)) if number != case.plates[0]]
    if len(case.plates) < 2:
        return None
    return case.with_wrenches(
        names=tuple(wrenches.names[number] for number in kept),
        bodies=tuple(wrenches.bodies[number] for number in kept),
        forces=wrenches.forces[:, kept],
        points=wrenches.points[:, kept],
        torques=wrenches.torques[:, kept],
    )


def _same_signal(case: Case) -> Case | None:
    """Write one plate's channels into another's."""
    if len(case.plates) < 2:
        return None
    first, second = case.plates[:2]
    parts = {}
    for part in ("forces", "points", "torques"):
        values = np.array(getattr(case.wrenches, part))
        values[:, second] = values[:, first]
        parts[part] = values
    return case.with_wrenches(**parts)


def _samples_lost(case: Case, seconds: float) -> Case:
    """Take samples of all plates out, and number the others anew."""
    wrenches = case.wrenches
    count = round(seconds / float(np.median(np.diff(wrenches.time))))
    middle = slice(len(wrenches.time) // 2, len(wrenches.time) // 2 + count)
    return case.with_wrenches(
        time=wrenches.time[: len(wrenches.time) - count],
        **{
            part: np.delete(getattr(wrenches, part), middle, axis=0)
            for part in ("forces", "points", "torques")
        },
    )


def _faults_of_axes() -> Iterator[Fault]:
    signs = {"x": (-1, 1, 1), "y": (1, -1, 1), "z": (1, 1, -1), "xyz": (-1, -1, -1)}
    for axes, sign in signs.items():
        accepted = ("reversed", "swapped sign", "mirrored axis", "walking direction")
        yield _all(
            f"plates: forces along {axes} reversed",
            accepted,
            "forces",
            lambda force, sign=sign: force * np.array(sign),
        )
    for axes in ("x", "y"):
        yield _one(
            f"plate: forces along {axes} reversed",
            ("reversed", "swapped sign", "turned plate"),
            "forces",
            lambda force, sign=signs[axes]: force * np.array(sign),
        )
    exchanged = ("exchanged axes", "walking direction", "turned plate", "mirrored axis")
    yield _all("plates: x and z exchanged", exchanged, "forces", lambda force: force[:, [2, 1, 0]])
    yield _one("plate: x and z exchanged", exchanged, "forces", lambda force: force[:, [2, 1, 0]])
    yield _all("plates: x and y exchanged", exchanged, "forces", lambda force: force[:, [1, 0, 2]])
    yield _all(
        "plates: points mirrored along z",
        ("mirrored", "wrong foot", "points mirrored"),
        "points",
        lambda points: points * np.array([1.0, 1.0, -1.0]),
    )
    yield Fault(
        name="plates: forces of two exchanged",
        accepted=("plates exchanged", "wrong foot"),
        put=_forces_exchanged,
    )
    yield Fault(name="plates: feet of two exchanged", accepted=("wrong foot",), put=_feet_exchanged)


def _forces_exchanged(case: Case) -> Case | None:
    """Exchange forces and torques of two plates, whose points stay."""
    if len(case.plates) < 2:
        return None
    first, second = case.plates[:2]
    order = np.arange(len(case.wrenches.names))
    order[[first, second]] = second, first
    return case.with_wrenches(
        forces=case.wrenches.forces[:, order], torques=case.wrenches.torques[:, order]
    )


def _feet_exchanged(case: Case) -> Case | None:
    """Put the forces of two feet on each other."""
    bodies = list(case.wrenches.bodies)
    first = case.plates[0]
    others = [plate for plate in case.plates if bodies[plate] != bodies[first]]
    if not others or not all(bodies):
        return None
    own = bodies[first]
    bodies[first] = bodies[others[0]]
    bodies[others[0]] = own
    return case.with_wrenches(bodies=tuple(bodies))


def _faults_of_places(rng: np.random.Generator) -> Iterator[Fault]:
    for axis, word in ((0, "fore-aft"), (2, "sideways")):
        for build, who in ((_one, "plate"), (_all, "plates")):
            shift = rng.choice([-1.0, 1.0]) * rng.uniform(0.04, 0.06)
            yield build(
                f"{who}: points {100 * shift:.1f} cm off {word}",
                ("points off", "moments about another origin"),
                "points",
                lambda points, axis=axis, shift=shift: points + shift * (np.arange(3) == axis),
            )
            share = rng.choice([-1.0, 1.0]) * rng.uniform(0.04, 0.06)
            yield build(
                f"{who}: {100 * share:.1f} % of the vertical force {word}",
                ("crosstalk", "tilted"),
                "forces",
                lambda force, axis=axis, share=share: (
                    force + share * force[:, [UP]] * (np.arange(3) == axis)
                ),
            )


def _faults_of_sizes(rng: np.random.Generator) -> Iterator[Fault]:
    gain = ("gain", "mass")
    for low, high in ((0.09, 0.12), (0.18, 0.25)):
        share = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(low, high)
        yield _gained(f"plates: gain {share:.2f}", gain, share, every=True)
    for low, high in ((0.13, 0.17), (0.2, 0.3)):
        share = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(low, high)
        yield _gained(f"plate: gain {share:.2f}", ("gain",), share, every=False)
    unit = ("unit of force", "unit of forces")
    units = {"pounds": 4.44822, "kilograms": 9.80665, "kN": 1e3, "body weights": 700.0}
    for word, size in units.items():
        yield _gained(f"plates: forces in {word}", unit, 1.0 / size, every=True)
    yield _all(
        "plates: torques in N mm",
        ("N mm for N m",),
        "torques",
        lambda torques: 1000.0 * torques,
    )
    yield _all("plates: points in mm", ("mm for m",), "points", lambda points: 1000.0 * points)


def _gained(name: str, accepted: tuple[str, ...], share: float, *, every: bool) -> Fault:
    """Make a fault of the size of forces and torques of one or all plates."""

    def put(case: Case) -> Case:
        plates = case.plates if every else case.plates[:1]
        changed = case.on_plates(plates, "forces", lambda force: share * force)
        return changed.on_plates(plates, "torques", lambda torque: share * torque)

    return Fault(name=name, accepted=accepted, put=put)


def _faults_of_clocks(rng: np.random.Generator) -> Iterator[Fault]:
    for low, high in ((0.018, 0.024), (0.03, 0.04), (0.05, 0.07)):
        lag = rng.choice([-1.0, 1.0]) * rng.uniform(low, high)
        yield Fault(
            name=f"plates: {1000 * lag:.0f} ms late",
            accepted=("clock",),
            put=lambda case, lag=lag: case.with_wrenches(time=case.wrenches.time + lag),
        )
    late = rng.uniform(0.035, 0.05)
    yield Fault(
        name=f"plate: {1000 * late:.0f} ms late",
        accepted=("clock",),
        put=lambda case: _one_late(case, late),
    )
    rate = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.018, 0.022)
    yield Fault(
        name=f"markers: rate {rate:.3f} times the true one",
        accepted=("clock rate",),
        put=lambda case: case.with_markers(
            case.markers.values,
            case.markers.time[0] + (case.markers.time - case.markers.time[0]) / rate,
        ),
    )


def _one_late(case: Case, late: float) -> Case:
    """Delay the channels of the most loaded plate."""
    wrenches = case.wrenches
    plate = case.plates[0]
    parts = {}
    for part in ("forces", "points", "torques"):
        values = np.array(getattr(wrenches, part))
        for axis in range(3):
            values[:, plate, axis] = np.interp(
                wrenches.time - late, wrenches.time, np.nan_to_num(values[:, plate, axis])
            )
        parts[part] = values
    return case.with_wrenches(**parts)


def _faults_of_wires(rng: np.random.Generator) -> Iterator[Fault]:
    mains = float(rng.choice([50.0, 60.0]))
    newtons = rng.uniform(20.0, 60.0)
    yield Fault(
        name=f"plate: {newtons:.0f} N of hum at {mains:.0f} Hz",
        accepted=("hum",),
        put=lambda case: _humming(case, mains, newtons),
    )
    spikes = rng.uniform(0.2, 0.8, int(rng.integers(2, 6)))
    yield Fault(
        name=f"plate: {len(spikes)} single samples",
        accepted=("spikes",),
        put=lambda case: _spiked(case, spikes),
    )
    first, second = rng.uniform(size=2)
    yield Fault(
        name="markers: one has the label of another, too",
        accepted=("doubled marker",),
        put=lambda case: _doubled(case, first, second),
    )


def _rate(case: Case) -> float:
    """Rate of the plates [Hz]."""
    return 1.0 / float(np.median(np.diff(case.wrenches.time)))


def _humming(case: Case, mains: float, newtons: float) -> Case | None:
    """Add a line to the vertical force, where samples are dense enough to hold one."""
    if _rate(case) < 4.0 * mains:
        return None
    line = newtons * np.sin(2.0 * np.pi * mains * case.wrenches.time)
    return case.on_plates(
        case.plates[:1], "forces", lambda force: force + line[:, None] * (np.arange(3) == UP)
    )


def _spiked(case: Case, places: Array) -> Case | None:
    """Lift single samples at shares of the time by half the largest force."""
    if _rate(case) < 400.0:
        return None
    at = np.isin(np.arange(len(case.wrenches.time)), (places * len(case.wrenches.time)).astype(int))

    def change(force: Array) -> Array:
        lift = 0.5 * float(np.nanmax(force[:, UP]))
        return force + lift * at[:, None] * (np.arange(3) == UP)

    return case.on_plates(case.plates[:1], "forces", change)


def _doubled(case: Case, first: float, second: float) -> Case:
    """Give one of the model's markers the positions of another."""
    known = [
        number for number, name in enumerate(case.markers.names) if name in case.model.marker_names
    ]
    one = known.pop(int(first * len(known)))
    other = known[int(second * len(known))]
    values = np.array(case.markers.values)
    values[:, one] = values[:, other]
    return case.with_markers(values)
