"""Impacts as forces: impulse from loudness or from motion, and short pulses on what strikes.

    p = e^a E^b

from the energy E of the sound, calibrated with impacts of known impulse; the pressure that a struck
membrane sends out grows with the impulse, so b is near 1/2;

    p = m dv,   m = 1 / (d^T J M^-1 J^T d)

from the change of velocity dv of the tip and the mass m it strikes with (Khatib 1995, effective
mass of a point along d).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.contact.sound import HeardImpacts
from myomorph.core.contact.strikers import Striker, change_of_velocity, site_places
from myomorph.core.fit.interval_rule import LEVEL, half_width
from myomorph.core.model.arrays import Array, read_only, unit_vector
from myomorph.core.model.causes import SOUND
from myomorph.core.model.contacts import Site
from myomorph.core.model.errors import BadData, BadModel, check_name
from myomorph.core.model.interval import Interval
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.motion.filters import lowpass
from myomorph.core.rigid.dynamics import MotionArrays
from myomorph.core.rigid.forward import forward_accelerations, gathered
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

LINEAR = 0.5
PRIOR = 1.0
"""Exponent of an instrument that answers linearly, and how much it counts compared with the
impacts: as if known to 0.1 where impacts scatter by 10 %.
"""


@dataclass(frozen=True)
class ImpulseLaw:
    """Impulse of an impact from the energy of its sound: p = scale E^exponent.

    Attributes
    ----------
    scale : impulse at an energy of 1 [N s]
    exponent : 1/2 for an instrument that answers linearly
    error : standard deviation of log p about the law: a share, 0.1 for 10 %; NaN of one impact
    lowest, highest : energies of the calibration impacts
    impacts : how many there were
    middle : mean of log E of the calibration impacts
    weight : sum of squares of log E about it, and what the exponent's prior adds
    """

    scale: float
    exponent: float
    error: float
    lowest: float
    highest: float
    impacts: int
    middle: float = 0.0
    weight: float = PRIOR

    def impulse(self, energy: ArrayLike) -> Array:
        """Impulse of energies; 0 of 0.

        Parameters
        ----------
        energy : of any shape [full scale^2 s]

        Returns
        -------
        as the energies [N s]
        """
        return self.scale * np.maximum(np.asarray(energy, dtype=np.float64), 0.0) ** self.exponent

    def limits(self, energy: float, level: float = LEVEL) -> Interval:
        """Interval of the impulse of one impact.

            log p +- t s sqrt(1 + 1/n + (log E - middle)^2 / weight)

        with s the error and t of n - 1 degrees of freedom: the prior of the exponent counts as
        an impact.

        Parameters
        ----------
        energy : of its sound [full scale^2 s]
        level : probability that the interval holds the impulse

        Returns
        -------
        [N s], its ends NaN where one impact alone calibrated
        """
        if self.impacts < 2 or not energy > 0.0:
            return Interval(float(self.impulse(energy)), np.nan, np.nan)
        away = np.log(energy) - self.middle
        sd = self.error * np.sqrt(1.0 + 1.0 / self.impacts + away**2 / self.weight)
        factor = float(np.exp(half_width(sd, level, self.impacts - 1)))
        impulse = float(self.impulse(energy))
        return Interval(impulse, impulse / factor, impulse * factor)

    def covers(self, energy: float) -> bool:
        """Return whether an energy lies among those calibrated on, by a factor of 2 (3 dB)."""
        return 0.5 * self.lowest <= energy <= 2.0 * self.highest


def calibrate_impulse(energies: ArrayLike, impulses: ArrayLike) -> ImpulseLaw:
    """Fit the law through impacts of known impulse, a straight line of log p over log E.

    The exponent is drawn towards 1/2 where energies hardly differ.

    Parameters
    ----------
    energies, impulses : (impacts,) of one instrument [full scale^2 s], [N s]

    Raises
    ------
    BadData : another number of both, none, or one that is not above 0
    """
    E = np.atleast_1d(np.asarray(energies, float))
    p = np.atleast_1d(np.asarray(impulses, float))
    if E.shape != p.shape or not len(E):
        raise BadData(
            f"{len(E)} energies and {len(p)} impulses: expected as many of both, one or more"
        )
    if not (np.all(np.isfinite(E) & (E > 0.0)) and np.all(np.isfinite(p) & (p > 0.0))):
        raise BadData(
            "energies and impulses of calibration impacts must be above 0: leave out impacts that"
            " were not heard"
        )
    x = np.log(E)
    y = np.log(p)
    across = x - x.mean()
    slope = float((across @ y + PRIOR * LINEAR) / (across @ across + PRIOR))
    offset = float(np.mean(y - slope * x))
    error = float("nan")
    if len(E) > 1:
        squares = np.sum((y - offset - slope * x) ** 2) + PRIOR * (slope - LINEAR) ** 2
        error = float(np.sqrt(squares / (len(E) - 1)))
    return ImpulseLaw(
        scale=float(np.exp(offset)),
        exponent=slope,
        error=error,
        lowest=float(E.min()),
        highest=float(E.max()),
        impacts=len(E),
        middle=float(x.mean()),
        weight=float(across @ across) + PRIOR,
    )


def calibration_pairs(
    heard: HeardImpacts, known: Mapping[str, Sequence[tuple[float, float]]]
) -> dict[str, ImpulseLaw]:
    """Fit a law for each instrument to impacts of known time and impulse.

    Parameters
    ----------
    heard : impacts on the clock of the known ones
    known : instrument to (time [s], impulse [N s]) of each impact; the nearest heard one within 50
        ms is it

    Raises
    ------
    BadData : none of the known impacts on an instrument was heard
    UnknownName : an instrument was not recorded
    """
    laws = {}
    for name, entries in known.items():
        on_it = heard.of(name)
        pairs = []
        for time, impulse in entries:
            near = min(on_it, key=lambda impact: abs(impact.time - time), default=None)
            if near is not None and abs(near.time - time) <= 0.05:
                pairs.append((near.energy, impulse))
        if not pairs:
            raise BadData(
                f"none of the {len(entries)} known impacts on '{name}' was heard within 50 ms of"
                " its time"
            )
        laws[name] = calibrate_impulse([pair for pair, _ in pairs], [pair for _, pair in pairs])
    return laws


def effective_mass(
    model: Model, motion: Motion, body: str, point: ArrayLike, direction: ArrayLike
) -> Array:
    """Mass with which a point of a body meets an impact along a direction.

        m = 1 / (d^T J M^-1 J^T d)

    over the coordinates that are free, couplers and loops kept, joints taken as loose: over a few
    milliseconds an impact outruns what muscles hold. It is inf where the point cannot move that
    way.

    Source: Khatib 1995.

    Parameters
    ----------
    model : of the body
    motion : coordinates over time
    body : its name
    point : (3,) in the body's frame [m]
    direction : (3,) or (frames, 3) in ground

    Returns
    -------
    (frames,) [kg]

    Raises
    ------
    BadModel : coordinates move no mass
    """
    tree = compile_tree(model)
    b = tree.body_number(body)
    coordinates = tree.coordinates_of(motion)
    poses = forward_kinematics(tree, coordinates)
    places = poses.points(np.array([b]), np.atleast_2d(np.asarray(point, float)))[:, 0]
    along = np.broadcast_to(np.asarray(direction, float), places.shape)
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    rows = np.einsum("fi,fij->fj", along, poses.jacobian(b, places)[:, 3:])
    still = np.zeros_like(rows)
    nothing = np.zeros((len(rows), len(tree.arrays.parent), 6))
    push = gathered(tree, coordinates, rows)
    try:
        at_rest = MotionArrays(values=coordinates, velocities=still, accelerations=still)
        pushed, _ = forward_accelerations(tree, at_rest, nothing, push)
        alone, _ = forward_accelerations(tree, at_rest, nothing, still)
    except np.linalg.LinAlgError:
        raise BadModel(
            f"model '{model.name}' has coordinates that move no mass: an impact has no effective"
            " mass"
        ) from None
    yields = np.einsum("fj,fj->f", rows, pushed - alone)
    return np.where(yields > 0.0, 1.0 / np.where(yields > 0.0, yields, 1.0), np.inf)


@read_only
class Impact:
    """A short force on a body at one of its sites.

    Attributes
    ----------
    site : its name
    time : when it begins [s]
    impulse : [N s]
    direction : (3,) of the force on the body, in ground (made a unit vector)
    instrument : that was struck
    low, high : limits of 90 % of the impulse, NaN where nothing shows them [N s]
    confidence : probability of this site among those that may have struck, 0 to 1
    """

    site: str
    time: float
    impulse: float
    direction: Array
    instrument: str = ""
    low: float = np.nan
    high: float = np.nan
    confidence: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(
            self,
            "direction",
            unit_vector(self.direction, "direction", f"an impact on '{self.site}'"),
        )
        if not (np.isfinite(self.impulse) and self.impulse >= 0.0):
            raise BadData(
                f"impulse of an impact on '{self.site}' is {self.impulse:g} N s: expected 0 or more"
            )


def velocity_change(model: Model, motion: Motion, site: Site, time: float) -> Array:
    """Change of a site's velocity in an impact.

    Between straight lines through its places in the 30 ms before and after it touches. Motion
    capture smooths an impact over its frames and its filter, so this is too small where either is
    slow.

    Parameters
    ----------
    model : of the body
    motion : coordinates over time
    site : that strikes
    time : of the impact [s]

    Returns
    -------
    (3,) in ground [m/s]
    """
    return change_of_velocity(motion.time, site_places(model, motion, site), time)


def impacts_from_sound(
    heard: HeardImpacts,
    laws: Mapping[str, ImpulseLaw],
    strikers: Mapping[int, Striker],
    normals: Mapping[str, ArrayLike],
) -> tuple[tuple[Impact, ...], tuple[Message, ...]]:
    """Impacts that were heard and whose site is known, with warnings.

    Parameters
    ----------
    heard : all impacts
    laws : of each instrument
    strikers : by place in `heard.impacts`, as `find_strikers` finds
    normals : instrument to the direction in which it pushes back, in ground; y where it is not
        named

    Returns
    -------
    impacts, and warnings, one line each

    Raises
    ------
    UnknownName : an instrument has no law
    """
    result = []
    beyond = []
    for number, striker in strikers.items():
        impact = heard.impacts[number]
        check_name("instrument", impact.instrument, laws, "the calibration of impulses")
        law = laws[impact.instrument]
        if not law.covers(impact.energy):
            beyond.append(impact)
        direction = np.asarray(normals.get(impact.instrument, (0.0, 1.0, 0.0)), float)
        limits = law.limits(impact.energy)
        result.append(
            Impact(
                site=striker.site,
                time=impact.time,
                impulse=float(law.impulse(impact.energy)),
                direction=direction,
                instrument=impact.instrument,
                low=limits.low,
                high=limits.high,
                confidence=striker.confidence,
            )
        )
    warnings = []
    if beyond:
        first = beyond[0]
        warnings.append(
            SOUND.message(
                f"{len(beyond)} of {len(result)} impacts are louder or softer than those calibrated"
                f" on, first on '{first.instrument}' at {first.time:.3f} s: their impulses are"
                " extrapolated"
            )
        )
    return tuple(result), tuple(warnings)


def impact_wrenches(  # page: a pulse and a filter beside what strikes
    impacts: Sequence[Impact],
    model: Model,
    motion: Motion,
    sites: Sequence[Site],
    duration: float = 0.008,
    cutoff: float | None = None,
) -> Wrenches:
    """Impacts as external loads at the motion's times, one for each site that was struck.

    Parameters
    ----------
    impacts : on the body
    model : of the body
    motion : coordinates over time
    sites : that may strike
    duration : of a half-sine pulse [s]; on a slower clock the pulse is as wide as the clock can
        carry
    cutoff : low-pass that the motion went through [Hz]: its accelerations are spread over an
        impact, and so must the force be that balances them; None for none

    Raises
    ------
    UnknownName : an impact on a site that does not exist
    """
    by_name = {site.name: site for site in sites}
    for impact in impacts:
        check_name("contact site", impact.site, by_name, "the model's sites")
    struck = tuple(dict.fromkeys(impact.site for impact in impacts))
    forces = np.zeros((len(motion), len(struck), 3))
    points = np.zeros((len(motion), len(struck), 3))
    for column, name in enumerate(struck):
        points[:, column] = site_places(model, motion, by_name[name])
    for impact in impacts:
        size = pulse(motion.time, impact.time, impact.impulse, duration)
        forces[:, struck.index(impact.site)] += size[:, None] * impact.direction
    if cutoff is not None and struck:
        forces = lowpass(forces, motion.rate, cutoff)
    bodies = tuple(by_name[name].body for name in struck)
    return Wrenches(
        time=motion.time,
        names=struck,
        bodies=bodies,
        forces=forces,
        points=points,
        torques=np.zeros_like(forces),
    )


def pulse(time: Array, start: float, impulse: float, duration: float) -> Array:
    """Make a half-sine of force that keeps its impulse and its middle on any clock.

    A frame gets the mean of the pulse under its hat function, the straight lines up from the frame
    before and down to the frame after. The hats add up to 1 and reproduce t, so that sums by the
    trapezoidal rule of F and t F are the integrals exactly, whatever the frame rate; a pulse
    between two frames becomes the two forces that balance at its middle. What lies beyond the
    clock's ends is lost.

    Parameters
    ----------
    time : (frames,) ascending [s]
    start, duration : of the pulse [s]
    impulse : [N s]

    Returns
    -------
    (frames,) [N]

    Raises
    ------
    BadData : a duration that is not above 0, or fewer than two frames
    """
    if not duration > 0.0:
        raise BadData(f"a pulse of {duration:g} s: expected above 0")
    if len(time) < 2:
        raise BadData("a pulse needs two frames or more")
    steps = np.diff(time)
    # Inside a step the integral of f times a rising line is [t F1 - F2] over its slope.
    first, second = _integrals(time - start, impulse, duration)
    mass = np.diff(first)
    rising = np.where(mass > 0.0, (steps * first[1:] - np.diff(second)) / steps, 0.0)
    weights = 0.5 * (np.append(steps, 0.0) + np.append(0.0, steps))
    return (np.append(0.0, rising) + np.append(mass - rising, 0.0)) / weights


def _integrals(since: Array, impulse: float, duration: float) -> tuple[Array, Array]:
    """First and second integral of a half-sine that begins at 0.

    Parameters
    ----------
    since : (frames,) times [s]
    impulse, duration : [N s], [s]

    Returns
    -------
    (frames,) [N s] and (frames,) [N s^2]
    """
    s = np.clip(since, 0.0, duration)
    angle = np.pi * s / duration
    first = 0.5 * impulse * (1.0 - np.cos(angle))
    second = 0.5 * impulse * (s - duration / np.pi * np.sin(angle)) + impulse * np.maximum(
        since - duration, 0.0
    )
    return first, second
