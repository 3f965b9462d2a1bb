"""Files of a small arm, and the command line in this process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from arm_files import write_arm


@pytest.fixture
def arm(tmp_path: Path) -> SimpleNamespace:
    """Files of a small arm in a folder of their own, by role."""
    return write_arm(tmp_path)


@pytest.fixture
def command(capfd: pytest.CaptureFixture[str]) -> Callable[..., SimpleNamespace]:
    """Runs the command line in this process: its exit status and what it printed."""
    from myomorph.cli import main

    def run(*arguments: object) -> SimpleNamespace:
        capfd.readouterr()
        status = main([str(one) for one in arguments])
        printed = capfd.readouterr()
        return SimpleNamespace(status=status, out=printed.out, err=printed.err)

    return run
