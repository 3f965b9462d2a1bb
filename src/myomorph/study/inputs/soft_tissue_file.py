"""The table of soft tissue that `identify` writes, read."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from myomorph.model.errors import BadData, BadFile
from myomorph.model.soft_tissue import SoftTissue
from myomorph.report.trial.identification_tables import SOFT_TISSUE_HEAD
from myomorph.store.results import file_source
from myomorph.study.inputs.input import Opened, Opening
from myomorph.study.inputs.soft_tissue import SoftTissueFile


def read_soft_tissue(path: Path) -> SoftTissue:
    """Read a table of `identify`. Raises `BadFile`: it is none."""
    hint = "give soft_tissue.csv of the folder that identify wrote beside its model"
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            head, *rows = csv.reader(stream)
        if tuple(head) != SOFT_TISSUE_HEAD:
            raise BadFile(path, f"has the columns {', '.join(head[:4])}, not {', '.join(SOFT_TISSUE_HEAD)}", hint)
        names, groups, alpha, sd = zip(*rows, strict=True) if rows else ((), (), (), ())
        return SoftTissue(names, groups, np.array(alpha, float), np.array(sd, float))
    except (OSError, ValueError, BadData) as error:
        raise BadFile(path, f"cannot be read as soft tissue ({error})", hint) from error


def opened(settings: SoftTissueFile, opening: Opening) -> Opened:
    """Soft tissue of a trial's subject."""
    path = settings.soft_tissue
    tissue = None if path is None else read_soft_tissue(path)
    # The table of `identify` is empty where markers move as the mass does.
    if path is None or tissue is None or not tissue.names:
        return Opened()
    return Opened(
        (tissue,),
        (file_source("soft tissue", path),),
        assumed=(f"Forces are of the motion without soft tissue, as {path.name} says it",),
    )
