"""Worker processes do jobs as this process would.

Those that are lost are replaced, and none outlives its parent.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
import worker_jobs as made

from myomorph.core.model.errors import BadData
from myomorph.lab.study.inputs.reading import open_model
from myomorph.lab.study.workers.local_workers import InProcess, LocalWorkers, local_workers

LONG = 120.0


@pytest.fixture
def hands():
    workers = LocalWorkers(2)
    yield workers
    workers.close()


def all_of(workers, *jobs, model=None):
    """Start jobs side by side and wait for all of them."""
    for job in jobs:
        workers.start(job, model)
    found = []
    while len(found) < len(jobs):
        found += workers.ended(LONG)
    return {one.job.key[1]: one for one in found}


def wait_for(path, seconds=LONG):
    until = time.monotonic() + seconds
    while not path.exists() or not path.read_text():
        assert time.monotonic() < until, f"{path} did not come"
        time.sleep(0.02)
    return path.read_text()


def test_a_model_is_sent_once_and_stays_read_only(arm, hands):
    """Arrays that could be written would compile every kernel once more."""
    model = open_model(arm.model)
    seen = []
    for name in ("a", "b", "c"):
        (one,) = all_of(hands, made.job(made.about_model, name), model=model).values()
        seen.append(one.outcome.done)
    assert seen[0] == seen[1] == seen[2]
    assert seen[0][2] == "False"
    assert len(hands.processes) == 1


def test_a_module_among_recordings_is_not_run(arm, hands, tmp_path, monkeypatch):
    """A file called `numpy.py` in the working folder would be run in the place of the package."""
    (tmp_path / "numpy.py").write_text("raise SystemExit('code of the folder was run')\n")
    monkeypatch.chdir(tmp_path)
    (one,) = all_of(hands, made.job(made.about_model, "a"), model=open_model(arm.model)).values()
    assert one.outcome.done


def test_what_is_printed_is_no_answer(hands):
    found = all_of(hands, made.job(made.speak, "a"), made.job(made.plain, "b"))
    assert found["a"].outcome.done == ("spoke",)
    assert found["b"].outcome.done == ("done",)


def test_a_lost_process_is_told_and_replaced(hands, tmp_path):
    lost = all_of(hands, made.job(made.leave, "a", mark=tmp_path / "mark"))["a"]
    assert lost.outcome is None
    assert "status 7" in lost.lost
    again = all_of(hands, lost.job)["a"]
    assert again.outcome.done == ("again",)


def test_memory_is_bounded(tmp_path):
    workers = LocalWorkers(1, memory=600 << 20)
    try:
        lost = all_of(workers, made.job(made.take_memory, "a", size=900 << 20))["a"]
        assert "more than the 0.59 GiB that a worker may take" in lost.lost
        assert all_of(workers, made.job(made.plain, "b"))["b"].outcome.done == ("done",)
    finally:
        workers.close()


def test_closing_lets_jobs_tidy_up(tmp_path):
    workers = LocalWorkers(1)
    mark = tmp_path / "mark"
    workers.start(made.job(made.sleep, "a", mark=mark), None)
    number = int(wait_for(mark))
    workers.close()
    assert (tmp_path / "mark.tidied").exists()
    assert not psutil.pid_exists(number)
    assert workers.processes == ()


PARENT = """
import sys, time
sys.path[:0] = [{tests!r}]
import worker_jobs as made
from pathlib import Path
from myomorph.lab.study.workers.local_workers import LocalWorkers
workers = LocalWorkers(1)
workers.start(made.job(made.sleep, "a", mark=Path({mark!r})), None)
time.sleep(600)
"""


def test_a_process_ends_with_its_parent(tmp_path):
    mark = tmp_path / "mark"
    text = PARENT.format(tests=str(Path(__file__).parent), mark=str(mark))
    parent = subprocess.Popen([sys.executable, "-c", text])
    try:
        number = int(wait_for(mark))
    finally:
        parent.kill()
        parent.wait()
    _, alive = psutil.wait_procs(
        [psutil.Process(number)] if psutil.pid_exists(number) else [], timeout=20.0
    )
    assert not alive


def test_how_many_workers():
    assert isinstance(local_workers(jobs=1), InProcess)
    assert local_workers(3, jobs=2).count == 2
    assert local_workers(2, memory=1 << 30).memory == 1 << 30
    assert local_workers(2).memory > 0
    for count in (0, -1):
        with pytest.raises(BadData, match="expected 1 or more"):
            local_workers(count, jobs=5)
    with pytest.raises(BadData, match="less does not hold a model"):
        local_workers(1, memory=1000)


def test_on_a_new_machine_the_first_job_compiles_alone(hands, monkeypatch):
    monkeypatch.setattr("myomorph.lab.study.workers.local_workers.motion_cached", lambda: False)
    jobs = [made.job(made.plain, name) for name in ("a", "b", "c")]
    for job in jobs[:2]:
        hands.start(job, None)
    assert len(hands.processes) == 1
    found = []
    while len(found) < 2:
        found += hands.ended(LONG)
    assert sorted(one.job.key[1] for one in found) == ["a", "b"]
    hands.start(jobs[2], None)
    (last,) = hands.ended(LONG)
    assert last.job.key == jobs[2].key
