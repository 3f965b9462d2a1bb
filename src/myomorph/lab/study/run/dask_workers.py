"""Jobs of a study on a Dask cluster: one at a time in each of its processes, wherever these run."""

from __future__ import annotations

import os
import queue
import time
import uuid
from collections import OrderedDict, deque
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.study.run.dask_cluster import (
    KEPT,
    connected,
    do_job,
    fitness,
    leave_mark,
    scheduler_address,
    unfit,
)
from myomorph.lab.study.workers.jobs import Ended, Job, pack

PATIENCE = 12.0  # How long a scheduler may take to answer, and its first worker to come [s].

ALONE = 600.0  # How long a study waits for workers once all are gone [s].

LOOK = 1.0  # How often the scheduler is asked which workers there are [s].

FETCH = 10.0  # How long an outcome may take to come from its process [s].


@dataclass
class Process:
    """A process of the cluster as seen from here.

    Attributes
    ----------
    address : in the cluster
    memory : that it may take [bytes], 0 where nothing bounds it
    asked : future of its fitness, None once it was found fit
    takes : it takes tasks now; one that is short of memory pauses
    model : packed, of its last job
    """

    address: str
    memory: int
    asked: Any
    there: bool = True
    takes: bool = True
    job: Job | None = None
    model: bytes = b""
    future: Any = None

    @property
    def useful(self) -> bool:
        """Whether it may be given jobs."""
        return self.asked is None and self.there and self.takes


class DaskWorkers:
    """The fit processes of a Dask cluster.

    They run the same version as this one, and see the folder of the results under the same name;
    `refused` says why others get no job.

    A process is given one job at a time, however many threads it has. A job whose process is
    lost is not repeated here: `ended` reports it, and who started it may start it again. Processes
    that come later are used, too; the scheduler and its first worker are waited for `patience` [s].
    """

    def __init__(self, address: str, folder: Path | None = None, patience: float = PATIENCE):
        self._address = scheduler_address(address)
        self.refused: dict[str, str] = {}
        self._processes: dict[str, Process] = {}
        self._waiting: deque[tuple[Job, bytes]] = deque()
        self._packed: OrderedDict[int, tuple[Model, bytes]] = OrderedDict()
        self._woken: queue.SimpleQueue[None] = queue.SimpleQueue()
        self._looked = 0.0
        self._last_useful = self._answered = time.monotonic()
        self._client = connected(self._address, patience)
        self._mark: tuple[Path, str] | None = None
        try:
            self._mark = None if folder is None else leave_mark(folder)
            self._await_first(patience)
        except BaseException:
            self.close()
            raise

    @property
    def count(self) -> int:
        """Jobs that run at the same time: the processes that are there now."""
        return sum(1 for process in self._processes.values() if process.useful)

    @property
    def memory(self) -> int | None:
        """What the smallest of the processes may take [bytes], None where none is bounded."""
        return min(
            (
                process.memory
                for process in self._processes.values()
                if process.useful and process.memory
            ),
            default=None,
        )

    def start(self, job: Job, model: Model | None) -> None:
        """Take a job; it waits where all processes are busy."""
        self._waiting.append((job, b"" if model is None else self._pack(model)))
        self._place()

    def ended(self, timeout: float) -> list[Ended]:
        """Return jobs that have ended since, or whose process is lost.

        There are none after `timeout` [s]. Raises `BadData` where the scheduler is gone, or there
        was no worker for `ALONE`.
        """
        until = time.monotonic() + timeout
        while True:
            if time.monotonic() - self._looked > LOOK:
                self._look()
            result = [
                one
                for process in list(self._processes.values())
                if (one := self._end_of(process)) is not None
            ]
            self._place()
            left = until - time.monotonic()
            if result or left <= 0.0:
                return result
            with suppress(queue.Empty):
                self._woken.get(timeout=min(left, LOOK))

    def close(self) -> None:
        """Give all jobs up.

        A process that a nanny starts again ends at once when its job is given up.
        """
        with suppress(Exception):
            busy = [
                process.future for process in self._processes.values() if process.future is not None
            ]
            self._client.cancel(busy, force=True)
        with suppress(Exception):
            self._client.close(timeout=3)
        if self._mark is not None:
            self._mark[0].unlink(missing_ok=True)

    def _await_first(self, patience: float) -> None:
        """Wait until a process is fit, and all that are there have answered."""
        until = time.monotonic() + patience
        while time.monotonic() < until:
            self._look()
            if (self.count or self.refused) and all(
                process.asked is None for process in self._processes.values()
            ):
                break
            time.sleep(0.05)
        if self.count:
            return
        if self.refused:
            some = "; ".join(list(self.refused.values())[:3])
            more = f"; and {len(self.refused) - 3} more" if len(self.refused) > 3 else ""
            raise BadData(f"--scheduler {self._address}: no worker can be used: {some}{more}")
        there = "none of its workers answers" if self._processes else "it has no workers"
        hint = f"start some with 'dask worker {self._address} --nthreads 1', then run this again"
        raise BadData(f"--scheduler {self._address}: {there}: {hint}")

    def _look(self) -> None:
        """See which processes there are; new ones are asked whether they are fit."""
        there = self._identity()
        self._looked = time.monotonic()
        if there is None:
            return
        for address, told in there.items():
            if address not in self._processes and address not in self.refused:
                path, content = self._mark or ("", "")
                asked = self._task(address, fitness, str(path), content)
                self._processes[address] = Process(
                    address, int(told.get("memory_limit") or 0), asked
                )
        for process in list(self._processes.values()):
            process.there = process.there and process.address in there
            process.takes = there.get(process.address, {}).get("status", "running") == "running"
            if not process.there and process.job is None:
                del self._processes[process.address]
            elif process.asked is not None and process.asked.done():
                self._judge(process)
        if self.count:
            self._last_useful = time.monotonic()
        elif time.monotonic() - self._last_useful > ALONE:
            hint = "what is done is kept: start workers and run the same command again to go on"
            raise BadData(
                f"--scheduler {self._address}: no worker was there for {ALONE / 60:.0f} min; {hint}"
            )

    def _identity(self) -> dict[str, dict[str, Any]] | None:
        """Return what the scheduler knows of each process, by address.

        It is None while the connection is made again.
        """
        if self._client.status not in ("closing", "closed"):
            try:
                identity = self._client.sync(
                    self._client.scheduler.identity, n_workers=-1, callback_timeout=FETCH
                )
            # of several libraries, and what it was does not matter: the next look tells
            except Exception:
                if time.monotonic() - self._answered > ALONE:
                    raise self._gone(f"has not answered for {ALONE / 60:.0f} min") from None
                return None
            self._answered = time.monotonic()
            return dict(identity["workers"])
        raise self._gone("is gone")

    def _gone(self, what: str) -> BadData:
        """Make the error of a scheduler that serves no longer."""
        hint = (
            "what is done is kept: start it and its workers, and run the same command again to"
            " go on"
        )
        return BadData(f"--scheduler {self._address}: the scheduler {what}: {hint}")

    def _judge(self, process: Process) -> None:
        """Take a process that has answered, or refuse it by name."""
        try:
            reason = unfit(process.asked.result(timeout=FETCH), self._mark)
        except Exception as error:
            reason = f"cannot run Myomorph ({type(error).__name__}: {' '.join(str(error).split())})"
        process.asked = None
        if reason:
            self.refused[process.address] = f"worker {process.address} {reason}"
            del self._processes[process.address]

    def _place(self) -> None:
        """Give jobs that wait to processes that do nothing, rather to one that has the model."""
        free = [
            process
            for process in self._processes.values()
            if process.useful and process.job is None
        ]
        while free and self._waiting:
            job, model = self._waiting.popleft()
            process = next((each for each in free if each.model is model), free[0])
            free.remove(process)
            process.job = job
            process.model = model
            date = os.environ.get("SOURCE_DATE_EPOCH", "")
            process.future = self._task(process.address, do_job, pack(job.work), model, date)

    def _task(self, address: str, function: Any, *values: Any) -> Any:
        """Return a future of a function's result in one process.

        The scheduler is never to repeat it elsewhere.
        """
        try:
            future = self._client.submit(
                function,
                *values,
                key=f"{function.__name__}-{uuid.uuid4().hex}",
                workers=[address],
                allow_other_workers=False,
                pure=False,
            )
        # of several libraries: the connection may end at any time
        except Exception as error:
            if self._client.status == "running":
                raise
            raise self._gone("is gone") from error
        future.add_done_callback(lambda _: self._woken.put(None))
        return future

    def _end_of(self, process: Process) -> Ended | None:
        """Return what became of a process's job, None where it goes on."""
        if process.job is None:
            return None
        outcome: Outcome | None = None
        lost = ""
        if process.future.done():
            try:
                outcome = process.future.result(timeout=FETCH)
            except Exception as error:
                lost = f"{type(error).__name__}: {' '.join(str(error).split())}"
        elif process.there:
            return None
        if outcome is None and (
            not process.there or process.future.status in ("cancelled", "lost")
        ):
            lost = f"worker {process.address} was lost ({self._reason(process)})"
        with suppress(Exception):
            process.future.cancel()
        ended = Ended(process.job, outcome, lost)
        process.job = process.future = None
        return ended

    def _reason(self, process: Process) -> str:
        with suppress(Exception):
            events = self._client.get_events("worker-restart-memory")
            if any(event[1].get("worker") == process.address for event in events):
                return f"over its memory, {process.memory / 1e9:.1f} GB"
        return "killed, cut off or ended"

    def _pack(self, model: Model) -> bytes:
        """Return the model as bytes, made once."""
        if id(model) not in self._packed:
            self._packed[id(model)] = model, pack(model)
            while len(self._packed) > KEPT:
                self._packed.popitem(last=False)
        return self._packed[id(model)][1]
