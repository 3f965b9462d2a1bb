"""Where the recordings are: `MYOMORPH_DATA`, or the folder that lies beside the checkout."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

# The matrices of tests are small: threads of BLAS get into each other's way, and into that of what runs beside.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

pytest_plugins = ["arm_files"]

BESIDE = Path(__file__).resolve().parents[2] / "shared" / "data"
DATA = Path(os.environ.get("MYOMORPH_DATA", BESIDE))


@pytest.fixture(scope="session")
def data() -> Callable[[str], Path]:
    """Path of a file of the data collection; the test is skipped where its data set is absent."""

    def find(name: str) -> Path:
        path = DATA / name
        if not path.exists():
            pytest.skip(f"needs the data set '{name.split('/')[0]}': set MYOMORPH_DATA to the folder that holds it")
        return path

    return find
