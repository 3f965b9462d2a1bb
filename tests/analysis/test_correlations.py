import numpy as np
import pytest
from scipy import stats
from scipy.signal import butter, lfilter

from myomorph.core.model.series import Series
from myomorph.lab.analysis.correlations import correlate

TIME = np.arange(1001) / 50.0


def _noise(
    random: np.random.Generator, columns: int, cutoff: float, time: np.ndarray = TIME
) -> np.ndarray:
    """Columns of noise below a frequency [Hz]."""
    numerator, denominator = butter(2, cutoff / 25.0)
    return lfilter(
        numerator, denominator, random.standard_normal((5 * len(time), columns)), axis=0
    )[-len(time) :]


def _series(values: np.ndarray, time: np.ndarray = TIME) -> Series:
    return Series(time, tuple(f"s{i}" for i in range(values.shape[1])), values)


def test_a_known_correlation_is_measured() -> None:
    random = np.random.default_rng(5)
    source = _noise(random, 1, 2.0)
    follower = source + 0.3 * source.std() * random.standard_normal(source.shape)
    result = correlate(_series(follower), _series(source))
    assert result.values[0, 0] == pytest.approx(1.0 / np.sqrt(1.09), abs=0.03)
    assert result.significant[0, 0]


def test_sign_follows_and_scale_does_not_matter() -> None:
    x = _noise(np.random.default_rng(2), 2, 1.0)
    first = correlate(_series(x), _series(x[:, :1]))
    other = correlate(_series(-3.0 + 1e4 * x * [1, -1]), _series(x[:, :1] * 1e-6))
    assert first.values[0, 0] == pytest.approx(1.0)
    assert other.values[:, 0] == pytest.approx(first.values[:, 0] * [1, -1], abs=1e-9)


@pytest.mark.parametrize("cutoff", [0.3, 2.0, 20.0])
def test_slow_signals_are_not_called_significant_by_chance(cutoff: float) -> None:
    """Of unrelated signals one in twenty has a chance under 0.05, however slow."""
    random = np.random.default_rng(int(10 * cutoff))
    results = [
        correlate(_series(_noise(random, 4, cutoff)), _series(_noise(random, 6, cutoff)))
        for _ in range(60)
    ]
    assert 0.01 < np.mean([result.chance < 0.05 for result in results]) < 0.085
    assert np.mean([result.significant.any() for result in results]) < 0.2


def test_chance_is_that_of_students_t() -> None:
    random = np.random.default_rng(5)
    result = correlate(_series(_noise(random, 4, 3.0)), _series(_noise(random, 3, 3.0)))
    r = result.values
    d = result.freedom
    expected = 2.0 * stats.t.sf(np.abs(r) * np.sqrt((d - 1.0) / (1.0 - r**2)), d - 1.0)
    np.testing.assert_allclose(result.chance, expected, rtol=1e-9)


def test_plain_correlation_would_call_them_significant() -> None:
    """Without the correction for degrees of freedom, most slow pairs would appear significant.

    That is the result when all frames are taken as independent.
    """
    result = correlate(
        _series(_noise(np.random.default_rng(0), 20, 0.3)),
        _series(_noise(np.random.default_rng(1), 20, 0.3)),
    )
    naive = np.abs(result.values) * np.sqrt(len(TIME)) > 1.96
    assert naive.mean() > 0.7
    assert np.median(result.freedom) < 60


def test_flat_and_unknown_columns_have_no_correlation() -> None:
    x = _noise(np.random.default_rng(2), 3, 1.0)
    x[:, 1] = 4.0
    x[:, 2] = np.nan
    result = correlate(_series(x), _series(x[:, :1]))
    assert np.isnan(result.values[1:, 0]).all()
    assert not result.significant[1:].any()
    assert correlate(_series(x[:5], TIME[:5]), _series(x[:5], TIME[:5])).significant.sum() == 0
