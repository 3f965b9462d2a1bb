"""`identify`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from myomorph.body.identify.recordings import RecordingOptions
from myomorph.body.identify.subject import IdentificationOptions
from myomorph.core.model.extension import MotionRequest, load
from myomorph.core.model.registry import with_extensions
from myomorph.lab.cli import options as flags
from myomorph.lab.cli.output import made
from myomorph.lab.store.settings import ForceOptions, with_settings
from myomorph.lab.study.subject.subject_files import BodyOptions

if TYPE_CHECKING:
    from myomorph.core.model.model import Model
    from myomorph.lab.study.inputs.input import ByType
    from myomorph.lab.study.subject.identifying import SubjectMotion

SOURCES = with_extensions(
    {}, "way by which motions come", lambda extension: extension.motion_sources
)
"""Ways by which motions come besides files, by the switch that asks for each."""

IdentifySettings = flags.options_class(
    ForceOptions,
    RecordingOptions,
    IdentificationOptions,
    BodyOptions,
    *(load(source.options) for source in SOURCES.values()),
    switches={name: source.help for name, source in SOURCES.items()},
)
IdentifyInputs = flags.inputs_class("loads", "time", leave_out=("loads",))


@flags.documented
@dataclass(frozen=True, kw_only=True)
class IdentifyFiles:
    """The files of an identification, and the subject's mass.

    Attributes
    ----------
    out : model to write (.osim); tables and a report go into a folder next to it
    motion : coordinates over time, one file per recording
    mass : body mass of the subject [kg]; by default that of the model
    check_motion : held-out motions, on which the models are compared
    check_loads : external forces of the held-out motions, one file per motion
    """

    model: flags.ModelFile
    out: Path
    motion: tuple[Path, ...] = ()
    loads: flags.Loads = ()
    mass: float | None = None
    check_motion: tuple[Path, ...] = ()
    check_loads: tuple[Path, ...] = ()


@flags.documented
@dataclass(frozen=True, kw_only=True)
class Shape:
    """What is known of the subject's shape.

    Attributes
    ----------
    skin : mesh of the subject's skin (.obj, .stl or .ply)
    landmarks : markers on the skin, by which the model is posed in the mesh (.csv: name, x, y, z
        [m])
    height : height of the subject [m], for a statistical body shape
    chest : chest circumference [m], for a statistical body shape
    sex : sex of the subject
    age : age of the subject [years]
    """

    skin: Path | None = None
    landmarks: Path | None = None
    height: float | None = None
    chest: float | None = None
    sex: Literal["female", "male"] | None = None
    age: float | None = None


ANY_SHAPE = Shape()


@flags.documented
def identify_command(
    *,
    files: Annotated[IdentifyFiles, Parameter(name="*")],
    shape: Annotated[Shape, Parameter(name="*")] = ANY_SHAPE,
    inputs: IdentifyInputs | None = None,  # type: ignore[valid-type]
    options: IdentifySettings | None = None,  # type: ignore[valid-type]
    threads: flags.Threads = None,
) -> int:
    """Identify masses, mass centers and inertias of every body from motions and forces.

    The body's shape is used where it is known.
    """
    from myomorph.lab.study.inputs.reading import open_model
    from myomorph.lab.study.subject import identifying
    from myomorph.lab.study.subject.subject_files import BodyShape, KnownBody
    from myomorph.lab.study.subject.subjects import tables_folder

    flags.use_threads(threads)
    tables = tables_folder(files.out, identifying.STEP.tables, (files.model,))
    settings = flags.settings_dict(options)
    known = BodyShape(
        skin=shape.skin,
        landmarks=shape.landmarks,
        height=shape.height,
        chest=shape.chest,
        sex=shape.sex,
        age=shape.age,
    )
    scaled = open_model(files.model)
    motions = _motions(scaled, files, flags.inputs_of_flags(inputs), settings)
    sources = identifying.input_sources(
        files.model,
        (*files.motion, *files.check_motion),
        (*files.loads, *files.check_loads),
        known,
    )
    identified = identifying.identify_subject(
        scaled,
        motions,
        KnownBody(shape=known, mass=files.mass),
        identifying.IdentifyOptions.of(settings),
        sources,
    )
    lost = identifying.write_identified(identified, files.out, tables)
    notes = (*scaled.warnings, *identified.found.notes, *lost)
    return made(files.out, tables, identifying.summary(identified), notes)


def _motions(
    model: Model, files: IdentifyFiles, shared: ByType, settings: Mapping[str, Any]
) -> list[SubjectMotion]:
    """Open the motions, those that are held out last, or let the chosen source bring them."""
    from myomorph.lab.study.inputs.loads import LoadsFile
    from myomorph.lab.study.inputs.time_span import TimeSpan
    from myomorph.lab.study.subject.identifying import MotionFiles, open_motions

    bodies = shared.or_default(LoadsFile)
    time = shared.or_default(TimeSpan).time
    forces = with_settings(ForceOptions(), settings)
    source = next((SOURCES[name] for name in SOURCES if settings.get(name)), None)
    if source is not None:
        request = MotionRequest(
            motions=files.motion,
            loads=files.loads,
            mass=files.mass,
            time=time,
            settings=settings,
        )
        motions = load(source.open)(model, request)
    else:
        used = MotionFiles(motions=files.motion, loads=files.loads, bodies=bodies)
        motions = open_motions(model, used, time, forces)
    held_out = MotionFiles(
        motions=files.check_motion, loads=files.check_loads, bodies=bodies, held_out=True
    )
    return motions + open_motions(model, held_out, forces=forces)
