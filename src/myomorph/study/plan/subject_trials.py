"""One subject of a study file: its files and its trials, with forces and EMG found by name; mistakes go to one list."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from myomorph.io.force_table import holds_forces
from myomorph.io.labels import read_labels
from myomorph.model.errors import BadFile, listing
from myomorph.model.frozen_map import FrozenMap
from myomorph.store.study_file import check_time, existing, is_folder, matching
from myomorph.study.inputs.contact_file import AUTO
from myomorph.study.inputs.laboratory import Laboratory
from myomorph.study.plan.measures import Measures
from myomorph.study.plan.subject_tables import Named, SubjectTable, TrialTable, given_options, study_steps
from myomorph.study.step.step_table import STEPS
from myomorph.study.subject.morph_files import bones_of
from myomorph.study.subject.subject_files import BodyShape, SubjectFiles
from myomorph.study.trial.trial_files import TrialFiles

MARKERS = ("markers_", "marker_", "_markers", "_marker", "_trc", "_ik", "ik_", "_coordinates", "_motion")
LOADS = ("grf", "GRF", "external_loads", "external_forces", "externalforces", "ExternalLoads", "loads", "forces")
EMG = ("emg", "EMG", "electromyography", "envelopes")
COORDINATES = (".mot", ".sto")
"""Endings of tables of coordinates, with which a trial may begin."""
NEEDS_MASS = ("refine", "identify")
"""Steps that hold what they find against the mass of the subject."""


def plain_stem(markers: Path) -> str:
    """A recording's name without its ending, and without "markers" before or after it."""
    stem = markers.stem
    for part in MARKERS:
        if part.endswith("_") and stem.lower().startswith(part):
            stem = stem[len(part) :]
        elif part.startswith("_") and stem.lower().endswith(part):
            stem = stem[: -len(part)]
    return stem or markers.stem


def companion(markers: Path, kind: str) -> Path | None:
    """The file of forces ("loads") or EMG ("emg") that belongs to a recording, by its stem, or None.

    With STEM the recording's name (and the same without "markers"), and WORD one of `LOADS` or `EMG`, the
    first of these that exists beside it: STEM_WORD, WORD_STEM, STEM; forces first as an external loads file
    (.xml), then as a table (.mot, .sto); EMG as a table (.sto, .mot, .csv), and never STEM alone.
    """
    words, endings = (LOADS, (".xml", ".mot", ".sto")) if kind == "loads" else (EMG, (".sto", ".mot", ".csv"))
    stems = dict.fromkeys((markers.stem, plain_stem(markers)))
    for ending in endings:
        for stem in stems:
            names = [name for word in words for name in (f"{stem}_{word}", f"{word}_{stem}")]
            if kind == "loads":
                names.append(stem)
            for name in names:
                path = markers.with_name(name + ending)
                if path.is_file():
                    return path
    return None


@dataclass
class Notes:
    """What is found while a study file is being read.

    Attributes
    ----------
    problems : all of them make the file be refused
    remarks : what is not used, or not as one might think
    found : files that were found by the rule of names
    """

    problems: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    found: list[str] = field(default_factory=list)


def measured(named: Named, measures: Measures | None, source: str, notes: Notes) -> tuple[SubjectTable, Path | None]:
    """A subject's table with what the table of measures tells, and its model where that is told there.

    What both tell must be the same; where either height or chest is known, there is no body shape, so neither is used.
    """
    where, table = f"subject '{named.name}'", named.table
    if measures is None:
        if table.model is None and table.model_of is None:
            notes.problems.append(f"{where}: has no model: give 'model', 'model_of', or a column 'model' in {source}")
        return table, None
    told: dict[str, Any] = {name: getattr(measures, name) for name in ("mass", "height", "chest", "sex", "age")}
    for name, value in told.items():
        own = getattr(table, name)
        if None not in (own, value) and own != value:
            notes.problems.append(f"{where}: {name} is {own} here and {value} in {source}: give it in one of them")
    model = measures.model
    if model is not None and (table.model is not None or table.model_of is not None):
        given = table.model or table.model_of
        notes.problems.append(
            f"{where}: model is '{given}' here and '{model.name}' in {source}: give it in one of them"
        )
    if model is None and table.model is None and table.model_of is None:
        notes.problems.append(f"{where}: has no model: give 'model', 'model_of', or a cell 'model' in {source}")
    sizes = [table.height or told["height"], table.chest or told["chest"]]
    if table.skin is None and table.height is None and table.chest is None and None in sizes:
        # Tables of measures often have heights only: no fault, but too little for a body shape.
        told["height"] = told["chest"] = None
    return table.model_copy(update={name: value for name, value in told.items() if value is not None}), model


def subject_files(named: Named, model: Path | None, trials: tuple[TrialFiles, ...], notes: Notes) -> SubjectFiles:
    """What the steps on a subject need, and whether they come before the others.

    Parameters
    ----------
    model : file that a table of measures names; None where the subject's own table does
    """
    table, folder, where, problems = named.table, named.folder, f"subject '{named.name}'", notes.problems
    _check_steps(table, where, problems)
    files = {
        role: existing(folder, name, f"{where}: {role}", problems)
        for role, name in (
            *(("static", table.static), ("skin", table.skin), ("landmarks", table.landmarks)),
            ("generic", table.generic),
        )
    }
    passive = [path for given in table.passive for path in matching(folder, given, f"{where}: passive", problems)]
    if "personalize" not in table.steps:
        notes.remarks += [
            f"{where}: '{key}' is not used: its steps lack 'personalize'"
            for key in ("passive", "generic")
            if getattr(table, key)
        ]
    if table.skin is None and (table.height is None) != (table.chest is None):
        lacking = "chest" if table.chest is None else "height"
        problems.append(f"{where}: a body shape takes 'height' and 'chest' [m], but '{lacking}' is missing")
    if "morph" in table.steps and table.bones is None:
        problems.append(f"{where}: the step 'morph' needs a table 'bones' with the folder of the subject's bones")
    source = model or folder / (table.model or "")
    bones = None if table.bones is None else bones_of(table.bones, source, table.mass, folder, where, problems)
    shape = BodyShape(files["skin"], files["landmarks"], table.height, table.chest, table.sex, table.age)
    return SubjectFiles(
        named.name,
        source,
        table.mass,
        files["static"],
        shape,
        trials,
        bones,
        model_of=table.model_of or "",
        labels=labels_of(table.labels, folder, where, problems),
        static_laboratory=Laboratory(table.up, table.turn if table.static_turn is None else table.static_turn),
        passive=tuple(passive),
        generic=files["generic"],
    )


def _check_steps(table: SubjectTable, where: str, problems: list[str]) -> None:
    for step in table.steps:
        if step not in study_steps():
            problems.append(f"{where}: unknown step '{step}': there are {listing(step, study_steps())}")
    for step in dict.fromkeys(table.steps):
        if table.steps.count(step) > 1:
            problems.append(f"{where}: steps: '{step}' is there twice")
    if "ik" not in table.steps:
        problems.append(f"{where}: steps lack 'ik', which every other step needs")
    for step in STEPS["subject"]:
        later = study_steps()[study_steps().index(step) + 1 :]
        before = table.steps[: table.steps.index(step)] if step in table.steps else []
        early = [one for one in before if one in later]
        if early:
            problems.append(
                f"{where}: steps wait for each other: '{step}' comes after '{early[0]}', which uses the model that "
                "it makes"
            )
        if step in NEEDS_MASS and step in table.steps and table.mass is None:
            problems.append(f"{where}: the step '{step}' needs the subject's 'mass' [kg]")


def subject_trials(
    named: Named, model: Path | None, left_out: Callable[[str, str], bool], notes: Notes
) -> Iterator[tuple[TrialFiles, dict[str, dict[str, Any]]]]:
    """The trials of a subject, each with what its own table says of the steps.

    Parameters
    ----------
    left_out : whether the study leaves out a trial of a subject; its other files are then not looked for
    """
    table, folder, where, problems = named.table, named.folder, f"subject '{named.name}'", notes.problems
    shared = {
        role: existing(folder, name, f"{where}: {role}", problems)
        for role, name in (
            *(("model", table.model), ("tasks", table.tasks), ("actuators", table.actuators)),
            ("emg_gains_file", table.emg_gains_file),
        )
    }
    if table.emg_gains_file is not None and "emg" in table.steps:
        problems.append(f"{where}: 'emg_gains_file' and the step 'emg', which finds gains: leave one of them out")
    reference = [path for given in table.emg_mvc for path in matching(folder, given, f"{where}: emg_mvc", problems)]
    if not table.trials:
        problems.append(f"{where}: has no trials")
    whole = TrialFiles(
        model=model or shared["model"] or folder,
        subject=named.name,
        emg_muscles={channel: tuple(names) for channel, names in table.emg_muscles.items()},
        emg_mvc=tuple(reference),
        emg_side=table.emg_side,
        emg_gains=shared["emg_gains_file"],
        tasks=shared["tasks"],
        actuators=shared["actuators"],
        contacts=contacts_file(table.contacts, folder, where, notes),
        measured=table.measured,
        contact_points=_points(table.contact_points, folder, where, notes),
        mass=table.mass,
        time=table.time,
        labels=labels_of(table.labels, folder, where, problems),
        laboratory=Laboratory(table.up, table.turn),
        assumed=tuple(table.assumed),
    )
    check_time(table.time, f"{where}: time", problems)
    for trial, recording in _recordings(table, folder, where, problems):
        name = trial.name or plain_stem(recording)
        if not left_out(named.name, name):
            begun = replace(whole, name=name, markers=recording)
            begun = replace(begun, markers=None, motion=recording) if trial.motion else begun
            yield _trial(begun, trial, folder, notes), given_options(trial)


def _recordings(
    table: SubjectTable, folder: Path, where: str, problems: list[str]
) -> Iterator[tuple[TrialTable, Path]]:
    """The recordings of markers or coordinates that the entries of `trials` name: patterns, files, or tables."""
    for given in table.trials:
        trial = _of_text(given) if isinstance(given, str) else given
        pattern = trial.markers or trial.motion
        if pattern is None or (trial.markers and trial.motion):
            problems.append(f"{where}: a trial has one of 'markers' and 'motion'")
            continue
        for recording in matching(folder, pattern, where, problems):
            yield trial, recording


def _of_text(given: str) -> TrialTable:
    """A trial that is a name or a pattern: of coordinates where it ends as tables do, else of markers."""
    return TrialTable(motion=given) if Path(given).suffix.lower() in COORDINATES else TrialTable(markers=given)


def _holds_forces(loads: Path) -> bool:
    """Whether a file that was found beside a recording names its forces, or is a table with columns of forces."""
    return loads.suffix.lower() not in (".mot", ".sto") or holds_forces(loads)


def _trial(whole: TrialFiles, trial: TrialTable, folder: Path, notes: Notes) -> TrialFiles:
    """A recording's own files, beside what the subject's table says of all."""
    where, problems = f"subject '{whole.subject}'", notes.problems
    torques = None
    if trial.torques is not None:
        torques = existing(folder, trial.torques, f"{where}: torques", problems)
        if trial.loads is not None:
            problems.append(f"{where}: {whole.name}: 'torques' and 'loads' are given: give one of them")
    # Torques that are given hold what the forces do, so none are looked for beside the recording.
    loads = None if torques is not None else _companion(whole, folder, trial.loads, "loads", notes)
    if loads is not None and trial.loads is None and not trial.bodies and not _holds_forces(loads):
        notes.found.pop()
        notes.remarks.append(f"{whole.subject}/{loads.name} is not used: no columns of forces are found in it")
        loads = None
    check_time(trial.time, f"{where}: time", problems)
    for name, span in trial.phases.items():
        check_time(span, f"{where}: phase '{name}'", problems)
    return replace(
        whole,
        loads=loads,
        torques=torques,
        bodies=FrozenMap(dict(trial.bodies)),
        plates=tuple(trial.plates),
        emg=_companion(whole, folder, trial.emg, "emg", notes),
        contacts=contacts_file(trial.contacts, folder, where, notes) if trial.contacts else whole.contacts,
        measured=trial.measured or whole.measured,
        contact_points=_points(trial.contact_points, folder, where, notes) or whole.contact_points,
        phases=FrozenMap(dict(trial.phases)),
        time=trial.time or whole.time,
        condition=trial.condition,
        laboratory=Laboratory(
            whole.laboratory.up if trial.up is None else trial.up,
            whole.laboratory.turn if trial.turn is None else trial.turn,
        ),
        assumed=(*whole.assumed, *trial.assumed),
    )


def _companion(whole: TrialFiles, folder: Path, given: str | None, kind: str, notes: Notes) -> Path | None:
    """The forces or EMG of a trial: as given, or found by its stem."""
    if given is not None:
        return existing(folder, given, f"subject '{whole.subject}': {kind}", notes.problems)
    recording = whole.markers or whole.motion
    assert recording is not None
    result = companion(recording, kind)
    if result is None or result == recording:
        return None
    notes.found.append(f"{whole.subject}/{recording.name}: {kind} from {result.name}")
    return result


def _points(given: str, folder: Path, where: str, notes: Notes) -> str:
    """What tells of contact points: "auto", or a folder or file as a path that can be opened."""
    if given in ("", AUTO) or is_folder(folder / given):
        return given if given in ("", AUTO) else str(folder / given)
    return str(existing(folder, given, f"{where}: contact_points", notes.problems) or "")


def contacts_file(given: str, folder: Path, where: str, notes: Notes) -> str:
    """What tells of contacts: "auto", or a file as a path that can be opened."""
    if given in ("", AUTO):
        return given
    found = existing(folder, given, f"{where}: contacts", notes.problems)
    if found is None:
        return ""
    return str(found)


def labels_of(given: Mapping[str, str] | str, folder: Path, where: str, problems: list[str]) -> Mapping[str, str]:
    """Labels of a study file: a table of its own, or a file that holds one."""
    if not isinstance(given, str):
        return FrozenMap(dict(given))
    path = existing(folder, given, f"{where}: labels", problems)
    try:
        return FrozenMap({} if path is None else read_labels(path))
    except BadFile as error:
        problems.append(f"{where}: labels: {error}")
        return FrozenMap({})
