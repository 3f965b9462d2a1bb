"""`demo` and `run`."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from myomorph.cli.options import OutFolder, Threads, use_threads
from myomorph.cli.output import said

if TYPE_CHECKING:
    from myomorph.store.outcome import Outcome
    from myomorph.study.plan.plan import Plan
    from myomorph.study.run.jobs import Workers

BAD_INPUT, OUR_FAULT = 2, 1
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
        from myomorph.cli.viscosity import ended, print_outcome
        from myomorph.demo.shoulder import run_shoulder_demo

        return ended(run_shoulder_demo(out, print_outcome), out)
    if study == "morph":
        from myomorph.demo.morph import run_morph_demo, summary

        found = run_morph_demo(out)
        for line in summary(found):
            said(line)
        said(f"report: {found.report.resolve()}")
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


def _dry_run(plan: Plan, out: Path, fresh: bool, count: int) -> int:
    """Print what a run by so many workers would do."""
    # Imported by the command that needs it: --help and the others start without.
    from myomorph.study.run.dry_run import dry_run
    from myomorph.study.run.dry_run_text import dry_run_lines
    from myomorph.study.run.job_plan import graph_of

    _say_remarks(plan)
    looked = dry_run(graph_of(plan, out), out, fresh, count)
    for line in dry_run_lines(looked, plan.excluded):
        said(line)
    return BAD_INPUT if looked.problems else 0


def dry_run_plan(plan: Plan, out: Path, *, workers: int | None = None, threads: int | None = None) -> int:
    """Print what a run of a plan on this machine would do; the exit status."""
    return _dry_run(plan, out, False, _hands(plan, workers, None, threads).count)


def _hands(plan: Plan, workers: int | None, memory: float | None, threads: int | None) -> Workers:
    """Workers of this machine for a study; raises `BadData` where there cannot be any."""
    # Imported by the command that needs it: --help and the others start without.
    from myomorph.model.errors import BadData
    from myomorph.study.run.local_workers import local_workers

    if memory is not None and not math.isfinite(memory):
        raise BadData(f"--memory {memory:g}: expected a number of GB")
    jobs = len(plan.trials) + len(plan.together)
    return local_workers(workers, None if memory is None else int(memory * 1e9), jobs, threads)


def _report(outcome: Outcome) -> None:
    """Print what became of a job."""
    name = _named(outcome)
    if outcome.error:
        said(f"{name}: FAILED: {outcome.error}")
        return
    kept = f" ({len(outcome.reused)} step{'s' if len(outcome.reused) != 1 else ''} unchanged)" if outcome.reused else ""
    again = f" (again, because {', '.join(outcome.changed)})" if outcome.changed else ""
    if not outcome.trial:
        said(f"{name}: {', '.join(outcome.done)} in {outcome.seconds:.1f} s{kept}{again}")
    else:
        rms = f", markers {100 * outcome.rms:.2f} cm" if outcome.rms == outcome.rms else ""
        said(f"{name}: {outcome.frames} frames in {outcome.seconds:.1f} s{kept}{rms}{again}")
    for text in outcome.findings:
        said(f"  {text}")


def run_command(
    study: Annotated[Path, Parameter(help="Study file (.toml).")],
    /,
    *,
    out: OutFolder,
    resume: Annotated[
        bool, Parameter(negative=(), help="Take over what has not changed; this is so without it, too.")
    ] = False,
    fresh: Annotated[
        bool, Parameter(negative=(), help="Compute every step anew, whatever an earlier run left in the folder.")
    ] = False,
    dry_run: Annotated[
        bool, Parameter(negative=(), help="Compute nothing: say what would be done, why, and how long it would take.")
    ] = False,
    workers: Annotated[
        int | None, Parameter(help="Processes that work side by side; by default as many as cores and memory allow.")
    ] = None,
    memory: Annotated[
        float | None, Parameter(help="That one process may take [GB]; by default its share of this machine's.")
    ] = None,
    scheduler: Annotated[
        str | None,
        Parameter(help="Dask cluster that does the work: its address, or the file that the scheduler wrote."),
    ] = None,
    threads: Annotated[
        int | None, Parameter(help="Threads of each process: one by default, all cores where there is a single trial.")
    ] = None,
) -> int:
    """Run a study file: subjects, models, trials and steps; what has not changed since an earlier run is taken over."""
    # Imported by the command that needs it: --help and the others start without.
    from myomorph.model.errors import BadData
    from myomorph.study.plan.plan import read_plan

    if resume and fresh:
        raise BadData("--resume and --fresh exclude each other: one takes over what is there, the other does not")
    if scheduler is not None:
        if (workers, memory, threads) != (None, None, None):
            raise BadData("--scheduler: --workers, --memory and --threads are the cluster's: set them at 'dask worker'")
        # Its processes are in folders of their own.
        study, out = study.resolve(), out.resolve()
    use_threads(threads)
    plan = read_plan(study)
    if dry_run:
        return _dry_run(plan, out, fresh, 1 if scheduler else _hands(plan, workers, memory, threads).count)
    return run_plan(plan, out, fresh=fresh, workers=workers, memory=memory, scheduler=scheduler, threads=threads)


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
    hands: Workers
    if scheduler is not None:
        from myomorph.study.run.dask_workers import DaskWorkers

        hands = cluster = DaskWorkers(scheduler, out)
        for text in cluster.refused.values():
            said(f"{text}; it gets no work")
    else:
        hands = _hands(plan, workers, memory, threads)
    outcomes = run_study(plan, out, fresh=fresh, workers=hands, report=_report)
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
        names = [_named(one) for one in failed[:MAX_REMARKS]]
        more = f" and {len(failed) - len(names)} more" if len(failed) > len(names) else ""
        said(f"failed: {', '.join(names)}{more}; why stands in results.csv and study.log")
    if (out / PAGE).is_file() and not any(outcome.error for outcome in outcomes if not outcome.subject):
        said(f"page: {(out / PAGE).resolve()}")
    if any(outcome.fault for outcome in outcomes):
        return OUR_FAULT
    return BAD_INPUT if failed else 0


def _named(outcome: Outcome) -> str:
    return f"{outcome.subject}/{outcome.trial}".strip("/") or "tables of the study"
