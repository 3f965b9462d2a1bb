"""`transfer`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.body.identify.transfer_options import TransferOptions
from myomorph.lab.cli.options import (
    ModelFile,
    Threads,
    documented,
    options_class,
    settings_dict,
    use_threads,
)
from myomorph.lab.cli.output import made

TransferSettings = options_class(TransferOptions)


@documented
@dataclass(frozen=True, kw_only=True)
class TransferFiles:
    """The files of a transfer.

    Attributes
    ----------
    to : model with more joints (.osim or .xml), which gets the subject's lengths, markers and
        masses
    out : model to write (.osim); tables go into a folder next to it
    pose : coordinates of the subject's model (.mot or .sto), whose first frame resembles the other
        model's default pose; by default the subject model's own default pose
    motion : coordinates of the subject's model over time, also transferred and written into the
        folder 'motions' of the tables
    """

    model: ModelFile
    to: Path
    out: Path
    pose: Path | None = None
    motion: tuple[Path, ...] = ()


@documented
def transfer_command(
    *,
    files: Annotated[TransferFiles, Parameter(name="*")],
    options: TransferSettings | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Transfer a subject's lengths, marker positions and masses to a model with more joints."""
    from myomorph.lab.store.settings import with_settings
    from myomorph.lab.study.subject import transferring
    from myomorph.lab.study.subject.subjects import tables_folder

    use_threads(threads)
    tables = tables_folder(
        files.out,
        transferring.STEP.tables,
        (files.model, files.to, files.pose, *files.motion),
    )
    chosen = with_settings(TransferOptions(), settings_dict(options))
    transferred = transferring.transfer_files(
        files.model, files.to, files.pose, chosen, files.motion
    )
    lost = transferring.write_transferred(transferred, files.out, tables)
    notes = (*transferred.found.notes, *lost)
    return made(files.out, tables, transferring.summary(transferred), notes)
