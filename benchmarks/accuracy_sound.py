"""Strokes heard in made-up recordings whose strokes are known: when, on which drum, and with which impulse."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.simulated_drums import Scene, Truth, instruments, record
from myomorph.contact.sound import Stroke, Strokes, hear_strokes
from myomorph.contact.strokes import calibrate_impulse

NEAR = 0.02
"""A stroke is heard where one is found on its drum within this time [s]."""

EVERY = 4
"""Every so many strokes of a drum are known and calibrate it; the rest are tested."""

SCENES = (
    Scene("one drum, no room, 20 dB", 0.0, drums=1),
    Scene("three drums, no room, 20 dB", 0.0),
    Scene("room 0.3 s, 20 dB"),
    Scene("room 0.3 s, 10 dB", snr=10.0),
    Scene("room 0.3 s, 0 dB", snr=0.0),
    Scene("room 0.6 s, 15 dB", 0.6, 15.0),
    Scene("hall 1.2 s, 10 dB", 1.2, 10.0),
    Scene("microphones 26 cm away", far=3.0),
    Scene("microphones 53 cm away", far=6.0),
    Scene("roll, 12 strokes a second", interval=0.083, drums=1),
    Scene("roll, 20 strokes a second", interval=0.05, drums=1),
    Scene("half with another drum, 0 to 30 ms apart", tied=0.5),
    Scene("impulses 1 : 50", softest=0.03, loudest=1.5),
    Scene("place of the stroke: modes vary by 15 %", scatter=0.15),
)


def matched(truth: tuple[Truth, ...], heard: Strokes) -> tuple[list[tuple[Truth, Stroke]], int]:
    """True strokes with what was heard of them, each used once, and how many others were heard."""
    left = list(heard.strokes)
    pairs = []
    for one in truth:
        near = [s for s in left if s.instrument == one.drum and abs(s.time - one.time) <= NEAR]
        if near:
            best = min(near, key=lambda s: abs(s.time - one.time))
            left.remove(best)
            pairs.append((one, best))
    return pairs, len(left)


def impulse_errors(pairs: list[tuple[Truth, Stroke]]) -> np.ndarray:
    """Relative errors of the impulses that did not calibrate."""
    errors = []
    for drum in dict.fromkeys(one.drum for one, _ in pairs):
        mine = [(s.energy, one.impulse) for one, s in pairs if one.drum == drum]
        law = calibrate_impulse(*np.array(mine[::EVERY]).T)
        errors += [float(law.impulse(energy)) / p - 1.0 for k, (energy, p) in enumerate(mine) if k % EVERY]
    return np.array(errors)


def measure_scene(scene: Scene, seed: int = 7) -> dict[str, object]:
    """One recording."""
    sound, truth = record(scene, seed)
    pairs, false = matched(truth, hear_strokes(sound, instruments(scene)))
    late = 1e3 * np.array([s.time - one.time for one, s in pairs])
    errors = np.abs(impulse_errors(pairs))
    return {
        "recording": scene.name,
        "strokes": len(truth),
        "missed": len(truth) - len(pairs),
        "false": false,
        "late by, median [ms]": float(np.median(late)),
        "error, 95 % [ms]": float(np.percentile(np.abs(late), 95)),
        "within 3 ms": f"{np.mean(np.abs(late) <= 3.0):.1%}",
        "impulse error, median": f"{np.median(errors):.1%}",
        "95 %": f"{np.percentile(errors, 95):.1%}",
        "within 10 %": f"{np.mean(errors <= 0.1):.1%}",
    }


def measure() -> Iterator[dict[str, object]]:
    """All recordings."""
    for scene in SCENES:
        yield measure_scene(scene)


def run() -> list[dict[str, object]]:
    """Rows of all recordings."""
    return list(measure())
