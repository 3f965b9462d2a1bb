"""Two sessions on one page: differences as they were made, and what is said of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from made_walker import recording, walker
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.trc import write_trc
from myomorph.core.model.errors import BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.analysis.cycles import Cycles
from myomorph.lab.analysis.gait_curves import KEYS, SAMPLES, SIDES, VARIABLES, GaitCurves
from myomorph.lab.analysis.gait_parameters import UNITS
from myomorph.lab.analysis.stride_spread import StrideSpread
from myomorph.lab.analysis.strides import Stride
from myomorph.lab.cli import main
from myomorph.lab.report.trial.comparison.comparison_page import comparison_page, stricter
from myomorph.lab.report.trial.comparison.session_difference import session_differences
from myomorph.lab.report.trial.comparison.walk_session import WalkSession
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.trial.comparing import compare_folders

STUDY = """
[study]
name = "two"
[[subject]]
name = "s"
model = "walker.osim"
mass = 60
trials = ["before.trc", "after.trc"]
steps = ["ik", "id"]
"""


def stride(side, start):
    return Stride(
        limb=side,
        start=start,
        lift=start + 0.6,
        stop=start + 1.0,
        length=1.3,
        width=0.1,
        seen=1.0,
        source="plates",
    )


def session(name, count, shift=0.0, sd=2.0, seed=0):
    """Make a session whose right knee bends to 60 degrees and more, with a known spread."""
    rng = np.random.default_rng(seed)
    shape = np.sin(np.linspace(0.0, np.pi, SAMPLES)) ** 2
    cycles = {}
    for side in SIDES:
        values = np.full((count, SAMPLES, len(KEYS)), np.nan)
        sizes = 60.0 + (shift if side == "right" else 0.0) + rng.normal(0.0, sd, count)
        values[:, :, KEYS.index("knee_flexion")] = sizes[:, None] * shape
        moments = 1.0 + (0.02 * shift) + rng.normal(0.0, 0.02, count)
        values[:, :, KEYS.index("ankle_moment")] = moments[:, None] * shape
        cycles[side] = Cycles(KEYS, values)
    strides = {side: tuple(stride(side, float(k)) for k in range(count)) for side in SIDES}
    speed = StrideSpread(mean=1.2, sd=0.05, low=1.1, high=1.3, count=count)
    parameters = {name: FrozenMap({}) for name in UNITS} | {
        "Walking speed": FrozenMap(dict.fromkeys(SIDES, speed))
    }
    return WalkSession(
        name=name,
        facts=FrozenMap({"Person": "s01"}),
        curves=GaitCurves(cycles["right"], cycles["left"], strides),
        parameters=FrozenMap(parameters),
        use="everything",
    )


def knees(first, second):
    found = session_differences(first, second, VARIABLES)
    return {each.side: each for each in found if each.quantity == "Knee flexion, largest"}


def test_a_difference_is_the_one_that_was_made():
    found = knees(session("before", 40), session("after", 40, shift=12.0, seed=1))
    assert found["right"].difference == pytest.approx(12.0, abs=1.5)
    assert found["right"].spread == pytest.approx(2.0, rel=0.3)
    assert found["right"].is_larger
    assert found["left"].difference == pytest.approx(0.0, abs=1.5)
    assert not found["left"].is_larger


def test_five_degrees_and_the_spread_must_both_be_exceeded():
    small = knees(session("a", 40, sd=0.3), session("b", 40, shift=4.0, sd=0.3, seed=1))
    assert small["right"].is_larger is False
    wide = knees(session("a", 40, sd=15.0), session("b", 40, shift=7.0, sd=15.0, seed=1))
    assert abs(wide["right"].difference) < wide["right"].spread
    assert wide["right"].is_larger is False


def test_moments_are_held_against_a_tenth_and_parameters_against_their_spread():
    found = session_differences(session("a", 20), session("b", 20, shift=10.0, seed=1), VARIABLES)
    moment = next(each for each in found if each.quantity.startswith("Ankle plantarflexion moment"))
    assert moment.limit == pytest.approx(0.12, abs=0.01)
    assert moment.is_larger
    speed = next(each for each in found if each.quantity == "Walking speed")
    assert (speed.limit, speed.is_larger) == (0.0, False)


@pytest.mark.parametrize("count", [1, 4])
def test_of_few_strides_nothing_is_said(count):
    found = knees(session("a", count), session("b", 40, shift=30.0, seed=1))
    assert found["right"].is_larger is None
    page = comparison_page(session("a", count), session("b", 40, shift=30.0))
    assert "few strides</td>" in page
    assert "Too few strides to say" in page
    assert "Larger than spread and limit</h2>" not in page


def test_the_page_has_both_sessions_on_the_same_axes():
    page = comparison_page(session("barefoot", 12), session("orthosis", 6, shift=12.0, seed=1))
    for words in ("Mean of 24 strides: 12 right, 12 left", "Knee flexion, right", "orthosis"):
        assert words in page
    assert page.count('data-range="0 100 -20 80"') == 2
    assert page.count('class="band first"') == 4
    assert page.count('class="band right"') == 2
    first_table = page.split("Larger than spread and limit</h2>")[1].split("</table>")[0]
    assert "Knee flexion, largest" in first_table
    assert "Walking speed" not in first_table


def test_nothing_is_compared_that_a_verdict_excludes():
    assert stricter("everything", "angles") == "angles"
    angles = replace(session("b", 12, shift=12.0), use="angles")
    page = comparison_page(session("a", 12), angles)
    assert "Usable for angles only" in page
    assert "moment" not in page.split("Larger: than")[0]
    nothing = comparison_page(session("a", 12), replace(angles, use="nothing"))
    assert "<svg" not in nothing
    assert "Walking speed" not in nothing


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Make results of two recordings of a made walker."""
    home = tmp_path_factory.mktemp("sessions")
    write_osim(walker(), home / "walker.osim")
    for seed, name in enumerate(("before", "after")):
        write_trc(recording(walker(), np.random.default_rng(seed), 0.5), home / f"{name}.trc")
    (home / "study.toml").write_text(STUDY)
    outcomes = run_study(read_plan(home / "study.toml"), home / "out")
    assert [outcome.error for outcome in outcomes] == ["", ""]
    return home / "out" / "s"


def test_a_command_compares_two_folders(results, tmp_path, capsys):
    out = tmp_path / "compare.html"
    assert main(["report", str(results / "before"), str(results / "after"), "--out", str(out)]) == 0
    page = out.read_text("utf-8")
    assert "<h1>before and after</h1>" in page
    assert "s: before" in page
    assert str(out) in capsys.readouterr().out


def test_what_cannot_be_compared_is_said(results, tmp_path, capsys):
    with pytest.raises(BadFile, match="given twice"):
        compare_folders(results / "before", results / "before", tmp_path / "c.html")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadFile, match="holds no results"):
        compare_folders(results / "before", tmp_path / "empty", tmp_path / "c.html")
    with pytest.raises(BadFile, match=r"ends in \.html"):
        compare_folders(results / "before", results / "after", tmp_path / "c.pdf")
    three = [str(results / "before")] * 3
    assert main(["report", *three]) == 2
    assert "3 folders" in capsys.readouterr().err
    assert main(["report", str(results / "before"), "--out", "x.html"]) == 2
