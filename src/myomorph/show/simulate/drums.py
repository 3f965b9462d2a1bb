"""A simulated drummer in a room: impacts of known time and impulse, and their sound.

An impact is a half-sine of force on a membrane of a few modes, with the noise of the stick's
contact; harder impacts are shorter (Hertz: duration in proportion to impulse^-1/5) and so brighter.
Each drum reaches each microphone by its direct way, by the mirror images of a box-shaped room to
the second order, and by a diffuse tail that decays with the room's reverberation time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve

from myomorph.core.contact.sound import Instrument
from myomorph.core.model.arrays import Array
from myomorph.core.model.series import Sound

SPEED = 343.0
RATE = 48_000.0
ROOM = np.array([7.0, 5.5, 3.0])
DRUMS = {
    "snare": (np.array([3.0, 2.5, 0.70]), 190.0, 0.06, 3.0),
    "high tom": (np.array([3.3, 3.0, 0.85]), 140.0, 0.12, 1.0),
    "bass": (np.array([2.7, 3.2, 0.40]), 62.0, 0.08, 1.0),
}
"""Place [m], lowest mode [Hz], its decay [s] and how much of the sound is the contact's noise."""

NEAR = np.array([0.05, -0.04, 0.06])
"""From each drum to its own microphone [m], times `Scene.far`."""

MODES = np.array([1.0, 1.59, 2.14, 2.30, 2.65, 2.92])
"""Frequencies of a circular membrane over its lowest."""


@dataclass(frozen=True)
class Scene:
    """What is varied.

    Attributes
    ----------
    reverberation : time in which the room's tail falls by 60 dB [s], 0 for none
    snr : energy of a median stroke in 20 ms over that of the noise, in its own microphone [dB]
    interval : mean time between two strokes on one drum [s]
    softest, loudest : impulses [N s], evenly spread in logarithm
    scatter : standard deviation of each mode's amplitude from stroke to stroke, as a share: where
        the head is hit
    drums : how many
    tied : share of the strokes that fall with one on another drum, 0 to 30 ms apart
    far : distance of the microphones from their drums over that of close ones, 9 cm
    """

    name: str
    reverberation: float = 0.3
    snr: float = 20.0
    interval: float = 0.5
    softest: float = 0.2
    loudest: float = 1.0
    scatter: float = 0.05
    drums: int = 3
    tied: float = 0.0
    far: float = 1.0
    duration: float = 30.0


@dataclass(frozen=True)
class Truth:
    """Drum, time [s] and impulse [N s] of a stroke."""

    drum: str
    time: float
    impulse: float


def instruments(scene: Scene) -> tuple[Instrument, ...]:
    """Return the drums with their microphones, distances to their own known."""
    far = float(np.linalg.norm(NEAR) * scene.far)
    return tuple(
        Instrument(name, str(k + 1), far) for k, name in enumerate(list(DRUMS)[: scene.drums])
    )


def record(scene: Scene, seed: int = 0) -> tuple[Sound, tuple[Truth, ...]]:
    """Record the microphones' channels and the impacts that made them."""
    rng = np.random.default_rng(seed)
    strokes = _strokes(scene, rng)
    return heard_of(strokes, scene, rng), strokes


def heard_of(strokes: Sequence[Truth], scene: Scene, rng: np.random.Generator) -> Sound:
    """Simulate what microphones hear of impacts, in the order of time."""
    length = int(scene.duration * RATE)
    heard = np.zeros((length, scene.drums))
    names = list(DRUMS)[: scene.drums]
    for name in names:
        source = np.zeros(length)
        for stroke in strokes:
            if stroke.drum == name:
                _add(source, stroke, scene, rng)
        for m, other in enumerate(names):
            reply = _reply(
                DRUMS[name][0], DRUMS[other][0] + scene.far * NEAR, scene.reverberation, rng
            )
            heard[:, m] += fftconvolve(source, reply)[:length]
    window = int(0.02 * RATE)
    for m, name in enumerate(names):
        begins = [int(one.time * RATE) for one in strokes if one.drum == name]
        loudness = np.median([np.mean(heard[k : k + window, m] ** 2) for k in begins])
        heard[:, m] += np.sqrt(loudness * 10.0 ** (-scene.snr / 10.0)) * rng.standard_normal(length)
    scale = 0.7 / np.abs(heard).max()
    return Sound(RATE, tuple(str(k + 1) for k in range(scene.drums)), heard * scale)


def _strokes(scene: Scene, rng: np.random.Generator) -> tuple[Truth, ...]:
    """Draw the impacts of all drums, some of two drums at nearly one time."""
    drawn = _even_strokes(scene, rng)
    apart = 0.06
    kept: list[Truth] = []
    for stroke in sorted(drawn, key=lambda stroke: stroke.time):
        near = any(stroke.time - other.time < apart and other.drum != stroke.drum for other in kept)
        if near and rng.uniform() >= scene.tied:
            continue
        kept.append(stroke)
    tied = _tied_strokes(kept, scene, rng)
    return tuple(sorted([*kept, *tied], key=lambda stroke: stroke.time))


def _even_strokes(scene: Scene, rng: np.random.Generator) -> list[Truth]:
    """Draw the impacts of each drum; between two lie 0.7 to 1.3 of the interval."""
    strokes = []
    for k, name in enumerate(list(DRUMS)[: scene.drums]):
        time = 0.5 + 0.37 * k * scene.interval
        while time < scene.duration - 1.0:
            strokes.append(Truth(name, time, _impulse(scene, rng)))
            time += scene.interval * rng.uniform(0.7, 1.3)
    return strokes


def _tied_strokes(strokes: Sequence[Truth], scene: Scene, rng: np.random.Generator) -> list[Truth]:
    """Draw impacts of another drum at nearly the times of some, as far as it is free."""
    tied = []
    for stroke in strokes:
        if not (rng.uniform() < scene.tied and scene.drums > 1):
            continue
        others = [name for name in list(DRUMS)[: scene.drums] if name != stroke.drum]
        drum = str(rng.choice(others))
        time = stroke.time + rng.uniform(0.0, 0.03)
        if all(abs(time - other.time) > 0.1 for other in strokes if other.drum == drum):
            tied.append(Truth(drum, time, _impulse(scene, rng)))
    return tied


def _impulse(scene: Scene, rng: np.random.Generator) -> float:
    """Draw an impulse between the softest and the loudest, even in its logarithm [N s]."""
    return float(np.exp(rng.uniform(np.log(scene.softest), np.log(scene.loudest))))


def _add(source: Array, stroke: Truth, scene: Scene, rng: np.random.Generator) -> None:
    """Add the sound of one impact at 1 m to the drum's."""
    _, lowest, decay, noise = DRUMS[stroke.drum]
    contact = 0.005 * (stroke.impulse / 0.3) ** -0.2
    late = stroke.time * RATE
    first = int(np.ceil(late))
    t = (np.arange(int(4.0 * decay * RATE)) + first - late) / RATE
    force = np.where(
        t < contact, np.pi * stroke.impulse / (2.0 * contact) * np.sin(np.pi * t / contact), 0.0
    )
    amplitudes = (1.0 + scene.scatter * rng.standard_normal(len(MODES))) / np.arange(
        1, len(MODES) + 1
    )
    ringing = sum(
        a * np.sin(2.0 * np.pi * lowest * m * t) * np.exp(-t * m / decay)
        for a, m in zip(amplitudes, MODES, strict=True)
    )
    rattle = noise * (1.0 + scene.scatter * rng.standard_normal()) * rng.standard_normal(len(t))
    rattle *= np.exp(-t / 0.015) * (1.0 - np.exp(-t / 0.0003))
    heard = fftconvolve(force, ringing)[: len(t)] / RATE + 0.15 * stroke.impulse * rattle
    last = min(first + len(t), len(source))
    source[first:last] += heard[: last - first]


def _reply(
    source: Array, microphone: Array, reverberation: float, rng: np.random.Generator
) -> Array:
    """Impulse response of the room from a place to another."""
    length = int((0.1 + 1.2 * reverberation) * RATE)
    reply = np.zeros(length)
    if reverberation == 0.0:
        _arrive(reply, float(np.linalg.norm(microphone - source)), 1.0)
        return reply
    volume = float(np.prod(ROOM))
    surface = 2.0 * float(ROOM[0] * ROOM[1] + ROOM[0] * ROOM[2] + ROOM[1] * ROOM[2])
    # Sabine: reverberation = 0.161 V / (S absorption).
    mirror = np.sqrt(max(1.0 - 0.161 * volume / (surface * reverberation), 0.04))
    for image in np.ndindex(5, 5, 5):
        order = np.array(image) - 2
        bounces = int(np.abs(order).sum())
        if bounces <= 2:
            place = np.where(order % 2 == 0, order * ROOM + source, (order + 1) * ROOM - source)
            _arrive(reply, float(np.linalg.norm(microphone - place)), mirror**bounces)
    begin = int(0.02 * RATE)
    t = np.arange(length - begin) / RATE
    # Diffuse energy density over that of the direct sound at 1 m: 16 pi / A, spread over the decay.
    absorbed = 0.161 * volume / reverberation
    tail = rng.standard_normal(len(t)) * np.exp(-6.91 * t / reverberation)
    reply[begin:] += tail * np.sqrt(16.0 * np.pi / absorbed / max(float(np.sum(tail**2)), 1e-300))
    return reply


def _arrive(reply: Array, distance: float, strength: float) -> None:
    """One arrival, between two samples where it falls so."""
    place = distance / SPEED * RATE
    k = int(place)
    if k + 1 < len(reply):
        reply[k] += strength / distance * (1.0 - (place - k))
        reply[k + 1] += strength / distance * (place - k)
