"""Locks: one run at a time in a study's folder, one process at a time in a trial's."""

from __future__ import annotations

import json
import os
import platform
import re
import socket
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path

from filelock import FileLock, Timeout

from myomorph import __version__
from myomorph.core.model.errors import BadData, BadFile

# Of the folders that a study writes; one higher where older versions would misread them.
FORMAT = 1
MARK = "study.json"
LOCK = ".study.lock"
PATIENCE = 600.0  # How long a trial waits for a process that still writes into its folder [s].


@dataclass(frozen=True)
class RunMark:
    """The run that a folder belongs to.

    Attributes
    ----------
    folder : of the study
    run : identifier
    host, process : on which it runs
    since : when it began
    format, version : of what wrote it
    """

    folder: Path
    run: str
    host: str
    process: int
    since: str
    version: str = __version__
    format: int = FORMAT

    def check(self) -> None:
        """Refuse to go on where another run has begun meanwhile.

        Raises
        ------
        BadData : this process has been given up
        """
        now = read_mark(self.folder)
        if now is not None and now.run != self.run:
            raise BadData(
                f"{self.folder}: another run has begun, since {now.since} on {now.host}: this one"
                " ends"
            )


def read_mark(folder: Path) -> RunMark | None:
    """Which run wrote a folder last, None where no run did."""
    path = folder / MARK
    try:
        mark = json.loads(path.read_text(encoding="utf-8"))
        return RunMark(
            folder=folder,
            run=mark["run"],
            host=mark["host"],
            process=int(mark["process"]),
            since=mark["since"],
            version=mark["version"],
            format=int(mark["format"]),
        )
    except FileNotFoundError:
        return None
    except (ValueError, KeyError, TypeError) as error:
        raise BadFile(
            path,
            f"does not state which run wrote here ({error})",
            "remove it, or give --out another",
        ) from None


def check_age(mark: RunMark | None) -> None:
    """Raise `BadData` where a newer version wrote the folder."""
    if mark is None:
        return
    if mark.format > FORMAT or _numbers(mark.version) > _numbers(__version__):
        raise BadData(
            f"{mark.folder}: was written by Myomorph {mark.version}, which is newer than this one"
            f" ({__version__}): update Myomorph, or give --out another folder"
        )


def _numbers(version: str) -> tuple[int, ...]:
    """Take the numbers that a version begins with: 1.2.0rc1 is (1, 2, 0)."""
    return tuple(map(int, re.findall(r"\d+", re.split(r"[^\d.]", version)[0])))


@contextmanager
def study_lock(out: Path) -> Iterator[RunMark]:
    """Keep other runs away from a study's folder, which is made where it does not exist."""
    if out.exists() and not out.is_dir():
        raise BadFile(out, "is a file, but results go into a folder", "give --out another name")
    lock = FileLock(out / LOCK, timeout=0)
    try:
        out.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise BadData(_taken(out)) from None
    except OSError as error:
        raise _unwritable(out, error) from None
    try:
        check_age(read_mark(out))
        now = datetime.now().astimezone().isoformat(timespec="seconds")
        mark = RunMark(
            folder=out,
            run=uuid.uuid4().hex,
            host=platform.node() or socket.gethostname(),
            process=os.getpid(),
            since=now,
        )
        content = {name: value for name, value in asdict(mark).items() if name != "folder"}
        try:
            write_whole(out / MARK, json.dumps(content, indent=1) + "\n")
        except OSError as error:
            raise _unwritable(out, error) from None
        yield mark
    finally:
        _let_go(lock)


def write_whole(path: Path, text: str) -> None:
    """Write a file of a study's folder, whole or not at all; what a killed process left goes."""
    temporary = path.with_name(f".{path.name}.part")
    try:
        temporary.write_text(text, encoding="utf-8")
        os.replace(temporary, path)
    except OSError:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def _unwritable(folder: Path, error: OSError) -> BadFile:
    return BadFile(
        folder, f"cannot be written ({error.strerror or error})", "give --out another folder"
    )


def _taken(out: Path) -> str:
    who = ""
    with suppress(BadFile):
        if (mark := read_mark(out)) is not None:
            who = f" (process {mark.process} on {mark.host}, since {mark.since})"
    return f"{out}: another run writes there{who}: wait for its end, or give --out another folder"


@contextmanager
def folder_lock(
    folder: Path, mark: RunMark | None = None, patience: float = PATIENCE
) -> Iterator[None]:
    """Keep other processes away from a trial's folder.

    They are of a run that was killed, or that was cut off.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder.with_name(f".{folder.name}.lock"), timeout=patience, poll_interval=0.05)
    try:
        lock.acquire()
    except Timeout:
        raise BadData(
            f"{folder}: another process still writes there: end it, then run again"
        ) from None
    try:
        if mark is not None:
            mark.check()
        yield
    finally:
        _let_go(lock)


def _let_go(lock: FileLock) -> None:
    """Remove a lock with its file.

    Where an open file cannot be removed (Windows), it is let go of before. Whoever waits for a file
    that is removed meanwhile sees that and begins anew: filelock does so since 3.24.
    """
    path = Path(lock.lock_file)
    try:
        path.unlink(missing_ok=True)
    except OSError:
        lock.release()
        with suppress(OSError):
            path.unlink(missing_ok=True)
    lock.release()
