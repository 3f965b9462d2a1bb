"""`personalize`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

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
from myomorph.report.trial.personalized import personal_lines
from myomorph.store.settings import Differentiation, ForceOptions
from myomorph.study.subject import personalizing

PersonalSettings = options_class(Differentiation, ForceOptions, *personalizing.STEP.options)
PersonalInputs = inputs_class("loads", "emg", "time", leave_out=("loads", "emg"))


def personalize_command(
    *,
    model: ModelFile,
    out: Annotated[Path, Parameter(help="Model to write (.osim); tables and a report go into a folder beside it.")],
    motion: Annotated[
        tuple[Path, ...],
        Parameter(help="Coordinates over time, one file a recording.", consume_multiple=True),
    ] = (),
    loads: Annotated[
        tuple[Path, ...],
        Parameter(
            help=f"External forces, one file a recording, in the same order: {LOADS_HELP}.", consume_multiple=True
        ),
    ] = (),
    torques: Annotated[
        tuple[Path, ...],
        Parameter(
            help="Instead of loads: torques of inverse dynamics (.sto), one a recording, in the same order.",
            consume_multiple=True,
        ),
    ] = (),
    emg: Annotated[
        tuple[Path, ...],
        Parameter(help="EMG, one a recording, in the same order; a channel named as a muscle.", consume_multiple=True),
    ] = (),
    passive: Annotated[
        tuple[Path, ...],
        Parameter(
            help="Measured passive torques (.sto): a pose a row by its coordinates, and COORDINATE_moment that resting "
            "muscles apply about them, blank where not measured.",
            consume_multiple=True,
        ),
    ] = (),
    generic: Annotated[
        Path | None, Parameter(help="The model that was scaled: muscles begin with its operating ranges.")
    ] = None,
    inputs: PersonalInputs | None = None,  # type: ignore[valid-type]
    options: PersonalSettings | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Fiber lengths, tendon slack lengths and strengths of a person's muscles, from torques and EMG."""
    from myomorph.study.inputs.reading import open_model
    from myomorph.study.subject.subjects import check_out_model, tables_folder

    use_threads(threads)
    check_out_model(out, read=(model, generic))
    files = personalizing.PersonalFiles(
        model,
        motion,
        loads,
        torques,
        emg,
        passive,
        generic,
        inputs_of_flags(inputs),
    )
    scaled = open_model(model)
    personalized = personalizing.personalize_files(files, settings_dict(options), scaled)
    lost = personalizing.write_personalized(personalized, out)
    tables = tables_folder(out, personalizing.STEP.tables)
    warn((*personalized.found.notes, *personalized.warnings, *lost), f"'{tables / personalizing.NOTES}' lists them")
    for line in personal_lines(personalized.found):
        said(line)
    said(f"wrote {out} and {tables}")
    return 0
