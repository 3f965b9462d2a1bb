"""What limits of results cost: a walk of 10 s with 92 muscles, its tensions alone and with 200
draws.

Each is a process of its own with kernels compiled before; memory is that of the process and those
that it starts.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress

import psutil

from data_collection import data_folder

HOME = "ceinms-emg-walk"
SPAN = ("5", "15")
LOOK = 0.05
"""How often memory is looked at [s]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the comparison."""
    parser.add_argument("--draws", type=int, default=200)


def run(draws: int) -> list[dict[str, object]]:
    """Rows: what is computed, its time, processor time and memory, and times over those without
    draws.
    """
    count = ("--draws", str(draws))
    ways = {
        "without draws": (),
        "sampled, one process": (*count, "--workers", "1"),
        "sampled": count,
    }
    _measured(("--draws", "3"))
    rows: list[dict[str, object]] = []
    for name, words in ways.items():
        wall, processor, memory = _measured(words)
        row: dict[str, object] = {
            "way": name,
            "time [s]": wall,
            "processor time [s]": processor,
            "memory [MB]": memory,
        }
        first = rows[0] if rows else row
        row["time over that without draws"] = wall / float(str(first["time [s]"]))
        row["memory above [MB]"] = memory - float(str(first["memory [MB]"]))
        rows.append(row)
    return rows


def _measured(words: tuple[str, ...]) -> tuple[float, float, float]:
    """Time [s], processor time of all processes [s] and largest memory [MB] of a command."""
    home = data_folder() / HOME
    files = ("--model", home / "model/gait2392.osim", "--motion", home / "walk36/ik.sto")
    with tempfile.TemporaryDirectory() as work:
        files += (
            "--loads",
            home / "walk36/XLD.mot",
            "--time",
            *SPAN,
            "--cutoff",
            "6",
            "--reactions",
            "child",
        )
        command = [
            sys.executable,
            "-m",
            "myomorph",
            "tension",
            *map(str, files),
            *words,
            "--out",
            f"{work}/out",
        ]
        begun = time.perf_counter()
        child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        watch = _Watch(child.pid)
        watch.start()
        status = child.wait()
        wall = time.perf_counter() - begun
        watch.join()
    if status:
        raise RuntimeError(f"{' '.join(command)} ended with {status}")
    return wall, sum(watch.times.values()), watch.most / 1e6


class _Watch(threading.Thread):
    """Looks at a process and those that it starts until it ends."""

    def __init__(self, number: int):
        super().__init__(daemon=True)
        self._process = psutil.Process(number)
        self.times: dict[int, float] = {}
        self.most = 0.0

    def run(self) -> None:
        with suppress(psutil.Error):
            while self._process.is_running() and self._process.status() != psutil.STATUS_ZOMBIE:
                taken = 0.0
                for one in (self._process, *self._process.children(recursive=True)):
                    with suppress(psutil.Error):
                        taken += one.memory_info().rss
                        spent = one.cpu_times()
                        self.times[one.pid] = spent.user + spent.system
                self.most = max(self.most, taken)
                time.sleep(LOOK)
