"""How far off the model may be, as the steps found that made it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from myomorph.study.inputs.error_size_tables import read_error_sizes, tables_beside
from myomorph.study.inputs.input import Input, Opened, Opening


@dataclass(frozen=True)
class ErrorSizeTables:
    """Tables of sizes of errors, in the order of the steps that found them; () for those beside the model."""

    paths: tuple[Path, ...] = ()


def _open(settings: ErrorSizeTables, opening: Opening) -> Opened:
    return Opened((read_error_sizes(settings.paths or tables_beside(opening.model_file)),))


INPUT = Input(name="error sizes", settings=ErrorSizeTables, open=_open)
