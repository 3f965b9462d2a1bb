"""Fixtures of the command line: the files of the example arm, and the program in this process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from myomorph.show.demo.arm import ExampleFiles, example_files


@pytest.fixture
def arm(tmp_path: Path) -> ExampleFiles:
    """Files of a small arm in a folder of their own, by role."""
    return example_files(tmp_path)


@pytest.fixture
def command(capfd: pytest.CaptureFixture[str]) -> Callable[..., SimpleNamespace]:
    """Return a function that runs the command line in this process.

    It gives the exit status and what was printed.
    """
    from myomorph.lab.cli import main

    def run(*arguments: object) -> SimpleNamespace:
        capfd.readouterr()
        status = main([str(one) for one in arguments])
        printed = capfd.readouterr()
        return SimpleNamespace(status=status, out=printed.out, err=printed.err)

    return run


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the jobs of studies in this process.

    For tests of the command line that do not test the processes.
    """
    from myomorph.lab.study.workers import local_workers

    monkeypatch.setattr(local_workers, "local_workers", lambda *_: local_workers.InProcess())
