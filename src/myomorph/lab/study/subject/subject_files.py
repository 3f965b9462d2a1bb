"""One subject of a study.

It has its files, the shape of its body, the steps on it, and the model that they make.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Provenance
from myomorph.lab.store.results import file_name, file_sources, provenance_of, value_source
from myomorph.lab.study.inputs.error_size_tables import TABLE as ERROR_SIZES
from myomorph.lab.study.inputs.input import ByType
from myomorph.lab.study.inputs.laboratory import AS_RECORDED, Laboratory
from myomorph.lab.study.inputs.motion import MotionFile
from myomorph.lab.study.inputs.reading import open_model
from myomorph.lab.study.step.step import Step, step_of
from myomorph.lab.study.step.step_table import STEPS
from myomorph.lab.study.trial.trial_inputs import Settings, TrialFiles, TrialInputs, open_trial


@dataclass(frozen=True)
class BodyOptions:
    """How the mass of a body is laid out before it is identified.

    Attributes
    ----------
    spacing : spacing of the grid of mass points [m]
    weights : assignment of mass points to links: by the distance to the bones, to the links' mass
        centers ([D] eq. 3.14), or to the nearest mass center only (3.15); by default to the bones
        in a skin, and each link's own points if only its envelope is known
    density : density inside a skin: the same everywhere ([D]), or that of each segment, lower in
        the trunk with its lungs (Dempster 1955)
    """

    spacing: float = 0.005
    weights: Literal["bone", "cog", "nearest"] | None = None
    density: Literal["even", "segments"] = "even"


@dataclass(frozen=True)
class BodyShape:
    """What is known of the subject's shape; nothing means envelopes of the model's own bodies.

    Attributes
    ----------
    skin : mesh file
    landmarks : table of markers on the skin (CSV: name, x, y, z), to pose the model in it
    height, chest : of the subject [m]
    sex : "female" or "male"
    age : [years]
    """

    skin: Path | None = None
    landmarks: Path | None = None
    height: float | None = None
    chest: float | None = None
    sex: Literal["female", "male"] | None = None
    age: float | None = None


@dataclass(frozen=True)
class KnownBody:
    """What is known of a subject's body.

    Attributes
    ----------
    shape : of the body
    mass : [kg], None for the model's
    """

    shape: BodyShape
    mass: float | None = None


@dataclass(frozen=True)
class SubjectFiles:
    """One subject of a study.

    Attributes
    ----------
    name : of the subject
    mass : of the body [kg], None for the model's
    model : generic or scaled
    static : recording of standing still, for calibration
    shape : what is known of the body, for identification
    trials : the subject's recordings
    own : values of the tables that steps bring, by their types
    model_of : subject whose own steps make the model that this one begins with, "" where a file is
    drawn : file beside which the meshes of that model lie, None where they lie beside it
    labels : what the model calls markers that the recordings call otherwise
    static_laboratory : how the axes of the static recording stand to the model's
    passive : tables of measured passive torques, for personalization
    generic : the model that was scaled, for personalization; None for the one before calibration,
        where there is one
    detailed : model with more joints, for a transfer
    """

    name: str
    model: Path
    mass: float | None = None
    static: Path | None = None
    shape: BodyShape = field(default_factory=BodyShape)
    trials: tuple[TrialFiles, ...] = ()
    own: ByType = field(default_factory=ByType)
    model_of: str = ""
    drawn: Path | None = None
    labels: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    static_laboratory: Laboratory = AS_RECORDED
    passive: tuple[Path, ...] = ()
    generic: Path | None = None
    detailed: Path | None = None


@dataclass(frozen=True)
class MadeModel:
    """Where a subject's own steps leave the model that the trials use.

    Attributes
    ----------
    path : of the model
    drawn : the file beside which its meshes lie
    left : what the steps leave, by use (`Step.leaves`): gains of EMG channels, folders with refined
        coordinates of trials and with those transferred to a model of more joints, table of how
        much more markers move than the mass (no file where they do not)
    sizes : tables of how far off the model may be; where a step finds none the file does not exist
    """

    path: Path
    drawn: Path
    left: Mapping[str, Path]
    sizes: tuple[Path, ...] = ()

    def open(self) -> Model:
        """Read the model; raise `BadFile` or `BadModel`."""
        model = open_model(self.path)
        # A morph brings its own bones; the others are drawn by the meshes of the model they began
        # with.
        return model if self.drawn == self.path else replace(model, source=str(self.drawn))


@dataclass(frozen=True)
class SubjectInputs:
    """What a step on a subject begins with.

    It has its files, all steps' settings, and the model (with its file) that the steps `done` have
    made; the model's source is the file beside which its meshes lie. `carried`: folder of the
    motions that were transferred to it.
    """

    files: SubjectFiles
    settings: Settings
    path: Path
    model: Model
    done: tuple[str, ...] = ()
    carried: Path | None = None

    def trials(self) -> list[TrialInputs]:
        """Open the subject's recordings with this model."""
        files = [
            carried_trial(replace(trial, model=self.path), self.carried)
            for trial in self.files.trials
        ]
        return [open_trial(trial, self.settings, self.model) for trial in files]

    def after(self, step: Step[Any], home: Path) -> SubjectInputs:
        """Return the same with the model that a step has left."""
        done = (*self.done, step.name)
        made = made_model(self.files, done, home)
        return replace(
            self, path=made.path, model=made.open(), done=done, carried=made.left.get("carried")
        )


def carried_trial(trial: TrialFiles, carried: Path | None) -> TrialFiles:
    """Return a trial that goes on with the motion of a folder where one was transferred for it."""
    return (
        trial
        if carried is None
        else trial.having(MotionFile(carried / f"{file_name(trial.name)}.mot"))
    )


def recordings_provenance(
    step: str,
    subject: SubjectInputs,
    more: Mapping[str, object] = FrozenMap({}),
    earlier: Sequence[str] = (),
) -> Provenance:
    """Return what a step's result from all recordings of a subject is derived from.

    It names the model so far, the recordings, its options and `more`, the settings of `earlier`
    steps of trials.
    """
    files = subject.files
    sources = list(dict.fromkeys(source for trial in subject.trials() for source in trial.sources))
    shape = files.shape
    sources += file_sources(
        ("static", files.static), ("skin", shape.skin), ("landmarks", shape.landmarks)
    )
    if files.static is not None and (files.static_laboratory or files.labels):
        values = (files.static_laboratory, sorted(files.labels.items()))
        sources.append(value_source("static", "axes and labels of the static recording", *values))
    options: dict[str, object] = {"mass": files.mass}
    options["times"] = [None if trial.time is None else list(trial.time) for trial in files.trials]
    for name in (step, *earlier):
        options |= {
            f"{name}.{setting}": value for setting, value in subject.settings.get(name, {}).items()
        }
    return provenance_of(step, sources, options | dict(more))


def made_model(files: SubjectFiles, steps: Sequence[str], folder: Path) -> MadeModel:
    """Return the model that a subject's trials use once its own steps are done."""
    left = {"model": files.model, "meshes": files.drawn or files.model}
    sizes = list[Path]()
    for step in [step_of(name, "subject") for name in STEPS["subject"] if name in steps]:
        if "carried" in step.leaves and files.detailed is not None:
            left["meshes"] = files.detailed
        left |= {use: folder / name for use, name in step.leaves.items()}
        sizes.append(folder / step.tables / ERROR_SIZES)
    return MadeModel(
        path=left["model"], drawn=left["meshes"], left=FrozenMap(left), sizes=tuple(sizes)
    )
