"""A process that does jobs for another.

Models and jobs come in on its input, outcomes go out on its output. It is started with `python -m
myomorph.lab.study.workers.worker_process` and ends at once when the other process does, because its
input then ends.
"""

from __future__ import annotations

import _thread
import faulthandler
import os
import pickle
import queue
import signal
import threading
import warnings
from collections.abc import Callable
from types import FrameType
from typing import IO, Any

from myomorph.core.model.model import Model
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.study.workers.jobs import Do, Done, Stop, send


class _Stopping:
    """End the process: at once if nobody waits for it, else after its work has tidied up."""

    def __init__(self) -> None:
        self.asked = False
        signal.signal(signal.SIGINT, self._interrupted)

    def _interrupted(self, number: int, frame: FrameType | None) -> None:
        # Ctrl-C reaches all processes of a terminal; what becomes of this one is for the other
        # process to say.
        if self.asked:
            raise KeyboardInterrupt

    def stop(self) -> None:
        """Interrupt what is done now."""
        self.asked = True
        if hasattr(signal, "pthread_kill"):
            # A real signal also ends waiting and sleeping.
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
        else:
            _thread.interrupt_main()


def _read(stream: IO[bytes], messages: queue.SimpleQueue[Any], stopping: _Stopping) -> None:
    """Take messages as they come.

    It runs in a thread, so that the end of the other process is noticed at any time.
    """
    while True:
        try:
            message = pickle.load(stream)
        except (OSError, EOFError, pickle.UnpicklingError):
            os._exit(1)
        messages.put(message)
        if isinstance(message, Stop):
            stopping.stop()


def _do(message: Do, held: list[Model | None]) -> Done:
    try:
        if message.model is not None:
            held[0] = pickle.loads(message.model)
        work: Callable[[Model | None], Outcome] = pickle.loads(message.work)
        return Done(work(*held))
    except Exception as error:
        return Done(None, f"{type(error).__name__}: {' '.join(str(error).split())}")


def main() -> None:
    """Do jobs until the other process asks for the end, or ends."""
    faulthandler.enable()
    warnings.simplefilter("ignore")
    messages_in = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    # Whatever else reads or prints must not meddle with the messages.
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(2, 1)
    stopping = _Stopping()
    messages: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(messages_in, messages, stopping), daemon=True).start()
    status = 0
    try:
        _work(messages, answers)
    except (KeyboardInterrupt, OSError):
        status = 1
    # Threads of libraries may still wait for something: nothing here is worth waiting for.
    os._exit(status)


def _work(messages: queue.SimpleQueue[Any], answers: IO[bytes]) -> None:
    # After the messages are taken: what the process prints must not meddle with them.
    from myomorph.lab.store.progress import silence

    silence()
    held: list[Model | None] = [None]
    while True:
        message = messages.get()
        if not isinstance(message, Do):
            return
        send(answers, _do(message, held))


if __name__ == "__main__":
    main()
