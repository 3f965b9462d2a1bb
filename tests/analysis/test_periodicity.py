import numpy as np
import pytest
from scipy.signal import butter, lfilter

from myomorph.core.model.errors import BadData
from myomorph.lab.analysis.cycles import PeriodOptions, find_period

TIME = np.arange(4001) / 100.0


def _slow_noise(random: np.random.Generator, cutoff: float) -> np.ndarray:
    """Noise below a frequency [Hz] that has forgotten how it began."""
    numerator, denominator = butter(2, cutoff / 50.0)
    return lfilter(numerator, denominator, random.standard_normal(3 * len(TIME)))[-len(TIME) :]


@pytest.mark.parametrize("period", [0.5, 1.13, 5.0, 12.0])
def test_a_period_in_noise_is_found(period: float) -> None:
    """Figure 5.3 of [D]: a period of about 5 s, 8 times in 40 s.

    Here other periods too, with a drift and measurement noise.
    """
    random = np.random.default_rng(3)
    wave = np.sin(2 * np.pi * TIME / period) + 0.4 * np.cos(4 * np.pi * TIME / period + 1.0)
    found = find_period(
        TIME, 0.9 + 0.05 * wave + 0.02 * TIME + 0.01 * random.standard_normal(len(TIME))
    )
    assert found.periodic
    assert found.confidence > 0.95
    assert found.period == pytest.approx(period, rel=0.01)
    assert found.cycles == pytest.approx(40.0 / period, rel=0.01)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e3])
def test_size_place_and_clock_do_not_matter(scale: float) -> None:
    wave = np.sin(2 * np.pi * TIME / 4.0) + 0.3 * np.random.default_rng(0).standard_normal(
        len(TIME)
    )
    one = find_period(TIME, wave)
    other = find_period(100.0 + TIME / 10.0, 7.0 + scale * wave)
    assert other.period == pytest.approx(one.period / 10.0, rel=1e-6)
    assert other.likeness == pytest.approx(one.likeness, abs=1e-6)


@pytest.mark.parametrize("cutoff", [0.1, 0.3, 1.0, 5.0])
def test_what_does_not_repeat_is_told_so(cutoff: float) -> None:
    """Noise that wanders at any pace rarely gets a period.

    The share that does is below one minus the requested confidence.
    """
    random = np.random.default_rng(int(100 * cutoff))
    found = [find_period(TIME, _slow_noise(random, cutoff)) for _ in range(120)]
    assert np.mean([one.periodic for one in found]) <= 0.05
    assert np.mean([one.confidence > 0.95 for one in found]) <= 0.12


def test_a_random_walk_and_a_ramp_have_no_period() -> None:
    walk = np.cumsum(np.random.default_rng(1).standard_normal(len(TIME)))
    for values in (walk, TIME, TIME**2, np.zeros_like(TIME), np.full_like(TIME, 3.0)):
        assert not find_period(TIME, values).periodic


def test_gaps_and_too_few_values() -> None:
    wave = np.sin(2 * np.pi * TIME / 4.0)
    wave[300:700] = np.nan
    assert find_period(TIME, wave).period == pytest.approx(4.0, rel=0.02)
    wave[700:2500] = np.nan
    assert not find_period(TIME, wave).periodic
    assert not find_period(TIME[:5], wave[:5]).periodic


def test_one_cycle_is_no_period() -> None:
    assert not find_period(TIME, np.sin(2 * np.pi * TIME / 30.0)).periodic
    with pytest.raises(BadData, match="2 or more"):
        PeriodOptions(cycles=1.0)
