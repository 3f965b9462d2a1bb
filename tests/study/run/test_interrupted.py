"""The program killed, its disk full, its folder read-only, its cluster cut off.

What is left is whole, and goes on.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest
from benchmarks.accuracy.faults.interrupted import SETTINGS, begin, end_of, mounted, others_of

from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from myomorph.show.demo.arm import example_files
from truths.cluster import cluster_in, cut_off, machines, namespaces_work
from truths.interrupted_checks import (
    computed_twice,
    differences,
    ended,
    half_written,
    left_over,
    losses,
    runs,
)

STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
trials = ["reach_*.trc"]
steps = ["ik", "id", "muscles", "tension"]
"""
TRIALS = 6


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a study file next to its recordings; nothing writes there."""
    arm = example_files(tmp_path_factory.mktemp("study"))
    for number in range(TRIALS):
        (arm.folder / f"reach_{number}.trc").write_bytes(arm.markers.read_bytes())
    path = arm.folder / "study.toml"
    path.write_text(STUDY, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def undisturbed(study: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of the study when nothing happens; nothing writes there."""
    out = tmp_path_factory.mktemp("undisturbed") / "whole"
    with pytest.MonkeyPatch.context() as patch:
        for name, value in SETTINGS.items():
            patch.setenv(name, value)
        outcomes = run_study(read_plan(study), out)
    assert [one.error for one in outcomes] == [""] * TRIALS
    return out


@pytest.fixture
def run_here(
    study: Path,
    command: Callable[..., SimpleNamespace],
    in_process: None,
    monkeypatch: pytest.MonkeyPatch,
) -> Callable[[Path], tuple[int, str]]:
    """Return a function that runs the study in this process: exit status and printed text."""
    for name, value in SETTINGS.items():
        monkeypatch.setenv(name, value)

    def run(out: Path) -> tuple[int, str]:
        told = command("run", study, "--out", out)
        return told.status, told.out + told.err

    return run


@pytest.fixture
def mount(tmp_path: Path) -> Iterator[Callable[[str], Path]]:
    """Make a small file system of its own; the test is skipped where that cannot be done."""
    import subprocess

    made: list[Path] = []

    def make(options: str) -> Path:
        folder = tmp_path / "mounted"
        folder.mkdir()
        reason = mounted(folder, options)
        if reason:
            pytest.skip(f"no file system can be mounted: {reason}")
        made.append(folder)
        return folder

    yield make
    for folder in made:
        subprocess.run(("umount", str(folder)), capture_output=True)


def wait_for(there: Callable[[], bool], process: object) -> None:
    """Wait for something that a run does."""
    import time

    while process.poll() is None and not there():  # type: ignore[attr-defined]
        time.sleep(0.02)


def test_checks_see_what_is_not_whole(undisturbed: Path, tmp_path: Path) -> None:
    undisturbed = Path(shutil.copytree(undisturbed, tmp_path / "whole"))
    assert half_written(undisturbed) == []
    assert differences(undisturbed, undisturbed)[1] == []
    assert computed_twice(undisturbed) == []
    home = undisturbed / "s01" / "reach_0"
    cut = [home / name for name in ("reach_0.nc", "torques.sto", "coordinates.mot", "values.csv")]
    for path in cut:
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert len(half_written(undisturbed)) == len(cut)
    assert len(differences(undisturbed, undisturbed.parent / "none", whole=False)[1]) > 20
    (home / ".reach_0.nc.abcd1234").touch()
    assert left_over(undisturbed) == ["s01/reach_0/.reach_0.nc.abcd1234"]
    times = undisturbed / "timings.csv"
    times.write_text(times.read_text() + times.read_text().splitlines()[1] + "\n")
    assert len(computed_twice(undisturbed)) == 1


@pytest.mark.long
def test_a_killed_program_goes_on_where_it_was(
    study: Path, undisturbed: Path, run_here: Callable[[Path], tuple[int, str]], tmp_path: Path
) -> None:
    out = tmp_path / "killed"
    for done in (0, 2):
        process = begin(study, out, "--workers", "2")
        wait_for(lambda done=done: runs(out) > 0 and ended(out) >= done, process)
        others = others_of(process)
        process.kill()
        end_of(process)
        # Nobody told the workers: they see that nobody waits for them.
        assert psutil.wait_procs(others, timeout=30)[1] == []
        assert half_written(out) == []
        assert differences(out, undisturbed, whole=False)[1] == []
    code, said = run_here(out)
    assert code == 0, said
    compared, unequal = differences(out, undisturbed)
    assert compared > 10 * TRIALS
    assert unequal == []
    assert computed_twice(out) == []
    assert left_over(out) == []


def test_a_full_disk_leaves_what_was_done(
    undisturbed: Path, run_here: Callable[[Path], tuple[int, str]], mount: Callable[[str], Path]
) -> None:
    import subprocess

    size = sum(path.stat().st_size for path in undisturbed.rglob("*") if path.is_file())
    out = mount(f"size={size // 2}")
    code, said = run_here(out)
    assert code == 2, said
    assert "no space is left" in said
    assert half_written(out) == []
    assert differences(out, undisturbed, whole=False)[1] == []
    subprocess.run(("mount", "-o", f"remount,size={8 * size}", str(out)), check=True)
    code, said = run_here(out)
    assert code == 0, said
    assert differences(out, undisturbed)[1] == []
    assert computed_twice(out) == []


def test_a_folder_that_cannot_be_written_is_refused_at_once(
    study: Path, command: Callable[..., SimpleNamespace], mount: Callable[[str], Path]
) -> None:
    out = mount("ro")
    run = command("run", study, "--out", out, "--workers", 1)
    assert run.status == 2
    assert (
        run.err
        == f"error: {out}: cannot be written (Read-only file system); give --out another folder\n"
    )


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="network namespaces are of Linux")
def test_a_machine_that_is_cut_off_loses_nothing(
    study: Path, undisturbed: Path, tmp_path: Path
) -> None:
    reason = namespaces_work()
    if reason:
        pytest.skip(f"no network namespaces: {reason}")
    names = ("myo-scheduler", "myo-one", "myo-two")
    # Dask waits for half a minute, if nobody says otherwise; shorter than this cannot be.
    settings = SETTINGS | {"DASK_DISTRIBUTED__COMM__TIMEOUTS__TCP": "11s"}
    out = tmp_path / "there"
    with machines(names) as hosts, cluster_in(tmp_path / "machines", settings) as cluster:
        cluster.scheduler(hosts[names[0]], names[0])
        for name in names[1:]:
            cluster.worker(name, hosts[name], name)
        cluster.await_workers(2)
        process = begin(study, out, "--scheduler", cluster.address)
        wait_for(lambda: ended(out) > 0, process)
        cut_off(names[2])
        code, said = end_of(process)
    assert code == 0, said
    assert losses(out) <= 1
    assert differences(out, undisturbed)[1] == []
    assert computed_twice(out) == []
    assert left_over(out) == []
