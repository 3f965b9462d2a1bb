"""Count of frames and rate of a recording, for plans, from its first bytes alone."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from myomorph.core.io.c3d.raw import BLOCK, KEY, claimed_frames
from myomorph.core.io.parsing.hdf5 import ERRORS, open_hdf5
from myomorph.core.io.parsing.named_file import is_named_file
from myomorph.core.io.parsing.text import number_or_nan
from myomorph.core.io.trc import trc_head
from myomorph.core.model.errors import BadFile, MyomorphError

# Bytes that hold the header of any recording, long lists of C3D parameters included.
HEAD = 1 << 18
HALF = 0.49  # Part of a frame by which times may be off, since they are rounded.
ROWS = 50
SHARE = 0.1
"""Rows whose times tell the rate; how far the length of a file may be from what its header claims.
"""


@dataclass(frozen=True)
class FrameCount:
    """Length and rate that a recording states.

    Attributes
    ----------
    frames : their count, None where the first bytes do not show it
    rate : frames per second [Hz], None where the first bytes do not show it
    start : time of the first frame [s], None where the first bytes do not show it
    """

    frames: int | None = None
    rate: float | None = None
    start: float | None = None

    def within(self, time: tuple[float, float] | None) -> int | None:
        """Count the frames of a part of the recording.

        Parameters
        ----------
        time : start and end of the part [s], None for the whole recording

        Returns
        -------
        frames within those recorded; all of them where the rate is unknown, None where their count
        is
        """
        if self.frames is None or time is None or self.rate is None:
            return self.frames
        asked = round((time[1] - time[0]) * self.rate) + 1
        if self.start is None:
            return max(0, min(self.frames, asked))
        first = max(0, math.ceil((time[0] - self.start) * self.rate - HALF))
        last = min(self.frames - 1, math.floor((time[1] - self.start) * self.rate + HALF))
        return max(0, last - first + 1)


def count_frames(path: str | os.PathLike[str]) -> FrameCount:
    """Read count, rate and start of the frames from the first bytes of a recording.

    Parameters
    ----------
    path : of the file (.trc, .c3d or keypoints in HDF5)

    Returns
    -------
    None for all that a damaged file, or one of another kind, does not state there
    """
    path = Path(path)
    if not is_named_file(path):
        return FrameCount()
    try:
        with path.open("rb") as stream:
            head = stream.read(HEAD)
    except OSError:
        return FrameCount()
    ending = path.suffix.lower()
    try:
        if ending == ".trc":
            return _trc(head, path)
        if ending == ".c3d" and len(head) >= BLOCK and head[1] == KEY:
            return _told(*claimed_frames(head))
        if ending in (".h5", ".hdf5"):
            return _keypoints(path)
    except (MyomorphError, ValueError, IndexError, OverflowError):
        pass
    return FrameCount()


def _told(frames: float, rate: float, start: float = float("nan")) -> FrameCount:
    """Return what is stated, None in place of numbers that cannot be."""
    whole = int(frames) if np.isfinite(frames) and 0 < frames < 2**31 else None
    often = float(rate) if np.isfinite(rate) and rate > 0.0 else None
    return FrameCount(whole, often, float(start) if np.isfinite(start) else None)


def _trc(head: bytes, path: Path) -> FrameCount:
    """Count frames by the header, unless the file is too short or too long for it.

    Parameters
    ----------
    head : first bytes of the file
    path : of the file; its size is compared with that of the rows in `head`

    Returns
    -------
    rate and start by the column of times, the rate by the header where this has one time
    """
    text = head.decode("utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    facts, start = trc_head(text, path)
    rows = text[start:].split("\n")
    rows = [row for row in (rows[:-1] if len(head) == HEAD else rows) if row.strip()]
    if not rows:
        return FrameCount()
    whole = path.stat().st_size * len(text) / len(head) - start
    frames = whole / (sum(map(len, rows)) / len(rows) + 1.0)
    count = number_or_nan(facts.get("NumFrames", ""))
    times = np.array(
        [
            number_or_nan(row.replace(",", " ").split()[1])
            for row in rows[:ROWS]
            if len(row.split()) > 1
        ]
    )
    start_time = times[0] if len(times) else float("nan")
    span = times[-1] - times[0] if len(times) > 1 else 0.0
    rate = (len(times) - 1) / span if span > 0.0 else number_or_nan(facts.get("DataRate", ""))
    return _told(
        count if abs(frames - count) < SHARE * frames + 2.0 else round(frames), rate, start_time
    )


def _keypoints(path: Path) -> FrameCount:
    try:
        with open_hdf5(path) as file:
            shape = getattr(file.get("tracks"), "shape", ())
            frames = shape[0] if shape else None
    except ERRORS:
        raise BadFile(path, "cannot be read as HDF5") from None
    return FrameCount(frames)
