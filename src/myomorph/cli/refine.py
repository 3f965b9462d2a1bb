"""`refine`."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.cli.identify import Loads
from myomorph.cli.options import (
    ForceBodies,
    LabelsFile,
    ModelFile,
    PlateBodies,
    Threads,
    Time,
    labels_of,
    options_class,
    settings_dict,
    use_threads,
)
from myomorph.cli.output import said, warn
from myomorph.identify.refine.options import RefineOptions
from myomorph.store.settings import ForceOptions, with_settings

RefineSettings = options_class(ForceOptions, RefineOptions)


def refine_command(
    *,
    model: ModelFile,
    out: Annotated[
        Path, Parameter(help="Model to write (.osim); motions, tables and a report go into a folder beside it.")
    ],
    markers: Annotated[
        tuple[Path, ...], Parameter(help="Recordings: .trc, .c3d, .mat or .h5, one or more.", consume_multiple=True)
    ] = (),
    loads: Loads = (),
    bodies: ForceBodies = (),
    plates: PlateBodies = "",
    mass: Annotated[float | None, Parameter(help="Of the subject [kg]; the model's by default.")] = None,
    tasks: Annotated[Path | None, Parameter(help="OpenSim task set or setup file: weights of markers.")] = None,
    labels: LabelsFile = None,
    time: Time = None,
    options: RefineSettings | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Motions, link lengths, marker positions and masses that agree with markers and force plates at once."""
    # Imported by the command that needs it: --help and the others start without.
    from myomorph.model.errors import BadData
    from myomorph.study.inputs.external_forces import bodies_of
    from myomorph.study.subject import refining
    from myomorph.study.subject.subjects import check_out_model
    from myomorph.study.trial.trial_files import TrialFiles

    use_threads(threads)
    check_out_model(out, read=(model,))
    if not markers or len(markers) != len(loads):
        raise BadData(
            f"{len(markers)} recordings of markers and {len(loads)} files of forces: give one of each for every "
            "recording, in the same order"
        )
    settings = settings_dict(options)
    forces = {field.name: settings.pop(field.name) for field in fields(ForceOptions) if field.name in settings}
    named = bodies_of(bodies, plates)
    names = [path.stem for path in markers]
    if len(set(names)) < len(names):
        names = [f"{path.parent.name}_{path.stem}" for path in markers]
    files = [
        TrialFiles(
            model=model, name=name, markers=marker_file, loads=load_file, bodies=named.bodies, plates=named.plates,
            tasks=tasks, time=time, labels=labels_of(labels),
        )
        for name, marker_file, load_file in zip(names, markers, loads, strict=True)
    ]  # fmt: skip
    chosen = with_settings(RefineOptions(), settings)
    found = refining.refine_files(model, files, mass, chosen, {"id": forces} if forces else {})
    lost = refining.write_refined(found, out)
    warn((*found.found.notes, *found.warnings, *lost))
    for line in refining.summary(found.found):
        said(line)
    said(f"wrote {out} and {refining.tables_folder(out)}")
    return 0
