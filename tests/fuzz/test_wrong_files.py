"""Every reader of files, given wrong ones: it reads them or says what is wrong, without crash or hang.

A small part of `python -m benchmarks fuzz`, which is guided by the code that inputs reach.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from benchmarks.fuzz_readers import READERS

ROOT = Path(__file__).parents[2]


def tried(folder: Path, examples: int) -> None:
    script = Path(__file__).with_name("wrong_files.py")
    given = [sys.executable, str(script), str(examples), str(folder)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8"}
    ended = subprocess.run(given, env=environment, cwd=folder, capture_output=True, encoding="utf-8", timeout=1200)
    said = [one for one in ended.stdout.splitlines() if not one.startswith("begins with")]
    assert ended.returncode == 0, "\n".join([*ended.stdout.splitlines()[-1:], *said, ended.stderr[-3000:]])
    assert f"begins with {[one.name for one in READERS if not one.guarded][-1]}" in ended.stdout


def test_a_few_wrong_files(tmp_path: Path) -> None:
    tried(tmp_path, 10)


@pytest.mark.long
def test_many_wrong_files(tmp_path: Path) -> None:
    tried(tmp_path, 40)
