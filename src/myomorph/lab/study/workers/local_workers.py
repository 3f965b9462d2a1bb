"""Workers of this machine, within its cores and memory: this process or others beside it."""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import psutil

from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.lab.study.workers.ahead import motion_cached
from myomorph.lab.study.workers.jobs import Do, Done, Ended, Job, Stop, Workers, pack, send

# Where Linux tells what a group of processes may take; absent elsewhere.
GROUP = Path("/sys/fs/cgroup")
LOOK = 0.25  # How often the memory of the processes is looked at [s].
GRACE = 5.0  # How long processes may tidy up when they are asked to end [s].
NEEDED = 1 << 30  # Memory below which a process is not begun unless asked for [bytes].
SHARE = 0.8  # Part of the free memory that the processes may take together.
GIB = 2.0**30
# How long the others wait, on a new machine, for the first process to compile what all use [s].
FIRST = 90.0
NOTHING = object()  # In the place of a model, None among them, before the first job.
ONE_THREAD = ("OPENBLAS", "OMP", "MKL", "NUMEXPR", "VECLIB_MAXIMUM")


def usable_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def free_memory() -> int:
    """Memory that is free for this process and those it starts [bytes]."""
    free = int(psutil.virtual_memory().available)
    for limit, used in (
        ("memory.max", "memory.current"),
        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"),
    ):
        granted = _number(GROUP / limit)
        taken = _number(GROUP / used)
        if granted is not None:
            free = min(free, max(0, granted - (taken or 0)))
    return free


def _number(path: Path) -> int | None:
    try:
        text = path.read_text(encoding="ascii").strip()
    except (OSError, ValueError):
        return None
    return int(text) if text.isdigit() else None


class InProcess:
    """One worker, which is the process that asks: each job is done when its end is asked for."""

    count = 1
    memory: int | None = None

    def __init__(self) -> None:
        self._waiting: deque[tuple[Job, Model | None]] = deque()

    def start(self, job: Job, model: Model | None) -> None:
        """Take a job."""
        self._waiting.append((job, model))

    def ended(self, timeout: float) -> list[Ended]:
        """Do the next job."""
        if not self._waiting:
            return []
        job, model = self._waiting.popleft()
        return [Ended(job, job.work(model))]

    def close(self) -> None:
        """Forget what has not begun."""
        self._waiting.clear()


@dataclass(eq=False)
class _Process:
    """A process beside this one.

    It holds what it writes on its standard error, for the reason where it is lost; the model of its
    last job; and why it was ended from here.
    """

    child: subprocess.Popen[bytes]
    seen: psutil.Process
    errors: IO[bytes]
    job: Job | None = None
    model: object = NOTHING
    over: str = ""

    @property
    def given(self) -> IO[bytes]:
        """Its input."""
        assert self.child.stdin is not None
        return self.child.stdin


class LocalWorkers:
    """Processes of this machine, replaced where they are lost.

    One that takes more than `memory` [bytes] is ended.
    """

    def __init__(self, count: int, memory: int | None = None, threads: int = 1) -> None:
        if count < 1:
            raise BadData(f"workers {count}: expected 1 or more")
        self.count = count
        self.memory = memory
        self.threads = threads
        self._all: list[_Process] = []
        self._answers: queue.SimpleQueue[tuple[_Process, Any]] = queue.SimpleQueue()
        self._packed: tuple[object, bytes] = NOTHING, b""
        self._looked = 0.0
        self._compiles_until: float | None = None
        self._later: deque[tuple[Job, Model | None]] = deque()

    @property
    def processes(self) -> tuple[int, ...]:
        """Numbers of the processes that live."""
        return tuple(process.child.pid for process in self._all)

    def start(self, job: Job, model: Model | None) -> None:
        """Give a job to a process that has none.

        The model is sent where the process does not hold it yet. On a new machine the first job is
        alone until it has ended, so that not all processes compile the same kernels.
        """
        if self._compiles_until is None:
            self._compiles_until = (
                0.0 if self.count == 1 or motion_cached() else time.monotonic() + FIRST
            )
        elif self._compiles_until:
            self._later.append((job, model))
            return
        self._give(job, model)

    def _give(self, job: Job, model: Model | None) -> None:
        idle = [
            process for process in self._all if process.job is None and process.child.poll() is None
        ]
        holding = [process for process in idle if process.model is model]
        process = (holding or idle or [self._begin()])[0]
        if self._packed[0] is not model:
            self._packed = model, pack(model)
        packed = None if process.model is model else self._packed[1]
        process.job = job
        process.model = model
        # Where it has just ended, its reader tells so.
        with contextlib.suppress(OSError):
            send(process.given, Do(pack(job.work), packed))

    def _begin(self) -> _Process:
        environment = os.environ | {f"{name}_NUM_THREADS": "1" for name in ONE_THREAD}
        # Modules are found where this process finds them.
        environment |= {
            "MYOMORPH_THREADS": str(self.threads),
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        }
        errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the process ends
        # -P: what lies in the folder of recordings is no module.
        child = subprocess.Popen(
            [sys.executable, "-P", "-m", "myomorph.lab.study.workers.worker_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            env=environment,
        )
        process = _Process(child, psutil.Process(child.pid), errors)
        self._all.append(process)
        threading.Thread(target=self._read, args=(process,), daemon=True).start()
        return process

    def _read(self, process: _Process) -> None:
        """Pass on what a process answers, and at last that it has ended; runs in a thread."""
        assert process.child.stdout is not None
        message: Any = True
        while message is not None:
            try:
                message = pickle.load(process.child.stdout)
            except Exception:
                # Whatever is wrong with its answers, it is of no use any more.
                message = None
            self._answers.put((process, message))
        with contextlib.suppress(OSError):
            process.child.stdout.close()

    def ended(self, timeout: float) -> list[Ended]:
        """Return jobs that have ended, as soon as there is one.

        It also watches the memory of the processes.
        """
        until = time.monotonic() + timeout
        result: list[Ended] = []
        while not result:
            left = until - time.monotonic()
            if left <= 0.0:
                break
            self._bound_memory()
            if self._compiles_until and time.monotonic() > self._compiles_until:
                self._give_rest()
            try:
                process, answer = self._answers.get(timeout=min(LOOK, left))
            except queue.Empty:
                continue
            result += self._take(process, answer)
            self._give_rest()
            while not self._answers.empty():
                result += self._take(*self._answers.get())
        return result

    def _give_rest(self) -> None:
        """Give out what waited for the first job."""
        self._compiles_until = 0.0
        while self._later:
            self._give(*self._later.popleft())

    def _take(self, process: _Process, answer: Any) -> list[Ended]:
        job = process.job
        process.job = None
        if isinstance(answer, Done):
            if job is None:
                return []
            return [
                Ended(
                    job,
                    answer.outcome,
                    answer.broken and f"it failed there: {answer.broken}",
                )
            ]
        if process in self._all:
            self._all.remove(process)
        why = process.over or _why(process)
        _bury(process)
        return [] if job is None else [Ended(job, None, why)]

    def _bound_memory(self) -> None:
        """End processes that take more than they may."""
        now = time.monotonic()
        if self.memory is None or now - self._looked < LOOK:
            return
        self._looked = now
        for process in self._all:
            with contextlib.suppress(psutil.Error):
                taken = _taken(process.seen)
                if taken > self.memory and not process.over:
                    limit = f"{self.memory / GIB:.2f} GiB that a worker may take"
                    process.over = f"it took {taken / GIB:.2f} GiB of memory, more than the {limit}"
                    process.child.kill()

    def close(self) -> None:
        """Let all processes tidy up and end; those that do not are ended after a few seconds."""
        ending = self._all
        self._all = []
        self._later.clear()
        for process in ending:
            # Where a pipe is full, the process would not read this either: it is ended below.
            threading.Thread(target=_ask_to_stop, args=(process,), daemon=True).start()
        until = time.monotonic() + GRACE
        for process in ending:
            _bury(process, max(0.0, until - time.monotonic()))


def _taken(process: psutil.Process) -> int:
    """Return the memory that a process takes [bytes].

    In an environment on Windows the interpreter is a child of what is started.
    """
    resident = int(process.memory_info().rss)
    if sys.platform == "win32":
        resident += sum(int(child.memory_info().rss) for child in process.children(recursive=True))
    return resident


def _ask_to_stop(process: _Process) -> None:
    with contextlib.suppress(OSError, ValueError):
        send(process.given, Stop())


def _bury(process: _Process, patience: float = GRACE) -> None:
    """Close what belonged to a process that has ended.

    One that has not ended after `patience` [s] is ended.
    """
    try:
        process.child.wait(patience)
    except subprocess.TimeoutExpired:
        process.child.kill()
        process.child.wait()
    for stream in (process.child.stdin, process.errors):
        if stream is not None:
            with contextlib.suppress(OSError):
                stream.close()


def _why(process: _Process) -> str:
    """Why a process has ended."""
    try:
        status = process.child.wait(GRACE)
    except subprocess.TimeoutExpired:
        return "its process closed its output"
    if status < 0:
        try:
            name = signal.Signals(-status).name
        except ValueError:
            name = f"signal {-status}"
        doubt = ", perhaps because memory ran out" if name == "SIGKILL" else ""
        return f"its process was ended by {name}{doubt}"
    process.errors.seek(0)
    lines = process.errors.read().decode("utf-8", "replace").strip().splitlines()
    return f"its process ended with status {status}" + (f": {lines[-1].strip()}" if lines else "")


def local_workers(
    count: int | None = None, memory: int | None = None, jobs: int = 0, threads: int | None = None
) -> Workers:
    """Return workers of this machine.

    They are the process itself where there is one job, else others beside it. By default there is
    one for each core, as far as memory reaches, but no more than `jobs` (0 where not known); each
    with one thread and its share of the free `memory` [bytes], or all cores where there is one job.
    """
    if memory is not None and memory < NEEDED // 4:
        raise BadData(
            f"memory {memory / 1e9:g} GB: expected {NEEDED / 4e9:.2f} GB or more: less does not"
            " hold a model"
        )
    if count is None and jobs == 1 and memory is None:
        return InProcess()
    free = free_memory()
    if count is None:
        cores = max(1, usable_cores() // (threads or 1))
        count = max(1, min(cores, jobs or cores, int(SHARE * free // (memory or NEEDED))))
    elif jobs:
        count = min(count, jobs)
    share = int(SHARE * free / max(1, count)) if memory is None else memory
    return LocalWorkers(count, share, threads or 1)
