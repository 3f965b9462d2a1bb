"""`identify`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from myomorph.body.identify.recordings import RecordingOptions
from myomorph.body.identify.subject import IdentificationOptions
from myomorph.core.model.extension import load
from myomorph.core.model.registry import with_extensions
from myomorph.lab.cli import options as flags
from myomorph.lab.cli.output import made
from myomorph.lab.store.settings import ForceOptions, with_settings
from myomorph.lab.study.subject.subject_files import BodyOptions

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
)
IdentifySwitches = flags.switches_class({name: source.help for name, source in SOURCES.items()})
IdentifyInputs = flags.inputs_class("loads", "time", leave_out=("loads",))


@flags.documented
def identify_command(
    *,
    model: flags.ModelFile,
    out: Path,
    motion: tuple[Path, ...] = (),
    loads: flags.Loads = (),
    mass: float | None = None,
    skin: Path | None = None,
    landmarks: Path | None = None,
    height: float | None = None,
    chest: float | None = None,
    sex: Literal["female", "male"] | None = None,
    age: float | None = None,
    check_motion: tuple[Path, ...] = (),
    check_loads: tuple[Path, ...] = (),
    inputs: IdentifyInputs | None = None,  # type: ignore[valid-type]
    switches: IdentifySwitches | None = None,  # type: ignore[valid-type]
    options: IdentifySettings | None = None,  # type: ignore[valid-type]
    threads: flags.Threads = None,
) -> int:
    """Identify masses, mass centers and inertias of every body from motions and forces.

    The body's shape is used where it is known.

    Parameters
    ----------
    out : model to write (.osim); tables and a report go into a folder beside it
    motion : coordinates over time, one file a recording
    mass : of the subject [kg]; the model's by default
    skin : mesh of the subject's skin: .obj, .stl or .ply
    landmarks : markers on the skin (CSV: name, x, y, z in metres), to pose the model in it
    height : of the subject [m], for a statistical body shape
    chest : circumference of the chest [m]
    sex : of the subject
    age : in years
    check_motion : motions that are not identified from, to compare the models on
    check_loads : their external loads
    """
    from myomorph.lab.study.inputs.loads import LoadsFile
    from myomorph.lab.study.inputs.reading import open_model
    from myomorph.lab.study.inputs.time_span import TimeSpan
    from myomorph.lab.study.subject import identifying
    from myomorph.lab.study.subject.subject_files import BodyShape, KnownBody
    from myomorph.lab.study.subject.subjects import tables_folder

    flags.use_threads(threads)
    tables = tables_folder(out, identifying.STEP.tables, (model,))
    settings = flags.settings_dict(options)
    shape = BodyShape(skin=skin, landmarks=landmarks, height=height, chest=chest, sex=sex, age=age)
    body = KnownBody(shape=shape, mass=mass)
    scaled = open_model(model)
    shared = flags.inputs_of_flags(inputs)
    bodies = shared.or_default(LoadsFile)
    time = shared.or_default(TimeSpan).time
    forces = with_settings(ForceOptions(), settings)
    chosen_source = next((SOURCES[name] for name in flags.switched_on(switches)), None)
    if chosen_source is not None:
        motions = load(chosen_source.open)(scaled, motion, loads, mass, time, settings)
    else:
        motions = identifying.open_motions(
            scaled,
            identifying.MotionFiles(motions=motion, loads=loads, bodies=bodies),
            time,
            forces,
        )
    motions += identifying.open_motions(
        scaled,
        identifying.MotionFiles(
            motions=check_motion, loads=check_loads, bodies=bodies, held_out=True
        ),
        forces=forces,
    )
    sources = identifying.input_sources(
        model, (*motion, *check_motion), (*loads, *check_loads), shape
    )
    identified = identifying.identify_subject(
        scaled, motions, body, identifying.IdentifyOptions.of(settings), sources
    )
    lost = identifying.write_identified(identified, out, tables)
    notes = (*scaled.warnings, *identified.found.notes, *lost)
    return made(out, tables, identifying.summary(identified), notes)
