"""How far a run is, for a program that watches it from outside: lines in files of a folder.

Where the environment names a folder, every process of a run appends what it begins and how far it
is to a file of its own there, one line of JSON each time.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

VARIABLE = "MYOMORPH_PROGRESS"
"""Names the folder; without it nothing is written."""


def is_watched() -> bool:
    """Whether somebody wants to know how far this process is."""
    return bool(os.environ.get(VARIABLE))


def announce(**values: str | float) -> None:
    """Append a line for whoever watches; that it cannot be written stops nothing.

    Parameters
    ----------
    values : what is begun (`subject`, `trial`, `step`), or how far it is (`done`, 0 to 1)
    """
    folder = os.environ.get(VARIABLE)
    if not folder:
        return
    with (
        suppress(OSError),
        (Path(folder) / f"{os.getpid()}.jsonl").open("a", encoding="utf-8") as stream,
    ):
        stream.write(json.dumps(values) + "\n")


def announcements(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield what all processes wrote, that of each in its order.

    Parameters
    ----------
    folder : that the environment of the run names
    """
    for path in sorted(folder.glob("*.jsonl")):
        with suppress(OSError, UnicodeDecodeError):
            for line in path.read_text(encoding="utf-8").splitlines():
                # The last line may be half written.
                with suppress(ValueError):
                    yield json.loads(line)
