"""What happened in a study, line by line with the time: `study.log`, and how long each step took: `timings.csv`."""

from __future__ import annotations

import os
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import TextIO

from myomorph.store.outcome import Outcome

LOG, TIMINGS = "study.log", "timings.csv"
HEADING = "subject,trial,step,frames,seconds"


class StudyLog:
    """The log of a study, to which every run adds; that it cannot be written stops nothing."""

    def __init__(self, folder: Path):
        self._log = _appended(folder / LOG)
        self._timings = _appended(folder / TIMINGS)
        if self._timings is not None and not self._timings.tell():
            self._put(self._timings, HEADING)

    def say(self, text: str) -> None:
        """Add a line."""
        now = datetime.now().astimezone().isoformat(timespec="seconds")
        self._put(self._log, f"{now} {' '.join(text.split())}")

    def time(self, outcome: Outcome) -> None:
        """Add how long the steps of a trial took that were computed now."""
        names = ",".join(_quoted(name) for name in (outcome.subject, outcome.trial))
        lines = [f"{names},{step},{outcome.frames},{seconds:.3f}" for step, seconds in outcome.timed]
        if lines:
            self._put(self._timings, "\n".join(lines))

    def close(self) -> None:
        """Close the files."""
        for file in (self._log, self._timings):
            if file is not None:
                with suppress(OSError):
                    file.close()

    @staticmethod
    def _put(file: TextIO | None, text: str) -> None:
        if file is not None:
            with suppress(OSError):
                file.write(text + "\n")
                file.flush()


def _appended(path: Path) -> TextIO | None:
    """A file open at its end, on a line of its own although an earlier run may have been cut off in one."""
    try:
        cut = path.is_file() and path.stat().st_size > 0 and not _ends_with_line(path)
        file = path.open("a", encoding="utf-8", newline="\n")
        if cut:
            file.write("\n")
        return file
    except OSError:
        return None


def _ends_with_line(path: Path) -> bool:
    with path.open("rb") as stream:
        stream.seek(-1, os.SEEK_END)
        return stream.read(1) == b"\n"


def _quoted(name: str) -> str:
    """A name as a field of a table."""
    return '"' + name.replace('"', '""') + '"' if set(name) & set(',"\n\r') else name
