"""Sessions that cannot be lost: killed, ended by signals, and with a clock that is set back."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.core.io.sto import read_sto
from myomorph.core.model.errors import BadFile
from myomorph.lab.store.results import read_result
from myomorph.live.interruption import asked_to_end, ended_by_signals
from myomorph.live.loop import BAD_TIME, SETTLING, SOLVED, Delays
from myomorph.live.run import LiveFiles, LiveOutputs, recover_session, run_live_chain
from myomorph.live.session_clock import PAUSE, SessionClock
from myomorph.live.session_log import CHECK, LOG, LogHead, SessionLog, read_log
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


@pytest.fixture(scope="module")
def lost(arm, tmp_path_factory):
    """Write the log of a whole session, and its results."""
    folder = tmp_path_factory.mktemp("sessions")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("myomorph.live.run._write_results", lambda *_: None)
        session(arm, folder / "lost")
    session(arm, folder / "whole")
    return folder / "lost" / LOG, folder / "whole"


def test_whatever_a_power_cut_leaves_of_the_last_rows_is_read_as_far_as_it_is_whole(lost, tmp_path):
    """Cut off at each byte, or as long as it was with zeros or old bytes of the disk behind it."""
    content = lost[0].read_bytes()
    width = read_log(lost[0]).head.width
    rows = read_log(lost[0]).rows
    begin = content.index(b"\n") + 1
    size = 8 * width
    assert len(content) == begin + 61 * size
    path = tmp_path / LOG
    for end in range(begin + 58 * size, len(content)):
        whole = (end - begin) // size
        missing = len(content) - end
        for left in (b"", bytes(missing), b"\xff" * missing, content[:missing]):
            path.write_bytes(content[:end] + left)
            stored = read_log(path)
            np.testing.assert_array_equal(stored.rows, rows[:whole])
            expected = 61 - whole if left else (end - begin) % size > 0
            assert stored.damaged == expected


def test_a_row_in_the_middle_that_is_damaged_is_left_out_alone(lost, tmp_path):
    content = bytearray(lost[0].read_bytes())
    rows = read_log(lost[0]).rows
    size = rows[0].nbytes
    content[len(content) - 31 * size + 100] ^= 1
    (tmp_path / LOG).write_bytes(content)
    stored = read_log(tmp_path / LOG)
    assert stored.damaged == 1
    np.testing.assert_array_equal(stored.rows, np.delete(rows, 30, axis=0))


def test_results_of_a_log_that_was_cut_off_are_those_of_its_frames(lost, tmp_path):
    log, whole = lost
    (tmp_path / LOG).write_bytes(log.read_bytes()[:-3000])
    stored = read_log(tmp_path / LOG)
    assert 40 < len(stored.rows) < 61
    recovered = recover_session(tmp_path)
    assert len(recovered.delays) == len(stored.rows)
    assert any("left out: 1" in note for note in recovered.notes)
    for name in ("coordinates.mot", "torques.sto", "activations.sto"):
        cut = read_sto(tmp_path / name)
        full = read_sto(whole / name)
        assert cut.names == full.names
        assert 0 < len(cut.time) < len(full.time)
        np.testing.assert_array_equal(cut.values, full.values[: len(cut.time)])


def test_a_log_cut_off_before_its_first_row_is_named(lost, tmp_path):
    content = lost[0].read_bytes()
    begin = content.index(b"\n") + 1
    for end in (0, 1, begin // 2, begin - 1, begin, begin + 100):
        (tmp_path / LOG).write_bytes(content[:end])
        with pytest.raises(BadFile, match=r"is no log|holds no frame"):
            recover_session(tmp_path)


class Interrupted(BaseException):
    """Raised at one line of the log's code."""


@pytest.mark.parametrize("line", range(0, 150, 3))
def test_an_interruption_at_any_line_leaves_one_row_per_frame(tmp_path, line):
    widths = {"delays": Delays.WIDTH, "dropped": 1, "time": 1, "coordinates": 2}
    widths |= dict.fromkeys(("velocities", "torques", "activations", "forces", "reserves"), 2)
    widths |= dict.fromkeys(("balanced", "wrenches"), 6)
    widths |= dict.fromkeys(("residual", "status", "error", "seen", "remaining", CHECK), 1)
    head = LogHead(
        model="m",
        provenance="{}",
        filter_delay=0.0,
        widths=widths,
        muscles=(),
        actuators=(),
        coordinates=(),
        lower=(),
        upper=(),
        bodies=(),
        up=(),
    )
    delays = Delays()
    lines = []

    def trace(frame, event, _):
        if not frame.f_code.co_filename.endswith("session_log.py"):
            return None
        if event == "line":
            lines.append(frame.f_lineno)
            if len(lines) == line + 1:
                raise Interrupted
        return trace

    log = SessionLog(tmp_path / LOG, head, delays)
    log._flushed = -1.0  # Each frame is written.
    before = sys.gettrace()
    try:
        sys.settrace(trace)
        for count in range(4):
            delays.add(0.01 * count, 0.0, 0.0, 0.0, SOLVED)
            if count != 1:
                log.put(_frame(count), np.zeros((0, 3)))
            log._flushed = -1.0
    except Interrupted:
        pass
    finally:
        sys.settrace(before)
    log.close()
    stored = read_log(tmp_path / LOG)
    assert stored.damaged == 0
    np.testing.assert_array_equal(stored.rows[:, head.parts["delays"]], delays.table)
    seen = stored.rows[:, head.parts["seen"].start]
    assert all(np.isnan(value) or value == count for count, value in enumerate(seen))


def _frame(count: int) -> SimpleNamespace:
    """Make a frame whose markers seen are its number."""
    two = np.zeros(2)
    shared = SimpleNamespace(
        activations=two, forces=two, reserves=two, balanced=np.zeros(6), equilibrium_residual=0.0
    )
    shared.status = 0
    frame = SimpleNamespace(time=0.01 * count, coordinates=two, velocities=two, torques=two)
    frame.tension = shared
    frame.wrenches = np.zeros((1, 6))
    frame.error = frame.owed = 0.0
    frame.seen = count
    return frame


@pytest.fixture
def heard():
    """Let Ctrl-C be heard, which a shell's background has ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.skipif(os.name != "posix", reason="Windows has no signal to oneself but Ctrl-C")
def test_the_first_signal_asks_and_the_second_interrupts(heard):
    with asked_to_end() as ended:
        os.kill(os.getpid(), signal.SIGINT)
        assert ended.wait(5.0)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="Windows has no such signal")
@pytest.mark.parametrize("block", [ended_by_signals, asked_to_end])
def test_a_signal_that_is_ignored_stays_ignored(block):
    """As `nohup` asks for, so that a session outlives its terminal."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with block() as ended:
            os.kill(os.getpid(), signal.SIGHUP)
            time.sleep(0.05)
            assert ended is None or not ended.is_set()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_full_disk_ends_a_session_with_its_reason(arm, tmp_path, monkeypatch):
    written = SessionLog._write

    def full(log, content, position):
        if position > 4_000:
            raise OSError(errno.ENOSPC, "No space left on device")
        written(log, content, position)

    monkeypatch.setattr(SessionLog, "_write", full)
    monkeypatch.setattr("myomorph.live.session_log.FLUSH", 0.0)
    with pytest.raises(OSError, match="No space"):
        session(arm, tmp_path / "lost")
    monkeypatch.undo()
    frames = len(read_log(tmp_path / "lost" / LOG).rows)
    assert len(recover_session(tmp_path / "lost").delays) == frames > 0


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
        frames = len(read_log(log).rows)
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
