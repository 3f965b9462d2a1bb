"""Fair times: programs take turns in one process and the median counts; and memory, on Linux."""

from __future__ import annotations

import multiprocessing
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

MEGABYTE = 2.0**20
T = TypeVar("T")


@dataclass(frozen=True)
class Taken(Generic[T]):
    """A result, and what it cost.

    It has seconds by the clock and by the processor, and memory [MB]: before, and its peak beyond
    that.
    """

    result: T
    seconds: float
    cpu: float
    before: float
    peak: float


def clocked(work: Callable[[], T]) -> Taken[T]:
    """Return the result of some work and what it cost."""
    before = resident()
    began = time.perf_counter()
    used = time.process_time()
    result = work()
    seconds = time.perf_counter() - began
    cpu = time.process_time() - used
    return Taken(
        result=result,
        seconds=seconds,
        cpu=cpu,
        before=before / MEGABYTE,
        peak=(peak() - before) / MEGABYTE,
    )


def in_own_process(work: Callable[..., T], *arguments: Any) -> T:
    """Return the result of some work in a fresh process, so that memory is its alone."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(work, arguments)


def alternate(
    programs: dict[str, Callable[[], object]], rounds: int = 5, patience: float = float("inf")
) -> dict[str, float]:
    """Median seconds of each program, run in turn `rounds` times after one round to warm up.

    `patience`: a program that has taken longer has no further round [s].
    """
    for program in programs.values():
        program()
    seconds: dict[str, list[float]] = {name: [] for name in programs}
    for _ in range(rounds):
        for name, program in programs.items():
            if sum(seconds[name]) <= patience:
                began = time.perf_counter()
                program()
                seconds[name].append(time.perf_counter() - began)
    return {name: statistics.median(taken) for name, taken in seconds.items()}


def compared(
    step: str, model: str, frames: int, seconds: dict[str, float], theirs_frames: int | None = None
) -> dict[str, object]:
    """Return ms per frame of "ours" and the other program, and how many times faster ours is."""
    other = next(name for name in seconds if name != "ours")
    ours_ms = 1e3 * seconds["ours"] / frames
    theirs_ms = 1e3 * seconds[other] / (theirs_frames or frames)
    return {
        "step": step,
        "model": model,
        "ours [ms/frame]": ours_ms,
        f"{other} [ms/frame]": theirs_ms,
        "times faster": theirs_ms / ours_ms,
    }


def _status(key: str) -> int:
    with open("/proc/self/status") as file:
        return next((int(line.split()[1]) * 1024 for line in file if line.startswith(key)), 0)


def resident() -> int:
    """Memory in use now, the peak forgotten [bytes]; Linux only."""
    with open("/proc/self/clear_refs", "w") as file:
        file.write("5")
    return _status("VmRSS")


def peak() -> int:
    """Most memory in use since `resident` [bytes]."""
    return _status("VmHWM")
