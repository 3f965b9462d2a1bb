"""Studies that are interrupted: killed, out of disk, out of workers, or cut off.

Counted are the results that are left, and whether they are equal.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import psutil

import myomorph as mm
from benchmarks.recordings import RECORDINGS, Recording, read_markers
from data_collection import data_folder
from truths.cluster import cluster_in, cut_off, machines, namespaces_work
from truths.interrupted_checks import (
    computed_twice,
    differences,
    ended,
    finished,
    half_written,
    left_over,
    losses,
    runs,
)

Row = dict[str, object]

TRIALS = 200
FEW = 40
KILLS = 20
LOSSES = 10
SETTINGS = {"SOURCE_DATE_EPOCH": "1700000000", "OPENBLAS_NUM_THREADS": "1"}
"""A fixed date makes results that can be compared byte for byte."""
WRONG: list[str] = []
"""What was not as it should be, in words, for whoever runs this."""


def measure() -> Iterable[Row]:
    """Yield a row for each kind of interruption."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        many = make_study(folder / "many", TRIALS)
        few = make_study(folder / "few", FEW)
        whole, took = _undisturbed(many, folder / "whole")
        part, _ = _undisturbed(few, folder / "part")
        yield from killed(many, whole, folder / "killed", took)
        yield workers_killed(many, whole, folder / "workers")
        yield started_twice(few, part, folder / "twice")
        yield disk_full(few, part, folder / "full")
        yield read_only(few, part, folder / "read only")
        yield machine_cut_off(few, part, folder / "cluster")


def _undisturbed(study: Path, out: Path) -> tuple[Path, float]:
    started = time.monotonic()
    code, said = end_of(begin(study, out))
    assert code == 0, said
    return out, time.monotonic() - started


class Run(subprocess.Popen[str]):
    """The program on a study, and what it prints: a pipe that nobody reads would stop it.

    Attributes
    ----------
    lines : that it has printed
    reader : the thread that reads them
    """

    def __init__(self, study: Path, out: Path, options: Sequence[str]) -> None:
        super().__init__(
            (sys.executable, "-m", "myomorph", "run", str(study), "--out", str(out), *options),
            env=os.environ | SETTINGS,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
        )
        self.lines: list[str] = []
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self) -> None:
        assert self.stdout is not None
        self.lines.extend(self.stdout)


def begin(study: Path, out: Path, *options: str) -> Run:
    """Start the program on a study, in a group of processes of its own."""
    return Run(study, out, options or ("--workers", "2"))


def end_of(process: Run) -> tuple[int, str]:
    """Return the exit status of a run and what it printed, once it has ended."""
    status = process.wait()
    process.reader.join()
    return status, "".join(process.lines)


def others_of(process: subprocess.Popen) -> list[psutil.Process]:
    """List the processes that a run has started."""
    with suppress(psutil.Error):
        return psutil.Process(process.pid).children(recursive=True)
    return []


def _row(what: str, times: object, reference: Path, out: Path, half: int, said: str = "") -> Row:
    """Compare the final results of a study with those of an undisturbed one."""
    files, unequal = differences(out, reference)
    twice = computed_twice(out)
    WRONG.extend(f"{what}: {one}" for one in (*unequal, *twice, *left_over(out)))
    return {
        "what happened": what,
        "trials": len(list(reference.glob("*/*/*.nc"))),
        "times": times,
        "runs": runs(out),
        "files compared": files,
        "not equal": len(unequal),
        "half-written": half,
        "computed twice": len(twice),
        "left over": len(left_over(out)),
        "message": said,
    }


def killed(
    study: Path, reference: Path, out: Path, took: float, times: int = KILLS
) -> Iterator[Row]:
    """Send SIGKILL at random moments.

    It goes to the program alone, whose workers must end themselves, or to all its processes.
    """
    random = np.random.default_rng(20)
    kills = 0
    half = 0
    longest = 0.0
    attempt = 0
    while True:
        home = out / str(attempt)
        begun = runs(home)
        process = begin(study, home)
        if kills % 4:  # else while the program starts, reads the study or looks at what is there
            _until(lambda home=home, begun=begun: runs(home) > begun, process)
        with suppress(subprocess.TimeoutExpired):
            process.wait(
                random.uniform(0.0, 2.0 * took / times if kills % 4 else 4.0)
                if kills < times
                else None
            )
        if process.poll() is None:
            longest = max(longest, _kill(process, workers_too=bool(kills % 2)))
            kills += 1
            half += _count_damage(home, reference)
            end_of(process)
            continue
        code, said = end_of(process)
        if code:
            WRONG.append(f"killed: the last run ended with {code}: {said[-500:]}")
        note = f"workers of a killed program ended within {longest:.1f} s"
        yield _row("program killed", kills, reference, home, half, note)
        if kills >= times:
            return
        attempt = attempt + 1
        times = times - kills
        kills = 0


def _kill(process: Run, workers_too: bool) -> float:
    """Kill a program, with or without its workers; return when they have ended [s]."""
    others = others_of(process)
    process.kill()
    for one in others if workers_too else ():
        with suppress(psutil.Error):
            one.kill()
    killed_at = time.monotonic()
    _, alive = psutil.wait_procs(others, timeout=30)
    WRONG.extend(f"killed: process {one.pid} lives on" for one in alive)
    return time.monotonic() - killed_at


def _count_damage(home: Path, reference: Path) -> int:
    """Count files that are half-written or not equal after a program was killed."""
    if not home.is_dir():
        return 0
    found = half_written(home) + differences(home, reference, whole=False)[1]
    WRONG.extend(f"killed: {one}" for one in found)
    return len(found)


def workers_killed(study: Path, reference: Path, out: Path, times: int = LOSSES) -> Row:
    """Kill single workers of one run at random moments; the next run does what it gives up."""
    random = np.random.default_rng(21)
    process = begin(study, out)
    kills = 0
    while process.poll() is None and kills < times:
        # The trial that was hit is done first, so after some others it is there.
        done = ended(out)
        _until(lambda done=done: ended(out) >= done + 3, process)
        with suppress(subprocess.TimeoutExpired):
            process.wait(random.uniform(0.0, 2.0))
        workers = [one for one in others_of(process) if _works(one)]
        if workers:
            with suppress(psutil.Error):
                workers[random.integers(len(workers))].kill()
                kills += 1
    code, said = end_of(process)
    note = f"{losses(out)} jobs lost their worker, {said.count('was lost twice')} of them twice"
    if code:
        code, said = end_of(begin(study, out))
        WRONG.extend([] if code == 0 else [f"worker killed: ended with {code}: {said[-500:]}"])
    return _row("a worker killed", kills, reference, out, len(half_written(out)), note)


def _works(process: psutil.Process) -> bool:
    with suppress(psutil.Error):
        return "resource_tracker" not in " ".join(process.cmdline())
    return False


def started_twice(study: Path, reference: Path, out: Path) -> Row:
    """Two runs into one folder at the same moment, and a third while one of them goes on."""
    both = [begin(study, out), begin(study, out)]
    while all(one.poll() is None for one in both):
        time.sleep(0.1)
    third = end_of(begin(study, out))
    ends = sorted([*(end_of(one) for one in both), third])
    if [code for code, _ in ends] != [0, 2, 2]:
        WRONG.append(f"started twice: {ends}")
    refused = next(said for code, said in ends if code == 2)
    return _row(
        "three runs at once", 1, reference, out, len(half_written(out)), _one_line(refused, out)
    )


def disk_full(study: Path, reference: Path, out: Path) -> Row:
    """Fill a disk that holds a third of the results, then make room."""
    size = sum(path.stat().st_size for path in finished(reference))
    out.mkdir()
    reason = mounted(out, f"size={size // 3}")
    if reason:
        return {"what happened": "disk full", "message": f"not measured: {reason}"}
    try:
        code, said = end_of(begin(study, out))
        half = half_written(out) + differences(out, reference, whole=False)[1]
        WRONG.extend(f"disk full: {one}" for one in half)
        if code != 2:
            WRONG.append(f"disk full: ended with {code}: {said[-500:]}")
        line = next(
            (line for line in said.splitlines() if "not run" in line and "FAILED" not in line),
            said[-200:],
        )
        subprocess.run(("mount", "-o", f"remount,size={4 * size}", str(out)), check=True)
        code, said = end_of(begin(study, out))
        WRONG.extend(
            [] if code == 0 else [f"disk full, then room: ended with {code}: {said[-500:]}"]
        )
        return _row("disk full, then room", 1, reference, out, len(half), line)
    finally:
        subprocess.run(("umount", str(out)), capture_output=True)


def read_only(study: Path, reference: Path, out: Path) -> Row:
    """Write to a folder that cannot be written."""
    out.mkdir()
    reason = mounted(out, "ro")
    if reason:
        return {"what happened": "folder read-only", "message": f"not measured: {reason}"}
    try:
        code, said = end_of(begin(study, out))
        if code != 2 or list(out.iterdir()):
            WRONG.append(f"read-only: ended with {code}: {said[-500:]}")
    finally:
        subprocess.run(("umount", str(out)), capture_output=True)
    return {"what happened": "folder read-only", "times": 1, "message": _one_line(said, out)}


def mounted(folder: Path, options: str) -> str:
    """Mount an empty file system on a folder; returns why that cannot be done, "" where it was."""
    try:
        ended = subprocess.run(
            ("mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)),
            capture_output=True,
            text=True,
        )
    except OSError as error:
        return f"mount: {error.strerror}"
    return " ".join(ended.stderr.split()) if ended.returncode else ""


def machine_cut_off(study: Path, reference: Path, out: Path) -> Row:
    """Cut off one of two workers in the middle of a run.

    The scheduler and the workers run each on a machine of its own.
    """
    what = "one of two machines cut off"
    reason = namespaces_work()
    if reason:
        return {"what happened": what, "message": f"not measured: {reason}"}
    names = ("myo-scheduler", "myo-one", "myo-two")
    with machines(names) as hosts, cluster_in(out.with_name("machines"), SETTINGS) as cluster:
        cluster.scheduler(hosts[names[0]], names[0])
        for name in names[1:]:
            cluster.worker(name, hosts[name], name)
        cluster.await_workers(2)
        process = begin(study, out, "--scheduler", cluster.address)
        reached = _until(lambda: ended(out) >= len(list(reference.glob("*/*/*.nc"))) // 3, process)
        cut_off(names[2])
        cut_at = time.monotonic()
        _until(lambda: losses(out) > 0, process)
        noticed = time.monotonic() - cut_at
        code, said = end_of(process)
        if code or not reached:
            WRONG.append(f"{what}: ended with {code}: {said[-500:]}")
        note = f"{losses(out)} jobs done again, {noticed:.0f} s after the cut"
        return _row(what, 1, reference, out, len(half_written(out)), note)


def _until(there: Callable[[], bool], process: subprocess.Popen) -> bool:
    """Wait for something while a run goes on; returns whether it came."""
    while process.poll() is None:
        if there():
            return True
        time.sleep(0.2)
    return False


def _one_line(said: str, out: Path) -> str:
    """Return the last line, without what is different each time."""
    text = said.strip().splitlines()[-1].replace(str(out), "DIR")
    text = re.sub(r"process \d+ on \S+,", "process ... on ...,", text)
    return re.sub(r"since [\dT:+.-]+\d", "since ...", text)


if __name__ == "__main__":
    for found in measure():
        sys.stdout.write(f"{found}\n")
        sys.stdout.flush()
    sys.stderr.writelines(f"{one}\n" for one in WRONG)


FRAMES = 24
OFFSET = 2e-3
NOISE = 5e-4
"""Standard deviation of what is added to each marker for a whole trial, and to each frame [m]."""


@dataclass(frozen=True)
class Source:
    """A recording of the collection that trials are made of.

    `start`, `end`: between which its forces are known [s]; `share`: of the trials of a study;
    `report`: whether its trials get a page each, which takes as long as all other steps.
    """

    name: str
    files: Recording
    table: str
    start: float
    end: float
    share: float
    report: bool = False


SOURCES = (
    Source(
        name="gait",
        files=RECORDINGS["gait2354"],
        table="subject01_walk1_grf.mot",
        start=0.5,
        end=1.9,
        share=0.5,
    ),
    Source(
        name="rajagopal",
        files=RECORDINGS["rajagopal"],
        table="grf_walk.mot",
        start=0.6,
        end=1.8,
        share=0.3,
    ),
    Source(
        name="opencap",
        files=RECORDINGS["opencap-walk"],
        table="walking1_grf.mot",
        start=0.2,
        end=1.1,
        share=0.2,
        report=True,
    ),
)


def make_study(folder: Path, trials: int) -> Path:
    """Write models, forces, perturbed recordings and the study file; returns this.

    Which frames a trial has and what is added to its markers follows from its number alone.
    """
    folder.mkdir(parents=True, exist_ok=True)
    parts = ['[study]\nname = "recordings repeated and perturbed, not measured"\n']
    for number, source in enumerate(SOURCES):
        loads = data_folder() / source.files.loads
        for path in (data_folder() / source.files.model, loads, loads.with_name(source.table)):
            shutil.copyfile(path, folder / path.name)
        markers = read_markers(data_folder() / source.files.markers)
        rows = []
        for trial in range(max(1, round(trials * source.share))):
            name = f"made_{source.name}_{trial + 1:03d}"
            _write_trial(
                markers, source, np.random.default_rng((number, trial)), folder / f"{name}.trc"
            )
            rows.append(f'    {{markers = "{name}.trc", loads = "{loads.name}"}},')
        steps = '"ik", "id", "muscles", "tension"' + (', "report"' if source.report else "")
        table = [
            f'[[subject]]\nname = "{source.name}"\nmodel = "{Path(source.files.model).name}"',
            f"steps = [{steps}]",
        ]
        parts.append("\n".join((*table, "trials = [", *rows, "]\n")))
    path = folder / "study.toml"
    path.write_text("\n".join(parts), encoding="utf-8")
    return path


def _write_trial(
    markers: mm.Markers, source: Source, random: np.random.Generator, path: Path
) -> None:
    inside = np.flatnonzero((markers.time >= source.start) & (markers.time <= source.end))
    first = inside[0] + random.integers(len(inside) - FRAMES)
    rows = slice(first, first + FRAMES)
    moved = markers.values[rows] + random.normal(0.0, OFFSET, markers.values.shape[1:])
    values = moved + random.normal(0.0, NOISE, moved.shape)
    mm.write_trc(replace(markers, time=markers.time[rows], values=values), path)
