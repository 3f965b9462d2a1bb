"""Sizes of the sources of error as users state them.

They are a file of their own, or the table `[uncertainty]` of a study.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from myomorph.core.model.errors import BadData, BadFile, unknown
from myomorph.lab.store.settings import settings_of
from myomorph.lab.store.toml_file import read_toml
from myomorph.lab.study.step.step import step_head

STEP = "uncertainty"


def read_sizes(path: Path) -> dict[str, Any]:
    """Read settings of the step 'uncertainty' from a TOML file.

    It holds `name = size`, with or without heading `[uncertainty]`.
    """
    sizes = read_toml(path)
    sizes = sizes.get(STEP, sizes)
    known = {
        setting.name: setting.kind
        for kind in step_head(STEP).options
        for setting in settings_of(kind)
    }
    for name, value in sizes.items():
        if name not in known:
            raise BadFile(path, unknown("source of error", name, known))
        if known[name] is bool and not isinstance(value, bool):
            raise BadFile(path, f"states '{value}' as '{name}'", "expected true or false")
        if known[name] is not bool and (
            isinstance(value, bool) or not isinstance(value, int | float)
        ):
            raise BadFile(
                path, f"states '{value}' as the uncertainty '{name}'", "expected a number"
            )
    return {name: known[name](value) for name, value in sizes.items()}


def drawn_settings(
    draws: int | None, path: Path | None, workers: int | None = None
) -> dict[str, dict[str, Any]]:
    """Return settings of the step 'uncertainty' from options of a command.

    There are none without `--draws` and `--uncertainty`.
    """
    options = {"draws": draws, "workers": workers}
    settings = {name: value for name, value in options.items() if value is not None}
    if draws is None and path is None:
        for name, value in settings.items():
            raise BadData(
                f"--{name} {value} without --draws: give the number of draws (--draws 200)"
            )
        return {}
    if workers is not None and workers < 1:
        raise BadData(f"--workers {workers}: expected 1 or more")
    return {STEP: ({} if path is None else read_sizes(path)) | settings}


def with_uncertainty(raw: Mapping[str, Any], default_steps: tuple[str, ...]) -> Mapping[str, Any]:
    """Return tables of a study file with `[uncertainty]` where it belongs.

    It belongs among the options, and as a step of all subjects.
    """
    sizes = raw.get(STEP)
    if not isinstance(sizes, dict):
        return raw
    options = dict(raw.get("options", {}))
    options[STEP] = sizes | options.get(STEP, {})
    subjects = []
    for subject in raw.get("subject", []):
        steps = subject.get("steps", list(default_steps)) if isinstance(subject, dict) else None
        subjects.append(subject | {"steps": [*steps, STEP]} if isinstance(steps, list) else subject)
    return {name: table for name, table in raw.items() if name != STEP} | {
        "options": options,
        "subject": subjects,
    }
