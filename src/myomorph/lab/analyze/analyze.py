"""From raw recordings to a study file: protocol, axes, static trial, model, forces and EMG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from myomorph.core.io.carried_meshes import carry_meshes
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.errors import BadData, BadFile, UnknownName, counted, few, listing
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers
from myomorph.core.motion.protocols import labels_between
from myomorph.core.motion.sync import cut
from myomorph.core.muscles.published_arms import arm_warnings
from myomorph.lab.analysis.arm_labels import is_arm
from myomorph.lab.analyze.arms import have_arms
from myomorph.lab.analyze.generic_model import generic_model
from myomorph.lab.analyze.joint_load_defaults import chosen_contact_points, with_joint_loads
from myomorph.lab.analyze.proposed_protocol import proposed_sites, proposed_table
from myomorph.lab.analyze.recorded_trial import (
    AnalyzeRequest,
    laboratory_of,
    protocol_sentences,
    recorded_trial,
)
from myomorph.lab.analyze.sensor_trials import (
    MIN_FRAMES,
    check_sensors,
    unmarked_model,
    unmarked_request,
    with_pose,
)
from myomorph.lab.analyze.session_sentences import (
    other_person_sentences,
    people_sentences,
    stated_session,
)
from myomorph.lab.analyze.unfit_markers import (
    MIN_MARKERS,
    missing_segments,
    shows_body,
    unfit_markers,
)
from myomorph.lab.session.plate_cover import weighed
from myomorph.lab.session.read import session_of
from myomorph.lab.session.recordings import (
    Recording,
    bare,
    by_what_shows,
    files_of,
    look_at,
    sites_of,
    standing_height,
    stands_still,
    static_beside,
)
from myomorph.lab.session.session import Person, Session, SessionTrial
from myomorph.lab.session.statements import corrected_session
from myomorph.lab.store.results import file_name
from myomorph.lab.study.inputs.assumed import Assumed
from myomorph.lab.study.inputs.input import ByType
from myomorph.lab.study.inputs.keys import Notes, Place, flag_of
from myomorph.lab.study.inputs.labels import Labels
from myomorph.lab.study.inputs.laboratory import AS_RECORDED
from myomorph.lab.study.inputs.loads import LoadsFile
from myomorph.lab.study.inputs.mass import BodyMass
from myomorph.lab.study.inputs.person import RecordedPerson
from myomorph.lab.study.inputs.reading import cut_to, open_model
from myomorph.lab.study.inputs.session import TrialSession
from myomorph.lab.study.inputs.table import all_keys, settings_of_keys
from myomorph.lab.study.plan.plan import Plan
from myomorph.lab.study.plan.written_plan import is_unchanged, study_text
from myomorph.lab.study.subject.subject_files import SubjectFiles
from myomorph.lab.study.trial.trial_inputs import TrialFiles
from myomorph.lab.study.trial.uncertainty_file import STEP as UNCERTAINTY

STUDY = "study.toml"
GENERIC = "generic.osim"
PROPOSED = "protocol.toml"
STEPS = ("calibrate", "ik", "id", "muscles", "tension", "report")
OF_MUSCLES = ("muscles", "tension")  # Steps that a model without muscles does not take.
MAX_HEIGHT = 3.0  # Of a body [m].
HEIGHT_TOLERANCE = 0.1  # A height that the markers show lies within this share of the true one.


@dataclass(frozen=True)
class PreparedStudy:
    """A study file that was written, and what it assumes.

    Attributes
    ----------
    study : the file, for `read_plan`
    assumed : sentences, those on all recordings first
    """

    study: Path
    assumed: tuple[str, ...]


def prepare_study(  # page: options of the command, each by its name
    recordings: Sequence[str | Path],
    out: str | Path,
    mass: float | None = None,
    height: float | None = None,
    static: str | Path | None = None,
    model: str | Path | None = None,
    arms: bool = False,
    keys: Mapping[str, object] = FrozenMap({}),
    options: Mapping[str, Mapping[str, object]] = FrozenMap({}),
) -> PreparedStudy:
    """Look at raw recordings and write a study file, as `analyze` does.

    `run_study` takes it from the recordings to a report.

    Parameters
    ----------
    recordings : files of markers (.c3d, .trc) or inertial sensors (.sto, .mvnx, .h5, .csv, .txt),
        or folders of them
    out : folder for `study.toml`, the generic model where no other is given, and the results
    mass : of the subject [kg]; without it, plates weigh the subject where they can
    height : of the subject [m], which scales the generic model
    static : recording of standing still; by default found among or beside the recordings
    model : OpenSim or MuJoCo file with markers; by default myo-sim's legs and trunk
    arms : give the generic model both arms, where markers show how they move
    keys : of the inputs of trials, as a study file has them; they go before what is found
    options : of the steps, by step and setting

    Returns
    -------
    the study file, and what it assumes, one sentence each

    Raises
    ------
    MyomorphError
        with one line that says what is missing, and the option that supplies it

    Examples
    --------
    >>> import myomorph as mm
    >>> squat = mm.demo_recording()
    >>> mm.write_trc(squat.markers, "squat.trc")
    >>> notes = mm.write_osim(squat.model, "squat.osim")
    >>> prepared = mm.prepare_study(
    ...     ["squat.trc"], "squat", mass=squat.model.mass, model="squat.osim"
    ... )
    >>> mm.read_plan(prepared.study).steps[0]
    ('calibrate', 'ik', 'id', 'muscles', 'tension', 'report')
    """
    request = AnalyzeRequest(
        recordings=tuple(map(Path, recordings)),
        mass=mass,
        height=height,
        static=None if static is None else Path(static),
        model=None if model is None else Path(model),
        arms=arms,
        inputs=_inputs_of(keys),
        options=FrozenMap(options),
    )
    return prepare_request(request, Path(out))


def _inputs_of(keys: Mapping[str, object]) -> ByType:
    """Check keys as a study file beside the program would have them, and make settings of them."""
    known = all_keys()
    place = Place(Path(), "keys", Notes())
    for name in keys:
        if name not in known:
            raise UnknownName("key", name, existing=known, where="a study file")
    values = {name: known[name][1].kind.located(name, value, place) for name, value in keys.items()}
    if place.notes.problems:
        raise BadData("; ".join(place.notes.problems))
    return settings_of_keys(values)


@dataclass(frozen=True, eq=False)
class SortedRecordings:
    """Recordings of a request by what they are for.

    Attributes
    ----------
    marked : motions that markers show
    sensed : motions that inertial sensors alone show
    static : markers of standing still, None for none
    looked_at : all recordings of markers that were given
    """

    marked: Sequence[Recording]
    sensed: Sequence[Recording]
    static: Recording | None
    looked_at: Sequence[Recording]

    @property
    def moving(self) -> list[Recording]:
        """Recordings of motion, of which each becomes a trial."""
        return [*self.marked, *self.sensed]

    @property
    def of_body(self) -> list[Recording]:
        """Recordings that show the lengths of segments."""
        return self._with_static(self.marked)

    @property
    def of_standing(self) -> list[Recording]:
        """Recordings in which somebody may stand still."""
        return self._with_static(self.looked_at)

    def _with_static(self, recordings: Sequence[Recording]) -> list[Recording]:
        return [*recordings] if self.static is None else [*recordings, self.static]


@dataclass(frozen=True)
class RecordingSentences:
    """Sentences on the recordings of a request, for the report.

    Attributes
    ----------
    worth : what results of sensors alone are worth
    static, pose : the static trial, and the sensors' calibration pose
    """

    worth: Sequence[str] = ()
    static: Sequence[str] = ()
    pose: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class ChosenModel:
    """The subject's model.

    Attributes
    ----------
    model, path : the model and its file
    labels : names of its markers, by the labels of recordings that call them otherwise
    of_height, of_model : sentences
    """

    model: Model
    path: Path
    labels: Mapping[str, str]
    of_height: Sequence[str]
    of_model: Sequence[str]


def prepare_request(request: AnalyzeRequest, out: Path) -> PreparedStudy:
    """Look at the recordings and write a study file, with the generic model where none is given.

    Parameters
    ----------
    request : recordings, and what the user says of them
    out : folder that both are written into

    Returns
    -------
    the study file, and what it assumes

    Raises
    ------
    MyomorphError
        with one line that says what is missing, and the option that supplies it
    """
    study = out / STUDY
    _refuse_changed(study)
    paths, passed_over = files_of(request.recordings)
    looked_at = [look_at(path, table=request.table) for path in paths]
    session = corrected_session(session_of(looked_at), request.statements)
    _check_one_person(session, request)
    # All are checked before anything is written.
    checked = [
        _checked_person(person, session, looked_at, request, out) for person in session.people
    ]
    out.mkdir(parents=True, exist_ok=True)
    subjects = [_prepared_subject(person, out, len(checked) == 1) for person in checked]
    of_people = people_sentences(session)
    plan = _plan(study, subjects, request, (*of_people, *passed_over))
    head = (
        f"Written by: {' '.join(request.command.split())}",
        "Change it as you like; these words run it again:",
        f"myomorph run {_shell(study)} --out {_shell(out)}",
    )
    study.write_text(study_text(plan, out, head), encoding="utf-8")
    return PreparedStudy(study=study, assumed=_all_assumed(subjects, of_people, passed_over))


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedSubject:
    """A subject of the study that is written.

    Attributes
    ----------
    files : of the subject
    steps : of its trials
    assumed : sentences on the subject
    of_trials : sentences on single trials, which begin with their names
    """

    files: SubjectFiles
    steps: tuple[str, ...]
    assumed: Sequence[str]
    of_trials: Sequence[str]


def _check_one_person(session: Session, request: AnalyzeRequest) -> None:
    """Refuse what belongs to one person where the recordings are of several."""
    stated = request.inputs.or_default(RecordedPerson)
    given = (
        ("--mass", request.mass),
        ("--height", request.height),
        ("--static", request.static),
        ("--age", stated.age),
        ("--sex", stated.sex),
    )
    flags = [flag for flag, value in given if value is not None]
    if len(session.people) > 1 and flags:
        names = " and ".join(str(person.name) for person in session.people)
        raise BadData(
            f"{flags[0]}: it belongs to one person, and the recordings are of {names}"
            f" ({session.people[1].why}); analyze one at a time, or leave it out and write it to"
            " each subject of the study file (--prepare)"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedPerson:
    """A person whose recordings can be analyzed.

    Attributes
    ----------
    name : of the subject
    request : for this person, with the mass
    recordings : by what they are for
    moving : recordings of motion, each with the files that belong to it
    trials : of the session, by file
    sentences : on the recordings
    of_mass : a sentence on the mass, where plates weigh it
    """

    name: str
    request: AnalyzeRequest
    recordings: SortedRecordings
    moving: Sequence[Recording]
    trials: Mapping[Path, SessionTrial]
    sentences: RecordingSentences
    of_mass: Sequence[str]


def _checked_person(
    person: Person,
    session: Session,
    looked_at: Sequence[Recording],
    request: AnalyzeRequest,
    out: Path,
) -> CheckedPerson:
    """One person's recordings sorted, checked, and weighed; raises `BadData`."""
    name = str(person.name)
    trials = {trial.path: trial for trial in session.of(name)}
    own = [recording for recording in looked_at if recording.path in trials]
    request = request.of_person(name)
    request, recordings, sentences = _sorted_recordings(request, own, trials)
    _check_inputs(request.inputs, recordings.moving)
    _check_recordings(recordings, request, out)
    moving = _with_given_loads(recordings.moving, request.inputs)
    of_mass: list[str] = []
    if request.mass is None:
        mass, sentence = weighed(recordings.static, moving, request.forces)
        request = replace(request, mass=mass)
        of_mass.append(sentence)
    return CheckedPerson(
        name=name,
        request=request,
        recordings=recordings,
        moving=moving,
        trials=trials,
        sentences=sentences,
        of_mass=of_mass,
    )


def _prepared_subject(person: CheckedPerson, out: Path, alone: bool) -> PreparedSubject:
    """Model of a person, written where it is the generic one, and the trials.

    Parameters
    ----------
    out : folder of the study
    alone : it is the study's only subject
    """
    request = person.request
    recordings = person.recordings
    generic = out / (GENERIC if alone else f"{file_name(person.name)}_{GENERIC}")
    chosen = _chosen_model(recordings, request, generic)

    own_markers = () if request.model is None else chosen.model.marker_names
    assumed = [
        *person.sentences.worth,
        *person.of_mass,
        *chosen.of_height,
        *person.sentences.static,
        *person.sentences.pose,
        *protocol_sentences(recordings.marked, (*own_markers, *chosen.labels)),
        *chosen.of_model,
    ]
    if not chosen.model.muscles:
        assumed.append(
            f"{chosen.path.name} has no muscles: the report ends with joint angles and torques."
        )
    trials, of_trials = _trials(person, chosen)
    return PreparedSubject(
        files=_subject_files(person.name, trials, recordings, chosen, request),
        steps=_steps(recordings, chosen, request),
        assumed=assumed,
        of_trials=of_trials,
    )


def _all_assumed(
    subjects: Sequence[PreparedSubject], of_people: Sequence[str], passed_over: Sequence[str]
) -> tuple[str, ...]:
    """List what a study assumes; where it is of several, each line says of whom."""
    texts = [*of_people]
    for subject in subjects:
        who = f"{subject.files.name}: " if len(subjects) > 1 else ""
        texts += [f"{who}{text}" for text in (*subject.assumed, *subject.of_trials)]
    return (*texts, *passed_over)


def _sorted_recordings(
    request: AnalyzeRequest,
    recordings: Sequence[Recording],
    of_person: Mapping[Path, SessionTrial],
) -> tuple[AnalyzeRequest, SortedRecordings, RecordingSentences]:
    """Sort recordings of one person by what they are for.

    The request gets what sensors alone need.
    """
    looked_at, sensed = by_what_shows(recordings)
    static: Recording | None = None
    marked = looked_at
    sentences = RecordingSentences()
    if looked_at:
        static, marked, of_static = static_trial(looked_at, of_person, request)
        # One among the recordings is of their person.
        strange = static is not None and static.path not in of_person and len(marked) > 0
        warned = other_person_sentences(static, marked[0]) if strange and static else []
        sentences = replace(sentences, static=[of_static, *warned])
    else:
        request, worth = unmarked_request(request)
        sentences = replace(sentences, worth=[worth])
    request, sensed, of_pose = with_pose(request, sensed, alone=not marked)
    sorted_ = SortedRecordings(marked=marked, sensed=sensed, static=static, looked_at=looked_at)
    return request, sorted_, replace(sentences, pose=of_pose)


def _check_recordings(recordings: SortedRecordings, request: AnalyzeRequest, out: Path) -> None:
    """Refuse motions that are too short, or whose markers or sensors do not show a body."""
    for recording in recordings.sensed:
        check_sensors(recording, request)
    for recording in recordings.marked:
        markers = recording.trial.markers
        assert markers is not None
        labels = markers.names
        if request.model is None:
            _check_markers(recording, recordings.of_standing, out)
            labels = tuple(recording.found.sites)
        _check_time(recording.path, markers, labels, request.time)


def _with_given_loads(moving: list[Recording], inputs: ByType) -> list[Recording]:
    """Give the only recording the file of forces that the user gave."""
    loads = inputs.or_default(LoadsFile).loads
    if loads is None:
        return moving
    near = FrozenMap({**moving[0].near, "loads": loads})
    return [replace(moving[0], near=near)]


def _chosen_model(
    recordings: SortedRecordings, request: AnalyzeRequest, generic: Path
) -> ChosenModel:
    """Model that was given, or the generic one fitted to the recordings and written."""
    if not recordings.marked:
        model, path, of_model = unmarked_model(request, generic)
        return ChosenModel(model=model, path=path, labels={}, of_height=(), of_model=of_model)
    height, of_height = _height(recordings.static or recordings.marked[0], request.height)
    model, path, labels, of_model = _model(recordings.of_body, request, height, generic)
    return ChosenModel(
        model=model, path=path, labels=labels, of_height=of_height, of_model=of_model
    )


def _plausible(height: float | None) -> float | None:
    """Return a stated height [m], None for one that is in another unit."""
    return height if height is not None and height < MAX_HEIGHT else None


def _trials(person: CheckedPerson, chosen: ChosenModel) -> tuple[tuple[TrialFiles, ...], list[str]]:
    """Trial of each recording of motion, and sentences on single trials."""
    request = person.request
    labels = Labels(FrozenMap(chosen.labels))
    mass = BodyMass(request.mass)
    body = replace(request.inputs.or_default(RecordedPerson), height=_plausible(request.height))
    points = chosen_contact_points(chosen.model, request.inputs, request.options)
    trials = []
    sentences = []
    for recording, name in zip(person.moving, _names(person.moving), strict=True):
        files = TrialFiles(model=chosen.path, name=name, subject=person.name, inputs=request.inputs)
        trial, of_trial = recorded_trial(recording, files, chosen.model, request)
        stated, of_session = stated_session(person.trials[recording.path], files.get(TrialSession))
        # Those on the session are not written, for its keys can be corrected.
        assumed = Assumed(tuple(of_trial))
        trials.append(trial.having(labels, mass, body, points, stated, assumed))
        sentences += [f"{name}: {sentence}" for sentence in (*of_session, *of_trial)]
    return tuple(trials), sentences


def _subject_files(
    name: str,
    trials: tuple[TrialFiles, ...],
    recordings: SortedRecordings,
    chosen: ChosenModel,
    request: AnalyzeRequest,
) -> SubjectFiles:
    """Subject with its trials."""
    static = recordings.static
    return SubjectFiles(
        name=name,
        model=chosen.path,
        mass=request.mass,
        static=None if static is None else static.path,
        trials=trials,
        labels=FrozenMap(chosen.labels),
        static_laboratory=(
            AS_RECORDED if static is None else laboratory_of(static, chosen.model, request)
        ),
    )


def _steps(
    recordings: SortedRecordings, chosen: ChosenModel, request: AnalyzeRequest
) -> tuple[str, ...]:
    """List the steps of a subject's trials, all alike."""
    steps = [step for step in STEPS if chosen.model.muscles or step not in OF_MUSCLES]
    if not recordings.marked:
        steps.remove("calibrate")
    if UNCERTAINTY in request.options:
        steps.append(UNCERTAINTY)
    return tuple(steps)


def _plan(
    study: Path,
    subjects: Sequence[PreparedSubject],
    request: AnalyzeRequest,
    of_all: Sequence[str],
) -> Plan:
    """Study; what is assumed of all recordings and of a subject stands with each trial."""
    files = [_with_assumed(subject, of_all) for subject in subjects]
    return Plan(
        name=study.parent.resolve().name,
        path=study,
        trials=tuple(trial for subject in files for trial in subject.trials),
        steps=tuple(subject.steps for subject in subjects for _ in subject.files.trials),
        settings=with_joint_loads(request.options),
        subjects=FrozenMap({subject.name: subject for subject in files}),
        flat=len(subjects) == 1,
    )


def _with_assumed(subject: PreparedSubject, of_all: Sequence[str]) -> SubjectFiles:
    """Subject, its trials with all that is assumed of them."""
    shared = (*of_all, *subject.assumed)
    trials = tuple(
        trial.having(Assumed((*shared, *trial.get(Assumed).assumed)))
        for trial in subject.files.trials
    )
    return replace(subject.files, trials=trials)


def _check_inputs(inputs: ByType, moving: Sequence[Recording]) -> None:
    """Refuse files that do not exist, and inputs of one recording where there are several."""
    for name, (declared, key) in all_keys().items():
        value = getattr(inputs.or_default(declared.settings), name)
        if value == key.default:
            continue
        for path in key.kind.files(value):
            if not path.exists():
                raise BadFile(path, "does not exist", f"give a file that does ({flag_of(name)})")
        if key.kind.per == "trial" and len(moving) != 1:
            raise BadData(
                f"{flag_of(name)} {value}: it belongs to one recording, and there are"
                f" {len(moving)}; analyze one at a time, or write '{name}' to each trial of the"
                " study file (--prepare)"
            )


def _shell(path: Path) -> str:
    text = str(path)
    return f'"{text}"' if " " in text else text


def _refuse_changed(path: Path) -> None:
    """Raise `BadData` where a study file stands that somebody has changed or written."""
    if path.is_file() and not is_unchanged(path.read_text(encoding="utf-8", errors="replace")):
        raise BadData(
            f"{path} was changed since it was written, and would be lost: run it ('myomorph run"
            f" {path} --out {path.parent}'), or give another folder (--out)"
        )


def static_trial(
    looked: list[Recording], of_person: Mapping[Path, SessionTrial], request: AnalyzeRequest
) -> tuple[Recording | None, list[Recording], str]:
    """Find the recording of standing still, the others, and a sentence on it.

    Somebody who sways stands too: recordings in which the session sees standing come after those in
    which nothing moves.

    Parameters
    ----------
    looked : recordings of markers of one person
    of_person : trials of the session, by file
    request : whose static trial, where it names one, goes before what is found
    """
    if request.static is not None:
        return _stated_static(looked, request.static, request)
    still = [one for one in looked if one.still]
    if not still:
        still = [one for one in looked if of_person[one.path].movement.value == "standing"]
    moving = [one for one in looked if one not in still]
    if still and moving:
        static = max(still, key=lambda one: len(one.found.sites))
        return static, moving, f"{static.path.name} is the static trial, without movement."
    beside = static_beside(looked[0], request.table) if moving else None
    if beside is not None:
        return (
            beside,
            moving,
            f"{beside.path.name} beside the recording is the static trial, without movement.",
        )
    return (
        None,
        looked,
        "There is no static trial (--static FILE): segment lengths come from the motion alone.",
    )


def _stated_static(
    looked: list[Recording], path: Path, request: AnalyzeRequest
) -> tuple[Recording, list[Recording], str]:
    """Look at the static trial that a user names; it is no motion besides, unless it is all."""
    static = look_at(path, table=request.table)
    moving = [one for one in looked if one.path != path] or looked
    moved = "" if static.still else ", although markers move in it by more than 3 cm"
    return static, moving, f"{static.path.name} is the static trial, as --static says{moved}."


def _check_markers(recording: Recording, everyone: Sequence[Recording], out: Path) -> None:
    """Refuse a recording whose known labels do not show a pelvis and a leg.

    The error says what the markers are, and names a table of what they may lie on where somebody
    stands still with them.

    Raises
    ------
    BadData
    """
    if shows_body(recording.found):
        return
    lacking = missing_segments(recording.found)
    if not recording.found.sites and not recording.found.unknown:
        raise BadData(
            f"{recording.path}: holds no marker that is ever seen: give the recording of the"
            " markers"
        )
    why = unfit_markers(recording.found, lacking)
    standing = None if is_arm(recording.found) else next(filter(all_still, everyone), None)
    proposals = (
        proposed_sites(standing.trial.markers)
        if standing is not None and standing.trial.markers
        else ()
    )
    if standing is None or not proposals:
        raise BadData(f"{recording.path}: {why}")
    table = out / PROPOSED
    if not table.exists():
        out.mkdir(parents=True, exist_ok=True)
        table.write_text(proposed_table(proposals, standing.path.name), encoding="utf-8")
    raise BadData(
        f"{recording.path}: {why}. What {len(proposals)} markers of {standing.path.name} may lie"
        f" on, by geometry, is in {table}: check each line, then give it (--protocol {table})"
    )


def all_still(recording: Recording) -> bool:
    """Whether somebody stands still, by all markers."""
    markers = recording.trial.markers
    return markers is not None and stands_still(np.moveaxis(markers.values, 1, 0))


def _check_time(
    path: Path, markers: Markers, labels: Sequence[str], time: tuple[float, float] | None
) -> None:
    """Refuse a part of a recording that is too short, or shows too few of the markers.

    Raises
    ------
    BadData
    """
    used = cut_to(time, markers, path)
    count = len(markers if used is None else cut(markers, *used))
    if count < MIN_FRAMES:
        within = " (--time)" if time else ""
        raise BadData(
            f"{path}: holds {counted(count, 'frame')}{within},"
            f" derivatives need {MIN_FRAMES} in a row: give a longer recording, and this one as"
            " --static where nobody moves in it"
        )
    if time is None:
        return
    places = np.stack([markers[label] for label in labels], axis=1)
    seen = np.isfinite(places).all(axis=2).sum(axis=1) >= MIN_MARKERS
    if not seen[(markers.time >= time[0]) & (markers.time <= time[1])].any():
        known = markers.time[seen]
        where = (
            f"seen together from {known[0]:.2f} to {known[-1]:.2f} s"
            if len(known)
            else "never seen together"
        )
        raise BadData(
            f"{path}: from {time[0]:g} to {time[1]:g} s (--time) fewer than {MIN_MARKERS} markers"
            f" of the body are seen in any frame; they are {where}"
        )


def _of_generic_model(model: Model, arms: bool, height: float | None) -> str:
    """Describe the model that stands in where none was given."""
    of_height = "" if height is None else f", from those of a body of {height:g} m"
    parts = "legs, trunk and arms" if arms else "legs and trunk"
    return (
        "No model was given (--model FILE): myo-sim's"
        f" {parts} with {len(model.muscles)}"
        f" muscles, {len(model.markers)} markers placed on its bones by landmark, its segments"
        f" stretched to the recordings{of_height}. "
    )


def _model(
    everyone: Sequence[Recording], request: AnalyzeRequest, height: float | None, generic: Path
) -> tuple[Model, Path, dict[str, str], list[str]]:
    """Choose the model of a person: the one that was given, else the generic one.

    Parameters
    ----------
    everyone : recordings that show the lengths of segments
    height : of the body [m], None for the model's own
    generic : file that the generic model is written to

    Returns
    -------
    model, its file, what it calls markers that recordings call otherwise, and sentences on it
    """
    if request.model is None:
        return _generic(everyone, request, height, generic)
    return _given(everyone, request, request.model)


def _generic(
    everyone: Sequence[Recording], request: AnalyzeRequest, height: float | None, path: Path
) -> tuple[Model, Path, dict[str, str], list[str]]:
    """Write the generic model with a marker for every label that lies on a bone of its."""
    assert request.mass is not None
    sites = sites_of(everyone)
    seen = have_arms(sites)
    alone = any(is_arm(one.found) for one in everyone)
    arms = alone or (request.arms and seen)
    model, without = generic_model(sites, height, request.mass, arms, alone)
    write_osim(model, path)
    carry_meshes(model, path.parent)
    text = _of_generic_model(model, arms, height)
    if alone:
        text += (
            "No marker is on a leg: arms with markers move, on a trunk that goes where its"
            " markers are; all else is attached to it, without muscles; what holds the trunk is not"
            " a joint torque."
        )
    if not arms:
        text += "The arms' mass is part of the trunk's" + (
            " (--arms gives it arms)." if seen else "."
        )
    if request.arms and not seen:
        text += " It has no arms, for no markers show two segments of one (--arms)."
    if without:
        text += f" Not placed on it: {few(without)}."
    recorded = dict.fromkeys(label for one in everyone for label in one.found.sites)
    return model, path, {label: bare(label) for label in recorded if bare(label) != label}, [text]


def _given(
    everyone: Sequence[Recording], request: AnalyzeRequest, path: Path
) -> tuple[Model, Path, dict[str, str], list[str]]:
    """Read the model that was given, and find its markers among the labels."""
    model = open_model(path)
    names = model.marker_names
    # A model may have markers that no protocol knows.
    recorded = list(
        dict.fromkeys(label for one in everyone for label in (*one.found.sites, *one.found.unknown))
    )
    labels = _labels_of_markers(recorded, names, request)
    known = [label for label in recorded if label in names or label in labels]
    if len(known) < MIN_MARKERS:
        raise BadData(
            f"{path}: {len(known)} of its {len(names)} markers are in the recordings,"
            f" which have {listing('', recorded)}: give a model with such markers, or leave --model"
            " out for the generic one"
        )
    texts = [f"{len(known)} labels are markers of {path.name}."]
    if labels:
        shown = few([f"{old} as {new}" for old, new in labels.items()])
        texts.append(
            f"{len(labels)} labels lie on the landmark of a marker of another name: {shown}."
        )
    texts += [f"{path.name}: {line}." for line in arm_warnings(model)]
    return model, path, labels, texts


def _labels_of_markers(
    recorded: Sequence[str], names: Sequence[str], request: AnalyzeRequest
) -> dict[str, str]:
    """Markers of a model by the labels that recordings have for them under another name."""
    labels = {
        label: bare(label) for label in recorded if bare(label) != label and bare(label) in names
    }
    rest = [label for label in recorded if label not in labels]
    by_landmark = labels_between(rest, names, request.table)
    return labels | {old: new for old, new in by_landmark.items() if new not in labels.values()}


def _height(recording: Recording, height: float | None) -> tuple[float | None, list[str]]:
    """Find the height that the generic model begins with [m], None for its own; and a sentence."""
    if height is None:
        return None, []
    found = standing_height(recording)
    if found is None:
        return height, [
            f"--height {height:g} m could not be checked against the markers: none are on shoulders"
            " and ankles."
        ]
    apart = found / height - 1.0
    shown = (
        f"the markers of {recording.path.name} show a body of about {found:.2f} m, "
        f"{100.0 * apart:+.0f} % of --height"
    )
    if abs(apart) < HEIGHT_TOLERANCE:
        return height, [f"Height {height:g} m (--height): {shown}."]
    return None, [
        f"WARNING: {shown} {height:g} m, which is not used: is the unit right, and are they of this"
        " person?"
    ]


def _names(recordings: Sequence[Recording]) -> list[str]:
    """Name trials by their files, and by their folders where these say nothing or are alike."""
    names = [one.name for one in recordings]
    result = []
    for recording, name in zip(recordings, names, strict=True):
        plain = name.lower() in ("markers", "marker", "motion", "motion_capture")
        parent = recording.path.resolve().parent.name
        if plain and parent:
            result.append(parent)
        elif names.count(name) > 1:
            result.append(f"{parent}_{name}")
        else:
            result.append(name)
    return result
