"""The log of a live session: a head, and a row for every frame, written as they come.

Whatever ends the session, even a killed process, the rows that were written stay. Results are made
of the log alone.
"""

from __future__ import annotations

import json
import time as clock
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np

from myomorph.core.io.formats import is_composed
from myomorph.core.io.parsing.door import readable
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadFile
from myomorph.core.model.provenance import Provenance
from myomorph.live.chain import ChainFrame, LiveChain
from myomorph.live.limits import TABLES
from myomorph.live.loop import Delays

LOG = "live.log"
FORMAT = "myomorph live log 1"
BLOCK = 256  # Frames that are written at once at most.
FLUSH = 0.2  # Time after which frames are written that have come [s].
MAX_HEAD = 1 << 24  # Bytes of the first line.


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
        self._filled = 0
        self._written = 0  # Rows of `delays` that are in the log.
        self._flushed = clock.monotonic()
        self._has_limits = head.draws > 0
        try:
            self._file: IO[bytes] = path.open("xb")
        except FileExistsError:
            raise BadFile(
                path,
                "is the log of a session whose results were not written",
                f"myomorph live --recover {path.parent} writes them, or give another --out",
            ) from None
        text = json.dumps({"format": FORMAT} | asdict(head))
        self._file.write(text.encode("utf-8") + b"\n")
        self._file.flush()

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
            self._add_lost(0)
            self._flush()
            self._file.close()

    def _add_lost(self, behind: int) -> None:
        """Add rows without values for frames that no output was given, but the newest `behind`."""
        while self._written < len(self._delays) - behind:
            self._add({})

    def _add(self, values: Mapping[str, object]) -> None:
        row = self._rows[self._filled]
        row[:] = np.nan
        row[self._parts["delays"]] = self._delays.row(self._written)
        row[self._parts["dropped"]] = self._delays.dropped
        for name, value in values.items():
            row[self._parts[name]] = value
        self._written += 1
        self._filled += 1
        if self._filled == BLOCK:
            self._flush()

    def _flush(self) -> None:
        self._file.write(self._rows[: self._filled].tobytes())
        self._file.flush()
        self._filled = 0
        self._flushed = clock.monotonic()


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


def read_log(path: Path) -> tuple[LogHead, Array]:
    """Read a log, as far as it was written.

    Parameters
    ----------
    path : of the log

    Returns
    -------
    its head, and rows (frames, numbers)

    Raises
    ------
    BadFile : it is none, or holds no frame
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
    except (ValueError, KeyError, TypeError, AttributeError):
        raise BadFile(path, "is no log of a session", hint) from None
    # The last row may have been written in part.
    rows = len(content) // (8 * head.width)
    if rows == 0:
        raise BadFile(path, "holds no frame: the session ended before the first", hint)
    numbers = np.frombuffer(content, np.float64, rows * head.width)
    return head, numbers.reshape(rows, head.width)
