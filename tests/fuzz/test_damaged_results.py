"""A file of results that is damaged or another program's is named, whatever HDF5 makes of it."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from myomorph.core.model.errors import BadFile
from myomorph.lab.store.results import read_result, stored_provenance


def _link_to_nothing(file: h5py.File) -> None:
    file["values"] = h5py.SoftLink("/nowhere")


def _group(file: h5py.File) -> None:
    file.create_group("inner")["values"] = np.zeros(3)


def _huge(file: h5py.File) -> None:
    # The file is small: HDF5 stores nothing for values that were never written.
    file.create_dataset("values", (1 << 44,))


def _text_for_provenance(file: h5py.File) -> None:
    file.attrs["provenance_ik"] = "{"


@pytest.mark.parametrize("spoil", [_link_to_nothing, _group, _huge, _text_for_provenance])
def test_it_is_named(tmp_path: Path, spoil) -> None:
    with h5py.File(tmp_path / "a.nc", "w") as file:
        file["time"] = np.zeros(3)
        spoil(file)
    with pytest.raises(BadFile, match="is not a result of Myomorph"):
        read_result(tmp_path / "a.nc")
    assert stored_provenance(tmp_path / "a.nc") == {}
