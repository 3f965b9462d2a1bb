"""The steps of one recording, run into its folder: what has not changed is taken over, the rest is computed."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from myomorph.model.provenance import Provenance
from myomorph.store.netcdf import HeldFile
from myomorph.store.outcome import Outcome, failed
from myomorph.store.results import (
    STORED,
    WHOSE,
    ResultWriter,
    Stored,
    file_name,
    new_result,
    read_result,
    stored_provenance,
    stored_values,
    whole_folder,
)
from myomorph.study.trial.ahead import compile_ahead, wraps_of
from myomorph.study.trial.reporting import TrialResults, write_report
from myomorph.study.trial.reuse import NEVER, PAGE, changes, keep_facts, report_is_made, same_report
from myomorph.study.trial.step import StepOutput, StepResults, large_variables, run_step, step_of, step_provenance
from myomorph.study.trial.step_table import REPORT, STEPS
from myomorph.study.trial.tidy import write_trial_values
from myomorph.study.trial.trial_inputs import TrialInputs

PARTS = ".steps"
PART = f"step{STORED}"
VALUES = "values.csv"
HELD_FRAMES = 1000
"""Steps of longer recordings go to disk as they are computed, however fast that is: they may not fit in memory."""
HELD_SECONDS = 1.0
"""Steps that took longer go to disk at once, so that a process that is killed leaves them."""

_LEFTOVER = re.compile(r"^\..+\.([a-z0-9_]{8}|part)$")


@dataclass(frozen=True)
class _Earlier:
    """What an earlier run left in a folder: the file that holds each step, and what it was made from."""

    files: Mapping[str, Path]
    made: Mapping[str, Provenance]


def _earlier(trial: TrialInputs, folder: Path) -> _Earlier:
    whole = folder / f"{file_name(trial.name)}{STORED}"
    made = {step: one for step, one in stored_provenance(whole).items() if step in STEPS}
    files = dict.fromkeys(made, whole)
    for step in STEPS:
        part = folder / PARTS / step / PART
        found = stored_provenance(part).get(step)
        if found is not None:
            made[step], files[step] = found, part
    return _Earlier(files, made)


def reused_steps(trial: TrialInputs, steps: Sequence[str], folder: Path) -> dict[str, tuple[str, ...]]:
    """Which steps a run would take over from results in a folder, and why it would compute the others.

    Parameters
    ----------
    steps : those that are asked for, the report among them or not

    Returns
    -------
    by step: () where it would be taken over, else why it is computed, one line each
    """
    earlier = _earlier(trial, folder)
    reasons = {step: _reasons(step, trial, earlier) for step in STEPS if step in steps}
    if REPORT in steps:
        computed = any(reasons.values())
        reason = ("its results are new",) if computed else ("what it contains has changed",)
        reasons[REPORT] = () if not computed and report_is_made(folder, trial, tuple(reasons)) else reason
    return reasons


def _reasons(step: str, trial: TrialInputs, earlier: _Earlier) -> tuple[str, ...]:
    if step not in earlier.made:
        return (NEVER,)
    made = step_provenance(step_of(step), trial)
    return () if made.key == earlier.made[step].key else changes(earlier.made[step], made)


def run_trial(
    trial: TrialInputs,
    steps: Sequence[str],
    folder: Path,
    fresh: bool = False,
    results: StepResults | None = None,
    check: Callable[[], None] = lambda: None,
) -> Outcome:
    """Run the steps of one recording into a folder: tables, `<trial>.nc`, `values.csv` and `report.html`.

    A step whose inputs, options and version are those of an earlier run is taken over. Where a step fails, what the
    steps before it found is kept.

    Parameters
    ----------
    fresh : compute every step, whatever is there
    results : what is known before the first of the steps
    check : called before each step; what it raises ends the trial
    """
    folder.mkdir(parents=True, exist_ok=True)
    clear_leftovers(folder)
    parts = folder / PARTS
    if fresh:
        shutil.rmtree(parts, ignore_errors=True)
    earlier = _Earlier({}, {}) if fresh else _earlier(trial, folder)
    wanted = [step for step in STEPS if step in steps]
    reasons = {step: _reasons(step, trial, earlier) for step in wanted}
    computed = [step for step in wanted if reasons[step]]
    changed = [text for step in computed for text in reasons[step] if text != NEVER]
    outcome = Outcome(trial.subject, trial.name, folder, changed=tuple(dict.fromkeys(changed)))
    chain = _Chain(trial, results or StepResults(), earlier)
    held = _Held(parts, _is_short(trial) and not earlier.files and not _stored(trial, folder).exists())
    ahead = compile_ahead(wanted, wraps_of(trial.model)) if computed else None
    try:
        for step in wanted:
            check()
            if step not in computed:
                chain.reuse(step)
                outcome = replace(outcome, done=(*outcome.done, step), reused=(*outcome.reused, step))
                continue
            shutil.rmtree(parts / step, ignore_errors=True)
            if ahead is not None:
                ahead.wait(step)
            started = time.monotonic()
            with whole_folder(parts / step) as temporary, held.writer(step, temporary) as writer:
                one = step_of(step)
                found = chain.having(*one.needs, *one.uses)
                chain.results = run_step(one, trial, found, StepOutput(writer, temporary))
            timed = (*outcome.timed, (step, time.monotonic() - started))
            outcome = replace(outcome, done=(*outcome.done, step), timed=timed)
        check()
        chain.having(*(step.gives for step in map(step_of, STEPS) if step.outcome is not None))
    except Exception as error:
        outcome = failed(outcome, error, _next(wanted, outcome.done))
    except BaseException:
        held.keep()
        raise
    finally:
        if ahead is not None:
            ahead.stop()
    if not outcome.done:
        return outcome
    try:
        stored = _gather(trial, earlier, held, outcome, steps)
        shown = TrialResults(_stored(trial, folder), trial.model, stored, REPORT in steps)
        outcome = with_results(outcome, chain.results)
        if outcome.timed or not (folder / VALUES).is_file():
            write_trial_values(shown, outcome)
    except Exception as error:
        held.keep()
        lost = () if _stored(trial, folder).is_file() else held.lost
        done = tuple(step for step in outcome.done if step not in lost)
        timed = tuple(one for one in outcome.timed if one[0] not in lost)
        return failed(replace(outcome, done=done, timed=timed), error, "results")
    except BaseException:
        held.keep()
        raise
    return _report(trial, outcome, shown) if REPORT in steps else outcome


class _Chain:
    """What the steps have found so far; results of an earlier run are read only where a later step needs them."""

    def __init__(self, trial: TrialInputs, results: StepResults, earlier: _Earlier):
        self.trial, self.results, self.earlier = trial, results, earlier
        self.waiting: list[str] = []

    def reuse(self, step: str) -> None:
        """Use what an earlier run found."""
        self.waiting.append(step)

    def having(self, *kinds: type) -> StepResults:
        """What was found, results of these types included."""
        for step in [one for one in self.waiting if step_of(one).gives in kinds]:
            stored = read_result(self.earlier.files[step], leave_out=large_variables())
            self.results = self.results.having(step_of(step).read(stored, self.trial.options))
            self.waiting.remove(step)
        return self.results


class _Held:
    """Values of steps that would quickly be computed again, in memory until they are put into one file.

    Only where an earlier run left nothing, which must not be lost between the two.

    Parameters
    ----------
    parts : folder of the steps' own results
    allowed : whether anything is held
    """

    def __init__(self, parts: Path, allowed: bool):
        self.parts, self.allowed = parts, allowed
        self.files: dict[str, HeldFile] = {}

    @contextmanager
    def writer(self, step: str, folder: Path) -> Iterator[ResultWriter]:
        """Take what a step finds, for a folder of its own."""
        if not self.allowed:
            with new_result(folder / PART, step) as writer:
                yield writer
            return
        file, started = HeldFile(), time.monotonic()
        yield ResultWriter(file, step)
        self.files[step] = file
        if time.monotonic() - started > HELD_SECONDS:
            self._store(step, folder)

    def _store(self, step: str, folder: Path) -> None:
        with new_result(folder / PART) as writer:
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
        """Steps that are nowhere but here, although they were to be kept: nothing more can be written."""
        return tuple(step for step in self.files if not (self.parts / step / PART).is_file())


def _is_short(trial: TrialInputs) -> bool:
    return trial.markers is not None and len(trial.markers) <= HELD_FRAMES


def _stored(trial: TrialInputs, folder: Path) -> Path:
    return folder / f"{file_name(trial.name)}{STORED}"


def clear_leftovers(folder: Path) -> None:
    """Remove what a process that was killed had not finished: files and folders with temporary names."""
    for home in (folder, folder / PARTS):
        for path in home.iterdir() if home.is_dir() else ():
            if not _LEFTOVER.match(path.name):
                continue
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)


def _next(wanted: Sequence[str], done: Sequence[str]) -> str:
    return next((step for step in wanted if step not in done), REPORT)


def _gather(
    trial: TrialInputs, earlier: _Earlier, held: _Held, outcome: Outcome, steps: Sequence[str]
) -> Stored | None:
    """Move the steps' tables up and put their values, and those taken over, into one file.

    Results of steps that nobody asks for now stay as long as they would come out the same.

    The order is that of the steps, whichever of them were taken over, so that the file is the same either way. The
    tables of muscle paths, of which there are many, get a folder of their own.

    Returns
    -------
    what the file holds, where that was all in memory
    """
    folder, wanted = outcome.folder, [step for step in STEPS if step in steps]
    parts, stored = folder / PARTS, _stored(trial, folder)
    fresh = [step for step in outcome.done if step in held.files or (parts / step / PART).is_file()]
    others = [step for step in earlier.files if step not in wanted and not _reasons(step, trial, earlier)]
    lost = [step for step in earlier.files if step not in outcome.done and step not in others]
    if not fresh and not lost and same_report(folder, trial, outcome.done):
        return None
    whole = HeldFile() if held.allowed else None
    with new_result(stored) as writer:
        if whole is not None:
            whole.attributes |= WHOSE
            at_once = ResultWriter(whole)
            keep_facts(at_once, trial, outcome.done)
            for step in fresh:
                at_once.take(held.files[step], (step,))
            at_once.gather_remarks(fresh, trial.warnings)
            writer.take(whole, fresh)
            # Before the file has its name: whoever finds it there finds the tables, too.
            _move_tables(fresh, parts, folder)
        else:
            keep_facts(writer, trial, outcome.done)
            every = [one for one in STEPS if one in outcome.done or one in others]
            for step in every:
                writer.copy(parts / step / PART if step in fresh else earlier.files[step], (step,))
            writer.gather_remarks(every, trial.warnings)
        # A report and values of the results before must not stand beside those that come now.
        for name in (PAGE, VALUES):
            (folder / name).unlink(missing_ok=True)
    if whole is None:
        _move_tables(fresh, parts, folder)
    if parts.is_dir():
        # Gone at once, so that a run that is killed meanwhile finds all of it or nothing.
        away = Path(tempfile.mkdtemp(prefix=f"{PARTS}.", dir=folder))
        os.replace(parts, away / "steps")
        shutil.rmtree(away, ignore_errors=True)
    return None if whole is None else stored_values(stored, whole)


def _move_tables(steps: Sequence[str], parts: Path, folder: Path) -> None:
    """Move the tables of steps into a trial's folder."""
    for step in steps:
        home = folder / step_of(step).tables
        home.mkdir(exist_ok=True)
        for path in sorted((parts / step).iterdir()):
            if path.name != PART:
                os.replace(path, home / path.name)


def with_results(outcome: Outcome, results: StepResults) -> Outcome:
    """An outcome with what results tell of the trial, as its frames and marker errors."""
    for step in map(step_of, STEPS):
        found = results.get(step.gives)
        if step.outcome is not None and found is not None:
            outcome = step.outcome(outcome, found)
    return outcome


def _report(trial: TrialInputs, outcome: Outcome, results: TrialResults) -> Outcome:
    if not outcome.timed and report_is_made(outcome.folder, trial, outcome.done):
        return replace(outcome, done=(*outcome.done, REPORT), reused=(*outcome.reused, REPORT))
    started = time.monotonic()
    try:
        write_report(outcome.folder, results.prepared)
    except Exception as error:
        return outcome if outcome.error else failed(outcome, error, REPORT)
    timed = (*outcome.timed, (REPORT, time.monotonic() - started))
    return replace(outcome, done=(*outcome.done, REPORT), timed=timed)
