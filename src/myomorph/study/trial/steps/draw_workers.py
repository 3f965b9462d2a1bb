"""Draws shared by processes: this one and others beside it, each with one thread."""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from myomorph.model.arrays import Array
from myomorph.rigid.frames import one_thread, thread_count
from myomorph.study.inputs.loads import ExternalLoads
from myomorph.study.trial.steps.draw_process import PROTOCOL
from myomorph.study.trial.steps.drawn_trials import Chain
from myomorph.uncertainty.bodies import Draw

Tables = Mapping[str, Array]
WORTH = 8.0
"""Processes are begun where what is left would take longer in this one [s]; to begin one takes two or three."""
AHEAD = 4
"""Results a process may be ahead of the one that is waited for, so that memory does not grow with draws."""
ONE_THREAD = ("OPENBLAS", "OMP", "MKL", "NUMEXPR", "VECLIB_MAXIMUM")


def attempts(chain: Chain, draws: Sequence[Draw], workers: int | None = None) -> Iterator[Tables | None]:
    """What draws come to, in order, None for no solution; by default on all threads where worth their start."""
    count = thread_count() if workers is None else workers
    if count <= 1 or len(draws) <= 2:
        yield from (chain.attempt(draw) for draw in draws)
        return
    # The first draw may compile kernels; the second tells how long one takes.
    yield chain.attempt(draws[0])
    begun = time.monotonic()
    yield chain.attempt(draws[1])
    left = draws[2:]
    if workers is None and len(left) * (time.monotonic() - begun) < WORTH:
        yield from (chain.attempt(draw) for draw in left)
        return
    with _Shared(chain, left, min(count, len(left)) - 1) as shared:
        yield from shared


class _Shared:
    """Draws that this process and others take one by one; iteration gives what they come to in order."""

    def __init__(self, chain: Chain, draws: Sequence[Draw], others: int):
        self._chain, self._draws = chain, draws
        self._found: dict[int, Tables | Exception | None] = {}
        self._next, self._wanted, self._window = 0, 0, AHEAD * (others + 1)
        self._returned: list[int] = []
        self._changed = threading.Condition()
        # What reads the recording's forces is a function of this process; the forces themselves are in the chain.
        plain = pickle.dumps(
            replace(chain, trial=replace(chain.trial, inputs=chain.trial.inputs.without(ExternalLoads))), PROTOCOL
        )
        self._children = [_begin() for _ in range(others)]
        for child in self._children:
            threading.Thread(target=self._serve, args=(child, plain), daemon=True).start()

    def __enter__(self) -> _Shared:
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._next = len(self._draws)
            self._returned.clear()
            self._changed.notify_all()
        for child in self._children:
            child.kill()
            child.wait()

    def __iter__(self) -> Iterator[Tables | None]:
        for number in range(len(self._draws)):
            yield self._result(number)

    def _result(self, number: int) -> Tables | None:
        while True:
            with self._changed:
                self._wanted = number
                self._changed.notify_all()
                if number in self._found:
                    result = self._found.pop(number)
                    break
                outcome = self._take(waiting=False)
                if outcome is None:
                    self._changed.wait()
                    continue
            with one_thread():
                made = self._chain.attempt(self._draws[outcome])
            with self._changed:
                self._found[outcome] = made
        if isinstance(result, Exception):
            raise result
        return result

    def _take(self, waiting: bool) -> int | None:
        """Number of a draw that nobody has begun, None where there is none now; called with the lock held."""
        while True:
            if self._returned:
                return self._returned.pop()
            if self._next >= len(self._draws):
                return None
            if self._next < self._wanted + self._window:
                self._next += 1
                return self._next - 1
            if not waiting:
                return None
            self._changed.wait()

    def _serve(self, child: subprocess.Popen[bytes], chain: bytes) -> None:
        """Give a process draws until there are no more; runs in a thread."""
        assert child.stdin is not None
        assert child.stdout is not None
        number: int | None = None
        try:
            child.stdin.write(pickle.dumps(sys.path, PROTOCOL) + chain)
            while True:
                with self._changed:
                    number = self._take(waiting=True)
                if number is None:
                    return
                child.stdin.write(pickle.dumps(self._draws[number], PROTOCOL))
                child.stdin.flush()
                answer = pickle.load(child.stdout)
                with self._changed:
                    self._found[number], number = answer, None
                    self._changed.notify_all()
        except (OSError, EOFError, pickle.UnpicklingError):
            # It was lost: another takes its draw.
            with self._changed:
                if number is not None:
                    self._returned.append(number)
                self._changed.notify_all()
        finally:
            for stream in (child.stdin, child.stdout):
                with contextlib.suppress(OSError):
                    stream.close()


def _begin() -> subprocess.Popen[bytes]:
    environment = os.environ | {f"{name}_NUM_THREADS": "1" for name in ONE_THREAD} | {"MYOMORPH_THREADS": "1"}
    command = [sys.executable, "-m", "myomorph.study.trial.steps.draw_process"]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment)
