"""Every reader of files, given wrong ones.

It reads them or reports what is wrong, without crash or hang. A small part of `python -m benchmarks
fuzz`.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from fuzz_readers import READERS

ROOT = Path(__file__).parents[2]


def run_on(folder: Path, examples: int) -> None:
    command = [
        sys.executable,
        str(Path(__file__).with_name("wrong_files.py")),
        str(folder),
        "--examples",
        str(examples),
    ]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8"}
    ended = subprocess.run(
        command, env=environment, cwd=folder, capture_output=True, encoding="utf-8", timeout=1200
    )
    findings = [line for line in ended.stdout.splitlines() if '"found"' in line]
    assert ended.returncode == 0, "\n".join(
        [*ended.stdout.splitlines()[-1:], *findings, ended.stderr[-3000:]]
    )
    unguarded = [reader.name for reader in READERS if not reader.guarded]
    assert f"begins with {unguarded[-1]}" in ended.stdout


def test_a_few_wrong_files(tmp_path: Path) -> None:
    run_on(tmp_path, 10)


@pytest.mark.long
def test_many_wrong_files(tmp_path: Path) -> None:
    run_on(tmp_path, 40)
