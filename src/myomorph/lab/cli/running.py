"""How commands run a study, whatever it is of.

Here are their options, workers, what is printed of each job, and the exit status.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from myomorph.core.model.errors import BadData, counted
from myomorph.core.model.message_groups import outcome_lines
from myomorph.lab.cli.options import documented, use_threads
from myomorph.lab.cli.output import said

if TYPE_CHECKING:
    from myomorph.lab.store.outcome import Excluded, Outcome
    from myomorph.lab.study.run.work import Graph
    from myomorph.lab.study.workers.jobs import Workers

BAD_INPUT = 2
OUR_FAULT = 1


@documented
@dataclass(frozen=True)
class Running:
    """How a study is run.

    Attributes
    ----------
    resume : reuse unchanged results; this is the default
    fresh : recompute every step, even if an earlier run has left its result
    dry_run : compute nothing, and print what would be computed, why, and how long it would take
    workers : number of processes that run in parallel; by default as many as cores and memory allow
    memory : memory limit of one process [GB]; by default its share of the machine's memory
    scheduler : Dask cluster to use: the address of its scheduler, or its scheduler file
    threads : number of threads of each process; 1 by default, all cores for a single job
    """

    resume: bool = False
    fresh: bool = False
    dry_run: bool = False
    workers: int | None = None
    memory: float | None = None
    scheduler: str | None = None
    threads: int | None = None

    def begin(self) -> None:
        """Set the threads of the kernels; raise `BadData` where options exclude each other."""
        if self.resume and self.fresh:
            raise BadData(
                "--resume and --fresh exclude each other: one reuses what is there, the other"
                " does not"
            )
        if self.scheduler is not None and (self.workers, self.memory, self.threads) != (
            None,
            None,
            None,
        ):
            raise BadData(
                "--scheduler: --workers, --memory and --threads are the cluster's: set them at"
                " 'dask worker'"
            )
        use_threads(self.threads)

    def place(self, path: Path) -> Path:
        """Return a path as the workers see it: those of a cluster are in folders of their own."""
        return path if self.scheduler is None else path.resolve()

    def _here(self, jobs: int) -> Workers:
        from myomorph.lab.study.workers.local_workers import local_workers

        if self.memory is not None and not math.isfinite(self.memory):
            raise BadData(f"--memory {self.memory:g}: expected a number of GB")
        memory = None if self.memory is None else int(self.memory * 1e9)
        return local_workers(self.workers, memory, jobs, self.threads)

    def hands(self, jobs: int, out: Path) -> Workers:
        """Workers of a cluster where one is named, else of this machine."""
        if self.scheduler is None:
            return self._here(jobs)
        from myomorph.lab.study.run.dask_workers import DaskWorkers

        cluster = DaskWorkers(self.scheduler, out)
        for text in cluster.refused.values():
            said(f"{text}; it is not used")
        return cluster

    def print_dry_run(
        self,
        graph_of: Callable[[Path], Graph],
        out: Path,
        jobs: int,
        excluded: Sequence[Excluded] = (),
        conditions: Sequence[str] = (),
    ) -> int:
        """Print what a run of so many jobs would do; the exit status."""
        from myomorph.lab.study.run.dry_run import dry_run, dry_run_lines

        count = 1 if self.scheduler else self._here(jobs).count
        looked = dry_run(graph_of(out), out, self.fresh, count)
        for line in dry_run_lines(looked, excluded, conditions):
            said(line)
        return BAD_INPUT if looked.problems else 0


RunOptions = Annotated[Running, Parameter(name="*")]
AS_USUAL = Running()


def print_outcome(outcome: Outcome) -> None:
    """Print what became of a job."""
    name = named(outcome)
    if outcome.error:
        said(f"{name}: FAILED: {outcome.error}")
        return
    kept = f" ({counted(len(outcome.reused), 'step')} unchanged)" if outcome.reused else ""
    again = f" (again, because {', '.join(outcome.changed)})" if outcome.changed else ""
    if not outcome.trial:
        said(f"{name}: {', '.join(outcome.done)} in {outcome.seconds:.1f} s{kept}{again}")
    else:
        rms = f", markers {100 * outcome.rms:.2f} cm" if outcome.rms == outcome.rms else ""
        said(f"{name}: {outcome.frames} frames in {outcome.seconds:.1f} s{kept}{rms}{again}")
    for text in outcome_lines(outcome.findings, _listed(outcome)):
        said(f"  {text}")


def _listed(outcome: Outcome) -> str:
    """Where all messages of a job stand."""
    from myomorph.lab.study.step.folder_steps import NOTES
    from myomorph.lab.study.trial.trial_step import PAGE

    return str(outcome.folder / (PAGE if outcome.trial else NOTES))


def named(outcome: Outcome) -> str:
    """Name a job as the user sees it."""
    return f"{outcome.subject}/{outcome.trial}".strip("/") or "tables of the study"


def status_of(outcomes: Sequence[Outcome]) -> int:
    """Return the exit status of a run."""
    if any(outcome.fault for outcome in outcomes):
        return OUR_FAULT
    return BAD_INPUT if any(outcome.error for outcome in outcomes) else 0
