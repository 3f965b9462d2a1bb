"""`identify`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from myomorph.body.identify.recordings import RecordingOptions
from myomorph.body.identify.subject import IdentificationOptions
from myomorph.lab.cli import options as flags
from myomorph.lab.cli.output import made
from myomorph.lab.store.settings import ForceOptions, with_settings
from myomorph.lab.study.subject.subject_files import BodyOptions
from myomorph.live.identification import LiveOptions

IdentifySettings = flags.options_class(
    ForceOptions, RecordingOptions, IdentificationOptions, BodyOptions, LiveOptions
)
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
    live: bool = False,
    options: IdentifySettings | None = None,  # type: ignore[valid-type]
    threads: flags.Threads = None,
) -> int:
    """Masses, mass centers and inertias of every body from motions, their forces and the body's
    shape.

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
    live : show what is known so far while frames arrive, from the files or streams
    """
    from myomorph.lab.study.inputs.loads import LoadsFile
    from myomorph.lab.study.inputs.reading import open_model
    from myomorph.lab.study.inputs.time_span import TimeSpan
    from myomorph.lab.study.subject import identifying
    from myomorph.lab.study.subject.subject_files import BodyShape
    from myomorph.lab.study.subject.subjects import tables_folder
    from myomorph.live.identification import live_motions

    flags.use_threads(threads)
    tables = tables_folder(out, identifying.STEP.tables, (model,))
    settings = flags.settings_dict(options)
    shape = BodyShape(skin=skin, landmarks=landmarks, height=height, chest=chest, sex=sex, age=age)
    scaled = open_model(model)
    shared = flags.inputs_of_flags(inputs)
    named = shared.or_default(LoadsFile)
    time = shared.or_default(TimeSpan).time
    forces = with_settings(ForceOptions(), settings)
    if live:
        motions = live_motions(scaled, motion, loads, mass, time, settings)
    else:
        motions = identifying.open_motions(scaled, motion, loads, time, named=named, forces=forces)
    motions += identifying.open_motions(
        scaled, check_motion, check_loads, held_out=True, named=named, forces=forces
    )
    sources = identifying.input_sources(
        model, (*motion, *check_motion), (*loads, *check_loads), shape
    )
    chosen = identifying.IdentifyOptions.of(settings)
    identified = identifying.identify_subject(scaled, motions, shape, mass, chosen, sources)
    lost = identifying.write_identified(identified, out, tables)
    notes = (*scaled.warnings, *identified.found.notes, *lost)
    return made(out, tables, identifying.summary(identified), notes)
