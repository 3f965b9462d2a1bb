"""What may be wrong with plates and markers, each as the correction that would put it right.

A hypothesis names explanations that data cannot tell apart, such as a gain of all plates and a mass
of the body, and says how a recording is corrected by values of given standard deviation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from myomorph.core.model.arrays import Array, read_only

UNITS = {
    "pounds": 4.4482216,
    "kilograms": 9.80665,
    "kilonewtons": 1e3,
    "millinewtons": 1e-3,
    "newtons, read as pounds": 0.2248089,
}
"""Units that forces may be in, in newtons."""
GAIN_SD = 0.2
UNIT_SD = 0.02
POINT_SD = 0.05
TILT_SD = 0.06
TURN_SD = 0.08
CLOCK_SD = 0.05
RATE_SD = 0.015
OFFSET_SD = 0.06
"""Standard deviations of what goes wrong: of a gain, of a gain beside a unit, a place [m],
crosstalk, a tilt [rad], a clock [s], the rate of a clock, an offset over the weight.
"""
LOST_AT = (0.3, 0.4, 0.5, 0.6, 0.7)
"""Shares of the frames before samples are lost, as far as they are tried."""
LOWEST_GAIN = -0.9
"""Correction of a gain beyond which a plate has no gain but another sign."""
GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""
LEAST = {
    "gain": 0.06,
    "mass": 0.055,
    "points": 0.027,
    "crosstalk": 0.025,
    "tilt": 0.042,
    "clock": 0.012,
    "lost": 0.015,
    "rate": 0.008,
    "offset": 0.03,
}
"""Sizes from which they matter, in the same units."""


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class Correction:
    """What is done to a recording before its balance is drawn up.

    Attributes
    ----------
    force : (plates, 3, 3) F' = force F
    point : (plates, 3, 3) p' = point p + shift
    shift : (plates, 3) [m]
    lag : (plates,) that the plates are late [s]
    offset : (plates, 3) added [N]
    rate : share by which the plates' clock is slow
    lost_from, lost : from this time on, plates are early by so much [s]
    gravity : (2,) tilt of the whole laboratory about the level axes [rad]
    cameras : (2,) tilt of the markers against the plates [rad]
    center : (3,) shift of the body's center of mass [m]
    ahead : that soles lie before those of the model [m]
    exchanged : two plates whose forces are exchanged while their points stay
    """

    force: Array
    point: Array
    shift: Array
    lag: Array
    offset: Array
    rate: float = 0.0
    lost_from: float = np.inf
    lost: float = 0.0
    gravity: Array = field(default_factory=lambda: np.zeros(2))
    cameras: Array = field(default_factory=lambda: np.zeros(2))
    center: Array = field(default_factory=lambda: np.zeros(3))
    ahead: float = 0.0
    exchanged: tuple[int, int] | None = None

    @property
    def keeps_clocks(self) -> bool:
        """Whether plates are sampled as they are."""
        moved = self.lag.any() or self.rate or self.lost
        return not moved and self.exchanged is None

    @property
    def of_plates(self) -> bool:
        """Whether it is made plate by plate, beside markers and the body."""
        of_others = self.gravity.any() or self.cameras.any() or self.center.any() or self.ahead
        return not (of_others or self.rate or self.lost or self.exchanged is not None)


def no_correction(plates: int) -> Correction:
    """Make the correction of so many plates that changes nothing."""
    same = np.tile(np.eye(3), (plates, 1, 1))
    nothing = np.zeros((plates, 3))
    return Correction(force=same, point=same, shift=nothing, lag=np.zeros(plates), offset=nothing)


Maker = Callable[[Array], Correction]
"""From values to the correction by them."""


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class Hypothesis:
    """What may be wrong.

    Attributes
    ----------
    kinds : explanations that look alike in the data, the likeliest first
    place : names of the plates concerned, "" for markers or the whole
    make : the correction by values
    sd : (values,) standard deviation of each, empty for what has no size
    least : size of a value from which it matters
    starts : (starts, values) from which the best values are looked for
    text : what is wrong with the forces by values and half widths of their intervals, after a
        colon
    prior : its log probability beside that of the others
    size : of what is wrong by values, for its message; None where it has none
    lowest : value below which it would be another fault
    """

    kinds: tuple[str, ...]
    place: str
    make: Maker
    text: Callable[[Array, Array], str]
    sd: Array = field(default_factory=lambda: np.zeros(0))
    least: float = 0.0
    starts: Array | None = None
    prior: float = 0.0
    size: Callable[[Array], float] | None = None
    lowest: float = -np.inf

    @property
    def first_values(self) -> Array:
        """(starts, values) to begin with: nothing wrong, where none are stated."""
        return np.zeros((1, len(self.sd))) if self.starts is None else self.starts


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class Plates:
    """What hypotheses are about.

    Attributes
    ----------
    names : of the plates
    live : numbers of the plates that are stepped on and work
    zeros : numbers of those that were seen without load, so that their offset is known
    up : number of the vertical axis
    weight : of the body [N]
    times : of the frames that are compared [s]
    """

    names: tuple[str, ...]
    live: tuple[int, ...]
    zeros: frozenset[int]
    up: int
    weight: float
    times: Array

    @property
    def level(self) -> Array:
        """(2, 3) unit vectors along the level axes."""
        return np.eye(3)[[axis for axis in range(3) if axis != self.up]]

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Every two plates that are stepped on."""
        return [
            (self.live[later], other)
            for later in range(len(self.live))
            for other in self.live[:later]
        ]


def hypotheses(plates: Plates) -> Iterator[Hypothesis]:
    """List what may be wrong: of all plates together, of each, of clocks, and of markers.

    Parameters
    ----------
    plates : of the recording
    """
    groups = [tuple(plates.live)]
    if len(plates.live) > 1:
        groups += [(number,) for number in plates.live]
    for group in groups:
        of_group = _Group(plates, group)
        yield from of_group.sizes()
        yield from of_group.axes()
        yield from of_group.places()
        yield from of_group.clock()
    yield from _of_the_whole(plates)
    for pair in plates.pairs:
        exchanged = replace(no_correction(len(plates.names)), exchanged=pair)
        yield _sure(
            kind="plates exchanged",
            place=", ".join(plates.names[number] for number in pair),
            text="exchanged with each other, while their points are not",
            correction=exchanged,
        )


def _sure(*, kind: str, place: str, text: str, correction: Correction) -> Hypothesis:
    """Make a hypothesis without a size."""
    return Hypothesis(kinds=(kind,), place=place, make=lambda _: correction, text=lambda *_: text)


@dataclass(frozen=True, eq=False)
class _Group:
    """Plates that have one fault in common: all of them, or one."""

    plates: Plates
    members: tuple[int, ...]

    @property
    def all(self) -> bool:
        """Whether these are all plates, which are more than one."""
        return len(self.members) > 1

    @property
    def place(self) -> str:
        """Names of the plates."""
        return ", ".join(self.plates.names[number] for number in self.members)

    @property
    def none(self) -> Correction:
        """What changes nothing."""
        return no_correction(len(self.plates.names))

    @property
    def mask(self) -> Array:
        """(plates,) 1 for those of the group."""
        return np.isin(np.arange(len(self.plates.names)), self.members).astype(float)

    def mixed(self, matrix: Array, start: Array) -> Array:
        """Put a matrix (3, 3) in the place of `start` (plates, 3, 3) for these plates."""
        return start + self.mask[:, None, None] * (matrix - np.eye(3))

    def _forces(self, matrix: Array) -> Correction:
        """Correct forces by a matrix (3, 3)."""
        none = self.none
        return replace(none, force=self.mixed(matrix, none.force))

    def _points(self, matrix: Array) -> Correction:
        """Correct points by a matrix (3, 3)."""
        none = self.none
        return replace(none, point=self.mixed(matrix, none.point))

    def sizes(self) -> Iterator[Hypothesis]:
        """Gains, units and offsets."""
        everything = len(self.members) == len(self.plates.live)
        yield self._weight() if everything else self._gain()
        if everything:
            for word, factor in UNITS.items():
                yield self._unit(word, factor)
        if not self.plates.zeros & set(self.members):
            yield Hypothesis(
                kinds=("offset",),
                place=self.place,
                make=lambda values: replace(self.none, offset=np.outer(self.mask, -values)),
                sd=np.full(3, OFFSET_SD * self.plates.weight),
                least=LEAST["offset"] * self.plates.weight,
                text=lambda values, _: (
                    "off by " + ", ".join(f"{value:.0f}" for value in values) + " N along x, y, z"
                ),
            )

    def _weight(self) -> Hypothesis:
        """Make the hypothesis that body and plates are not of one weight."""
        mass = self.plates.weight / GRAVITY
        return Hypothesis(
            kinds=("mass", "gain of all plates"),
            place=self.place,
            make=lambda values: self._forces(np.eye(3) * (1.0 + values[0])),
            sd=np.array([GAIN_SD]),
            least=LEAST["mass"],
            text=lambda values, spread: (
                f"a body of {_over(mass, values[0], spread[0], digits=1, unit='kg')}, where the"
                f" model weighs {mass:.1f} kg ({100.0 * values[0]:+.0f} %): scale the model to the"
                " person's mass, or check the calibration of the plates"
            ),
            size=lambda values: 100.0 * float(values[0]),
            lowest=LOWEST_GAIN,
        )

    def _gain(self) -> Hypothesis:
        """Make the hypothesis that one plate has another gain than the others."""
        return Hypothesis(
            kinds=("gain",),
            place=self.place,
            make=lambda values: self._forces(np.eye(3) * (1.0 + values[0])),
            sd=np.array([GAIN_SD]),
            least=LEAST["gain"],
            text=lambda values, spread: (
                f"{_over(100.0, values[0], spread[0], digits=0, unit='%')} of what the body needs:"
                " check the calibration of its plate (gain, range)"
            ),
            size=lambda values: 100.0 / (1.0 + float(values[0])) - 100.0,
            lowest=LOWEST_GAIN,
        )

    def _unit(self, word: str, factor: float) -> Hypothesis:
        """Make the hypothesis that forces are in a unit of so many newtons."""
        return Hypothesis(
            kinds=("unit of force",),
            place=self.place,
            make=lambda values: self._forces(np.eye(3) * factor * (1.0 + values[0])),
            sd=np.array([UNIT_SD]),
            text=lambda *_: f"in {word}",
        )

    def axes(self) -> Iterator[Hypothesis]:
        """Signs, exchanged axes and quarter turns."""
        up = self.plates.up
        for axis, word in enumerate("xyz"):
            mirror = np.diag(np.where(np.arange(3) == axis, -1.0, 1.0))
            yield self._sure(f"reversed {word}", f"reversed along {word}", self._forces(mirror))
            if axis != up:
                yield self._sure(
                    f"points mirrored {word}",
                    f"points mirrored along {word}",
                    self._points(mirror),
                )
        yield self._sure("reversed xyz", "reversed", self._forces(-np.eye(3)))
        for first, second in ((0, 1), (0, 2), (1, 2)):
            order = np.arange(3)
            order[[first, second]] = second, first
            words = f"{'xyz'[first]} and {'xyz'[second]}"
            yield self._sure(
                f"exchanged axes {words}",
                f"{words} exchanged",
                self._forces(np.eye(3)[order]),
            )
        upright = np.outer(np.eye(3)[up], np.eye(3)[up])
        for sign in (1.0, -1.0):
            quarter = upright + sign * np.cross(np.eye(3), np.eye(3)[up])
            yield self._sure(
                "turned plate", "turned by a quarter about the vertical", self._forces(quarter)
            )

    def _sure(self, kind: str, text: str, correction: Correction) -> Hypothesis:
        """Make a hypothesis about these plates without a size."""
        return _sure(kind=kind, place=self.place, text=text, correction=correction)

    def places(self) -> Iterator[Hypothesis]:
        """Shifted points and crosstalk of the vertical force."""
        level = self.plates.level
        vertical = np.eye(3)[self.plates.up]
        yield Hypothesis(
            kinds=("points off",),
            place=self.place,
            make=lambda values: replace(self.none, shift=np.outer(self.mask, values @ level)),
            sd=np.full(2, POINT_SD),
            least=LEAST["points"],
            text=lambda values, _: (
                f"centers of pressure off by {_along(-100.0 * values, 'cm', level)}"
            ),
        )
        everything = len(self.members) == len(self.plates.live)
        yield Hypothesis(
            kinds=("crosstalk", "plates tilted") if everything else ("crosstalk",),
            place=self.place,
            make=lambda values: self._forces(np.eye(3) + np.outer(values @ level, vertical)),
            sd=np.full(2, TILT_SD),
            least=LEAST["crosstalk"],
            text=lambda values, _: (
                "hold "
                + _along(-100.0 * values, "%", level)
                + " of the vertical force"
                + (", or the plates are tilted" if everything else "")
            ),
        )

    def clock(self) -> Iterator[Hypothesis]:
        """Plates that are late."""
        whole = self.all or len(self.plates.live) == 1
        yield Hypothesis(
            kinds=("clock",),
            place=self.place,
            make=lambda values: replace(self.none, lag=self.mask * values[0]),
            sd=np.array([CLOCK_SD]),
            least=LEAST["clock"],
            starts=np.linspace([-0.15], [0.15], 11),
            text=lambda values, spread: (
                f"{_late(values[0], spread[0])} relative to the motion"
                + (f": {_shift(values[0])}" if whole else " and the other plates")
            ),
            size=lambda values: 1000.0 * abs(float(values[0])),
        )


def _of_the_whole(plates: Plates) -> Iterator[Hypothesis]:
    """List what concerns the clocks, or markers and plates together."""
    none = no_correction(len(plates.names))
    place = ", ".join(plates.names[number] for number in plates.live)
    for share in LOST_AT:
        yield _lost(none, place, float(np.quantile(plates.times, share)))
    yield Hypothesis(
        kinds=("clock rate",),
        place=place,
        make=lambda values: replace(none, rate=values[0]),
        sd=np.array([RATE_SD]),
        least=LEAST["rate"],
        text=lambda values, _: (
            f"at a rate that differs from the motion's by {abs(100.0 * values[0]):.1f} %"
        ),
    )
    for kind, words, make in (
        (
            "laboratory tilted",
            "tilted with the cameras against gravity",
            lambda values: replace(none, gravity=values),
        ),
        (
            "cameras tilted",
            "tilted against the cameras",
            lambda values: replace(none, cameras=values),
        ),
    ):
        yield _tilted(kind=kind, place=place, words=words, make=make)


def _lost(none: Correction, place: str, time: float) -> Hypothesis:
    """Make the hypothesis that samples are lost from a time on [s]."""
    return Hypothesis(
        kinds=("lost samples",),
        place=place,
        make=lambda values: replace(none, lost_from=time, lost=values[0]),
        sd=np.array([CLOCK_SD]),
        least=LEAST["lost"],
        starts=np.array([[-0.12], [-0.05], [0.05], [0.12]]),
        prior=-float(np.log(len(LOST_AT))),
        text=lambda values, spread: (
            f"{_late(values[0], spread[0])} from about {time:.2f} s on: samples of"
            f" {_shorter(values[0])} are lost there"
        ),
    )


def _over(size: float, gain: float, spread: float, *, digits: int, unit: str) -> str:
    """Write a size over a gain with its interval: the half width follows by its derivative.

    Parameters
    ----------
    size : of what is divided, in the unit
    gain, spread : share by which forces are to be larger, and half width of its interval
    digits : after the point
    unit : of the size
    """
    share = 1.0 / (1.0 + gain)
    half = size * spread * share**2
    return f"{size * share:.{digits}f} {unit} (±{half:.{digits}f} {unit})"


def _late(lag: float, spread: float) -> str:
    """Write a lag and its interval's half width [s], and a direction."""
    direction = "late" if lag > 0.0 else "early"
    return f"{abs(1000.0 * lag):.0f} ms (±{1000.0 * spread:.0f} ms) {direction}"


def _shift(lag: float) -> str:
    """Say what helps where all plates lag by so much [s]."""
    shift = f"{-1000.0 * lag:.0f} ms (--force-shift {-lag:.3f})"
    return f"shift them by {shift}, or synchronize the recordings"


def _shorter(lag: float) -> str:
    """Name the recording whose samples are lost where the forces lag by so much [s]."""
    return "the motion" if lag > 0.0 else "the forces"


def _tilted(*, kind: str, place: str, words: str, make: Maker) -> Hypothesis:
    """Make the hypothesis of a tilt about the two level axes."""
    return Hypothesis(
        kinds=(kind,),
        place=place,
        make=make,
        sd=np.full(2, TURN_SD),
        least=LEAST["tilt"],
        text=lambda values, _: f"{words} by {np.degrees(np.linalg.norm(values)):.1f} degrees",
    )


def _along(values: Array, unit: str, level: Array) -> str:
    """Write values (2,) of a unit along the two level axes (2, 3)."""
    axes = ["xyz"[int(np.argmax(axis))] for axis in level]
    return " and ".join(
        f"{value:.1f} {unit} along {axis}" for value, axis in zip(values, axes, strict=True)
    )
