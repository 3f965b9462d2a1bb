"""Jobs on a Dask cluster: done once each, with their models.

A lost process is reported.
"""

from __future__ import annotations

import os
import pickle
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.core.model.errors import BadData, BadFile, MyomorphError
from myomorph.core.model.model import Model
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.study.run import dask_workers
from myomorph.lab.study.run.dask_cluster import connected, do_job, fitness, scheduler_address, unfit
from myomorph.lab.study.run.dask_workers import DaskWorkers
from myomorph.lab.study.workers.jobs import Ended, Job
from truths.cluster import Cluster, cluster_in
from truths.interrupted_checks import differences, left_over

ROOT = Path(__file__).parents[3]
HERE = {
    "PYTHONPATH": os.pathsep.join(
        map(str, (Path(__file__).parent, ROOT / "tests", ROOT / "src", ROOT))
    )
}


def named(name: str) -> Model:
    """Make an empty model."""
    return Model(name=name, bodies=(), joints=(), coordinates=(), gravity=np.zeros(3))


def tell(folder: Path, name: str, model: Model | None) -> Outcome:
    """Say which process has done the job, and with which model."""
    called = "" if model is None else model.name
    return Outcome("s", name, folder, error=f"{os.getpid()} {called} {id(model)}")


def take_long(folder: Path, name: str, model: Model | None) -> Outcome:
    """Say that the job has begun, and go on until somebody lets it end."""
    (folder / f"{name}.{os.getpid()}").touch()
    until = time.monotonic() + 60
    while not (folder / "end").exists() and time.monotonic() < until:
        time.sleep(0.05)
    (folder / f"{name}.ended").touch()
    return Outcome("s", name, folder)


def raise_error(model: Model | None) -> Outcome:
    """Do what a job should not."""
    raise MemoryError("no room")


def all_ended(workers: DaskWorkers, count: int, limit: float = 60.0) -> list[Ended]:
    """Wait for so many jobs."""
    found: list[Ended] = []
    until = time.monotonic() + limit
    while len(found) < count and time.monotonic() < until:
        found += workers.ended(1.0)
    return found


def begun(folder: Path, name: str) -> int:
    """Wait until a job has begun; returns the process that does it."""
    until = time.monotonic() + 30
    while time.monotonic() < until:
        for path in folder.glob(f"{name}.[0-9]*"):
            return int(path.suffix[1:])
        time.sleep(0.05)
    raise AssertionError(f"'{name}' has not begun")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    with cluster_in(tmp_path_factory.mktemp("cluster"), HERE) as made:
        made.scheduler()
        made.worker("one")
        made.worker("two", host="127.0.0.2" if sys.platform == "linux" else "127.0.0.1")
        made.await_workers(2)
        yield made


@pytest.fixture
def workers(cluster: Cluster, tmp_path: Path) -> Iterator[DaskWorkers]:
    made = DaskWorkers(cluster.address, tmp_path, patience=30.0)
    until = time.monotonic() + 30
    while made.count < 2 and time.monotonic() < until:
        made.ended(0.5)
    yield made
    made.close()


def test_jobs_are_done_once_each_by_all_processes_with_one_model_for_all_jobs_of_a_process(
    workers: DaskWorkers, tmp_path: Path
) -> None:
    models = [named("a"), named("b")]
    assert (workers.count, workers.memory) == (2, 4_000_000_000)
    jobs = [Job(("s", f"t{i}"), partial(tell, tmp_path, f"t{i}")) for i in range(12)]
    for i, job in enumerate(jobs):
        workers.start(job, models[i % 2] if i < 10 else None)
    found = all_ended(workers, 12)
    assert sorted(one.job.key for one in found) == sorted(job.key for job in jobs)
    told = {
        one.outcome.trial: one.outcome.error.split(" ") for one in found if one.outcome is not None
    }
    assert len({process for process, _, _ in told.values()}) == 2
    for i in range(12):
        assert told[f"t{i}"][1] == (models[i % 2].name if i < 10 else "")
    # The same object for every job of one process: it is compiled once.
    assert len({(process, name, which) for process, name, which in told.values() if name}) <= 4
    assert workers.ended(0.1) == []


STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
trials = ["reach.trc", "again.trc", "third.trc"]
steps = ["ik", "id", "muscles", "tension"]
"""


def test_a_study_on_a_cluster_writes_the_bytes_of_one_process(
    cluster: Cluster,
    arm: SimpleNamespace,
    command: Callable[..., SimpleNamespace],
    in_process: None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    for name in ("again.trc", "third.trc"):
        (arm.folder / name).write_bytes(arm.markers.read_bytes())
    study = arm.folder / "study.toml"
    study.write_text(STUDY, encoding="utf-8")
    monkeypatch.chdir(arm.folder)
    assert command("run", study, "--out", arm.folder / "here", "--workers", 1).status == 0
    # What is relative here means nothing in the folder of a worker.
    run = command("run", "study.toml", "--out", "there", "--scheduler", cluster.address)
    assert run.status == 0, run.out + run.err
    assert "3 of 3 trials done" in run.out
    compared, unequal = differences(arm.folder / "there", arm.folder / "here")
    assert compared > 20
    assert unequal == []
    assert left_over(arm.folder / "there") == []


def date_of(model: Model | None) -> Outcome:
    return Outcome("s", os.environ.get("SOURCE_DATE_EPOCH", "the clock"), Path())


@pytest.mark.parametrize(("date", "told"), [("", "the clock"), ("5", "5")])
def test_results_are_dated_as_the_sender_does(
    date: str, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An empty variable is none: libraries take it for a number that cannot be read."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "7")
    assert do_job(pickle.dumps(date_of), date=date).trial == told
    assert os.environ["SOURCE_DATE_EPOCH"] == "7"


def test_workers_of_the_command_are_those_of_the_cluster(
    arm: SimpleNamespace, command: Callable[..., SimpleNamespace]
) -> None:
    run = command(
        "run", arm.folder / "study.toml", "--out", arm.out, "--scheduler", "a:1", "--workers", 2
    )
    assert (run.status, arm.out.exists()) == (2, False)
    assert "set them at 'dask worker'" in run.err


def test_a_process_that_was_killed_is_told_of_and_another_takes_its_place(
    workers: DaskWorkers, tmp_path: Path
) -> None:
    import psutil

    job = Job(("s", "long"), partial(take_long, tmp_path, "long"))
    workers.start(job, named("a"))
    psutil.Process(begun(tmp_path, "long")).kill()
    (ended,) = all_ended(workers, 1)
    assert ended.outcome is None
    assert "was lost" in ended.lost
    assert ended.job is job
    (tmp_path / "end").touch()
    workers.start(job, named("a"))
    (again,) = all_ended(workers, 1)
    assert again.outcome is not None
    assert not again.outcome.error
    until = time.monotonic() + 30
    while workers.count < 2 and time.monotonic() < until:
        workers.ended(0.5)
    assert workers.count == 2


def test_what_a_job_lets_through_does_not_end_the_study(
    workers: DaskWorkers, tmp_path: Path
) -> None:
    workers.start(Job(("s", "bad"), raise_error), None)
    (ended,) = all_ended(workers, 1)
    assert ended.outcome is None
    assert ended.lost == "MemoryError: no room"
    workers.start(Job(("s", "good"), partial(tell, tmp_path, "good")), None)
    assert all_ended(workers, 1)[0].outcome is not None


def test_a_job_that_is_given_up_does_not_go_on(cluster: Cluster, tmp_path: Path) -> None:
    import psutil

    workers = DaskWorkers(cluster.address, tmp_path, patience=30.0)
    workers.start(Job(("s", "left"), partial(take_long, tmp_path, "left")), None)
    process = psutil.Process(begun(tmp_path, "left"))
    workers.close()
    process.wait(20)
    (tmp_path / "end").touch()
    assert not (tmp_path / "left.ended").exists()
    assert not list(tmp_path.glob(".seen*"))


def test_without_the_extra_cluster_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MyomorphError, match=r"pip install 'myomorph\[cluster\]'"):
        connected("tcp://127.0.0.1:8786", 1.0)


def test_a_scheduler_that_does_not_answer_is_named_soon() -> None:
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(
            BadData, match=f"--scheduler {address}: no scheduler answers .*dask scheduler"
        ):
            DaskWorkers(address, patience=2.0)
    with pytest.raises(BadData, match="no scheduler answers"):
        DaskWorkers(address, patience=2.0)


def test_a_program_that_is_no_scheduler_is_named_soon() -> None:
    with socket.socket() as web:
        web.bind(("127.0.0.1", 0))
        web.listen()

        def answer() -> None:
            while True:
                try:
                    other, _ = web.accept()
                except OSError:
                    return
                other.sendall(b"HTTP/1.0 400 Bad Request\r\n\r\n" * 20)

        threading.Thread(target=answer, daemon=True).start()
        with pytest.raises(BadData, match="no scheduler answers"):
            DaskWorkers(f"127.0.0.1:{web.getsockname()[1]}", patience=2.0)


def test_a_scheduler_without_workers_is_told_from_none(tmp_path: Path) -> None:
    with cluster_in(tmp_path / "alone") as alone:
        address = alone.scheduler()
        with pytest.raises(
            BadData,
            match=f"it has no workers: start some with 'dask worker {address} --nthreads 1'",
        ):
            DaskWorkers(address, patience=1.0)


def test_addresses_are_read_or_refused_by_name(tmp_path: Path) -> None:
    assert scheduler_address("node7:8786") == "tcp://node7:8786"
    assert scheduler_address("tls://node7:8786") == "tls://node7:8786"
    told = tmp_path / "scheduler.json"
    told.write_text('{"address": "tcp://10.0.0.1:8786"}', encoding="utf-8")
    assert scheduler_address(str(told)) == "tcp://10.0.0.1:8786"
    told.write_text("{", encoding="utf-8")
    with pytest.raises(BadFile, match="is no scheduler file"):
        scheduler_address(str(told))
    with pytest.raises(BadFile, match="cannot be read"):
        scheduler_address(str(tmp_path / "none.json"))
    with pytest.raises(BadData, match="no protocol 'tpc': Dask has 'tcp'"):
        scheduler_address("tpc://node7:8786")
    for text in ("node7", "tcp://node7", ":8786", ""):
        with pytest.raises(BadData, match="expected a machine and a port"):
            scheduler_address(text)


def test_processes_that_are_not_fit_are_named_with_what_to_do(tmp_path: Path) -> None:
    from dataclasses import replace

    here = fitness()
    assert not unfit(here, None)
    assert "install the same version" in unfit(replace(here, version="0.0.1"), None)
    assert "has Python 2.7" in unfit(replace(here, python="2.7"), None)
    assert "runs on Plan9" in unfit(replace(here, system="Plan9"), None)
    mark = (tmp_path / "mark", "told")
    assert "share under the same name" in unfit(fitness(str(mark[0]), mark[1]), mark)
    mark[0].write_text("told", encoding="utf-8")
    assert not unfit(fitness(str(mark[0]), mark[1]), mark)


def test_workers_of_another_version_get_no_job(
    cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("myomorph.lab.study.run.dask_cluster.__version__", "99.0")
    with pytest.raises(
        BadData,
        match=r"no worker can be used: worker tcp://\S+ has Myomorph .* this program is 99.0",
    ):
        DaskWorkers(cluster.address, patience=10.0)


def test_a_study_ends_where_the_scheduler_goes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_workers, "LOOK", 0.2)
    with cluster_in(tmp_path / "brief", HERE) as brief:
        brief.scheduler()
        brief.worker("one")
        brief.await_workers(1)
        workers = DaskWorkers(brief.address, tmp_path, patience=30.0)
        workers._client._timeout = 2.0
        workers.start(Job(("s", "left"), partial(take_long, tmp_path, "left")), None)
        begun(tmp_path, "left")
        brief.processes["scheduler"].kill()
        with pytest.raises(BadData, match="the scheduler is gone: what is done is kept"):
            all_ended(workers, 100)
        workers.close()
