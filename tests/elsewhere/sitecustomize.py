"""Make a Python on Linux behave as on another system.

A child process with this folder on its path imports it first.

- Processes are spawned, as on Windows and macOS, never forked.
- A file that is opened without an encoding is cp1252, as on Windows; PYTHONIOENCODING does the same
  for the terminal.
- A file that is open cannot be replaced, renamed or deleted, as on Windows: neither by the process
  that has it open
  nor while the process HOLDER has.
- fcntl (Windows) is not there.
"""

import builtins
import errno
import io
import multiprocessing
import os
import sys
from collections.abc import Callable
from typing import Any

sys.modules["fcntl"] = None  # type: ignore[assignment]

multiprocessing.set_start_method("spawn")
del os.fork

open_with_encoding = io.open


def open_as_windows(
    file: Any, mode: str = "r", buffering: int = -1, encoding: Any = None, *others: Any, **more: Any
) -> Any:
    """`open` whose encoding, where none is given, is cp1252."""
    if "b" not in mode and encoding in (None, "locale"):
        encoding = "cp1252"
    return open_with_encoding(file, mode, buffering, encoding, *others, **more)


io.open = builtins.open = open_as_windows  # type: ignore[assignment]


def is_open(path: Any) -> bool:
    """Whether this process or HOLDER has a file open."""
    if isinstance(path, int) or not os.path.isfile(path):
        return False
    wanted = os.stat(path)
    for process in {"self", os.environ.get("HOLDER", "self")}:
        for one in os.listdir(f"/proc/{process}/fd"):
            try:
                if os.path.samestat(os.stat(f"/proc/{process}/fd/{one}"), wanted):
                    return True
            except OSError:
                continue
    return False


def refusing(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return the function, which first checks whether its paths are open."""

    def looked(*paths: Any, **options: Any) -> Any:
        if any(map(is_open, paths)):
            error = PermissionError(errno.EACCES, "Access is denied", paths[0])
            if len(paths) > 1:
                error.filename2 = paths[1]
            raise error
        return function(*paths, **options)

    return looked


for name in ("replace", "rename", "unlink", "remove"):
    setattr(os, name, refusing(getattr(os, name)))
