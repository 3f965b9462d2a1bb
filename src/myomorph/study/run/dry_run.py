"""What a run of a study would do, and about how long it would take; nothing is computed or written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from myomorph.io.frame_count import FrameCount, count_frames
from myomorph.model.errors import MyomorphError
from myomorph.model.model import Model
from myomorph.store.locks import check_age, read_mark
from myomorph.store.outcome import Excluded, Key
from myomorph.store.progress import progress
from myomorph.store.results import STORED, file_name
from myomorph.study.inputs.reading import open_model
from myomorph.study.plan.plan import Plan
from myomorph.study.run.expected_time import Expected, ModelSize, StepTimes, together
from myomorph.study.run.job_plan import jobs_of, with_made
from myomorph.study.run.watching import TIMINGS
from myomorph.study.subject.subject_files import SUBJECT_STEPS, MadeModel
from myomorph.study.subject.subjects import reused_subject_steps
from myomorph.study.trial.open_trial import open_trial
from myomorph.study.trial.reuse import NEVER
from myomorph.study.trial.run_trial import PARTS, reused_steps
from myomorph.study.trial.together import TOGETHER_STEPS
from myomorph.study.trial.trial_files import TrialFiles

FRESH = "everything is asked for anew"
NEW_MODEL = "its model is made anew"
NEW_PARTS = "its trials are computed anew"
MAX_MODELS = 8
"""Models that are read for their sizes; what they have in common is taken for the rest."""


@dataclass(frozen=True)
class Row:
    """One trial of a dry run, or a subject's own steps (`trial` "").

    Attributes
    ----------
    frames : of the part that is used, None where the files do not tell at once
    files : names of what was found, the recording first
    reasons : by step, why it would be computed; () where it would be taken over
    expected : time of the steps that would be computed
    problem : what keeps it from being looked at, "" for nothing
    """

    subject: str
    trial: str
    condition: str
    frames: int | None
    files: tuple[str, ...]
    reasons: Mapping[str, tuple[str, ...]]
    expected: Expected
    problem: str = ""

    @property
    def reused(self) -> tuple[str, ...]:
        """Steps that would be taken over."""
        return tuple(step for step, why in self.reasons.items() if not why)

    @property
    def computed(self) -> tuple[str, ...]:
        """Steps that would be computed."""
        return tuple(step for step, why in self.reasons.items() if why)


@dataclass(frozen=True)
class DryRun:
    """What a run would do.

    Attributes
    ----------
    rows : in the order of the study file
    workers : jobs that run side by side
    begins : what the run takes besides its steps [s]
    compiles : what the first run on this machine takes longer [s]
    """

    plan: Plan
    out: Path
    rows: tuple[Row, ...]
    excluded: tuple[Excluded, ...]
    workers: int = 1
    begins: float = 0.0
    compiles: float = 0.0

    @property
    def expected(self) -> Expected:
        """Time of all rows one after another."""
        return together([row.expected for row in self.rows if row.expected.seconds is not None])

    @property
    def side(self) -> int:
        """Jobs that run side by side."""
        return max(min(self.workers, sum(1 for row in self.rows if row.computed)), 1)

    @property
    def lasts(self) -> float:
        """Time of the whole run, without what is compiled once [s]; 0 where there is nothing to compute."""
        if not any(row.computed for row in self.rows):
            return 0.0
        longest = max((row.expected.seconds or 0.0) for row in self.rows)
        return max((self.expected.seconds or 0.0) / self.side, longest) + self.begins

    @property
    def unknown(self) -> tuple[str, ...]:
        """Trials for whose time nothing tells."""
        return tuple(f"{row.subject}/{row.trial}".rstrip("/") for row in self.rows if row.expected.seconds is None)

    @property
    def problems(self) -> tuple[str, ...]:
        """What would fail, as far as it was looked at."""
        return tuple(dict.fromkeys(row.problem for row in self.rows if row.problem))


def dry_run(plan: Plan, out: Path, fresh: bool = False, workers: int = 1) -> DryRun:
    """Look at what a run of a study would do.

    Recordings are opened only where there are earlier results to hold against them.

    Parameters
    ----------
    out : folder of results, which need not exist
    fresh : as if nothing could be taken over
    workers : jobs that run side by side

    Raises
    ------
    BadFile, BadData
        where a run would be refused, since a newer version wrote the folder
    """
    check_age(read_mark(out))
    looked = _Looked(plan, out, fresh, workers)
    rows: list[Row] = []
    seen: set[str] = set()
    with progress("looking at trials", len(plan.trials), "trials") as advance:
        for files, steps in zip(plan.trials, plan.steps, strict=True):
            for name in _makers(plan, files.subject):
                if name not in seen:
                    rows.append(looked.subject(name))
                    seen.add(name)
            rows.append(looked.trial(files, [step for step in steps if step not in SUBJECT_STEPS]))
            advance(1)
    rows += [looked.joined(one.name, one.trials) for one in plan.together]
    computed = {step for row in rows for step in row.computed}
    compiles = looked.times.compiles(bool(computed & {"muscles", "tension"})) if computed else 0.0
    return DryRun(plan, out, tuple(rows), plan.excluded, workers, looked.times.begins(len(plan.trials)), compiles)


def _makers(plan: Plan, subject: str) -> list[str]:
    """Subjects whose own steps come before a subject's trials, in that order."""
    result: list[str] = []
    name = plan.maker(subject)
    while name and name not in result:
        result.insert(0, name)
        name = plan.begins_with(name)
    return result


@dataclass
class _Looked:
    """What was looked at so far.

    Attributes
    ----------
    computed : subjects and trials of which something would be computed
    counts : of the frames of recordings
    begun : jobs that would compute something
    """

    plan: Plan
    out: Path
    fresh: bool
    workers: int = 1
    computed: set[Key] = field(default_factory=set)
    counts: dict[Path, FrameCount] = field(default_factory=dict)
    begun: int = 0
    _models: dict[Path, Model | MyomorphError] = field(default_factory=dict)
    _sizes: dict[Path, ModelSize] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.jobs = jobs_of(self.plan, self.out)
        self.times = StepTimes.here(self.out / TIMINGS)

    def subject(self, name: str) -> Row:
        """The steps on a subject."""
        files = self.plan.subjects[name]
        steps = [step for step in SUBJECT_STEPS if step in self.plan.steps_of(name)]
        begins = self.plan.begins_with(name)
        problem = ""
        reasons: dict[str, tuple[str, ...]]
        if self.fresh:
            reasons = dict.fromkeys(steps, (FRESH,))
        elif begins and (begins, "") in self.computed:
            reasons = dict.fromkeys(steps, (NEW_MODEL,))
        else:
            begin = self._made(begins)
            files = files if begin is None else replace(files, model=begin.path, drawn=begin.drawn)
            try:
                reasons = reused_subject_steps(
                    files, steps, self.plan.settings_of(name), self.plan.home(self.out, name)
                )
            except MyomorphError as error:
                reasons, problem = dict.fromkeys(steps, (NEVER,)), " ".join(str(error).split())
        counts = [self._frames(trial) for trial in files.trials]
        frames = sum(count for count in counts if count is not None) if None not in counts else None
        if any(reasons.values()):
            self.computed.add((name, ""))
        given = (files.static, files.shape.skin, files.shape.landmarks)
        names = tuple(path.name for path in (files.model, *given) if path is not None)
        expected = self._expected((name, ""), reasons, frames, files.model)
        return Row(name, "", "", frames, names, reasons, expected, problem)

    def trial(self, files: TrialFiles, steps: Sequence[str]) -> Row:
        """The steps of a trial."""
        key = (files.subject, files.name)
        maker, problem = self.plan.maker(files.subject), ""
        folder = self.jobs.homes[key]
        stored = (folder / f"{file_name(files.name)}{STORED}").is_file() or (folder / PARTS).is_dir()
        reasons: dict[str, tuple[str, ...]]
        if self.fresh or not stored:
            reasons = dict.fromkeys(steps, (FRESH if stored else NEVER,))
        elif maker and (maker, "") in self.computed:
            reasons = dict.fromkeys(steps, (NEW_MODEL,))
        else:
            reasons, problem = self._reused(files, steps, folder)
        if any(reasons.values()):
            self.computed.add(key)
        frames = self._frames(files)
        used = (files.markers, files.motion, files.loads, files.torques, files.emg, files.tasks, files.actuators)
        names = tuple(path.name for path in used if path is not None)
        expected = self._expected(key, reasons, frames, files.model)
        unread = self._models.get(files.model)
        if isinstance(unread, MyomorphError) and not problem:
            problem = " ".join(str(unread).split())
        if frames == 0 and files.time is not None and files.markers is not None and not problem:
            start, end = files.time
            problem = f"{files.markers}: has no frame from {start:g} to {end:g} s, the time asked for"
        return Row(*key, files.condition, frames, names, reasons, expected, problem)

    def joined(self, name: str, trials: Mapping[str, str]) -> Row:
        """Trials that are solved as one; whether their contacts have changed is not looked at."""
        stored = (self.out / file_name(name) / f"{file_name(name)}{STORED}").is_file()
        why: tuple[str, ...] = ()
        if self.fresh or not stored:
            why = (FRESH if stored else NEVER,)
        elif any(key in self.computed for key in trials.items()):
            why = (NEW_PARTS,)
        reasons = dict.fromkeys(TOGETHER_STEPS, why)
        own = [trial for trial in self.plan.trials if (trial.subject, trial.name) in set(trials.items())]
        counts = [one for one in map(self._frames, own) if one is not None]
        frames = min(counts) if counts else None
        expected = self._expected((name, name), reasons, frames, own[0].model if own else None)
        return Row(name, name, "", frames, tuple(f"{one.subject}/{one.name}" for one in own), reasons, expected)

    def _reused(self, files: TrialFiles, steps: Sequence[str], folder: Path) -> tuple[dict[str, tuple[str, ...]], str]:
        """Why steps of a trial with earlier results would be computed, and what kept it from being looked at."""
        made, settings = self._made(self.plan.maker(files.subject)), self.plan.settings_of(files.subject, files.name)
        try:
            if made is not None:
                files = with_made(files, made, self.plan.maker(files.subject), self.plan.settings_of(files.subject))
            model = self._model(files.model, made)
            trial = open_trial(files, settings, model)
            return reused_steps(trial, steps, folder), ""
        except MyomorphError as error:
            return dict.fromkeys(steps, (NEVER,)), " ".join(str(error).split())

    def _made(self, maker: str) -> MadeModel | None:
        """The model that a subject's own steps make."""
        if not maker:
            return None
        return self.jobs.made[maker]

    def _model(self, path: Path, made: MadeModel | None = None) -> Model:
        """A model, read once; raises what reading it raised the first time."""
        if path not in self._models:
            try:
                self._models[path] = open_model(path) if made is None else made.open()
            except MyomorphError as error:
                self._models[path] = error
        result = self._models[path]
        if isinstance(result, MyomorphError):
            raise result
        return result

    def _frames(self, files: TrialFiles) -> int | None:
        if files.markers is None:
            return None
        if files.markers not in self.counts:
            self.counts[files.markers] = count_frames(files.markers)
        return self.counts[files.markers].within(files.time)

    def _expected(
        self, key: Key, reasons: Mapping[str, tuple[str, ...]], frames: int | None, model: Path | None
    ) -> Expected:
        computed = [step for step, why in reasons.items() if why]
        size = self._size(model) if computed and model is not None else None
        settings = self.plan.settings_of(*key)
        # As many jobs as run side by side are the first of their processes.
        first = bool(computed) and self.begun < self.workers
        self.begun += bool(computed)
        found = [self.times.expected(*key, step, frames, size, settings.get(step), first) for step in computed]
        whole = together(found)
        if whole.seconds is None or not key[1] or not computed:
            return whole
        return replace(whole, seconds=whole.seconds + self.times.opens(frames, first))

    def _size(self, path: Path) -> ModelSize | None:
        if path in self._sizes:
            return self._sizes[path]
        if len(self._sizes) >= MAX_MODELS:
            return next(iter(self._sizes.values()))
        try:
            model = self._model(path)
        except MyomorphError:
            return None
        self._sizes[path] = ModelSize(len(model.coordinate_names), len(model.muscles))
        return self._sizes[path]
