"""Soft-tissue motion of a subject's markers relative to the mass, from `identify` or `refine`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from myomorph.core.io.parsing.cells import csv_rows
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.lab.store.results import file_source
from myomorph.lab.study.inputs.input import Input, Opened, Opening
from myomorph.lab.study.inputs.keys import File

SOFT_TISSUE = "soft_tissue.csv"  # Table of `identify` and `refine`.


@dataclass(frozen=True)
class SoftTissueFile:
    """Soft tissue that was found for the subject.

    Attributes
    ----------
    soft_tissue : Soft-tissue motion of markers relative to the body's mass (soft_tissue.csv of
        `identify` or `refine`), which is removed from the motion before forces are computed.
    """

    soft_tissue: Annotated[Path | None, File()] = None


def read_soft_tissue(path: Path) -> SoftTissue:
    """Read a table of `identify` or `refine`. Raises `BadFile`: it is none."""
    from myomorph.lab.report.trial.identification_tables import SOFT_TISSUE_HEAD

    hint = "give soft_tissue.csv of the folder that identify or refine wrote beside its model"
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            head, *rows = csv_rows(stream)
        if tuple(head) != SOFT_TISSUE_HEAD:
            raise BadFile(
                path,
                f"has the columns {', '.join(head[:4])}, not {', '.join(SOFT_TISSUE_HEAD)}",
                hint,
            )
        names, groups, alpha, sd = zip(*rows, strict=True) if rows else ((), (), (), ())
        return SoftTissue(
            names=names, groups=groups, alpha=np.array(alpha, float), sd=np.array(sd, float)
        )
    except (OSError, ValueError, BadData) as error:
        raise BadFile(path, f"cannot be read as soft tissue ({error})", hint) from error


def _open(settings: SoftTissueFile, opening: Opening) -> Opened:
    path = settings.soft_tissue
    # The table is empty where markers move as the mass does.
    if path is None or not (tissue := read_soft_tissue(path)).names:
        return Opened()
    assumed = f"Forces are of the motion without soft tissue, by {path.name}"
    return Opened((tissue,), (file_source("soft tissue", path),), assumed=(assumed,))


INPUT = Input(name="soft tissue", settings=SoftTissueFile, open=_open, main="soft_tissue")
