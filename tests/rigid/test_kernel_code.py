"""Machine code of kernels that runs without Numba gives what Numba gives, or leaves it to Numba."""

from __future__ import annotations

import os
import subprocess
import sys
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from numba import typeof

from myomorph.core.rigid.kernel_cache import type_key
from myomorph.core.rigid.kernel_code import TRIED, call_key

KERNELS = '''
"""Kernels of a test."""
import numpy as np
from myomorph.core.rigid.kernels import kernel

@kernel
def sums(rows, scale, options):
    """Add up what several calls of C and an array of its own come to."""
    if rows.shape[0] == 0:
        raise ValueError("no rows")
    total = np.zeros(rows.shape[1])
    for row in rows:
        total += np.sin(row) ** 3 * scale + np.expm1(row) % 0.7
    return total, options
'''
RUN = """
import sys
import numpy as np
from summed import sums
rows = np.random.default_rng(3).standard_normal((50, 7))
total, options = sums(rows, 0.1, (1, None, True))
assert options == (1, None, True)
print(total.tobytes().hex())
print("numba" in sys.modules)
try:
    sums(rows[:0], 0.1, (1, None, True))
except ValueError as error:
    print(error)
"""
DYNAMICS = """
import sys
import numpy as np
from myomorph.lab.study.workers.ahead import two_links
from myomorph import Motion, inverse_dynamics
from myomorph.core.motion.filters import differentiate
model = two_links()
time = np.linspace(0.0, 1.0, 50)
motion = Motion(time, model.coordinate_names, np.column_stack([np.sin(time), np.cos(3.0 * time)]))
torques = inverse_dynamics(model, differentiate(motion))
print(np.asarray(torques.values).tobytes().hex())
print("numba" in sys.modules)
"""


class Pair(NamedTuple):
    first: np.ndarray
    second: float


Pair.__module__ = "myomorph.made"


class Foreign(NamedTuple):
    first: float


def frozen(array):
    """Return an array that may not be changed."""
    array.flags.writeable = False
    return array


VALUES = [
    1,
    1.0,
    True,
    None,
    np.float64(2.0),
    np.float32(2.0),
    np.int32(2),
    np.zeros(3),
    np.zeros(3, dtype=np.float32),
    np.zeros((3, 2)),
    np.zeros((3, 2), order="F"),
    np.zeros((4, 4))[::2, ::2],
    np.zeros((3, 1)),
    np.zeros(()),
    np.zeros((0, 3)),
    frozen(np.zeros(3)),
    np.zeros(3, dtype=bool),
    np.zeros((2, 2, 2), dtype=np.uint8),
    (),
    (1.0, 2.0),
    (1.0, 2),
    (np.zeros(3), (None, (1,))),
    Pair(np.zeros(3), 2.0),
    (Pair(np.zeros(3), 2.0), Pair(np.zeros(3), 2.0)),
]


@pytest.mark.parametrize("value", VALUES, ids=str)
def test_types_of_values_are_named_as_numba_tells_them_apart(value):
    assert call_key([value]) == type_key((typeof(value),)) is not None


def test_values_have_one_name_where_numba_has_one_type():
    for first, second in pairwise(VALUES):
        same = typeof(first) == typeof(second)
        assert (call_key([first]) == call_key([second])) == same


@pytest.mark.parametrize(
    "value",
    ["text", [1.0], 1 << 70, Foreign(1.0), np.zeros(3, dtype=">f8"), np.array(["a"]), print],
    ids=str,
)
def test_values_of_other_kinds_are_left_to_numba(value):
    assert call_key([1.0, value]) is None
    assert call_key([(1.0, value)]) is None


@pytest.fixture
def environment(tmp_path):
    """Return the environment of a process with an empty cache and a module with a kernel."""
    if not TRIED:
        pytest.skip("kernels run through Numba on this machine")
    (tmp_path / "summed.py").write_text(KERNELS)
    paths = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    return os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": paths}


def printed(program, environment):
    """Run a program in a process of its own and return the lines that it prints."""
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_code_gives_the_same_bits_and_errors(environment):
    compiled = printed(RUN, environment)
    loaded = printed(RUN, environment)
    numba = printed(RUN, environment | {"MYOMORPH_NUMBA": "1"})
    assert [lines[0] for lines in (loaded, numba)] == [compiled[0]] * 2
    assert [lines[2] for lines in (compiled, loaded, numba)] == ["no rows"] * 3
    assert [lines[1] for lines in (compiled, loaded, numba)] == ["True", "False", "True"]


def test_dynamics_give_the_same_bits_without_numba(environment):
    compiled = printed(DYNAMICS, environment)
    loaded = printed(DYNAMICS, environment)
    assert loaded[0] == compiled[0]
    assert [compiled[1], loaded[1]] == ["True", "False"]


def _flip(data: bytes) -> bytes:
    return data[:-100] + bytes([data[-100] ^ 1]) + data[-99:]


def _cut(data: bytes) -> bytes:
    return data[: len(data) // 2]


def _ask_for_more(data: bytes) -> bytes:
    return data.replace(b'"symbols": [', b'"symbols": ["no_such_symbol", ')


def _name_another(data: bytes) -> bytes:
    return data.replace(b'"kernel": "summed', b'"kernel": "other')


def _empty(data: bytes) -> bytes:
    return b""


@pytest.mark.parametrize("damage", [_flip, _cut, _ask_for_more, _name_another, _empty])
def test_code_that_is_damaged_or_asks_for_more_is_left_to_numba(environment, tmp_path, damage):
    compiled = printed(RUN, environment)
    files = list((tmp_path / "cache").glob("*/*.code"))
    assert len(files) == 1
    whole = files[0].read_bytes()
    files[0].write_bytes(damage(whole))
    assert files[0].read_bytes() != whole
    again = printed(RUN, environment)
    assert again == compiled


def test_code_of_older_sources_is_removed(environment, tmp_path):
    printed(RUN, environment)
    before = set((tmp_path / "cache").glob("*/*.code"))
    (tmp_path / "summed.py").write_text(KERNELS + "\n")
    printed(RUN, environment)
    after = set((tmp_path / "cache").glob("*/*.code"))
    assert len(before) == len(after) == 1
    assert before != after


def test_code_that_an_older_version_left_for_numba_alone_is_made_anew(environment, tmp_path):
    printed(RUN, environment)
    for file in (tmp_path / "cache").glob("*/*.code"):
        file.unlink()
    printed(RUN, environment)
    assert printed(RUN, environment)[1] == "False"
