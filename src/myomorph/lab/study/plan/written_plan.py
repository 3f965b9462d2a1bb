"""A plan as the text of a study file, which `read_plan` reads as the same plan."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

from myomorph.core.io.parsing.toml import toml_text
from myomorph.lab.study.inputs.keys import relative
from myomorph.lab.study.inputs.laboratory import Laboratory
from myomorph.lab.study.inputs.table import all_keys
from myomorph.lab.study.plan.plan import Plan
from myomorph.lab.study.subject.subject_files import SubjectFiles
from myomorph.lab.study.trial.trial_inputs import TrialFiles
from myomorph.lab.study.trial.uncertainty_file import STEP as UNCERTAINTY

MARK = "# As it was written: "
"""Before the digest of all lines above, which says whether somebody has changed the file since."""


def study_text(plan: Plan, folder: Path, head: Sequence[str] = ()) -> str:
    """Write the study file of subjects that begin with models in files, as text.

    Conditions are not written. What an input says of all trials of a subject stands once, else in
    their tables. `folder`: that the file will lie in; paths are relative to it; `head`: lines of
    comment at the top.
    """
    document: dict[str, Any] = {
        "study": {"name": plan.name} | ({"flat": True} if plan.flat else {})
    }
    settings = {step: dict(values) for step, values in plan.settings.items() if values}
    if UNCERTAINTY in settings:
        document[UNCERTAINTY] = settings.pop(UNCERTAINTY)
    shared = {name: _shared(files, files.trials) for name, files in plan.subjects.items()}
    # Keys among options hold for all where there is one subject.
    only = next(iter(shared.values())) if len(shared) == 1 else {}
    _put_options(document, settings, only, folder)
    document["subject"] = [
        _subject(plan, files, shared[name], folder) for name, files in plan.subjects.items()
    ]
    text = toml_text(document, head)
    return f"{text}{MARK}{_digest(text)}\n"


def is_unchanged(text: str) -> bool:
    """Whether a study file is still as `study_text` made it, so that nothing is lost with it."""
    body, mark, digest = text.rpartition(MARK)
    return bool(mark) and digest.strip() == _digest(body)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _subject(
    plan: Plan, files: SubjectFiles, shared: Mapping[str, Any], folder: Path
) -> dict[str, Any]:
    """Return the table of the subject, those of its trials last."""
    table: dict[str, Any] = {"name": files.name, "model": relative(files.model, folder)}
    if files.mass is not None:
        table["mass"] = files.mass
    table["steps"] = [step for step in plan.steps_of(files.name) if step != UNCERTAINTY]
    if files.static is not None:
        table["static"] = relative(files.static, folder)
        if files.static_laboratory.turn != shared.get("turn", 0.0):
            table["static_turn"] = files.static_laboratory.turn
    _put_inputs(table, shared, folder)
    if len(plan.subjects) > 1:
        _put_options(table, {}, shared, folder)
    trials = []
    for trial in files.trials:
        usual = {name: key.default for name, (_, key) in all_keys().items()} | dict(shared)
        own = {name: value for name, value in _values(trial).items() if value != usual[name]}
        for name in [name for name in own if all_keys()[name][1].kind.adds]:
            own[name] = own[name][len(shared.get(name, ())) :]
        entry: dict[str, Any] = {"name": trial.name}
        _put_inputs(entry, own, folder)
        _put_options(entry, {}, own, folder)
        trials.append(entry)
    table["trials"] = trials
    return table


def _shared(files: SubjectFiles, trials: Sequence[TrialFiles]) -> dict[str, Any]:
    """Return what inputs say of all trials, by key.

    The axis that points up is that of the static recording where there is one.
    """
    shared: dict[str, Any] = {}
    keys = all_keys()
    for name, first in _values(trials[0]).items():
        declared, key = keys[name]
        values = [_values(trial)[name] for trial in trials]
        if declared.settings is Laboratory and name == "up" and files.static is not None:
            shared[name] = files.static_laboratory.up
        elif key.kind.adds:
            alike = takewhile(lambda parts: len(set(parts)) == 1, zip(*values, strict=False))
            shared[name] = tuple(parts[0] for parts in alike)
        elif key.kind.per != "trial" and values.count(first) == len(values):
            shared[name] = first
    return {name: value for name, value in shared.items() if value != keys[name][1].default}


def _values(trial: TrialFiles) -> dict[str, Any]:
    """Return what inputs say of a trial, by key; the mass is the subject's."""
    return {
        name: getattr(trial.get(declared.settings), name)
        for name, (declared, _) in all_keys().items()
        if name != "mass"
    }


def _put_options(
    table: dict[str, Any], settings: Mapping[str, Any], values: Mapping[str, Any], folder: Path
) -> None:
    """Put settings of steps, and keys of inputs among them, into the options of a table."""
    by_step = {step: dict(said) for step, said in settings.items()}
    for name, value in values.items():
        kind = all_keys()[name][1].kind
        if kind.option_of:
            by_step.setdefault(kind.option_of, {})[name] = kind.written(value, folder)
    if by_step:
        table["options"] = by_step


def _put_inputs(table: dict[str, Any], values: Mapping[str, Any], folder: Path) -> None:
    """Put values of keys into a table, but those that stand among the options of steps."""
    for name, value in values.items():
        kind = all_keys()[name][1].kind
        if not kind.option_of:
            table[name] = kind.written(value, folder)
