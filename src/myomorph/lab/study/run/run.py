"""Run a study: every trial through its steps.

Jobs run in order on workers. What failed is named, the rest is whole.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from graphlib import TopologicalSorter
from pathlib import Path

from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.lab.store.locks import RunMark, study_lock
from myomorph.lab.store.outcome import Key, Outcome, failed, no_space
from myomorph.lab.store.results import file_source
from myomorph.lab.study.plan.plan import Plan
from myomorph.lab.study.run.job_plan import graph_of
from myomorph.lab.study.run.step_times import Learning
from myomorph.lab.study.run.watching import StudyWatcher
from myomorph.lab.study.run.work import Graph, Work, not_run, outcome_of
from myomorph.lab.study.workers.jobs import Ended, Job, Workers
from myomorph.lab.study.workers.local_workers import InProcess

PATIENCE = 0.5  # How often the loop looks round although nothing has ended [s].
AT_ONCE = 0.001  # How long it waits where there is more to begin [s].
FULL = "no space is left where the results go: free space, then run again"


class _Models:
    """Models that jobs need, opened once and let go after the last of their jobs."""

    def __init__(self, works: Iterable[Work], read: Callable[[Path], tuple[Model, str]]):
        self.read = read
        self.open = dict[Path, tuple[Model, str]]()
        self.wanted = Counter(work.model for work in works)

    def of(self, path: Path | None) -> tuple[Model | None, str]:
        """Return the model of a file, and the hash of that."""
        if path is None:
            return None, ""
        if path not in self.open:
            self.open[path] = self.read(path)
        return self.open[path]

    def done(self, path: Path | None) -> None:
        """Count a job with this model that has ended for good."""
        self.wanted[path] -= 1
        if path is not None and not self.wanted[path]:
            self.open.pop(path, None)


class Schedule:
    """Jobs, each done once what it needs has ended well.

    `read` gives the model of a file, and its hash.
    """

    def __init__(
        self,
        works: Sequence[Work],
        workers: Workers,
        read: Callable[[Path], tuple[Model, str]],
        watcher: StudyWatcher,
    ):
        self.works = {work.key: work for work in works}
        self.models = _Models(works, read)
        self.workers = workers
        self.watcher = watcher
        self.outcomes: dict[Key, Outcome] = {}
        self.losses: Counter[Key] = Counter()
        self.running = 0
        self.full = False
        self.order = TopologicalSorter(
            {work.key: {*work.needs, *work.after} & self.works.keys() for work in works}
        )
        self.order.prepare()
        self.ready = deque(self.order.get_ready())

    def run(self) -> dict[Key, Outcome]:
        """Do all of them."""
        while self.ready or self.running:
            until = time.monotonic() + PATIENCE
            free = max(1, self.workers.count)
            while self.ready and self.running < free and time.monotonic() < until:
                self._start(self.works[self.ready.popleft()])
            if not self.running:
                continue
            # Where many results are there already, those that compute are seen to meanwhile.
            ended = self.workers.ended(AT_ONCE if self.ready and self.running < free else PATIENCE)
            for ended_job in ended:
                self.running -= 1
                self._take(ended_job)
            if not ended:
                self.watcher.idle()
        return self.outcomes

    def _start(self, work: Work) -> None:
        if self.full:
            self._end(work, not_run(work, FULL))
            return
        failure = next((self.outcomes[key] for key in work.needs if self.outcomes[key].error), None)
        if failure is not None:
            self._end(work, not_run(work, failure.error.removeprefix("not run: "), failure.fault))
            return
        try:
            model, read = self.models.of(work.model)
        except Exception as error:
            self._end(work, failed(outcome_of(work.key, work.folder), error))
            return
        # With the hash of the model's file they see where it has changed since.
        reused = None if work.fresh else work.reused(model, read)
        if reused is not None:
            self._end(work, reused)
            return
        self.running += 1
        self.watcher.started(work.key)
        self.workers.start(Job(work.key, partial(work, read=read)), model)

    def _take(self, ended: Ended) -> None:
        work = self.works[ended.job.key]
        if ended.outcome is not None:
            self._end(work, ended.outcome)
            return
        if no_space(work.folder):
            # A process that cannot write may end of it: nothing is gained by beginning another.
            self.full = True
        self.losses[work.key] += 1
        again = self.losses[work.key] < 2 and not self.full
        self.watcher.lost(work.key, ended.lost, again)
        if again:
            self.ready.appendleft(work.key)
            return
        text = (
            f"its worker was lost twice: {ended.lost}"
            if self.losses[work.key] > 1
            else f"not run: {FULL}"
        )
        self._end(work, replace(outcome_of(work.key, work.folder), error=text))

    def _end(self, work: Work, outcome: Outcome) -> None:
        self.full = self.full or outcome.full
        self.outcomes[work.key] = outcome
        self.models.done(work.model)
        self.watcher.ended(outcome)
        self.order.done(work.key)
        self.ready.extend(self.order.get_ready())


def run_study(
    plan: Plan,
    out: Path,
    *,
    fresh: bool = False,
    workers: Workers | None = None,
    report: Callable[[Outcome], None] = lambda outcome: None,
) -> list[Outcome]:
    """Run all trials of a plan, each into `out/subject/trial`, and write the tables of the study.

    Steps whose inputs, options and version have not changed since an earlier run are reused.

    What a study is and what it writes is described in docs/studies.md.

    Parameters
    ----------
    plan : as `read_plan` reads it
    out : folder of the results, made where it does not exist
    fresh : compute every step, whatever an earlier run left
    workers : that do the jobs, closed at the end; None does them in this process
    report : called with each trial's outcome when it ends

    Returns
    -------
    outcomes in the order of the study file, those of groups and tables last

    Raises
    ------
    BadData
        where another run writes into the folder, or a newer version has
    BadFile
        where the folder cannot be written

    Examples
    --------
    >>> from pathlib import Path
    >>> import myomorph as mm
    >>> outcomes = mm.run_study(mm.read_plan("study.toml"), Path("results"))
    >>> len(outcomes), sorted(mm.load("results"))
    (1, ['s01/reach'])
    """
    return run_graph(partial(graph_of, plan, out, fresh), out, workers, report)


def run_graph(
    graph_of: Callable[[RunMark], Graph],
    out: Path,
    workers: Workers | None = None,
    report: Callable[[Outcome], None] = lambda outcome: None,
) -> list[Outcome]:
    """Do all jobs of a study, then what is done for the whole study.

    The latter reports failures, too. Outcomes come in the order of the study file, those of the
    whole study last; `graph_of` is from the run to what it has to do in its folder.
    """
    workers = workers or InProcess()
    try:
        with study_lock(out) as mark:
            graph = graph_of(mark)
            learning = Learning({work.key: work for work in graph.works})
            watcher = StudyWatcher(
                graph=graph, out=out, workers=workers, said=report, learning=learning
            )
            try:
                _run(graph, workers, watcher, learning)
                learning.keep(watcher.outcomes())
            except BaseException as error:
                watcher.interrupted(error)
                raise
            finally:
                # Workers end before the lock does, so that no other run meets them.
                workers.close()
                watcher.close()
    finally:
        workers.close()
    return watcher.outcomes()


def _run(graph: Graph, workers: Workers, watcher: StudyWatcher, learning: Learning) -> None:
    def read(path: Path) -> tuple[Model, str]:
        sha = file_source("model", path).sha256
        model = graph.open_model(path)
        if file_source("model", path).sha256 != sha:
            raise BadData(f"{path}: has changed while it was read: run the study again")
        learning.muscles[path] = len(model.muscles)
        return model, sha

    def done(works: Sequence[Work]) -> tuple[Outcome, ...]:
        outcomes = Schedule(works=works, workers=workers, read=read, watcher=watcher).run()
        return tuple(outcomes[work.key] for work in works)

    done(graph.last(done(graph.works)))
