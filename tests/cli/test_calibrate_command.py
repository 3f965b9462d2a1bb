"""`calibrate`: a model and tables from files, and bad files in one line."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.trc import write_trc
from myomorph.core.model.provenance import Provenance
from myomorph.core.model.series import Markers
from stick_figure import person


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Return a generic model and a recording of a person of other lengths."""
    folder = tmp_path_factory.mktemp("person")
    one = person(frames=60)
    write_osim(one.generic, folder / "generic.osim")
    write_trc(one.markers, folder / "dance.trc")
    still = Markers(
        one.markers.time[:5], one.markers.names, np.repeat(one.markers.values[:1], 5, axis=0)
    )
    write_trc(still, folder / "static.trc")
    return folder, one


def refused(told, *words):
    assert told.status == 2, told
    assert told.err.count("\n") == 1, told.err
    for word in words:
        assert word in told.err, told.err


def test_a_model_and_its_tables(files, command):
    folder, one = files
    out = folder / "subject.osim"
    told = command(
        "calibrate",
        "--model",
        folder / "generic.osim",
        "--markers",
        folder / "dance.trc",
        "--static",
        folder / "static.trc",
        "--mass",
        71.5,
        "--noise",
        0,
        "--frames",
        20,
        "--symmetric",
        "--out",
        out,
    )
    assert told.status == 0, told.err
    assert "root mean square" in told.out
    assert "femur_y" in told.out
    model = read_model(out)
    assert model.mass == pytest.approx(71.5)
    thigh = next(j for j in model.joints if j.child == "tibia_r").parent_frame.translation
    true = next(j for j in one.model.joints if j.child == "tibia_r").parent_frame.translation
    assert np.linalg.norm(thigh) == pytest.approx(np.linalg.norm(true), abs=2e-3)
    with (folder / "subject_calibration" / "lengths.csv").open() as stream:
        lengths = {row["length"]: row for row in csv.DictReader(stream)}
    assert float(lengths["femur_y"]["calibrated_m"]) == pytest.approx(
        np.linalg.norm(thigh), abs=1e-4
    )
    with (folder / "subject_calibration" / "markers.csv").open() as stream:
        assert len(list(csv.DictReader(stream))) == 30
    made = Provenance.from_json((folder / "subject_calibration" / "provenance.json").read_text())
    assert [source.role for source in made.sources] == ["model", "markers", "static"]
    assert made.options["symmetric"] is True


def test_bad_input_is_named(files, command):
    folder, one = files
    model = folder / "generic.osim"
    markers = folder / "dance.trc"
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    out = folder / "other.osim"
    refused(command("calibrate", "--model", model, "--out", out), "--markers")
    refused(
        command("calibrate", "--model", model, "--markers", folder / "no.trc", "--out", out),
        "no.trc",
    )
    refused(
        command("calibrate", "--model", model, "--markers", markers, "--out", folder / "x.mot"),
        ".osim",
    )
    refused(
        command(
            "calibrate", "--model", model, "--markers", markers, "--time", 50, 60, "--out", out
        ),
        "has nothing from",
    )
    refused(
        command("calibrate", "--model", model, "--markers", markers, "--mass", -3, "--out", out),
        "mass",
    )
    large = Markers(one.markers.time, one.markers.names, 1e3 * one.markers.values)
    write_trc(large, folder / "large.trc")
    refused(
        command("calibrate", "--model", model, "--markers", folder / "large.trc", "--out", out),
        "millimetres",
    )
    (folder / "large.trc").unlink()
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
