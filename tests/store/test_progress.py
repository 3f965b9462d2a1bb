"""Short work is silent; long work tells its end in one line, or shows a bar on a terminal."""

from __future__ import annotations

import io
import sys

import pytest

from myomorph.lab.store import progress as module
from myomorph.lab.store.progress import progress


class Terminal(io.StringIO):
    """Standard error that says it is a terminal."""

    def isatty(self):
        return True


@pytest.fixture
def stderr(monkeypatch):
    def use(stream, patience):
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setattr(module, "PATIENCE", patience)
        return stream

    return use


def work(frames=10, stop_at=10):
    with progress("walk: inverse kinematics", frames) as advance:
        for frame in range(frames):
            if frame == stop_at:
                raise KeyboardInterrupt
            advance(1)


def test_short_work_is_silent(stderr):
    for stream in (io.StringIO(), Terminal()):
        stderr(stream, 60.0)
        work()
        assert stream.getvalue() == ""


def test_long_work_without_a_terminal_is_one_line(stderr):
    stream = stderr(io.StringIO(), -1.0)
    work()
    assert stream.getvalue().startswith("walk: inverse kinematics: 10 frames in ")
    assert stream.getvalue().count("\n") == 1


def test_long_work_on_a_terminal_shows_a_bar(stderr):
    stream = stderr(Terminal(), -1.0)
    work()
    assert "walk: inverse kinematics" in stream.getvalue()
    assert "10/10" in stream.getvalue()


@pytest.mark.parametrize("kind", [io.StringIO, Terminal])
def test_an_error_passes_through(stderr, kind):
    stream = stderr(kind(), -1.0)
    with pytest.raises(KeyboardInterrupt):
        work(stop_at=5)
    assert "frames in" not in stream.getvalue()
