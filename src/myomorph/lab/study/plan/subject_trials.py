"""One subject of a study file: its files and its trials, with forces and EMG found by name.

Mistakes go to one list.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from myomorph.core.model.errors import listing
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.store.named_files import existing, matching
from myomorph.lab.study.inputs.beside import plain_stem
from myomorph.lab.study.inputs.input import ByType
from myomorph.lab.study.inputs.keys import Notes, Place
from myomorph.lab.study.inputs.laboratory import Laboratory
from myomorph.lab.study.inputs.table import INPUTS, all_keys, input_of, settings_of_keys
from myomorph.lab.study.plan.measures import Measures
from myomorph.lab.study.plan.subject_tables import (
    Named,
    SubjectTable,
    given_options,
    own_tables,
    study_steps,
    trial_table,
)
from myomorph.lab.study.step.own_table import TableOwner
from myomorph.lab.study.step.step import step_head
from myomorph.lab.study.step.step_table import STEPS
from myomorph.lab.study.subject.subject_files import BodyShape, SubjectFiles
from myomorph.lab.study.trial.trial_inputs import TrialFiles

BEGINS = ("markers", "motion")  # Keys of what a trial begins with.
COORDINATES = (".mot", ".sto")  # Endings of tables of coordinates, with which a trial may begin.
# Steps that hold what they find against the mass of the subject.
NEEDS_MASS = ("refine", "identify")


def measured(
    named: Named, measures: Measures | None, source: str, notes: Notes
) -> tuple[SubjectTable, Path | None]:
    """Return a subject's table completed from the table of measures, and its model.

    The model is None where the table of measures names none. What both tables specify must be the
    same. A chest without a height gives no body shape and is not used.
    """
    table = named.table
    if measures is None:
        if not _names_model(table):
            notes.problems.append(_missing_model(named, f"a column 'model' in {source}"))
        return table, None
    values: dict[str, Any] = {
        name: getattr(measures, name) for name in ("mass", "height", "chest", "sex", "age")
    }
    notes.problems += _disagreements(named, values, measures.model, source)
    if measures.model is None and not _names_model(table):
        notes.problems.append(_missing_model(named, f"a cell 'model' in {source}"))
    if table.skin is None and table.chest is None and not (table.height or values["height"]):
        values["chest"] = None
    known = {name: value for name, value in values.items() if value is not None}
    return table.model_copy(update=known), measures.model


def _names_model(table: SubjectTable) -> bool:
    return table.model is not None or table.model_of is not None


def _missing_model(named: Named, source: str) -> str:
    return f"subject '{named.name}': has no model: give 'model', 'model_of', or {source}"


def _disagreements(
    named: Named, values: Mapping[str, Any], model: Path | None, source: str
) -> Iterator[str]:
    """Yield a line on each value that a subject's table and the table of measures both specify.

    A model must stand in one of them; other values may stand in both where they are the same.
    """
    table = named.table
    where = f"subject '{named.name}'"
    for name, value in values.items():
        own = getattr(table, name)
        if None not in (own, value) and own != value:
            yield f"{where}: {name} is {own} here and {value} in {source}: give it in one of them"
    if model is not None and _names_model(table):
        yield (
            f"{where}: model is '{table.model or table.model_of}' here and '{model.name}' in"
            f" {source}: give it in one of them"
        )


def subject_files(
    named: Named, model: Path | None, trials: tuple[TrialFiles, ...], notes: Notes
) -> SubjectFiles:
    """Return what the steps on a subject need, and whether they come before the others.

    Parameters
    ----------
    named : the subject with its table
    model : file that a table of measures names; None where the subject's own table does
    trials : of the subject
    notes : that take up what is wrong
    """
    table = named.table
    folder = named.folder
    where = f"subject '{named.name}'"
    problems = notes.problems
    _check_steps(table, where, problems)
    files = {
        role: existing(folder, getattr(table, role), f"{where}: {role}", problems)
        for role in ("static", "skin", "landmarks", "generic", "detailed")
    }
    passive = [
        path
        for given in table.passive
        for path in matching(folder, given, f"{where}: passive", problems)
    ]
    _check_content(table, where, notes)
    shared = located(table, "subject", named.place(notes))
    source = model or folder / (table.model or "")
    turn = shared.get("turn", 0.0) if table.static_turn is None else table.static_turn
    return SubjectFiles(
        name=named.name,
        model=source,
        mass=table.mass,
        static=files["static"],
        shape=_body_shape(table, files["skin"], files["landmarks"]),
        trials=trials,
        own=_own_values(table, TableOwner(source, table.mass, named.place(notes))),
        model_of=table.model_of or "",
        labels=shared.get("labels", FrozenMap({})),
        static_laboratory=Laboratory(shared.get("up", ""), turn),
        passive=tuple(passive),
        generic=files["generic"],
        detailed=files["detailed"],
    )


def _is_shaped(table: SubjectTable) -> bool:
    """Return whether a table has a body shape; a height alone is none."""
    return table.skin is not None or table.chest is not None


def _body_shape(table: SubjectTable, skin: Path | None, landmarks: Path | None) -> BodyShape:
    return BodyShape(
        skin=skin,
        landmarks=landmarks,
        height=table.height if _is_shaped(table) else None,
        chest=table.chest,
        sex=table.sex,
        age=table.age,
    )


def _own_values(table: SubjectTable, owner: TableOwner) -> ByType:
    """Read the tables that steps bring, of those that the subject has."""
    values = [
        declared.read(getattr(table, declared.key), owner)
        for declared in own_tables().values()
        if getattr(table, declared.key) is not None
    ]
    return ByType().having(*values)


def _check_content(table: SubjectTable, where: str, notes: Notes) -> None:
    """Report what a subject's table lacks, and what its steps do not use."""
    if "personalize" not in table.steps:
        notes.remarks += [
            f"{where}: '{key}' is not used: step 'personalize' is missing"
            for key in ("passive", "generic")
            if getattr(table, key)
        ]
    if table.skin is None and table.height is None and table.chest is not None:
        notes.problems.append(
            f"{where}: a body shape takes 'height' and 'chest' [m], but 'height' is missing"
        )
    if table.height is not None and not _is_shaped(table) and "identify" in table.steps:
        notes.remarks.append(f"{where}: 'height' without 'chest' gives 'identify' no body shape")
    for step, own_table in own_tables().items():
        if step in table.steps and getattr(table, own_table.key) is None:
            notes.problems.append(
                f"{where}: the step '{step}' needs a table '{own_table.key}' with"
                f" {own_table.content}"
            )
    if ("transfer" in table.steps) != (table.detailed is not None):
        notes.problems.append(
            f"{where}: the step 'transfer' and 'detailed', the model with more joints, go together"
        )


def _check_steps(table: SubjectTable, where: str, problems: list[str]) -> None:
    for step in table.steps:
        if step not in study_steps():
            problems.append(
                f"{where}: unknown step '{step}': there are {listing(step, study_steps())}"
            )
        elif step_head(step).refused:
            problems.append(f"{where}: the step '{step}' cannot run: {step_head(step).refused}")
    for step in dict.fromkeys(table.steps):
        if table.steps.count(step) > 1:
            problems.append(f"{where}: steps: '{step}' is given twice")
    if "ik" not in table.steps:
        problems.append(f"{where}: step 'ik' is missing, which every other step needs")
    for step in STEPS["subject"]:
        later = study_steps()[study_steps().index(step) + 1 :]
        before = table.steps[: table.steps.index(step)] if step in table.steps else []
        early = [one for one in before if one in later]
        if early:
            problems.append(
                f"{where}: steps depend on each other: '{step}' comes after '{early[0]}', which"
                " uses"
                " the model that it makes"
            )
        if step in NEEDS_MASS and step in table.steps and table.mass is None:
            problems.append(f"{where}: the step '{step}' needs the subject's 'mass' [kg]")


def subject_trials(
    named: Named,
    model: Path | None,
    common: Mapping[str, Any],
    left_out: Callable[[str, str], bool],
    notes: Notes,
) -> Iterator[tuple[TrialFiles, dict[str, dict[str, Any]]]]:
    """Yield the trials of a subject, each with what its own table specifies for the steps.

    `common`: what the study specifies for inputs of all subjects, by key; `left_out`: whether the
    study leaves out a trial of a subject; its other files are then not searched for.
    """
    table = named.table
    place = named.place(notes)
    file = existing(named.folder, table.model, f"{place.where}: model", notes.problems)
    if table.emg_gains_file is not None and "emg" in table.steps:
        notes.problems.append(
            f"{place.where}: 'emg_gains_file' and the step 'emg', which finds gains: leave one of"
            " them out"
        )
    if not table.trials:
        notes.problems.append(f"{place.where}: has no trials")
    shared = {**common, **located(table, "subject", place)}
    for trial, recording in _recordings(table, named.folder, place.where, notes.problems):
        name = trial.name or plain_stem(recording)
        if left_out(named.name, name):
            continue
        yield (
            TrialFiles(
                model=model or file or named.folder,
                name=name,
                subject=named.name,
                inputs=_trial_inputs(named, trial, recording, name, shared, notes),
                condition=trial.condition,
            ),
            given_options(trial),
        )


def _trial_inputs(
    subject: Named,
    trial: Any,
    recording: Path,
    name: str,
    shared: Mapping[str, Any],
    notes: Notes,
) -> ByType:
    """Return settings of the inputs of a trial.

    `trial`: its table; `name`: of the trial; `shared`: values that all trials of the subject have,
    by key.
    """
    place = subject.place(notes)
    own = located(trial, "trial", place, leave_out=BEGINS)
    if trial.markers or trial.motion:
        own["markers" if trial.markers else "motion"] = recording
    values = dict(shared) | own
    values |= {
        key: (*shared[key], *own[key])
        for key in own
        if key in shared and all_keys()[key][1].kind.adds
    }
    if own.get("torques") is not None and own.get("loads") is not None:
        notes.problems.append(
            f"{place.where}: {name}: 'torques' and 'loads' are given: give one of them"
        )
    beside = _beside(recording, values, subject.name, notes)
    if not (trial.markers or trial.motion):
        # Sensors do not show where on the plates the feet are.
        beside.pop("loads", None)
    return settings_of_keys(values | beside)


def located(table: Any, per: str, place: Place, leave_out: Sequence[str] = ()) -> dict[str, Any]:
    """Return what a table specifies for inputs, by key, its paths as files.

    `table`: of a subject, a trial, or the whole file, of which only options concern inputs; `per`:
    "subject" or "trial": whose table it is; `leave_out`: keys that are read elsewhere.
    """
    values = {}
    for name, (_, key) in all_keys().items():
        if name in leave_out or key.kind.per not in (per, "both"):
            continue
        step = key.kind.option_of
        options = getattr(table.options, step) if step else None
        if options is not None and name in options.model_fields_set:
            values[name] = key.kind.located(name, getattr(options, name), place)
        elif name in table.model_fields_set:
            if step:
                place.notes.remarks.append(
                    f"{place.where}: '{name}' belongs to [options.{step}]; it is still read here"
                )
            values[name] = key.kind.located(name, getattr(table, name), place)
    return values


def _beside(
    recording: Path, values: Mapping[str, Any], subject: str, notes: Notes
) -> dict[str, Path]:
    """Files that belong to a recording by the rule of names, where nothing else is said."""
    result = {}
    for declared in map(input_of, INPUTS):
        if declared.beside is None or declared.main in values:
            continue
        path, remark = declared.beside(recording, values)
        if remark:
            notes.remarks.append(f"{subject}/{remark}")
        if path is not None and path != recording:
            notes.found.append(f"{subject}/{recording.name}: {declared.main} from {path.name}")
            result[declared.main] = path
    return result


def _recordings(
    table: SubjectTable, folder: Path, where: str, problems: list[str]
) -> Iterator[tuple[Any, Path]]:
    """Yield the recordings that the entries of `trials` name: patterns, files, or tables.

    They are of markers, of coordinates, or of sensors alone.
    """
    trial: Any
    for given in table.trials:
        trial = given
        if isinstance(given, str):
            # A name or a pattern: of coordinates where it ends as tables do, else of markers.
            key = "motion" if Path(given).suffix.lower() in COORDINATES else "markers"
            trial = trial_table()(**{key: given})
        if not (trial.markers or trial.motion) and trial.imu:
            sensors = [
                path for text in trial.imu for path in matching(folder, text, where, problems)
            ]
            yield from ((trial, path) for path in sensors[:1])
            continue
        if bool(trial.markers) == bool(trial.motion):
            problems.append(f"{where}: a trial has one of 'markers' and 'motion', or 'imu'")
            continue
        for recording in matching(folder, trial.markers or trial.motion, where, problems):
            yield trial, recording
