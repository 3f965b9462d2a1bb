"""Checks of a study whose tables are each right.

They find clashing names, models in a circle, and unknown names in options that only the model
knows.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

from myomorph.core.io.parsing.door import content_of
from myomorph.core.model.errors import BadFile, MyomorphError, listing
from myomorph.core.model.model import GROUND, Model
from myomorph.lab.store.results import file_name
from myomorph.lab.study.inputs.reading import open_model
from myomorph.lab.study.inputs.table import input_of, inputs_of
from myomorph.lab.study.step.step import step_of
from myomorph.lab.study.step.step_table import STEPS
from myomorph.lab.study.subject.subject_files import SubjectFiles
from myomorph.lab.study.trial.trial_inputs import TrialFiles

RESERVED = (
    "con",
    "prn",
    "aux",
    "nul",
    *(f"{port}{number}" for port in ("com", "lpt") for number in "123456789¹²³"),
)
"""Names that Windows gives to devices, with any ending."""

OF_STUDY = (
    "results.csv",
    "results.parquet",
    "results_tidy.csv",
    "quality.csv",
    "messages.csv",
    "condition_curves.csv",
    "condition_values.csv",
    "differences.csv",
    "value_differences.csv",
    "outliers.csv",
    "timings.csv",
    "study.html",
    "study.json",
    "study.log",
    "study.toml",
    "tables_provenance.json",
    "groups_provenance.json",
    "groups.html",
    "group_parameters.csv",
    "group_curves.csv",
    "group_values.csv",
    "group_strides.csv",
)
"""Files of the results' folder, whose names no subject can have."""

# Signs of a name: it is there twice in the path of a result, and Windows takes 260 in all.
LONGEST = 100


def folder_key(name: str) -> str:
    """Return a folder's name as a file system sees it that knows no case.

    Windows drops dots at the end as well.
    """
    return unicodedata.normalize("NFC", file_name(name)).rstrip(". ").casefold()


def check_names(
    trials: Sequence[TrialFiles],
    steps: Mapping[str, Sequence[str]],
    together: Sequence[str],
    problems: list[str],
    flat: bool = False,
) -> None:
    """Add to the problems the names that cannot be folders, and those that share a folder.

    `steps`: of every subject, by name; `together`: names of trials that are solved as one; `flat`:
    folders of trials lie beside the study's own files.
    """
    named = [(f"subject '{name}'", name) for name in steps] + [
        (f"together '{name}'", name) for name in together
    ]
    for what, name in named:
        _possible(name, what, (*OF_STUDY, *STEPS["study"]), problems)
    _clashes(named, problems)
    for subject, own in steps.items():
        steps_on = [step_of(step, "subject") for step in STEPS["subject"] if step in own]
        written = (
            path.split("/")[0] for step in steps_on for path in (step.tables, *step.leaves.values())
        )
        made = [*dict.fromkeys(written), *(OF_STUDY if flat else ())]
        own_trials = [trial.name for trial in trials if trial.subject == subject]
        for name in dict.fromkeys(own_trials):
            _possible(name, f"subject '{subject}': trial '{name}'", made, problems)
            if own_trials.count(name) > 1:
                problems.append(
                    f"subject '{subject}' has two trials named '{name}': give one a 'name'"
                )
        _clashes(
            [(f"subject '{subject}': trial '{name}'", name) for name in dict.fromkeys(own_trials)],
            problems,
        )


def _possible(name: str, what: str, taken: Sequence[str], problems: list[str]) -> None:
    key = folder_key(name)
    if not key.strip("._"):
        problems.append(
            f"{what}: cannot be the name of a folder: give it a 'name' with letters or digits"
        )
    elif key.split(".")[0] in RESERVED:
        problems.append(
            f"{what}: '{key.split('.')[0]}' is a device name on Windows: give it another 'name'"
        )
    elif key in taken:
        problems.append(
            f"{what}: results already have a file or folder '{key}' there: give it another 'name'"
        )
    elif len(name) > LONGEST:
        problems.append(
            f"{what}: its name has {len(name)} characters, at most {LONGEST} are possible: give it"
            " a"
            " 'name'"
        )


def _clashes(named: Sequence[tuple[str, str]], problems: list[str]) -> None:
    """Names that differ, but whose folders would not."""
    first: dict[str, str] = {}
    for what, name in named:
        other = first.setdefault(folder_key(name), what)
        if other != what:
            problems.append(
                f"{other} and {what} would write the same folder '{file_name(name)}': rename one of"
                " them"
            )


def makes_model(steps: Sequence[str]) -> bool:
    """Whether a subject's own steps make the model that its trials use."""
    return bool(set(steps) & set(STEPS["subject"]))


def maker_of(
    name: str, subjects: Mapping[str, SubjectFiles], steps: Mapping[str, Sequence[str]]
) -> str:
    """Return the subject whose own steps make the model that another begins with.

    It is "" where that begins with a file.
    """
    maker = subjects[name].model_of
    while maker and not makes_model(steps[maker]):
        maker = subjects[maker].model_of
    return maker


def check_makers(
    subjects: Mapping[str, SubjectFiles], steps: Mapping[str, Sequence[str]], problems: list[str]
) -> None:
    """Add to the problems the subjects that wait for a model that is never made.

    They wait for each other's models, or for one that nobody makes.
    """
    circles: list[set[str]] = []
    for name, files in subjects.items():
        if not files.model_of:
            continue
        if files.model_of not in subjects:
            exist = listing(files.model_of, tuple(subjects))
            problems.append(
                f"subject '{name}': model_of: no subject '{files.model_of}': there are {exist}"
            )
            continue
        chain = [name]
        while (following := subjects[chain[-1]].model_of) in subjects and following not in chain:
            chain.append(following)
        circle = chain[chain.index(following) :] if following in chain else []
        if circle and set(circle) not in circles:
            circles.append(set(circle))
            waiting = " waits for ".join(f"'{one}'" for one in (*circle, circle[0]))
            problems.append(f"model_of: subjects need each other's models: {waiting}")
        elif not following and not any(makes_model(steps[one]) for one in chain[1:]):
            problems.append(
                f"subject '{name}': model_of: subject '{chain[-1]}' makes no model: give it one of"
                f" the steps {', '.join(STEPS['subject'])}, or give this one its 'model'"
            )


def check_masses(subjects: Mapping[str, SubjectFiles], problems: list[str]) -> None:
    """Add to the problems the subjects without a mass where others have one."""
    without = [name for name, subject in subjects.items() if subject.mass is None]
    if without and len(without) < len(subjects):
        known = len(subjects) - len(without)
        problems += [
            f"subject '{name}': has no 'mass' [kg], but {known} of {len(subjects)} have one"
            for name in without
            if not any(f"subject '{name}'" in problem and "mass" in problem for problem in problems)
        ]


def check_model_names(trials: Sequence[TrialFiles], problems: list[str]) -> None:
    """Add to the problems the names that no part of a trial's model has.

    A name that stands in the model's file is taken for right without reading the model, so that a
    study of many models is still checked at once. A model that cannot be read is reported when its
    trials run.
    """
    text_of = cache(_text)
    model_of = cache(_model)
    seen: set[tuple[str, Path, str, str]] = set()
    for trial in trials:
        for kind, what, name in _named_in(trial):
            key = (trial.subject, trial.model, kind, name)
            if key in seen:
                continue
            seen.add(key)
            text = text_of(trial.model)
            if f'"{name}"' in text or f"'{name}'" in text:
                continue
            model = model_of(trial.model)
            if model is None or name in (known := _names(kind, model)):
                continue
            where = f"subject '{trial.subject}': {what}"
            problems.append(
                f"{where}: unknown {kind} '{name}': {trial.model.name} has {listing(name, known)}"
            )


def _named_in(trial: TrialFiles) -> Iterator[tuple[str, str, str]]:
    """Kind, key of the study file and name of all that must be the model's."""
    for input_name, settings in inputs_of(trial.inputs).items():
        for key in input_of(input_name).keys:
            for kind, name in key.kind.parts(getattr(settings, key.name)):
                if name != GROUND:
                    yield kind, key.name, name


def _names(kind: str, model: Model) -> tuple[str, ...]:
    if kind == "body":
        return tuple(body.name for body in model.bodies)
    return tuple(marker.name for marker in (model.markers if kind == "marker" else model.muscles))


def _text(path: Path) -> str:
    """Read a model's file as text, names as they stand in XML."""
    try:
        return content_of(path, "XML").decode("utf-8", errors="replace")
    except BadFile:
        return ""


def _model(path: Path) -> Model | None:
    try:
        return open_model(path)
    except MyomorphError:
        return None
