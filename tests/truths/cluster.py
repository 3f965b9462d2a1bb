"""A Dask cluster of a few processes, on this machine or in network namespaces.

The namespaces stand for machines.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil

START = 60.0
"""How long a scheduler may take to write its address [s]."""


@dataclass
class Cluster:
    """A scheduler and its workers, each with the nanny that starts it again.

    Attributes
    ----------
    folder : for their files and what they say
    address : of the scheduler
    settings : environment variables of all processes
    """

    folder: Path
    address: str = ""
    settings: Mapping[str, str] = field(default_factory=dict)
    processes: dict[str, subprocess.Popen] = field(default_factory=dict)

    def scheduler(self, host: str = "127.0.0.1", namespace: str = "") -> str:
        """Start the scheduler; returns its address."""
        told = self.folder / "scheduler.json"
        options = ("--host", host, "--port", "0", "--no-dashboard", "--scheduler-file", str(told))
        self._run("scheduler", ("-m", "distributed.cli.dask_scheduler", *options), namespace)
        until = time.monotonic() + START
        while not told.is_file() and time.monotonic() < until:
            time.sleep(0.05)
        for _ in range(100):
            with suppress(ValueError):
                self.address = json.loads(told.read_text(encoding="utf-8"))["address"]
                break
            time.sleep(0.05)
        return self.address

    def worker(
        self, name: str, host: str = "127.0.0.1", namespace: str = "", memory: str = "4GB"
    ) -> None:
        """Start a process that does jobs."""
        place = ("--host", host, "--name", name, "--local-directory", str(self.folder / name))
        size = ("--nthreads", "1", "--nworkers", "1", "--memory-limit", memory, "--no-dashboard")
        self._run(
            name, ("-m", "distributed.cli.dask_worker", self.address, *place, *size), namespace
        )

    def await_workers(self, count: int) -> None:
        """Wait until so many workers have come."""
        from distributed import Client

        with Client(self.address, timeout=2 * START, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=2 * START)

    def end(self) -> None:
        """End all processes and what they have started."""
        for process in reversed(self.processes.values()):
            with suppress(psutil.Error):
                own = psutil.Process(process.pid)
                for one in [*own.children(recursive=True), own]:
                    with suppress(psutil.Error):
                        one.kill()
            process.wait()

    def _run(self, name: str, arguments: tuple[str, ...], namespace: str) -> None:
        before = ("ip", "netns", "exec", namespace) if namespace else ()
        with (self.folder / f"{name}.log").open("w", encoding="utf-8") as log:
            self.processes[name] = subprocess.Popen(
                (*before, sys.executable, *arguments),
                env=os.environ | dict(self.settings),
                cwd=self.folder,
                stdout=log,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
            )


@contextmanager
def cluster_in(folder: Path, settings: Mapping[str, str] | None = None) -> Iterator[Cluster]:
    """Yield a cluster without processes yet; all are ended on leaving."""
    folder.mkdir(parents=True, exist_ok=True)
    made = Cluster(folder, settings=settings or {})
    try:
        yield made
    finally:
        made.end()


def namespaces_work() -> str:
    """Why there can be no network namespaces here, "" where there can."""
    if shutil.which("ip") is None:
        return "there is no program 'ip'"
    tried = subprocess.run(("ip", "netns", "add", "myomorph-try"), capture_output=True, text=True)
    if tried.returncode:
        return " ".join(tried.stderr.split())
    subprocess.run(("ip", "netns", "del", "myomorph-try"), check=True)
    return ""


@contextmanager
def machines(names: tuple[str, ...]) -> Iterator[dict[str, str]]:
    """Yield the addresses of network namespaces on one switch, by name.

    This process is on the switch, too, at 10.77.0.1. `cut_off` takes one of them off it.
    """
    run = _commands
    bridge = "myobr0"
    _remove(names, bridge)  # what a run that was killed has left
    try:
        run(
            f"ip link add {bridge} type bridge",
            f"ip addr add 10.77.0.1/24 dev {bridge}",
            f"ip link set {bridge} up",
        )
        for i, name in enumerate(names):
            run(
                f"ip netns add {name}",
                f"ip link add myo{i} type veth peer name eth0 netns {name}",
                f"ip link set myo{i} master {bridge} up",
                f"ip -n {name} addr add 10.77.0.{i + 2}/24 dev eth0",
                f"ip -n {name} link set eth0 up",
                f"ip -n {name} link set lo up",
            )
        yield {name: f"10.77.0.{i + 2}" for i, name in enumerate(names)}
    finally:
        _remove(names, bridge)


def _remove(names: tuple[str, ...], bridge: str) -> None:
    links = [bridge, *(f"myo{i}" for i in range(len(names)))]
    for text in (
        *(f"ip link del {link}" for link in links),
        *(f"ip netns del {name}" for name in names),
    ):
        subprocess.run(text.split(), capture_output=True)


def cut_off(name: str) -> None:
    """Take a machine off the switch, as if its cable were pulled: nobody is told."""
    _commands(f"ip -n {name} link set eth0 down")


def _commands(*texts: str) -> None:
    for text in texts:
        subprocess.run(text.split(), check=True, capture_output=True, text=True)
