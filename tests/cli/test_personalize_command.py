"""`myomorph personalize`: the model it writes and its tables.

Also its messages on bad input, and the step of a study.
"""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from identified_arm import put_on_plate
from myomorph.core.io.formats import read_model
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import read_sto, write_sto
from myomorph.core.model.errors import BadFile
from myomorph.core.model.series import Table
from myomorph.lab.store.results import read_result
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.subject.personalizing import read_passive


@pytest.fixture
def plate(arm):
    put_on_plate(arm)
    return arm


def given(arm, *more):
    return ("personalize", "--model", arm.model, "--out", arm.folder / "own.osim", *more)


def test_muscles_from_torques_of_loads(plate, command):
    told = command(*given(plate, "--motion", plate.motion, "--loads", plate.loads, "--cutoff", 6.0))
    assert told.status == 0, told.err
    before = read_model(plate.model)
    after = read_osim(plate.folder / "own.osim")
    assert after.muscle_names == before.muscle_names
    folder = plate.folder / "own_personalization"
    assert {path.name for path in folder.iterdir()} >= {
        *(
            "personalized_muscles.csv",
            "fiber_lengths.csv",
            "notes.txt",
            "report.html",
            "provenance.json",
        ),
    }
    rows = list(csv.DictReader((folder / "personalized_muscles.csv").read_text().splitlines()))
    lengths = [row for row in rows if row["parameter"] == "optimal fiber length"]
    assert [row["muscle or group"] for row in lengths] == list(before.muscle_names)
    for row, muscle in zip(lengths, after.muscles, strict=True):
        assert float(row["person"]) == pytest.approx(muscle.optimal_fiber_length, rel=1e-5)
        assert float(row["low"]) < float(row["person"]) < float(row["high"])
        assert row["identifiable"] in ("yes", "partly", "no")
    said = told.err.splitlines()
    assert any("of the lengths, which follow the prior" in line for line in said[:4]), said
    assert all("_" not in name for name in rows[0])
    assert "Normalized fiber length" in (folder / "report.html").read_text()


def test_torques_of_a_table_give_the_same_as_loads(plate, command):
    table = plate.folder / "tau.sto"
    # The filter is stated: by default forces, which a table of torques is without, help to find it.
    filtered = ("--cutoff", 6.0)
    assert (
        command(
            "id",
            "--model",
            plate.model,
            "--motion",
            plate.motion,
            "--loads",
            plate.loads,
            *filtered,
            "--out",
            table,
        ).status
        == 0
    )
    motion = ("--motion", plate.motion, *filtered)
    assert command(*given(plate, *motion, "--loads", plate.loads)).status == 0
    first = read_osim(plate.folder / "own.osim")
    assert command(*given(plate, *motion, "--torques", table)).status == 0
    second = read_osim(plate.folder / "own.osim")
    for one, other in zip(first.muscles, second.muscles, strict=True):
        assert one.tendon_slack_length == pytest.approx(other.tendon_slack_length, rel=1e-4)


def passive_table(plate, names, *, missing=False):
    """Twelve poses, each with the torque of one joint only."""
    angles = np.column_stack([np.linspace(-30.0, 60.0, 12), np.linspace(10.0, 110.0, 12)])
    torques = np.where(np.arange(12)[:, None] % 2 == [0, 1], -0.1 * (angles - 40.0), np.nan)
    if missing:
        angles[3, 1] = np.nan
    path = plate.folder / "passive.sto"
    names = ("shoulder_flexion", "elbow_flexion", *names)
    write_sto(Table(np.arange(12.0), names, np.hstack([angles, torques]), in_degrees=True), path)
    return path


def test_measured_passive_torques_alone_serve(plate, command):
    path = passive_table(plate, ("shoulder_flexion_moment", "elbow_flexion_moment"))
    read = read_passive(path, read_model(plate.model))
    assert read.torques.names == ("shoulder_flexion", "elbow_flexion")
    assert np.isnan(read.torques.values).sum() == 12
    np.testing.assert_allclose(read.motion.values[0], np.radians([-30.0, 10.0]))
    told = command(*given(plate, "--passive", path))
    assert told.status == 0, told.err
    assert "12 frames" in told.out
    assert (plate.folder / "own.osim").exists()


def test_passive_tables_that_cannot_serve(plate, command):
    told = command(*given(plate, "--passive", passive_table(plate, ("torque_a", "torque_b"))))
    assert told.status == 2
    assert "no column is a torque: name them as 'shoulder_flexion_moment'" in " ".join(
        told.err.split()
    )
    names = ("shoulder_flexion_moment", "elbow_flexion_moment")
    told = command(*given(plate, "--passive", passive_table(plate, names, missing=True)))
    assert told.status == 2
    assert "'elbow_flexion' has no value in row 4" in " ".join(told.err.split())


def test_the_generic_model_alone_serves(plate, command):
    told = command(*given(plate, "--generic", plate.model))
    assert told.status == 0, told.err
    assert "2 muscles mapped from the generic model" in told.out
    for one, other in zip(
        read_model(plate.model).muscles, read_osim(plate.folder / "own.osim").muscles, strict=True
    ):
        assert one.optimal_fiber_length == pytest.approx(other.optimal_fiber_length, rel=1e-3)


@pytest.mark.parametrize(
    ("more", "what"),
    [
        ((), "nothing to fit muscles to"),
        (("--motion", "{motion}"), "motions without torques"),
        (
            ("--motion", "{motion}", "{motion}", "--loads", "{loads}"),
            "2 motions but 1 files of loads",
        ),
        (("--motion", "{motion}", "--loads", "{loads}", "--torques", "{loads}"), "not both"),
        (("--motion", "{motion}", "--loads", "{loads}", "--fiber-spread", "3"), "expected 0 to 1"),
    ],
)
def test_bad_input(plate, command, more, what):
    texts = [one.format(motion=plate.motion, loads=plate.loads) for one in more]
    told = command(*given(plate, *texts))
    assert told.status == 2
    assert what in " ".join(told.err.split())
    assert not (plate.folder / "own.osim").exists()


def test_torques_at_other_times_are_refused(plate, command):
    table = plate.folder / "tau.sto"
    assert (
        command(
            "id",
            "--model",
            plate.model,
            "--motion",
            plate.motion,
            "--loads",
            plate.loads,
            "--out",
            table,
        ).status
        == 0
    )
    read = read_sto(table)
    write_sto(type(read)(read.time + 100.0, read.names, read.values), table)
    told = command(*given(plate, "--motion", plate.motion, "--torques", table))
    assert told.status == 2
    assert "has times" in told.err


STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
trials = ["reach.trc"]
steps = ["ik", "personalize", "tension"]
"""


def test_a_study_uses_the_person_s_muscles(plate):
    path = plate.folder / "study.toml"
    path.write_text(STUDY)
    subject, trial = run_study(read_plan(path), plate.out)
    assert (subject.done, subject.error) == (("personalize",), "")
    assert trial.done == ("ik", "tension")
    home = plate.out / "s01"
    made = read_result(home / "reach" / "reach.nc").provenance["tension"]
    assert [one.name for one in made.sources if one.role == "model"] == [
        str(home / "personalized.osim")
    ]
    assert (home / "personalization" / "report.html").is_file()
    again = run_study(read_plan(path), plate.out)
    assert again[0].reused == ("personalize",)


def test_a_study_takes_measured_passive_torques_and_the_generic_model(plate):
    passive_table(plate, ("shoulder_flexion_moment", "elbow_flexion_moment"))
    path = plate.folder / "study.toml"
    text = STUDY.replace('"ik", "personalize", "tension"', '"ik", "personalize"')
    path.write_text(text + 'passive = ["pass*.sto"]\ngeneric = "arm.osim"\n')
    (subject, *_) = run_study(read_plan(path), plate.out)
    assert (subject.done, subject.error) == (("personalize",), "")
    made = json.loads((plate.out / "s01" / "personalization" / "provenance.json").read_text())
    assert {"passive torques", "generic model"} <= {one["role"] for one in made["sources"]}
    rows = list(
        csv.DictReader((plate.out / "s01" / "personalization" / "personalized_muscles.csv").open())
    )
    alone = plate.folder / "alone.toml"
    alone.write_text(text)
    run_study(read_plan(alone), plate.folder / "alone")
    without = list(
        csv.DictReader((plate.folder / "alone/s01/personalization/personalized_muscles.csv").open())
    )
    assert [row["person"] for row in rows] != [row["person"] for row in without]
    again = run_study(read_plan(path), plate.out)
    assert again[0].reused == ("personalize",)
    passive_table(plate, ("elbow_flexion_moment", "shoulder_flexion_moment"))
    assert run_study(read_plan(path), plate.out)[0].done == ("personalize",)


def test_what_a_study_does_not_use_is_reported(plate):
    passive_table(plate, ("shoulder_flexion_moment", "elbow_flexion_moment"))
    path = plate.folder / "study.toml"
    path.write_text(
        STUDY.replace('"ik", "personalize", "tension"', '"ik", "tension"')
        + 'passive = ["passive.sto"]\n'
    )
    assert any(
        "'passive' is not used: step 'personalize' is missing" in one
        for one in read_plan(path).remarks
    )
    path.write_text(STUDY + 'passive = ["none.sto"]\ngeneric = "none.osim"\n')
    with pytest.raises(BadFile, match="passive") as told:
        read_plan(path)
    assert "none.osim" in str(told.value)


def test_every_file_that_was_read_is_hashed(plate, command):
    more = (
        "--motion",
        plate.motion,
        "--loads",
        plate.loads,
        "--emg",
        plate.emg,
        "--emg-mvc",
        plate.emg,
    )
    told = command(*given(plate, *more))
    assert told.status == 0, told.err
    made = json.loads((plate.folder / "own_personalization" / "provenance.json").read_text())
    assert {source["role"] for source in made["sources"]} >= {
        "model",
        "motion",
        "loads",
        "emg",
        "emg mvc",
    }
