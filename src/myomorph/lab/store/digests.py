"""Digests of files (SHA-256), and the one that a result file carries as its last bytes.

Libraries for HDF5 pass over what stands behind a file's end. A result that fits its digest is as
Myomorph wrote it. This shows damage by a disk, a copy or an edit, not intent: whoever makes a file
can make its digest too.
"""

from __future__ import annotations

import hashlib
import os
import stat
import time
from enum import Enum, auto
from pathlib import Path
from typing import IO

MARK = b"\nmyomorph sha256 "
LENGTH = len(MARK) + 64 + 1  # Bytes of the mark, the digest and a line feed.
BLOCK = 1 << 20
SETTLED = 10.0
"""A file is taken to be the same while its size and times are, if it has not been touched for so
long [s].
"""
LARGE = 1 << 16  # Bytes from which a file is read only once.
MAX_KNOWN = 256
_known: dict[tuple[int, ...], str] = {}


class Seal(Enum):
    """What a file's own digest shows."""

    WHOLE = auto()
    DAMAGED = auto()
    NONE = auto()


def file_digest(path: str | os.PathLike[str]) -> str:
    """Hash a file's bytes; a large file that has not been touched since is read only once.

    Parameters
    ----------
    path : of the file

    Raises
    ------
    OSError : it cannot be read, or is a pipe or a device
    """
    if not stat.S_ISREG(os.stat(path).st_mode) and not os.path.isdir(path):
        raise OSError("it is a pipe or a device")
    with open(path, "rb") as stream:
        return _digest(stream, 0)


def seal(path: str | os.PathLike[str]) -> None:
    """Append its digest to a file that is whole.

    Parameters
    ----------
    path : of the file
    """
    with open(path, "rb+") as stream:
        digest = _hash(stream, os.fstat(stream.fileno()).st_size)
        stream.seek(0, os.SEEK_END)
        stream.write(MARK + digest.encode("ascii") + b"\n")


def seal_of(path: str | os.PathLike[str]) -> Seal:
    """Compare a file with its own digest.

    Parameters
    ----------
    path : of the file

    Returns
    -------
    whether it is whole, damaged, or carries no digest

    Raises
    ------
    OSError : it cannot be read
    """
    if not Path(path).is_file():
        return Seal.NONE
    with open(path, "rb") as stream:
        size = os.fstat(stream.fileno()).st_size - LENGTH
        if size < 0:
            return Seal.NONE
        stream.seek(size)
        end = stream.read(LENGTH)
        if not end.startswith(MARK) or not end.endswith(b"\n"):
            return Seal.NONE
        stated = end[len(MARK) : -1].decode("ascii", "replace")
        return Seal.WHOLE if _digest(stream, LENGTH) == stated else Seal.DAMAGED


def _digest(stream: IO[bytes], left_out: int) -> str:
    """Hash an open file but for so many bytes at its end, or look up what it was before."""
    status = os.fstat(stream.fileno())
    state = (
        status.st_dev,
        status.st_ino,
        status.st_size,
        status.st_mtime_ns,
        status.st_ctime_ns,
        left_out,
    )
    # One that was written just now could be written again without its time telling.
    settled = time.time() - max(status.st_mtime, status.st_ctime) > SETTLED
    if settled and state in _known:
        return _known[state]
    digest = _hash(stream, status.st_size - left_out)
    if settled and status.st_size > LARGE:
        while len(_known) >= MAX_KNOWN:
            _known.pop(next(iter(_known)), None)
        _known[state] = digest
    return digest


def _hash(stream: IO[bytes], size: int) -> str:
    """Hash the first bytes of an open file."""
    digest = hashlib.sha256()
    stream.seek(0)
    while size > 0 and (block := stream.read(min(BLOCK, size))):
        digest.update(block)
        size -= len(block)
    return digest.hexdigest()
