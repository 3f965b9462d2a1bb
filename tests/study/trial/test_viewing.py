"""From folders of results to what a page shows, and what is told where there is nothing to show."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.core.io.mesh import write_obj
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import BadFile
from myomorph.core.model.model import Mesh
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.model.surface import Surface
from myomorph.lab.cli import main
from myomorph.lab.store import stored
from myomorph.lab.store.results import STORED, file_source, new_result, provenance_of
from myomorph.lab.study.trial.viewing import open_replay, recordings
from myomorph.lab.viewer.replay_body import PlayedBody

Write = Callable[..., Path]


@pytest.fixture
def write(arm: SimpleNamespace) -> Write:
    """Return a function that writes a small result of the arm: a second of a bend."""
    model = read_osim(arm.model)

    def written(name: str, trial: str, first: float = 0.0, gap: bool = False) -> Path:
        time = first + np.arange(0.0, 1.0, 0.02)
        values = np.stack([0.1 * time, 0.5 + 0.3 * time], axis=1)
        if gap:
            values[10:20] = np.nan
        path: Path = arm.folder / "results" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with new_result(path, "muscles") as writer:
            stored.put_derivatives(writer, Motion(time, model.coordinate_names, values), model)
            writer.fact("trial", trial)
            writer.provenance(provenance_of("muscles", [file_source("model", arm.model)], {}))
        return path

    return written


def test_recordings_are_named_by_folder_and_trial(write: Write, arm: SimpleNamespace) -> None:
    path = write(f"s01/walk1/walk1{STORED}", "walk1")
    write(f"s01/walk2/walk2{STORED}", "walk2")
    write(f".steps/x/ik{STORED}", "hidden")
    found = recordings(arm.folder / "results")
    assert list(found) == [str(Path("s01/walk1")), str(Path("s01/walk2"))]
    body = PlayedBody(found[str(Path("s01/walk2"))]())
    assert len(body.time) == 50
    assert body.muscles == read_osim(arm.model).muscle_names
    assert list(recordings(path)) == ["walk1"]


def test_files_of_one_trial_belong_together_and_those_of_several_do_not(
    write: Write, arm: SimpleNamespace
) -> None:
    write(f"a_muscles{STORED}", "a")
    write(f"a_tension{STORED}", "a")
    write(f"b_muscles{STORED}", "b", first=5.0)
    found = recordings(arm.folder / "results")
    assert sorted(found) == ["a", "b"]
    assert found["b"]().kinematics.motion.time[0] == 5.0  # type: ignore[union-attr]


def test_what_a_command_wrote_is_shown(
    arm: SimpleNamespace, command: Callable[..., SimpleNamespace]
) -> None:
    done = command(
        "tension",
        "--model",
        arm.model,
        "--motion",
        arm.motion,
        "--loads",
        arm.loads,
        "--out",
        arm.out,
    )
    assert done.status == 0, done.err
    replay = open_replay([arm.out])
    try:
        body = replay.bodies[0]
        assert np.isfinite(body.activations).all()
        replay.seek(0.31)
        assert np.isfinite(body.at(31).measured).all()
    finally:
        replay.close()


def test_frames_without_a_pose_are_played_over(write: Write) -> None:
    replay = open_replay([write(f"gap{STORED}", "gap", gap=True)])
    try:
        assert replay.bodies[0].known.sum() == 40
        replay.seek(0.3)
        assert not replay.bodies[0].at(15).known
    finally:
        replay.close()


def test_what_is_missing_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(BadFile, match="does not exist"):
        recordings(tmp_path / "nowhere")
    with pytest.raises(BadFile, match="holds no results"):
        recordings(tmp_path)
    with new_result(tmp_path / f"other{STORED}", "ik") as writer:
        writer.time(np.arange(3.0))
    with pytest.raises(BadFile, match="none with a motion"):
        recordings(tmp_path)
    (tmp_path / f"broken{STORED}").write_bytes(b"no result at all")
    with pytest.raises(BadFile, match="is not a result of Myomorph"):
        recordings(tmp_path)
    for given in (
        [],
        [str(tmp_path / "nowhere")],
        [str(tmp_path), "--port", "99999"],
        [str(tmp_path), "--port", "a"],
    ):
        status = main(["view", *given, "--no-browser"])
        told = capsys.readouterr().err
        assert status == 2, given
        assert told.count("\n") == 1
        assert "Traceback" not in told


def test_a_model_that_is_gone_is_told(
    write: Write, arm: SimpleNamespace, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write(f"walk{STORED}", "walk")
    arm.model.unlink()
    status = main(["view", str(path), "--no-browser"])
    told = capfd.readouterr().err
    assert status == 2
    assert "is gone" in told
    assert told.count("\n") == 1


def test_results_are_shown_from_any_folder(
    arm: SimpleNamespace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the model was named relative to the folder that the command ran in."""
    monkeypatch.chdir(arm.folder)
    assert (
        main(["muscles", "--model", arm.model.name, "--motion", arm.motion.name, "--out", "out"])
        == 0
    )
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    (opened,) = recordings(arm.folder / "out").values()
    assert PlayedBody(opened()).muscles == read_osim(arm.model).muscle_names
    arm.model.write_text(arm.model.read_text().replace("0.12", "0.13"))
    with pytest.raises(BadFile, match="has changed"):
        opened()


@pytest.mark.skipif(os.name != "posix", reason="sends Ctrl-C as a signal")
def test_the_command_says_where_and_ends_with_ctrl_c(write: Write) -> None:
    path = write(f"walk{STORED}", "walk")
    command = [sys.executable, "-m", "myomorph.lab.cli", "view", str(path), "--no-browser"]
    # A shell that runs the tests in the background has its children ignore Ctrl-C.
    heeded = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command, **pipes, text=True, preexec_fn=heeded)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert re.match(r"http://127\.0\.0\.1:\d+/\?token=[\w-]+ ", line), line
        process.send_signal(signal.SIGINT)
        rest, errors = process.communicate(timeout=20)
        assert process.returncode == 0, errors
        assert rest == ""
        assert errors == ""
    finally:
        process.kill()


def test_missing_meshes_are_named_and_found_in_the_folder_given(
    write: Write, arm: SimpleNamespace, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = read_osim(arm.model)
    mesh = Mesh(file="hand.obj", pose=Transform(np.eye(3), np.zeros(3)), scale=np.ones(3))
    bodies = (model.bodies[0], replace(model.bodies[1], meshes=(mesh,)))
    write_osim(replace(model, bodies=bodies), arm.model)
    path = write(f"walk{STORED}", "walk")
    movie = ["--movie", str(tmp_path / "walk.gif"), "--size", "200", "120"]
    pytest.importorskip("PIL", reason="needs the extra 'view'")
    assert main(["view", str(path), *movie]) == 0
    told = capsys.readouterr()
    assert "1 of 1 mesh files" in told.err
    assert "'hand.obj'" in told.err
    assert "--geometry" in told.err
    assert re.search(r"wrote .*walk.gif: 20 pictures, 1 s at 1 of", told.out)
    meshes = tmp_path / "meshes"
    meshes.mkdir()
    write_obj(Surface(np.eye(3), np.array([[0, 1, 2]])), meshes / "hand.obj")
    assert main(["view", str(path), *movie, "--geometry", str(meshes)]) == 0
    assert capsys.readouterr().err == ""
    assert main(["view", str(path), *movie, "--geometry", str(tmp_path / "gone")]) == 2
    assert "is no folder" in capsys.readouterr().err


def test_options_of_a_movie_need_a_movie(write: Write, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(f"walk{STORED}", "walk")
    assert main(["view", str(path), "--speed", "0.5", "--no-browser"]) == 2
    assert "--movie" in capsys.readouterr().err
    assert main(["view", str(path), str(path), "--movie", "a.gif"]) == 2
    assert "one folder" in capsys.readouterr().err
