"""A plan as a graph of jobs.

Jobs are of subjects, of trials, of trials of several subjects that are solved as one, and of the
study.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from myomorph.body.refine.options import RefineOptions
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.motion.sync import cut
from myomorph.lab.store.locks import RunMark
from myomorph.lab.store.outcome import GATHERED, Key, Outcome
from myomorph.lab.store.results import STORED, file_name, file_source, read_result
from myomorph.lab.store.settings import TrialMotion, with_settings
from myomorph.lab.study.inputs.emg import EmgFiles
from myomorph.lab.study.inputs.error_size_tables import ErrorSizeTables
from myomorph.lab.study.inputs.reading import open_model
from myomorph.lab.study.inputs.refined import RefinedFile
from myomorph.lab.study.inputs.soft_tissue import SoftTissueFile
from myomorph.lab.study.plan.plan import Plan
from myomorph.lab.study.run.work import Graph, Recording, Work, outcome_of
from myomorph.lab.study.step.folder_steps import FolderSteps
from myomorph.lab.study.step.job_steps import JobSteps
from myomorph.lab.study.step.step import large_variables, step_of
from myomorph.lab.study.step.step_table import REPORT, STEPS
from myomorph.lab.study.subject.subject_files import (
    MadeModel,
    SubjectFiles,
    SubjectInputs,
    carried_trial,
    made_model,
)
from myomorph.lab.study.summary.study_inputs import StudyInputs
from myomorph.lab.study.trial.run_trial import TrialSteps
from myomorph.lab.study.trial.steps import ik
from myomorph.lab.study.trial.together import Part, Together, join_trials, object_part
from myomorph.lab.study.trial.trial_inputs import Settings, TrialFiles, open_trial
from myomorph.lab.study.trial.trial_step import StepResults

# The step of a study that gathers the values of its trials; it is not told of where it ends well.
TABLES = "tables"


def _open_trial_steps(
    model: Model | None,
    read: str,
    fresh: bool,
    *,
    files: TrialFiles,
    steps: tuple[str, ...],
    settings: Settings,
    folder: Path,
) -> JobSteps:
    """Open the steps of a trial."""
    if read and file_source("model", files.model).sha256 != read:
        raise BadData(f"{files.model}: has changed while the study ran: run it again")
    return TrialSteps(
        trial=open_trial(files, settings, model), asked=steps, folder=folder, fresh=fresh
    )


def _open_subject_steps(
    model: Model | None,
    read: str,
    fresh: bool,
    *,
    files: SubjectFiles,
    settings: Settings,
    folder: Path,
) -> JobSteps:
    """Open a subject's own steps, which make the model of its trials."""
    assert model is not None
    inputs = SubjectInputs(files=files, settings=settings, path=files.model, model=model)
    return FolderSteps(
        scope="subject", inputs=inputs, outcome=Outcome(files.name, "", folder), fresh=fresh
    )


@dataclass(frozen=True)
class _SubjectPart:
    """The trial of a subject that is solved with those of others.

    Attributes
    ----------
    files : of the trial
    home : folder of the results of its own steps
    settings : of its own steps
    """

    files: TrialFiles
    home: Path
    settings: Settings

    def joined(self, subject: str, model: Model) -> Part:
        """Read the coordinates that its own steps found."""
        path = self.home / f"{file_name(self.files.name)}{STORED}"
        trial = open_trial(self.files, self.settings, model)
        stored = read_result(path, large_variables())
        poses = ik.STEP.read(stored, trial.options)
        if poses is None:
            raise BadData(
                f"{path}: holds no coordinates: run the step 'ik' of subject '{subject}' first"
            )
        recorded = poses.recorded if trial.time is None else cut(poses.recorded, *trial.time)
        return Part(
            trial=trial,
            recorded=recorded,
            source=str(self.files.model),
            made=stored.provenance["ik"].key,
        )


def _open_pair_steps(
    model: Model | None,
    read: str,
    fresh: bool,
    *,
    together: Together,
    parts: Mapping[str, _SubjectPart],
    models: Mapping[Path, MadeModel],
    common: Settings,
    folder: Path,
) -> JobSteps:
    """Open the steps of several trials as one, from the coordinates that their own steps found.

    `parts` are by subject; `models` are by file those that a subject's own steps made; `common`
    settings are of the steps of all as one.
    """
    opened: dict[Path, Model] = {}
    joined: dict[str, Part] = {}
    for subject, part in parts.items():
        file = part.files.model
        if file not in opened:
            opened[file] = models[file].open() if file in models else open_model(file)
        joined[subject] = part.joined(subject, opened[file])
    joined |= {table.name: object_part(table, path) for table, path in together.objects}
    trial, start = join_trials(together, joined, common)
    return TrialSteps(
        trial=trial,
        asked=(*STEPS["pair"], REPORT),
        folder=folder,
        fresh=fresh,
        results=StepResults(start),
    )


def _open_study_steps(
    model: Model | None, read: str, fresh: bool, *, inputs: StudyInputs, key: Key
) -> JobSteps:
    """Open what is done for the whole study."""
    outcome = outcome_of(key, inputs.out)
    return FolderSteps(scope="study", inputs=inputs, outcome=outcome, fresh=fresh)


def graph_of(plan: Plan, out: Path, fresh: bool = False, mark: RunMark | None = None) -> Graph:
    """Return what a study has to do, `fresh` whatever an earlier run left.

    `mark` is the run that the folder belongs to.
    """
    works = _Works(plan, out)
    for files, steps in zip(plan.trials, plan.steps, strict=True):
        works.trial(files, steps)
    for together in plan.together:
        works.pair(together)
    models = {made.path: made for made in works.made.values()}

    def model_of(path: Path) -> Model:
        return models[path].open() if path in models else open_model(path)

    def last(outcomes: tuple[Outcome, ...]) -> tuple[Work, ...]:
        return tuple(replace(work, fresh=fresh) for work in works.last(outcomes))

    jobs = tuple(replace(work, fresh=fresh, mark=mark) for work in works.works)
    return Graph(name=plan.name, works=jobs, last=last, open_model=model_of)


def with_made(files: TrialFiles, made: MadeModel, maker: str, settings: Settings) -> TrialFiles:
    """Return a trial with what the steps of the subject `maker` make.

    It gets the model, the gains of EMG and the motion. Electrodes and recordings are one subject's:
    those of a subject whose model another begins with are not the other's.
    """
    files = replace(files, model=made.path).having(ErrorSizeTables(made.sizes))
    if maker != files.subject:
        return files
    recorded = files.get(EmgFiles)
    if "gains" in made.left and recorded.emg is not None:
        files = files.having(replace(recorded, emg_gains_file=made.left["gains"]))
    if "soft_tissue" in made.left and files.get(SoftTissueFile).soft_tissue is None:
        files = files.having(SoftTissueFile(made.left["soft_tissue"]))
    refining = settings.get("refine", {})
    if "motions" in made.left and with_settings(TrialMotion(), refining).use_motions:
        cutoff = with_settings(RefineOptions(), refining).cutoff
        return files.having(
            RefinedFile(made.left["motions"] / f"{file_name(files.name)}.mot", cutoff)
        )
    return carried_trial(files, made.left.get("carried"))


def _recordings(*trials: TrialFiles) -> tuple[Recording, ...]:
    return tuple(
        Recording(trial.markers, trial.time) for trial in trials if trial.markers is not None
    )


@dataclass
class _Works:
    """The jobs so far, in their order."""

    plan: Plan
    out: Path
    works: list[Work] = field(default_factory=list)
    made: dict[str, MadeModel] = field(default_factory=dict)
    used: dict[Key, TrialFiles] = field(default_factory=dict)

    def maker(self, subject: str) -> str:
        """Return the subject whose own steps make the model that trials use.

        Its job is among the jobs; it is "" for a file.
        """
        maker = self.plan.maker(subject) if subject in self.plan.subjects else ""
        if maker and maker not in self.made:
            self._subject(maker)
        return maker

    def _subject(self, name: str) -> None:
        files = self.plan.subjects[name]
        begins = self.plan.begins_with(name)
        if begins:
            begin = self.made[self.maker(begins)]
            files = replace(files, model=begin.path, drawn=begin.drawn)
        steps = tuple(step for step in STEPS["subject"] if step in self.plan.steps_of(name))
        home = self.plan.home(self.out, name)
        settings = self.plan.settings_of(name)
        self.made[name] = made_model(files, steps, home)
        read = (files.model, files.detailed, files.static, files.shape.skin, files.shape.landmarks)
        self.works.append(
            Work(
                scope="subject",
                outcome=Outcome(name, "", home),
                steps=steps,
                open=partial(_open_subject_steps, files=files, settings=settings, folder=home),
                needs=((self.plan.maker(begins), ""),) if begins else (),
                model=files.model,
                settings=settings,
                files=tuple(path.name for path in read if path is not None),
                recordings=_recordings(*files.trials),
            )
        )

    def trial(self, files: TrialFiles, steps: tuple[str, ...]) -> None:
        """Add a trial, and before the first of a subject its own steps."""
        maker = self.maker(files.subject)
        key = (files.subject, files.name)
        if maker:
            files = with_made(files, self.made[maker], maker, self.plan.settings_of(files.subject))
        self.used[key] = files
        home = self.plan.home(self.out, *key)
        settings = self.plan.settings_of(*key)
        steps = tuple(step for step in (*STEPS["trial"], REPORT) if step in steps)
        self.works.append(
            Work(
                scope="trial",
                outcome=outcome_of(key, home, condition=files.condition),
                steps=steps,
                open=partial(
                    _open_trial_steps, files=files, steps=steps, settings=settings, folder=home
                ),
                needs=((maker, ""),) if maker else (),
                model=files.model,
                settings=settings,
                files=tuple(dict.fromkeys(path.name for path in files.paths)),
                recordings=_recordings(files),
            )
        )

    def pair(self, together: Together) -> None:
        """Add trials that are solved as one, after these.

        Their coordinates are enough: their later steps may fail, but their models must exist.
        """
        keys = tuple(together.trials.items())
        parts = {
            subject: _SubjectPart(
                files=self.used[subject, trial],
                home=self.plan.home(self.out, subject, trial),
                settings=self.plan.settings_of(subject, trial),
            )
            for subject, trial in keys
        }
        files = [part.files for part in parts.values()]
        made = {model.path: model for model in self.made.values()}
        makers = dict.fromkeys(self.maker(name) for name in together.trials)
        home = self.out / file_name(together.name)
        self.works.append(
            Work(
                scope="pair",
                outcome=Outcome(together.name, together.name, home),
                steps=(*STEPS["pair"], REPORT),
                open=partial(
                    _open_pair_steps,
                    together=together,
                    parts=parts,
                    models={each.model: made[each.model] for each in files if each.model in made},
                    common=self.plan.settings,
                    folder=home,
                ),
                needs=tuple((maker, "") for maker in makers if maker),
                after=keys,
                settings=self.plan.settings,
                files=tuple("/".join(key) for key in keys),
                recordings=_recordings(*files),
            )
        )

    def last(self, outcomes: tuple[Outcome, ...]) -> tuple[Work, ...]:
        """Return what is done for the whole study, the tables and their page last."""
        inputs = StudyInputs(self.plan, outcomes, self.out)
        works = []
        for step in STEPS["study"]:
            if step_of(step, "study").applies(inputs):
                key = GATHERED if step == TABLES else (step, "")
                opened = partial(_open_study_steps, inputs=inputs, key=key)
                outcome = outcome_of(key, self.out)
                works.append(Work(scope="study", outcome=outcome, steps=(step,), open=opened))
        return tuple(works)
