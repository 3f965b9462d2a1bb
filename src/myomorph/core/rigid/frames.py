"""Frames split over the cores: kernels release the GIL, so plain threads suffice."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from typing import Any

# Frames that a thread computes at a time: few enough to share evenly, enough to cost nothing
CHUNK = 64
_ALONE = ContextVar("_ALONE", default=False)


@contextmanager
def one_thread() -> Iterator[None]:
    """Split no frames in here: processes beside this one use the other cores."""
    before = _ALONE.set(True)
    try:
        yield
    finally:
        _ALONE.reset(before)


def thread_count() -> int:
    """Count the threads to use.

    One within `one_thread`, else the environment variable MYOMORPH_THREADS, or all cores.
    """
    if _ALONE.get():
        return 1
    requested = os.environ.get("MYOMORPH_THREADS", "")
    if requested.isdigit() and int(requested) > 0:
        return int(requested)
    return os.cpu_count() or 1


def over_frames(
    task: Callable[[int, int], None],
    frames: int,
    progress: Callable[[int], None] | None = None,
    chunk: int = CHUNK,
) -> None:
    """Call `task(start, stop)` for all frames, chunk by chunk, in `thread_count()` threads.

    Parameters
    ----------
    task : computes the frames start ... stop - 1
    frames : their number
    progress : called with the number of frames just done
    chunk : frames of a call
    """
    parts = [(start, min(start + chunk, frames)) for start in range(0, frames, chunk)]
    # A single chunk, as of a live frame, does not ask the system for its cores.
    threads = min(thread_count(), len(parts)) if len(parts) > 1 else 1
    if threads <= 1:
        for start, stop in parts:
            task(start, stop)
            if progress:
                progress(stop - start)
        return
    with ThreadPoolExecutor(threads) as pool:
        # A thread starts with an empty context: a copy says whether kernels run as Python.
        running = {
            pool.submit(copy_context().run, task, start, stop): stop - start
            for start, stop in parts
        }
        try:
            for done in as_completed(running):
                done.result()
                if progress:
                    progress(running[done])
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def run_frames(
    kernel: Callable[..., Any],
    fixed: Iterable[Any],
    *arrays: Any,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Call `kernel(*fixed, *parts)` for all frames as `over_frames` does.

    Parameters
    ----------
    kernel : fills some of its arrays in place
    fixed : its first arguments, the same for all frames
    arrays : (frames, ...) of which each call takes a part
    progress : called with the number of frames just done
    """

    def run(start: int, stop: int) -> None:
        kernel(*fixed, *(array[start:stop] for array in arrays))

    over_frames(run, len(arrays[0]), progress)
