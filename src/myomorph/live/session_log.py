"""The log of a live session: a head, and a row for every frame, written as they come.

Whatever ends the session, even a killed process, the rows that were written stay. Each row ends in
a checksum of its own, so that rows that a power cut left in part, or as zeros, are known. Results
are made of the log alone.
"""

from __future__ import annotations

import json
import time as clock
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np

from myomorph.core.io.formats import is_composed
from myomorph.core.io.parsing.door import readable
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadFile
from myomorph.core.model.provenance import Provenance
from myomorph.live.chain import ChainFrame, LiveChain
from myomorph.live.limits import TABLES
from myomorph.live.loop import Delays

LOG = "live.log"
FORMAT = "myomorph live log 2"
BLOCK = 256  # Frames that are written at once at most.
FLUSH = 0.2  # Time after which frames are written that have come [s].
MAX_HEAD = 1 << 24  # Bytes of the first line.
CHECK = "check"
"""The last number of a row: CRC-32 of the bytes before it."""


@dataclass(frozen=True, kw_only=True)
class LogHead:
    """What the rows of a log hold, and what results are made with.

    Attributes
    ----------
    model : path of the model, or its name
    provenance : of the results, as JSON
    filter_delay : how much older the results are than their frame [s]
    widths : numbers of each part of a row, in their order
    muscles, actuators, coordinates : of the tension problem
    lower, upper : (muscles,) bounds of activations
    bodies : that external forces act on
    up : (3,) vertical direction in ground
    draws : of limits, 0 for none
    factors : of the limits, by group of errors
    notes : what is assumed, one line each
    """

    model: str
    provenance: str
    filter_delay: float
    widths: Mapping[str, int]
    muscles: tuple[str, ...]
    actuators: tuple[str, ...]
    coordinates: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    bodies: tuple[str, ...]
    up: tuple[float, ...]
    draws: int = 0
    factors: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def parts(self) -> dict[str, slice]:
        """Columns of each part of a row."""
        ends = np.cumsum([0, *self.widths.values()]).tolist()
        return {
            name: slice(start, stop)
            for name, start, stop in zip(self.widths, ends, ends[1:], strict=False)
        }

    @property
    def width(self) -> int:
        """Count of numbers of a row."""
        return sum(self.widths.values())


def head_of(chain: LiveChain, model: Path, provenance: Provenance) -> LogHead:
    """Describe the rows that a chain will give.

    Parameters
    ----------
    chain : that computes them
    model : path of its model, or its name
    provenance : of its results
    """
    count = len(chain.model.coordinates)
    muscles = len(chain.model.muscles)
    widths = {
        "delays": Delays.WIDTH,
        "dropped": 1,
        "time": 1,
        "coordinates": count,
        "velocities": count,
        "torques": count,
        "activations": muscles,
        "forces": muscles,
        "reserves": len(chain.actuators),
        "balanced": len(chain.tension.coordinates),
        "wrenches": 6 * len(chain.bodies),
        "residual": 1,
        "status": 1,
        "error": 1,
        "seen": 1,
        "remaining": 1,
    }
    drawn = chain.limits
    if drawn is not None:
        widths |= {f"{name}_limits": 3 * widths[name] for name in TABLES}
    widths[CHECK] = 1
    return LogHead(
        model=str(model) if is_composed(model) else str(model.resolve()),
        provenance=provenance.to_json(),
        filter_delay=chain.filter_delay,
        widths=widths,
        muscles=tuple(chain.tension.muscles),
        actuators=tuple(chain.tension.actuators),
        coordinates=tuple(chain.tension.coordinates),
        lower=tuple(map(float, chain.tension.lower)),
        upper=tuple(map(float, chain.tension.upper)),
        bodies=tuple(chain.bodies),
        up=tuple(map(float, chain.feet.up)),
        draws=0 if drawn is None else drawn.draws,
        factors={} if drawn is None else dict(drawn.factors),
        notes=tuple(map(str, chain.notes)),
    )


class SessionLog:
    """Writes the rows of a session, an output of the loop.

    Parameters
    ----------
    path : of the log, which must not exist
    head : what rows hold
    delays : of the session, to which the loop adds before it gives a frame out
    """

    def __init__(self, path: Path, head: LogHead, delays: Delays):
        self.path = path
        self._delays = delays
        self._parts = head.parts
        self._rows = np.empty((BLOCK, head.width))
        # Rows of `delays` that were added, and how many of them the file has: an interruption may
        # come between any two statements, and each changes one of them alone.
        self._added = 0
        self._stored = 0
        self._flushed = clock.monotonic()
        self._has_limits = head.draws > 0
        try:
            self._file: IO[bytes] = path.open("xb", buffering=0)
        except FileExistsError:
            raise BadFile(
                path,
                "is the log of a session whose results were not written",
                f"myomorph live --recover {path.parent} writes them, or give another --out",
            ) from None
        text = json.dumps({"format": FORMAT} | asdict(head)).encode("utf-8") + b"\n"
        self._begin = len(text)
        self._write(text, 0)

    def __enter__(self) -> SessionLog:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self.close()

    def put(self, frame: ChainFrame, markers: Array) -> None:
        """Add a frame, and before it those that the loop could not give out.

        Parameters
        ----------
        frame : its results
        markers : (markers, 3) [m], or coordinates, which no result holds
        """
        self._add_lost(1)
        shared = frame.tension
        values = {
            "time": frame.time,
            "coordinates": frame.coordinates,
            "velocities": frame.velocities,
            "torques": frame.torques,
            "activations": shared.activations,
            "forces": shared.forces,
            "reserves": shared.reserves,
            "balanced": shared.balanced,
            "wrenches": frame.wrenches.ravel(),
            "residual": shared.equilibrium_residual,
            "status": shared.status,
            "error": frame.error,
            "seen": frame.seen,
            "remaining": frame.owed,
        }
        if self._has_limits:
            for name in TABLES:
                limits = np.nan if frame.limits is None else getattr(frame.limits, name).ravel()
                values[f"{name}_limits"] = limits
        self._add(values)
        if clock.monotonic() - self._flushed > FLUSH:
            self._flush()

    def close(self) -> None:
        """Nothing more comes."""
        if not self._file.closed:
            try:
                self._add_lost(0)
                self._flush()
            finally:
                self._file.close()

    def _add_lost(self, behind: int) -> None:
        """Add rows without values for frames that no output was given, but the newest `behind`."""
        while self._added < len(self._delays) - behind:
            self._add({})

    def _add(self, values: Mapping[str, object]) -> None:
        if self._added - self._stored == BLOCK:
            self._flush()
        row = self._rows[self._added - self._stored]
        row[:] = np.nan
        row[self._parts["delays"]] = self._delays.row(self._added)
        row[self._parts["dropped"]] = self._delays.dropped
        for name, value in values.items():
            row[self._parts[name]] = value
        row[-1] = zlib.crc32(row[:-1].tobytes())
        self._added += 1

    def _flush(self) -> None:
        """Write the rows that the file lacks; again after an interruption, to the same place."""
        rows = self._rows[: self._added - self._stored]
        self._write(rows.tobytes(), self._begin + self._stored * self._rows[0].nbytes)
        self._stored = self._added
        self._flushed = clock.monotonic()

    def _write(self, content: bytes, position: int) -> None:
        """Write bytes to a place of the file."""
        self._file.seek(position)
        left = memoryview(content)
        while left:
            left = left[self._file.write(left) :]


def _head(facts: Mapping[str, Any]) -> LogHead:
    """Make a head of what a log states."""
    return LogHead(
        model=facts["model"],
        provenance=facts["provenance"],
        filter_delay=facts["filter_delay"],
        widths=facts["widths"],
        muscles=tuple(facts["muscles"]),
        actuators=tuple(facts["actuators"]),
        coordinates=tuple(facts["coordinates"]),
        lower=tuple(facts["lower"]),
        upper=tuple(facts["upper"]),
        bodies=tuple(facts["bodies"]),
        up=tuple(facts["up"]),
        draws=facts["draws"],
        factors=facts["factors"],
        notes=tuple(facts["notes"]),
    )


@read_only
@dataclass(frozen=True, kw_only=True)
class StoredLog:
    """What a log holds.

    Attributes
    ----------
    head : what rows hold
    rows : (frames, numbers) those that are whole
    damaged : count of rows that were left out, one that was cut off at the end included
    """

    head: LogHead
    rows: Array
    damaged: int


def read_log(path: Path) -> StoredLog:
    """Read a log, as far as it was written.

    Parameters
    ----------
    path : of the log

    Returns
    -------
    its head and the rows whose checksum fits

    Raises
    ------
    BadFile : it is none, or holds no whole row
    """
    hint = "give the folder of a session of live that did not end"
    with readable(path), path.open("rb") as stream:
        line = stream.readline(MAX_HEAD)
        content = stream.read()
    try:
        facts = json.loads(line)
        if facts.pop("format") != FORMAT:
            raise BadFile(path, "is the log of another version", "recover it with that version")
        head = _head(facts)
        if head.parts[CHECK] != slice(head.width - 1, head.width):
            raise ValueError
    except (ValueError, KeyError, TypeError, AttributeError):
        raise BadFile(path, "is no log of a session", hint) from None
    size = 8 * head.width
    count = len(content) // size
    rows = np.frombuffer(content, np.float64, count * head.width).reshape(count, head.width)
    checks = [zlib.crc32(content[size * at : size * (at + 1) - 8]) for at in range(count)]
    whole = rows[:, -1] == checks if count else np.zeros(0, np.bool_)
    if not whole.any():
        raise BadFile(path, "holds no frame: the session ended before the first", hint)
    cut = int(len(content) > count * size)
    return StoredLog(
        head=head, rows=rows[whole], damaged=int(count - np.count_nonzero(whole)) + cut
    )
