"""Readers given files that grow: the exponent of their time, which should be 1.

`python -m benchmarks.reading_times [READER]` takes the sound files of `tests/fuzz`, repeats a
part of each (a line, an element of XML, an opened comment, a column) until the file has so many
bytes, and measures the processor time of reading. The exponent is that of the largest sizes whose
time is long enough to be measured; a reader's row has its worst part.
"""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "tests" / "fuzz"
SIZES = (50_000, 100_000, 200_000)
ENOUGH = 0.02  # Processor time from which an exponent is measured [s].
SLOW = 3.0  # A reader that takes longer is not given larger files [s].
REPEATS = 2
PARTS = 3  # Of each kind in a file.
ELEMENT = re.compile(rb"<(\w+)[^<>]*/>|<(\w+)[^<>]*>[^<>]*</\2>")
ODD = (b"<!--", b"<!DOCTYPE ", b"&", b"[", b'"', b"a,", b"a\t", b"\n", b" ")
"""Pieces that are repeated before the end of a file too."""


def run() -> list[dict[str, object]]:
    """One row a reader."""
    from fuzz_readers import READERS

    return [_measured(reader.name) for reader in READERS if not reader.guarded]


def _measured(name: str) -> dict[str, object]:
    """Measure a reader in a process of its own."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(FOLDER), *sys.path))}
    command = [sys.executable, "-m", "benchmarks.reading_times", name]
    done = subprocess.run(
        command,
        env=environment,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        check=False,
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    if not lines:
        raise RuntimeError(f"{name}: {done.stderr[-500:]}")
    return json.loads(lines[-1])


def measure(name: str) -> dict[str, object]:
    """Measure a reader: its worst exponent, and the time of its slowest file."""
    from fuzz_readers import reader

    chosen = reader(name)
    worst = -math.inf
    slowest = 0.0
    part_of_worst = ""
    parts = 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / chosen.file_name
        for content in chosen.seeds():
            for part, before, after in _grown(content):
                parts += 1
                times = _times(chosen, path, (before, part, after))
                slowest = max(slowest, *times)
                exponent = _exponent(times)
                if exponent > worst:
                    worst = exponent
                    part_of_worst = part[:24].decode("ascii", "backslashreplace")
    return {
        "reader": name,
        "parts": parts,
        "exponent": round(worst, 2) if math.isfinite(worst) else "",
        "slowest [s]": round(slowest, 2),
        "worst part": repr(part_of_worst) if math.isfinite(worst) else "",
    }


def _grown(content: bytes) -> Iterator[tuple[bytes, bytes, bytes]]:
    """Yield parts of a file, and what stands before and after the place of their copies."""
    places = [(match.start(), match.end()) for match in re.finditer(rb"[^\n]+\n?", content)]
    places += [(match.start(), match.end()) for match in ELEMENT.finditer(content)]
    for start, stop in places[:: max(1, len(places) // (2 * PARTS))]:
        yield content[start:stop], content[:start], content[stop:]
    first = content.find(b"\n") + 1
    cells = re.search(rb"[^\s,;]+[\t,;]", content[first:])
    if cells:
        start = first + cells.start()
        yield cells.group(), content[:start], content[start:]
    half = len(content) // 2
    for piece in ODD:
        yield piece, content[:half], content[half:]


def _times(chosen: object, path: Path, parts: tuple[bytes, bytes, bytes]) -> list[float]:
    """Return the processor time of reading at each size [s], as far as it was tried."""
    before, part, after = parts
    times = []
    for size in SIZES:
        path.write_bytes(before + part * (size // len(part)) + after)
        times.append(min(_time(chosen, path) for _ in range(REPEATS if not times else 2)))
        if times[-1] > SLOW:
            break
    return times


def _time(chosen: object, path: Path) -> float:
    from myomorph.core.model.errors import MyomorphError

    start = time.process_time()
    with suppress(MyomorphError):
        chosen.read(path)  # type: ignore[attr-defined]
    return time.process_time() - start


def _exponent(times: list[float]) -> float:
    """Slope of the logarithm of time over that of size, -inf where too little is known.

    It is between the first time that is long enough and the last.
    """
    pairs = zip(SIZES, times, strict=False)
    known = [(math.log(size), math.log(seconds)) for size, seconds in pairs if seconds > ENOUGH]
    if len(known) < 2:
        return -math.inf
    return (known[-1][1] - known[0][1]) / (known[-1][0] - known[0][0])


if __name__ == "__main__":
    sys.path.insert(0, str(FOLDER))
    for row in [measure(sys.argv[1])] if len(sys.argv) > 1 else run():
        sys.stdout.write(json.dumps(row) + "\n")
