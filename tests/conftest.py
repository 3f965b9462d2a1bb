"""Where the recordings are, and which tests run first.

Recordings are in `MYOMORPH_DATA`, or in the folder next to the checkout.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import hypothesis
import pytest

from data_collection import data_folder
from shape_checks import check_shapes

# Before the package is imported.
check_shapes()
# The matrices of tests are small: threads of BLAS get into each other's way, and into that of what
# runs beside.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# What tests take on a busy machine teaches no dry run.
os.environ["MYOMORPH_STEP_TIMES"] = ""
# No test asserts how long something takes, hypothesis' neither.
hypothesis.settings.register_profile("no deadline", deadline=None)
hypothesis.settings.load_profile("no deadline")

pytest_plugins = ["arm_files"]

DATA = data_folder()

COMPILING = (
    "cli/test_calibrate_command.py",
    "analysis/test_length_analysis.py",
    "motion/test_closed_ik.py",
    "cli/test_commands.py",
    "demo/test_performances.py",
    "cli/test_identify.py",
    "rigid/test_loops.py",
    "cli/test_live_command.py",
    "cli/test_passive_commands.py",
)
"""Files that compile most of the kernels where there are none on disk; neighbors compile different
ones.
"""


def pytest_configure(config: pytest.Config) -> None:
    """Let pytest-xdist take files in their order.

    By itself it would begin with those that have most tests.
    """
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """First the files that compile, then those that take long, those of few short tests last.

    So two processes do not compile the same kernels at once, and no long file is left for one of
    them at the end.
    """
    here = Path(__file__).parent
    count = Counter(item.path for item in items)
    long = Counter(item.path for item in items if item.get_closest_marker("long"))
    first = {here / name: len(COMPILING) - k for k, name in enumerate(COMPILING)}
    items.sort(
        key=lambda item: (
            -first.get(item.path, 0),
            -bool(long[item.path]),
            -count[item.path],
            str(item.path),
        )
    )


@pytest.fixture(autouse=True, scope="session")
def told_of_no_wait() -> None:
    """Print nothing on kernels that compile, nor on how long work took.

    Both depend on the machine and on what ran before, and are no warning. Tests of what is printed
    run a process of their own, or set the patience themselves.
    """
    # Here, because shapes are checked only in what is imported after `check_shapes`.
    from myomorph.core.rigid import compile_notices
    from myomorph.lab.cli import program
    from myomorph.lab.store import progress

    compile_notices._ANNOUNCED[program._say_that_kernels_compile] = True
    progress.PATIENCE = math.inf


@pytest.fixture(scope="session")
def data() -> Callable[[str], Path]:
    """Path of a file of the data collection; the test is skipped where its data set is absent."""

    def find(name: str) -> Path:
        path = DATA / name
        if not path.exists():
            pytest.skip(
                f"needs the data set '{name.split('/')[0]}': set MYOMORPH_DATA to the folder that"
                " holds it"
            )
        return path

    return find
