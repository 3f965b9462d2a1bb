"""Impacts heard.

Made ones are recovered at their time, on their drum and as loud; silence, noise and faults are
named.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.accuracy.contact.sound import impulse_errors, matched

from myomorph.core.contact import onsets as onset_module
from myomorph.core.contact.onsets import Heard, energy_after, listen, onsets
from myomorph.core.contact.sound import (
    HeardImpact,
    HeardImpacts,
    Instrument,
    contacts_heard,
    hear_impacts,
    sound_faults,
    speed_of_sound,
)
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.series import Sound
from myomorph.show.simulate.drums import Scene, instruments, record

RATE = 48_000.0
CLICKS = np.array([0.31234, 0.77777, 1.2, 1.40001])
DRUM = Instrument("drum", "1")


def clicks(noise: float = 1e-3, sizes=(0.5, 0.2, 0.4, 0.05), seconds: float = 2.0) -> Sound:
    """Bursts of noise that begin at `CLICKS` and fade in 10 ms, and noise all along; synthetic."""
    rng = np.random.default_rng(1)
    time = np.arange(int(seconds * RATE)) / RATE
    signal = noise * rng.standard_normal(len(time))
    for at, size in zip(CLICKS, sizes, strict=True):
        since = time - at
        signal += np.where(
            since >= 0.0, size * np.exp(-since / 0.01) * rng.standard_normal(len(time)), 0.0
        )
    return Sound(RATE, ("1",), np.clip(signal[:, None], -1.0, 1.0))


@pytest.fixture(scope="module")
def drums():
    """Three drums in a room at 15 dB; synthetic."""
    scene = Scene("test", 0.4, 15.0, duration=9.0)
    sound, truth = record(scene, 3)
    return scene, sound, truth, hear_impacts(sound, instruments(scene))


def _times(sound: Sound, **changes) -> np.ndarray:
    return np.array([one.time for one in hear_impacts(sound, [replace(DRUM, **changes)]).impacts])


@pytest.mark.parametrize(("share", "time"), [(0.505, 0.5), (0.495, 0.503)])
def test_the_time_is_that_of_the_fastest_level_with_half_of_the_largest_excess(
    monkeypatch, share, time
):
    """Two levels whose clicks lie 3 ms apart; how clearly each shows its own is given."""
    rates = (RATE, RATE / 4.0)
    levels = tuple(
        np.where(np.arange(int(rate)) >= at * rate, 1.0, 0.0)
        for rate, at in zip(rates, (0.5, 0.503), strict=True)
    )
    shown = {rates[0]: share, rates[1]: 1.0}

    def excess(signal, rate, hops):
        return np.where(np.arange(hops) == round(0.5 / onset_module.HOP), shown[rate], 0.0)

    monkeypatch.setattr(onset_module, "_excess", excess)
    (found,) = onsets(Heard("1", tuple(zip(levels, rates, strict=True)), 0.0))
    assert found.time == pytest.approx(time, abs=5e-4)


def test_clicks_are_heard_to_a_fifth_of_a_millisecond():
    np.testing.assert_allclose(_times(clicks()), CLICKS, atol=2e-4)


@pytest.mark.parametrize("rate", [8_000.0, 22_050.0, 96_000.0])
def test_the_rate_does_not_matter(rate):
    time = np.arange(int(2.0 * rate)) / rate
    rng = np.random.default_rng(2)
    signal = 1e-3 * rng.standard_normal(len(time))
    for at in CLICKS:
        signal += np.where(
            time >= at, 0.3 * np.exp(-(time - at) / 0.01) * rng.standard_normal(len(time)), 0.0
        )
    np.testing.assert_allclose(_times(Sound(rate, ("1",), signal[:, None])), CLICKS, atol=5e-4)


def test_the_clock_and_the_way_to_the_microphone_are_taken_off():
    plain = _times(clicks())
    np.testing.assert_allclose(_times(replace(clicks(), start=12.5)), plain + 12.5, atol=1e-9)
    np.testing.assert_allclose(_times(clicks(), distance=3.43), plain - 0.01, atol=1e-9)
    warm = hear_impacts(clicks(), [replace(DRUM, distance=3.43)], speed_of_sound(35.0))
    assert warm.impacts[0].time == pytest.approx(plain[0] - 3.43 / 351.9, abs=1e-5)
    assert speed_of_sound(20.0) == pytest.approx(343.2, abs=0.05)


def test_twice_as_loud_is_four_times_the_energy_at_the_same_time():
    sound = clicks(sizes=(0.2, 0.1, 0.15, 0.05))
    louder = hear_impacts(Sound(RATE, ("1",), 2.0 * sound.samples), [DRUM]).impacts
    for one, other in zip(hear_impacts(sound, [DRUM]).impacts, louder, strict=True):
        assert other.time == pytest.approx(one.time, abs=1e-9)
        assert other.energy == pytest.approx(4.0 * one.energy, rel=1e-4)


def test_what_still_rings_is_taken_off_the_energy_of_the_next():
    time = np.arange(int(RATE)) / RATE
    rng = np.random.default_rng(3)
    ringing = 0.3 * np.exp(-time / 0.3) * np.sin(2 * np.pi * 180.0 * time)
    since = time - 0.5
    new = np.where(
        since >= 0.0, 0.1 * np.exp(-since / 0.02) * np.sin(2 * np.pi * 260.0 * since), 0.0
    )
    energies = []
    for signal in (new, ringing + new):
        heard = listen(
            Sound(RATE, ("1",), (signal + 1e-5 * rng.standard_normal(len(time)))[:, None]), "1"
        )
        energies.append(energy_after(heard, 0.5)[0])
    assert energies[1] == pytest.approx(energies[0], rel=0.05)
    window = (since >= 0.0) & (since < 0.02)
    plain = np.sum((ringing + new)[window] ** 2) / np.sum(new[window] ** 2)
    assert plain > 1.5


def test_noise_hum_and_silence_are_no_strokes():
    rng = np.random.default_rng(4)
    time = np.arange(int(10.0 * RATE)) / RATE
    noise = 0.05 * rng.standard_normal(len(time))
    hum = (
        0.3 * np.sin(2 * np.pi * 50.0 * time)
        + 0.1 * np.sin(2 * np.pi * 150.0 * time + 1.0)
        + 0.1 * noise
    )
    for signal in (noise, hum, np.zeros(len(time))):
        heard = hear_impacts(Sound(RATE, ("1",), signal[:, None]), [DRUM])
        assert heard.impacts == ()
        assert "no impact on 'drum' was heard" in heard.warnings[-1]


def test_strokes_in_a_room_are_heard_once_on_their_drum_within_three_milliseconds(drums):
    _, _, truth, heard = drums
    pairs, false = matched(truth, heard)
    assert len(truth) > 25
    assert len(pairs) >= len(truth) - 1
    assert false <= 1
    assert max(abs(stroke.time - one.time) for one, stroke in pairs) < 3e-3
    assert min(stroke.confidence for _, stroke in pairs) > 0.1


def test_impulses_come_back_to_a_tenth_by_the_strokes_that_calibrate(drums):
    _, _, truth, heard = drums
    pairs, _ = matched(truth, heard)
    errors = np.abs(impulse_errors(pairs))
    assert np.median(errors) < 0.05
    assert np.mean(errors < 0.1) > 0.85


def test_a_stroke_in_every_microphone_is_one_stroke(drums):
    scene, sound, truth, heard = drums
    arrivals = sum(len(onsets(listen(sound, one.channel))) for one in instruments(scene))
    assert arrivals > len(truth) + 5
    assert len(heard.impacts) <= len(truth) + 1


def test_strokes_become_contacts_with_their_instrument(drums):
    scene, _, _, heard = drums
    played = tuple(replace(one, sites=("stick_r",)) for one in instruments(scene))
    contacts = contacts_heard(
        replace(heard, instruments=played), ["stick_r"] * len(heard.impacts), duration=0.02
    )
    assert contacts.sites == ("stick_r",)
    assert len(contacts.intervals) == len(heard.impacts)
    first = contacts.intervals[0]
    assert (first.surface, first.source) == (heard.impacts[0].instrument, "sound")
    assert first.stop - first.start == pytest.approx(0.02)
    both = tuple(replace(one, sites=("stick_r", "stick_l")) for one in instruments(scene))
    left = contacts_heard(replace(heard, instruments=both), ["stick_l"] * len(heard.impacts))
    assert left.of("stick_r") == ()
    with pytest.raises(UnknownName, match="'foot'"):
        contacts_heard(replace(heard, instruments=both), ["foot"] * len(heard.impacts))


def test_silent_and_clipped_channels_are_named():
    sound = clicks()
    values = np.column_stack(
        [np.clip(4.0 * sound["1"], -0.6, 0.6), np.zeros(len(sound)), sound["1"]]
    )
    faults = sound_faults(Sound(RATE, ("snare", "tom", "bass"), values))
    assert len(faults) == 2
    assert "channel 'snare' is clipped at 0.6 of full scale, first at 0.31" in faults[0]
    assert faults[1] == "sound channel 'tom' is silent"


def test_another_length_than_the_motions_is_told_and_another_time_refused():
    sound = clicks()
    assert sound_faults(sound, np.linspace(0.0, 2.0, 201)) == ()
    told = sound_faults(sound, np.linspace(0.0, 7.0, 701))
    assert "the sound runs from 0.000 to 2.000 s, the motion from 0.000 to 7.000 s" in told[0]
    with pytest.raises(BadData, match="have no time in common"):
        sound_faults(sound, np.linspace(30.0, 40.0, 101))
    with pytest.raises(BadData, match="have no time in common"):
        hear_impacts(replace(sound, start=99.0), [DRUM], time=np.linspace(0.0, 2.0, 201))


def test_what_is_not_there_is_named():
    sound = clicks()
    with pytest.raises(
        UnknownName,
        match="unknown sound channel '7': the recording, for instrument 'drum', has '1'",
    ):
        hear_impacts(sound, [Instrument("drum", "7")])
    with pytest.raises(BadData, match="each with a name of its own"):
        hear_impacts(sound, [DRUM, DRUM])
    with pytest.raises(BadData, match=r"instrument 'drum' is -1 m from channel '1'"):
        Instrument("drum", "1", -1.0)
    with pytest.raises(UnknownName, match="'bell'"):
        HeardImpacts(
            (DRUM,), (HeardImpact(instrument="drum", time=0.0, energy=1.0, confidence=1.0),)
        ).of("bell")
    assert hear_impacts(Sound(RATE, ("1",), np.zeros((100, 1))), [DRUM]).impacts == ()
