"""A file in TOML and its problems, without what checks its keys: that takes long to import."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from myomorph.core.model.errors import BadFile, listing

MAX_PROBLEMS = 200  # Of a file that are printed


def read_toml(path: Path) -> dict[str, Any]:
    """Read the tables of a study file."""
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8"))
    except OSError as error:
        beside = (
            sorted(file.name for file in path.parent.glob("*.toml")) if path.parent.is_dir() else []
        )
        hint = (
            f"{path.parent} has {listing(path.name, beside)}"
            if beside
            else "give a study file in TOML"
        )
        raise BadFile(path, f"cannot be read ({error.strerror or error})", hint) from None
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
