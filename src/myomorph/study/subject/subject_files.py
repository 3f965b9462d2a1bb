"""The files of one subject, and the model that its own steps make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from myomorph.model.model import Model
from myomorph.study.subject.body_shape import BodyShape
from myomorph.study.subject.morph_files import MorphFiles
from myomorph.study.trial.inputs import open_model
from myomorph.study.trial.takes import FileTake

SUBJECT_STEPS = ("morph", "calibrate", "identify")
"""In the order in which they run."""


MODELS = {"morph": "morphed.osim", "calibrate": "calibrated.osim", "identify": "identified.osim"}


TABLES = {"morph": "morph", "calibrate": "calibration", "identify": "identification"}


@dataclass(frozen=True)
class SubjectFiles:
    """One subject of a study.

    Attributes
    ----------
    model : generic or scaled
    static : recording of standing still, for calibration
    shape : what is known of the body, for identification
    takes : the subject's recordings
    bones : the subject's own, for a morph
    model_of : subject whose own steps make the model that this one begins with, "" where a file is
    drawn : file beside which the meshes of that model lie, None where they lie beside it
    """

    name: str
    model: Path
    mass: float | None = None
    static: Path | None = None
    shape: BodyShape = field(default_factory=BodyShape)
    takes: tuple[FileTake, ...] = ()
    bones: MorphFiles | None = None
    model_of: str = ""
    drawn: Path | None = None


@dataclass(frozen=True)
class MadeModel:
    """Where a subject's own steps leave the model that the trials use.

    Attributes
    ----------
    path : of its file
    drawn : file beside which its meshes lie
    """

    path: Path
    drawn: Path

    def open(self) -> Model:
        """The model; raises `BadFile` or `BadModel`."""
        model = open_model(self.path)
        # A morph brings its own bones; the others are drawn by the meshes of the model they began with.
        return model if self.drawn == self.path else replace(model, source=str(self.drawn))


def made_model(files: SubjectFiles, steps: Sequence[str], folder: Path) -> MadeModel:
    """The model that a subject's trials use once its own steps are done."""
    made = MadeModel(files.model, files.drawn or files.model)
    for step in SUBJECT_STEPS:
        if step in steps:
            path = folder / MODELS[step]
            made = MadeModel(path, path if step == "morph" else made.drawn)
    return made
