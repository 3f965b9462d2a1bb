"""The kernels that a child process compiles ahead are those that the steps then use."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

USE = """
from myomorph.study.trial import ahead
from myomorph.muscles.path_kernels import path_frames
assert ahead.cached()
ahead.compile_muscles()
assert sum(path_frames.stats.cache_hits.values()) == 1
assert not path_frames.stats.cache_misses
"""


@pytest.mark.long
def test_what_the_child_compiles_is_found_in_the_cache(tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    subprocess.run([sys.executable, "-m", "myomorph.study.trial.ahead"], check=True, env=environment)
    subprocess.run([sys.executable, "-c", USE], check=True, env=environment)


def test_nothing_is_compiled_where_no_later_step_needs_it():
    from myomorph.study.trial.ahead import compile_ahead

    for steps in ((), ("ik",), ("ik", "id"), ("muscles",)):
        waiting = compile_ahead(steps)
        assert waiting._child is None
        waiting.wait("muscles")
