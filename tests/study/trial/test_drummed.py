"""Impacts from a recording of their sound to forces on the body that strikes.

Sounds are made, impulses are known.
"""

from __future__ import annotations

import csv

import numpy as np
from scipy.io.wavfile import write as write_wav

from myomorph.core.io.contact_events import read_events
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.sto import read_sto

RATE = 48000
STROKES = ((0.15, 0.4), (0.45, 0.8))
KNOWN = [list(stroke) for stroke in STROKES]
CONTACTS = f"""
feet = false
measured = "hidden"
[sound]
file = "drum.wav"
[[instrument]]
name = "snare"
distance = 0.686
sites = ["hand"]
direction = [0.0, 1.0, 0.0]
known = {KNOWN}
[[site]]
name = "hand"
body = "fore"
points = [[0.0, -0.28, 0.0]]
intervals = "file"
"""


def drum(path):
    """Write the sound of a drum heard 2 ms late, with some noise.

    Its pressure is in proportion to the impulse.
    """
    random = np.random.default_rng(8)
    sound = 1e-4 * random.normal(size=int(0.6 * RATE))
    for time, impulse in STROKES:
        first = round((time + 0.686 / 343.0) * RATE)
        since = np.arange(len(sound) - first) / RATE
        sound[first:] += 0.5 * impulse * np.exp(-since / 0.02) * np.sin(2 * np.pi * 220.0 * since)
    write_wav(path, RATE, (32767 * sound).astype(np.int16)[:, None])


def test_impulses_reach_the_hand(arm, command):
    drum(arm.folder / "drum.wav")
    (arm.folder / "contacts.toml").write_text(CONTACTS)
    done = command(
        "tension",
        "--model",
        arm.model,
        "--motion",
        arm.motion,
        "--contacts",
        arm.folder / "contacts.toml",
        "--out",
        arm.out,
    )
    assert done.status == 0, done.err
    touches = read_events(arm.out / "contacts.csv").intervals
    assert [one.surface for one in touches] == ["snare", "snare"]
    np.testing.assert_allclose(
        [one.start for one in touches], [time for time, _ in STROKES], atol=0.003
    )
    loads = read_external_loads(arm.out / "contact_forces.xml")
    (hand,) = [k for k, body in enumerate(loads.bodies) if body == "fore"]
    for time, impulse in STROKES:
        near = np.abs(loads.time - time) < 0.05
        np.testing.assert_allclose(
            np.trapezoid(loads.forces[near, hand, 1], loads.time[near]), impulse, rtol=0.1
        )
    assert not loads.forces[:, hand, [0, 2]].any()
    with (arm.out / "impacts.csv").open(newline="") as file:
        impacts = list(csv.DictReader(file))
    assert [(one["site"], one["instrument"]) for one in impacts] == [("hand", "snare")] * 2
    for one, (_, impulse) in zip(impacts, STROKES, strict=True):
        assert float(one["impulse_low"]) < impulse < float(one["impulse_high"])
        assert float(one["site_confidence"]) == 1.0
    # The hand's force is that of its impacts, in tables as in the loads.
    groups = read_sto(arm.out / "contact_groups.sto")
    np.testing.assert_allclose(groups["hand_fy"], loads.forces[:, hand, 1], atol=1e-6)
