"""Signals that end a session as Ctrl-C does, so that its results are written."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

SIGNALS = ("SIGTERM", "SIGHUP", "SIGBREAK")
"""Of a system that shuts down, a terminal that is closed, and Ctrl-Break of Windows."""


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Take signals to end for Ctrl-C within the block.

    Only the main thread of a program can do so; in others nothing is changed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: Any) -> None:
        raise KeyboardInterrupt

    before = {
        number: signal.signal(number, stop)
        for name in SIGNALS
        if (number := getattr(signal, name, None)) is not None
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
