"""`transfer`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.cli.options import ModelFile, Threads, options_class, settings_dict, use_threads
from myomorph.cli.output import said, warn
from myomorph.identify.transfer_options import TransferOptions

TransferSettings = options_class(TransferOptions)


def transfer_command(
    *,
    model: ModelFile,
    to: Annotated[Path, Parameter(help="Model with more joints (.osim or .xml).")],
    out: Annotated[Path, Parameter(help="Model to write (.osim); tables go into a folder beside it.")],
    pose: Annotated[
        Path | None,
        Parameter(
            help="Coordinates of the subject's model (.mot or .sto) in whose first frame it stands much like the "
            "other's default pose; its own default pose without."
        ),
    ] = None,
    options: TransferSettings | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """A subject's lengths, marker positions and masses for a model with more joints."""
    # Imported by the command that needs it: --help and the others start without.
    from myomorph.store.settings import with_settings
    from myomorph.study.subject import transferring
    from myomorph.study.subject.subjects import check_out_model, tables_folder

    use_threads(threads)
    read = (model, to, *((pose,) if pose is not None else ()))
    check_out_model(out, tables_folder(out, transferring.TABLES), read)
    transferred = transferring.transfer_files(model, to, pose, with_settings(TransferOptions(), settings_dict(options)))
    lost = transferring.write_transferred(transferred, out)
    warn((*transferred.found.notes, *lost))
    for line in transferring.summary(transferred.found):
        said(line)
    said(f"wrote {out} and {tables_folder(out, transferring.TABLES)}")
    return 0
