"""Masses change no more than a measurement shows."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.body.identify.shown_masses import (
    MAX_RISK,
    HeldMasses,
    mass_evidence,
    shown_masses,
)
from myomorph.core.fit.interval_rule import half_width


@pytest.mark.parametrize("sd", [0.02, 0.05, 0.1, 0.2])
def test_a_mass_is_seldom_farther_than_before(sd):
    """Masses that differ by 15 % from the generic one, and are measured to within sd of it."""
    random = np.random.default_rng(7)
    truth = 1.0 + 0.15 * random.standard_normal(40000)
    measured = truth + sd * random.standard_normal(truth.shape)
    share = 0.15**2 / (0.15**2 + sd**2)
    expected = 1.0 + share * (measured - 1.0)
    after = np.full(truth.shape, np.sqrt(share) * sd)
    before = np.ones(truth.shape)
    masses = shown_masses(before, expected, after)
    farther = np.abs(masses - truth) > np.abs(before - truth)
    assert farther.mean() < MAX_RISK
    expected_farther = np.abs(expected - truth) > np.abs(before - truth)
    assert expected_farther.mean() > 2.0 * farther.mean()
    # The mass lies in the interval about the expected one, and what is sure is taken whole.
    half = half_width(after[0], 1.0 - 2.0 * MAX_RISK)
    assert (np.abs(masses - expected) <= half + 1e-12).all()
    sure = np.abs(expected - 1.0) > 2.0 * half
    np.testing.assert_allclose(masses[sure], expected[sure])


def test_what_the_interval_holds_does_not_change():
    masses = shown_masses(np.array([2.0, 2.0]), np.array([2.1, 1.5]), np.array([0.1, 0.01]))
    np.testing.assert_allclose(masses, [2.0, 1.5])


def test_the_evidence_is_what_is_taken_of_the_change():
    before = np.array([2.0, 2.0, 2.0, 2.0])
    expected = np.array([2.1, 1.7, 1.5, 2.0])
    sd = np.array([0.1, 0.1, 0.01, 0.0])
    words = mass_evidence(before, expected, sd)
    assert words == ("not shown", "partly shown", "shown", "not shown")


def test_the_heaviest_link_has_the_rest():
    held = HeldMasses.of(np.array([5.0, 30.0, 0.0, 1.0]))
    assert held.rows.shape == (2, 40)
    parameters = np.zeros((4, 10))
    parameters[:, 0] = [5.0, 17.0, 3.0, 1.0]
    np.testing.assert_allclose(held.rows @ parameters.ravel(), held.right)
