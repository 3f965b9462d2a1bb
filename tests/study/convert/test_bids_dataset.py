"""A study as a dataset of BIDS: the validator finds no error, and what is written is read back."""

from __future__ import annotations

import json
import subprocess
import sys
from types import SimpleNamespace

import edfio
import numpy as np
import pytest

from myomorph.core.io.c3d.write import write_trial
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.sto import read_sto
from myomorph.core.io.trc import read_trc
from myomorph.core.model.errors import BadData, BadFile, MissingPackage
from myomorph.core.model.series import Emg, Event, Series, Trial
from myomorph.core.model.series_quantities import EMG
from myomorph.exchange.bids.dataset import export_bids, read_bids
from myomorph.exchange.bids.recording import (
    force_signals,
    plates_of,
    read_emg,
    read_motion_trial,
    write_emg,
)
from myomorph.exchange.bids.signals import Channel, read_signals, signals_of, write_signals
from myomorph.exchange.bids.tables import INTERVALS, TABLES, label_of, name_of, plain_provenance
from myomorph.lab.convert.convert import convert
from myomorph.lab.session.recordings import files_of
from myomorph.lab.store.results import read_result
from myomorph.lab.study.inputs.emg_files import channels_of
from myomorph.lab.study.inputs.reading import read_recording
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from myomorph.show.demo.arm import example_files

STUDY = """[study]
name = "reaching"
conditions = {near = "reach*"}
[[subject]]
name = "s 01"
model = "arm.osim"
trials = [{markers = "reach.trc", loads = "reach_grf.xml", emg = "reach_emg.sto"}]
steps = ["ik", "id", "tension", "uncertainty"]
[[subject]]
name = "s-01"
model = "arm.osim"
trials = ["events.c3d"]
steps = ["ik"]
[options.uncertainty]
draws = 4
"""
EVENTS = (Event(0.1, "Reach", "Right"), Event(0.3, "Touch"))


def validated(folder):
    """Return the errors that the validator of BIDS finds, and how many files it checked.

    It reads a dataset and its derivatives.
    """
    program = [sys.executable, "-c", "import bids_validator_deno; bids_validator_deno.cli()"]
    options = ["--format", "json", "--recursive", "--max-rows", "-1"]
    said = json.loads(
        subprocess.run(
            [*program, folder, *options], capture_output=True, text=True, check=False
        ).stdout
    )
    parts = [said, *said.get("derivativesSummary", {}).values()]
    errors = [
        issue
        for part in parts
        for issue in part["issues"]["issues"]
        if issue["severity"] == "error"
    ]
    return errors, sum(part["summary"]["totalFiles"] for part in parts)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Results of two subjects whose names have the same letters, and the dataset made of them."""
    home = tmp_path_factory.mktemp("laboratory")
    arm = example_files(home)
    write_trial(home / "events.c3d", Trial(markers=read_trc(arm.markers).markers, events=EVENTS))
    (home / "study.toml").write_text(STUDY)
    outcomes = run_study(read_plan(home / "study.toml"), home / "out")
    assert not any(outcome.error for outcome in outcomes)
    made = export_bids(home / "out", home / "bids")
    first = read_result(home / "out" / "s_01/reach/reach.nc")
    second = read_result(home / "out" / "s-01/events/events.nc")
    return SimpleNamespace(
        home=home, arm=arm, notes=made, first=first, second=second, bids=home / "bids"
    )


def test_the_validator_finds_no_error(study):
    errors, files = validated(study.bids)
    assert not errors
    assert files == sum(path.is_file() for path in study.bids.rglob("*"))
    assert study.notes == ()


def test_the_validator_finds_what_is_wrong(study, tmp_path):
    (tmp_path / "sub-1").mkdir()
    (tmp_path / "sub-1" / "sub-1_motion.tsv").write_text("1\n")
    (tmp_path / "dataset_description.json").write_text('{"Name": "x"}')
    assert validated(tmp_path)[0]


def test_labels_are_names_and_earlier_ones_are_known():
    for quantity in (*TABLES, EMG):
        assert label_of(quantity.name).isalnum()
        assert name_of(label_of(quantity.name)) == quantity.name
        assert name_of(label_of(quantity.name) + INTERVALS) == f"{quantity.name}_intervals"
    assert name_of("tensions") == "muscle_force"
    assert name_of("torquesIntervals") == "generalized_force_intervals"


def test_results_are_read_back(study):
    trials = read_bids(study.bids)
    assert sorted(trials) == ["s 01/reach", "s-01/events"]
    derived = trials["s 01/reach"].derived
    values = study.first.values
    names = study.first.names
    for table, kind in (
        ("coordinate_value", "coordinate"),
        ("generalized_force", "coordinate"),
        ("muscle_force", "muscle"),
        ("activation", "muscle"),
        ("emg", "emg_channel"),
    ):
        assert derived[table].names == names[kind]
        np.testing.assert_allclose(derived[table].values, values[table], rtol=1e-14, err_msg=table)
    np.testing.assert_allclose(derived["generalized_force"].time, study.first.time, atol=1e-12)
    for table in ("coordinate_value", "generalized_force", "muscle_force"):
        limits = np.hstack([values[f"{table}_{part}"] for part in ("low", "high", "sd")])
        np.testing.assert_allclose(
            derived[f"{table}_intervals"].values, limits, rtol=1e-14, err_msg=table
        )
    assert derived["coordinate_value_intervals"].facts["Draws"] == 4
    assert {channel.unit for channel in derived["coordinate_value"].channels} == {"rad"}
    (load,) = plates_of(derived["external_force"])
    assert {channel.placement for channel in derived["external_force"].channels} == set(
        names["external_force_body"]
    )
    assert np.array_equal(load.forces, values["external_force_vector"][:, 0])
    assert list(trials["s-01/events"].derived) == ["coordinate_value"]


def test_recordings_are_read_back(study):
    trials = read_bids(study.bids)
    first = trials["s 01/reach"].recording
    second = trials["s-01/events"].recording
    recorded = read_trc(study.arm.markers).markers
    assert first.markers.names == recorded.names
    assert np.array_equal(first.markers.values, recorded.values)
    np.testing.assert_allclose(first.markers.time, recorded.time, atol=1e-12)
    loads = read_external_loads(study.arm.loads)
    assert np.array_equal(first.plates[0].forces, loads.forces[:, 0])
    assert np.array_equal(first.plates[0].points, loads.points[:, 0])
    assert [(event.label, event.side) for event in second.events] == [
        ("Reach", "Right"),
        ("Touch", ""),
    ]
    assert [event.time for event in second.events] == pytest.approx([0.1, 0.3], abs=1e-6)
    emg = trials["s 01/reach"].emg
    whole = read_sto(study.arm.emg)
    assert emg.names == whole.names
    np.testing.assert_allclose(emg.time, whole.time, atol=1e-9)
    np.testing.assert_allclose(
        emg.values, whole.values, atol=2.0 * np.abs(whole.values).max() / 2**24
    )


def test_commands_take_files_of_the_dataset(study, command, tmp_path):
    path = next(study.bids.glob("sub-s01x2/motion/*-markers_motion.tsv"))
    ik = command("ik", "--model", study.arm.model, "--markers", path, "--out", tmp_path / "q.mot")
    assert ik.status == 0, ik.err
    angles = read_sto(tmp_path / "q.mot")
    np.testing.assert_allclose(
        np.deg2rad(angles.values), study.first.values["coordinate_value"], atol=1e-6
    )
    convert([path], tmp_path / "back.trc")
    np.testing.assert_allclose(
        read_trc(tmp_path / "back.trc").markers.values, read_recording(path).markers.values
    )
    emg = next(study.bids.glob("sub-s01x2/emg/*.bdf"))
    assert channels_of(emg).names == read_sto(study.arm.emg).names
    forces = path.with_name(path.name.replace("markers", "forces"))
    told = ("id", "--model", study.arm.model, "--motion", study.arm.motion, "--plates", "fore")
    made = command(*told, "--loads", forces, "--out", tmp_path / "t.sto")
    assert made.status == 0, made.err
    assert read_motion_trial(forces).markers is None
    assert [file.name for file in files_of([study.bids])[0]] == [
        f"sub-{name}_tracksys-markers_motion.tsv"
        for name in ("s01_task-events", "s01x2_task-reach")
    ]
    assert command("info", emg).out.count("flexor") == 1


def test_provenance_has_no_folder_of_this_machine(study):
    for path in study.bids.rglob("*"):
        if path.is_file():
            assert str(study.home).encode() not in path.read_bytes(), path
    sidecar = next(
        study.bids.glob("derivatives/myomorph/sub-s01x2/motion/*-generalizedForce_motion.json")
    )
    said = json.loads(sidecar.read_text())["Provenance"]
    assert said == plain_provenance(study.first.provenance["id"])
    sources = {source["Role"]: source for source in said["Sources"]}
    assert sources["markers"]["Name"] == "reach.trc"
    assert sources["markers"]["SHA256"] == study.first.provenance["id"].sources[1].sha256
    assert said["Options"]["id.cutoff"] == study.first.provenance["id"].options["id.cutoff"]


def test_files_that_are_gone_are_named_and_results_stand_in(study, tmp_path):
    elsewhere = study.home / "reach.trc"
    moved = elsewhere.rename(study.home / "moved.trc")
    try:
        notes = export_bids(study.home / "out" / "s_01", tmp_path / "bids")
    finally:
        moved.rename(elsewhere)
    assert any("reach.trc" in note and "is gone" in note for note in notes)
    (trial,) = read_bids(tmp_path / "bids").values()
    assert np.array_equal(
        trial.recording.markers.values, study.first.values["recorded_marker_position"]
    )


def test_what_is_refused(study, command, tmp_path, monkeypatch):
    out = study.home / "out"
    full = command("export", out, "--bids", study.bids)
    assert full.status == 2
    assert "is not an empty folder" in full.err
    (tmp_path / "empty").mkdir()
    none = command("export", tmp_path / "empty", "--bids", tmp_path / "bids")
    assert none.status == 2
    assert "holds no results" in none.err
    neither = command("export", out)
    assert neither.status == 2
    assert "--bids FOLDER" in neither.err
    both = command("export", out, "--bids", tmp_path / "bids", "--mjcf", tmp_path / "a.xml")
    assert both.status == 2
    monkeypatch.setitem(sys.modules, "edfio", None)
    missing = command("export", out, "--bids", tmp_path / "bids")
    assert missing.status == 2
    assert "myomorph[bids]" in missing.err
    assert not (tmp_path / "bids").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]
    with pytest.raises(MissingPackage):
        read_emg(next(study.bids.glob("sub-s01x2/emg/*.bdf")))
    with pytest.raises(BadFile, match="is no dataset of BIDS"):
        read_bids(tmp_path)


def test_any_rate_and_lost_samples_of_emg(tmp_path):
    rng = np.random.default_rng(3)
    time = 5.25 + np.arange(1234) / 1111.1
    values = rng.standard_normal((1234, 2)) * [1e-4, 3e3]
    values[7, 0] = np.nan
    stem = tmp_path / "sub-1_task-a"
    write_emg(
        stem, Emg(time, ("a long name of a muscle", "B"), values), ("V", "n/a"), {"TaskName": "a"}
    )
    back = read_emg(tmp_path / "sub-1_task-a_emg.bdf")
    assert back.names == ("a long name of a muscle", "B")
    assert back.units == ("V", "")
    np.testing.assert_allclose(back.time, time, atol=1e-9)
    values[7, 0] = 0.0
    for column in range(2):
        limit = 1.2 * np.abs(values[:, column]).max() / 2**23
        np.testing.assert_allclose(
            back.values[:, column], values[:, column], atol=max(limit, 2e-5 / 2**23)
        )
    plain = [
        edfio.EdfSignal(column, 50.0, label="C", physical_dimension="mV")
        for column in (np.arange(100.0),)
    ]
    edfio.Edf(plain).write(tmp_path / "plain.edf")
    other = read_emg(tmp_path / "plain.edf")
    assert (other.names, other.units, other.rate) == (("C",), ("V",), pytest.approx(50.0))
    np.testing.assert_allclose(other["C"], 1e-3 * np.arange(100.0), atol=2e-6)
    with pytest.raises(BadData, match="no even sampling rate"):
        write_emg(stem, Emg(time**1.1, ("A", "B"), values), ("V", "V"), {})


def test_motion_of_others(tmp_path):
    """Centimetres, degrees, no latencies, a gap, and facts at the top of the dataset."""
    home = tmp_path / "sub-1" / "motion"
    home.mkdir(parents=True)
    (tmp_path / "dataset_description.json").write_text('{"Name": "x", "BIDSVersion": "1.11.0"}')
    (tmp_path / "task-walk_tracksys-opt_motion.json").write_text(
        '{"SamplingFrequency": 50, "TaskName": "walk"}'
    )
    (tmp_path / "task-run_motion.json").write_text('{"SamplingFrequency": 10}')
    head = "name\tcomponent\ttype\ttracked_point\tunits\n"
    rows = [f"A_{axis}\t{axis}\tPOS\tA\tcm" for axis in "zxy"] + ["knee\tn/a\tJNTANG\tn/a\tdeg"]
    stem = home / "sub-1_task-walk_tracksys-opt"
    (home / f"{stem.name}_channels.tsv").write_text(head + "\n".join(rows))
    path = home / f"{stem.name}_motion.tsv"
    path.write_text("300\t100\t200\t90\nn/a\t110\t210\t180\n")
    (home / "sub-1_task-walk_events.tsv").write_text("onset\tduration\n0.02\t0\n")
    signals = read_signals(path)
    assert signals.time.tolist() == [0.0, 0.02]
    assert signals["knee"] == pytest.approx([np.pi / 2.0, np.pi])
    trial = read_recording(path)
    assert trial.markers.names == ("A",)
    np.testing.assert_allclose(trial.markers.values[:, 0], [[1.0, 2.0, 3.0], [1.1, 2.1, np.nan]])
    assert trial.events[0].time == 0.02
    path.write_text("300\t100\t200\n")
    with pytest.raises(BadFile, match="has 3 columns, but its channels are 4"):
        read_signals(path)
    (home / f"{stem.name}_channels.tsv").write_text("name\ttype\nA\tPOS\n")
    with pytest.raises(BadFile, match="has no column 'component'"):
        read_signals(path)
    (home / f"{stem.name}_channels.tsv").unlink()
    with pytest.raises(BadFile, match="no _channels"):
        read_signals(path)


def test_a_table_without_markers_is_no_recording(tmp_path):
    series = Series(np.arange(3.0), ("knee",), np.zeros((3, 1)))
    write_signals(
        tmp_path / "sub-1_task-a_tracksys-angles",
        signals_of(series, [Channel("knee", "JNTANG", "deg")]),
    )
    with pytest.raises(BadFile, match="holds no positions of markers"):
        read_recording(tmp_path / "sub-1_task-a_tracksys-angles_motion.tsv")


def test_plates_keep_their_corners(study):
    loads = read_external_loads(study.arm.loads)
    corners = np.arange(12.0).reshape(4, 3)
    facts = {"ForcePlates": [{"Name": loads.names[0], "Corners": corners.tolist()}]}
    (plate,) = plates_of(force_signals(loads, facts))
    assert np.array_equal(plate.corners, corners)
