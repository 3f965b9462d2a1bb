import numpy as np
import pytest
from scipy import stats
from scipy.signal import butter, lfilter

from myomorph.analysis.lagged import LagOptions, correlate, lock
from myomorph.model.series import Series

TIME = np.arange(1001) / 50.0


def noise(random: np.random.Generator, columns: int, cutoff: float, time: np.ndarray = TIME) -> np.ndarray:
    """Columns of noise below a frequency [Hz]."""
    numerator, denominator = butter(2, cutoff / 25.0)
    return lfilter(numerator, denominator, random.standard_normal((5 * len(time), columns)), axis=0)[-len(time) :]


def series(values: np.ndarray, time: np.ndarray = TIME) -> Series:
    return Series(time, tuple(f"s{i}" for i in range(values.shape[1])), values)


@pytest.mark.parametrize("lag", [-0.4, -0.06, 0.0, 0.24, 0.5])
def test_a_known_lag_is_found(lag: float) -> None:
    random = np.random.default_rng(5)
    source = noise(random, 1, 2.0, np.arange(1101) / 50.0)[:, 0]
    shift = round(50 * lag)
    follower = source[50 - shift : 1051 - shift] + 0.3 * source.std() * random.standard_normal(1001)
    found = correlate(series(follower[:, None]), series(source[50:1051, None]))
    assert found.lags[0, 0] == pytest.approx(lag, abs=0.015)
    assert found.values[0, 0] == pytest.approx(1.0 / np.sqrt(1.09), abs=0.03)
    assert found.related[0, 0]


def test_sign_follows_and_scale_does_not_matter() -> None:
    x = noise(np.random.default_rng(2), 2, 1.0)
    one = correlate(series(x), series(x[:, :1]))
    other = correlate(series(-3.0 + 1e4 * x * [1, -1]), series(x[:, :1] * 1e-6))
    assert one.values[0, 0] == pytest.approx(1.0)
    assert one.lags[0, 0] == 0.0
    assert other.values[:, 0] == pytest.approx(one.values[:, 0] * [1, -1], abs=1e-9)


@pytest.mark.parametrize("lag", [0.0, 0.5])
@pytest.mark.parametrize("cutoff", [0.3, 2.0, 20.0])
def test_slow_signals_are_not_called_related_by_chance(cutoff: float, lag: float) -> None:
    """Of unrelated signals one in twenty has a chance under 0.05, however slow, and whatever lags are searched."""
    random = np.random.default_rng(int(10 * cutoff))
    options = LagOptions(lag)
    found = [correlate(series(noise(random, 4, cutoff)), series(noise(random, 6, cutoff)), options) for _ in range(60)]
    assert 0.01 < np.mean([one.chance < 0.05 for one in found]) < 0.085
    assert np.mean([one.related.any() for one in found]) < 0.2


def test_the_best_of_many_lags_has_so_many_tries() -> None:
    """Student's t at one lag, and 1 + 4 d lag / duration tries of it."""
    random, lag = np.random.default_rng(5), 0.3
    found = correlate(series(noise(random, 4, 3.0)), series(noise(random, 3, 3.0)), LagOptions(lag=lag))
    r, d = found.values, found.freedom
    single = 2.0 * stats.t.sf(np.abs(r) * np.sqrt((d - 1.0) / (1.0 - r**2)), d - 1.0)
    tries = np.log1p(-found.chance) / np.log1p(-single)
    np.testing.assert_allclose(tries, 1.0 + 4.0 * d * lag / (TIME[-1] - TIME[0]), rtol=0.005)


def test_plain_correlation_would_call_them_related() -> None:
    """Why degrees of freedom matter: as if all frames were independent, most slow pairs would stand out."""
    found = correlate(
        series(noise(np.random.default_rng(0), 20, 0.3)), series(noise(np.random.default_rng(1), 20, 0.3))
    )
    naive = np.abs(found.values) * np.sqrt(len(TIME)) > 1.96
    assert naive.mean() > 0.7
    assert np.median(found.freedom) < 60


def test_flat_and_unknown_columns_have_no_correlation() -> None:
    x = noise(np.random.default_rng(2), 3, 1.0)
    x[:, 1], x[:, 2] = 4.0, np.nan
    found = correlate(series(x), series(x[:, :1]))
    assert np.isnan(found.values[1:, 0]).all()
    assert not found.related[1:].any()
    assert correlate(series(x[:5], TIME[:5]), series(x[:5], TIME[:5])).related.sum() == 0


@pytest.mark.parametrize("delay", [0.0, 0.25, 0.7])
def test_the_delay_within_a_period_is_found(delay: float) -> None:
    random = np.random.default_rng(4)
    wave = np.maximum(np.sin(2 * np.pi * (TIME / 2.5 - delay)), 0.0) + 0.2 * random.standard_normal(len(TIME))
    found = lock(series(wave[:, None]), series(np.sin(2 * np.pi * TIME / 2.5)[:, None]), 2.5)
    assert found is not None
    assert found.cycles == 8
    assert found.locked[0]
    assert found.strength[0] > 0.95
    assert (found.delay[0] - delay + 0.5) % 1.0 - 0.5 == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("cutoff", [0.1, 1.0, 10.0])
def test_what_has_no_rhythm_keeps_none(cutoff: float) -> None:
    random = np.random.default_rng(int(10 * cutoff))
    wave = series(np.sin(2 * np.pi * TIME / 2.5)[:, None])
    found = [lock(series(noise(random, 10, cutoff)), wave, 2.5) for _ in range(40)]
    assert np.mean([one.chance < 0.05 for one in found if one is not None]) < 0.12


def test_three_periods_are_too_few() -> None:
    wave = series(np.sin(2 * np.pi * TIME / 6.0)[:, None])
    assert lock(wave, wave, 6.0) is None
    assert lock(wave, wave, float("nan")) is None
