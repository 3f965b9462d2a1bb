"""How much more a subject's markers move than the body's mass, as `identify` found it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from myomorph.study.inputs.input import Input, later
from myomorph.study.inputs.keys import File


@dataclass(frozen=True)
class SoftTissueFile:
    """Soft tissue of a subject.

    Attributes
    ----------
    soft_tissue : how much more markers move than the body's mass: soft_tissue.csv of `identify`; it is taken from the
        motion before forces are computed
    """

    soft_tissue: Annotated[Path | None, File()] = None


INPUT = Input(
    name="soft tissue",
    settings=SoftTissueFile,
    open=later("myomorph.study.inputs.soft_tissue_file:opened"),
    main="soft_tissue",
)
