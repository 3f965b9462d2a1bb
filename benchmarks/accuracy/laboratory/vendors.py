"""`myomorph analyze` on every file of a collection of vendors' samples.

The result is a report, or one line that names what helps. Each file is one command in a process
of its own, with a limit of time: a reader that hangs or dies is a row too.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import myomorph as mm

Row = dict[str, object]
SETS = (
    "c3d-vendor-samples",
    "c3d-shoulder-emg-handle",
    "wheelchair-pushrim",
    "shoulder-bonepin",
    "odd-trc-mot",
)
"""Folders of samples and of recordings that are not of legs."""
WINDOW = 0.4
"""Part of a recording, about its middle, that is analyzed [s]."""
LIMIT = 300.0
"""Longest time of a command [s]."""
FAILURE = re.compile("error:|FAILED:|Traceback")
OPTION = re.compile(r"--[a-z][a-z-]*|: give |; give |expected ")
"""What a line has that names what to do: an option, or the file that is needed."""


def measure(folder: Path) -> Iterator[Row]:
    """Yield each file's exit status, and whether its one line names what helps."""
    for name in SETS:
        home = folder / name
        for path in sorted(
            one for one in home.rglob("*") if one.suffix.lower() in (".c3d", ".trc")
        ):
            yield _row(path, folder)


class _Ended(NamedTuple):
    """How a command ended.

    Attributes
    ----------
    status : None where it hung
    lines : that it printed
    reports : number of reports that it wrote
    """

    status: int | None
    lines: Sequence[str]
    reports: int


def _row(path: Path, folder: Path) -> Row:
    started = time.monotonic()
    ended = _analyzed(path)
    seconds = time.monotonic() - started
    failed = [line.strip() for line in ended.lines if FAILURE.search(line)]
    line = (failed or ended.lines[-1:] or [""])[0]
    line = line.removeprefix("error: ").replace(f"{path}: ", "")
    fine = ended.status == 0 and ended.reports > 0
    one_line = ended.status == 2 and len(failed) == 1
    ending = "one line" if one_line else f"exit {ended.status}"
    helps = "yes" if OPTION.search(line) else "no"
    return {
        "file": str(path.relative_to(folder)),
        "ends with": "report" if fine else ending,
        "line": "" if fine else line.replace("|", "/")[:160],
        "names what helps": "" if fine else helps,
        "time [s]": seconds,
    }


def _analyzed(path: Path) -> _Ended:
    """Run `myomorph analyze` on the middle of a file, in a process of its own."""
    words = ["analyze", str(path), "--mass", "70", "--workers", "1", *_window(path)]
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "out"
        try:
            ended = subprocess.run(
                [sys.executable, "-m", "myomorph", *words, "--out", str(out)],
                capture_output=True,
                text=True,
                timeout=LIMIT,
            )
            status = ended.returncode
            lines = [*ended.stdout.splitlines(), *ended.stderr.splitlines()]
        except subprocess.TimeoutExpired:
            status = None
            lines = [f"still running after {LIMIT:.0f} s"]
        return _Ended(status=status, lines=lines, reports=len(list(out.rglob("report.html"))))


def _window(path: Path) -> list[str]:
    """Return the middle of a recording; nothing where it cannot be read or is shorter."""
    try:
        markers = mm.read_recording(path).markers
    except mm.MyomorphError:
        return []
    if markers is None or len(markers) < 2:
        return []
    first = float(markers.time[0])
    last = float(markers.time[-1])
    if last - first <= WINDOW:
        return []
    middle = 0.5 * (first + last)
    return ["--time", f"{middle - 0.5 * WINDOW:.3f}", f"{middle + 0.5 * WINDOW:.3f}"]
