"""What is wrong with EMG is named with its channel and its time; what is right is not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from myomorph.core.io.sto import read_sto
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.series import Emg, Series
from myomorph.core.motion.emg_activation import EmgCalibration, channel_means
from myomorph.core.motion.emg_checks import (
    envelope_faults,
    noise_faults,
    rate_against,
    raw_faults,
    refuse_unfit,
    without_faults,
)
from myomorph.core.motion.envelope import EnvelopeOptions, envelopes, largest, linear_envelope

RATE = 2000.0
TIME = np.arange(6000) / RATE


def _muscle(seed: int = 0) -> np.ndarray:
    """Noise of the band of surface EMG that swells and fades, 16 bits."""
    noise = np.random.default_rng(seed).standard_normal(len(TIME))
    band = sosfilt(butter(2, (40.0, 200.0), "bandpass", fs=RATE, output="sos"), noise)
    return np.round(3000.0 * band * (0.55 - 0.45 * np.cos(2 * np.pi * TIME)))


def _kinds(raw: np.ndarray, rate: float = RATE) -> dict[str, tuple[float, float]]:
    """Faults of one raw channel, by kind."""
    found = raw_faults(Series(np.arange(len(raw)) / rate, ("a",), raw[:, None]))
    assert all("'a'" in one.text for one in found)
    return {one.kind: (one.start, one.stop) for one in found}


def test_a_sound_channel_has_no_faults():
    assert _kinds(_muscle()) == {}


def test_what_is_wrong_with_published_envelopes_is_named(data):
    texts = []
    for name in (
        "rajagopal-walk-emg/electromyography.sto",
        "walk-so-jointload-emg/EMG_allMuscles.sto",
    ):
        table = read_sto(data(name))
        texts += [one.text for one in envelope_faults(Emg(table.time, table.names, table.values))]
    assert any(
        "'tibialis_anterior' is negative in" in one and "down to -0.0267" in one for one in texts
    )
    assert any("'vasint_l_activation' is a copy of 'vaslat_l_activation'" in one for one in texts)


def test_a_dead_stretch_is_named_with_its_times():
    raw = _muscle()
    raw[2000:3000] = raw[2000]
    start, stop = _kinds(raw)["dead"]
    assert (start, stop) == pytest.approx((1.0, 1.4995), abs=1e-3)
    assert "throughout" in raw_faults(Series(TIME, ("a",), np.full((len(TIME), 1), 3.0)))[0].text


def test_a_clipped_channel_is_named():
    raw = _muscle()
    assert "clipped" in _kinds(np.clip(raw, -0.3 * raw.max(), 0.3 * raw.max()))


def test_an_envelope_that_was_cut_is_named_stretch_by_stretch():
    """What lies between two cut peaks stays; a peak of a smooth envelope is no cut."""
    time = np.arange(2000) / 1000.0
    wave = 0.5 - 0.5 * np.cos(4.0 * np.pi * time)
    whole = Emg(time, ("a",), wave[:, None])
    cut = Emg(time, ("a",), np.minimum(wave, 0.8)[:, None])
    assert envelope_faults(whole) == ()
    faults = envelope_faults(cut)
    assert [one.kind for one in faults] == 4 * ["clipped"]
    kept = without_faults(cut, faults).values[:, 0]
    np.testing.assert_array_equal(np.isnan(kept), cut.values[:, 0] == 0.8)


def test_what_is_only_rectified_or_has_an_offset_is_no_envelope():
    made = envelopes(Series(TIME, ("a",), _muscle()[:, None]))
    assert not {one.kind for one in envelope_faults(made)} & {"fast"}
    for column in (np.abs(_muscle()), _muscle() + 1e4):
        faults = envelope_faults(Emg(TIME, ("a",), column[:, None] / column.max()))
        assert "fast" in {one.kind for one in faults}


def test_a_wrong_rate_shows_in_the_spectrum():
    assert "rate" in _kinds(_muscle(), rate=10_000.0)
    assert "rate" in _kinds(_muscle(), rate=200.0)
    assert "rate" in _kinds(envelopes(Series(TIME, ("a",), _muscle()[:, None])).values[:, 0])


def test_a_wrong_rate_shows_in_the_length():
    motion = np.linspace(0.0, 3.0, 301)
    assert "probably 2000 Hz" in rate_against(
        Series(np.arange(6000) / 1000.0, ("a",), _muscle()[:, None]), motion
    )
    assert rate_against(Series(TIME, ("a",), _muscle()[:, None]), motion) == ""


def test_unknown_samples_are_named():
    raw = _muscle()
    raw[:3000] = np.nan
    assert _kinds(raw)["unknown"] == pytest.approx((0.0, 1.4995))
    assert (
        "no known value"
        in raw_faults(Series(TIME, ("a",), np.full((len(TIME), 1), np.nan)))[0].text
    )


def test_negative_large_and_dead_envelopes_are_named_and_taken_out():
    time = np.arange(300) / 100.0
    values = 0.5 + 0.4 * np.sin(np.outer(time, [7.0, 8.0, 9.0]))
    values[10:20, 0] = -0.1
    values[50, 1] = 2.0
    values[100:200, 2] = 0.3
    emg = Emg(time, ("a", "b", "c"), values)
    faults = envelope_faults(emg)
    assert [(one.channel, one.kind) for one in faults] == [
        ("a", "negative"),
        ("b", "large"),
        ("c", "dead"),
    ]
    assert faults[0].start == pytest.approx(0.10)
    assert "down to -0.1" in faults[0].text
    clean = without_faults(emg, faults)
    assert clean["a"].min() == 0.0
    assert np.isnan(clean["c"][100:200]).all()
    assert np.isfinite(clean["c"][:99]).all()


def test_emg_that_does_not_overlap_or_is_unknown_is_refused():
    emg = Emg(TIME, ("a",), np.abs(_muscle()[:, None]))
    with pytest.raises(BadData, match=r"EMG runs from 0 to 2\.9995 s, the motion from 10 to 12 s"):
        refuse_unfit(emg, np.array([10.0, 12.0]))
    with pytest.raises(BadData, match="no EMG channel has a value, of 'a'"):
        refuse_unfit(Emg(TIME, ("a",), np.full((len(TIME), 1), np.nan)), TIME)


def test_a_notch_takes_out_the_mains_and_little_else():
    raw = _muscle()
    hum = 2000.0 * np.sin(2 * np.pi * 50.0 * TIME) + 1000.0 * np.sin(2 * np.pi * 150.0 * TIME)
    pure = Series(TIME, ("a",), raw[:, None])
    humming = Series(TIME, ("a",), (raw + hum)[:, None])
    options = EnvelopeOptions(notch=50.0)
    truth = linear_envelope(pure)["a"][500:-500]
    notched = linear_envelope(humming, options)["a"][500:-500]
    assert np.abs(linear_envelope(humming)["a"][500:-500] - truth).mean() > 0.5 * truth.mean()
    assert np.abs(notched - truth).mean() < 0.1 * truth.mean()


def test_references_scale_envelopes():
    raw = Series(TIME, ("a",), _muscle()[:, None])
    strong = Series(TIME, ("a",), 4.0 * _muscle()[:, None])
    found = envelopes(raw, maxima=largest([strong, raw]))
    np.testing.assert_allclose(4.0 * found.values, envelopes(raw).values, rtol=1e-9)
    with pytest.raises(UnknownName, match="'a'"):
        envelopes(raw, maxima={"b": 1.0})
    with pytest.raises(BadData, match="'a': its largest value in the reference is 0"):
        envelopes(raw, maxima={"a": 0.0})


def test_a_calibration_is_applied_late_and_within_bounds():
    time = np.arange(101) / 100.0
    emg = Emg(time, ("a", "b"), np.array([time, 1.0 - time]).T)
    calibration = EmgCalibration(
        channels=("b", "a"),
        delays=np.array([0.1, 0.2]),
        gains=np.array([3.0, 0.5]),
        offsets=np.array([0.0, 0.1]),
    )
    told = calibration.applied(emg, np.array([0.05, 0.5, 1.0]))
    np.testing.assert_allclose(told["a"], [np.nan, 0.25, 0.5])
    np.testing.assert_allclose(told["b"], [np.nan, 1.0, 0.3])
    with pytest.raises(BadData, match="0 or more"):
        EmgCalibration(channels=("a",), delays=np.zeros(1), gains=-np.ones(1), offsets=np.zeros(1))


def test_a_muscle_that_does_not_exist_is_named_with_its_channel():
    with pytest.raises(
        UnknownName, match=r"muscle of EMG channel 'c' 'soleus': the model has 'soleus_r'"
    ):
        channel_means({"c": ("soleus",)}, ("soleus_r",), np.zeros((3, 1)))


def test_a_channel_of_noise_among_muscles_is_named():
    rng = np.random.default_rng(7)
    raw = np.column_stack([_muscle(1), 300.0 * rng.standard_normal(len(TIME)), _muscle(2)])
    emg = envelopes(Series(TIME, ("a", "noise", "b"), raw))
    (fault,) = noise_faults(emg)
    assert (fault.channel, fault.kind) == ("noise", "noise")
    assert "noise throughout" in fault.text
    # Where nothing bursts, a posture is held: nothing is known against any channel. Nor of those
    # not asked for.
    assert noise_faults(Emg(emg.time, ("noise", "other"), emg.values[:, [1, 1]])) == ()
    assert noise_faults(emg, ("a", "b")) == ()


@pytest.mark.parametrize(
    "path", ["ceinms-emg-walk/walk36/emgFilt.sto", "walk-so-jointload-emg/EMG_allMuscles.sto"]
)
def test_no_channel_of_clean_walks_is_noise(data, path):
    table = read_sto(data(path))
    for start in (5.0, 20.0, 40.0):
        use = (table.time >= start) & (table.time < start + 2.5)
        assert noise_faults(Emg(table.time[use], table.names, table.values[use])) == ()
