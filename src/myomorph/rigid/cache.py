"""Compiled kernels on disk: those of another version are forgotten, and processes save theirs in turns.

Numba keeps machine code beside the sources, and pip leaves it there when it replaces them. Its index
names our classes; where a version has renamed one, reading the index fails before Numba can see that it
is out of date.

Numba numbers the files of a kernel by what the index holds, and writes index and code one after the other. Two
processes that compile at the same time can give one number to the code of two signatures, and either is then
called with the arguments of the other.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

from filelock import FileLock
from numba.core.caching import IndexDataCacheFile

from myomorph import __version__

STAMP = "kernels-of-version"
LOCK = "kernels.lock"
PATIENCE = 60.0
"""How long a process waits until others have saved a kernel [s]; after that it keeps its own to itself."""


def forget_other_versions(package: Path) -> int:
    """Delete compiled kernels in a package's `__pycache__` folders unless this version made them.

    Returns how many files were deleted. A folder that cannot be written holds no kernels of ours.
    """
    stamp = package / "__pycache__" / STAMP
    deleted = 0
    with contextlib.suppress(OSError):
        if stamp.is_file() and stamp.read_text("utf-8") == __version__:
            return 0
        for kernel in package.rglob("__pycache__/*.nb[ic]"):
            kernel.unlink()
            deleted += 1
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(__version__, "utf-8")
    return deleted


class KernelFile(IndexDataCacheFile):  # type: ignore[misc]
    """The files of one kernel, one process at a time: code first, then the index that names it."""

    def save(self, key: Any, data: Any) -> None:
        """Save the code of one signature; where others do not let go, or nothing can be written, it is not saved."""
        folder = Path(self._cache_path)
        try:
            with FileLock(folder / LOCK, timeout=PATIENCE):
                named = self._load_index()
                free = (self._data_name(number) for number in range(1, len(named) + 2))
                name = named.get(key) or next(one for one in free if one not in named.values())
                self._save_data(name, data)
                self._save_index(named | {key: name})
        except OSError:
            return


def save_in_turns() -> None:
    """Let every kernel of this process be saved as `KernelFile` does."""
    IndexDataCacheFile.save = KernelFile.save
