"""Qualisys exports come back as they were written; damaged and foreign files are named."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.io import savemat

from myomorph.core.io import mat5
from myomorph.core.io.qualisys_mat import read_qualisys_mat
from myomorph.core.model.errors import BadFile
from myomorph.lab.info.inspect import inspect
from myomorph.lab.study.inputs.reading import read_recording

FRAMES = 40


def made(path, labels=("hip", "knee"), fragments=3, rate=250.0, compressed=True, **changes):
    """Write a recording as QTM writes it, and return its positions [mm]."""
    rng = np.random.default_rng(3)
    own = rng.uniform(-500, 500, (len(labels), 4, FRAMES))
    loose = rng.uniform(-500, 500, (fragments, 4, FRAMES))
    own[0, :, 5:9] = np.nan
    loose[:, :3, 20:] = np.nan
    label = np.empty((1, len(labels)), object)
    label[0] = labels
    groups = {"Labeled": {"Count": float(len(labels)), "Labels": label, "Data": own}}
    if fragments:
        groups["Unidentified"] = {"Count": float(fragments), "Data": loose}
    table = {
        "StartFrame": 11.0,
        "Frames": float(FRAMES),
        "FrameRate": rate,
        "Trajectories": groups,
    } | changes
    savemat(path, {"walk_1": table}, do_compression=compressed)
    return own


@pytest.mark.parametrize("compressed", [True, False])
def test_what_was_written_is_read_back(tmp_path, compressed):
    own = made(tmp_path / "a.mat", compressed=compressed)
    trial = read_qualisys_mat(tmp_path / "a.mat")
    assert trial.markers.names == ("hip", "knee")
    np.testing.assert_allclose(
        trial.markers.values, 1e-3 * own[:, :3].transpose(2, 0, 1), rtol=1e-15
    )
    np.testing.assert_allclose(trial.markers.time, (10 + np.arange(FRAMES)) / 250.0)
    assert trial.facts["unidentified fragments"] == "3, together 0.2 s, the longest 0.08 s"


def test_fragments_are_kept_on_request(tmp_path):
    made(tmp_path / "a.mat")
    markers = read_qualisys_mat(tmp_path / "a.mat", unidentified=True).markers
    assert markers.names == ("hip", "knee", "unidentified_1", "unidentified_2", "unidentified_3")
    assert np.isfinite(markers["unidentified_2"]).all(axis=1).sum() == 20


def test_one_marker_and_none_besides(tmp_path):
    own = made(tmp_path / "a.mat", labels=("tail",), fragments=0)
    trial = read_qualisys_mat(tmp_path / "a.mat")
    assert trial.markers.names == ("tail",)
    np.testing.assert_allclose(trial.markers["tail"], 1e-3 * own[0, :3].T)


def test_a_recording_without_fragments_is_read_on_request_too(tmp_path):
    made(tmp_path / "a.mat", fragments=0)
    markers = read_qualisys_mat(tmp_path / "a.mat", unidentified=True).markers
    assert markers.names == ("hip", "knee")


def test_what_is_not_read_is_told(tmp_path):
    made(tmp_path / "a.mat", Force={"ForcePlateName": "AMTI"}, Frames=99.0)
    told = " ".join(read_qualisys_mat(tmp_path / "a.mat").warnings)
    assert "not read: Force" in told
    assert "announces 99 frames, but holds 40" in told


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"FrameRate": 0.0}, "frame rate of 0 Hz"),
        ({"Trajectories": {"Unidentified": {"Count": 0.0}}}, "no labelled trajectories"),
        (
            {
                "Trajectories": {
                    "Labeled": {"Count": 1.0, "Labels": "a", "Data": np.zeros((1, 7, 4))}
                }
            },
            "the shape",
        ),
        (
            {
                "Trajectories": {
                    "Labeled": {"Count": 2.0, "Labels": "a", "Data": np.zeros((2, 4, 4))}
                }
            },
            "1 labels for 2",
        ),
    ],
)
def test_recordings_that_cannot_be_are_named(tmp_path, changes, words):
    made(tmp_path / "a.mat", **changes)
    with pytest.raises(BadFile, match=words):
        read_qualisys_mat(tmp_path / "a.mat")


def test_damaged_and_foreign_files_are_named(tmp_path, monkeypatch):
    made(tmp_path / "a.mat")
    whole = (tmp_path / "a.mat").read_bytes()
    broken = {
        "cut off": whole[: len(whole) // 2],
        "not a MATLAB file": b"Frame 1\n" * 40,
        "version 7.3": b"MATLAB 7.3 MAT-file" + whole[19:],
        "damaged": whole[:200] + bytes(64) + whole[264:],
    }
    for words, content in broken.items():
        (tmp_path / "b.mat").write_bytes(content)
        with pytest.raises(BadFile, match=words):
            read_qualisys_mat(tmp_path / "b.mat")
    (tmp_path / "b.mat").write_bytes(b"")
    with pytest.raises(BadFile, match="not a MATLAB file"):
        read_qualisys_mat(tmp_path / "b.mat")
    savemat(tmp_path / "c.mat", {"x": np.eye(3)})
    with pytest.raises(BadFile, match="holds 'x', but no Qualisys recording"):
        read_qualisys_mat(tmp_path / "c.mat")
    monkeypatch.setattr(mat5, "MAX_UNPACKED", 1000)
    with pytest.raises(BadFile, match="once unpacked"):
        read_qualisys_mat(tmp_path / "a.mat")


def test_the_treadmill_mouse(data):
    path = data("mouse-markers-treadmill/treadmill_15m_per_min.mat")
    trial = read_recording(path)
    assert (len(trial.markers), len(trial.markers.names), trial.markers.rate) == (
        10500,
        11,
        pytest.approx(300.0),
    )
    unseen = 1.0 - np.isfinite(trial.markers.values).all(axis=2).mean(axis=0)
    seldom = dict(zip(trial.markers.names, unseen, strict=True))
    assert seldom["left_ankle"] == pytest.approx(0.81, abs=0.01)
    assert seldom["right_ankle"] == pytest.approx(0.87, abs=0.01)
    # A mouse: hip and knee a few centimetres apart, millimetres in the file.
    apart = np.nanmedian(
        np.linalg.norm(trial.markers["left_hip"] - trial.markers["left_knee"], axis=1)
    )
    assert 0.005 < apart < 0.03
    assert any("unidentified fragments" in label for label, _ in inspect(path).facts)


@pytest.mark.parametrize("more", range(1, 8))
def test_bytes_left_over_are_named(tmp_path, more):
    """One to seven bytes after the last element are no element."""
    made(tmp_path / "a.mat")
    with (tmp_path / "a.mat").open("ab") as file:
        file.write(b"\0" * more)
    with pytest.raises(BadFile, match="ends early"):
        read_qualisys_mat(tmp_path / "a.mat")
