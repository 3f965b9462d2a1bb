"""Whether an HDF5 file can be read, tried in a child process: the library hangs on some damaged files.

`python -m myomorph.io.parsing.hdf5_guard FILE` is the child's side.
"""

from __future__ import annotations

import sys
from pathlib import Path

from myomorph.io.parsing.guard import limit_memory, run_guarded
from myomorph.model.errors import BadFile

SECONDS = 10.0
BYTES_PER_SECOND = 20e6
LARGEST = 1 << 31
"""Bytes of a data set that are read to see whether they can be."""

MEMORY = 4.0
"""Of the child at most [GiB]."""


def check_hdf5(path: Path, hint: str) -> None:
    """Raise `BadFile` where the library crashes or hangs on a file; what it says of one, the reader meets itself."""
    seconds = SECONDS + path.stat().st_size / BYTES_PER_SECOND
    outcome = run_guarded("myomorph.io.parsing.hdf5_guard", [str(path.resolve())], seconds)
    if outcome.status == "hung":
        raise BadFile(path, f"cannot be read as HDF5 (the library {outcome.message})", f"is it damaged? {hint}")
    if outcome.status == "failed":
        raise BadFile(path, f"cannot be read as HDF5 ({outcome.message[:120]})", hint)


def _main() -> int:
    import h5py

    limit_memory(MEMORY)
    try:
        with h5py.File(sys.argv[1], "r") as file:
            for holder in (file, *file.values()):
                dict(holder.attrs)
                if isinstance(holder, h5py.Dataset) and holder.nbytes <= LARGEST:
                    holder[...]
    except (OSError, RuntimeError, TypeError, ValueError, KeyError, AttributeError, MemoryError):
        # The reader tells what it is that it cannot read.
        return 0
    return 0


if __name__ == "__main__":
    sys.exit(_main())
