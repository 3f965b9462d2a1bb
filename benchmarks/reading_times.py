"""Readers given files that grow: exponents of time and memory, which should be 1.

`python -m benchmarks.reading_times [READER]` takes the sound files of `tests/fuzz` of every reader
in the formats' table. It makes them larger in several ways: rows that go on as the last two do,
elements of XML with new names, more frames in binary files, and parts that are only repeated (a
line, an opened comment, a column, a bracket). Processor time, that of children included, and memory
are those of a process of its own for each file, less those of the sound file, and the least of a
few such processes. Each file is eight times as large as the one before, until its time can be
measured. The exponent is that of the two largest files: below a mebibyte a reader may have its
numbers in the processor's cache, and the interpreter collects no garbage yet. A row has the worst
exponent of a reader, and the seconds that its slowest way comes to at the largest size that its
door lets in; the rows of a text end at `MAX_SECONDS`.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import re
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[1] / "tests" / "fuzz"
SIZES = (1 << 17, 1 << 20, 1 << 23, 1 << 26)  # From small to large [bytes].
LEAST_SIZE = 1 << 20  # Of the smaller of two files that are compared [bytes].
ENOUGH = 0.05  # Processor time from which an exponent is measured [s].
LONG = 1.5  # Whoever takes longer is given nothing larger [s].
TRIES = 3  # Of the files that an exponent is measured with.
LEAST_COST = 1e-3  # Of a smaller file, so that its logarithm is finite [s or MiB].
MEMORY = 32.0  # From which its exponent is measured [MiB].
AT_ONCE = 2
PARTS = 1  # Of each kind in a file.
HANG = 300  # After so long a reading is ended [s].
MIB = 1 << 20
ELEMENT = re.compile(rb"<(\w+)[^<>]*/>|<(\w+)[^<>]*>[^<>]*</\2>")
NAME = re.compile(rb"(\bname\s*=\s*[\"'])([^\"']*)")
CELL = re.compile(rb"[^\t,; \r\n]+")
ODD = (b"<!--", b"<!DOCTYPE ", b"&", b"[", b"{", b'"', b"a,", b"\n")
"""Pieces that are repeated in the middle of a file."""

Grow = Callable[[int], bytes]
"""Makes a file of about so many bytes."""


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What reading a file takes.

    Attributes
    ----------
    seconds : of processor time [s]
    mebibytes : greatest memory [MiB]
    """

    seconds: float
    mebibytes: float


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Files of one way to grow, from small to large.

    Attributes
    ----------
    way : how they grew
    sizes : of the files [bytes]
    seconds, mebibytes : that reading took beyond the sound file
    """

    way: str
    sizes: Sequence[int]
    seconds: Sequence[float]
    mebibytes: Sequence[float]

    @property
    def time_exponent(self) -> float:
        """Slope of the logarithm of time over that of size, NaN where either is too short."""
        if len(self.seconds) < 2 or not (self.seconds[-2] > ENOUGH or self.seconds[-1] > LONG):
            return math.nan
        return _slope(self.sizes, self.seconds)

    @property
    def memory_exponent(self) -> float:
        """Slope of the logarithm of memory over that of size, NaN where either is too little."""
        if len(self.mebibytes) < 2 or not self.mebibytes[-2] > MEMORY:
            return math.nan
        return _slope(self.sizes, self.mebibytes)

    @property
    def rate(self) -> float:
        """Time by size of the largest file [s/MiB]."""
        return self.seconds[-1] / (self.sizes[-1] / MIB)


def run() -> list[dict[str, object]]:
    """Return one row per reader."""
    from fuzz_readers import READERS

    context = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(AT_ONCE, context) as pool:
        return list(pool.map(measure, [reader.name for reader in READERS]))


def measure(name: str) -> dict[str, object]:
    """Measure a reader: its worst exponents, and its slowest file."""
    from fuzz_readers import reader

    chosen = reader(name)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / chosen.file_name
        limit = _size_limit(chosen, path)
        # What is imported at a first reading is imported here.
        for content in chosen.seeds():
            path.write_bytes(content)
            _cost_here(chosen, path)
        ways = [
            _grown(chosen, path, way, grow)
            for number, content in enumerate(chosen.seeds())
            for way, grow in _ways(content, chosen.ending, ODD if number == 0 else ())
        ]
    timed = [way for way in ways if math.isfinite(way.time_exponent)]
    worst = max(timed, key=lambda way: way.time_exponent, default=None)
    slowest = max(ways, key=lambda way: way.rate)
    memory = [way.memory_exponent for way in ways if math.isfinite(way.memory_exponent)]
    return {
        "reader": name,
        "ways": len(ways),
        "exponent of time": "" if worst is None else round(worst.time_exponent, 2),
        "of memory": round(max(memory), 2) if memory else "",
        "worst way": "" if worst is None else worst.way,
        "largest [MiB]": round(max(way.sizes[-1] for way in ways) / MIB, 1),
        "slowest [s/MiB]": float(f"{slowest.rate:.2g}"),
        "size limit [MiB]": round(limit / MIB),
        "at the limit [s]": float(f"{slowest.rate * limit / MIB:.2g}"),
    }


def _size_limit(chosen: Any, path: Path) -> int:
    """Find the largest size that the reader's door lets in [bytes], by its message."""
    from myomorph.core.io.parsing.door import MAX_SIZES
    from myomorph.core.model.errors import MyomorphError

    with path.open("wb") as stream:
        stream.truncate(max(MAX_SIZES.values()) + 1)
    try:
        chosen.read(path)
    except MyomorphError as error:
        for kind, size in MAX_SIZES.items():
            if f"allowed for {kind}" in str(error):
                return size
    finally:
        path.unlink()
    # The formats of several files are given small ones beside it.
    return MAX_SIZES["a table"]


def _ways(content: bytes, ending: str, pieces: Sequence[bytes]) -> Iterator[tuple[str, Grow]]:
    """Yield ways in which a sound file grows, some by pieces that are repeated, and their names."""
    from binary_seeds import binary_seeds

    if content in binary_seeds().get(ending, ()):
        yield from _binary_ways(content, ending)
        return
    rows = _rows_that_go_on(content)
    if rows is not None:
        yield "rows that go on", rows
    elements = list(ELEMENT.finditer(content))
    for match in elements[len(elements) // 2 :][:PARTS]:
        yield f"{_shown(match.group())} with new names", _named_copies(content, match)
    lines = list(re.finditer(rb"[^\n]+\n?", content))
    for match in lines[len(lines) // 2 :][:PARTS]:
        yield _shown(match.group()), _copies(content, match.group(), match.start())
    first = content.find(b"\n") + 1
    cells = re.search(rb"[^\s,;]+[\t,;]", content[first:])
    if cells:
        yield _shown(cells.group()), _copies(content, cells.group(), first + cells.start())
    for piece in pieces:
        yield _shown(piece), _copies(content, piece, len(content) // 2)


def _binary_ways(content: bytes, ending: str) -> Iterator[tuple[str, Grow]]:
    """Yield the ways of a binary file: more frames, and bytes that are repeated."""
    from binary_seeds import FRAMES, binary_files, binary_seeds

    index = binary_seeds()[ending].index(content)
    # A few frames are mostly head.
    more = len(binary_files(ending, 1000 * FRAMES)[index]) - len(content)
    each = max(1.0, more / (999 * FRAMES))

    def with_frames(size: int) -> bytes:
        frames = max(1, round(size / each / FRAMES)) * FRAMES
        return binary_files(ending, frames)[index]

    yield "frames", with_frames
    half = len(content) // 2
    for piece in (content[half : half + 16], content[-16:], b"\0"):
        yield _shown(piece), _copies(content, piece, half)


def _copies(content: bytes, part: bytes, place: int) -> Grow:
    """Repeat a part at its place."""
    return lambda size: content[:place] + part * (size // len(part)) + content[place:]


def _named_copies(content: bytes, match: re.Match[bytes]) -> Grow:
    """Repeat an element of XML, with another name each time where it has one."""
    part = match.group()

    def grow(size: int) -> bytes:
        copies = (NAME.sub(rb"\g<1>\g<2>_%d" % number, part) for number in range(size // len(part)))
        return content[: match.end()] + b"".join(copies) + content[match.end() :]

    return grow


def _rows_that_go_on(content: bytes) -> Grow | None:
    """Continue a table by the differences of its last two rows; None where it has none."""
    rows = [CELL.findall(line) for line in content.splitlines() if line.strip()]
    if len(rows) < 2 or len(rows[-1]) != len(rows[-2]) or len(rows[-1]) < 2:
        return None
    numbers = [[_number(cell) for cell in row] for row in rows[-2:]]
    if not any(math.isfinite(value) for value in numbers[-1]):
        return None
    last_line = content.rstrip().splitlines()[-1]
    form = CELL.sub(b"%s", last_line.replace(b"%", b"%%")) + b"\n"

    def cell(column: int, number: int) -> bytes:
        before = numbers[0][column]
        last = numbers[1][column]
        if math.isfinite(before) and math.isfinite(last):
            return b"%.9g" % (last + number * (last - before))
        text = rows[-1][column]
        return text if text == rows[-2][column] else b"%s_%d" % (text.strip(b'"'), number)

    def grow(size: int) -> bytes:
        count = size // (len(last_line) + 1)
        added = (
            form % tuple(cell(column, number) for column in range(len(rows[-1])))
            for number in range(1, count + 1)
        )
        return content.rstrip() + b"\n" + b"".join(added)

    return grow


def _number(cell: bytes) -> float:
    """Return the number in a cell, NaN where it is a text."""
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _shown(part: bytes) -> str:
    """Return the beginning of a part, for the table."""
    return repr(part[:24].decode("ascii", "backslashreplace"))[1:-1]


def _grown(chosen: Any, path: Path, way: str, grow: Grow) -> Measured:
    """Measure files that grow in one way until they take long enough."""
    path.write_bytes(grow(0))
    start = _least_cost(chosen, path)
    sizes: list[int] = []
    costs: list[Cost] = []
    for size in SIZES:
        path.write_bytes(grow(size))
        cost = _least_cost(chosen, path)
        sizes.append(path.stat().st_size)
        costs.append(
            Cost(
                seconds=max(cost.seconds - start.seconds, 0.0),
                mebibytes=max(cost.mebibytes - start.mebibytes, 0.0),
            )
        )
        smaller = costs[-2:][0].seconds if size > LEAST_SIZE else 0.0
        if costs[-1].seconds > LONG or smaller > ENOUGH:
            break
    return Measured(
        way=way,
        sizes=sizes,
        seconds=[cost.seconds for cost in costs],
        mebibytes=[cost.mebibytes for cost in costs],
    )


def _least_cost(chosen: Any, path: Path) -> Cost:
    """Return the least of what several processes take for a file; of one where that is long."""
    costs = [_cost(chosen, path)]
    while len(costs) < TRIES and costs[0].seconds < LONG:
        costs.append(_cost(chosen, path))
    return Cost(
        seconds=min(cost.seconds for cost in costs),
        mebibytes=min(cost.mebibytes for cost in costs),
    )


def _cost(chosen: Any, path: Path) -> Cost:
    """Return what reading takes in a process of its own."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        signal.alarm(HANG)
        try:
            os.write(writing, json.dumps(asdict(_cost_here(chosen, path))).encode())
        finally:
            os._exit(0)
    os.close(writing)
    with open(reading, "rb") as stream:
        answer = stream.read()
    os.waitpid(child, 0)
    if not answer:
        raise RuntimeError(f"the process that read {path.name} ended")
    found = json.loads(answer)
    return Cost(seconds=found["seconds"], mebibytes=found["mebibytes"])


def _cost_here(chosen: Any, path: Path) -> Cost:
    """Read a file, and return what it takes, with what its children take."""
    from myomorph.core.model.errors import MyomorphError

    start = time.process_time() + sum(os.times()[2:4])
    with suppress(MyomorphError):
        chosen.read(path)
    seconds = time.process_time() + sum(os.times()[2:4]) - start
    peaks = (
        resource.getrusage(who).ru_maxrss
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return Cost(seconds=seconds, mebibytes=max(peaks) / 1024.0)


def _slope(sizes: Sequence[int], costs: Sequence[float]) -> float:
    """Return the slope of the logarithms of the last two costs over those of their sizes.

    A file that is refused at once may take less than a sound one.
    """
    smaller = max(costs[-2], LEAST_COST)
    larger = max(costs[-1], LEAST_COST)
    return math.log(larger / smaller) / math.log(sizes[-1] / sizes[-2])


if __name__ == "__main__":
    sys.path.insert(0, str(FOLDER))
    for row in [measure(sys.argv[1])] if len(sys.argv) > 1 else run():
        sys.stdout.write(json.dumps(row) + "\n")
