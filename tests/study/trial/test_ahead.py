"""The kernels that a child process compiles ahead are those that the steps then use."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

from filelock import FileLock

from myomorph.core.model.cache_folder import kernel_folder
from myomorph.core.rigid.kernel_cache import LOCK
from myomorph.lab.study.workers.ahead import TENDONS, compile_muscles

USE = """
import sys
from myomorph.lab.study.workers import ahead
from myomorph.core.muscles.path import path_frames
wraps = frozenset({ahead.TENDONS})
assert ahead.cached(wraps)
assert not ahead.cached(frozenset())
ahead.compile_muscles(wraps)
assert path_frames.forms == 1
from myomorph.core.rigid.kernel_code import TRIED
assert ("numba" not in sys.modules) == TRIED
"""


def test_what_the_child_compiles_is_found_in_the_cache(tmp_path):
    """In a cache that lacks the kernel of paths; what that calls is compiled once for all tests."""
    compile_muscles(frozenset({TENDONS}))
    folder = kernel_folder()
    with FileLock(folder / LOCK):
        shutil.copytree(
            folder, tmp_path / folder.name, ignore=shutil.ignore_patterns("*.path_frames-*", LOCK)
        )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    subprocess.run(
        [sys.executable, "-m", "myomorph.lab.study.workers.ahead", "tendons"],
        check=True,
        env=environment,
    )
    subprocess.run([sys.executable, "-c", USE], check=True, env=environment)


def test_nothing_is_compiled_where_no_later_step_needs_it():
    from myomorph.lab.study.workers.ahead import compile_ahead

    for steps in ((), ("ik",), ("ik", "id"), ("muscles",)):
        waiting = compile_ahead(steps)
        assert waiting._child is None
        waiting.wait("muscles")


def test_the_rules_by_which_paths_wrap_are_those_of_their_kernels():
    from myomorph.core.muscles.model_paths import compile_paths
    from myomorph.lab.study.workers.ahead import SURFACES, TENDONS, two_links, wraps_of

    for wraps in (set(), {SURFACES}, {TENDONS}, {SURFACES, TENDONS}):
        model = two_links(frozenset(wraps))
        assert wraps_of(model) == wraps
        assert compile_paths(model).rules == (
            1 if SURFACES in wraps else None,
            1 if TENDONS in wraps else None,
            None,
        )
