"""The start of a sound on the motion's clock is found from when sticks turn round."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sticks import SITES, rods

from myomorph.core.contact.clocks import sound_clock
from myomorph.core.contact.sound import HeardImpact, HeardImpacts, Instrument
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.series import Motion

TIMES = np.array([0.31, 0.62, 0.90, 1.33, 1.52, 1.95, 2.40, 2.61])


@pytest.fixture(scope="module")
def drummer():
    """Two sticks that swing slowly; each turns round sharply at every other stroke."""
    model = rods("a", "b")
    time = np.arange(0.0, 3.0, 0.005)
    columns = []
    for own in (TIMES[::2], TIMES[1::2]):
        near = np.abs(time[:, None] - own).min(axis=1)
        columns.append(np.minimum(near, 0.12) * 6.0 + 0.2 * np.sin(3.0 * time))
    drums = (
        Instrument(name="left", channel="1", distance=0.0, sites=("tip_a",)),
        Instrument(name="right", channel="2", distance=0.0, sites=("tip_b",)),
    )
    struck = tuple(
        HeardImpact(instrument=drums[k % 2].name, time=float(at), energy=1e-4, confidence=1.0)
        for k, at in enumerate(TIMES)
    )
    return model, Motion(time, ("a", "b"), np.column_stack(columns)), HeardImpacts(drums, struck)


@pytest.mark.parametrize("shift", [-1.7, -0.2, 0.0, 0.913])
def test_the_shift_is_found(drummer, shift):
    model, motion, sound_heard = drummer
    heard = replace(
        sound_heard,
        impacts=tuple(replace(one, time=one.time - shift) for one in sound_heard.impacts),
    )
    found = sound_clock(heard, model, motion, SITES)
    assert found.shift == pytest.approx(shift, abs=0.006)
    assert found.ratio > 1.3
    assert found.impacts == len(TIMES)


def test_strokes_at_any_time_tell_little(drummer):
    model, motion, sound_heard = drummer
    rng = np.random.default_rng(1)
    at = np.sort(rng.uniform(0.2, 2.8, len(TIMES)))
    moved = (
        replace(one, time=float(time)) for one, time in zip(sound_heard.impacts, at, strict=True)
    )
    heard = replace(sound_heard, impacts=tuple(moved))
    assert sound_clock(heard, model, motion, SITES).ratio < 1.25


def test_what_cannot_tell_a_clock_is_named(drummer):
    model, motion, sound_heard = drummer
    with pytest.raises(BadData, match="2 impacts by sites of the model: a clock needs 3 or more"):
        sound_clock(replace(sound_heard, impacts=sound_heard.impacts[:2]), model, motion, SITES)
    with pytest.raises(UnknownName, match="'tip_b'"):
        sound_clock(sound_heard, model, motion, SITES[:1])
