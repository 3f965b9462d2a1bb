"""Signals that end a session as Ctrl-C does, so that its results are written.

Windows has SIGBREAK in the place of SIGHUP: Ctrl-Break, a closed window and the end of the login.
There a closed window leaves a program no time to write results, and ending a process by the task
manager is no signal at all: what is left is the log.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

SIGNALS = ("SIGTERM", "SIGHUP", "SIGBREAK")
"""Of a system that shuts down, a terminal that is closed, and both on Windows."""


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Take signals to end for Ctrl-C within the block: they raise `KeyboardInterrupt`."""

    def stop(number: int, frame: Any) -> None:
        raise KeyboardInterrupt

    with _handled(SIGNALS, stop):
        yield


@contextmanager
def asked_to_end() -> Iterator[threading.Event]:
    """Yield the event that the first Ctrl-C, or signal to end, sets within the block.

    An exception can be raised anywhere, in the middle of writing too. So only a second signal
    raises `KeyboardInterrupt`.
    """
    ended = threading.Event()

    def end(number: int, frame: Any) -> None:
        if ended.is_set():
            raise KeyboardInterrupt
        ended.set()

    with _handled(("SIGINT", *SIGNALS), end):
        yield ended


@contextmanager
def _handled(names: Sequence[str], handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Give signals a handler within the block, where the system has them.

    Only the main thread of a program can do so; in others nothing is changed. A signal that is
    ignored stays so: `nohup` and a shell's background ask for it.
    """
    before = {}
    if threading.current_thread() is threading.main_thread():
        for name in names:
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) != signal.SIG_IGN:
                before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
