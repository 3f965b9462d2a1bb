"""The tables of a study and its page.

All trials, in the order of the study file, whatever became of them.
"""

from __future__ import annotations

import csv
import shutil
from collections import defaultdict
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest

from made_walker import recording, walker
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.trc import write_trc
from myomorph.core.model.series import Series
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.summary import study_tables
from myomorph.lab.study.summary.condition_values import GrowingCondition, RunningMeans, described
from myomorph.lab.study.summary.study_tables import FILES, PAGE, SignSearch, gather_study
from myomorph.lab.study.trial.tidy import OF_STRIDE, OF_TRIAL, STRIDE_COLUMNS
from myomorph.lab.study.trial.trial_inputs import Value

NUMBERS = ("value", *STRIDE_COLUMNS)
SUBJECT = """[[subject]]
name = "{0}"
model = "walker.osim"
trials = ["{0}/walk_*.trc"]
steps = ["ik", "muscles"{1}]
"""
STUDY = """[study]
name = "slow and fast"
conditions = {slow = ["walk_slow*"], fast = ["walk_fast*"]}
[[exclude]]
subject = "S3"
trial = "walk_slow1"
reason = "stumbled"
"""
OWN = {"S1": -0.05, "S2": 0.0, "S3": 0.04, "S4": 0.08}


def table(path):
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Make four subjects twice slow and twice fast.

    One recording is broken, one is left out, in one the knee bends far.
    """
    home = tmp_path_factory.mktemp("study")
    write_osim(walker(), home / "walker.osim")
    rng = np.random.default_rng(7)
    text = STUDY
    for name, own in OWN.items():
        (home / name).mkdir()
        for condition, extra in (("slow", 0.2), ("fast", 0.5)):
            for k in (1, 2):
                far = 0.5 if (name, condition, k) == ("S2", "fast", 2) else 0.0
                bend = extra + own + far + 0.02 * rng.standard_normal()
                write_trc(recording(walker(), rng, bend), home / name / f"walk_{condition}{k}.trc")
        text += SUBJECT.format(name, ', "report"' if name == "S1" else "")
    (home / "S4" / "walk_fast1.trc").write_text("rubbish")
    (home / "study.toml").write_text(text)
    plan = read_plan(home / "study.toml")
    outcomes = run_study(plan, home / "out")
    return SimpleNamespace(plan=plan, outcomes=outcomes, out=home / "out")


def _number(cell):
    return float(cell) if cell else None


def test_all_values_in_one_table(study):
    rows = table(study.out / "results_tidy.csv")
    assert list(rows[0]) == [
        "subject",
        "condition",
        "trial",
        "step",
        "quantity",
        "value",
        "unit",
        "low",
        "high",
        "sd",
        *STRIDE_COLUMNS,
    ]
    trials = list(dict.fromkeys((row["subject"], row["trial"]) for row in rows))
    assert trials == [(one.subject, one.trial) for one in study.outcomes if not one.error]
    assert {(row["condition"], row["trial"][5:9]) for row in rows} == {
        ("slow", "slow"),
        ("fast", "fast"),
    }
    own = table(study.out / "S1" / "walk_fast1" / "values.csv")
    mine = [row for row in rows if (row["subject"], row["trial"]) == ("S1", "walk_fast1")]
    assert [(row["quantity"], row["value"]) for row in mine] == [
        (row["quantity"], row["value"]) for row in own
    ]
    whole = pq.read_table(study.out / "results.parquet")
    assert whole.column_names == list(rows[0])
    for name in whole.column_names:
        if name in ("low", "high", "sd"):
            # Nothing was drawn.
            assert np.isnan(whole[name].to_numpy()).all()
            assert {row[name] for row in rows} == {""}
            continue
        told = [_number(row[name]) if name in NUMBERS else row[name] for row in rows]
        assert whole[name].to_pylist() == told


def test_what_failed_and_what_was_left_out_is_told(study):
    rows = table(study.out / "quality.csv")
    (failed,) = [row for row in rows if row["state"] == "failed"]
    assert (failed["subject"], failed["trial"], failed["condition"]) == ("S4", "walk_fast1", "fast")
    assert "walk_fast1.trc" in failed["detail"]
    (left,) = [row for row in rows if row["state"] == "left out"]
    assert (left["subject"], left["trial"], left["detail"]) == ("S3", "walk_slow1", "stumbled")
    judged = [row for row in rows if row["quantity"] == "Marker error, largest"]
    assert len(judged) == 14
    page = (study.out / PAGE).read_text(encoding="utf-8")
    assert "stumbled" in page
    assert "14 done, 1 failed, 1 left out" in page


def test_conditions_are_means_of_subjects(study):
    """Each subject counts once, however many of its trials went well."""
    quantity = "knee_angle_r, range in a stride"
    trials = defaultdict(list)
    for row in table(study.out / "results_tidy.csv"):
        if row["quantity"] == quantity:
            trials[row["condition"], row["subject"]].append(float(row["value"]))
    rows = {
        row["condition"]: row
        for row in table(study.out / "condition_values.csv")
        if row["quantity"] == quantity
    }
    for condition in ("slow", "fast"):
        means = [np.mean(trials[condition, subject]) for subject in OWN]
        row = rows[condition]
        np.testing.assert_allclose(
            (float(row["mean"]), float(row["sd"])), (np.mean(means), np.std(means, ddof=1))
        )
        assert (row["n"], row["of"], row["unit"]) == ("4", "subjects", "deg")


def test_curves_of_conditions(study):
    rows = [
        row for row in table(study.out / "condition_curves.csv") if row["curve"] == "knee_angle_r"
    ]
    assert [float(row["percent"]) for row in rows if row["condition"] == "slow"] == list(
        np.arange(101.0)
    )
    assert {(row["kind"], row["cycle"], row["of"]) for row in rows} == {
        ("joint angle [°]", "stride", "subjects")
    }
    # By hand at one percent, from the trials' own curves.
    column = "joint angle: knee_angle_r [°]"
    means = []
    for subject in OWN:
        own = sorted((study.out / subject).glob("walk_fast*/curves.csv"))
        means.append(np.mean([float(table(path)[70][column]) for path in own]))
    (row,) = [row for row in rows if (row["condition"], row["percent"]) == ("fast", "70")]
    np.testing.assert_allclose(float(row["mean"]), np.mean(means), rtol=1e-6)
    np.testing.assert_allclose(float(row["sd"]), np.std(means, ddof=1), rtol=1e-6)


def test_conditions_are_compared_within_subjects(study):
    rows = table(study.out / "differences.csv")
    assert {(row["first"], row["second"], row["paired"]) for row in rows} == {
        ("slow", "fast", "yes")
    }
    (knee,) = [row for row in rows if row["name"] == "knee_angle_l"]
    assert 50.0 < float(knee["percent"]) < 95.0
    # The knee bends by 0.3 rad more, by half a radian more in one of the fourteen.
    assert 10.0 < float(knee["difference"]) < 35.0
    assert float(knee["p_corrected"]) >= 2 / 16


def test_a_trial_unlike_the_others_is_named(study):
    rows = table(study.out / "outliers.csv")
    bent = [row for row in rows if row["quantity"] == "knee_angle_r, range in a stride"]
    assert [(row["subject"], row["trial"]) for row in bent] == [("S2", "walk_fast2")]
    assert float(bent[0]["score"]) > 3.5
    assert any(
        "distance of its curve" in row["quantity"] and row["trial"] == "walk_fast2" for row in rows
    )
    assert "walk_fast2" in (study.out / PAGE).read_text(encoding="utf-8").split('id="outliers"')[1]


class _Links(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.places = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.places += [value for name, value in attributes if tag == "a" and name == "href"]


def test_links_of_the_page_lead_somewhere(study):
    places = _Links((study.out / PAGE).read_text(encoding="utf-8")).places
    beside = [one for one in places if not one.startswith(("#", "https:"))]
    assert sum(one.endswith("/report.html") for one in beside) == 4
    assert {name for name, _ in FILES} <= set(beside)
    for one in beside:
        assert (study.out / one).is_file(), one


def test_the_order_in_which_trials_ended_does_not_matter(study, tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    found = []
    for k, outcomes in enumerate((study.outcomes, study.outcomes[::-1])):
        out = tmp_path / str(k)
        shutil.copytree(study.out, out)
        moved = [replace(one, folder=out / one.folder.relative_to(study.out)) for one in outcomes]
        gather_study(study.plan, moved, out, out)
        found.append(
            {name: (out / name).read_bytes() for name in (PAGE, *(name for name, _ in FILES))}
        )
        assert not list(out.glob(".*"))
    assert found[0] == found[1]


def test_changes_since_the_last_run_are_told(study, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(study.out, out)
    told = [
        replace(
            one, folder=out / one.folder.relative_to(study.out), changed=("ik.accuracy: 1 -> 2",)
        )
        for one in study.outcomes
    ]
    gather_study(study.plan, told, out, out)
    page = (out / PAGE).read_text(encoding="utf-8")
    assert "Changes since the last run" in page
    assert "ik.accuracy: 1 -&gt; 2" in page
    assert "S1, walk_fast1" in page
    assert "Changes since the last run" not in (study.out / PAGE).read_text(encoding="utf-8")


def test_a_study_of_which_nothing_went_well(tmp_path):
    write_osim(walker(), tmp_path / "walker.osim")
    (tmp_path / "walk.trc").write_text("rubbish")
    (tmp_path / "study.toml").write_text(
        '[study]\nname = "nothing"\n[[subject]]\nname = "s"\nmodel = "walker.osim"\n'
        'trials = ["walk.trc"]\nsteps = ["ik"]\n'
    )
    outcomes = run_study(read_plan(tmp_path / "study.toml"), tmp_path / "out")
    assert [bool(one.error) for one in outcomes] == [True]
    assert table(tmp_path / "out" / "results_tidy.csv") == []
    assert pq.read_table(tmp_path / "out" / "results.parquet").num_rows == 0
    assert "0 done, 1 failed" in (tmp_path / "out" / PAGE).read_text(encoding="utf-8")


def test_running_means_are_those_of_numpy():
    rng = np.random.default_rng(0)
    running = RunningMeans(101)
    whole = []
    names = [("angle", "a"), ("angle", "b"), ("torque", "a")]
    for k in range(12):
        if k < 3:
            own = [0, 1]
        elif k % 2:
            own = [2, 0]
        else:
            own = [0, 1, 2]
        values = 1e3 + rng.standard_normal((101, len(own)))
        values[rng.random(values.shape) < 0.1] = np.nan
        running.add(tuple(names[j] for j in own), values)
        row = np.full((101, 3), np.nan)
        row[:, own] = values
        whole.append(row)
    order = [running.columns[name] for name in names]
    np.testing.assert_allclose(running.mean[:, order], np.nanmean(whole, axis=0), rtol=1e-12)
    np.testing.assert_array_equal(running.count[:, order], np.isfinite(whole).sum(axis=0))
    np.testing.assert_allclose(
        running.squares[:, order],
        np.nanvar(whole, axis=0) * np.isfinite(whole).sum(axis=0),
        rtol=1e-9,
    )


def test_a_condition_does_not_mix_strides_with_whole_trials():
    percent = np.linspace(0.0, 100.0, 101)

    def curves(height):
        return {
            "joint angle [°]": Series(
                percent, ("knee",), (height * np.sin(percent / 10.0))[:, None]
            )
        }

    values = [Value(step="ik", quantity="duration", value=1.0, unit="s")]
    growing = GrowingCondition("slow")
    growing.add("s1", "stands", values, OF_TRIAL, curves(100.0))
    growing.add("s1", "walks", values, OF_STRIDE, curves(1.0))
    growing.add("s2", "walks", values, OF_STRIDE, curves(3.0))
    growing.add("s2", "turns", values, OF_TRIAL, curves(100.0))
    found = growing.finished(of_subjects=True)
    assert (found.cycle, found.unit, found.trials) == ("stride", "subjects", 4)
    np.testing.assert_allclose(
        found.curves["joint angle [°]"].mean[:, 0], 2.0 * np.sin(percent / 10.0), atol=1e-12
    )
    assert len(growing.notes) == 2
    assert "s2, turns" in growing.notes[1]


def test_the_unit_is_the_same_in_all_conditions_of_a_study():
    slow = GrowingCondition("slow")
    fast = GrowingCondition("fast")
    for condition, subject, trial, seconds in (
        (slow, "s1", "a", 1.0),
        (slow, "s2", "a", 3.0),
        (fast, "s1", "b", 5.0),
    ):
        condition.add(
            subject,
            trial,
            [Value(step="ik", quantity="duration", value=seconds, unit="s")],
            OF_TRIAL,
            {},
        )
    fast.add("s1", "c", [Value(step="ik", quantity="duration", value=7.0, unit="s")], OF_TRIAL, {})
    means = described([slow, fast])[0].conditions
    assert means[0] == pytest.approx((2.0, np.sqrt(2.0), 2))
    assert means[1] == pytest.approx((6.0, np.nan, 1), nan_ok=True)
    assert described([fast])[0].conditions[0] == pytest.approx((6.0, np.sqrt(2.0), 2))


def test_angles_that_models_count_the_other_way_round_are_noted():
    def angle(name, least, most):
        return [
            Value(step="ik", quantity=f"{name}, minimum", value=least, unit="deg"),
            Value(step="ik", quantity=f"{name}, maximum", value=most, unit="deg"),
        ]

    search = SignSearch()
    search.add("s1", angle("knee_angle_r", 2.0, 70.0) + angle("hip_flexion_r", -20.0, 40.0))
    search.add("s2", angle("knee_angle_r", -5.0, 65.0) + angle("hip_flexion_r", -30.0, 0.0))
    assert search.notes() == []
    search.add("s3", angle("knee_angle_r", -68.0, 1.0))
    assert search.notes()[0].startswith(
        "knee_angle_r: above zero in s1, s2, below it in s3: if their models"
    )


def test_without_the_extra_parquet_the_tables_are_csv_alone(study, tmp_path, monkeypatch):
    """An older file of that name goes: it would hold other values than the tables beside it."""
    monkeypatch.setattr(study_tables, "has_parquet", lambda: False)
    older = tmp_path / "results.parquet"
    older.write_text("older")
    gather_study(study.plan, study.outcomes, tmp_path, tmp_path)
    assert not older.exists()
    assert (tmp_path / PAGE).is_file()
