"""The files of one recording, opened into what the steps take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, UnknownName
from myomorph.model.model import Actuator, Model
from myomorph.model.provenance import Source
from myomorph.model.segments import feet_of
from myomorph.model.series import Motion, Trial
from myomorph.motion.crossings import CrossingOptions
from myomorph.motion.emg_checks import rate_against
from myomorph.motion.envelope import EnvelopeOptions
from myomorph.motion.ik import CoordinateTask, InverseKinematicsOptions
from myomorph.store.results import file_source, value_source
from myomorph.store.settings import (
    Differentiation,
    EmgUse,
    Measured,
    ReportOptions,
    Side,
    TensionTables,
    TorqueTable,
    plain_settings,
    with_settings,
)
from myomorph.study.trial import inputs
from myomorph.study.trial.emg_files import open_emg
from myomorph.study.trial.take import Take

if TYPE_CHECKING:
    from myomorph.io.osim.tasks import IkTasks

Settings = Mapping[str, Mapping[str, Any]]
"""What each step was told, by step and setting."""


@dataclass(frozen=True)
class FileTake:
    """The files of one recording of one subject.

    Attributes
    ----------
    markers : TRC or C3D file
    motion : table of coordinates, where inverse kinematics is not asked for
    loads : external loads file, or a table of forces with `bodies`
    bodies : prefix of the columns of each force in a table, and the body it acts on
    plates : bodies that stand on the plates of a C3D file, in the plates' order
    emg_muscles : EMG channel to the muscles it was measured on, where its name does not tell
    emg_reference : recordings of maximum voluntary contractions, that raw EMG is scaled to
    emg_side : side of channels whose names tell none
    contacts : "auto", or a file of touches or contact sites; "" to estimate no contact force
    measured : what measured forces are used for where contacts are estimated; None as the file says
    phases : parts of the motion that the report tells apart, name to start and end [s]
    mass : of the subject [kg]
    time : start and end [s]
    labels : what the model calls markers that the recording calls otherwise
    condition : that it was recorded in, as the study file names it
    """

    model: Path
    name: str = ""
    subject: str = ""
    markers: Path | None = None
    motion: Path | None = None
    loads: Path | None = None
    bodies: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    plates: tuple[str, ...] = ()
    emg: Path | None = None
    emg_muscles: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: MappingProxyType({}))
    emg_reference: tuple[Path, ...] = ()
    emg_side: Side = ""
    tasks: Path | None = None
    actuators: Path | None = None
    contacts: str = ""
    measured: Measured | None = None
    phases: Mapping[str, tuple[float, float]] = field(default_factory=lambda: MappingProxyType({}))
    mass: float | None = None
    time: tuple[float, float] | None = None
    labels: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    condition: str = ""


def open_take(files: FileTake, settings: Settings, model: Model | None = None) -> Take:
    """Read the files of a recording and make of them what the steps take.

    Parameters
    ----------
    settings : what each step is told
    model : the model, where it was read already

    Raises
    ------
    MyomorphError
        where a file cannot be read, or does not fit the model
    """
    model = inputs.open_model(files.model) if model is None else model
    take = _common(files, settings, model)
    if files.markers is None:
        return take
    known = [marker.name for marker in model.markers]
    for name in files.labels.values():
        if name not in known:
            raise UnknownName("marker", name, known, "labels: the model")
    trial = inputs.fitted_to(model, inputs.with_labels(inputs.open_trial(files.markers), files.labels))
    assert trial.markers is not None
    take = replace(
        take,
        markers=trial.markers,
        events=trial.events,
        time=inputs.cut_to(files.time, trial.markers, files.markers),
        warnings=(
            *take.warnings,
            *(f"{files.markers.name}: {text}" for text in trial.warnings),
            *_rate_doubts(take, trial.markers.time),
            *_phase_doubts(files, trial.markers.time),
        ),
    )
    if files.loads is None and files.plates:
        take = replace(take, loads=_plate_loads(trial, files))
    elif files.loads is None and trial.plates and feet_of(model):
        told = "The force of each plate acts on the foot that is nearest to its center of pressure."
        take = replace(take, loads=_nearest_loads(trial, model), assumed=(*take.assumed, told))
    return replace(take, real=_real(files, take), plates=trial.plates, plate_time=trial.plate_time)


def open_motion_take(files: FileTake, settings: Settings) -> tuple[Take, Motion]:
    """The same for steps that begin with coordinates from a file; also returns these."""
    assert files.motion is not None
    model = inputs.open_model(files.model)
    take = _common(files, settings, model)
    given = inputs.open_motion(files.motion, model)
    recorded, lacking = whole_motion(given, model)
    warnings = (*take.warnings, *_rate_doubts(take, recorded.time))
    if lacking:
        warnings = (*warnings, f"{files.motion.name}: lacks {', '.join(lacking)}: they rest at their defaults")
    take = replace(take, time=inputs.cut_to(files.time, recorded, files.motion), warnings=warnings)
    return replace(take, real=_real(files, take)), recorded


def _phase_doubts(files: FileTake, time: Array) -> tuple[str, ...]:
    """Phases that are told of times outside the recording."""
    start, stop = float(time[0]), float(time[-1])
    return tuple(
        f"phase '{name}' is told from {first:g} to {last:g} s, the recording lasts from {start:g} to {stop:g} s"
        for name, (first, last) in files.phases.items()
        if last <= start or first >= stop
    )


def _rate_doubts(take: Take, time: Array) -> tuple[str, ...]:
    """Whether EMG lasts so much longer or shorter than the whole motion that its rate is probably wrong."""
    told = "" if take.emg is None else rate_against(take.emg, time)
    return (told,) if told else ()


def whole_motion(motion: Motion, model: Model) -> tuple[Motion, tuple[str, ...]]:
    """The motion with every coordinate of the model, and those that it lacked and no coupler gives."""
    from myomorph.rigid.tree import compile_tree

    if set(motion.names) == set(model.coordinate_names):
        return motion, ()
    values = compile_tree(model).coordinates_of(motion)
    given = (*motion.names, *model.dependent_coordinates)
    lacking = tuple(name for name in model.coordinate_names if name not in given)
    return Motion(motion.time, model.coordinate_names, values), lacking


def _common(files: FileTake, settings: Settings, model: Model) -> Take:
    used = (
        ("model", files.model),
        ("markers", files.markers),
        ("motion", files.motion),
        ("loads", files.loads),
        ("emg", files.emg),
        ("tasks", files.tasks),
        ("actuators", files.actuators),
        *(("emg reference", path) for path in files.emg_reference),
    )
    sources = [file_source(role, path) for role, path in used if path is not None]
    if files.loads is not None:
        sources += load_tables(files.loads, files.markers)
    if files.contacts:
        sources += contact_sources(files)
    if files.bodies or files.plates:
        sources.append(value_source("bodies", "bodies of the forces", sorted(files.bodies.items()), files.plates))
    name = files.name or (files.markers or files.motion or files.model).stem
    given = None
    if files.emg is not None:
        envelope = with_settings(EnvelopeOptions(), settings.get("tension", {}))
        given = open_emg(files.emg, model, files.emg_muscles, envelope, files.emg_reference, files.emg_side)
        sources.append(value_source("emg", "settings of envelopes", sorted(plain_settings(envelope).items())))
    if files.labels:
        sources.append(value_source("markers", "labels of markers", sorted(files.labels.items())))
    if files.emg_muscles or files.emg_side:
        sources.append(value_source("emg", "muscles of channels", sorted(files.emg_muscles.items()), files.emg_side))
    return Take(
        name=name,
        subject=files.subject or model.name,
        model=model,
        loads=_file_loads(files, model),
        emg=None if given is None else given.emg,
        emg_muscles={} if given is None else given.muscles,
        mass=files.mass,
        kinematics=kinematics_options(files, settings.get("ik", {}), model),
        crossings=with_settings(CrossingOptions(), settings.get("ik", {})),
        derivatives=derivative_options(settings),
        torque_table=with_settings(TorqueTable(), settings.get("id", {})),
        tension=tension_options(settings),
        **contact_parts(files, settings, model),
        emg_use=with_settings(EmgUse(), settings.get("tension", {})),
        tables=with_settings(TensionTables(), settings.get("tension", {})),
        report=report_options(settings),
        phases=files.phases,
        actuators=_actuators(files, model),
        sources=tuple(sources),
        warnings=(
            *(f"{files.model.name}: {text}" for text in model.warnings),
            *(() if given is None else given.notes),
        ),
    )


def contact_sources(files: FileTake) -> list[Source]:
    """What tells of contacts, as inputs by their hashes."""
    from myomorph.study.trial.contact_file import AUTO, contact_files

    told = value_source("contacts", files.contacts, files.contacts, files.measured)
    if files.contacts == AUTO:
        return [told]
    return [told, *(file_source("contacts", path) for path in contact_files(Path(files.contacts)))]


def load_tables(path: Path, markers: Path | None = None) -> list[Source]:
    """The tables that an external loads file, or a file of stairs, takes its numbers from."""
    if path.suffix.lower() == ".toml":
        from myomorph.study.trial.stairs_file import recording_of

        return [file_source("load table", one) for one in recording_of(path, markers)]
    if path.suffix.lower() != ".xml":
        return []
    from myomorph.io.loads import read_load_entries

    with inputs.about(path):
        tables = dict.fromkeys(entry.data for entry in read_load_entries(path))
    return [file_source("load table", table) for table in tables]


def _file_loads(files: FileTake, model: Model) -> Any:
    if files.loads is None:
        return None
    path, bodies, markers = files.loads, files.bodies, files.markers
    return lambda motion: inputs.open_loads(path, model, motion, bodies, markers)


def _plate_loads(trial: Trial, files: FileTake) -> Any:
    wrenches = inputs.recorded_wrenches(trial, files.plates)
    return lambda motion: wrenches


def _nearest_loads(trial: Trial, model: Model) -> Any:
    return lambda motion: inputs.assigned_wrenches(trial, model, motion)


def kinematics_options(files: FileTake, given: Mapping[str, Any], model: Model) -> InverseKinematicsOptions:
    """Options of inverse kinematics from settings and, where there is one, a task set."""
    options = with_settings(InverseKinematicsOptions(), given)
    if files.tasks is None:
        return options
    from myomorph.io.osim.tasks import read_ik_tasks

    with inputs.about(files.tasks):
        tasks = read_ik_tasks(files.tasks)
    return with_tasks(options, tasks, model, str(files.tasks))


def with_tasks(
    options: InverseKinematicsOptions, tasks: IkTasks, model: Model, source: str
) -> InverseKinematicsOptions:
    """Options with the weights and aims of an OpenSim task set; one without markers leaves all of them at 1.

    Raises
    ------
    BadData
        where the set gives no marker of the model a weight
    """
    known = set(model.marker_names)
    weights = {name: weight for name, weight in tasks.marker_weights.items() if name in known}
    if tasks.marker_weights and not any(weights.values()):
        raise BadData(f"{source}: gives no marker of model '{model.name}' a weight")
    aims = {}
    for aim in tasks.coordinates:
        if aim.weight > 0.0 and aim.coordinate in model.coordinate_names:
            default = model.coordinate(aim.coordinate).default
            value = {"value": aim.value, "default": default, "table": None}[aim.source]
            aims[aim.coordinate] = CoordinateTask(aim.weight, value)
    only = bool(tasks.marker_weights)
    return replace(options, marker_weights=weights, only_weighted=only, coordinate_tasks=aims)


def task_values(tasks: IkTasks, path: Path | None, model: Model, source: Path) -> Motion | None:
    """The motion that coordinate tasks take their values from; None where none does, whatever file is named.

    Raises
    ------
    BadData
        where a task takes its value from a file, but none is named
    """
    wanted = [aim.coordinate for aim in tasks.coordinates if aim.source == "table" and aim.weight > 0.0]
    if not wanted:
        return None
    if path is None:
        raise BadData(
            f"{source}: the task of '{wanted[0]}' takes its value from a file, but there is no coordinate_file"
        )
    return inputs.open_motion(path, model)


def derivative_options(settings: Settings) -> Differentiation:
    """The low-pass filter: one for all steps that differentiate, so the last that names it counts."""
    options = Differentiation()
    for step in ("id", "muscles", "tension"):
        options = with_settings(options, settings.get(step, {}))
    return options


def tension_options(settings: Settings) -> Any:
    """Options of muscle tensions, or None where nothing is said, so that commands without them start faster."""
    if not settings.get("tension"):
        return None
    from myomorph.tension.solve import TensionOptions

    return with_settings(TensionOptions(), settings["tension"])


def report_options(settings: Settings) -> ReportOptions:
    """How the report looks at motions; raises `UnknownName` where there is no such preset."""
    from myomorph.analysis.presets import preset_of

    options = with_settings(ReportOptions(), settings.get("report", {}))
    if options.preset:
        preset_of(options.preset)
    return options


def contact_parts(files: FileTake, settings: Settings, model: Model) -> dict[str, Any]:
    """Contacts and what the step of tensions is told of them and of EMG, as far as a recording has them."""
    given = settings.get("tension", {})
    parts: dict[str, Any] = {}
    if files.contacts:
        from myomorph.study.trial.contact_file import read_contacts
        from myomorph.tension.terms.contacts import ContactOptions

        parts["contacts"] = read_contacts(files.contacts, model, files.measured)
        parts["contact_options"] = with_settings(ContactOptions(), given)
    if files.emg is not None:
        from myomorph.tension.emg_calibration import EmgOptions

        parts["emg_options"] = with_settings(EmgOptions(), given)
    return parts


def _actuators(files: FileTake, model: Model) -> tuple[Actuator, ...] | None:
    if files.actuators is None:
        return None
    from myomorph.io.osim.actuator_files import read_actuators

    with inputs.about(files.actuators):
        return read_actuators(files.actuators, model)


def _real(files: FileTake, take: Take) -> tuple[str, ...]:
    """What was recorded, as a sentence for the first lines of the report."""
    parts = []
    if files.markers is not None:
        parts.append(f"markers from {files.markers.name}")
    if files.motion is not None:
        parts.append(f"coordinates from {files.motion.name}")
    if take.loads is not None:
        parts.append(f"external forces from {files.loads.name}" if files.loads else "external forces of the plates")
    if files.emg is not None:
        parts.append(f"EMG from {files.emg.name}")
    text = ", ".join(parts)
    return (f"{text[0].upper()}{text[1:]}.",) if parts else ()
