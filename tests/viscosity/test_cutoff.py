"""The filter's cutoff: noise found again, motion kept, results on a plateau."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.errors import BadData
from myomorph.swings.viscosity.trust.cutoff import (
    MAX_CUTOFF,
    MIN_CUTOFF,
    choice_of,
    residual_analysis,
    scan_cutoffs,
)
from truths.mechanical_joint import JointExperiment, mechanical_joint

RATE = 200.0
TIME = np.arange(0.0, 30.0, 1.0 / RATE)


def _decaying(frequency: float, noise: float, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    return np.exp(-0.1 * TIME) * np.sin(
        2.0 * np.pi * frequency * TIME
    ) + noise * random.standard_normal(len(TIME))


def test_the_noise_of_a_signal_is_found_again():
    found = residual_analysis("angle", [_decaying(0.7, 0.004), _decaying(0.8, 0.004, 1)], RATE)
    assert found.noise == pytest.approx(0.004, rel=0.05)
    assert 0.5 < found.band < 3.0
    assert found.band < found.cutoff < 10.0


def test_a_faster_motion_asks_for_a_higher_cutoff():
    slow = residual_analysis(f"{0.7:g}", [_decaying(0.7, 0.004)], RATE)
    fast = residual_analysis(f"{4.0:g}", [_decaying(4.0, 0.004)], RATE)
    assert fast.cutoff > 2.0 * slow.cutoff
    choice = choice_of([slow, fast])
    assert choice.cutoff == fast.cutoff
    assert "'4'" in choice.reason
    assert "\n" not in choice.reason


def test_a_choice_stays_within_its_limits():
    still = residual_analysis(
        "still", [1e-3 * np.random.default_rng(2).standard_normal(len(TIME))], RATE
    )
    assert choice_of([still]).cutoff == MIN_CUTOFF
    quick = residual_analysis("quick", [_decaying(18.0, 1e-4)], RATE)
    assert choice_of([quick]).cutoff == MAX_CUTOFF


def test_a_signal_full_of_gaps_is_refused():
    with pytest.raises(BadData, match="needs 2 s without gaps"):
        residual_analysis("angle", [TIME[:100]], RATE)


def test_results_of_a_virtual_hinge_lie_on_a_plateau():
    joint = mechanical_joint("hinge", 0.05, 0.0, seed=1, experiment=JointExperiment(seconds=15.0))
    scan = scan_cutoffs(joint.swings, (2.0, 5.0, 7.0, 10.0))
    truth = joint.truth
    mass, com, viscosity = scan.T
    assert mass == pytest.approx(truth.mass, rel=0.005)
    assert com[1:] == pytest.approx(truth.com, abs=0.002)
    assert viscosity[1:] == pytest.approx(truth.damping, rel=0.03)
    assert abs(viscosity[0] / truth.damping - 1.0) > 0.03
    assert np.abs(scan[[1, 3]] / scan[2] - 1.0).max() < 0.01 < np.abs(scan[1] / scan[0] - 1.0).max()
