"""A process that does one task for the page: the task comes in on its input, events go out.

It is started with `python -m myomorph.show.app.task_process`, says on its output how it goes, one
line of JSON each time, and ends when its input does.
"""

from __future__ import annotations

import _thread
import faulthandler
import json
import os
import pickle
import signal
import threading
import warnings
from typing import IO, Any

from myomorph.core.rigid.compile_notices import before_compiling
from myomorph.lab.cli.failures import failure_of
from myomorph.show.app.tasks import do

COMPILING = "Preparing this computer, once: the first computation takes some minutes longer."


def main() -> None:
    """Do the task that comes in, until it is done or the other process wants no more."""
    faulthandler.enable()
    warnings.simplefilter("ignore")
    # Where the program runs in the background, shells let it and its children ignore this.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    task_in = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    # Whatever else reads or prints must not meddle with the events.
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(2, 1)
    task = pickle.load(task_in)
    threading.Thread(target=_await_end, args=(task_in,), daemon=True).start()

    def say(event: str, **values: Any) -> None:
        answers.write(json.dumps({"event": event, **values}) + "\n")
        answers.flush()

    before_compiling(lambda folder, can_keep: say("note", text=COMPILING))
    try:
        do(task, say)
    except KeyboardInterrupt:
        say("cancelled")
    except Exception as error:
        say("failed", text=failure_of(error).text)
    # Threads of libraries may still wait for something: nothing here is worth waiting for.
    os._exit(0)


def _await_end(stream: IO[bytes]) -> None:
    """Interrupt the work once the other process wants no more; runs in a thread."""
    while stream.read(1):
        pass
    if hasattr(signal, "pthread_kill"):
        # A real signal also ends waiting and sleeping.
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        _thread.interrupt_main()


if __name__ == "__main__":
    main()
