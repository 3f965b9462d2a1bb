"""One subject of a study: its files, the shape of its body, the steps on it, and the model that they make."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Literal

from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import Model
from myomorph.model.provenance import Provenance
from myomorph.store.results import file_source, provenance_of, value_source
from myomorph.study.inputs.error_sizes import TABLE as ERROR_SIZES
from myomorph.study.inputs.laboratory import AS_RECORDED, Laboratory
from myomorph.study.inputs.reading import open_model
from myomorph.study.subject.morph_files import MorphFiles
from myomorph.study.trial.open_trial import open_trial
from myomorph.study.trial.step import StepHead
from myomorph.study.trial.trial_files import Settings, TrialFiles
from myomorph.study.trial.trial_inputs import TrialInputs

WEIGHTS = ("bone", "cog", "nearest")


@dataclass(frozen=True)
class BodyOptions:
    """How the mass of a body is laid out before it is identified.

    Attributes
    ----------
    spacing : of the grid of mass points [m]
    weights : which links a mass point belongs to: by its distance to the bones, to the links' mass centers ([D] eq.
        3.14), or to the nearest mass center only (3.15); by default to the bones in a skin, and each link's own
        points where only its envelope is known
    density : inside a skin, the same everywhere ([D]), or that of each segment, the trunk light with its lungs
        (Dempster 1955)
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


SUBJECT_STEPS: dict[str, str] = {
    "morph": "myomorph.study.subject.morphing",
    "calibrate": "myomorph.study.subject.calibrating",
    "refine": "myomorph.study.subject.refining",
    "identify": "myomorph.study.subject.identifying",
    "personalize": "myomorph.study.subject.personalizing",
    "emg": "myomorph.study.subject.emg_gains_step",
}
"""Steps that make the model of a subject's trials, in the order in which they run: a name, and the module whose `STEP`
it is; read when first needed."""


@dataclass(frozen=True)
class SubjectFiles:
    """One subject of a study.

    Attributes
    ----------
    model : generic or scaled
    static : recording of standing still, for calibration
    shape : what is known of the body, for identification
    trials : the subject's recordings
    bones : the subject's own, for a morph
    model_of : subject whose own steps make the model that this one begins with, "" where a file is
    drawn : file beside which the meshes of that model lie, None where they lie beside it
    labels : what the model calls markers that the recordings call otherwise
    static_laboratory : how the axes of the static recording stand to the model's
    passive : tables of measured passive torques, for personalization
    generic : the model that was scaled, for personalization; None for the one before calibration, where there is one
    """

    name: str
    model: Path
    mass: float | None = None
    static: Path | None = None
    shape: BodyShape = field(default_factory=BodyShape)
    trials: tuple[TrialFiles, ...] = ()
    bones: MorphFiles | None = None
    model_of: str = ""
    drawn: Path | None = None
    labels: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    static_laboratory: Laboratory = AS_RECORDED
    passive: tuple[Path, ...] = ()
    generic: Path | None = None


@dataclass(frozen=True)
class MadeModel:
    """Where a subject's own steps leave the model that the trials use.

    Attributes
    ----------
    path : of its file
    drawn : file beside which its meshes lie
    gains : of the subject's EMG channels, None where no step finds them
    motions : folder with refined coordinates of the subject's trials, None where no step finds them
    sizes : tables of how far off the model may be, one of each step; where a step finds none it is not there
    """

    path: Path
    drawn: Path
    gains: Path | None = None
    motions: Path | None = None
    sizes: tuple[Path, ...] = ()

    def open(self) -> Model:
        """The model; raises `BadFile` or `BadModel`."""
        model = open_model(self.path)
        # A morph brings its own bones; the others are drawn by the meshes of the model they began with.
        return model if self.drawn == self.path else replace(model, source=str(self.drawn))


@dataclass(frozen=True)
class Prepared:
    """The model that a subject's trials use.

    Attributes
    ----------
    path : of its file
    model : itself; its source is the file beside which its meshes lie
    done, reused : steps that made it, and those reused from an earlier run
    changed : what made steps be computed again that an earlier run had done
    timed : each step that was computed, and how long it took [s]
    """

    path: Path
    model: Model
    done: tuple[str, ...] = ()
    reused: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    timed: tuple[tuple[str, float], ...] = ()

    def trials(self, files: SubjectFiles, settings: Settings) -> list[TrialInputs]:
        """The subject's recordings with this model."""
        return [open_trial(replace(trial, model=self.path), settings, self.model) for trial in files.trials]


def recordings_provenance(
    step: str, files: SubjectFiles, prepared: Prepared, settings: Settings, more: Mapping[str, object]
) -> Provenance:
    """What a step makes of all recordings of a subject is derived from: the model so far, the recordings, its options.

    Parameters
    ----------
    more : further options that the step depends on
    """
    sources = list(dict.fromkeys(source for trial in prepared.trials(files, settings) for source in trial.sources))
    given = (("static", files.static), ("skin", files.shape.skin), ("landmarks", files.shape.landmarks))
    sources += [file_source(role, path) for role, path in given if path is not None]
    if files.static is not None and (files.static_laboratory or files.labels):
        values = (files.static_laboratory, sorted(files.labels.items()))
        sources.append(value_source("static", "axes and labels of the static recording", *values))
    options: dict[str, object] = {f"{step}.{name}": value for name, value in settings.get(step, {}).items()}
    times = [None if one.time is None else list(one.time) for one in files.trials]
    return provenance_of(step, sources, options | {"mass": files.mass, "times": times} | dict(more))


@dataclass(frozen=True, kw_only=True)
class SubjectStep(StepHead):
    """A step on a subject, which makes the model of its trials.

    Attributes
    ----------
    model : name of the file of that model, "" of a step that leaves the model as it is
    tables : folder beside it
    run : from the files, the model so far, settings and provenance to the model's file and its tables
    provenance : what the model is derived from
    gains : file in `tables` with the gains of the subject's EMG channels, "" for none
    motions : folder in `tables` with coordinates of the subject's trials, "" for none
    brings_bones : whether the model has meshes of its own; those of other steps are drawn by what they began with
    """

    model: str
    tables: str
    run: Callable[[SubjectFiles, Prepared, Settings, Provenance, Path, Path], object]
    provenance: Callable[[SubjectFiles, Prepared, Settings], Provenance]
    brings_bones: bool = False
    gains: str = ""
    motions: str = ""


def subject_step(name: str) -> SubjectStep:
    """A step of `SUBJECT_STEPS`."""
    return import_module(SUBJECT_STEPS[name]).STEP


def made_model(files: SubjectFiles, steps: Sequence[str], folder: Path) -> MadeModel:
    """The model that a subject's trials use once its own steps are done."""
    made = MadeModel(files.model, files.drawn or files.model)
    for step in [subject_step(name) for name in SUBJECT_STEPS if name in steps]:
        path = folder / step.model if step.model else made.path
        gains = folder / step.tables / step.gains if step.gains else made.gains
        motions = folder / step.tables / step.motions if step.motions else made.motions
        sizes = (*made.sizes, folder / step.tables / ERROR_SIZES)
        made = MadeModel(path, path if step.brings_bones else made.drawn, gains, motions, sizes)
    return made
