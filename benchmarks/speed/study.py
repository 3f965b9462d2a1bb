"""A study of 1,000 short trials.

Measured are workers side by side, memory over the run, and what a trial costs besides its steps.

A recorded walk is cut into short recordings, each a little different; by one worker, by two, once
more where nothing has changed, and by two workers of a Dask cluster on the same machine.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import psutil

import myomorph as mm
from data_collection import data_folder
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.study.run.dask_workers import DaskWorkers
from myomorph.lab.study.workers.local_workers import LocalWorkers
from truths.cluster import cluster_in

TRIALS = 1000
FRAMES = 30
NOISE = 5e-4
"""Of the markers of each trial [m]."""
LOOK = 0.5
"""How often memory is looked at [s]."""
MB = 2.0**20

STUDY = """[study]
name = "short trials"
[[subject]]
name = "s01"
model = '{model}'
trials = ["trials/*.trc"]
steps = ["ik", "id"]
"""

Row = dict[str, object]


def run(trials: int = TRIALS) -> list[Row]:
    """One row a run, and one that compares them."""
    with tempfile.TemporaryDirectory() as made:
        home = Path(made)
        study = write_study(home, trials)
        measured(study, home / "warm", LocalWorkers(1), few=True)
        one = measured(study, home / f"by {1}", LocalWorkers(1))
        two = measured(study, home / f"by {2}", LocalWorkers(2))
        again = measured(study, home / "by 2", LocalWorkers(2)) | {
            "run": "2 workers, nothing has changed"
        }
        with cluster_in(home / "cluster") as cluster:
            cluster.scheduler()
            for name in ("one", "two"):
                cluster.worker(name)
            cluster.await_workers(2)
            with closing(DaskWorkers(cluster.address)) as hands:
                dask = measured(study, home / "by Dask", hands) | {"run": "2 workers of Dask"}
        ratio = float(str(two["trials/s"])) / float(str(one["trials/s"]))
        return [
            one,
            two,
            again,
            dask,
            {"throughput of 2 workers over 1": ratio, "cores": os.cpu_count()},
        ]


def write_study(home: Path, trials: int, few: int = 4) -> Path:
    """Write a study of short recordings, and next to it one of only a few of them.

    The file of the first is returned.
    """
    data = data_folder() / "opensim-gait-subject01"
    recorded = mm.read_recording(data / "experiment/subject01_walk1.trc").markers
    assert recorded is not None
    random = np.random.default_rng(1)
    for folder, count in (("trials", trials), ("few", few)):
        (home / folder).mkdir()
        for index in range(count):
            start = index % (len(recorded.time) - FRAMES)
            part = slice(start, start + FRAMES)
            values = recorded.values[part] + random.normal(0.0, NOISE, recorded.values[part].shape)
            short = replace(recorded, time=recorded.time[part], values=values)
            mm.write_trc(short, home / folder / f"walk{index:04d}.trc")
    text = STUDY.format(model=data / "ref_ik/subject01_simbody.osim")
    (home / "few.toml").write_text(text.replace("trials/*", "few/*"), encoding="utf-8")
    (home / "study.toml").write_text(text, encoding="utf-8")
    return home / "study.toml"


@dataclass
class Memory:
    """Resident memory of this process and of its largest worker, at several times [bytes]."""

    times: list[float] = field(default_factory=list)
    own: list[int] = field(default_factory=list)
    workers: list[int] = field(default_factory=list)

    def rows(self, last: float) -> Row:
        """Return memory when a fifth and when all of the trials had ended [MB].

        That is before the tables of the study are made.
        """
        count = sum(1 for time in self.times if time <= last)
        told: Row = {}
        for name, taken in (("this process", self.own[:count]), ("a worker", self.workers[:count])):
            if taken:
                told[f"{name}, early [MB]"] = taken[count // 5] / MB
                told[f"{name}, end [MB]"] = taken[-1] / MB
                told[f"{name}, maximum [MB]"] = max(taken) / MB
        return told


@contextmanager
def watched(hands: LocalWorkers | DaskWorkers) -> Iterator[Memory]:
    """Look at memory while a study runs; of a cluster only at that of this process."""
    memory = Memory()
    over = threading.Event()

    def look() -> None:
        while not over.wait(LOOK):
            try:
                numbers = hands.processes if isinstance(hands, LocalWorkers) else []
                taken = [psutil.Process(number).memory_info().rss for number in numbers]
            except psutil.Error:
                continue
            if len(taken) == hands.count or isinstance(hands, DaskWorkers):
                memory.times.append(time.perf_counter())
                memory.own.append(psutil.Process().memory_info().rss)
                memory.workers += [max(taken)] if taken else []

    thread = threading.Thread(target=look)
    thread.start()
    try:
        yield memory
    finally:
        over.set()
        thread.join()


def measured(study: Path, out: Path, hands: LocalWorkers | DaskWorkers, few: bool = False) -> Row:
    """Run by so many workers; the time that processes take to begin is reported separately."""
    plan = mm.read_plan(study.with_name("few.toml") if few else study)
    count = hands.count
    ends: list[float] = []

    def said(outcome: Outcome) -> None:
        ends.append(time.perf_counter())

    own = time.process_time()
    began = time.perf_counter()
    with watched(hands) as memory:
        outcomes = mm.run_study(plan, out, workers=hands, report=said)
    failures = [one.error for one in outcomes if one.error]
    if failures:
        raise RuntimeError(f"{len(failures)} trials failed, the first with: {failures[0]}")
    parent = time.process_time() - own
    # The first trials wait for the processes to begin and to load their kernels.
    skipped = 2 * count
    took = ends[-1] - ends[skipped - 1]
    left = len(ends) - skipped
    steps = sum(seconds for one in outcomes for _, seconds in one.timed) / len(outcomes)
    return {
        "run": "1 worker" if count == 1 else f"{count} workers",
        "trials": len(outcomes),
        "trials/s": left / took,
        "first trial after [s]": ends[0] - began,
        "a trial [ms]": 1e3 * count * took / left,
        "of that its steps [ms]": 1e3 * steps,
        "beside its steps [ms]": 1e3 * (count * took / left - steps),
        "this process [ms a trial]": 1e3 * parent / len(outcomes),
        **memory.rows(ends[-1]),
    }
