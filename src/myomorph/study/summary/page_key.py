"""Whether the tables and pages of a study are those of its trials: their key stands in the page, written last."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import astuple
from pathlib import Path

from myomorph import __version__
from myomorph.store.netcdf import open_netcdf
from myomorph.store.outcome import Outcome
from myomorph.store.results import DAMAGED, STORED, file_name, file_source, made_from, value_source
from myomorph.study.plan.groups import GroupPlan
from myomorph.study.plan.plan import Plan
from myomorph.study.trial.reuse import KEY

END = "</body>"
_KEY = re.compile(rb"<!-- made of ([0-9a-f]{64}) -->\s*</body>\s*</html>\s*\Z")


def with_key(page: str, key: str) -> str:
    """A page that tells what it and the tables beside it were made of."""
    before, end, after = page.rpartition(END)
    return f"{before}<!-- made of {key} -->\n{end}{after}"


def made_of(page: Path, key: str) -> bool:
    """Whether a page tells that it was made of this."""
    try:
        with page.open("rb") as stream:
            stream.seek(max(0, page.stat().st_size - 200))
            match = _KEY.search(stream.read())
    except OSError:
        return False
    return match is not None and match.group(1).decode() == key


def tables_key(plan: Plan, outcomes: Iterable[Outcome], own: Sequence[str], made: Iterable[Path]) -> str:
    """Hash of what the tables of a study are made of, and of the tables.

    Parameters
    ----------
    own : names of the tables that each trial has
    made : the tables of the study
    """
    trials = [
        (
            outcome.key,
            outcome.condition,
            outcome.done,
            outcome.error,
            outcome.frames,
            outcome.changed,
            _hashes(outcome.folder / name for name in own),
        )
        for outcome in outcomes
    ]
    planned = [(trial.subject, trial.name, trial.condition) for trial in plan.trials]
    values = (plan.name, planned, [one.name for one in plan.together], plan.groups is None, list(plan.conditions.names))
    left = [astuple(one) for one in plan.excluded]
    conditions = sorted(plan.conditions.trials.items())
    return value_source("tables", "", __version__, values, left, conditions, trials, _hashes(made)).sha256


def groups_key(plan: GroupPlan, name: str, out: Path, made: Iterable[Path]) -> str:
    """The same for two groups, from what the results of their trials were made of."""
    results = []
    for subject in (*plan.first[1], *plan.second[1]):
        for trial in plan.trials[subject]:
            results.append(_result_key(out / file_name(subject) / file_name(trial) / f"{file_name(trial)}{STORED}"))
    values = (plan.first, plan.second, sorted(plan.trials.items()), plan.strides)
    return value_source("groups", name, __version__, name, values, results, _hashes(made)).sha256


def _result_key(path: Path) -> tuple[object, ...]:
    try:
        with open_netcdf(path) as file:
            attributes = file.attributes
        return attributes.get(KEY, ""), sorted((step, one.key) for step, one in made_from(attributes).items())
    except DAMAGED:
        return ()


def _hashes(paths: Iterable[Path]) -> tuple[str, ...]:
    """Hash of each file, "" for one that is not there."""
    return tuple(file_source("", path).sha256 if path.is_file() else "" for path in paths)
