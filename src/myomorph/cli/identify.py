"""`identify`."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from myomorph.cli.options import (
    LOADS_HELP,
    ModelFile,
    Threads,
    inputs_class,
    inputs_of_flags,
    options_class,
    settings_dict,
    use_threads,
)
from myomorph.cli.output import said, warn
from myomorph.identify.recordings import RecordingOptions
from myomorph.identify.subject import GENERIC, IdentificationOptions
from myomorph.live.identification import LiveOptions
from myomorph.store.settings import ForceOptions, with_settings
from myomorph.study.subject.subject_files import BodyOptions

IdentifySettings = options_class(ForceOptions, RecordingOptions, IdentificationOptions, BodyOptions, LiveOptions)
IdentifyInputs = inputs_class("loads", "time", leave_out=("loads",))

Motions = Annotated[
    tuple[Path, ...],
    Parameter(name="--motion", help="Coordinates over time, one file a recording.", consume_multiple=True),
]
Loads = Annotated[
    tuple[Path, ...],
    Parameter(
        name="--loads",
        help=f"External forces, one file a recording, in the same order: {LOADS_HELP}.",
        consume_multiple=True,
    ),
]


def identify_command(
    *,
    model: ModelFile,
    out: Annotated[Path, Parameter(help="Model to write (.osim); tables and a report go into a folder beside it.")],
    motion: Motions = (),
    loads: Loads = (),
    mass: Annotated[float | None, Parameter(help="Of the subject [kg]; the model's by default.")] = None,
    skin: Annotated[Path | None, Parameter(help="Mesh of the subject's skin: .obj, .stl or .ply.")] = None,
    landmarks: Annotated[
        Path | None, Parameter(help="Markers on the skin (CSV: name, x, y, z in metres), to pose the model in it.")
    ] = None,
    height: Annotated[float | None, Parameter(help="Of the subject [m], for a statistical body shape.")] = None,
    chest: Annotated[float | None, Parameter(help="Circumference of the chest [m].")] = None,
    sex: Annotated[Literal["female", "male"] | None, Parameter(help="Of the subject.")] = None,
    age: Annotated[float | None, Parameter(help="In years.")] = None,
    check_motion: Annotated[
        tuple[Path, ...],
        Parameter(help="Motions that are not identified from, to compare the models on.", consume_multiple=True),
    ] = (),
    check_loads: Annotated[tuple[Path, ...], Parameter(help="Their external loads.", consume_multiple=True)] = (),
    inputs: IdentifyInputs | None = None,  # type: ignore[valid-type]
    live: Annotated[
        bool, Parameter(negative=(), help="Show what is known so far while frames arrive, from the files or streams.")
    ] = False,
    options: IdentifySettings | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Masses, mass centers and inertias of every body from motions, their forces and the body's shape."""
    # Imported by the command that needs it: --help and the others start without.
    from myomorph.live.identification import live_motions
    from myomorph.study.inputs.loads import LoadsFile
    from myomorph.study.inputs.reading import open_model
    from myomorph.study.inputs.time_span import TimeSpan
    from myomorph.study.subject import identifying
    from myomorph.study.subject.subject_files import BodyShape
    from myomorph.study.subject.subjects import check_out_model, tables_folder

    use_threads(threads)
    check_out_model(out, read=(model,))
    settings = settings_dict(options)
    shape = BodyShape(skin, landmarks, height, chest, sex, age)
    scaled = open_model(model)
    shared = inputs_of_flags(inputs)
    named, time = shared.or_default(LoadsFile), shared.or_default(TimeSpan).time
    force_settings = {field.name: settings.pop(field.name) for field in fields(ForceOptions) if field.name in settings}
    forces = with_settings(ForceOptions(), force_settings)
    if live:
        motions = live_motions(scaled, motion, loads, mass, time, settings)
    else:
        motions = identifying.open_motions(scaled, motion, loads, time, named=named, forces=forces)
    motions += identifying.open_motions(scaled, check_motion, check_loads, held_out=True, named=named, forces=forces)
    sources = identifying.input_sources(model, (*motion, *check_motion), (*loads, *check_loads), shape)
    chosen = identifying.IdentifyOptions.of(settings)
    identified = identifying.identify_subject(scaled, motions, shape, mass, chosen, sources)
    lost = identifying.write_identified(identified, out)
    warn((*scaled.warnings, *identified.found.notes, *lost))
    for line in identifying.summary(identified.found):
        said(line)
    for name, validation in identified.validation.items():
        moment, force = validation.rms(identified.found.identified)
        generic = validation.rms(GENERIC)
        said(f"{name}, not used: {force:.1f} N, {moment:.1f} N m (generic {generic[1]:.1f} N, {generic[0]:.1f} N m)")
    said(f"wrote {out} and {tables_folder(out, identifying.STEP.tables)}")
    return 0
