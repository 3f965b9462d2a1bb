"""Results round-trip through files, appear whole or not at all, and name their sources."""

from __future__ import annotations

import errno
import io
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from myomorph.core.model.errors import BadFile
from myomorph.core.model.provenance import Provenance, Source
from myomorph.core.model.series import Emg, Event, Motion, Series, Wrenches
from myomorph.core.motion.ik import KinematicsFit
from myomorph.lab.store import netcdf
from myomorph.lab.store import stored as store
from myomorph.lab.store.results import (
    file_source,
    new_result,
    provenance_of,
    read_result,
    stored_provenance,
    value_source,
    whole_folder,
)
from myomorph.lab.store.stored_fit import get_fit, put_fit
from myomorph.lab.store.stored_tension import get_tension

TIME = np.arange(5) / 10.0
NAMES = ("a", "b", "c")


@pytest.fixture
def values():
    return np.random.default_rng(7).standard_normal((5, 3))


def test_series_survive(tmp_path, values):
    wrenches = Wrenches(
        time=TIME,
        names=("w",),
        bodies=("foot",),
        forces=values[:, None],
        points=values[:, None] + 1,
        torques=values[:, None] + 2,
    )
    emg = Emg(np.arange(20) / 40.0, ("m",), np.random.default_rng(1).random((20, 1)))
    events = (Event(0.1, "Foot Strike", "Left"), Event(0.3, "Ünicode"))
    with new_result(tmp_path / "x.nc") as writer:
        writer.time(TIME)
        store.put_torques(writer, Series(TIME, NAMES, values), wrenches)
        store.put_emg(writer, emg)
        store.put_events(writer, events)
        store.put_truth(writer, {"coordinate_value": Series(TIME, NAMES, 2 * values)})
    found = read_result(tmp_path / "x.nc")
    np.testing.assert_array_equal(store.get_torques(found).values, values)
    back = store.get_wrenches(found)
    assert (back.names, back.bodies) == (("w",), ("foot",))
    np.testing.assert_array_equal(back.torques, wrenches.torques)
    np.testing.assert_array_equal(store.get_emg(found).values, emg.values)
    assert store.get_events(found) == events
    np.testing.assert_array_equal(store.get_truth(found)["coordinate_value"].values, 2 * values)
    assert get_tension(found, None) is None
    assert get_fit(found) is None


def test_forces_of_which_none_is_left_are_no_forces(tmp_path, values):
    """Plates on which nobody steps while a motion lasts are left out, all of them in the end."""
    nothing = np.zeros((5, 0, 3))
    none = Wrenches(time=TIME, names=(), bodies=(), forces=nothing, points=nothing, torques=nothing)
    with new_result(tmp_path / "x.nc") as writer:
        writer.time(TIME)
        store.put_torques(writer, Series(TIME, NAMES, values), none)
    found = read_result(tmp_path / "x.nc")
    np.testing.assert_array_equal(store.get_torques(found).values, values)
    assert store.get_wrenches(found) is None


def test_fit_survives_with_gaps(tmp_path, values):
    class Model:
        """Enough of a model to tell units."""

        @staticmethod
        def coordinate(name):
            return type("Coordinate", (), {"motion": "rotational"})

    errors = np.abs(values).copy()
    errors[2] = np.nan
    fit = KinematicsFit(
        motion=Motion(TIME, NAMES, values),
        marker_names=NAMES,
        marker_error=errors,
        marker_weight=np.ones(3),
        converged=np.array([1, 1, 0, 1, 1], bool),
        iterations=np.arange(5),
        unused_markers=("x",),
        missing_markers=(),
    )
    with new_result(tmp_path / "x.nc") as writer:
        put_fit(writer, fit, Model())
    back = get_fit(read_result(tmp_path / "x.nc"))
    np.testing.assert_array_equal(back.marker_error, errors)
    np.testing.assert_array_equal(back.converged, fit.converged)
    assert (back.unused_markers, back.missing_markers) == (("x",), ())


def test_a_result_appears_whole_or_not_at_all(tmp_path):
    (tmp_path / "x.nc").write_bytes(b"earlier")

    def broken():
        with new_result(tmp_path / "x.nc") as writer:
            writer.time(TIME)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        broken()
    assert [path.name for path in tmp_path.iterdir()] == ["x.nc"]
    assert (tmp_path / "x.nc").read_bytes() == b"earlier"


def test_a_folder_appears_whole_or_not_at_all(tmp_path):
    def broken():
        with whole_folder(tmp_path / "out") as folder:
            (folder / "a.sto").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        broken()
    assert list(tmp_path.iterdir()) == []
    with whole_folder(tmp_path / "out") as folder:
        (folder / "a.sto").write_text("one")
    with whole_folder(tmp_path / "out") as folder:
        (folder / "b.sto").write_text("two")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["a.sto", "b.sto"]
    assert len(list(tmp_path.iterdir())) == 1


def test_a_folder_inside_is_renewed_file_by_file(tmp_path):
    """As the motions of a transfer that is run anew."""
    for text in ("one", "two"):
        with whole_folder(tmp_path / "out") as folder:
            (folder / "motions").mkdir()
            (folder / "motions" / f"{text}.mot").write_text(text)
            (folder / "motions" / "walk.mot").write_text(text)
    assert sorted(path.name for path in (tmp_path / "out" / "motions").iterdir()) == [
        "one.mot",
        "two.mot",
        "walk.mot",
    ]
    assert (tmp_path / "out" / "motions" / "walk.mot").read_text() == "two"


def test_only_some_steps_are_taken_over(tmp_path, values):
    for step in ("ik", "id"):
        with new_result(tmp_path / f"{step}.nc", step) as writer:
            writer.time(TIME)
            writer.put(f"{step}_value", ("time",), values[:, 0], "m", "a value")
            writer.provenance(provenance_of(step, (), {}))
    with new_result(tmp_path / "both.nc") as writer:
        writer.copy(tmp_path / "ik.nc", ("ik",))
        writer.copy(tmp_path / "id.nc", ("id",))
    with new_result(tmp_path / "one.nc") as writer:
        writer.copy(tmp_path / "both.nc", ("id",))
    found = read_result(tmp_path / "one.nc")
    assert set(found.values) == {"time", "id_value"}
    assert set(found.provenance) == {"id"}
    assert set(stored_provenance(tmp_path / "both.nc")) == {"ik", "id"}


def test_large_values_are_copied_block_by_block(tmp_path):
    values = np.random.default_rng(2).standard_normal((1300, 70))
    with new_result(tmp_path / "a.nc", "ik") as writer:
        writer.time(np.arange(1300) / 100.0)
        writer.names("column", [f"c{i}" for i in range(70)])
        variable = writer.create("x", ("time", "column"), "m", "x")
        for start in range(0, 1300, 333):
            variable[start : start + 333] = values[start : start + 333]
    with new_result(tmp_path / "b.nc") as writer:
        writer.copy(tmp_path / "a.nc", ("ik",))
    np.testing.assert_array_equal(read_result(tmp_path / "b.nc").values["x"], values)


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "x.nc"
    path.write_bytes(b"CDF\x01 not ours")
    with pytest.raises(BadFile, match=r"x\.nc: is not a result"):
        read_result(path)
    assert stored_provenance(path) == {}
    assert stored_provenance(tmp_path / "absent.nc") == {}


def test_hash_of_a_file_is_that_of_its_bytes(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    # FIPS 180-2, appendix B.1.
    known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert file_source("model", tmp_path / "a").sha256 == known
    with pytest.raises(BadFile, match="cannot be read"):
        file_source("model", tmp_path / "b")
    assert (
        value_source("x", "n", np.arange(3)).sha256 != value_source("x", "n", np.arange(4)).sha256
    )


@given(
    st.text(max_size=8),
    st.lists(st.tuples(st.text(max_size=5), st.text(max_size=5), st.text(max_size=5)), max_size=3),
    st.dictionaries(
        st.text(max_size=5),
        st.none() | st.booleans() | st.integers() | st.text(max_size=5),
        max_size=3,
    ),
)
def test_provenance_round_trips(step, sources, options):
    made = Provenance(
        step=step,
        sources=tuple(
            Source(role=role, name=name, sha256=sha256) for role, name, sha256 in sources
        ),
        options=options,
        version="1.0",
        date="2024-01-01T00:00:00+00:00",
    )
    back = Provenance.from_json(made.to_json())
    assert back == made
    assert back.key == made.key


def test_key_changes_with_what_matters_only():
    made = provenance_of("ik", (Source("model", "a.osim", "1"),), {"x": 1})
    same = Provenance(
        step="ik",
        sources=(Source("model", "elsewhere/b.osim", "1"),),
        options={"x": 1},
        version=made.version,
        date="another day",
    )
    assert same.key == made.key
    others = (
        Provenance(step="id", sources=made.sources, options=made.options, version=made.version),
        Provenance(
            step="ik",
            sources=(Source("model", "a.osim", "2"),),
            options=made.options,
            version=made.version,
        ),
        Provenance(step="ik", sources=made.sources, options={"x": 2}, version=made.version),
        Provenance(step="ik", sources=made.sources, options=made.options, version="other"),
    )
    assert len({made.key, *(other.key for other in others)}) == 5
    with pytest.raises(ValueError, match="not a provenance"):
        Provenance.from_json("{}")


class FillingUp(io.FileIO):
    """A file on a disk that is soon full."""

    room = 4000

    def write(self, content):
        if self.room < len(content):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.room -= len(content)
        return super().write(content)


def test_a_full_disk_is_an_error_and_leaves_nothing(tmp_path, monkeypatch):
    """HDF5 itself may end the process where it cannot write."""
    monkeypatch.setattr(
        netcdf, "open", lambda path, mode, buffering: FillingUp(path, "w+"), raising=False
    )

    def write():
        with new_result(tmp_path / "a.nc", "ik") as writer:
            writer.time(np.arange(1000.0))
            for number in range(50):
                writer.put(f"x{number}", ("time",), np.ones(1000), "m", "a value")

    with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
        write()
    assert list(tmp_path.iterdir()) == []


def test_the_mass_is_a_number_with_a_unit_and_survives_a_copy(tmp_path):
    xarray = pytest.importorskip("xarray")
    with new_result(tmp_path / "x.nc", "ik") as writer:
        writer.time(TIME)
        writer.fact("mass", repr(72.6))
    with new_result(tmp_path / "y.nc") as writer:
        writer.copy(tmp_path / "x.nc", ("ik",))
    for name in ("x.nc", "y.nc"):
        with xarray.open_dataset(tmp_path / name) as found:
            assert found.attrs["mass"] == 72.6
            assert found.attrs["mass_unit"] == "kg"
        assert read_result(tmp_path / name).facts["mass"] == "72.6"


def test_a_mass_that_is_not_known_is_left_out(tmp_path):
    with new_result(tmp_path / "x.nc") as writer:
        writer.time(TIME)
        writer.fact("mass", "")
    assert "mass" not in read_result(tmp_path / "x.nc").facts
