"""The page for the clinic: written beside the report of a walk, held against the norm that was
asked for.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph import differentiate, inverse_dynamics, resample_wrenches
from myomorph.core.io.formats import read_model
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.known import Known
from myomorph.core.model.scale import scale
from myomorph.lab.analysis.gait_curves import ANGLES, KEYS, SAMPLES, SIDES, gait_curves
from myomorph.lab.report.page.parts import PageHead
from myomorph.lab.report.trial.prepared import prepare
from myomorph.lab.report.trial.report_input import Kinematics, ReportInput
from myomorph.lab.study.trial.gait_norms import adult_norm, checked_norms, norm_of
from myomorph.lab.study.trial.reporting import GaitNorms, write_report
from myomorph.lab.uncertainty.spread import Uncertainty


@pytest.fixture(scope="module")
def prepared(data):
    home = data("opensim-gait-subject01") / "ref_id"
    model = read_model(home / "subject01.osim")
    motion = motion_from_table(read_sto(home / "subject01_walk1_ik.mot"), model)
    return prepare(
        ReportInput(PageHead("s01: walk"), model, kinematics=Kinematics(coordinates=motion))
    )


def test_the_norm_of_adults_is_a_walk():
    norm = adult_norm()
    mean = dict(zip(KEYS, norm.mean.T, strict=True))
    assert np.isfinite(norm.mean[:, [KEYS.index("hip_flexion"), KEYS.index("ankle_moment")]]).all()
    assert 60.0 < mean["knee_flexion"].max() < 70.0
    assert 1.3 < mean["ankle_moment"].max() < 1.6
    # A cycle ends as it begins.
    known = np.isfinite(norm.mean).all(axis=0)
    np.testing.assert_allclose(norm.mean[0, known], norm.mean[-1, known])
    assert (norm.deviation[:, known] >= 0.0).all()
    assert norm.parameters["Stride length"][0] == pytest.approx(1.34, abs=0.01)


def test_a_walk_has_its_page_and_the_report_leads_to_it(prepared, tmp_path):
    write_report(tmp_path, prepared)
    page = (tmp_path / "gait.html").read_text("utf-8")
    report = (tmp_path / "report.html").read_text("utf-8")
    assert 'href="gait.html"' in report
    for words in (
        "Knee flexion",
        "Walking speed",
        "Gait profile score of 5 variables",
        "CC BY 4.0",
        "No scaled score",
    ):
        assert words in page
    assert page.count("<svg") == ANGLES
    write_report(tmp_path, prepared, GaitNorms(("none",)))
    assert "Movement analysis profile" not in (tmp_path / "gait.html").read_text("utf-8")


@pytest.mark.parametrize("movement", ["jumping", "running", "stairs", "upper limb", "other"])
def test_what_is_no_walk_has_no_page_and_no_norms(prepared, tmp_path, movement):
    write_report(tmp_path, prepared)
    found = Known(value=movement, origin="markers", sentence="as markers show")
    recorded = replace(prepared.results.recorded, movement=found, date="2026-03-05")
    write_report(tmp_path, prepare(replace(prepared.results, recorded=recorded)))
    report = (tmp_path / "report.html").read_text("utf-8")
    assert not (tmp_path / "gait.html").exists()
    assert "gait.html" not in report
    for words in (f"{movement} (as markers show)", "2026-03-05", "s01"):
        assert words in report


def test_what_is_stated_to_be_a_walk_has_a_page(prepared, tmp_path):
    stated = Known(value="walking", origin="user")
    recorded = replace(prepared.results.recorded, movement=stated)
    write_report(tmp_path, prepare(replace(prepared.results, recorded=recorded)))
    assert (tmp_path / "gait.html").is_file()
    assert "walking (study file)" in (tmp_path / "report.html").read_text("utf-8")


def test_a_small_body_has_no_norm_of_adults(prepared):
    model = prepared.results.model
    child = scale(model, dict.fromkeys(model.body_names, np.full(3, 0.7)), 30.0)
    norm, note = norm_of((), child, "c", {})
    assert norm is None
    assert "about 1." in note
    assert norm_of(("adults",), child, "c", {})[0] is adult_norm()
    assert norm_of((), model, "a", {})[0] is adult_norm()


def test_controls_are_a_norm_without_the_patient(prepared):
    curves = prepared.gait
    controls = dict.fromkeys("abcd", (curves,))
    norm, _ = norm_of(("controls",), prepared.results.model, "d", controls)
    assert norm.persons == 3
    legs = np.stack([curves.mean(side)[:, :ANGLES] for side in SIDES])
    np.testing.assert_allclose(norm.mean[:, :ANGLES], legs.mean(axis=0))
    with pytest.raises(BadData, match="2 persons"):
        norm_of(("controls",), prepared.results.model, "c", dict.fromkeys("abc", (curves,)))


def test_a_norm_that_is_nothing_is_refused(tmp_path):
    with pytest.raises(BadFile, match="adults"):
        checked_norms(("adult",))
    assert checked_norms((str(tmp_path),)) == (str(tmp_path),)


def test_draws_are_the_bands(prepared, tmp_path):
    rng = np.random.default_rng(0)
    errors = {
        side: rng.standard_normal((50, 1, len(KEYS))).repeat(SAMPLES, axis=1) for side in SIDES
    }
    shown = replace(prepared.results, uncertainty=Uncertainty(gait=errors))
    write_report(tmp_path, prepare(shown))
    page = (tmp_path / "gait.html").read_text("utf-8")
    assert "90 % of the draws" in page
    assert "line edge right" in page
    assert "(" in page.split("Gait profile score of")[1][:120]


def test_moments_of_feet_off_plates_are_left_out(data, prepared):
    home = data("opensim-gait-subject01") / "ref_id"
    model = prepared.results.model
    motion = prepared.results.kinematics.motion
    strides = prepared.strides
    motion = differentiate(motion, cutoff=6.0)
    wrenches = read_external_loads(home / "subject01_walk1_grf.xml")
    torques = inverse_dynamics(model, motion, resample_wrenches(wrenches, motion.time, cutoff=6.0))
    with_plates = gait_curves(model, motion, strides, torques, wrenches)
    ankle = KEYS.index("ankle_moment")
    power = KEYS.index("ankle_power")
    for side in SIDES:
        moment = with_plates.mean(side)[:, ankle]
        if np.isfinite(moment).any():
            assert 1.0 < np.nanmax(moment) < 2.2
            assert 40.0 < 2.0 * np.nanargmax(moment) < 60.0
            assert np.nanmax(with_plates.mean(side)[:, power]) > 1.0
    assert (
        np.isfinite(with_plates.mean("right")[:, ankle]).any()
        or np.isfinite(with_plates.mean("left")[:, ankle]).any()
    )
    without = gait_curves(model, motion, strides, torques)
    assert not np.isfinite(without.right.values[..., ANGLES:]).any()
