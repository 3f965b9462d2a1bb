"""A process beside the server that does a task, is listened to, and can be ended at any time."""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping
from typing import Any

import psutil

from myomorph.core.model.errors import one_line
from myomorph.core.model.frozen_map import FrozenMap

MODULE = "myomorph.show.app.task_process"
GRACE = 8.0  # How long the process may tidy up when it is asked to end [s].
NO_WINDOW = getattr(subprocess, "CREATE_NO_WINDOW", 0)

Event = dict[str, Any]


class Worker:
    """A process that does one task.

    Parameters
    ----------
    task : of a kind of `tasks`
    heard : called with each event, in a thread; the last is `gone`, with the last line that the
        process printed
    environment : that it has besides this process'
    """

    def __init__(
        self,
        task: object,
        heard: Callable[[Worker, Event], None],
        environment: Mapping[str, str] = FrozenMap({}),
    ) -> None:
        self._heard = heard
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed when the process ends
        # Modules are found where this process finds them.
        modules = os.pathsep.join(filter(None, sys.path))
        self._child = subprocess.Popen(
            [sys.executable, "-P", "-m", MODULE],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            env={**os.environ, "PYTHONPATH": modules, **environment},
            creationflags=NO_WINDOW,
        )
        assert self._child.stdin is not None
        # Where it has ended already, the reader says so.
        with contextlib.suppress(OSError):
            pickle.dump(task, self._child.stdin)
            self._child.stdin.flush()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        """Pass on what the process says; runs in a thread."""
        assert self._child.stdout is not None
        for line in self._child.stdout:
            with contextlib.suppress(ValueError):
                self._heard(self, json.loads(line))
        self._child.wait()
        self._child.stdout.close()
        self._errors.seek(0)
        printed = self._errors.read().decode("utf-8", "replace").strip().splitlines()
        self._errors.close()
        last = one_line(printed[-1]) if printed else f"status {self._child.returncode}"
        self._heard(self, {"event": "gone", "why": last})

    def stop(self) -> None:
        """Ask the process to end, and end it with all that it has begun where it does not."""
        with contextlib.suppress(OSError):
            assert self._child.stdin is not None
            self._child.stdin.close()
        try:
            self._child.wait(GRACE)
        except subprocess.TimeoutExpired:
            self._kill()
        self._reader.join(GRACE)

    def _kill(self) -> None:
        with contextlib.suppress(psutil.Error):
            for child in psutil.Process(self._child.pid).children(recursive=True):
                with contextlib.suppress(psutil.Error):
                    child.kill()
        self._child.kill()
        self._child.wait()
