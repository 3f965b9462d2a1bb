"""A file in TOML and its problems, without what checks its keys: that takes long to import."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from myomorph.core.io.parsing.door import content_of
from myomorph.core.model.errors import BadFile

MAX_PROBLEMS = 200  # Of a file that are printed


def read_toml(path: Path) -> dict[str, Any]:
    """Read the tables of a study file."""
    try:
        return tomllib.loads(content_of(path, "settings").decode("utf-8"))
    except UnicodeDecodeError:
        raise BadFile(path, "is not text", "give a study file in TOML") from None
    except (ValueError, RecursionError) as error:
        # Not only of `tomllib`: a whole number of thousands of digits is refused by `int`.
        raise BadFile(path, f"is not TOML: {error}", "see docs/studies.md for an example") from None


def refuse(path: Path, problems: Sequence[str]) -> None:
    """Raise `BadFile` with all problems in one line, where there are any."""
    if problems:
        count = f"{len(problems)} problems" if len(problems) > 1 else "1 problem"
        lines = list(problems[:MAX_PROBLEMS])
        if len(problems) > MAX_PROBLEMS:
            lines.append(f"and {len(problems) - MAX_PROBLEMS} more")
        raise BadFile(path, f"{count}: " + " | ".join(lines))
