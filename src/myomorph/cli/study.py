"""`demo` and `run`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from myomorph.cli.options import OutFolder, Threads, use_threads
from myomorph.cli.output import said
from myomorph.cli.running import (
    BAD_INPUT,
    OUR_FAULT,
    DryRun,
    Fresh,
    Memory,
    Resume,
    Scheduler,
    WorkerCount,
    WorkerThreads,
    check_running,
    named,
    print_dry_run,
    print_outcome,
    status_of,
    workers_here,
    workers_of,
)

if TYPE_CHECKING:
    from myomorph.store.outcome import Outcome
    from myomorph.study.plan.plan import Plan

MAX_REMARKS = 12


def demo_command(
    *,
    out: Annotated[Path, Parameter(help="Folder to write.")] = Path("demo"),
    study: Annotated[
        Literal["simulated", "jump", "shoulder", "judo", "morph"],
        Parameter(
            help="A simulated full-body squat with known truth, a recorded countermovement jump with markers on one "
            "leg, six virtual shoulders that swing on a force plate, two simulated fighters whose contact forces are "
            "found, or a leg's muscles transferred to bones whose deformation is known."
        ),
    ] = "simulated",
    threads: Threads = None,
) -> int:
    """The main job on data that come with the installation, from markers to a report."""
    use_threads(threads)
    if study == "shoulder":
        # Imported by the command that needs it: --help and the others start without.
        from myomorph.cli.viscosity import ended, print_specimen
        from myomorph.demo.shoulder import run_shoulder_demo

        return ended(run_shoulder_demo(out, print_specimen), out)
    if study == "morph":
        from myomorph.demo.morph import run_morph_demo, summary

        demo = run_morph_demo(out)
        for line in summary(demo):
            said(line)
        said(f"report: {demo.report.resolve()}")
        return 0
    from myomorph.demo.demos import run_demo
    from myomorph.study.trial.reporting import REPORT

    outcome = run_demo(study, out)
    if outcome.error:
        sys.stderr.write(f"error: {outcome.error}\n")
        return OUR_FAULT if outcome.fault else BAD_INPUT
    said(
        f"{outcome.frames} frames through {', '.join(outcome.done)}; markers' root mean square error "
        f"{100 * outcome.rms:.2f} cm"
    )
    if study == "judo":
        from myomorph.demo.judo import ERRORS

        said(f"errors of feet and grips against the true forces: {out / ERRORS}")
    said(f"report: {(out / REPORT).resolve()}")
    return 0


def _say_remarks(plan: Plan) -> None:
    """Print what is remarkable about the files of a study; of many trials the first, since they are alike."""
    for remark in plan.remarks[:MAX_REMARKS]:
        said(remark)
    if len(plan.remarks) > MAX_REMARKS:
        said(f"and {len(plan.remarks) - MAX_REMARKS} more: --dry-run lists the files of every trial")


def dry_run_plan(
    plan: Plan,
    out: Path,
    *,
    fresh: bool = False,
    workers: int | None = None,
    memory: float | None = None,
    scheduler: str | None = None,
    threads: int | None = None,
) -> int:
    """Print what a run of a plan would do; the exit status."""
    # Imported by the command that needs it: --help and the others start without.
    from myomorph.study.run.job_plan import graph_of

    _say_remarks(plan)
    count = 1 if scheduler else workers_here(_jobs(plan), workers, memory, threads).count
    return print_dry_run(partial(graph_of, plan), out, fresh, count, plan.excluded, plan.conditions.names)


def _jobs(plan: Plan) -> int:
    return len(plan.trials) + len(plan.together)


def run_command(
    study: Annotated[Path, Parameter(help="Study file (.toml).")],
    /,
    *,
    out: OutFolder,
    resume: Resume = False,
    fresh: Fresh = False,
    dry_run: DryRun = False,
    workers: WorkerCount = None,
    memory: Memory = None,
    scheduler: Scheduler = None,
    threads: WorkerThreads = None,
) -> int:
    """Run a study file: subjects, models, trials and steps; what has not changed since an earlier run is taken over."""
    # Imported by the command that needs it: --help and the others start without.
    from myomorph.study.plan.plan import read_plan

    check_running(resume, fresh, scheduler, workers, memory, threads)
    if scheduler is not None:
        # Its processes are in folders of their own.
        study, out = study.resolve(), out.resolve()
    use_threads(threads)
    run = dry_run_plan if dry_run else run_plan
    return run(read_plan(study), out, fresh=fresh, workers=workers, memory=memory, scheduler=scheduler, threads=threads)


def run_plan(
    plan: Plan,
    out: Path,
    *,
    fresh: bool = False,
    workers: int | None = None,
    memory: float | None = None,
    scheduler: str | None = None,
    threads: int | None = None,
) -> int:
    """Run a plan and say what became of it; the exit status."""
    # Imported by the command that needs it: --help and the others start without.
    from myomorph.study.run.run import run_study

    _say_remarks(plan)
    hands = workers_of(scheduler, out, _jobs(plan), workers, memory, threads)
    outcomes = run_study(plan, out, fresh=fresh, workers=hands, report=print_outcome)
    return _ended(outcomes, out)


def _ended(outcomes: Sequence[Outcome], out: Path) -> int:
    """Say what a run came to, where its results are and what failed where; the exit status."""
    # Imported by the command that needs it: --help and the others start without.
    from myomorph.study.run.run import FULL
    from myomorph.study.summary.study_tables import PAGE, PARQUET, has_parquet

    trials = [outcome for outcome in outcomes if outcome.trial]
    failed = [outcome for outcome in outcomes if outcome.error]
    said(f"{sum(1 for trial in trials if not trial.error)} of {len(trials)} trials done; table: {out / 'results.csv'}")
    if not has_parquet():
        said(f"{PARQUET} is left out: pip install 'myomorph[parquet]' brings what writes it")
    full = sum(1 for trial in trials if trial.error.startswith("not run:") and FULL in trial.error)
    if full:
        said(f"{full} trials were not run: {FULL}")
    if failed:
        names = [named(outcome) for outcome in failed[:MAX_REMARKS]]
        more = f" and {len(failed) - len(names)} more" if len(failed) > len(names) else ""
        said(f"failed: {', '.join(names)}{more}; why stands in results.csv and study.log")
    if (out / PAGE).is_file() and not any(outcome.error for outcome in outcomes if not outcome.subject):
        said(f"page: {(out / PAGE).resolve()}")
    return status_of(outcomes)
