"""Models of myo-sim are composed once, and again whenever what is kept cannot be trusted."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from myomorph.core.io.mjcf import composed
from myomorph.core.io.mjcf.composed import composed_model
from myomorph.core.model.cache_folder import kernel_folder
from myomorph.core.model.errors import BadFile

NAME = "myofinger"
pytest.importorskip("myo_sim")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    return kernel_folder()


def files_of(folder):
    return sorted(folder.glob("composed-*"))


def composing(monkeypatch):
    """Count how often a model is composed."""
    names = []
    compose = composed._composed

    def counted(name):
        names.append(name)
        return compose(name)

    monkeypatch.setattr(composed, "_composed", counted)
    return names


def test_the_same_model_is_composed_once(folder, monkeypatch):
    names = composing(monkeypatch)
    first = composed_model(NAME)
    again = composed_model(f"myo-sim:{NAME}")
    assert names == [NAME]
    assert pickle.dumps(again) == pickle.dumps(pickle.loads(pickle.dumps(first)))
    assert not again.bodies[-1].mass_center.flags.writeable
    assert len(files_of(folder)) == 1


@pytest.mark.parametrize("place", [3, 40, -1])
def test_a_damaged_file_is_composed_anew(folder, monkeypatch, place):
    first = composed_model(NAME)
    (file,) = files_of(folder)
    content = bytearray(file.read_bytes())
    content[place] ^= 1
    file.write_bytes(content)
    names = composing(monkeypatch)
    again = composed_model(NAME)
    assert names == [NAME]
    np.testing.assert_array_equal(again.bodies[-1].mass_center, first.bodies[-1].mass_center)
    composed_model(NAME)
    assert names == [NAME]


def test_another_version_replaces_what_was_kept(folder, monkeypatch):
    composed_model(NAME)
    (old,) = files_of(folder)
    names = composing(monkeypatch)
    monkeypatch.setattr(composed, "version", lambda package: "another")
    composed_model(NAME)
    (new,) = files_of(folder)
    assert names == [NAME]
    assert new != old


def test_a_folder_that_cannot_be_written_stops_nothing(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("", encoding="utf-8")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(blocked))
    assert composed_model(NAME).name == NAME


def test_a_name_that_does_not_exist_is_named(folder):
    with pytest.raises(BadFile, match="no such model of myo-sim"):
        composed_model("../nothing")
    assert not files_of(folder)
