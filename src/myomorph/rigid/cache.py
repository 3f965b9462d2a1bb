"""Kernels that another version compiled are forgotten, because they may not load any more.

Numba keeps machine code beside the sources, and pip leaves it there when it replaces them. Its index
names our classes; where a version has renamed one, reading the index fails before Numba can see that it
is out of date.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

from myomorph import __version__

STAMP = "kernels-of-version"


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
