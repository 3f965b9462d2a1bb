"""A Dask cluster.

It has its address and connection, the test of which of its processes are fit, and the job that one
of them does.
"""

from __future__ import annotations

import asyncio
import json
import os
import pickle
import platform
import socket
import sys
import threading
import uuid
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from myomorph import __version__
from myomorph.core.model.errors import BadData, BadFile, MyomorphError, listing
from myomorph.core.model.model import Model
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.progress import silence

KEPT = 8  # Models that a process keeps, as many as the compiled forms of it that are kept.

WATCH = 0.5  # How often a process looks whether its job is still wanted [s].

FAILED = 70  # Exit status of a process whose job is no longer wanted.

_opened = lru_cache(KEPT)(pickle.loads)  # A model of its bytes, the same while it is kept.
MARK = ".seen-by-workers-"
"""Beginning of the name of a file that tells whether a worker sees the folder of the results."""
SCHEMES = ("tcp", "tls", "ucx", "ws", "wss", "inproc")
START = "start one with 'dask scheduler' and give the address that it prints"


@dataclass(frozen=True)
class Fitness:
    """What a process is, and whether it sees the folder of the results.

    It sees the folder where it can read the file that it is given.
    """

    version: str
    python: str
    system: str
    sees: bool


def fitness(path: str = "", content: str = "") -> Fitness:
    """Return what this process is; `path` is a file that must exist with that content."""
    try:
        sees = not path or Path(path).read_text(encoding="utf-8") == content
    except OSError:
        sees = False
    return Fitness(
        version=__version__,
        python=f"{sys.version_info.major}.{sys.version_info.minor}",
        system=platform.system(),
        sees=sees,
    )


def do_job(work: bytes, model: bytes = b"", date: str = "") -> Outcome:
    """Do a packed job with its packed model.

    `date` is the date of the results, as in SOURCE_DATE_EPOCH, "" for that of the clock.
    """
    with _dated(date), _ends_when_unwanted():
        do: Callable[[Model | None], Outcome] = pickle.loads(work)
        return do(_opened(model) if model else None)


@contextmanager
def _dated(date: str) -> Iterator[None]:
    """Work silently on one thread, and date results as the sender does.

    The settings before hold again afterwards.
    """
    # Frames are not split over threads: the machine has as many processes as it should use cores.
    wanted = {"MYOMORPH_THREADS": "1", "SOURCE_DATE_EPOCH": date}
    before = {name: os.environ.pop(name) for name in wanted if name in os.environ}
    # Libraries take an empty date for a number that cannot be read.
    os.environ |= {name: value for name, value in wanted.items() if value}
    silent = silence()
    try:
        yield
    finally:
        silence(silent)
        for name in wanted:
            os.environ.pop(name, None)
        os.environ |= before


@contextmanager
def _ends_when_unwanted() -> Iterator[None]:
    """End this process where its job is given up.

    The job is given up by the program that sent it, or because the cluster is out of reach. Else
    the job would go on writing beside its successor. Only a process that a nanny starts again, and
    that does nothing else at the same time, ends itself.
    """
    try:
        from distributed import get_worker
        from distributed.worker import thread_state

        worker = get_worker()
        key = thread_state.key
    except (ImportError, ValueError, AttributeError):
        yield
        return
    if not getattr(worker, "nanny", None) or worker.state.nthreads != 1:
        yield
        return
    done = threading.Event()
    threading.Thread(target=_watch, args=(worker, key, done), daemon=True).start()
    try:
        yield
    finally:
        done.set()


def _watch(worker: Any, key: Any, done: threading.Event) -> None:
    while not done.wait(WATCH):
        task = worker.state.tasks.get(key)
        given_up = task is None or task.state == "cancelled"
        if (
            given_up or worker.status.name in ("closing", "closed", "failed")
        ) and not done.is_set():
            os._exit(FAILED)


def scheduler_address(text: str) -> str:
    """Return the address of a scheduler.

    It comes from a text or from the file that `dask scheduler --scheduler-file` writes.
    """
    if text.lower().endswith(".json"):
        try:
            return str(json.loads(Path(text).read_text(encoding="utf-8"))["address"])
        except OSError as error:
            hint = "give the file that 'dask scheduler --scheduler-file' writes, once it is there"
            raise BadFile(text, f"cannot be read ({error.strerror or error})", hint) from None
        except (ValueError, KeyError, TypeError):
            raise BadFile(
                text, "is no scheduler file", "give what 'dask scheduler --scheduler-file' writes"
            ) from None
    scheme, separator, rest = text.rpartition("://")
    if separator and scheme not in SCHEMES:
        raise BadData(
            f"--scheduler {text}: there is no protocol '{scheme}': Dask has"
            f" {listing(scheme, SCHEMES)}"
        )
    name, _, port = rest.rpartition(":")
    if scheme != "inproc" and not (name and port.isdigit()):
        raise BadData(
            f"--scheduler {text}: expected a machine and a port like tcp://10.0.0.1:8786: {START}"
        )
    return text if separator else f"tcp://{text}"


def connected(address: str, patience: float) -> Any:
    """Return a client of the scheduler, which has to answer within `patience` [s]."""
    try:
        # An extra, and slow to import.
        from distributed import Client
        from distributed.versions import VersionMismatchWarning
    except ImportError as error:
        needed = f"a Dask cluster needs the package 'distributed' ({error})"
        raise MyomorphError(f"{needed}: pip install 'myomorph[cluster]'") from None

    try:
        # In a thread of its own, for where there is a loop already, as in a notebook.
        with ThreadPoolExecutor(1) as pool:
            pool.submit(lambda: asyncio.run(_greet(address, patience))).result()
        with warnings.catch_warnings():
            # Which processes are of another version is said by name, see `unfit`.
            warnings.simplefilter("ignore", VersionMismatchWarning)
            return Client(address, timeout=patience, set_as_default=False, name="myomorph")
    except OSError as error:
        reason = " ".join(str(error).split()) or "the connection is accepted, but nothing answers"
        raise BadData(f"--scheduler {address}: no scheduler answers ({reason}): {START}") from None
    # whatever the bytes of a program of another kind lead to, MemoryError among it
    except Exception:
        reason = "what answers is not a Dask scheduler"
        raise BadData(f"--scheduler {address}: no scheduler answers ({reason}): {START}") from None


async def _greet(address: str, patience: float) -> None:
    """Shake hands with a scheduler: the client itself would wait forever for one that is silent."""
    from distributed.comm import connect
    from distributed.security import Security

    options = Security().get_connection_args("client")
    greeted = await asyncio.wait_for(connect(address, timeout=patience, **options), patience)
    greeted.abort()


def leave_mark(folder: Path) -> tuple[Path, str]:
    """Write a file into the folder of the results; return it and what it holds.

    A process that reads the same sees the same folder.
    """
    content = f"{socket.gethostname()} {os.getpid()} {uuid.uuid4().hex}"
    path = folder.resolve() / f"{MARK}{uuid.uuid4().hex[:8]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")
    except OSError as error:
        reason = error.strerror or str(error)
        raise BadFile(
            folder, f"cannot be written ({reason})", "give --out another folder"
        ) from None
    return path, content


def unfit(fit: Fitness, mark: tuple[Path, str] | None) -> str:
    """Why a process may not be given jobs, "" where it may."""
    here = fitness()
    if fit.version != here.version:
        return (
            f"has Myomorph {fit.version}, this program is {here.version}: install the same version"
            " on both"
        )
    if fit.python != here.python:
        return (
            f"has Python {fit.python}, this program runs in {here.python}: use the same version on"
            " both"
        )
    if fit.system != here.system:
        return f"runs on {fit.system}, this program on {here.system}: use one operating system"
    if mark is not None and not fit.sees:
        return (
            f"cannot see {mark[0].parent}: give --out a folder that all machines share under the"
            " same name"
        )
    return ""
