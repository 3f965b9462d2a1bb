"""Impacts heard in synthetic recordings whose impacts are known.

Compared are when, on which drum, and with which impulse.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import myomorph as mm
from myomorph.core.contact.impacts import calibrate_impulse, effective_mass, velocity_change
from myomorph.core.contact.sound import HeardImpact, HeardImpacts, hear_impacts
from myomorph.core.model.contacts import Site
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.filters import lowpass
from myomorph.show.simulate.drums import Scene, Truth, instruments, record

NEAR = 0.02
"""A stroke is heard where one is found on its drum within this time [s]."""

LENGTH = 0.4
"""Of a drum stick [m]."""

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


def matched(
    truth: tuple[Truth, ...], heard: HeardImpacts
) -> tuple[list[tuple[Truth, HeardImpact]], int]:
    """Match true impacts to those that were heard, each used once.

    Their pairs are returned with the number of others that were heard.
    """
    left = list(heard.impacts)
    pairs = []
    for one in truth:
        near = [s for s in left if s.instrument == one.drum and abs(s.time - one.time) <= NEAR]
        if near:
            best = min(near, key=lambda s: abs(s.time - one.time))
            left.remove(best)
            pairs.append((one, best))
    return pairs, len(left)


def impulse_errors(pairs: list[tuple[Truth, HeardImpact]]) -> np.ndarray:
    """Return the relative errors of the impulses that did not calibrate.

    Parameters
    ----------
    pairs : true impacts with those that were heard

    Returns
    -------
    (impacts,) errors over the true impulses
    """
    errors = []
    for drum in dict.fromkeys(one.drum for one, _ in pairs):
        mine = [(s.energy, one.impulse) for one, s in pairs if one.drum == drum]
        law = calibrate_impulse(*np.array(mine[::EVERY]).T)
        errors += [
            float(law.impulse(energy)) / p - 1.0 for k, (energy, p) in enumerate(mine) if k % EVERY
        ]
    return np.array(errors)


def measure_scene(scene: Scene, seed: int = 7) -> dict[str, object]:
    """One recording."""
    sound, truth = record(scene, seed)
    pairs, false = matched(truth, hear_impacts(sound, instruments(scene)))
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


def measure_motion() -> Iterator[dict[str, object]]:
    """Compare the change of a tip's velocity in motion capture with the true one.

    The ratio is measured at several frame rates and filters.
    """
    stick, tip = _stick()
    mass = effective_mass(
        stick,
        mm.Motion(np.zeros(1), ("turn",), np.zeros((1, 1))),
        "stick",
        tip.points[0],
        [1.0, 0.0, 0.0],
    )
    for rate in (100.0, 200.0, 500.0, 1000.0):
        for cutoff in (None, 20.0, 6.0):
            rng = np.random.default_rng(7)
            ratios = [_seen(stick, tip, rate, cutoff, rng) for _ in range(100)]
            yield {
                "frames per second": rate,
                "low-pass [Hz]": "none" if cutoff is None else cutoff,
                "velocity change over the true one, mean": float(np.mean(ratios)),
                "SD": float(np.std(ratios)),
                "effective mass [g]": float(1e3 * mass[0]),
            }


def _seen(
    stick: mm.Model, tip: Site, rate: float, cutoff: float | None, rng: np.random.Generator
) -> float:
    """Return the ratio of velocity changes of one impact.

    The tip comes at 5 m/s, leaves at 3.5 m/s, is turned round in 5 ms and heard up to 2 ms late.
    Angles are 0.1 degrees rough.
    """
    fine = np.arange(-0.5, 0.5, 1e-5)
    begin = 0.01 * rng.uniform()
    touch = 0.005
    inside = np.clip((fine - begin) / touch, 0.0, 1.0)
    speed = (-5.0 + 8.5 * 0.5 * (1.0 - np.cos(np.pi * inside))) / LENGTH
    # Before and after, muscles swing the stick within 0.2 s either way.
    speed *= np.cos(np.clip((fine - begin) / 0.2, -1.0, 1.0) * 0.5 * np.pi)
    angle = np.cumsum(speed) * 1e-5
    time = np.arange(-0.4, 0.4, 1.0 / rate)
    values = np.interp(time, fine, angle)[:, None] + np.radians(0.1) * rng.standard_normal(
        (len(time), 1)
    )
    if cutoff is not None and cutoff < 0.5 * rate:
        values = lowpass(values, rate, cutoff)
    heard = begin + 0.002 * rng.uniform()
    change = velocity_change(stick, mm.Motion(time, ("turn",), values), tip, heard)
    return float(np.linalg.norm(change)) / 8.5


def _stick() -> tuple[mm.Model, Site]:
    """Return a drum stick of 60 g and 0.4 m that turns about its end, and its tip."""
    across = 0.06 * LENGTH**2 / 12.0
    body = Body(
        name="stick",
        mass=0.06,
        mass_center=np.array([0.0, -0.5 * LENGTH, 0.0]),
        inertia=np.diag([across, 1e-9, across]),
    )
    axis = Axis(
        kind="rotation",
        vector=np.array([0.0, 0.0, 1.0]),
        function=linear(1.0),
        coordinates=("turn",),
    )
    at = Transform.identity()
    joint = Joint(
        name="hand",
        kind="PinJoint",
        parent=GROUND,
        child="stick",
        parent_frame=at,
        child_frame=at,
        axes=(axis,),
        coordinates=("turn",),
    )
    model = mm.Model("stick", (body,), (joint,), (Coordinate("turn"),), np.array([0.0, -9.81, 0.0]))
    return model, Site("tip", "stick", np.array([[0.0, -LENGTH, 0.0]]))
