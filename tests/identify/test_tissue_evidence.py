"""Soft tissue is distinguished from noise of the motion, whose size nobody knows."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.accuracy.identification.tissue_noise import (
    Truth,
    identified,
    simulated_person,
)

from myomorph.body.identify.tissue_evidence import TissueEvidence

SEED = 41


@pytest.fixture(scope="module")
def mover():
    return simulated_person(SEED)


@pytest.mark.parametrize(
    "truth",
    [
        Truth(name="noise", noise=0.3),
        Truth(name="noise that lasts", noise=0.1, alike=0.9),
        Truth(name="markers that move less", alpha=-3e-4, noise=0.1),
    ],
    ids=lambda truth: truth.name,
)
def test_noise_is_no_soft_tissue(mover, truth):
    found = identified(mover, truth, SEED, "auto")
    assert found.soft_tissue is None
    assert not found.tissue_evidence.shown
    assert "not identifiable" in found.tissue_evidence.sentence


def test_soft_tissue_is_seen_through_noise(mover):
    found = identified(mover, Truth(name="tissue", alpha=4e-4, noise=0.1), SEED, "auto")
    assert found.tissue_evidence.shown
    assert found.soft_tissue is not None


def test_what_was_asked_for_and_is_not_shown_is_named(mover):
    found = identified(mover, Truth(name="noise", noise=0.1), SEED, "always")
    assert found.soft_tissue is not None
    assert any("not identifiable" in note for note in found.notes)


def test_little_data_show_nothing():
    assert not TissueEvidence(size=np.nan, sd=np.inf, blocks=0).shown
    assert not TissueEvidence(size=5.0, sd=1.0, blocks=3).shown
    assert TissueEvidence(size=5.0, sd=1.0, blocks=12).shown
    assert not TissueEvidence(size=-5.0, sd=1.0, blocks=12).shown
    assert "too short" in TissueEvidence(size=np.nan, sd=np.inf, blocks=0).sentence
