"""A Dask cluster from outside: its address, the connection to it, and which of its processes are fit."""

from __future__ import annotations

import asyncio
import json
import os
import socket
import uuid
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from myomorph.model.errors import BadData, BadFile, MyomorphError, listing
from myomorph.study.run.dask_job import Fitness, fitness

MARK = ".seen-by-workers-"
"""Beginning of the name of a file that tells whether a worker sees the folder of the results."""

SCHEMES = ("tcp", "tls", "ucx", "ws", "wss", "inproc")
START = "start one with 'dask scheduler' and give the address that it prints"


def scheduler_address(text: str) -> str:
    """The address of a scheduler, from a text or from the file that `dask scheduler --scheduler-file` writes.

    Raises
    ------
    BadData
        where the text is no address
    BadFile
        where the file cannot be read
    """
    if text.lower().endswith(".json"):
        try:
            return str(json.loads(Path(text).read_text(encoding="utf-8"))["address"])
        except OSError as error:
            hint = "give the file that 'dask scheduler --scheduler-file' writes, once it is there"
            raise BadFile(text, f"cannot be read ({error.strerror or error})", hint) from None
        except (ValueError, KeyError, TypeError):
            raise BadFile(text, "is no scheduler file", "give what 'dask scheduler --scheduler-file' writes") from None
    scheme, separator, rest = text.rpartition("://")
    if separator and scheme not in SCHEMES:
        raise BadData(f"--scheduler {text}: there is no protocol '{scheme}': Dask has {listing(scheme, SCHEMES)}")
    name, _, port = rest.rpartition(":")
    if scheme != "inproc" and not (name and port.isdigit()):
        raise BadData(f"--scheduler {text}: expected a machine and a port like tcp://10.0.0.1:8786: {START}")
    return text if separator else f"tcp://{text}"


def connected(address: str, patience: float) -> Any:
    """A client of the scheduler.

    Raises
    ------
    BadData
        where it does not answer for `patience` [s]
    MyomorphError
        where the extra `cluster` is not installed
    """
    try:
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
        told = " ".join(str(error).split()) or "something takes the connection, but is silent"
        raise BadData(f"--scheduler {address}: no scheduler answers ({told}): {START}") from None
    except Exception:  # whatever the bytes of a program of another kind lead to, MemoryError among it
        told = "something is there that does not speak as a Dask scheduler does"
        raise BadData(f"--scheduler {address}: no scheduler answers ({told}): {START}") from None


async def _greet(address: str, patience: float) -> None:
    """Shake hands with a scheduler: the client itself would wait forever for one that is silent."""
    from distributed.comm import connect
    from distributed.security import Security

    options = Security().get_connection_args("client")
    greeted = await asyncio.wait_for(connect(address, timeout=patience, **options), patience)
    greeted.abort()


def leave_mark(folder: Path) -> tuple[Path, str]:
    """A file in the folder of the results, and what it holds: who reads the same sees the same folder.

    Raises
    ------
    BadFile
        where nothing can be written there
    """
    content = f"{socket.gethostname()} {os.getpid()} {uuid.uuid4().hex}"
    path = folder.resolve() / f"{MARK}{uuid.uuid4().hex[:8]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")
    except OSError as error:
        reason = error.strerror or str(error)
        raise BadFile(folder, f"cannot be written ({reason})", "give --out another folder") from None
    return path, content


def unfit(found: Fitness, mark: tuple[Path, str] | None) -> str:
    """Why a process may not be given jobs, "" where it may."""
    here = fitness()
    if found.version != here.version:
        return f"has Myomorph {found.version}, this program is {here.version}: install the same version on both"
    if found.python != here.python:
        return f"has Python {found.python}, this program runs in {here.python}: use the same version on both"
    if found.system != here.system:
        return f"runs on {found.system}, this program on {here.system}: use one operating system"
    if mark is not None and not found.sees:
        return f"does not see {mark[0].parent}: give --out a folder that all machines share under the same name"
    return ""
