"""How much of a machine there is for us: cores and memory, also where a container or a batch system grants less."""

from __future__ import annotations

import os
from pathlib import Path

import psutil

GROUP = Path("/sys/fs/cgroup")
"""Where Linux tells what a group of processes may take; absent elsewhere."""


def usable_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def free_memory() -> int:
    """Memory that is free for this process and those it starts [bytes]."""
    free = int(psutil.virtual_memory().available)
    for limit, used in (
        ("memory.max", "memory.current"),
        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"),
    ):
        granted, taken = _number(GROUP / limit), _number(GROUP / used)
        if granted is not None:
            free = min(free, max(0, granted - (taken or 0)))
    return free


def _number(path: Path) -> int | None:
    try:
        text = path.read_text(encoding="ascii").strip()
    except (OSError, ValueError):
        return None
    return int(text) if text.isdigit() else None
