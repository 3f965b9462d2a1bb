"""Rules that ruff checks, beyond those that hold for all files and stand in pyproject.toml."""

from __future__ import annotations

import json
import subprocess
import sys

from tests.page.rules import Finding
from tests.page.sources import FOLDERS, ROOT, Source

RULES = (
    "C901",  # complexity 10
    "PLR0912",  # branches
    "PLR0914",  # locals
    "PLR0915",  # statements
    "PLR1702",  # nested blocks
    "D205",  # a docstring begins with a line of its own
    "D401",  # in the imperative mood
)
SETTINGS = """
line-length = 100
target-version = "py311"
lint.mccabe.max-complexity = 10
lint.pylint.max-locals = 15
lint.pydocstyle.convention = "numpy"
"""


def ruff_findings(files: dict[str, Source]) -> list[Finding]:
    """Places that ruff finds and that have no waiver."""
    settings = [f"--config={line}" for line in SETTINGS.strip().splitlines()]
    command = [sys.executable, "-m", "ruff", "check", *FOLDERS]
    options = ["--isolated", "--no-cache", "--preview", "--ignore-noqa", "--output-format=json"]
    selection = f"--select={','.join(RULES)}"
    done = subprocess.run(
        [*command, *options, selection, *settings],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode > 1:
        raise RuntimeError(done.stderr)
    found = [_finding(place) for place in json.loads(done.stdout)]
    return [
        finding
        for finding in found
        if finding.path in files and finding.line not in files[finding.path].waivers
    ]


def _finding(place: dict) -> Finding:
    path = place["filename"].replace("\\", "/").removeprefix(f"{ROOT.as_posix()}/")
    return Finding(
        rule=place["code"], path=path, line=place["location"]["row"], text=place["message"]
    )
