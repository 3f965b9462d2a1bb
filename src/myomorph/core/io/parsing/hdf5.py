"""HDF5 files of others: read in a child first, and never out of the file itself.

The library may crash, hang or eat memory on damaged bytes. A file may also name other files, by
external links, external storage or virtual data sets: these are refused.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from myomorph.core.io.parsing.door import check_file
from myomorph.core.io.parsing.guard import run_guarded, seconds_for
from myomorph.core.model.errors import BadFile

ERRORS = (
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
    KeyError,
    AttributeError,
    MemoryError,
)
"""What h5py raises for damaged files."""
MEMORY = 4.0  # Of the child at most [GiB].
MAX_BYTES = 1 << 31  # Of a data set that is read to see whether it can be.
STEP = 1 << 26  # Bytes of a data set that are read at once.
HEAD = 120  # Characters of an error that are printed.
MAX_KNOWN = 256
_sound: dict[tuple[int, ...], None] = {}
"""Files that a child has read in this process: device, number, size and times."""


@contextmanager
def open_hdf5(path: Path, hint: str = "", in_order: bool = False) -> Iterator[Any]:
    """Open a file of somebody else to read from, once a child has read all of it.

    Parameters
    ----------
    path : of the file
    hint : what was expected, for messages
    in_order : whether names come in the order in which they were made

    Yields
    ------
    the open `h5py.File`

    Raises
    ------
    BadFile : it is no regular file or too large, the library crashed, hung or needed too much
        memory on it, or it leads to other files
    OSError : it is no HDF5
    """
    check_hdf5(path, hint)
    # Brings h5py: loaded only where it is needed.
    import h5py

    with h5py.File(path, "r", track_order=in_order or None) as file:
        yield file


def check_hdf5(path: Path, hint: str = "") -> None:
    """Read a file in another process; a file that has not changed since is read only once.

    Errors that the library reports are left to the reader.

    Parameters
    ----------
    path : of the file
    hint : what was expected, for messages

    Raises
    ------
    BadFile : see `open_hdf5`
    """
    check_file(path, "HDF5")
    status = path.stat()
    state = (
        status.st_dev,
        status.st_ino,
        status.st_size,
        status.st_mtime_ns,
        status.st_ctime_ns,
    )
    if state in _sound:
        return
    outcome = run_guarded(f"{__name__}:read_through", [path.resolve()], seconds_for(path), MEMORY)
    if outcome.status == "hung":
        problem = f"cannot be read as HDF5 (the library {outcome.message})"
        raise BadFile(path, problem, f"is it damaged? {hint}" if hint else "is it damaged?")
    if outcome.status == "failed":
        raise BadFile(path, f"cannot be read as HDF5 ({outcome.message[:HEAD]})", hint)
    while len(_sound) >= MAX_KNOWN:
        _sound.pop(next(iter(_sound)), None)
    _sound[state] = None


def read_through(path: str | os.PathLike[str]) -> None:
    """Run the child's side: touch everything that a reader may read.

    Parameters
    ----------
    path : of the file

    Raises
    ------
    BadFile : the file leads to other files
    """
    import h5py

    for in_order in (None, True):
        try:
            with h5py.File(path, "r", track_order=in_order) as file:
                _refuse_links(file)
                _touch(file)
                file.visititems(lambda name, holder: _touch(holder))
        except ERRORS:
            # The reader reports what it cannot read.
            continue


def _refuse_links(file: Any) -> None:
    """Refuse links and data sets that lead out of a file; none of them is followed."""
    import h5py

    leaving = []

    def look(name: bytes, link: Any) -> None:
        if link.type == h5py.h5l.TYPE_HARD:
            leads_out = _is_stored_elsewhere(file, name)
        else:
            leads_out = link.type != h5py.h5l.TYPE_SOFT
        if leads_out:
            leaving.append(name)

    # The library calls `look`, which must not raise.
    file.id.links.visit(look, info=True)
    if leaving:
        name = leaving[0].decode("utf-8", "replace")
        raise BadFile(f"'{name}'", "lies in another file, which is not opened")


def _is_stored_elsewhere(file: Any, name: bytes) -> bool:
    """Whether the values of a data set lie in other files."""
    import h5py

    with suppress(*ERRORS):
        holder = h5py.h5o.open(file.id, name)
        if isinstance(holder, h5py.h5d.DatasetID):
            stored = holder.get_create_plist()
            return stored.get_external_count() > 0 or stored.get_layout() == h5py.h5d.VIRTUAL
    return False


def _touch(holder: Any) -> None:
    """Read the attributes of an object, what they refer to, and the values of a data set."""
    import h5py

    with suppress(*ERRORS):
        for name in holder.attrs:
            with suppress(*ERRORS):
                _follow(holder, holder.attrs[name])
    with suppress(*ERRORS):
        if isinstance(holder, h5py.Dataset) and holder.nbytes <= MAX_BYTES:
            _read(holder)


def _follow(holder: Any, value: Any) -> None:
    """Open the objects that an attribute refers to, as dimensions of NetCDF do."""
    import h5py

    for reference in value.ravel().tolist() if hasattr(value, "ravel") else ():
        for target in reference.ravel() if hasattr(reference, "ravel") else (reference,):
            if isinstance(target, h5py.Reference):
                _ = holder.file[target].name


def _read(dataset: Any) -> None:
    """Read a data set part by part, so that little memory is needed."""
    if not dataset.shape:
        dataset[()]
        return
    rows = max(1, STEP // max(1, dataset.nbytes // max(1, dataset.shape[0])))
    for start in range(0, dataset.shape[0], rows):
        dataset[start : start + rows]
