"""What a process of a Dask cluster does: it says whether it is fit, and does one job at a time."""

from __future__ import annotations

import os
import pickle
import platform
import sys
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from myomorph import __version__
from myomorph.model.model import Model
from myomorph.store.outcome import Outcome
from myomorph.store.progress import silence

KEPT = 8
"""Models that a process keeps, as many as the compiled forms of it that are kept."""

WATCH = 0.5
"""How often a process looks whether its job is still wanted [s]."""

FAILED = 70
"""Exit status of a process whose job is no longer wanted."""

_models: OrderedDict[str, Model] = OrderedDict()


@dataclass(frozen=True)
class Fitness:
    """What a process is, and whether it sees the folder of the results.

    Attributes
    ----------
    python : version, major and minor
    system : operating system
    sees : whether the file that it was told to read is there and holds what it should
    """

    version: str
    python: str
    system: str
    sees: bool


def fitness(path: str = "", content: str = "") -> Fitness:
    """What this process is; `path` is a file that must be there with that content."""
    sees = True
    if path:
        try:
            sees = Path(path).read_text(encoding="utf-8") == content
        except OSError:
            sees = False
    return Fitness(__version__, f"{sys.version_info.major}.{sys.version_info.minor}", platform.system(), sees)


def do_job(work: bytes, key: str = "", model: bytes = b"", date: str = "") -> Outcome | None:
    """Do what a job says, which was packed.

    Parameters
    ----------
    key : of the model that it needs, "" where it needs none
    model : itself, packed, where this process was not given it before
    date : that results are to bear, as SOURCE_DATE_EPOCH says it, "" for that of the clock

    Returns
    -------
    the outcome, or None where the process does not have the model
    """
    value = _model(key, model)
    if key and value is None:
        return None
    with _as_told(date), _ends_when_unwanted():
        do: Callable[[Model | None], Outcome] = pickle.loads(work)
        return do(value)


def _model(key: str, model: bytes) -> Model | None:
    if not key:
        return None
    if model:
        _models[key] = pickle.loads(model)
        while len(_models) > KEPT:
            _models.popitem(last=False)
    if key in _models:
        _models.move_to_end(key)
    return _models.get(key)


@contextmanager
def _as_told(date: str) -> Iterator[None]:
    """Work silently on one thread, and date results as the program that sent the job does.

    Whatever this process was told before holds again afterwards.
    """
    # Frames are not split over threads: the machine has as many processes as it should use cores.
    wanted = {"MYOMORPH_THREADS": "1", "SOURCE_DATE_EPOCH": date or None}
    before = {name: os.environ.get(name) for name in wanted}
    _set_environment(wanted)
    silent = silence()
    try:
        yield
    finally:
        silence(silent)
        _set_environment(before)


def _set_environment(values: Mapping[str, str | None]) -> None:
    for name, value in values.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


@contextmanager
def _ends_when_unwanted() -> Iterator[None]:
    """End this process where its job is given up: by the program that sent it, or because the cluster is out of reach.

    Else the job would go on writing beside its successor. Only a process that a nanny starts again, and that does
    nothing else at the same time, ends itself.
    """
    try:
        from distributed import get_worker
        from distributed.worker import thread_state

        worker, key = get_worker(), thread_state.key
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
        if (given_up or worker.status.name in ("closing", "closed", "failed")) and not done.is_set():
            os._exit(FAILED)
