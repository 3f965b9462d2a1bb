"""Synergies: mixtures of few time courses are recovered.

A channel that is missing for a while does no harm.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Emg
from myomorph.core.motion.emg_activation import (
    EmgCalibration,
    SynergyWeights,
    _factors,
    find_synergies,
)

NAMES = tuple("abcdef")


@pytest.fixture
def mixed():
    """Two bursts (200, 2) in six channels (200, 6)."""
    time = np.linspace(0.0, 4.0, 200)
    courses = np.maximum(np.sin(np.pi * time[:, None] + np.array([0.0, 2.0])), 0.0)
    vectors = np.array([[1.0, 0.8, 0.5, 0.0, 0.0, 0.1], [0.0, 0.1, 0.4, 1.0, 0.7, 0.6]])
    return time, courses, courses @ vectors * np.array([1.0, 0.2, 3.0, 0.5, 1.0, 0.1])


def test_as_many_as_were_mixed(mixed):
    _, _, envelopes = mixed
    found = find_synergies(NAMES, envelopes, explained=0.99)
    assert len(found) == 2
    assert found.explained > 0.99
    assert (found.vectors >= 0.0).all()
    np.testing.assert_allclose(found.vectors.max(axis=1), 1.0)
    courses = found.courses(envelopes)
    assert (courses >= 0.0).all()
    error = courses @ found.vectors * found.scale - envelopes
    assert np.sum(error**2) < 0.01 * np.sum(envelopes**2)


def test_what_factors_leave_is_orthogonal_to_what_they_explain(mixed):
    """As of any least-squares fit of which a multiple fits no better.

    Of the data, <D - H V, H V> = 0.
    """
    rng = np.random.default_rng(0)
    for data in (mixed[2], rng.random((60, 5))):
        for count in (1, 2):
            courses, vectors = _factors(data, count)
            explained = courses @ vectors
            assert np.sum(data * explained) == pytest.approx(np.sum(explained**2), rel=1e-4)


def test_units_of_a_channel_make_no_difference(mixed):
    _, _, envelopes = mixed
    one = find_synergies(NAMES, envelopes)
    other = find_synergies(NAMES, envelopes * np.array([1, 10, 1, 0.1, 1, 5]))
    np.testing.assert_allclose(one.vectors, other.vectors, atol=1e-6)


def test_a_channel_that_is_missing_is_left_out(mixed):
    _, _, envelopes = mixed
    found = find_synergies(NAMES, envelopes, explained=0.99)
    whole = found.courses(envelopes)
    broken = envelopes.copy()
    broken[50:80, 1] = np.nan
    broken[10] = np.nan
    some = found.courses(broken)
    assert np.isnan(some[10]).all()
    np.testing.assert_allclose(np.delete(some, 10, axis=0), np.delete(whole, 10, axis=0), atol=0.05)
    with pytest.raises(BadData, match="no frame has all of them known"):
        find_synergies(NAMES, np.full((5, 6), np.nan))


def test_activations_of_muscles_that_nobody_measured(mixed):
    time, _, envelopes = mixed
    found = find_synergies(NAMES, envelopes, explained=0.99)
    weights = np.array([[0.4, 0.0], [0.0, 3.0]])
    one = SynergyWeights(found, ("x", "y"), weights)
    calibration = EmgCalibration(
        channels=NAMES,
        delays=np.full(6, 0.1),
        gains=np.ones(6),
        offsets=np.zeros(6),
        synergies=(one,),
    )
    told = calibration.extrapolated(Emg(time, NAMES, envelopes), time)
    assert told.names == ("x", "y")
    wanted = np.clip(found.courses(envelopes) @ weights.T, 0.0, 1.0)
    np.testing.assert_allclose(
        told.values[20:],
        np.array([np.interp(time[20:] - 0.1, time, column) for column in wanted.T]).T,
        atol=0.08,
    )
    assert np.nanmax(told.values) == 1.0
    assert np.isnan(told.values[0]).all()
