"""`refine`."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.body.refine.options import RefineOptions
from myomorph.lab.cli import options as flags
from myomorph.lab.cli.output import made
from myomorph.lab.store.settings import ForceOptions, with_settings

RefineSettings = flags.options_class(ForceOptions, RefineOptions)
RefineInputs = flags.inputs_class(
    "loads", "tasks", "labels", "laboratory", "time", leave_out=("loads",)
)


@flags.documented
@dataclass(frozen=True, kw_only=True)
class RefineFiles:
    """The files of a refinement, and the subject's mass.

    Attributes
    ----------
    out : model to write (.osim); motions, tables and a report go into a folder next to it
    markers : one or more recordings of markers (.trc, .c3d, .mat or .h5)
    mass : body mass of the subject [kg]; by default that of the model
    """

    model: flags.ModelFile
    out: Path
    markers: tuple[Path, ...] = ()
    loads: flags.Loads = ()
    mass: float | None = None


@flags.documented
def refine_command(
    *,
    files: Annotated[RefineFiles, Parameter(name="*")],
    inputs: RefineInputs | None = None,  # type: ignore[valid-type]
    options: RefineSettings | None = None,  # type: ignore[valid-type]
    threads: flags.Threads = None,
) -> int:
    """Fit motions, link lengths, marker positions and masses to markers and plates at once."""
    from myomorph.core.model.errors import BadData
    from myomorph.lab.study.inputs.loads import LoadsFile
    from myomorph.lab.study.inputs.markers import MarkersFile
    from myomorph.lab.study.subject import refining
    from myomorph.lab.study.subject.subjects import tables_folder
    from myomorph.lab.study.trial.trial_inputs import TrialFiles

    flags.use_threads(threads)
    tables = tables_folder(files.out, refining.STEP.tables, (files.model,))
    if not files.markers or len(files.markers) != len(files.loads):
        raise BadData(
            f"{len(files.markers)} recordings of markers and {len(files.loads)} files of forces:"
            " give one of each for every recording, in the same order"
        )
    settings = flags.settings_dict(options)
    forces = {
        field.name: settings.pop(field.name)
        for field in fields(ForceOptions)
        if field.name in settings
    }
    shared = flags.inputs_of_flags(inputs)
    named = shared.or_default(LoadsFile)
    names = [path.stem for path in files.markers]
    if len(set(names)) < len(names):
        names = [f"{path.parent.name}_{path.stem}" for path in files.markers]
    trials = [
        TrialFiles(
            files.model,
            name,
            inputs=shared.having(MarkersFile(marker_file), replace(named, loads=load_file)),
        )
        for name, marker_file, load_file in zip(names, files.markers, files.loads, strict=True)
    ]
    chosen = with_settings(RefineOptions(), settings)
    refined = refining.refine_files(
        files.model, trials, files.mass, chosen, {"id": forces} if forces else {}
    )
    lost = refining.write_refined(refined, files.out, tables)
    notes = (*refined.found.notes, *refined.warnings, *lost)
    return made(files.out, tables, refining.summary(refined.found), notes)
