"""Sizes of the sources of error as users state them: a file of their own, or the table `[uncertainty]` of a study."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from myomorph.model.errors import BadData, BadFile
from myomorph.store.settings import settings_of
from myomorph.store.study_file import read_toml
from myomorph.study.trial.step import step_head

STEP = "uncertainty"


def read_sizes(path: Path) -> dict[str, Any]:
    """Settings of the step 'uncertainty' from a TOML file, `name = size`, with or without the heading `[uncertainty]`.

    Raises
    ------
    BadFile
        where it is no TOML, or names something else
    """
    given = read_toml(path)
    given = given.get(STEP, given)
    known = {one.name: one for kind in step_head(STEP).options for one in settings_of(kind)}
    for name, value in given.items():
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"is '{near[0]}' meant?" if near else f"there are {', '.join(known)}"
            raise BadFile(path, f"states the uncertainty of '{name}', which is no source of error", hint)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BadFile(path, f"states '{value}' as the uncertainty '{name}'", "expected a number")
    return {name: known[name].kind(value) for name, value in given.items()}


def drawn_settings(draws: int | None, path: Path | None, workers: int | None = None) -> dict[str, dict[str, Any]]:
    """Settings of the step 'uncertainty' from `--draws`, `--uncertainty` and `--workers`; none without the first two.

    Raises
    ------
    BadData
        workers for nothing, or fewer than one
    """
    if draws is None and path is None:
        if workers is not None:
            raise BadData("--workers without --draws: processes share the draws; say how many there are to be")
        return {}
    if workers is not None and workers < 1:
        raise BadData(f"--workers {workers}: expected 1 or more")
    given = {} if path is None else read_sizes(path)
    options = {"draws": draws, "workers": workers}
    return {STEP: given | {name: value for name, value in options.items() if value is not None}}


def with_uncertainty(raw: Mapping[str, Any], default_steps: tuple[str, ...]) -> Mapping[str, Any]:
    """Tables of a study file with `[uncertainty]` where it means: among the options, and as a step of all subjects."""
    given = raw.get(STEP)
    if not isinstance(given, dict):
        return raw
    options = dict(raw.get("options", {}))
    options[STEP] = given | options.get(STEP, {})
    subjects = []
    for one in raw.get("subject", []):
        steps = one.get("steps", list(default_steps)) if isinstance(one, dict) else None
        subjects.append(one | {"steps": [*steps, STEP]} if isinstance(steps, list) else one)
    return {name: one for name, one in raw.items() if name != STEP} | {"options": options, "subject": subjects}
