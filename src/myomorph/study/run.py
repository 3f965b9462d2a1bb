"""Run a study: every trial through its steps, what failed by name, the rest whole."""

from __future__ import annotations

import csv
import io
import os
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from myomorph.model.errors import BadData, MyomorphError
from myomorph.model.model import Model
from myomorph.motion.sync import cut
from myomorph.study.ahead import compile_ahead
from myomorph.study.group_plan import GroupPlan
from myomorph.study.inputs import open_model
from myomorph.study.jobs import Outcome
from myomorph.study.plan import Plan
from myomorph.study.results import STORED, file_name, new_result, read_result, stored_provenance, whole_folder
from myomorph.study.steps import CHAIN, Found, Take, read_step, run_step, step_provenance
from myomorph.study.subjects import SUBJECT_STEPS, Prepared, prepare_subject
from myomorph.study.takes import FileTake, open_take
from myomorph.study.together import TOGETHER_STEPS, Part, Together, join_takes, object_part

PARTS = ".steps"
PART = f"step{STORED}"


def run_study(
    plan: Plan, out: Path, resume: bool = False, said: Callable[[Outcome], None] = lambda outcome: None
) -> list[Outcome]:
    """Run all trials of a plan, each into `out/subject/trial`, and write the table `results.csv`.

    Parameters
    ----------
    resume : take over steps whose inputs, options and version are those of an earlier run
    said : called with each trial's outcome when it ends
    """
    out.mkdir(parents=True, exist_ok=True)
    models: dict[Path, Model] = {}
    prepared: dict[str, Outcome | Prepared] = {}
    outcomes = []
    opened: dict[tuple[str, str], FileTake] = {}

    def ended(outcome: Outcome, started: float) -> None:
        outcomes.append(replace(outcome, seconds=time.monotonic() - started))
        said(outcomes[-1])
        write_table(outcomes, out / "results.csv")

    for files, steps in zip(plan.takes, plan.steps, strict=True):
        home = out / file_name(files.subject)
        started = time.monotonic()
        if set(steps) & set(SUBJECT_STEPS):
            if files.subject not in prepared:
                prepared[files.subject] = _subject(plan, files.subject, steps, home, resume)
                ended(_outcome(prepared[files.subject], files.subject, home), started)
                started = time.monotonic()
            ready = prepared[files.subject]
            if isinstance(ready, Outcome):
                text = f"not run: {ready.error}"
                ended(Outcome(files.subject, files.name, home, error=text, fault=ready.fault), started)
                continue
            files = replace(files, model=ready.path)
            models[ready.path] = ready.model
        opened[files.subject, files.name] = files
        ended(_trial(files, steps, plan, home / file_name(files.name), resume, models), started)
    for one in plan.together:
        started = time.monotonic()
        ended(_together(one, opened, plan, out, resume, models), started)
    if plan.groups is not None:
        started = time.monotonic()
        ended(_groups(plan.groups, out, plan.name), started)
    return outcomes


def _groups(plan: GroupPlan, out: Path, name: str) -> Outcome:
    """Two groups compared, from the results of their subjects' trials."""
    from myomorph.study.grouping import compare_stored

    outcome = Outcome(f"{plan.first[0]} and {plan.second[0]}", "", out)
    try:
        compare_stored(plan, out, name)
    except (MyomorphError, OSError) as error:
        return replace(outcome, error=f"groups: {' '.join(str(error).split())}")
    except Exception as error:
        return replace(outcome, error=f"groups: {type(error).__name__}: {' '.join(str(error).split())}", fault=True)
    return replace(outcome, done=("groups",))


def _subject(plan: Plan, name: str, steps: Sequence[str], home: Path, resume: bool) -> Outcome | Prepared:
    """The model of a subject's own steps, or why there is none."""
    outcome = Outcome(name, "", home)
    try:
        return prepare_subject(plan.subjects[name], steps, plan.settings, home, resume)
    except (MyomorphError, OSError) as error:
        return replace(outcome, error=" ".join(str(error).split()))
    except Exception as error:
        return replace(outcome, error=f"{type(error).__name__}: {' '.join(str(error).split())}", fault=True)


def _outcome(prepared: Outcome | Prepared, name: str, home: Path) -> Outcome:
    if isinstance(prepared, Outcome):
        return prepared
    return Outcome(name, "", home, done=prepared.done, kept=prepared.kept)


def _trial(
    files: FileTake, steps: tuple[str, ...], plan: Plan, folder: Path, resume: bool, models: dict[Path, Model]
) -> Outcome:
    """One trial; an error ends it, but not the study."""
    outcome = Outcome(files.subject, files.name, folder)
    try:
        if files.model not in models:
            models[files.model] = open_model(files.model)
        take = open_take(files, plan.settings, models[files.model])
        return run_take(take, steps, folder, resume)
    except (MyomorphError, OSError) as error:
        return replace(outcome, error=" ".join(str(error).split()))
    except Exception as error:
        return replace(outcome, error=f"{type(error).__name__}: {' '.join(str(error).split())}", fault=True)


def _together(
    together: Together,
    opened: Mapping[tuple[str, str], FileTake],
    plan: Plan,
    out: Path,
    resume: bool,
    models: dict[Path, Model],
) -> Outcome:
    """Several trials as one, from the coordinates that their own steps found."""
    folder = out / file_name(together.name)
    outcome = Outcome(together.name, together.name, folder)
    try:
        parts: dict[str, Part] = {}
        for subject, trial in together.trials.items():
            if (subject, trial) not in opened:
                raise BadData(f"subject '{subject}' has no coordinates of '{trial}': its own steps failed")
            files = opened[subject, trial]
            stored = out / file_name(subject) / file_name(trial) / f"{file_name(trial)}{STORED}"
            take = open_take(files, plan.settings, models[files.model])
            found = read_step("ik", take, Found(), read_result(stored, leave_out=("moment_arm",)))
            if found.recorded is None:
                raise BadData(f"{stored}: holds no coordinates: run the step 'ik' of subject '{subject}' first")
            recorded = found.recorded if take.time is None else cut(found.recorded, *take.time)
            parts[subject] = Part(take, recorded, str(files.model))
        parts |= {table.name: object_part(table, path) for table, path in together.objects}
        take, found = join_takes(together, parts, plan.settings)
        return replace(run_take(take, TOGETHER_STEPS, folder, resume, found), subject=outcome.subject)
    except (MyomorphError, OSError) as error:
        return replace(outcome, error=" ".join(str(error).split()))
    except Exception as error:
        return replace(outcome, error=f"{type(error).__name__}: {' '.join(str(error).split())}", fault=True)


def run_take(
    take: Take, steps: Sequence[str], folder: Path, resume: bool = False, found: Found | None = None
) -> Outcome:
    """Run the steps of one recording into a folder: tables, `<trial>.nc` and `report.html`.

    Where a step fails, what the steps before it found is kept.

    Parameters
    ----------
    found : what is known before the first of the steps
    """
    folder.mkdir(parents=True, exist_ok=True)
    outcome = Outcome(take.subject, take.name, folder)
    parts, earlier = folder / PARTS, folder / f"{file_name(take.name)}{STORED}"
    if not resume:
        shutil.rmtree(parts, ignore_errors=True)
    known = {step: made.key for step, made in stored_provenance(earlier).items()} if resume else {}
    found = found or Found()
    wanted = [one for one in CHAIN if one in steps]
    ahead = compile_ahead(wanted)
    try:
        for step in wanted:
            key = step_provenance(step, take).key
            part = parts / step / PART
            made = stored_provenance(part).get(step)
            if made is not None and made.key == key:
                found = read_step(step, take, found, read_result(part, leave_out=("moment_arm",)))
                outcome = replace(outcome, kept=(*outcome.kept, step))
            elif known.get(step) == key:
                found = read_step(step, take, found, read_result(earlier, leave_out=("moment_arm",)))
                outcome = replace(outcome, kept=(*outcome.kept, step))
            else:
                shutil.rmtree(parts / step, ignore_errors=True)
                ahead.wait(step)
                with whole_folder(parts / step) as temporary, new_result(temporary / PART, step) as writer:
                    found = run_step(step, take, found, writer, temporary)
            outcome = replace(outcome, done=(*outcome.done, step))
    except (MyomorphError, OSError) as error:
        outcome = replace(outcome, error=f"{_next(steps, outcome.done)}: {' '.join(str(error).split())}")
    except Exception as error:
        text = f"{_next(steps, outcome.done)}: {type(error).__name__}: {' '.join(str(error).split())}"
        outcome = replace(outcome, error=text, fault=True)
    finally:
        ahead.stop()
    if outcome.done:
        _gather(parts, earlier, outcome)
    outcome = _with_numbers(outcome, found)
    if "report" in steps and outcome.done:
        outcome = _report(take, outcome)
    return outcome


def _next(steps: Sequence[str], done: Sequence[str]) -> str:
    return next((step for step in CHAIN if step in steps and step not in done), "report")


def _gather(parts: Path, stored: Path, outcome: Outcome) -> None:
    """Move the steps' tables up and put their values, and those taken over, into one file.

    The tables of muscle paths, of which there are many, get a folder of their own.
    """
    fresh = [step for step in outcome.done if (parts / step / PART).is_file()]
    if fresh:
        with new_result(stored) as writer:
            for step in fresh:
                writer.copy(parts / step / PART, (step,))
            taken = [step for step in outcome.kept if step not in fresh]
            if taken:
                writer.copy(stored, taken)
        for step in fresh:
            home = stored.parent / "muscles" if step == "muscles" else stored.parent
            home.mkdir(exist_ok=True)
            for path in (parts / step).iterdir():
                if path.name != PART:
                    os.replace(path, home / path.name)
    shutil.rmtree(parts, ignore_errors=True)


def _with_numbers(outcome: Outcome, found: Found) -> Outcome:
    if found.recorded is not None:
        outcome = replace(outcome, frames=len(found.recorded))
    if found.fit is not None and np.isfinite(found.fit.errors).any():
        rms, largest = float(np.nanmean(found.fit.rms)), float(np.nanmax(found.fit.largest))
        outcome = replace(outcome, rms=rms, largest=largest)
    return outcome


def _report(take: Take, outcome: Outcome) -> Outcome:
    from myomorph.study.reporting import report_folder

    try:
        report_folder(outcome.folder, take)
    except (MyomorphError, OSError) as error:
        return replace(outcome, error=outcome.error or f"report: {' '.join(str(error).split())}")
    except Exception as error:
        text = f"report: {type(error).__name__}: {' '.join(str(error).split())}"
        return replace(outcome, error=outcome.error or text, fault=True)
    return replace(outcome, done=(*outcome.done, "report"))


def write_table(outcomes: Sequence[Outcome], path: Path) -> None:
    """Write what became of every trial as a CSV file, whole or not at all."""
    text = io.StringIO(newline="")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("subject", "trial", "steps", "frames", "marker_rms_m", "marker_largest_m", "seconds", "error"))
    for one in outcomes:
        numbers = (one.frames, f"{one.rms:.6g}", f"{one.largest:.6g}", f"{one.seconds:.2f}")
        table.writerow((one.subject, one.trial, " ".join(one.done), *numbers, one.error))
    temporary = path.with_name(f".{path.name}.part")
    temporary.write_text(text.getvalue(), encoding="utf-8")
    os.replace(temporary, path)
