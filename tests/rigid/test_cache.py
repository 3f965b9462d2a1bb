"""Kernels of another version are deleted once, those of this version stay; processes save theirs in turns."""

from __future__ import annotations

import threading

import numba
from numba.core.caching import IndexDataCacheFile

from myomorph import __version__
from myomorph.rigid.cache import STAMP, KernelFile, forget_other_versions


def test_kernels_of_another_version_are_forgotten(tmp_path):
    folder = tmp_path / "rigid" / "__pycache__"
    folder.mkdir(parents=True)
    for name in ("kinematics.body_poses-1.nbi", "kinematics.body_poses-1.1.nbc", "kinematics.cpython-311.pyc"):
        (folder / name).write_text("compiled")
    assert forget_other_versions(tmp_path) == 2
    assert [path.name for path in folder.iterdir()] == ["kinematics.cpython-311.pyc"]
    assert (tmp_path / "__pycache__" / STAMP).read_text() == __version__
    (folder / "kinematics.body_poses-2.nbi").write_text("compiled")
    assert forget_other_versions(tmp_path) == 0
    (tmp_path / "__pycache__" / STAMP).write_text("0.0.1")
    assert forget_other_versions(tmp_path) == 1


def test_kernels_that_are_saved_at_the_same_time_get_files_of_their_own(tmp_path):
    """As processes do, each file object reads the index anew; nothing may be lost or stand under another's name."""
    together = threading.Barrier(8)

    def save(number):
        together.wait()
        KernelFile(str(tmp_path), "kernel", "stamp").save(("signature", number), f"code of {number}")

    threads = [threading.Thread(target=save, args=(number,)) for number in range(8)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    found = IndexDataCacheFile(str(tmp_path), "kernel", "stamp")
    assert [found.load(("signature", number)) for number in range(8)] == [f"code of {n}" for n in range(8)]


def test_code_of_an_older_source_is_replaced(tmp_path):
    KernelFile(str(tmp_path), "kernel", "older").save("signature", "older code")
    KernelFile(str(tmp_path), "kernel", "newer").save("other signature", "newer code")
    newer = IndexDataCacheFile(str(tmp_path), "kernel", "newer")
    assert newer.load("other signature") == "newer code"
    assert newer.load("signature") is None


def test_a_kernel_is_saved_and_found_again(tmp_path, monkeypatch):
    """Through Numba itself, whose inner workings this relies on."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    module = tmp_path / "twice.py"
    module.write_text("def twice(x):\n    return 2 * x\n")
    names = {}
    exec(compile(module.read_text(), str(module), "exec"), names)
    first, second = (numba.njit(cache=True)(names["twice"]) for _ in range(2))
    assert first(2) == second(2) == 4
    assert sum(first.stats.cache_misses.values()) == 1
    assert sum(second.stats.cache_hits.values()) == 1
    assert first.stats.cache_path.startswith(str(tmp_path))
    assert IndexDataCacheFile.save is KernelFile.save
