"""One run at a time in a folder, one process at a time in a trial's.

None of a version that knows less.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from myomorph import __version__
from myomorph.core.model.errors import BadData, BadFile
from myomorph.lab.store.locks import FORMAT, MARK, folder_lock, read_mark, study_lock

HOLD = """
import sys
from pathlib import Path
from myomorph.lab.store.locks import {lock}
with {lock}(Path({folder!r})):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def holder():
    """Another process that holds a lock until its input ends."""
    begun = []

    def hold(lock, folder):
        text = HOLD.format(lock=lock, folder=str(folder))
        child = subprocess.Popen(
            [sys.executable, "-c", text], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        begun.append(child)
        assert child.stdout.readline().strip() == b"held"
        return child

    yield hold
    for child in begun:
        child.kill()
        child.wait()


def test_a_second_run_is_told_who_was_first(tmp_path, holder):
    out = tmp_path / "a study, mëasured"
    child = holder("study_lock", out)
    with (
        pytest.raises(
            BadData, match=rf"another run writes there \(process {child.pid} on .*, since 20"
        ),
        study_lock(out),
    ):
        pass
    child.kill()
    child.wait()
    with study_lock(out) as mark:
        assert mark.process == os.getpid()
    assert sorted(path.name for path in out.iterdir()) == [MARK]


def test_within_one_process_too(tmp_path):
    with (
        study_lock(tmp_path),
        pytest.raises(BadData, match="another run writes there"),
        study_lock(tmp_path),
    ):
        pass


def test_a_trial_waits_for_the_process_that_writes(tmp_path, holder):
    folder = tmp_path / "s01" / "walk"
    child = holder("folder_lock", folder)
    with (
        pytest.raises(BadData, match="another process still writes there"),
        folder_lock(folder, patience=0.2),
    ):
        pass
    child.kill()
    with folder_lock(folder, patience=60.0):
        pass
    assert not list(tmp_path.rglob(".*"))


def test_a_process_of_an_earlier_run_gives_up(tmp_path):
    """One that was cut off must not write what the run after it has made."""
    with study_lock(tmp_path) as first:
        first.check()
        with folder_lock(tmp_path / "s01" / "walk", first):
            pass
    with study_lock(tmp_path):
        with pytest.raises(BadData, match="another run has begun"):
            first.check()
        with (
            pytest.raises(BadData, match="another run has begun"),
            folder_lock(tmp_path / "s01" / "walk", first),
        ):
            pass


@pytest.mark.parametrize(
    "told", [{"format": FORMAT + 1}, {"version": "999.0"}, {"version": f"{__version__}.1"}]
)
def test_a_folder_of_a_newer_version_is_refused(tmp_path, told):
    with study_lock(tmp_path):
        pass
    path = tmp_path / MARK
    path.write_text(json.dumps(json.loads(path.read_text()) | told))
    before = path.read_bytes()
    with pytest.raises(BadData, match="newer than this one"), study_lock(tmp_path):
        pass
    assert path.read_bytes() == before


@pytest.mark.parametrize("version", ["0.0.1", "0.0.1rc2", __version__])
def test_a_folder_of_an_older_version_is_used(tmp_path, version):
    with study_lock(tmp_path):
        pass
    path = tmp_path / MARK
    path.write_text(json.dumps(json.loads(path.read_text()) | {"version": version}))
    with study_lock(tmp_path):
        assert read_mark(tmp_path).version == __version__


def test_a_mark_that_is_none(tmp_path):
    (tmp_path / MARK).write_text("{}")
    with pytest.raises(BadFile, match="does not state which run wrote here"), study_lock(tmp_path):
        pass


def test_a_file_in_the_place_of_the_folder(tmp_path):
    path = tmp_path / "out"
    path.write_text("")
    with pytest.raises(BadFile, match="is a file"), study_lock(path):
        pass
    with pytest.raises(BadFile, match="cannot be written"), study_lock(path / "below"):
        pass
