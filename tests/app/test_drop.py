"""Files that a browser sends."""

from __future__ import annotations

import io

import pytest

from myomorph.core.model.errors import BadData, BadFile
from myomorph.show.app import drop


@pytest.fixture
def begun(tmp_path):
    return drop.new_drop(tmp_path / "S 01", [4, 4])


def test_files_come_whole_into_folders(begun):
    begun.receive("Läufe/walk 1.c3d", io.BytesIO(b"abcd"), 4)
    begun.receive("Läufe/walk 1_grf.mot", io.BytesIO(b"efgh"), 4)
    assert (begun.folder / "Läufe" / "walk 1.c3d").read_bytes() == b"abcd"
    assert sorted(path.name for path in begun.files) == ["walk 1.c3d", "walk 1_grf.mot"]


def test_a_file_that_ends_too_early_is_not_there(begun):
    with pytest.raises(BadFile, match="arrived incomplete"):
        begun.receive("walk.c3d", io.BytesIO(b"ab"), 4)
    assert list(begun.folder.iterdir()) == []


@pytest.mark.parametrize("name", ["film.mp4", "walk.exe", "walk", "walk.c3d.lnk"])
def test_only_recordings_and_what_belongs_to_them_are_taken(begun, name):
    with pytest.raises(BadFile, match=r"is not a recording and belongs to none; expected .*\.c3d"):
        begun.receive(name, io.BytesIO(b"abcd"), 4)
    assert list(begun.folder.iterdir()) == []


def test_a_file_does_not_come_twice(begun):
    begun.receive("walk.c3d", io.BytesIO(b"abcd"), 4)
    with pytest.raises(BadFile, match="came twice"):
        begun.receive("./walk.c3d", io.BytesIO(b"efgh"), 4)
    assert (begun.folder / "walk.c3d").read_bytes() == b"abcd"


def test_nothing_leads_out_of_the_folder(begun):
    with pytest.raises(BadFile, match="below a folder"):
        begun.receive("../walk.c3d", io.BytesIO(b"abcd"), 4)


def test_limits(tmp_path, monkeypatch):
    monkeypatch.setattr(drop, "MAX_FILE", 10)
    monkeypatch.setattr(drop, "MAX_ALL", 15)
    monkeypatch.setattr(drop, "MAX_FILES", 2)
    begun = drop.Drop(folder=tmp_path, left=15)
    with pytest.raises(BadFile, match=r"too large to be dropped.*name their folder"):
        begun.receive("a.c3d", io.BytesIO(b""), 11)
    begun.receive("a.c3d", io.BytesIO(b"0123456789"), 10)
    with pytest.raises(BadFile, match="too large"):
        begun.receive("b.c3d", io.BytesIO(b"0123456789"), 10)
    begun.receive("b.c3d", io.BytesIO(b"01234"), 5)
    with pytest.raises(BadFile, match="more than 2 files"):
        begun.receive("c.c3d", io.BytesIO(b""), 0)
    with pytest.raises(BadData, match=r"3 files .* were dropped: name their folder"):
        drop.new_drop(tmp_path / "x", [1, 1, 1])
    with pytest.raises(BadData, match=r"were dropped: name their folder"):
        drop.new_drop(tmp_path / "x", [16])
    with pytest.raises(BadData, match="nothing was dropped"):
        drop.new_drop(tmp_path / "x", [])
    assert not (tmp_path / "x").exists()


def test_a_full_disk_is_said_before(tmp_path, monkeypatch):
    monkeypatch.setattr(drop, "RESERVE", 1 << 60)
    with pytest.raises(BadFile, match="free space; make room"):
        drop.new_drop(tmp_path / "x", [1])


@pytest.mark.parametrize(
    ("dropped", "name"),
    [
        (["S 01/walk.c3d", "S 01/Static/s.c3d"], "S 01"),
        (["walk 1.c3d", "walk 1_grf.mot"], "walk 1"),
        (["a/x.c3d", "b/y.c3d"], "x"),
        (["a/x.c3d", "y.c3d"], "x"),
    ],
)
def test_names_of_what_was_dropped(dropped, name):
    assert drop.common_name(dropped) == name
