"""A process that does jobs for another: models and jobs come in on its input, outcomes go out on its output.

It is started with `python -m myomorph.study.workers.worker_process` and ends at once when the other process does,
because its input then ends.
"""

from __future__ import annotations

import _thread
import faulthandler
import os
import pickle
import queue
import signal
import sys
import threading
import warnings
from collections.abc import Callable
from types import FrameType
from typing import Any

from myomorph.model.model import Model
from myomorph.store.outcome import Outcome
from myomorph.study.workers.jobs import Begin, Do, Done, Stop, receive, send


class _Stopping:
    """Ends the process: at once where nobody waits for it, else after what it does has tidied up."""

    def __init__(self) -> None:
        self.asked = False
        signal.signal(signal.SIGINT, self._interrupted)

    def _interrupted(self, number: int, frame: FrameType | None) -> None:
        # Ctrl-C reaches all processes of a terminal; what becomes of this one is for the other process to say.
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


def _read(descriptor: int, messages: queue.SimpleQueue[Any], stopping: _Stopping) -> None:
    """Take messages as they come; runs in a thread, so that the end of the other process is seen at any time."""
    while True:
        try:
            message = receive(descriptor)
        except (OSError, pickle.UnpicklingError):
            message = None
        if message is None:
            os._exit(1)
        messages.put(message)
        if isinstance(message, Stop):
            stopping.stop()


def _do(message: Do, models: dict[int, Model]) -> Done:
    try:
        for number in message.forget:
            models.pop(number, None)
        if message.packed is not None:
            models[message.model] = pickle.loads(message.packed)
        work: Callable[[Model | None], Outcome] = pickle.loads(message.work)
        return Done(work(models.get(message.model)))
    except Exception as error:
        return Done(None, f"{type(error).__name__}: {' '.join(str(error).split())}")


def main() -> None:
    """Do jobs until the other process asks for the end, or ends."""
    faulthandler.enable()
    warnings.simplefilter("ignore")
    messages_in, answers = os.dup(0), os.dup(1)
    if sys.platform == "win32":
        # Windows only.
        import msvcrt

        for descriptor in (messages_in, answers):
            msvcrt.setmode(descriptor, os.O_BINARY)
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


def _work(messages: queue.SimpleQueue[Any], answers: int) -> None:
    # After the messages are taken: what the process prints must not meddle with them.
    from myomorph.store.progress import silence

    silence()
    models: dict[int, Model] = {}
    while True:
        message = messages.get()
        if isinstance(message, Begin):
            sys.path[:] = message.path
        elif isinstance(message, Do):
            send(answers, _do(message, models))
        else:
            return


if __name__ == "__main__":
    main()
