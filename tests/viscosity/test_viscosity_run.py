"""A specimen that fails is named and the rest of the cohort is done.

Files are whole and the report opens.
"""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from myomorph.core.model.errors import BadData, BadFile
from myomorph.lab.cli.program import main
from myomorph.lab.study.run.dry_run import dry_run
from myomorph.swings.viscosity.cohort import SPECIMENS
from myomorph.swings.viscosity.report.specimen_report import specimen_report
from myomorph.swings.viscosity.study import specimen_step
from myomorph.swings.viscosity.study.options import StudyOptions
from myomorph.swings.viscosity.study.plan import read_viscosity_plan
from myomorph.swings.viscosity.study.results import read_store
from myomorph.swings.viscosity.study.run import graph_of, run_viscosity
from myomorph.swings.viscosity.study.specimen import Studied
from swing_cohort import specimens


@pytest.fixture
def study(tmp_path):
    """Make a study of four specimens whose files are empty."""
    for name in ("arm.osim", "a.trc", "a.mot", "b.trc", "b.mot"):
        (tmp_path / name).write_text("")
    tables = [
        f'[[specimen]]\nname = "{one.name}"\nmodel = "arm.osim"\nremoved = ["a.trc"]\nintact ='
        ' ["b.trc"]\n'
        for one in SPECIMENS[:4]
    ]
    text = (
        '[study]\nname = "four shoulders"\n'
        + "".join(tables)
        + "[options.identification]\ndraws = 7\n"
    )
    path = tmp_path / "shoulder.toml"
    path.write_text(text)
    return path


@pytest.fixture
def studied(monkeypatch):
    """Specimen 02 fails by its input, 03 by a fault of ours."""
    known = {one.name: one for one in specimens()}

    def study_specimen(files, options, advance):
        assert options.identification.draws == 7
        advance(0.4)
        if files.name == "02":
            raise BadData("a wire slipped:\n the elbow turns")
        if files.name == "03":
            raise ZeroDivisionError("by nothing")
        return Studied(known[files.name], specimen_report(known[files.name]))

    monkeypatch.setattr(specimen_step, "study_specimen", study_specimen)


def rows(path):
    with path.open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.usefixtures("studied")
def test_the_rest_of_the_cohort_is_done(study, tmp_path):
    out = tmp_path / "out"
    seen = []
    outcomes = run_viscosity(read_viscosity_plan(study), out, seen.append)
    assert outcomes == seen
    assert [bool(outcome.error) for outcome in outcomes] == [False, True, True, False]
    assert [outcome.fault for outcome in outcomes] == [False, False, True, False]
    assert [row["name"] for row in rows(out / "specimens.csv")] == ["01", "04"]
    mean = np.mean([SPECIMENS[0].total_viscosity, SPECIMENS[3].total_viscosity])
    cohort = {row["quantity"]: row for row in rows(out / "cohort.csv")}
    assert float(cohort["total_viscosity"]["mean"]) == pytest.approx(mean)
    assert cohort["total_viscosity"]["n"] == "2"
    failed = [row for row in rows(out / "notes.csv") if row["kind"] == "failed"]
    assert [row["text"] for row in failed] == [
        "a wire slipped: the elbow turns",
        "ZeroDivisionError: by nothing",
    ]
    page = (out / "report.html").read_text()
    assert "Specimen 02 could not be done: a wire slipped" in page
    assert "four shoulders" in page
    assert (out / "01" / "with_swing1.sto").is_file()
    assert not list(out.rglob(".*"))


@pytest.mark.usefixtures("studied")
def test_provenance_tells_inputs_and_options(study, tmp_path):
    run_viscosity(read_viscosity_plan(study), tmp_path / "out")
    made = json.loads((tmp_path / "out" / "01" / "provenance.json").read_text())
    assert made["options"]["identification.draws"] == 7
    roles = {source["role"] for source in made["sources"]}
    assert roles == {
        "result",
        "model",
        "markers without muscles",
        "loads without muscles",
        "markers with muscles",
        "loads with muscles",
    }


@pytest.mark.usefixtures("studied")
def test_a_second_run_reuses_what_has_not_changed(study, tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    out = tmp_path / "out"
    run_viscosity(read_viscosity_plan(study), out)
    of_a_run = ("study.log", "study.json", "timings.csv", "results.csv")
    before = {
        path: path.read_bytes()
        for path in out.rglob("*")
        if path.is_file() and path.name not in of_a_run
    }
    looked = {
        row.work.key[0]: row for row in dry_run(graph_of(read_viscosity_plan(study), out), out).rows
    }
    assert looked["01"].reused == ("viscosity",)
    assert looked["02"].computed == ("viscosity",)
    again = run_viscosity(read_viscosity_plan(study), out)
    assert [outcome.reused for outcome in again] == [("viscosity",), (), (), ("viscosity",)]
    assert {path: path.read_bytes() for path in before} == before

    (tmp_path / "b.mot").write_text("\n")
    changed = dry_run(graph_of(read_viscosity_plan(study), out), out).rows[0]
    assert changed.reasons["viscosity"] == ("loads with muscles b.mot has changed",)
    study.write_text(
        study.read_text().replace('name = "01"', 'name = "01"\ntruth = { joint_viscosity = 0.1 }')
    )
    (tmp_path / "b.mot").write_text("")
    outcome = run_viscosity(read_viscosity_plan(study), out)[0]
    # What a value is held against does not change how it is found, but the page shows it.
    assert outcome.reused == ("viscosity",)
    assert read_store(out).specimens[0].truth["joint_viscosity"] == 0.1


@pytest.mark.usefixtures("studied")
def test_a_dry_run_and_its_command_compute_nothing(study, tmp_path, capsys):
    assert (
        main(
            ["viscosity", str(study), "--out", str(tmp_path / "out"), "--dry-run", "--workers", "1"]
        )
        == 0
    )
    said = capsys.readouterr().out
    assert "four shoulders" in said
    assert "time unknown: viscosity" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("studied", "in_process")
def test_the_command_says_who_failed_and_ends_with_2_or_1(study, tmp_path, capsys):
    status = main(["viscosity", str(study), "--out", str(tmp_path / "out")])
    told = capsys.readouterr().out
    assert status == 1  # one of the failures is a fault of ours
    assert "02: FAILED: viscosity: a wire slipped: the elbow turns" in told
    assert "joint 0.0761 (" in told
    assert "2 of 4 specimens done" in told
    study.write_text(study.read_text().replace('name = "03"', 'name = "06"'))
    assert main(["viscosity", str(study), "--out", str(tmp_path / "out")]) == 2
    assert main(["report", str(tmp_path / "out")]) == 0


def test_options_that_are_out_of_range_stop_before_anything_is_written(study, tmp_path):
    study.write_text(study.read_text().replace("draws = 7", "draws = 0"))
    with pytest.raises(BadData, match="draws from 2"):
        run_viscosity(read_viscosity_plan(study), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_options_come_from_their_tables():
    options = StudyOptions.of({"filter": {"cutoff": 6.0}, "moment_arms": {"factor": 0.2}})
    assert (options.filter.cutoff, options.moment_arms.factor) == (6.0, 0.2)
    assert options.identification == StudyOptions().identification
    assert options.plain["filter"] == {"cutoff": 6.0}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work in a folder that has a recording without forces."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lone.trc").write_text("")
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give a study file, or --model with --intact and --removed"),
        (["STUDY", "--model", "arm.osim"], "but not both"),
        (["STUDY", "--draws", "20"], "--draws is for --model: write it into the table [options]"),
        (["--model", "none.osim", "--intact", "b.trc"], "none.osim: does not exist"),
        (["--model", "arm.osim"], "no recordings: give --intact and --removed"),
        (
            ["--model", "arm.osim", "--intact", "b.trc", "--intact-loads", "a.mot", "b.mot"],
            "1 recordings but 2 files",
        ),
        (
            ["--model", "arm.osim", "--removed", "lone.trc"],
            "lone.trc: has no forces beside it; give --removed-loads",
        ),
    ],
)
def test_what_is_wrong_is_one_line_and_status_2(arguments, message, study, folder, capsys):
    arguments = [str(study) if one == "STUDY" else one for one in arguments]
    assert main(["viscosity", *arguments, "--out", "out"]) == 2
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1
    assert message in printed
    assert not (folder / "out").exists()


def test_files_that_cannot_be_read_are_named_specimen_by_specimen(study, tmp_path):
    outcomes = run_viscosity(
        read_viscosity_plan(_with(study, "draws = 7", "draws = 20")), tmp_path / "out"
    )
    assert all(outcome.error for outcome in outcomes)
    assert "a.trc" in outcomes[0].error
    assert rows(tmp_path / "out" / "specimens.csv") == []
    with pytest.raises(BadFile, match="no such file"):
        read_viscosity_plan(tmp_path / "none.toml")


def _with(study, old, new):
    study.write_text(study.read_text().replace(old, new))
    return study
