"""Files of others at the door: regular ones, of a size that their kind allows.

Whatever is read of a stranger passes here: a pipe or a device is never opened, nothing is read that
is larger than the table allows, and the rows of a text end with their time.
"""

from __future__ import annotations

import stat
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import numpy as np

from myomorph.core.model.errors import BadFile, quoted
from myomorph.core.model.frozen_map import FrozenMap

Row = TypeVar("Row")
MEBIBYTE = 1 << 20
MAX_SIZES = FrozenMap(
    {
        "C3D": 1024 * MEBIBYTE,
        "a table": 1024 * MEBIBYTE,
        "a MATLAB file": 1024 * MEBIBYTE,
        "HDF5": 4096 * MEBIBYTE,
        "sound": 4096 * MEBIBYTE,
        "EMG": 1024 * MEBIBYTE,
        "XML": 256 * MEBIBYTE,
        "a mesh": 256 * MEBIBYTE,
        "a part of a model": 512 * MEBIBYTE,
        "landmarks": 64 * MEBIBYTE,
        "contacts": 64 * MEBIBYTE,
        "settings": 16 * MEBIBYTE,
        "names of points": MEBIBYTE,
    }
)
"""Largest file of each kind [bytes], named as in messages."""
MAX_NUMBERS = 1 << 26  # Of positions in a packed file, which may be small itself.
MAX_SECONDS = 300.0  # Of processor time, for going once through the rows of a text.
ROWS_AT_ONCE = 256  # Between two looks at the clock.


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Raise `BadFile` where the system refuses to read a file within the block.

    Parameters
    ----------
    path : of the file, for the message

    Yields
    ------
    nothing

    Raises
    ------
    BadFile : an `OSError` occurs in the block
    """
    try:
        yield
    except FileNotFoundError:
        raise BadFile(path, "no such file", _beside(path)) from None
    except OSError as error:
        raise BadFile(path, f"cannot be read ({error.strerror or error})") from None


def check_file(path: Path, kind: str) -> int:
    """Check that a file exists, is a regular one and not larger than its kind may be.

    Parameters
    ----------
    path : of the file
    kind : of content, one of `MAX_SIZES`

    Returns
    -------
    its size [bytes]

    Raises
    ------
    BadFile : it is absent, a folder, a pipe or a device, or larger
    """
    largest = MAX_SIZES[kind]
    with readable(path):
        status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        what = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe or a device"
        raise BadFile(path, f"cannot be read: it is {what}", "give a regular file")
    if status.st_size > largest:
        raise BadFile(
            path,
            f"is {status.st_size / MEBIBYTE:.0f} MiB, more than the {largest / MEBIBYTE:.0f} MiB"
            f" allowed for {kind}",
        )
    return status.st_size


def content_of(path: Path, kind: str) -> bytes:
    """Read the bytes of a file.

    Parameters
    ----------
    path : of the file
    kind : of content, one of `MAX_SIZES`

    Returns
    -------
    all of them

    Raises
    ------
    BadFile : it is no regular file, too large, or cannot be read
    """
    check_file(path, kind)
    with readable(path):
        return path.read_bytes()


def mapped_bytes(path: Path, kind: str) -> np.ndarray:
    """Map the bytes of a file into memory.

    Parameters
    ----------
    path : of the file
    kind : of content, one of `MAX_SIZES`

    Returns
    -------
    (bytes,) of type uint8, empty for an empty file

    Raises
    ------
    BadFile : it is no regular file, too large, or cannot be read
    """
    size = check_file(path, kind)
    with readable(path):
        return np.memmap(path, dtype=np.uint8, mode="r") if size else np.zeros(0, np.uint8)


def within_time(rows: Iterable[Row], path: Path) -> Iterator[Row]:
    """Yield the rows of a text until their time is over, what is done with each included.

    It is the processor time of the calling thread, so that other work of a machine does not count,
    and it is looked at between rows, so that it ends on all systems and in all threads.

    Parameters
    ----------
    rows : of the file
    path : of the file, for the message

    Yields
    ------
    each row

    Raises
    ------
    BadFile : they take more than `MAX_SECONDS`
    """
    end = time.thread_time() + MAX_SECONDS
    for number, row in enumerate(rows):
        if number % ROWS_AT_ONCE == 0 and time.thread_time() > end:
            raise BadFile(
                path,
                f"takes more than {MAX_SECONDS:g} s of processor time to read (row {number + 1})",
                "is it what it seems to be? Cut it into several files",
            )
        yield row


def _beside(path: Path) -> str:
    """List the files of the same ending in a file's folder, as a hint."""
    folder = path.parent
    if not folder.is_dir():
        return f"the folder '{folder}' does not exist"
    names = sorted(
        file.name for file in folder.iterdir() if file.suffix.lower() == path.suffix.lower()
    )
    return f"its folder has {quoted(names)}" if names else f"its folder has no '{path.suffix}' file"
