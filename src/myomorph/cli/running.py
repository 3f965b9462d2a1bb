"""How commands run a study, whatever it is of: their options, workers, what is printed of each job, the exit status."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from myomorph.cli.output import said
from myomorph.model.errors import BadData

if TYPE_CHECKING:
    from myomorph.store.outcome import Excluded, Outcome
    from myomorph.study.run.jobs import Workers
    from myomorph.study.run.work import Graph

BAD_INPUT, OUR_FAULT = 2, 1

Resume = Annotated[bool, Parameter(negative=(), help="Reuse what has not changed; this is so without it, too.")]
Fresh = Annotated[
    bool, Parameter(negative=(), help="Compute every step anew, whatever an earlier run left in the folder.")
]
DryRun = Annotated[
    bool, Parameter(negative=(), help="Compute nothing: say what would be done, why, and how long it would take.")
]
WorkerCount = Annotated[
    int | None, Parameter(help="Processes that work side by side; by default as many as cores and memory allow.")
]
Memory = Annotated[
    float | None, Parameter(help="That one process may take [GB]; by default its share of this machine's.")
]
Scheduler = Annotated[
    str | None, Parameter(help="Dask cluster that does the work: its address, or the file that the scheduler wrote.")
]
WorkerThreads = Annotated[
    int | None, Parameter(help="Threads of each process: one by default, all cores where there is a single job.")
]


def check_running(
    resume: bool,
    fresh: bool,
    scheduler: str | None,
    workers: int | None,
    memory: float | None,
    threads: int | None,
) -> None:
    """Raise `BadData` where options of a run exclude each other."""
    if resume and fresh:
        raise BadData("--resume and --fresh exclude each other: one reuses what is there, the other does not")
    if scheduler is not None and (workers, memory, threads) != (None, None, None):
        raise BadData("--scheduler: --workers, --memory and --threads are the cluster's: set them at 'dask worker'")


def workers_here(jobs: int, workers: int | None, memory: float | None, threads: int | None) -> Workers:
    """Workers of this machine for so many jobs; raises `BadData` where there cannot be any."""
    # Imported by the command that needs it: --help and the others start without.
    from myomorph.study.run import local_workers

    if memory is not None and not math.isfinite(memory):
        raise BadData(f"--memory {memory:g}: expected a number of GB")
    return local_workers.local_workers(workers, None if memory is None else int(memory * 1e9), jobs, threads)


def workers_of(
    scheduler: str | None, out: Path, jobs: int, workers: int | None, memory: float | None, threads: int | None
) -> Workers:
    """Workers of a cluster where one is named, else of this machine."""
    if scheduler is None:
        return workers_here(jobs, workers, memory, threads)
    # Brings Dask: loaded only where it is needed.
    from myomorph.study.run.dask_workers import DaskWorkers

    cluster = DaskWorkers(scheduler, out)
    for text in cluster.refused.values():
        said(f"{text}; it gets no work")
    return cluster


def print_dry_run(
    graph_of: Callable[[Path], Graph],
    out: Path,
    fresh: bool,
    count: int,
    excluded: Sequence[Excluded] = (),
    conditions: Sequence[str] = (),
) -> int:
    """Print what a run by so many workers would do; the exit status."""
    # Imported by the command that needs it: --help and the others start without.
    from myomorph.study.run.dry_run import dry_run, dry_run_lines

    looked = dry_run(graph_of(out), out, fresh, count)
    for line in dry_run_lines(looked, excluded, conditions):
        said(line)
    return BAD_INPUT if looked.problems else 0


def print_outcome(outcome: Outcome) -> None:
    """Print what became of a job."""
    name = named(outcome)
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


def named(outcome: Outcome) -> str:
    """A job as it is named to the user."""
    return f"{outcome.subject}/{outcome.trial}".strip("/") or "tables of the study"


def status_of(outcomes: Sequence[Outcome]) -> int:
    """The exit status of a run."""
    if any(outcome.fault for outcome in outcomes):
        return OUR_FAULT
    return BAD_INPUT if any(outcome.error for outcome in outcomes) else 0
