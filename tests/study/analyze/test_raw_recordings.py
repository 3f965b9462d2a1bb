"""What a recording is: its axes, whether somebody stands still, the files beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from made_standing import standing
from myomorph.core.io.trc import write_trc
from myomorph.core.model.errors import BadData, BadFile
from myomorph.lab.session.plate_cover import uncovered_share
from myomorph.lab.session.recordings import files_of, look_at, standing_height
from myomorph.lab.study.inputs.laboratory import UPRIGHT, Laboratory


@pytest.mark.parametrize("up", list(UPRIGHT))
@pytest.mark.parametrize("turn", [0.0, 90.0, 180.0, -90.0, 37.0])
def test_any_laboratory_is_turned_to_the_models_axes(up: str, turn: float, tmp_path) -> None:
    """The rotation that is found undoes the one by which the laboratory's axes stand otherwise."""
    body = standing()
    laboratory = Laboratory(up, turn)  # type: ignore[arg-type]
    write_trc(body.rotated(laboratory.rotation.T), tmp_path / "x.trc")
    found = look_at(tmp_path / "x.trc")
    back = found.trial.markers.rotated(found.laboratory.rotation)
    np.testing.assert_allclose(back.values, body.values, atol=0.02)
    assert (found.laboratory.up or "y") == up


def test_standing_still_is_no_motion(tmp_path) -> None:
    write_trc(standing(), tmp_path / "still.trc")
    write_trc(standing(0.3), tmp_path / "moving.trc")
    assert look_at(tmp_path / "still.trc").still
    moving = look_at(tmp_path / "moving.trc")
    assert not moving.still
    assert not moving.shown_still(None)
    assert moving.shown_still((0.0, 0.02))


def test_height_of_the_body_that_markers_show(tmp_path) -> None:
    body = standing()
    write_trc(replace(body, values=1.1 * body.values), tmp_path / "tall.trc")
    write_trc(body, tmp_path / "x.trc")
    usual = standing_height(look_at(tmp_path / "x.trc"))
    assert 1.55 < usual < 1.85
    assert standing_height(look_at(tmp_path / "tall.trc")) == pytest.approx(1.1 * usual, rel=1e-3)


def test_a_folder_of_pose2sim_counts_its_last_stage(tmp_path) -> None:
    home = tmp_path / "trial" / "pose-3d"
    home.mkdir(parents=True)
    for name in (
        "walk_0-100.trc",
        "walk_0-100_filt_butterworth.trc",
        "walk_0-100_filt_butterworth_LSTM.trc",
        "jump.trc",
    ):
        write_trc(standing(), home / name)
    found, notes = files_of([tmp_path / "trial"])
    assert [one.name for one in found] == ["jump.trc", "walk_0-100_filt_butterworth_LSTM.trc"]
    assert len(notes) == 2


def test_what_is_no_recording_is_refused(tmp_path) -> None:
    (tmp_path / "notes.txt").write_text("walk")
    with pytest.raises(BadFile, match="does not exist"):
        files_of([tmp_path / "none.c3d"])
    with pytest.raises(BadFile, match="no recording of markers"):
        files_of([tmp_path / "notes.txt"])
    with pytest.raises(BadFile, match="holds no recording"):
        files_of([tmp_path])


def test_a_recording_without_markers_says_what_to_give(tmp_path) -> None:
    body = standing()
    write_trc(replace(body, values=np.full_like(body.values, np.nan)), tmp_path / "empty.trc")
    from myomorph.lab.analyze.analyze import prepare_request
    from myomorph.lab.analyze.recorded_trial import AnalyzeRequest

    with pytest.raises(BadData, match="give the recording of the markers"):
        prepare_request(AnalyzeRequest((tmp_path / "empty.trc",), 70.0), tmp_path / "out")


def test_plates_that_nobody_steps_on_cover_no_frame_though_feet_have_no_landmark(
    tmp_path, monkeypatch
) -> None:
    body = standing(0.05)
    ankles = [index for index, name in enumerate(body.names) if name[1:] not in ("HEE", "TOE")]
    bare = replace(
        body, names=tuple(body.names[index] for index in ankles), values=body.values[:, ankles]
    )
    write_trc(bare, tmp_path / "x.trc")
    unloaded = (body.time, np.zeros(len(body)), np.zeros((len(body), 3)))
    monkeypatch.setattr("myomorph.lab.session.plate_cover.total_force", lambda *_: unloaded)
    assert uncovered_share(look_at(tmp_path / "x.trc"), 700.0) > 0.9
