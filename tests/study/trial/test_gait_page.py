"""The page for the clinic.

It is written next to the report of a walk, compared with the requested norm.
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
from myomorph.lab.analysis.gait_curves import ANGLES, KEYS, SAMPLES, SIDES, WalkLoads, gait_curves
from myomorph.lab.analysis.gait_scores import gait_scores
from myomorph.lab.report.page.parts import PageHead
from myomorph.lab.report.trial.gait.gait_notes import score_notes
from myomorph.lab.report.trial.prepared import prepare
from myomorph.lab.report.trial.report_input import Kinematics, ReportInput
from myomorph.lab.study.trial.control_group import ControlPerson, group_norm
from myomorph.lab.study.trial.gait_norms import (
    GaitNorms,
    adult_norm,
    checked_norms,
    norm_of,
    walker_of,
)
from myomorph.lab.study.trial.norm_file import read_norms, write_norm
from myomorph.lab.study.trial.reporting import write_report
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
    assert norm.ages == (30.0, 39.0)


def test_a_walk_has_its_page_and_the_report_leads_to_it(prepared, tmp_path):
    write_report(tmp_path, prepared)
    page = (tmp_path / "gait.html").read_text("utf-8")
    report = (tmp_path / "report.html").read_text("utf-8")
    assert 'href="gait.html"' in report
    for words in (
        "Knee flexion",
        "Walking speed",
        "Root mean square of 5 angles",
        "CC BY 4.0",
        "No scaled score",
    ):
        assert words in page
    # Neither offsets nor nine angles are in it.
    assert "Gait profile score" not in page
    assert "Movement analysis profile" not in page
    assert page.count("<svg") == ANGLES
    write_report(tmp_path, prepared, GaitNorms(("none",)))
    assert "Difference from the norm" not in (tmp_path / "gait.html").read_text("utf-8")


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
    walker = walker_of(prepared)
    child = replace(walker, stature=1.1)
    norm, note = norm_of(GaitNorms(), child)
    assert norm is None
    assert "about 1.10 m" in note
    assert norm_of(GaitNorms(("adults",)), child).norm is adult_norm()
    assert norm_of(GaitNorms(), walker).norm is adult_norm()


def test_a_norm_is_of_the_age_and_the_speed(prepared):
    walker = replace(walker_of(prepared), speed=1.25)
    for age, group in ((25.0, "18 to 29"), (39.9, "30 to 39"), (80.0, "70 years")):
        assert group in norm_of(GaitNorms(), replace(walker, age=age)).norm.group
    for age in (8.0, 99.0):
        norm, note = norm_of(GaitNorms(), replace(walker, age=age))
        assert norm is None
        assert f"{age:g} years, and the norm is of 18 to 91 years" in note
    slow = replace(walker, age=35.0, speed=0.6)
    norm, note = norm_of(GaitNorms(), slow)
    assert norm is None
    assert "0.60 m/s, and the norm is of 0.95 to 1.60 m/s" in note
    norm, note = norm_of(GaitNorms(("adults",)), slow)
    assert norm is adult_norm()
    assert "does not fit" in note
    assert norm_of(GaitNorms(("none",)), walker).norm is None


def test_a_group_of_parameters_alone_has_no_band_and_no_scores(prepared, tmp_path):
    young = replace(prepared.results, recorded=replace(prepared.results.recorded, age=25.0))
    write_report(tmp_path, prepare(young))
    page = (tmp_path / "gait.html").read_text("utf-8")
    assert "adults of 18 to 29 years" in page
    assert "No norm of curves" in page
    assert 'class="band norm"' not in page
    assert "Gait profile score" not in page
    assert "1.36\u00a0±\u00a00.138" in page


def person(curves, speed, age):
    return ControlPerson(curves=curves, parameters={"Walking speed": speed}, age=age)


def test_controls_are_a_norm_without_the_patient(prepared):
    walker = replace(walker_of(prepared), age=33.0, speed=1.2)
    people = {name: person(prepared.gait, 1.1 + 0.1 * k, 30.0 + k) for k, name in enumerate("abcd")}
    norms = GaitNorms(("controls",), controls=people)
    norm, note = norm_of(norms, replace(walker, person="d", age=31.0))
    assert norm.persons == 3
    assert note == ""
    legs = np.stack([prepared.gait.mean(side)[:, :ANGLES] for side in SIDES])
    np.testing.assert_allclose(norm.mean[:, :ANGLES], legs.mean(axis=0))
    assert norm.parameters["Walking speed"] == pytest.approx((1.2, 0.1))
    assert norm.ages == (30.0, 32.0)
    assert norm_of(norms, replace(walker, person="d", age=50.0)).norm is None
    few = GaitNorms(("controls",), controls={name: people[name] for name in "abc"})
    with pytest.raises(BadData, match="2 persons"):
        norm_of(few, replace(walker, person="c"))


def test_a_file_of_norms_comes_back_as_it_was(prepared, tmp_path):
    people = [person(prepared.gait, 1.1 + 0.1 * k, 30.0 + k) for k in range(5)]
    norm = group_norm(people, "own control group: a, b")
    write_norm(tmp_path / "controls.csv", norm)
    (again,) = read_norms(tmp_path / "controls.csv")
    np.testing.assert_allclose(again.mean, norm.mean, rtol=1e-7)
    np.testing.assert_allclose(again.deviation, norm.deviation, rtol=1e-7, atol=1e-12)
    assert again.source == norm.source
    assert again.same_definitions
    assert again.persons == 5
    assert again.scale is not None
    np.testing.assert_allclose(again.scale.side, norm.scale.side, rtol=1e-7)
    np.testing.assert_allclose(again.scale.both, norm.scale.both, rtol=1e-7)
    assert (again.ages, again.speeds) == (norm.ages, pytest.approx(norm.speeds))
    assert again.parameters["Walking speed"] == pytest.approx(norm.parameters["Walking speed"])
    write_norm(tmp_path / "again.csv", again)
    assert (tmp_path / "again.csv").read_text() == (tmp_path / "controls.csv").read_text()


def test_a_broken_file_of_norms_is_refused_with_its_row(tmp_path):
    path = tmp_path / "norm.csv"
    head = "group,variable,percent,mean,sd,n,low,high\n"
    for text, words in (
        ("a,b\n1,2\n", "no column 'group'"),
        (f"{head}g,knee_flexon,0,1,1,,,\n", "unknown variable 'knee_flexon'"),
        (f"{head}g,knee_flexion,0,x,1,,,\n", "row 1"),
        (f"{head}g,knee_flexion,140,1,1,,,\n", "between 0 and 100"),
    ):
        path.write_text(text)
        with pytest.raises(BadFile, match=words):
            read_norms(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadFile, match="cannot be read"):
        read_norms(path)


def test_a_scale_of_mean_curves_is_left_out_and_says_why(prepared, tmp_path):
    norm = group_norm([person(prepared.gait, 1.1 + 0.1 * k, 30.0) for k in range(5)], "group")
    path = tmp_path / "controls.csv"
    write_norm(path, norm)
    lines = path.read_text("utf-8").splitlines(keepends=True)
    older = [line for line in lines if "both sides" not in line]
    path.write_text("".join(older).replace("ln stride score", "ln score"), encoding="utf-8")
    (old,) = read_norms(path)
    assert old.scale is None
    assert old.old_scale
    scores = gait_scores(prepared.gait, old)
    assert "myomorph norms" in score_notes(scores, old)[0]


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
    assert "(" in page.split("Root mean square of")[1][:120]


def test_moments_of_feet_off_plates_are_left_out(data, prepared):
    home = data("opensim-gait-subject01") / "ref_id"
    model = prepared.results.model
    motion = prepared.results.kinematics.motion
    strides = prepared.strides
    motion = differentiate(motion, cutoff=6.0)
    wrenches = read_external_loads(home / "subject01_walk1_grf.xml")
    torques = inverse_dynamics(model, motion, resample_wrenches(wrenches, motion.time, cutoff=6.0))
    with_plates = gait_curves(model, motion, strides, WalkLoads(torques=torques, wrenches=wrenches))
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
    without = gait_curves(model, motion, strides, WalkLoads(torques=torques))
    assert not np.isfinite(without.right.values[..., ANGLES:]).any()
