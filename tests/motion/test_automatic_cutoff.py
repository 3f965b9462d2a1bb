"""The cutoff that a motion asks for: by laws, by motions of known accelerations, and by measured
ground forces.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.series import Motion
from myomorph.core.motion.automatic_cutoff import SLOWEST, automatic_cutoff
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.rigid.dynamics import inverse_dynamics

RATE = 120.0


def _walk(
    noise: float, seconds: float = 4.0, fundamental: float = 1.0
) -> tuple[Motion, np.ndarray]:
    """Three coordinates of five harmonics that fall off as those of a walk, and their
    accelerations; synthetic.
    """
    random = np.random.default_rng(5)
    time = np.arange(int(seconds * RATE)) / RATE
    values = np.zeros((len(time), 3))
    accelerations = np.zeros((len(time), 3))
    for j in range(3):
        for k in range(1, 6):
            w = 2.0 * np.pi * fundamental * k
            phase = random.uniform(0.0, 2.0 * np.pi)
            values[:, j] += 0.4 / k**3 * np.sin(w * time + phase)
            accelerations[:, j] -= 0.4 / k**3 * w**2 * np.sin(w * time + phase)
    values += noise * random.standard_normal(values.shape)
    return Motion(time, ("hip", "knee", "ankle"), values), accelerations


def _error(motion: Motion, truth: np.ndarray, cutoff: float | None) -> float:
    found = differentiate(motion, cutoff).accelerations
    assert found is not None
    inner = slice(60, -60)
    return float(np.sqrt(np.mean((found - truth)[inner] ** 2)))


@pytest.mark.parametrize(("noise", "worse"), [(0.01, 3.0), (0.02, 1.5)])
def test_with_errors_of_skin_markers_accelerations_come_near_the_best_of_any_cutoff(
    noise: float, worse: float
) -> None:
    motion, truth = _walk(noise)
    cutoff = automatic_cutoff(motion)
    best = min(_error(motion, truth, one) for one in np.arange(2.0, 20.0, 0.5))
    assert _error(motion, truth, cutoff) < worse * best
    assert _error(motion, truth, cutoff) < 0.01 * _error(motion, truth, None)


def test_a_smooth_motion_is_left_as_it_is() -> None:
    assert automatic_cutoff(_walk(0.0)[0]) is None
    filtered = differentiate(_walk(0.01)[0], 6.0)
    assert automatic_cutoff(Motion(filtered.time, filtered.names, filtered.values)) is None


def test_a_motion_that_is_twice_as_fast_has_twice_the_cutoff() -> None:
    motion, _ = _walk(0.01)
    faster = Motion(motion.time / 2.0, motion.names, motion.values)
    slow = automatic_cutoff(motion)
    fast = automatic_cutoff(faster)
    assert slow is not None
    assert fast == pytest.approx(2.0 * slow, rel=1e-9)


def test_faster_movements_need_higher_cutoffs_and_noisier_markers_lower_ones() -> None:
    quick = automatic_cutoff(_walk(*(0.01, 4.0, 2.0))[0])
    quiet = automatic_cutoff(_walk(*(0.01,))[0])
    noisy = automatic_cutoff(_walk(*(0.05,))[0])
    assert quick is not None
    assert quiet is not None
    assert noisy is not None
    assert quick > 1.5 * quiet
    assert noisy <= quiet


def test_a_pose_that_is_held_is_filtered_at_no_less_than_the_slowest_movement() -> None:
    time = np.arange(480) / RATE
    held = np.column_stack([0.3 * np.sin(0.3 * time), 0.2 * np.cos(0.4 * time)])
    held += 0.01 * np.random.default_rng(2).standard_normal(held.shape)
    assert automatic_cutoff(Motion(time, ("hip", "knee"), held)) == SLOWEST


def test_size_and_start_of_coordinates_do_not_matter() -> None:
    motion, _ = _walk(0.01)
    other = Motion(motion.time + 7.0, motion.names, 3.0 * motion.values + 1.0)
    assert automatic_cutoff(other) == pytest.approx(automatic_cutoff(motion), rel=1e-9)


def test_gaps_short_motions_and_motions_at_rest_are_borne() -> None:
    motion, _ = _walk(0.01)
    values = motion.values.copy()
    values[40:44] = np.nan
    assert automatic_cutoff(Motion(motion.time, motion.names, values)) is not None
    assert automatic_cutoff(Motion(motion.time[:20], motion.names, motion.values[:20])) is None
    assert automatic_cutoff(Motion(motion.time, motion.names, np.zeros_like(motion.values))) is None


def test_what_holds_the_pelvis_of_a_recorded_walk_is_a_fifth_of_that_without_a_filter(data) -> None:
    model = read_model(data("opensim-gait-subject01/ref_id/subject01.osim"))
    recorded = motion_from_table(
        read_sto(data("opensim-gait-subject01/ref_id/subject01_walk1_ik.mot")), model
    )
    measured = read_external_loads(data("opensim-gait-subject01/ref_id/subject01_walk1_grf.xml"))
    residuals = {}
    for cutoff in (None, automatic_cutoff(recorded)):
        motion = differentiate(recorded, cutoff)
        torques = inverse_dynamics(model, motion, resample_wrenches(measured, motion.time))
        on_plates = (motion.time > 0.6) & (motion.time < 1.4)
        held = np.stack([torques[f"pelvis_t{axis}"][on_plates] for axis in "xyz"])
        residuals[cutoff is not None] = float(np.sqrt(np.mean(np.sum(held**2, axis=0))))
    assert residuals[True] < 0.2 * residuals[False]


def test_it_is_found_once_for_a_motion(monkeypatch) -> None:
    motion, _ = _walk(0.01)
    first = automatic_cutoff(motion)
    monkeypatch.setattr(
        "myomorph.core.motion.automatic_cutoff._cutoff", lambda motion: pytest.fail("found again")
    )
    assert automatic_cutoff(motion) == first
