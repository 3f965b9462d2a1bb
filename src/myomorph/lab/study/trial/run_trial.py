"""The steps of one recording and their results in its folder.

They are one file, tables of values and a report.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

from myomorph.core.io.parsing.named_file import is_named_file
from myomorph.core.model.messages import unique
from myomorph.core.model.provenance import Provenance
from myomorph.lab.store import results as store
from myomorph.lab.store.netcdf import HeldFile, open_netcdf
from myomorph.lab.store.outcome import Outcome, failed
from myomorph.lab.store.table_digests import altered_tables, read_digests, write_digests
from myomorph.lab.study.step.job_steps import JobSteps, run_steps
from myomorph.lab.study.step.step import StepOutput, large_variables, step_of, trial_steps
from myomorph.lab.study.step.step_table import REPORT, STEPS
from myomorph.lab.study.trial import trial_step
from myomorph.lab.study.trial.reporting import TrialResults, write_report
from myomorph.lab.study.trial.tidy import write_trial_values
from myomorph.lab.study.trial.trial_inputs import TrialInputs
from myomorph.lab.study.workers.ahead import Ahead, compile_ahead, wraps_of

PARTS = ".steps"
DIGESTS = "digests.json"
"""File with the digests of those that are made of all results: values and pages."""
PART = f"step{store.STORED}"
VALUES = "values.csv"
HELD_FRAMES = 1000
"""Steps of longer recordings go to disk as they are computed, however fast that is: they may not
fit in memory.
"""
# Steps that took longer go to disk at once, so that a process that is killed leaves them.
HELD_SECONDS = 1.0

_LEFTOVER = re.compile(r"^\..+\.([a-z0-9_]{8}|part)$")


class TrialSteps(JobSteps):
    """Steps of one recording, whose results go into one file in its folder.

    `results` are known before the first.
    """

    def __init__(
        self,
        trial: TrialInputs,
        asked: Sequence[str],
        folder: Path,
        fresh: bool = False,
        results: trial_step.StepResults | None = None,
    ):
        self.trial = trial
        self.folder = folder
        self.fresh = fresh
        self.outcome = Outcome(trial.subject, trial.name, folder)
        self.steps = tuple(step for step in STEPS["trial"] if step in asked)
        self.reports = REPORT in asked
        self.parts = folder / PARTS
        self.stored = folder / f"{store.file_name(trial.name)}{store.STORED}"
        self.results = results or trial_step.StepResults()
        self._damage: dict[str, tuple[str, ...]] = {}
        self._files, self._made = ({}, {}) if fresh else self._earlier()
        self._waiting: list[str] = []
        markers = trial.recording.markers
        short = markers is not None and len(markers) <= HELD_FRAMES
        self._held = _Held(self.parts, short and not self._files and not self.stored.exists())
        self._ahead: Ahead | None = None

    def _earlier(self) -> tuple[dict[str, Path], dict[str, Provenance]]:
        """Return the file that holds the result of each step, and what that was derived from.

        Steps are left out of which the file or a table is damaged; `_damage` then says what.
        """
        made: dict[str, Provenance] = {}
        files: dict[str, Path] = {}
        stored = store.stored_provenance(self.stored)
        tables = store.stored_tables(self.stored)
        if self.stored.is_file() and not stored:
            self._damage = dict.fromkeys(STEPS["trial"], (f"{self.stored.name} is damaged",))
        for step in STEPS["trial"]:
            if step in stored:
                home = self.folder / step_of(step).tables
                self._damage[step] = altered_tables(home, tables.get(step, {}))
                made[step] = stored[step]
                files[step] = self.stored
            part = self.parts / step / PART
            provenance = store.stored_provenance(part).get(step)
            if provenance is not None:
                digests = store.stored_tables(part).get(step, {})
                self._damage[step] = altered_tables(part.parent, digests)
                made[step] = provenance
                files[step] = part
        sound = [step for step in made if not self._damage.get(step)]
        return {step: files[step] for step in sound}, {step: made[step] for step in sound}

    def reasons(self, step: str) -> tuple[str, ...]:
        """Why a step is computed: also where its file or a table is damaged."""
        return self._damage.get(step) or super().reasons(step)

    def provenance(self, step: str) -> Provenance:
        """Return what a step's result would be derived from now."""
        return trial_step.step_provenance(step_of(step), self.trial)

    def earlier(self, step: str) -> Provenance | None:
        """Return what an earlier run derived a step's result from."""
        return self._made.get(step)

    def all_reasons(self, steps: Sequence[str]) -> dict[str, tuple[str, ...]]:
        """By step, why a run would compute it; of the report, which is no result, too."""
        reasons = super().all_reasons([step for step in STEPS["trial"] if step in steps])
        if REPORT in steps:
            computed = any(reasons.values())
            reason = ("its results are new",) if computed else ("its contents have changed",)
            made = not computed and trial_step.report_is_made(
                self.folder, self.trial, tuple(reasons)
            )
            reasons[REPORT] = () if made else reason
        return reasons

    def unchanged(self, steps: Sequence[str]) -> Outcome | None:
        """Return the outcome of a trial whose folder a run would not change.

        Its file is opened once.
        """
        if not self._is_whole():
            return None
        telling = [step for step in map(step_of, self.steps) if step.outcome is not None]
        with open_netcdf(self.stored) as file:
            if not self._would_be_made_so(file.attributes):
                return None
            stored = store.stored_values(
                self.stored,
                file,
                only=[name for step in telling for name in step.outcome_variables],
            )
        clear_leftovers(self.folder)
        done = (*self.steps, REPORT) if self.reports else self.steps
        results = trial_step.StepResults(
            *(step.read(stored, self.trial.options) for step in telling)
        )
        return self._with_results(replace(self.outcome, done=done, reused=done), results)

    def _is_whole(self) -> bool:
        """Return whether the folder has all files that a run would leave, none of them altered."""
        if any(self._damage.values()) or self._altered_pages() or self.parts.exists():
            return False
        expected = [VALUES, trial_step.PAGE] if self.reports else [VALUES]
        names = (self.stored.name, *expected)
        return all((self.folder / name).is_file() for name in names)

    def _would_be_made_so(self, attributes: Mapping[str, Any]) -> bool:
        """Return whether a result file holds what these steps would find now, and nothing else."""
        made = store.made_from(attributes)
        # A step that nobody asks for now is for a run to keep or to remove.
        key = trial_step.report_key(self.trial, self.steps)
        if set(made) != set(self.steps) or attributes.get(trial_step.KEY, "") != key:
            return False
        return all(made[step].key == self.provenance(step).key for step in self.steps)

    def _altered_pages(self) -> tuple[str, ...]:
        """Files made of all results that are damaged or were edited."""
        path = self.folder / DIGESTS
        digests = read_digests(path.read_text("utf-8")) if is_named_file(path) else {}
        return tuple(
            name
            for name, digest in digests.items()
            if altered_tables(self.folder, {name: digest}) and (self.folder / name).is_file()
        )

    def __enter__(self) -> Self:
        self.folder.mkdir(parents=True, exist_ok=True)
        clear_leftovers(self.folder)
        for name in self._altered_pages():
            # Made anew of the results.
            (self.folder / name).unlink(missing_ok=True)
        if self.fresh:
            shutil.rmtree(self.parts, ignore_errors=True)
        return self

    def __exit__(self, *raised: object) -> None:
        if self._ahead is not None:
            self._ahead.stop()
        if raised[0] is not None:
            self._held.keep()

    def compute(self, step: str) -> None:
        """Run a step with the results before it."""
        if self._ahead is None:
            self._ahead = compile_ahead(
                self.steps[self.steps.index(step) :], wraps_of(self.trial.model)
            )
        self._ahead.wait(step)
        shutil.rmtree(self.parts / step, ignore_errors=True)
        value = step_of(step)
        with (
            store.whole_folder(self.parts / step) as temporary,
            self._held.writer(step, temporary) as writer,
        ):
            known = self._having(*value.needs, *value.uses)
            self.results = trial_step.run_step(
                value, self.trial, known, StepOutput(writer, temporary)
            )

    def reuse(self, step: str) -> None:
        """Use what an earlier run found; it is read where a later step needs it."""
        self._waiting.append(step)

    def _having(self, *kinds: type) -> trial_step.StepResults:
        """Return what was found, results of these types included."""
        for step in [name for name in self._waiting if step_of(name).gives in kinds]:
            stored = store.read_result(self._files[step], leave_out=large_variables())
            self.results = self.results.having(step_of(step).read(stored, self.trial.options))
            self._waiting.remove(step)
        return self.results

    def end(self, outcome: Outcome) -> Outcome:
        """Put the results into one file, and make the tables and the report of it."""
        if self._ahead is not None:
            self._ahead.stop()
        if not outcome.done:
            return outcome
        outcome = self._ended(outcome)
        if outcome.error:
            return outcome
        try:
            write_digests(self.folder / DIGESTS, self.folder, (VALUES, trial_step.PAGE))
        except OSError as error:
            return failed(outcome, error, "results")
        return outcome

    def _ended(self, outcome: Outcome) -> Outcome:
        """Gather the results of steps, with their tables and pages."""
        try:
            self._having(*(step.gives for step in trial_steps() if step.outcome is not None))
            held = self._gather(outcome)
            shown = TrialResults(
                path=self.stored, model=self.trial.model, stored=held, page=self.reports
            )
            outcome = self._with_results(outcome, self.results)
            if outcome.timed or not (self.folder / VALUES).is_file():
                write_trial_values(shown, outcome)
        except Exception as error:
            self._held.keep()
            lost = () if self.stored.is_file() else self._held.lost
            done = tuple(step for step in outcome.done if step not in lost)
            timed = tuple((step, seconds) for step, seconds in outcome.timed if step not in lost)
            return failed(replace(outcome, done=done, timed=timed), error, "results")
        return _report(self.trial, outcome, shown) if self.reports else outcome

    def _with_results(self, outcome: Outcome, results: trial_step.StepResults) -> Outcome:
        """Add what results tell of the trial, after what is said of its files."""
        found = with_results(outcome, results)
        said = unique((*self.trial.warnings, *found.findings))
        return replace(found, findings=said)

    def _gather(self, outcome: Outcome) -> store.Stored | None:
        """Move the steps' tables up and put their values, and those reused, into one file.

        What the file holds is returned, where all was in memory. Results of steps that are not
        requested now stay as long as they would come out the same. The order is that of the steps,
        whichever of them were reused, so that the file is the same either way. The tables of muscle
        paths, of which there are many, get a folder of their own.
        """
        fresh = [step for step in outcome.done if self._is_fresh(step)]
        others = self._others()
        lost = set(self._files).difference(outcome.done, others)
        if not fresh and not lost and trial_step.same_report(self.folder, self.trial, outcome.done):
            return None
        every = [step for step in STEPS["trial"] if step in (*outcome.done, *others)]
        whole = HeldFile() if self._held.allowed else None
        with store.new_result(self.stored) as writer:
            if whole is None:
                self._fill(writer, every, outcome.done)
            else:
                in_memory = store.ResultWriter(whole)
                whole.attributes |= store.WHOSE
                self._fill(in_memory, every, outcome.done)
                writer.take(whole, every)
                # Before the file has its name: whoever finds it there finds the tables, too.
                _move_tables(fresh, self.parts, self.folder)
            # A report and values of the results before must not stand beside those that come now.
            for name in (trial_step.PAGE, VALUES):
                (self.folder / name).unlink(missing_ok=True)
        if whole is None:
            _move_tables(fresh, self.parts, self.folder)
        self._remove_parts()
        return None if whole is None else store.stored_values(self.stored, whole)

    def _others(self) -> list[str]:
        """List steps of an earlier run that are not requested and would come out the same."""
        return [step for step in self._files if step not in self.steps and not self.reasons(step)]

    def _is_fresh(self, step: str) -> bool:
        """Return whether this run, or one that was interrupted, computed a step."""
        return step in self._held.files or (self.parts / step / PART).is_file()

    def _fill(self, writer: store.ResultWriter, steps: Sequence[str], done: Sequence[str]) -> None:
        """Put facts and the values of steps, in their order, into one file.

        `done`: those that are requested.
        """
        trial_step.keep_facts(writer, self.trial, done)
        for step in steps:
            if step in self._held.files:
                writer.take(self._held.files[step], (step,))
            elif step in done and self._is_fresh(step):
                writer.copy(self.parts / step / PART, (step,))
            else:
                writer.copy(self._files[step], (step,))
        writer.gather_remarks(steps, self.trial.warnings)

    def _remove_parts(self) -> None:
        """Remove the folders of single steps, whose tables and values are elsewhere now.

        They are gone at once, so that a run that is killed meanwhile finds all of them or nothing.
        """
        if self.parts.is_dir():
            away = Path(tempfile.mkdtemp(prefix=f"{PARTS}.", dir=self.folder))
            os.replace(self.parts, away / "steps")
            shutil.rmtree(away, ignore_errors=True)


def run_trial(
    trial: TrialInputs, steps: Sequence[str], folder: Path, fresh: bool = False
) -> Outcome:
    """Run the steps of one recording into a folder.

    It then has tables, `<trial>.nc`, `values.csv` and `report.html`. A step whose inputs, options
    and version are those of an earlier run is reused. Where a step fails, what the steps before it
    found is kept.
    """
    job = TrialSteps(trial=trial, asked=steps, folder=folder, fresh=fresh)
    return run_steps(job, job.steps)


class _Held:
    """Values of quick steps in memory until they are put into one file.

    They are held where no earlier run left anything to lose.
    """

    def __init__(self, parts: Path, allowed: bool):
        self.parts = parts
        self.allowed = allowed
        self.files: dict[str, HeldFile] = {}

    @contextmanager
    def writer(self, step: str, folder: Path) -> Iterator[store.ResultWriter]:
        """Take what a step finds, for a folder of its own."""
        if not self.allowed:
            with store.new_result(folder / PART, step) as writer:
                yield writer
                writer.tables(step, folder, PART)
            return
        file = HeldFile()
        started = time.monotonic()
        writer = store.ResultWriter(file, step)
        yield writer
        writer.tables(step, folder, PART)
        self.files[step] = file
        if time.monotonic() - started > HELD_SECONDS:
            self._store(step, folder)

    def _store(self, step: str, folder: Path) -> None:
        with store.new_result(folder / PART) as writer:
            writer.take(self.files[step], (step,))

    def keep(self) -> None:
        """Write what is only here: this run is interrupted."""
        for step in self.files:
            folder = self.parts / step
            if folder.is_dir() and not (folder / PART).exists():
                with suppress(OSError):
                    self._store(step, folder)

    @property
    def lost(self) -> tuple[str, ...]:
        """Steps that are nowhere but here, although they were to be stored.

        Nothing more can be written.
        """
        return tuple(step for step in self.files if not (self.parts / step / PART).is_file())


def clear_leftovers(folder: Path) -> None:
    """Remove what a process that was killed had not finished.

    These are files and folders with temporary names.
    """
    for home in (folder, folder / PARTS):
        for path in home.iterdir() if home.is_dir() else ():
            if not _LEFTOVER.match(path.name):
                continue
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)


def _move_tables(steps: Sequence[str], parts: Path, folder: Path) -> None:
    """Move the tables of steps into a trial's folder."""
    for step in steps:
        home = folder / step_of(step).tables
        home.mkdir(exist_ok=True)
        for path in sorted((parts / step).iterdir()):
            if path.name != PART:
                os.replace(path, home / path.name)


def with_results(outcome: Outcome, results: trial_step.StepResults) -> Outcome:
    """Return an outcome with what results report of the trial: frames, marker errors and others."""
    for step in trial_steps():
        result = results.get(step.gives)
        if step.outcome is not None and result is not None:
            outcome = step.outcome(outcome, result)
    return outcome


def _report(trial: TrialInputs, outcome: Outcome, results: TrialResults) -> Outcome:
    if not outcome.timed and trial_step.report_is_made(outcome.folder, trial, outcome.done):
        return replace(outcome, done=(*outcome.done, REPORT), reused=(*outcome.reused, REPORT))
    started = time.monotonic()
    try:
        write_report(outcome.folder, results.prepared)
    except Exception as error:
        return outcome if outcome.error else failed(outcome, error, REPORT)
    timed = (*outcome.timed, (REPORT, time.monotonic() - started))
    return replace(outcome, done=(*outcome.done, REPORT), timed=timed)
