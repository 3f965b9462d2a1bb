"""`personalize`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.lab.cli import options as flags
from myomorph.lab.cli.output import made
from myomorph.lab.report.trial.personalized import personal_lines
from myomorph.lab.store.settings import Differentiation, ForceOptions
from myomorph.lab.study.step.folder_steps import NOTES
from myomorph.lab.study.subject import personalizing

PersonalSettings = flags.options_class(Differentiation, ForceOptions, *personalizing.STEP.options)
PersonalInputs = flags.inputs_class("loads", "emg", "time", leave_out=("loads", "emg"))


@flags.documented
@dataclass(frozen=True, kw_only=True)
class Recordings:
    """What a person's muscles are fitted to.

    Attributes
    ----------
    out : model to write (.osim); tables and a report go into a folder next to it
    motion : coordinates over time, one file per recording
    torques : joint torques of inverse dynamics (.sto) instead of loads, one file per recording, in
        the same order
    emg : EMG, one file per recording, in the same order; channels are named as muscles
    passive : measured passive torques (.sto), one row per pose: coordinates, and in
        COORDINATE_moment the torque of the relaxed muscles [N m], blank where not measured
    generic : generic model from which the subject's was scaled; its ranges of normalized fiber
        length are the starting point
    """

    model: flags.ModelFile
    out: Path
    motion: tuple[Path, ...] = ()
    loads: flags.Loads = ()
    torques: tuple[Path, ...] = ()
    emg: tuple[Path, ...] = ()
    passive: tuple[Path, ...] = ()
    generic: Path | None = None


@flags.documented
def personalize_command(
    *,
    recordings: Annotated[Recordings, Parameter(name="*")],
    inputs: PersonalInputs | None = None,  # type: ignore[valid-type]
    options: PersonalSettings | None = None,  # type: ignore[valid-type]
    threads: flags.Threads = None,
) -> int:
    """Fit fiber lengths, tendon slack lengths and strengths of a person's muscles.

    They are fitted to torques and EMG.
    """
    from myomorph.lab.study.inputs.reading import open_model
    from myomorph.lab.study.subject.subjects import tables_folder

    flags.use_threads(threads)
    out = recordings.out
    tables = tables_folder(out, personalizing.STEP.tables, (recordings.model, recordings.generic))
    files = personalizing.PersonalFiles(
        model=recordings.model,
        motion=recordings.motion,
        loads=recordings.loads,
        torques=recordings.torques,
        emg=recordings.emg,
        passive=recordings.passive,
        generic=recordings.generic,
        inputs=flags.inputs_of_flags(inputs),
    )
    scaled = open_model(recordings.model)
    personalized = personalizing.personalize_files(files, flags.settings_dict(options), scaled)
    lost = personalizing.write_personalized(personalized, out, tables)
    notes = (*personalized.found.notes, *personalized.warnings, *lost)
    return made(
        out,
        tables,
        personal_lines(personalized.found),
        notes,
        f"'{tables / NOTES}' lists them",
    )
