"""What limits of results cost: tensions of two walks alone and with 200 draws.

One is of 10 s on a treadmill with 92 muscles, one of 2.4 s over plates with 80 and both sides of
the knees.

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
from collections.abc import Mapping
from contextlib import suppress

import psutil

from data_collection import data_folder

TREADMILL = "ceinms-emg-walk"
PLATES = "rajagopal-walk-emg"
WALKS: Mapping[str, tuple[str, ...]] = {
    "10 s": (
        *("--model", f"{TREADMILL}/model/gait2392.osim"),
        *("--motion", f"{TREADMILL}/walk36/ik.sto"),
        *("--loads", f"{TREADMILL}/walk36/XLD.mot"),
        *("--time", "5", "15", "--cutoff", "6", "--reactions", "child"),
    ),
    "2.4 s": (
        *("--model", f"{PLATES}/subject_walk_scaled.osim"),
        *("--motion", f"{PLATES}/coordinates.sto"),
        *("--loads", f"{PLATES}/grf_walk.xml"),
        *("--reactions", "child", "--contact-points", "auto"),
    ),
}
"""What `tension` is called with, by the length of the walk; files in the folder of data."""
LOOK = 0.05
"""How often memory is looked at [s]."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the comparison."""
    parser.add_argument("--draws", type=int, default=200)


def run(draws: int) -> list[dict[str, object]]:
    """Measure a walk with and without draws.

    Rows have what is computed, its time, processor time and memory, and times over those without
    draws.
    """
    count = ("--draws", str(draws))
    ways = {
        "without draws": (),
        "sampled, one process": (*count, "--workers", "1"),
        "sampled": count,
    }
    rows: list[dict[str, object]] = []
    for walk in WALKS:
        rows += _rows(walk, ways)
    return rows


def _rows(walk: str, ways: Mapping[str, tuple[str, ...]]) -> list[dict[str, object]]:
    """Rows of one walk."""
    _measured(walk, ("--draws", "3"))
    rows: list[dict[str, object]] = []
    for name, words in ways.items():
        wall, processor, memory = _measured(walk, words)
        row: dict[str, object] = {
            "walk": walk,
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


def _measured(walk: str, words: tuple[str, ...]) -> tuple[float, float, float]:
    """Time [s], processor time of all processes [s] and largest memory [MB] of a command."""
    files = [str(data_folder() / word) if "/" in word else word for word in WALKS[walk]]
    with tempfile.TemporaryDirectory() as work:
        command = [
            sys.executable,
            "-m",
            "myomorph",
            "tension",
            *files,
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
