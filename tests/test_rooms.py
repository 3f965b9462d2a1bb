"""The rooms import downwards only, and hold no drawer for what belongs nowhere."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DRAWERS = {"utils", "util", "common", "helpers", "misc"}


def test_imports_go_down_only():
    pytest.importorskip("importlinter", reason="needs the extra 'lint'")
    program = (
        "import sys; from importlinter.cli import lint_imports_command;"
        " sys.exit(lint_imports_command())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_no_drawers():
    found = [path for path in (ROOT / "src").rglob("*") if path.stem in DRAWERS]
    assert found == []


def test_import_is_light():
    """`import myomorph` loads nothing that takes time.

    The same holds for the root of the command line.
    """
    program = "import sys, myomorph, myomorph.lab.cli; print(*sorted(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.split())
    assert not loaded & {"numba", "scipy", "mujoco", "xarray", "matplotlib", "pydantic"}


def test_commands_begin_without_what_few_of_them_need():
    """SciPy's filters and statistics take half a second each.

    Steps that use them import them there.
    """
    program = (
        "import sys, myomorph.lab.cli.step_command, myomorph.lab.study.run.run,"
        " myomorph.lab.study.plan.plan; print(*sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.split())
    assert "numpy" in loaded
    assert not loaded & {"scipy.signal", "scipy.stats", "pandas", "xarray", "matplotlib", "mujoco"}


def test_core_body_and_laboratory_name_no_guest():
    """Nor in a text that is imported later: what a wing adds is in its own `extension.py`."""
    package = ROOT / "src" / "myomorph"
    guests = sorted(path.parent.name for path in package.glob("*/extension.py"))
    assert guests == ["bones", "exchange", "forward", "live", "show", "swings"]
    named = re.compile(rf"\bmyomorph[./\\](?:{'|'.join(guests)})\b")
    found = [
        f"{path.relative_to(ROOT).as_posix()}: {match[0]}"
        for wing in ("core", "body", "lab")
        for path in sorted((package / wing).rglob("*.py*"))
        if path.suffix in (".py", ".pyi")
        for match in named.finditer(path.read_text(encoding="utf-8"))
    ]
    assert found == []
