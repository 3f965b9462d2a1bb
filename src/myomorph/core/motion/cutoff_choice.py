"""The default cutoff of the low-pass filter: of least expected error, with the recording's noise.

Motion and noise of a recording are distinguished by its spectra (`core/fit/noise_fit.py`). One
cutoff for all coordinates: what a filter takes cancels in the torques only if all lose the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np
import scipy

from myomorph.core.fit.noise import RecordingNoise
from myomorph.core.fit.signal_and_noise import MIN_FRAMES, SignalAndNoise
from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.movement import Movement
from myomorph.core.model.series import Motion
from myomorph.core.motion.noise_evidence import NO_EVIDENCE, NoiseEvidence, told_apart
from myomorph.core.motion.splines import natural_spline
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.rigid.dynamics import inverse_dynamics

USUAL = 6.0  # Cutoff of recordings too short to say how fast they are [Hz]
MOVEMENT_CUTOFFS: Mapping[Movement, float] = FrozenMap(
    {
        "standing": 6.0,
        "walking": 6.0,
        "squatting": 6.0,
        "rising": 6.0,
        "stairs": 6.0,
        "upper limb": 6.0,
        "running": 12.0,
        "jumping": 12.0,
    }
)
"""Cutoffs of adults' movements where the noise of a recording is not known [Hz].

Walking: Winter, Sidwall and Hobson 1974. Running and jumping: between 10 and 15 Hz for motion and
forces alike, Kristianslund, Krosshaug and van den Bogert 2012.
"""

ALIKE = 2.0  # Factor by which the speed of a recording may differ from that of its movement
SPEED_SHARE = 0.85  # Share of the power of velocities that lies below the frequency of a movement
SLOWEST = 2.0  # Usual cutoff of the slowest movement [Hz]
NEAR = 5.0  # Times slow frequencies, up to which power counts as motion where noise is not known
PER_SPEED = 2.5  # A cutoff over that frequency, where nothing else is known
MAX_PER_SPEED = 3.0
"""Highest cutoff over that frequency: beyond it skin moves on its own.

The wobble of skin has no plateau by which a spectrum could tell it from motion.
"""

MAX_SURE = 7.5  # The same where markers or forces show the wobble of skin
MIN_PERIODS = 3.0  # Of the usual cutoff in a recording that says how fast it is
TRUST = 1.5  # Weight of that cutoff in log(error), over its periods in the recording
LASTING_TRUST = 0.03  # However long the recording
DOUBT = 1.0  # Where the noise is not known
NOISELESS = 0.002
"""Accelerations of noise over those of the motion, below which a motion was computed."""

SMOOTH = 0.2
"""Accelerations above the cutoff over those below it, up to which a motion whose noise is not known
is taken as filtered before.
"""

MAX_BRIDGED = 0.1  # Longest gap within what spectra are made of [s]
UNEVEN = 0.1  # Of a step, up to which times are taken as rounded ones of an even clock
HEAVY = 1e-3  # Torques that accelerations change less, over the largest, do not count
TRIED = 240  # Cutoffs that are compared
LEAST = 1e-300
ENOUGH = 0.01
"""Squared error of accelerations over their square, below which a coordinate gains little; for
motions without a model, whose torques are not known.
"""

Origin = Literal["noise", "markers", "forces", "movement", "speed", "usual", "smooth"]


@read_only
@dataclass(frozen=True, kw_only=True, eq=False)
class CutoffChoice:
    """The low-pass filter that a recording is given by default.

    Attributes
    ----------
    cutoff : [Hz], None where the motion is smooth already
    origin : by what it was chosen: the recording's noise as its spectra show it, or else as
        residuals of markers or measured forces do; where that is not known its movement, else its
        speed, else what is usual, as it is too short; or that it is smooth
    spectra : of motion and noise of each coordinate, None where there are none
    """

    cutoff: float | None
    origin: Origin
    spectra: SignalAndNoise | None

    @property
    def sentence(self) -> str:
        """Why this cutoff, in words."""
        return {
            "noise": "by the noise of the recording",
            "markers": "by the noise that residuals of markers show",
            "forces": "by the noise that measured forces show",
            "movement": "usual for this movement, as the noise is not known",
            "speed": "by the speed of the movement, as the noise is not known",
            "usual": "usual for people, as the recording is short",
            "smooth": "smooth motion",
        }[self.origin]


FEWEST_A_SECOND = 5.0
"""Rate below which frames are poses for themselves, which no filter is for [Hz]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Asked:
    """What a choice was made of."""

    model: Model | None
    movement: Movement | None
    evidence: NoiseEvidence
    choice: CutoffChoice


_KNOWN: WeakKeyDictionary[Motion, _Asked] = WeakKeyDictionary()
"""Of motions that still exist: coordinates, external forces and what is printed ask for the same
one.
"""


def choose_cutoff(
    motion: Motion,
    model: Model | None = None,
    movement: Movement | None = None,
    evidence: NoiseEvidence = NO_EVIDENCE,
) -> CutoffChoice:
    """Choose the cutoff that a motion needs before it is differentiated.

    The cutoff fc is where

        log E(fc) + w (log(fc / fr))^2

    is least, with the expected squared error E of joint torques M q'' by the spectra of motion and
    noise, see `SignalAndNoise.expected_error`, and the usual cutoff fr. That is 2.5 times the
    frequency below which 85 % of the power of velocities lies; where the noise is not known, and
    the movement is, that of the movement. The weight w falls with the length of the recording, and
    grows where the noise is not known. The cutoff is at most three times that frequency, and 7.5
    times where residuals of markers or measured forces show how far skin wobbles.

    Parameters
    ----------
    motion : coordinates over time (frames, coordinates) [rad or m], NaN in gaps
    model : whose torques count; without one, accelerations of all coordinates do
    movement : that was recorded, None where it is not known
    evidence : markers and forces that were measured; a model has to be given with them

    Returns
    -------
    the cutoff and what it was chosen by

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> from myomorph.core.motion.cutoff_choice import choose_cutoff
    >>> time = np.arange(0.0, 4.0, 0.01)
    >>> noise = np.random.default_rng(0).normal(scale=0.01, size=(400, 2))
    >>> angles = np.column_stack([np.sin(3.0 * time), np.cos(6.0 * time)]) + noise
    >>> choice = choose_cutoff(mm.Motion(time, ("hip", "knee"), angles))
    >>> choice.origin, 1.0 < choice.cutoff < 4.0
    ('noise', True)
    """
    known = _KNOWN.get(motion)
    asked_before = (
        known is not None
        and known.model is model
        and known.movement == movement
        and known.evidence.same(evidence)
    )
    if known is None or not asked_before:
        choice = _choice(motion, model, movement, evidence)
        known = _Asked(model=model, movement=movement, evidence=evidence, choice=choice)
        _KNOWN[motion] = known
    return known.choice


def recording_noise(motion: Motion, choice: CutoffChoice) -> RecordingNoise:
    """Describe the noise of the coordinates of a recording, as far as its spectra show it.

    Parameters
    ----------
    motion : as recorded
    choice : made of it

    Returns
    -------
    noise as it is in the recording, NaN for coordinates in which none was seen
    """
    count = len(motion.names)
    gaps = np.asarray(1.0 - np.isfinite(motion.values).mean(axis=0))
    unknown = np.full(count, np.nan)
    spectra = choice.spectra
    if spectra is None or spectra.doubtful:
        sd = unknown
        alike = unknown
    else:
        sd = np.where(spectra.known, spectra.sd, np.nan)
        alike = np.where(spectra.known, spectra.correlation_time, np.nan)
    return RecordingNoise(
        names=motion.names,
        unit="rad or m",
        sd=sd,
        correlation_time=alike,
        floor=unknown,
        gaps=gaps,
    )


def _choice(
    motion: Motion, model: Model | None, movement: Movement | None, evidence: NoiseEvidence
) -> CutoffChoice:
    """Choose a cutoff; see `choose_cutoff`."""
    part = recorded_part(motion)
    if len(part) < MIN_FRAMES:
        cutoff = MOVEMENT_CUTOFFS.get(movement, USUAL) if movement else USUAL
        return CutoffChoice(cutoff=cutoff, origin="usual", spectra=None)
    if part.rate < FEWEST_A_SECOND:
        return CutoffChoice(cutoff=None, origin="smooth", spectra=None)
    rows = None if model is None else inertia_rows(model, motion)
    found = told_apart(part, model, rows, evidence)
    whole = found.spectra
    count = len(motion.names)
    if whole is None or not whole.moves[:count].any():
        return CutoffChoice(cutoff=None, origin="smooth", spectra=None)
    own = whole.columns(slice(count))
    if not own.doubtful and _noise_share(own) < NOISELESS:
        return CutoffChoice(cutoff=None, origin="smooth", spectra=own)

    duration = len(part) / part.rate
    usual = _usual(own, duration, movement)
    tried = np.geomspace(own.frequency[0], 0.45 * part.rate, TRIED)
    of_torques = rows is not None and whole.moves[count:].any()
    costs = _torque_cost(whole, count, tried) if of_torques else _acceleration_cost(own, tried)
    trust = TRUST / (usual.cutoff * duration) + LASTING_TRUST + DOUBT * own.doubtful
    costs = costs + trust * np.square(np.log(tried / usual.cutoff))
    highest = MAX_SURE / PER_SPEED * usual.cutoff if found.sure else usual.highest
    cutoff = float(min(tried[costs.argmin()], highest))
    if own.doubtful and _fast_share(own, cutoff) < SMOOTH:
        return CutoffChoice(cutoff=None, origin="smooth", spectra=own)
    origin: Origin = usual.origin if own.doubtful else found.shown_by
    return CutoffChoice(cutoff=cutoff, origin=origin, spectra=own)


def recorded_part(motion: Motion) -> Motion:
    """Take the longest part without long gaps, short ones filled, at an even clock.

    Gaps are filled by Akima's cubics, and for spectra alone. Fast steps of time that are rounded
    stay as they are; uneven ones are brought to even times by a spline.

    Source: Akima 1970.

    Parameters
    ----------
    motion : (frames, coordinates), NaN in gaps

    Returns
    -------
    coordinates without NaN; no frames where none is seen
    """
    seen = np.all(np.isfinite(motion.values), axis=1)
    if not seen.any():
        return motion.frames(slice(0, 0))
    longest = max(1, int(MAX_BRIDGED * motion.rate)) if len(motion) > 1 else 1
    used = seen.copy()
    for start, stop in runs(~seen):
        used[start:stop] = stop - start <= longest and start > 0 and stop < len(seen)
    start, stop = max(runs(used), key=lambda run: run[1] - run[0])
    time = motion.time[start:stop]
    values = motion.values[start:stop]
    inside = seen[start:stop]
    if not inside.all() and inside.sum() > 1:
        values = scipy.interpolate.Akima1DInterpolator(time[inside], values[inside])(time)
    if not is_even(time):
        even = np.linspace(time[0], time[-1], len(time))
        values = natural_spline(time, values)(even)
        time = even
    return Motion(time, motion.names, values)


def is_even(time: Array) -> bool:
    """Whether times are those of an even clock, but for rounding.

    Parameters
    ----------
    time : (frames,) [s]

    Returns
    -------
    whether each is within a tenth of a step of it
    """
    even = np.linspace(time[0], time[-1], len(time))
    step = (time[-1] - time[0]) / max(len(time) - 1, 1)
    return bool(np.abs(time - even).max() <= UNEVEN * step)


def inertia_rows(model: Model, motion: Motion) -> Array | None:
    """Rows of the mass matrix at the median pose, for the torques at joints.

    Parameters
    ----------
    model : with masses
    motion : (frames, coordinates) in gaps NaN

    Returns
    -------
    (torques, coordinates of the motion) [kg m^2, kg m], torques of rotations that do not float;
    None where the model has no masses
    """
    count = len(motion.names)
    names = set(model.coordinate_names)
    if not set(motion.names) <= names or not model.mass > 0.0:
        return None
    pose = np.nanmedian(motion.values, axis=0)
    accelerations = np.zeros((count + 1, count))
    accelerations[1:] = np.eye(count)
    still = Motion(
        time=np.arange(count + 1.0),
        names=motion.names,
        values=np.tile(pose, (count + 1, 1)),
        velocities=np.zeros((count + 1, count)),
        accelerations=accelerations,
    )
    needed = inverse_dynamics(model, still).values
    floating = floating_coordinates(model)
    turning = [
        coordinate.motion == "rotational" and coordinate.name not in floating
        for coordinate in model.coordinates
    ]
    rows = (needed[1:] - needed[0]).T[turning]
    sizes = np.abs(rows).max(axis=1, initial=0.0)
    return np.asarray(rows[sizes > HEAVY * sizes.max(initial=0.0)])


@dataclass(frozen=True, kw_only=True)
class _Usual:
    """The cutoff that a recording is given where its noise says nothing.

    Attributes
    ----------
    cutoff : [Hz]
    origin : what it comes from
    """

    cutoff: float
    origin: Literal["movement", "speed", "usual"]

    @property
    def highest(self) -> float:
        """Bound of the cutoff by the noise [Hz]."""
        return MAX_PER_SPEED / PER_SPEED * self.cutoff


def _usual(own: SignalAndNoise, duration: float, movement: Movement | None) -> _Usual:
    """Find the usual cutoff by speed and, where the noise is not known, by movement.

    Parameters
    ----------
    own : spectra of the coordinates
    duration : of the recording [s]
    movement : None where it is not known
    """
    of_movement = MOVEMENT_CUTOFFS.get(movement) if movement else None
    if duration * USUAL < MIN_PERIODS:
        return _Usual(cutoff=of_movement or USUAL, origin="usual")
    cutoff = max(PER_SPEED * _speed(own), SLOWEST)
    # Animals and children are faster than adults: their speed says more.
    if own.doubtful and of_movement and abs(np.log(cutoff / of_movement)) < np.log(ALIKE):
        return _Usual(cutoff=of_movement, origin="movement")
    return _Usual(cutoff=cutoff, origin="speed")


def _speed(own: SignalAndNoise) -> float:
    """Find the frequency below which most of the velocities' power lies, of the median coordinate.

    Where the noise is not known, it is part of the power. Fast noise would then pass for speed, so
    that only what is near slow frequencies counts: those that hold most of the power when it is
    weighed by f in the place of f^2.

    Parameters
    ----------
    own : spectra of the coordinates

    Returns
    -------
    [Hz]
    """
    if not own.doubtful:
        return _share_below(own.frequency, own.motion[:, own.moves] * _velocity(own, 2))
    power = own.recorded[:, own.moves]
    slow = _share_below(own.frequency, power * _velocity(own, 1))
    near = (own.frequency <= NEAR * slow)[:, None]
    return _share_below(own.frequency, power * near * _velocity(own, 2))


def _velocity(own: SignalAndNoise, power: int) -> Array:
    """Weights (bins, 1) of a power of frequency, times the width of bins."""
    return np.asarray((own.frequency**power * own.width)[:, None])


def _share_below(frequency: Array, power: Array) -> float:
    """Frequency below which `SPEED_SHARE` of the power (bins, columns) lies, of the median column.

    Parameters
    ----------
    frequency : (bins,) [Hz]
    power : (bins, columns) in each bin

    Returns
    -------
    [Hz]
    """
    passed = np.cumsum(power, axis=0)
    shares = (passed / passed[-1]).T
    return float(np.median([np.interp(SPEED_SHARE, share, frequency) for share in shares]))


def _torque_cost(whole: SignalAndNoise, coordinates: int, tried: Array) -> Array:
    """Logarithm of the expected error of all torques together, by cutoff.

    Parameters
    ----------
    whole : spectra of coordinates and, after them, of torques
    coordinates : number of the former
    tried : (cutoffs,) [Hz]

    Returns
    -------
    (cutoffs,)
    """
    error = whole.columns(slice(coordinates, None)).expected_error(tried, 2).sum(axis=1)
    return np.asarray(np.log(error + LEAST))


def _acceleration_cost(own: SignalAndNoise, tried: Array) -> Array:
    """Mean logarithm (cutoffs,) of the expected relative error of accelerations.

    Parameters
    ----------
    own : spectra of the coordinates
    tried : (cutoffs,) [Hz]
    """
    error = own.expected_error(tried, 2)[:, own.moves]
    size = _acceleration(own) @ own.motion[:, own.moves]
    return np.asarray(np.log(error / size + ENOUGH).mean(axis=1))


def _acceleration(own: SignalAndNoise) -> Array:
    """Weights (bins,) by which power adds up to the mean square of accelerations."""
    return np.asarray((2.0 * np.pi * own.frequency) ** 4 * own.width)


def _noise_share(own: SignalAndNoise) -> float:
    """Accelerations of the noise over those of the motion, of the median coordinate."""
    weight = _acceleration(own)
    noise = weight @ own.noise[:, own.moves]
    return float(np.median(np.sqrt(noise / (weight @ own.motion[:, own.moves]))))


def _fast_share(own: SignalAndNoise, cutoff: float) -> float:
    """Accelerations above a cutoff over those below it, of the median coordinate."""
    gain = (1.0 / (1.0 + (own.frequency / cutoff) ** 6))[:, None]
    power = own.recorded[:, own.moves] * _acceleration(own)[:, None]
    above = (power * (1.0 - gain) ** 2).sum(axis=0)
    return float(np.median(np.sqrt(above / (power * gain**2).sum(axis=0))))
