"""Muscle lengths over the strides of a walker whose gait is known."""

from __future__ import annotations

import numpy as np
import pytest
from tests.walker import shown

from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.errors import BadData
from myomorph.core.model.segments import feet_of
from myomorph.core.model.series import Motion, Series
from myomorph.core.muscles.kinematics import default_path_lengths, muscle_kinematics
from myomorph.lab.analysis.cycles import band
from myomorph.lab.analysis.length_analysis import RANGE_HEAD, curve_rows, length_analysis, range_row
from myomorph.lab.analysis.walking import chains, walking_limbs, walking_points, walking_strides
from myomorph.lab.report.trial.muscle_sections import length_cycle_section
from myomorph.lab.report.trial.prepared import prepare

MODEL = "rajagopal-walk-emg/subject_walk_scaled.osim"
PERIOD = 1.1
TIME = np.arange(0.0, 5.5, 0.02)


@pytest.fixture(scope="module")
def model(data):
    return read_osim(data(MODEL))


@pytest.fixture(scope="module")
def motion(model):
    """Hips and knees swing as in a walk at 1.2 m/s, the left half a stride after the right."""
    values = np.tile([one.default for one in model.coordinates], (len(TIME), 1))
    columns = {name: k for k, name in enumerate(model.coordinate_names)}
    values[:, columns["pelvis_tx"]] = 1.2 * TIME
    for side, lag in (("r", 0.0), ("l", 0.5)):
        phase = 2.0 * np.pi * (TIME / PERIOD - lag)
        values[:, columns[f"hip_flexion_{side}"]] = 0.4 * np.cos(phase)
        values[:, columns[f"knee_angle_{side}"]] = 0.4 - 0.3 * np.sin(phase)
    return Motion(
        TIME, model.coordinate_names, values, velocities=np.gradient(values, TIME, axis=0)
    )


@pytest.fixture(scope="module")
def lengths(model, motion):
    found = muscle_kinematics(model, motion, moment_arms=False)
    return Series(TIME, model.muscle_names, found.muscle_length), Series(
        TIME, model.muscle_names, found.muscle_velocity
    )


@pytest.fixture(scope="module")
def analysis(model, motion, lengths):
    return length_analysis(model, lengths[0], walking_strides(model, motion), lengths[1])


def test_limbs_are_the_legs_with_what_hangs_on_them(model):
    limbs = walking_limbs(model)
    assert tuple(one.name for one in limbs) == feet_of(model) == ("calcn_r", "calcn_l")
    reach = chains(model, limbs)
    assert reach["calcn_r"] == {"femur_r", "patella_r", "tibia_r", "talus_r", "calcn_r", "toes_r"}
    assert not reach["calcn_r"] & reach["calcn_l"]


def test_strides_are_those_of_the_motion(analysis):
    for limb in ("calcn_r", "calcn_l"):
        lasting = [one.duration for one in analysis.strides[limb]]
        assert len(lasting) >= 3
        np.testing.assert_allclose(lasting, PERIOD, atol=0.02)
        np.testing.assert_allclose(
            [one.length for one in analysis.strides[limb]], 1.2 * PERIOD, atol=0.03
        )


def test_every_stride_shows_the_same_curve_and_both_sides_agree(analysis):
    for muscle in ("soleus_r", "recfem_r", "bflh_r", "gasmed_r"):
        curves = analysis.curves(muscle)
        assert np.ptp(curves, axis=0).max() < 2e-3
        other = band(analysis.curves(muscle.removesuffix("_r") + "_l")).mean
        np.testing.assert_allclose(band(analysis.curves(muscle)).mean, other, atol=2e-3)


def test_ranges_are_those_of_the_lengths(model, analysis, lengths):
    found = {one.muscle: one for one in analysis.ranges}
    assert set(found) == set(model.muscle_names)
    column = lengths[0]["recfem_r"]
    one = found["recfem_r"]
    assert one.limb == "calcn_r"
    assert one.shortest == pytest.approx(column.min(), abs=1e-4)
    assert one.longest == pytest.approx(column.max(), abs=1e-4)
    assert one.excursion == pytest.approx(
        np.ptp(column) / model.muscle("recfem_r").optimal_fiber_length, rel=0.01
    )
    assert one.standing == default_path_lengths(model)[model.muscle_names.index("recfem_r")]
    fastest = -lengths[1]["recfem_r"][20:-20].min() / model.muscle("recfem_r").optimal_fiber_length
    assert one.shortening == pytest.approx(fastest, rel=0.03)


def test_tables_hold_every_stride(analysis):
    rows = list(curve_rows(analysis))
    per_stride = {limb: len(cycles.names) for limb, cycles in analysis.lengths.items()}
    assert len(rows) == 1 + sum(
        per_stride[limb] * len(own) for limb, own in analysis.strides.items()
    )
    assert list(rows[0][4:]) == [f"{k} %" for k in range(101)]
    row = next(one for one in rows if one[3] == "soleus_r")
    assert float(row[4]) == pytest.approx(1e3 * analysis.curves("soleus_r")[0, 0], rel=1e-4)
    cells = dict(zip(RANGE_HEAD, range_row(analysis.ranges[0]), strict=True))
    assert float(cells["standing [mm]"]) == pytest.approx(
        1e3 * analysis.ranges[0].standing, rel=1e-3
    )


def test_the_page_shows_them_for_a_walk_only(model, motion, lengths):
    given = shown(
        "a walk", model=model, coordinates=motion, lengths=lengths[0], velocities=lengths[1]
    )
    section = length_cycle_section(prepare(given))
    assert section is not None
    assert len(section.figures) >= 8
    assert "band right" in section.figures[0].svg
    assert len(section.grids[0].rows) == len(model.muscles)
    still = Motion(TIME, motion.names, np.tile(motion.values[:1], (len(TIME), 1)))
    assert (
        length_cycle_section(
            prepare(shown("still", model=model, coordinates=still, lengths=lengths[0]))
        )
        is None
    )
    assert walking_strides(model, still) is None


def test_up_from_a_chair_and_down_again_is_no_walk(model):
    values = np.tile([one.default for one in model.coordinates], (len(TIME), 1))
    columns = {name: k for k, name in enumerate(model.coordinate_names)}
    bent = 0.8 - 0.8 * np.cos(2.0 * np.pi * TIME / PERIOD)
    for side in ("r", "l"):
        values[:, columns[f"hip_flexion_{side}"]] = bent
        values[:, columns[f"knee_angle_{side}"]] = 1.2 * bent
    right = walking_points(model, Motion(TIME, model.coordinate_names, values)).values[:, 0]
    for k, name in enumerate(("pelvis_tx", "pelvis_ty")):
        values[:, columns[name]] -= right[:, k] - right[0, k]
    assert walking_strides(model, Motion(TIME, model.coordinate_names, values)) is None


def test_no_stride_is_named(model, motion, lengths):
    short = Motion(TIME[:20], motion.names, motion.values[:20])
    assert walking_strides(model, short) is None
    strides = walking_strides(model, motion)
    with pytest.raises(BadData, match="no whole stride"):
        length_analysis(
            model,
            lengths[0],
            type(strides)((), {"calcn_r": np.zeros(0)}, {}, {}, np.eye(3)[0], 0.0),
        )
