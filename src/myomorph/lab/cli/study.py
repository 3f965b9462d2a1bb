"""`demo` and `run`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from myomorph.lab.cli.options import OutFolder, Threads, documented, use_threads
from myomorph.lab.cli.output import said
from myomorph.lab.cli.running import (
    AS_USUAL,
    BAD_INPUT,
    OUR_FAULT,
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
def demo_command(
    *,
    out: Path = Path("demo"),
    study: Literal[
        "simulated", "jump", "shoulder", "judo", "taichi", "tap", "drum", "morph"
    ] = "simulated",
    threads: Threads = None,
) -> int:
    """The main job on data that come with the installation, from markers to a report.

    Parameters
    ----------
    out : folder to write
    study : a simulated full-body squat with known truth, a recorded countermovement jump with
        markers on one leg, six virtual shoulders that swing on a force plate, contacts simulated as
        files with a study file (two fighters, Tai Chi on one plate, tap dance, a drum with
        microphones), or a leg's muscles transferred to bones whose deformation is known
    """
    use_threads(threads)
    if study == "shoulder":
        from myomorph.swings.command import ended, print_specimen
        from myomorph.swings.demo import run_shoulder_demo

        return ended(run_shoulder_demo(out, print_specimen), out)
    if study == "morph":
        from myomorph.bones.demo import run_morph_demo, summary

        demo = run_morph_demo(out)
        for line in summary(demo):
            said(line)
        said(f"report: {demo.report.resolve()}")
        return 0
    if study in ("judo", "taichi", "tap", "drum"):
        return _perform(study, out)
    from myomorph.lab.study.trial.reporting import REPORT
    from myomorph.show.demo.demos import run_demo

    outcome = run_demo(study, out)
    if outcome.error:
        sys.stderr.write(f"error: {outcome.error}\n")
        return OUR_FAULT if outcome.fault else BAD_INPUT
    said(
        f"{outcome.frames} frames through {', '.join(outcome.done)}; markers' root mean square"
        f" error {100 * outcome.rms:.2f} cm"
    )
    said(f"report: {(out / REPORT).resolve()}")
    return 0


def _perform(name: str, out: Path) -> int:
    """Write the files of a simulated performance, run its study, and lay its contact forces beside
    the truth.
    """
    from myomorph.lab.study.plan.plan import read_plan
    from myomorph.lab.study.trial.reporting import REPORT
    from myomorph.show.demo.performances import ERRORS, write_errors, write_performance

    written = write_performance(name, out)
    said(f"simulated; to run it again: myomorph run {written.study} --out {out / 'results'}")
    results = out / "results"
    status = run_plan(read_plan(written.study), results, AS_USUAL)
    if status == 0:
        write_errors(written, results, out / ERRORS)
        said(f"errors of contact forces against the true ones: {out / ERRORS}")
        said(f"report: {(results / written.results / REPORT).resolve()}")
    return status


@documented
def run_command(study: Path, /, *, out: OutFolder, running: RunOptions = AS_USUAL) -> int:
    """Run a study file: subjects, models, trials and steps; what has not changed since an earlier
    run is reused.

    Parameters
    ----------
    study : study file (.toml)
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
    """Say what a run came to, where its results are and what failed where; the exit status."""
    from myomorph.lab.study.run.run import FULL
    from myomorph.lab.study.summary.study_tables import PAGE, PARQUET, has_parquet

    trials = [outcome for outcome in outcomes if outcome.trial]
    failed = [outcome for outcome in outcomes if outcome.error]
    said(
        f"{sum(1 for trial in trials if not trial.error)} of {len(trials)} trials done; table:"
        f" {out / 'results.csv'}"
    )
    if not has_parquet():
        said(f"{PARQUET} is left out: pip install 'myomorph[parquet]' brings what writes it")
    full = sum(1 for trial in trials if trial.error.startswith("not run:") and FULL in trial.error)
    if full:
        said(f"{full} trials were not run: {FULL}")
    if failed:
        names = [named(outcome) for outcome in failed[:MAX_REMARKS]]
        more = f" and {len(failed) - len(names)} more" if len(failed) > len(names) else ""
        said(f"failed: {', '.join(names)}{more}; why stands in results.csv and study.log")
    if (out / PAGE).is_file() and not any(
        outcome.error for outcome in outcomes if not outcome.subject
    ):
        said(f"page: {(out / PAGE).resolve()}")
    return status_of(outcomes)
