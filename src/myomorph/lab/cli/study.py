"""`run`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from myomorph.lab.cli.options import OutFolder, documented
from myomorph.lab.cli.output import said
from myomorph.lab.cli.running import (
    AS_USUAL,
    Running,
    RunOptions,
    named,
    print_outcome,
    status_of,
)

if TYPE_CHECKING:
    from myomorph.lab.store.outcome import Outcome
    from myomorph.lab.study.plan.plan import Plan

MAX_REMARKS = 12


@documented
def run_command(study: Path, /, *, out: OutFolder, running: RunOptions = AS_USUAL) -> int:
    """Run a study file: subjects, models, trials and steps.

    What has not changed since an earlier run is reused.

    Parameters
    ----------
    study : study file (.toml)
    out : folder to write
    running : how the jobs are run
    """
    from myomorph.lab.study.plan.plan import read_plan

    running.begin()
    return run_plan(read_plan(running.place(study)), running.place(out), running)


def run_plan(plan: Plan, out: Path, running: Running) -> int:
    """Run a plan and say what became of it, or what a run would do; the exit status."""
    from myomorph.lab.study.run.job_plan import graph_of
    from myomorph.lab.study.run.run import run_study

    # Print what is remarkable about the files of a study; of many trials the first, since they are
    # alike.
    for remark in plan.remarks[:MAX_REMARKS]:
        said(remark)
    if len(plan.remarks) > MAX_REMARKS:
        said(
            f"and {len(plan.remarks) - MAX_REMARKS} more: --dry-run lists the files of every trial"
        )
    jobs = len(plan.trials) + len(plan.together)
    if running.dry_run:
        return running.print_dry_run(
            partial(graph_of, plan), out, jobs, plan.excluded, plan.conditions.names
        )
    hands = running.hands(jobs, out)
    return _ended(
        run_study(plan, out, fresh=running.fresh, workers=hands, report=print_outcome), out
    )


def _ended(outcomes: Sequence[Outcome], out: Path) -> int:
    """Print what a run came to, where its results are and what failed where.

    The result is the exit status.
    """
    from myomorph.lab.study.run.run import FULL
    from myomorph.lab.study.summary.study_tables import PAGE, PARQUET, has_parquet

    trials = [outcome for outcome in outcomes if outcome.trial]
    done = [trial.error for trial in trials].count("")
    said(f"{done} of {len(trials)} trials done; table: {out / 'results.csv'}")
    if not has_parquet():
        said(f"{PARQUET} is left out: pip install 'myomorph[parquet]' to write it")
    full = sum(trial.error.startswith("not run:") and FULL in trial.error for trial in trials)
    if full:
        said(f"{full} trials were not run: {FULL}")
    failed = [outcome for outcome in outcomes if outcome.error]
    _print_failed(failed)
    if (out / PAGE).is_file() and all(outcome.subject for outcome in failed):
        said(f"page: {(out / PAGE).resolve()}")
    return status_of(outcomes)


def _print_failed(failed: Sequence[Outcome]) -> None:
    """Name the first jobs that failed, and count the others."""
    if failed:
        names = [named(outcome) for outcome in failed[:MAX_REMARKS]]
        more = f" and {len(failed) - len(names)} more" if len(failed) > len(names) else ""
        said(f"failed: {', '.join(names)}{more}; reasons are in results.csv and study.log")
