"""Kernels have a folder of their own, one for each version.

Processes save theirs in turns; Numba stays as it was.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
import types
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit
from numba import types as numba_types
from numba.core.caching import IndexDataCacheFile
from numba.core.errors import NumbaError

import myomorph
from myomorph import __version__
from myomorph.core.model import cache_folder
from myomorph.core.model.cache_folder import PACKAGE, kernel_folder
from myomorph.core.rigid import kernel_cache, vectors
from myomorph.core.rigid.frames import over_frames
from myomorph.core.rigid.kernel_cache import KernelFile
from myomorph.core.rigid.kernel_code import TRIED
from myomorph.core.rigid.kernel_files import source_digest
from myomorph.core.rigid.kernels import interpreted, kernel, signatures_on_disk
from myomorph.core.rigid.vectors import turned

DOUBLE = (
    "from myomorph.core.rigid.kernels import kernel\n@kernel\ndef double(x):\n    return 2 * x\n"
)
CALL = """
import sys
from myomorph.core.rigid.kernels import kernel, signatures_on_disk
from doubled import double
sys.stdin.readline()
assert double(2) == 4 and double(1.5) == 3.0
used = set(sys.modules)
assert signatures_on_disk(double)
stats = double.dispatcher.stats
print(double.forms, sum(stats.cache_misses.values()), "numba.core.dispatcher" in used)
"""
IMPORT = """
import os
from numba.core import caching
def classes():
    return {name: dict(vars(one)) for name, one in vars(caching).items() if isinstance(one, type)}
before = classes()
import myomorph.core.tension.solve, myomorph.core.motion.ik
assert before == classes()
assert not os.path.exists(os.environ["NUMBA_CACHE_DIR"])
"""


@pytest.fixture
def cached(tmp_path):
    """Make a module with a kernel, and an empty cache."""
    (tmp_path / "doubled.py").write_text(DOUBLE)
    paths = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    return os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": paths}


def test_kernels_that_are_saved_at_the_same_time_get_files_of_their_own(tmp_path):
    """As processes do, each file object reads the index anew.

    Nothing may be lost or stored under another's name.
    """
    together = threading.Barrier(8)

    def save(number):
        together.wait()
        KernelFile(str(tmp_path), "kernel", "stamp").save(
            ("signature", number), f"code of {number}"
        )

    threads = [threading.Thread(target=save, args=(number,)) for number in range(8)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    found = IndexDataCacheFile(str(tmp_path), "kernel", "stamp")
    assert [found.load(("signature", number)) for number in range(8)] == [
        f"code of {n}" for n in range(8)
    ]


def test_code_of_an_older_source_is_replaced(tmp_path):
    KernelFile(str(tmp_path), "kernel", "older").save("signature", "older code")
    KernelFile(str(tmp_path), "kernel", "newer").save("other signature", "newer code")
    newer = IndexDataCacheFile(str(tmp_path), "kernel", "newer")
    assert newer.load("other signature") == "newer code"
    assert newer.load("signature") is None


def test_an_index_of_arguments_whose_classes_are_gone_counts_as_none(tmp_path, monkeypatch):
    moved = types.ModuleType("moved")
    moved.Key = type("Key", (tuple,), {"__module__": "moved", "__qualname__": "Key"})
    monkeypatch.setitem(sys.modules, "moved", moved)
    KernelFile(str(tmp_path), "kernel", "older").save(moved.Key((1,)), "older code")
    monkeypatch.delitem(sys.modules, "moved")
    file = KernelFile(str(tmp_path), "kernel", "newer")
    assert file.load("signature") is None
    file.save("signature", "newer code")
    assert file.load("signature") == "newer code"


def test_a_kernel_that_counts_no_users_refuses_to_make_arrays():
    source = (
        "import numpy as np\ndef sums(x):\n    return x.sum()\ndef twice(x):\n    return 2.0 * x\n"
    )
    exec(source, functions := {})
    numbers = np.arange(3.0)
    assert njit(_nrt=False)(functions["sums"])(numbers) == 3.0
    with pytest.raises(NumbaError):
        njit(_nrt=False)(functions["twice"])(numbers)


def test_two_processes_compile_once_what_a_third_runs_without_numba(cached):
    def start():
        return subprocess.Popen(
            [sys.executable, "-c", CALL],
            env=cached,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    together = [start(), start()]
    for one in together:
        one.stdin.write("\n")
        one.stdin.flush()
    counts = [one.communicate()[0].split() for one in together]
    assert [one.returncode for one in together] == [0, 0]
    assert sum(int(compiled) for _, compiled, _ in counts) == 2
    assert start().communicate("\n")[0].split() == ["2", "0", str(not TRIED)]


def test_importing_kernels_changes_nothing_in_numba_and_writes_nothing(cached):
    subprocess.run([sys.executable, "-c", IMPORT], check=True, env=cached)


def test_kernels_of_each_version_and_copy_have_a_folder_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    here = kernel_folder()
    assert here.parent == tmp_path
    assert __version__ in here.name
    monkeypatch.setattr(cache_folder, "PACKAGE", tmp_path / "elsewhere")
    elsewhere = kernel_folder()
    monkeypatch.setattr(myomorph, "__version__", "0.0.1")
    assert len({here, elsewhere, kernel_folder()}) == 3
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    assert not kernel_folder().is_relative_to(PACKAGE)


def test_a_kernel_signatures_on_disk_anew_where_one_that_it_calls_has_changed(
    tmp_path, monkeypatch
):
    """The code of a kernel holds that of the kernels it calls."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "doubled_inside.py").write_text(DOUBLE)
    outer = "from doubled_inside import double\n" + DOUBLE.replace("double(x)", "four(x)").replace(
        "2 * x", "2*double(x)"
    )
    (tmp_path / "doubled_outside.py").write_text(outer)
    source_digest.cache_clear()
    from doubled_outside import four

    assert not signatures_on_disk(four)
    assert four(1) == 4
    assert signatures_on_disk(four)
    (tmp_path / "doubled_inside.py").write_text(DOUBLE.replace("2 * x", "3 * x"))
    source_digest.cache_clear()
    assert not signatures_on_disk(four)


def test_where_nothing_can_be_written_a_kernel_still_runs(tmp_path, cached):
    (tmp_path / "cache").write_text("a file, no folder")
    call = CALL.replace("assert signatures_on_disk(double)", "")
    done = subprocess.run(
        [sys.executable, "-c", call], env=cached, input="\n", capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_arguments_are_ours_where_all_their_classes_are():
    class Foreign(NamedTuple):
        a: int

    class Ours(NamedTuple):
        a: int

    Ours.__module__ = f"{kernel_cache.OURS}made"
    integer = numba_types.int64
    ours = numba_types.NamedUniTuple(integer, 1, Ours)
    foreign = numba_types.NamedUniTuple(integer, 1, Foreign)
    assert kernel_cache._ours(integer)
    assert kernel_cache._ours(numba_types.Tuple((ours, integer)))
    assert not kernel_cache._ours(foreign)
    assert not kernel_cache._ours(numba_types.Tuple((ours, foreign)))


ANNOUNCED = """
from myomorph.core.rigid.compile_notices import before_compiling
from doubled import double
calls = []
before_compiling(lambda folder, can_keep: calls.append(can_keep))
before_compiling(print)
assert calls == []
double(2), double(1.5)
print(calls)
"""


@pytest.mark.parametrize("can_keep", [True, False])
def test_compiling_is_announced_once_with_whether_the_code_can_be_kept(tmp_path, cached, can_keep):
    if not can_keep:
        (tmp_path / "cache").write_text("a file, no folder")
    done = subprocess.run(
        [sys.executable, "-c", ANNOUNCED], env=cached, capture_output=True, text=True, check=True
    )
    lines = done.stdout.splitlines()
    assert lines[-1] == str([can_keep])
    assert len(lines) == 2
    assert str(tmp_path / "cache") in lines[0]


def test_code_from_the_disk_is_not_announced(cached):
    command = [sys.executable, "-c", ANNOUNCED]
    for lines in (2, 1):
        done = subprocess.run(command, env=cached, capture_output=True, text=True, check=True)
        assert len(done.stdout.splitlines()) == lines


def test_interpreted_kernels_give_what_compiled_ones_give():
    matrix = np.array([[3.0, 1.0, 0.5], [1.0, 2.0, 0.25], [0.5, 0.25, 1.0]])
    with interpreted():
        plain = turned(vectors.matrix(matrix[None], 0), (1.0, 2.0, 3.0))
    assert plain == tuple(matrix @ [1.0, 2.0, 3.0])


@kernel
def noted(notes, frame):
    """Note a frame in a list of texts, which Numba does not compile."""
    notes.append(str(object()) + str(frame))


def test_threads_over_frames_run_interpreted_kernels_too(monkeypatch):
    monkeypatch.setenv("MYOMORPH_THREADS", "2")
    notes = []
    with interpreted():
        over_frames(lambda start, stop: noted(notes, start), 4, chunk=1)
    assert len(notes) == 4


def test_a_kernel_is_pickled_by_its_name():
    assert pickle.loads(pickle.dumps(turned)) is turned
