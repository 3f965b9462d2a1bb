"""Sessions that cannot be lost: killed, ended by signals, and with a clock that is set back."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.sto import read_sto
from myomorph.core.model.errors import BadFile
from myomorph.lab.store.results import read_result
from myomorph.live.loop import BAD_TIME, SETTLING, SOLVED, Delays
from myomorph.live.run import LiveFiles, LiveOutputs, recover_session, run_live_chain
from myomorph.live.session_clock import PAUSE, SessionClock
from myomorph.live.session_log import LOG, read_log
from myomorph.live.sources import Arrived, Replay
from myomorph.show.demo.arm import example_files


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return example_files(tmp_path_factory.mktemp("arm"))


def session(arm, out: Path, speed: float = 0.0):
    files = LiveFiles(arm.folder / "reach.trc", None, speed)
    return run_live_chain(arm.folder / "arm.osim", files, LiveOutputs(folder=out))


def same_results(first: Path, second: Path) -> None:
    for name in ("coordinates.mot", "torques.sto", "activations.sto"):
        assert (first / name).read_bytes() == (second / name).read_bytes()
    one = read_result(first / "live.nc")
    other = read_result(second / "live.nc")
    assert one.values.keys() == other.values.keys()
    for name, values in one.values.items():
        np.testing.assert_array_equal(values, other.values[name])


def test_a_log_gives_the_results_of_its_session(arm, tmp_path, monkeypatch):
    """The log of a session whose results were not written, recovered."""
    session(arm, tmp_path / "whole")
    assert not (tmp_path / "whole" / LOG).exists()
    with monkeypatch.context() as patch:
        patch.setattr("myomorph.live.run._write_results", lambda *_: None)
        session(arm, tmp_path / "lost")
    assert [path.name for path in (tmp_path / "lost").iterdir()] == [LOG]
    with pytest.raises(BadFile, match="--recover"):
        session(arm, tmp_path / "lost")
    recovered = recover_session(tmp_path / "lost")
    assert len(recovered.delays) == 61
    assert any("did not end by itself" in note for note in recovered.notes)
    same_results(tmp_path / "whole", tmp_path / "lost")
    assert not (tmp_path / "lost" / LOG).exists()


def test_a_row_that_was_cut_off_is_left_out(arm, tmp_path, monkeypatch):
    monkeypatch.setattr("myomorph.live.run._write_results", lambda *_: None)
    session(arm, tmp_path / "lost")
    path = tmp_path / "lost" / LOG
    os.truncate(path, path.stat().st_size - 100)
    monkeypatch.undo()
    _, rows = read_log(path)
    assert len(rows) == 60
    assert len(recover_session(tmp_path / "lost").delays) == 60
    assert read_sto(tmp_path / "lost" / "torques.sto").names


def test_what_is_no_log_is_named(tmp_path):
    with pytest.raises(BadFile, match="nothing to recover"):
        recover_session(tmp_path)
    (tmp_path / LOG).write_bytes(b"{}\n" + bytes(800))
    with pytest.raises(BadFile, match="is no log"):
        recover_session(tmp_path)


def test_a_model_that_was_changed_is_named(arm, tmp_path, monkeypatch):
    monkeypatch.setattr("myomorph.live.run._write_results", lambda *_: None)
    session(arm, tmp_path / "lost")
    monkeypatch.undo()
    path = arm.folder / "arm.osim"
    before = path.read_bytes()
    path.write_bytes(before + b"\n")
    try:
        with pytest.raises(BadFile, match="was changed since the session"):
            recover_session(tmp_path / "lost")
    finally:
        path.write_bytes(before)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows ends processes without a signal")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL], ids=["SIGTERM", "SIGKILL"])
def test_a_killed_process_loses_nothing(arm, tmp_path, number):
    out = tmp_path / "out"
    command = [
        *(sys.executable, "-m", "myomorph", "live", "--model", str(arm.folder / "arm.osim")),
        *("--markers", str(arm.folder / "reach.trc"), "--speed", "0.1", "--out", str(out)),
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    log = out / LOG
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline and process.poll() is None:
        if log.is_file() and log.stat().st_size > 6_000:
            break
        time.sleep(0.05)
    process.send_signal(number)
    said = process.communicate(timeout=60)[0].decode()
    if number == signal.SIGTERM:
        assert process.returncode == 0, said
        assert not log.exists()
    else:
        assert process.returncode == -number
        frames = len(read_log(log)[1])
        assert 5 < frames < 61
        assert len(recover_session(out).delays) == frames
    assert read_sto(out / "coordinates.mot").names
    assert (out / "live.nc").is_file()


class SetBack:
    """A recording whose sender's clock is set back at a frame; forces are none."""

    def __init__(self, source: Replay, at: int, by: float):
        self._source = source
        self._at = at
        self._by = by
        self._count = 0
        for name in ("names", "markers", "rate", "plates", "bodies", "force_rate", "duration"):
            setattr(self, name, getattr(source, name))
        self.speed = source.speed

    def take(self) -> Arrived:
        arrived = self._source.take()
        time = np.array(arrived.motion_time)
        index = self._count + np.arange(len(time))
        self._count += len(time)
        time[index >= self._at] -= self._by
        return Arrived(
            motion_time=time,
            motion=arrived.motion,
            force_time=arrived.force_time,
            forces=arrived.forces,
        )

    def wait(self, most: float) -> None:
        self._source.wait(most)

    def age(self, time: float) -> float:
        return float("nan")

    @property
    def done(self) -> bool:
        return self._source.done


@pytest.mark.parametrize("by", [3600.0, 0.05])
def test_a_clock_that_is_set_back_does_not_end_a_session(arm, tmp_path, monkeypatch, by):
    def opened(*given: object, **named: object):
        source, read = real(*given, **named)
        return SetBack(source, 30, by), read

    from myomorph.live import run

    real = run.open_source
    monkeypatch.setattr(run, "open_source", opened)
    ended = session(arm, tmp_path / "out")
    states = ended.delays.states()
    assert len(ended.delays) == 61
    motion = read_sto(tmp_path / "out" / "coordinates.mot")
    assert (np.diff(motion.time) > 0.0).all()
    rows = (tmp_path / "out" / "delays.csv").read_text(encoding="utf-8").splitlines()[1:]
    marked = [row for row in rows if "bad time" in row]
    if by > 1.0:
        # It begins anew: settles, then solves again.
        assert states.get(BAD_TIME, 0) == 0
        assert np.diff(motion.time).max() > PAUSE
        table = ended.delays.table
        assert table[30, 0] == pytest.approx(table[29, 0] + PAUSE)
        assert table[30, 4] == SETTLING
        assert table[-1, 4] == SOLVED
    else:
        assert len(marked) == states[BAD_TIME] > 0


def test_times_of_a_session_rise():
    stamps = SessionClock()
    times = [0.0, 0.01, float("nan"), 0.005, 0.01, 0.02, -900.0, -899.99, 50.0]
    given = [stamps.of_frame(time, float("nan")) for time in times]
    assert [stamp.is_bad for stamp in given] == [False, False, True, True, True] + 4 * [False]
    assert [stamp.restarts for stamp in given] == 6 * [False] + [True, False, False]
    good = [stamp.time for stamp in given if not stamp.is_bad]
    assert (np.diff(good) > 0.0).all()
    assert good[-2] - good[-3] == pytest.approx(0.01)


def test_forces_go_with_the_clock_of_frames():
    stamps = SessionClock()
    stamps.of_frame(10.0, 0.0)
    time, kept = stamps.of_forces(np.array([9.99, 10.0, 10.0, np.nan, 10.01]))
    assert kept.tolist() == [True, True, False, False, True]
    assert time.tolist() == [9.99, 10.0, 10.01]
    stamps.of_frame(2.0, 0.0)
    time, kept = stamps.of_forces(np.array([10.02, 2.0, 2.01]))
    # One by the old clock cannot be aligned.
    assert kept.tolist() == [False, True, True]
    np.testing.assert_allclose(time, [11.0, 11.01])


def test_frames_that_no_output_saw_are_in_the_log(arm, tmp_path: Path) -> None:
    delays = Delays()
    delays.add(0.0, 0.0, 0.0, 0.0, BAD_TIME)
    assert delays.row(0)[4] == BAD_TIME
    again = Delays.of_table(delays.table, dropped=3)
    assert again.dropped == 3
    np.testing.assert_array_equal(again.table, delays.table)
