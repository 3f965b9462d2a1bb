"""Fair times: the programs take turns in one process, and the median of each counts."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable


def alternate(programs: dict[str, Callable[[], object]], rounds: int = 5) -> dict[str, float]:
    """Median seconds of each program, run in turn `rounds` times after one round to warm up."""
    for program in programs.values():
        program()
    seconds: dict[str, list[float]] = {name: [] for name in programs}
    for _ in range(rounds):
        for name, program in programs.items():
            began = time.perf_counter()
            program()
            seconds[name].append(time.perf_counter() - began)
    return {name: statistics.median(taken) for name, taken in seconds.items()}


def compared(
    step: str, model: str, frames: int, seconds: dict[str, float], theirs_frames: int | None = None
) -> dict[str, object]:
    """A row of ms a frame of "ours" and the other program, and how many times faster ours is."""
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
