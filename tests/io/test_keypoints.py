"""Keypoints become markers once their names and unit are told; nothing is guessed."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest

from myomorph.core.io.keypoints import read_keypoint_names, read_keypoints
from myomorph.core.io.parsing import hdf5
from myomorph.core.io.parsing.guard import Outcome
from myomorph.core.model.errors import BadFile
from myomorph.lab.study.inputs.reading import read_recording

NAMES = ("nose", "hip", "tail")


def made(path, shape=(20, 1, 3, 3), node_names=(), attributes=(), dataset="tracks"):
    tracks = np.random.default_rng(1).uniform(-100.0, 100.0, shape)
    tracks[4, ..., 1, :] = np.nan
    with h5py.File(path, "w") as file:
        file[dataset] = tracks
        if node_names:
            file["node_names"] = [name.encode() for name in node_names]
        for key, value in dict(attributes).items():
            file.attrs[key] = value
    return tracks


def test_names_and_unit_of_the_file_itself(tmp_path):
    tracks = made(tmp_path / "a.h5", node_names=NAMES, attributes={"units": "mm", "fps": 50})
    trial = read_keypoints(tmp_path / "a.h5")
    assert (trial.markers.names, trial.warnings) == (NAMES, ())
    np.testing.assert_allclose(trial.markers.values, 1e-3 * tracks[:, 0])
    assert trial.markers.time[-1] == pytest.approx(19 / 50)


def test_what_is_told_goes_before_what_the_file_says(tmp_path):
    tracks = made(tmp_path / "a.h5", (20, 3, 3), node_names=NAMES, attributes={"units": "mm"})
    trial = read_keypoints(tmp_path / "a.h5", ("a", "b", "c"), "cm", 100.0)
    assert trial.markers.names == ("a", "b", "c")
    np.testing.assert_allclose(trial.markers.values, 1e-2 * tracks)


def test_names_beside_the_recording(tmp_path):
    made(tmp_path / "a.h5")
    (tmp_path / "a.json").write_text(
        json.dumps({"names": NAMES, "units": "m", "rate": 10, "bodies": {"nose": "Head"}})
    )
    assert read_keypoints(tmp_path / "a.h5").markers.names == NAMES
    assert read_keypoint_names(tmp_path / "a.json").bodies == {"nose": "Head"}
    (tmp_path / "a.yaml").write_text("[one, two, three]\n")
    with pytest.raises(BadFile, match="does not state its unit"):
        read_keypoints(tmp_path / "a.h5")
    (tmp_path / "b.txt").write_text("nose\nhip\n\ntail\n")
    assert read_keypoint_names(tmp_path / "b.txt").names == NAMES


def test_without_a_rate_times_are_frame_numbers_and_that_is_told(tmp_path):
    made(tmp_path / "a.h5", node_names=NAMES, attributes={"units": "m"})
    trial = read_keypoints(tmp_path / "a.h5")
    assert trial.markers.rate == 1.0
    assert "no frame rate" in trial.warnings[0]


def test_several_animals(tmp_path):
    tracks = made(
        tmp_path / "a.h5", (20, 2, 3, 3), node_names=NAMES, attributes={"units": "m", "rate": 1.0}
    )
    trial = read_keypoints(tmp_path / "a.h5", animal=1)
    np.testing.assert_allclose(trial.markers.values, tracks[:, 1])
    assert trial.warnings == ("holds 2 animals: this is number 1, counted from 0",)
    with pytest.raises(BadFile, match="no animal 2"):
        read_keypoints(tmp_path / "a.h5", animal=2)


def test_files_that_cannot_be_used_are_named(tmp_path):
    cases = {
        "does not name its 3 points": {},
        "no 'tracks'": {"dataset": "poses"},
        "two-dimensional": {"shape": (20, 1, 3, 2)},
        "3 points, but 2 names": {"node_names": NAMES[:2]},
    }
    for words, how in cases.items():
        made(tmp_path / "a.h5", **how)
        with pytest.raises(BadFile, match=words):
            read_keypoints(tmp_path / "a.h5")
    made(tmp_path / "a.h5", node_names=NAMES)
    whole = (tmp_path / "a.h5").read_bytes()
    for content in (b"", b"nothing of the kind", whole[:600]):
        (tmp_path / "b.h5").write_bytes(content)
        with pytest.raises(BadFile, match="HDF5"):
            read_keypoints(tmp_path / "b.h5")
    with pytest.raises(BadFile, match="unknown unit 'feet'"):
        read_keypoints(tmp_path / "a.h5", units="feet")
    (tmp_path / "a.yaml").write_text("names: {nose: 1}\n")
    with pytest.raises(BadFile, match="no list"):
        read_keypoint_names(tmp_path / "a.yaml")
    (tmp_path / "a.yaml").write_text("names: [nose\n")
    with pytest.raises(BadFile, match="is not YAML"):
        read_keypoint_names(tmp_path / "a.yaml")


def test_files_made_to_fill_the_memory_are_refused(tmp_path):
    nested = ""
    for k in range(1, 9):
        nine = ", ".join([f"*a{k - 1}"] * 9)
        nested += f"a{k}: &a{k} [{nine}]\n"
    (tmp_path / "a.yaml").write_text(f"a0: &a0 [{', '.join('x' * 9)}]\n{nested}names: [*a8]\n")
    with pytest.raises(BadFile, match="a name cannot be a list"):
        read_keypoint_names(tmp_path / "a.yaml")
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file.create_dataset("tracks", shape=(2**32, 2**31, 2, 3), chunks=(1, 1, 1, 3), dtype="f4")
    with pytest.raises(BadFile, match="too much to read"):
        read_keypoints(tmp_path / "b.h5")
    made(tmp_path / "c.h5", attributes={"fps": [1.0, 2.0]})
    with pytest.raises(BadFile, match="HDF5"):
        read_keypoints(tmp_path / "c.h5")


def test_the_mouse_of_34_keypoints(data):
    trial = read_recording(data("mouse-skeleton-keypoints/mouse_mocap_3600_frames.h5"))
    assert trial.markers.values.shape == (3600, 34, 3)
    assert (
        "names of the points are those of keypoint_to_body_mouse.yaml, in units of 0.001 m"
        in trial.warnings
    )
    length = np.linalg.norm(trial.markers["Nose"] - trial.markers["TTI"], axis=1)
    assert 0.06 < np.median(length) < 0.13
    told = read_keypoint_names(data("mouse-skeleton-keypoints/keypoint_to_body_mouse.yaml"))
    assert told.bodies["Knee_L"] == "mouse__LFemur"
    assert set(told.offsets) == set(trial.markers.names)


@pytest.mark.parametrize(
    ("status", "told"), [("hung", "did not end within 10 s"), ("failed", "ended with status -11")]
)
def test_a_file_on_which_the_library_hangs_or_crashes_is_named(tmp_path, monkeypatch, status, told):
    """HDF5 does so on some damaged files: they are tried in a process of their own first."""
    made(tmp_path / "a.h5", node_names=NAMES, attributes={"units": "m"})
    monkeypatch.setattr(hdf5, "run_guarded", lambda *_: Outcome(status, told))
    with pytest.raises(BadFile, match=f"cannot be read as HDF5 .*{told}"):
        read_keypoints(tmp_path / "a.h5")


def test_a_number_of_thousands_of_digits_is_named(tmp_path):
    (tmp_path / "a.json").write_text('{"rate": ' + 5000 * "9" + "}", encoding="utf-8")
    with pytest.raises(BadFile, match="is not JSON"):
        read_keypoint_names(tmp_path / "a.json")
