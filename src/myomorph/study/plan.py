"""A study file: what is to be done with which files, checked as a whole before anything runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from pydantic import Field, create_model

from myomorph.model.errors import BadFile, listing
from myomorph.study.body_shape import BodyOptions, BodyShape
from myomorph.study.contact_file import AUTO
from myomorph.study.group_plan import GroupPlan, StridesTable, groups_of
from myomorph.study.jobs import Conditions, Excluded
from myomorph.study.morph_files import BonesTable, bones_of
from myomorph.study.settings import (
    Differentiation,
    EmgUse,
    Measured,
    ReportOptions,
    Setting,
    Side,
    TensionTables,
    TorqueTable,
    settings_of,
)
from myomorph.study.study_file import (
    Strict,
    StudyTable,
    check_time,
    checked,
    existing,
    matching,
    options_table,
    read_toml,
    refuse,
)
from myomorph.study.subjects import SUBJECT_STEPS, SubjectFiles
from myomorph.study.takes import FileTake
from myomorph.study.together import Together, TogetherTable, together_of

STEPS = ("morph", "calibrate", "ik", "identify", "id", "muscles", "tension", "report")
MARKERS = ("markers_", "marker_", "_markers", "_marker", "_trc")
LOADS = ("grf", "GRF", "external_loads", "external_forces", "externalforces", "ExternalLoads", "loads", "forces")
EMG = ("emg", "EMG", "electromyography", "envelopes")


def step_settings() -> dict[str, tuple[Setting, ...]]:
    """Settings of every step, by its name."""
    from myomorph.identify.recordings import RecordingOptions
    from myomorph.identify.subject import IdentificationOptions
    from myomorph.morph.fields import MapOptions
    from myomorph.morph.morphed import MorphOptions
    from myomorph.morph.nonrigid import MatchOptions
    from myomorph.motion.calibrate import CalibrationOptions
    from myomorph.motion.crossings import CrossingOptions
    from myomorph.motion.envelope import EnvelopeOptions
    from myomorph.motion.ik import InverseKinematicsOptions
    from myomorph.tension.contacts import ContactOptions
    from myomorph.tension.emg_targets import EmgOptions
    from myomorph.tension.solve import TensionOptions

    identification = (RecordingOptions, IdentificationOptions, BodyOptions)
    tension = (TensionOptions, ContactOptions, EmgOptions, EnvelopeOptions, EmgUse, TensionTables)
    morph = (MatchOptions, MapOptions, MorphOptions)
    kinematics = tuple(one for one in settings_of(InverseKinematicsOptions) if one.name != "only_weighted")
    filters = settings_of(Differentiation)
    return {
        "morph": tuple(one for options in morph for one in settings_of(options)),
        "calibrate": tuple(one for one in settings_of(CalibrationOptions) if one.name != "mass"),
        "identify": tuple(one for options in identification for one in settings_of(options)),
        "ik": (*kinematics, *settings_of(CrossingOptions)),
        "id": (*filters, *settings_of(TorqueTable)),
        "muscles": filters,
        "report": settings_of(ReportOptions),
        "tension": (*filters, *(one for options in tension for one in settings_of(options))),
    }


class _Trial(Strict):
    """A trial given by a table, where its files do not follow the rule of names."""

    markers: str
    name: str = ""
    loads: str | None = None
    bodies: dict[str, str] = Field(default_factory=dict)
    plates: list[str] = Field(default_factory=list)
    emg: str | None = None
    contacts: str = ""
    measured: Measured | None = None
    phases: dict[str, tuple[float, float]] = Field(default_factory=dict)
    time: tuple[float, float] | None = None


class _Subject(Strict):
    name: str
    model: str
    mass: float | None = Field(default=None, gt=0.0)
    trials: list[str | _Trial]
    steps: list[str] = Field(default_factory=lambda: [step for step in STEPS if step not in SUBJECT_STEPS])
    static: str | None = None
    skin: str | None = None
    landmarks: str | None = None
    height: float | None = Field(default=None, gt=0.0)
    chest: float | None = Field(default=None, gt=0.0)
    sex: Literal["female", "male"] | None = None
    age: float | None = Field(default=None, gt=0.0)
    emg_muscles: dict[str, list[str]] = Field(default_factory=dict)
    emg_reference: list[str] = Field(default_factory=list)
    emg_side: Side = ""
    tasks: str | None = None
    actuators: str | None = None
    contacts: str = ""
    measured: Measured | None = None
    time: tuple[float, float] | None = None
    labels: dict[str, str] = Field(default_factory=dict)
    bones: BonesTable | None = None


@dataclass(frozen=True)
class Plan:
    """What a study does: one `FileTake` a trial, and what the steps are told.

    Attributes
    ----------
    settings : by step, only what the study file says
    steps : of each take, in the order in which they run
    subjects : by name, what the steps on subjects need
    together : trials of several subjects that are solved as one after their own steps
    remarks : which files were found by the rule of names
    groups : two groups of subjects to compare when all is done
    conditions : of the trials
    excluded : what the study file leaves out, and why
    """

    name: str
    path: Path
    takes: tuple[FileTake, ...]
    steps: tuple[tuple[str, ...], ...]
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: MappingProxyType({}))
    remarks: tuple[str, ...] = ()
    subjects: Mapping[str, SubjectFiles] = field(default_factory=lambda: MappingProxyType({}))
    together: tuple[Together, ...] = ()
    groups: GroupPlan | None = None
    conditions: Conditions = field(default_factory=Conditions)
    excluded: tuple[Excluded, ...] = ()


def read_plan(path: str | Path) -> Plan:
    """Read a study file; paths in it are relative to its folder.

    Raises
    ------
    BadFile
        where it is no TOML, or with one list of all that is wrong: unknown keys and steps, values of the
        wrong kind, files that do not exist, patterns that no file matches
    """
    path = Path(path)
    options = options_table(step_settings())
    file = create_model(
        "StudyFile",
        __base__=Strict,
        study=(StudyTable, ...),
        subject=(list[_Subject], Field(min_length=1)),
        together=(list[TogetherTable], Field(default_factory=list)),
        groups=(dict[str, list[str]], Field(default_factory=dict)),
        strides=(StridesTable, Field(default_factory=StridesTable)),
        options=(options, Field(default_factory=options)),
    )
    raw = read_toml(path)
    if "specimen" in raw and "subject" not in raw:
        raise BadFile(path, "describes specimens, not subjects", "run it with 'myomorph viscosity'")
    found, problems = checked(file, raw)
    takes: list[FileTake] = []
    steps: list[tuple[str, ...]] = []
    remarks: list[str] = []
    subjects: dict[str, SubjectFiles] = {}
    together: list[Together] = []
    groups: GroupPlan | None = None
    if found is not None:
        for subject in found.subject:
            own = list(_takes(subject, path.parent, problems, remarks))
            takes += own
            steps += [tuple(step for step in STEPS if step in subject.steps)] * len(own)
            if subject.name in subjects and set(SUBJECT_STEPS) & set(subject.steps):
                problems.append(f"subject '{subject.name}' is there twice: put its trials into one table")
            subjects[subject.name] = _subject(subject, own, path.parent, problems)
        _distinct(takes, problems)
        for one in found.together:
            contacts = _contacts(one.contacts, path.parent, f"together '{one.name}'", problems)
            together.append(together_of(one, takes, path.parent, contacts, problems))
        trials = {one: [take.name for take in takes if take.subject == one] for one in subjects}
        groups = groups_of(found.groups, found.strides, trials, problems)
    refuse(path, problems)
    assert found is not None
    settings = {step: one for step, one in found.options.model_dump(exclude_unset=True).items() if one}
    return Plan(
        found.study.name,
        path,
        tuple(takes),
        tuple(steps),
        MappingProxyType(settings),
        tuple(remarks),
        subjects,
        tuple(together),
        groups,
    )


def _subject(subject: _Subject, takes: list[FileTake], folder: Path, problems: list[str]) -> SubjectFiles:
    """What the steps on a subject need, and whether they come before the others."""
    where = f"subject '{subject.name}'"
    for step in SUBJECT_STEPS:
        later = STEPS[STEPS.index(step) + 1 :]
        before = subject.steps[: subject.steps.index(step)] if step in subject.steps else []
        early = [one for one in before if one in later]
        if early:
            problems.append(f"{where}: steps: '{step}' comes after '{early[0]}', which uses the model that it makes")
    files = {
        role: existing(folder, name, f"{where}: {role}", problems)
        for role, name in (("static", subject.static), ("skin", subject.skin), ("landmarks", subject.landmarks))
    }
    if subject.skin is None and (subject.height is None) != (subject.chest is None):
        lacking = "chest" if subject.chest is None else "height"
        problems.append(f"{where}: a body shape takes 'height' and 'chest' [m], but '{lacking}' is missing")
    if "morph" in subject.steps and subject.bones is None:
        problems.append(f"{where}: the step 'morph' needs a table 'bones' with the folder of the subject's bones")
    bones = (
        None
        if subject.bones is None
        else bones_of(subject.bones, folder / subject.model, subject.mass, folder, where, problems)
    )
    shape = BodyShape(files["skin"], files["landmarks"], subject.height, subject.chest, subject.sex, subject.age)
    return SubjectFiles(subject.name, folder / subject.model, subject.mass, files["static"], shape, tuple(takes), bones)


def _takes(subject: _Subject, folder: Path, problems: list[str], remarks: list[str]) -> Iterator[FileTake]:
    where = f"subject '{subject.name}'"
    for step in subject.steps:
        if step not in STEPS:
            problems.append(f"{where}: unknown step '{step}': there are {listing(step, STEPS)}")
    if "ik" not in subject.steps:
        problems.append(f"{where}: steps lack 'ik', which every other step needs")
    shared = {
        role: existing(folder, name, f"{where}: {role}", problems)
        for role, name in (("model", subject.model), ("tasks", subject.tasks), ("actuators", subject.actuators))
    }
    reference = [
        path for one in subject.emg_reference for path in matching(folder, one, f"{where}: emg_reference", problems)
    ]
    if not subject.trials:
        problems.append(f"{where}: has no trials")
    for given in subject.trials:
        for trial, markers in _matches(given, folder, where, problems):
            remarks_before = len(remarks)
            loads = _companion(folder, trial.loads, markers, "loads", f"{where}: loads", problems, remarks)
            emg = _companion(folder, trial.emg, markers, "emg", f"{where}: emg", problems, remarks)
            check_time(trial.time or subject.time, f"{where}: time", problems)
            for name, span in trial.phases.items():
                check_time(span, f"{where}: phase '{name}'", problems)
            if loads is not None and loads.suffix.lower() not in (".xml", ".toml") and not trial.bodies:
                if trial.loads is None:
                    del remarks[remarks_before:]
                    remarks.append(f"{loads.name} is not used: it does not say which bodies its forces act on")
                    loads = None
                else:
                    problems.append(f"{where}: {loads.name} needs 'bodies': prefix of its columns = body")
            assert shared["model"] is not None or problems
            yield FileTake(
                model=shared["model"] or folder,
                name=trial.name or plain_stem(markers),
                subject=subject.name,
                markers=markers,
                loads=loads,
                bodies=MappingProxyType(dict(trial.bodies)),
                plates=tuple(trial.plates),
                emg=emg,
                emg_muscles={channel: tuple(names) for channel, names in subject.emg_muscles.items()},
                emg_reference=tuple(reference),
                emg_side=subject.emg_side,
                tasks=shared["tasks"],
                actuators=shared["actuators"],
                contacts=_contacts(trial.contacts or subject.contacts, folder, where, problems),
                measured=trial.measured or subject.measured,
                phases=MappingProxyType(dict(trial.phases)),
                mass=subject.mass,
                time=trial.time or subject.time,
                labels=MappingProxyType(dict(subject.labels)),
            )


def _matches(given: str | _Trial, folder: Path, where: str, problems: list[str]) -> list[tuple[_Trial, Path]]:
    """The recordings that an entry of `trials` names: a pattern, a file, or a table."""
    pattern = given if isinstance(given, str) else given.markers
    table = _Trial(markers=pattern) if isinstance(given, str) else given
    return [(table, path) for path in matching(folder, pattern, where, problems)]


def _companion(
    folder: Path, given: str | None, markers: Path, kind: str, what: str, problems: list[str], remarks: list[str]
) -> Path | None:
    """The forces or EMG of a trial: as given, or found by its stem."""
    if given is not None:
        return existing(folder, given, what, problems)
    found = companion(markers, kind)
    if found is not None:
        remarks.append(f"{markers.name}: {kind} from {found.name}")
    return found


def _contacts(given: str, folder: Path, where: str, problems: list[str]) -> str:
    """What tells of contacts: "auto", or a file as a path that can be opened."""
    if given in ("", AUTO):
        return given
    found = existing(folder, given, f"{where}: contacts", problems)
    return "" if found is None else str(found)


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
    (.xml), then as a table (.mot, .sto); EMG as a table (.sto, .mot), and never STEM alone.
    """
    words, endings = (LOADS, (".xml", ".mot", ".sto")) if kind == "loads" else (EMG, (".sto", ".mot"))
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


def _distinct(takes: list[FileTake], problems: list[str]) -> None:
    seen: set[tuple[str, str]] = set()
    for take in takes:
        key = (take.subject, take.name)
        if key in seen:
            problems.append(f"subject '{take.subject}' has two trials named '{take.name}': give one a 'name'")
        seen.add(key)
