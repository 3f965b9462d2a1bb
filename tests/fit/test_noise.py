"""Correlation times and the noise of a recording, on signals whose noise is known."""

import numpy as np
import pytest

from myomorph.core.fit import noise_of_residuals
from myomorph.core.fit.correlation import correlation_times, variance_samples
from myomorph.core.model.errors import UnknownName


def colored(random, frames, keep):
    """Noise of variance 1 whose autocorrelation falls by `keep` a frame."""
    values = np.empty(frames)
    values[0] = random.normal()
    for frame in range(1, frames):
        values[frame] = keep * values[frame - 1] + np.sqrt(1.0 - keep**2) * random.normal()
    return values


@pytest.mark.parametrize("keep", [0.0, 0.5, 0.9])
def test_correlation_times_are_those_of_an_autoregression(keep):
    random = np.random.default_rng(0)
    runs = [colored(random, 20000, keep)[:, None] for _ in range(3)]
    expected = (1.0 + keep) / (1.0 - keep)
    # Geyer's sum ends late rather than early: of long correlations it makes too much.
    np.testing.assert_allclose(correlation_times(runs), expected, rtol=0.2)
    assert correlation_times(runs) > 0.95 * expected
    squares = (1.0 + keep**2) / (1.0 - keep**2)
    # Squares of what lags have by chance add up: of long correlations there are fewer samples.
    assert 0.95 * squares < 60000 / variance_samples(runs) < 1.4 * squares


def test_the_noise_of_a_recording_is_what_was_put_in():
    random = np.random.default_rng(1)
    frames = 4000
    rate = 100.0
    time = np.arange(frames) / rate
    movement = np.sin(2.0 * np.pi * time)[:, None, None] * np.ones((1, 2, 3))
    noise = np.stack(
        [np.column_stack([colored(random, frames, keep) for _ in range(3)]) for keep in (0.0, 0.8)],
        axis=1,
    )
    noise *= np.array([0.001, 0.003])[:, None]
    noise[:200, 1] = np.nan
    found = noise_of_residuals(("heel", "knee"), time, noise, "m")
    assert np.isnan(found.floor).all()
    found = found.with_floor(movement + noise)
    np.testing.assert_allclose(found.sd, [0.001, 0.003], rtol=0.06)
    np.testing.assert_allclose(found.correlation_time, [0.01, 0.09], rtol=0.2)
    np.testing.assert_allclose(found.gaps, [0.0, 0.05])
    # White noise is its own floor; of the other only a part is white.
    np.testing.assert_allclose(found.floor[0], 0.001, rtol=0.06)
    assert found.floor[1] < 0.0015
    assert found.sd_of("knee") == found.sd[1]


def test_what_cannot_be_known_is_not_known():
    time = np.arange(20) / 100.0
    found = noise_of_residuals(("heel",), time, np.zeros((20, 1, 3)), "m")
    assert not found.known
    assert found.sd_of("heel") is None
    assert found.sentence == "the noise of the recording is not known"
    # Residuals of a fit that can follow every marker are none of the noise.
    time = np.arange(200) / 100.0
    assert not noise_of_residuals(("heel",), time, np.zeros((200, 1, 3)), "m", explained=0.9).known
    with pytest.raises(UnknownName, match="toe"):
        found.sd_of("toe")


def test_what_a_fit_follows_is_added_to_its_residuals():
    random = np.random.default_rng(2)
    time = np.arange(300) / 100.0
    noise = random.normal(size=(300, 4, 3))
    left = noise - noise.mean(axis=1, keepdims=True)
    found = noise_of_residuals("abcd", time, left, "m", explained=0.25)
    np.testing.assert_allclose(found.sd, 1.0, rtol=0.1)
